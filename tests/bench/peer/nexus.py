"""Nexus: nxs_build and nxs_compress from pymeshlab, and reading their files.

The header of .nxs and .nxz has 88 bytes, followed by 44 bytes per node and 12 per patch; nodes begin at multiples of
256 bytes. A node's faces are runs, one per patch, each covered by the finer node that the patch names. The last node is
the sink, which is empty."""
import os
import numpy as np

from peer.run import python, read_ply, write_ply

IDLE = "import pymeshlab\npymeshlab.MeshSet()"
BUILD = "import sys,pymeshlab\nms=pymeshlab.MeshSet()\nms.apply_filter('nxs_build',input_file=sys.argv[1],output_file=sys.argv[2],ram=2000)\n"
COMPRESS = "ms.apply_filter('nxs_compress',input_file=sys.argv[2],output_file=sys.argv[3])\n"
# A given step of positions instead of the default share of an edge. Normals cannot be omitted: use the fewest bits.
COARSE = ("import sys,pymeshlab\npymeshlab.MeshSet().apply_filter('nxs_compress',input_file=sys.argv[1],output_file=sys.argv[2],"
          "nxz_vertex_quantization=float(sys.argv[3]),normal_bits=2)\n")
NODE = np.dtype([("offset", "<u4"), ("vertices", "<u2"), ("faces", "<u2"), ("error", "<f4"), ("cone", "<i2", 4),
                 ("sphere", "<f4", 4), ("tight", "<f4"), ("first_patch", "<u4")])
PATCH = np.dtype([("node", "<u4"), ("end", "<u4"), ("texture", "<u4")])


def fresh(*paths):
    for path in paths:
        if os.path.exists(path):
            os.remove(path)


def nexus(mesh, work, keep=False, ram=2000):
    """Runs nxs_build and nxs_compress in a process of their own. Returns (bytes, Run, CPU and elapsed seconds minus
    Python's own).

    `ram` is the number of megabytes that it may use. The compressed file is `peer.nxz` in `work`; with `keep`, the
    uncompressed one remains as `peer.nxs`."""
    idle = python(IDLE)
    nxs, nxz = os.path.join(work, "peer.nxs"), os.path.join(work, "peer.nxz")
    fresh(nxs, nxz)
    run = python(BUILD.replace("ram=2000", f"ram={ram}") + COMPRESS, mesh, nxs, nxz)
    size = os.path.getsize(nxz)
    if not keep:
        os.remove(nxs)
    return size, run, run.cpu - idle.cpu, run.wall - idle.wall


def build_only(mesh, nxs, triangles):
    """A pyramid of at least two levels. Fewer triangles than these at the top (4,096 by default) give none."""
    fresh(nxs)
    python(BUILD.replace("ram=2000", "ram=2000,top_node_faces=int(sys.argv[3])"), mesh, nxs, max(min(4096, triangles // 4), 1))


def compress(nxs, nxz, step):
    """A compressed file with positions on a lattice. `step` must be a power of two, because the program takes its
    logarithm."""
    fresh(nxz)
    python(COARSE, nxs, nxz, repr(float(step)))
    return os.path.getsize(nxz)


class Index:
    """The part of a file that is read first: its nodes, and where they are."""

    def __init__(self, path):
        self.path, self.size = path, os.path.getsize(path)
        with open(path, "rb") as f:
            head = f.read(88)
            version, = np.frombuffer(head, "<u4", 1, 4)
            nodes, patches, _ = (int(n) for n in np.frombuffer(head, "<u4", 3, 60))
            if head[:4] not in (b" sxN", b"Nxs ") or version != 2 or nodes < 2 or 88 + 44 * nodes + 12 * patches > self.size:
                raise RuntimeError(f"{os.path.basename(path)} is no file of Nexus in version 2")
            kinds, sizes = np.frombuffer(head, "u1", 16, 24).reshape(8, 2).astype(int).T, [0, 1, 1, 2, 2, 4, 4, 4, 8]
            self.vertex_bytes = sum(sizes[kind] * count for kind, count in zip(*kinds))
            self.nodes = np.frombuffer(f.read(44 * nodes), NODE)
            self.patches = np.frombuffer(f.read(12 * patches), PATCH)
        self.offsets = self.nodes["offset"].astype(np.int64) * 256
        self.sink = nodes - 1

    def runs(self, node):
        """(finer node, first face, end face) of a node's patches."""
        first = 0
        for k in range(self.nodes["first_patch"][node], self.nodes["first_patch"][node + 1]):
            yield int(self.patches["node"][k]), first, int(self.patches["end"][k])
            first = int(self.patches["end"][k])

    def default_step(self):
        """The compressor's own choice of a step: a twentieth of the smallest error of the nodes above the finest."""
        above = [float(self.nodes["error"][n]) for n in range(self.sink) if self.patches["node"][self.nodes["first_patch"][n]] == self.sink]
        step = min([e for e in [float(self.nodes["error"][0]), *above] if e > 0], default=1.0) * 0.05
        return 2.0 ** int(np.log2(step))

    def first_picture(self):
        """Requests and bytes until the roots are read: the header, which gives the length of the index; the index; the
        roots."""
        roots = min(int(self.patches["node"].min()), self.sink)
        return 3, int(self.offsets[roots])

    def coarser(self):
        """For each node, the nodes whose patches it refines."""
        coarser = [[] for _ in range(self.sink + 1)]
        for node in range(self.sink):
            for finer, _, _ in self.runs(node):
                coarser[finer].append(node)
        return coarser

    def selected(self, error):
        """The nodes to refine or draw at this error: the roots, and the nodes above the error below only such nodes."""
        coarser, chosen = self.coarser(), np.zeros(self.sink + 1, bool)
        for node in range(self.sink):
            chosen[node] = not coarser[node] or (self.nodes["error"][node] > error and all(chosen[c] for c in coarser[node]))
        return chosen

    def triangles(self, chosen):
        """Number of triangles that these nodes show."""
        return sum(end - first for n in np.flatnonzero(chosen[:-1]) for finer, first, end in self.runs(n) if not chosen[finer])

    def bytes_of(self, chosen):
        """Bytes of the header, the index and these nodes."""
        return int(self.offsets[0] + sum(self.offsets[n + 1] - self.offsets[n] for n in np.flatnonzero(chosen)))

    def read_for(self, chosen, cube):
        """The chosen nodes that a cube (low x, y, z, high x, y, z) needs: those that touch it, and all above them."""
        low, high = np.array(cube[:3]), np.array(cube[3:])
        centre, reach = self.nodes["sphere"][:, :3].astype(float), self.nodes["tight"].astype(float)
        away = np.maximum(np.maximum(low - centre, centre - high), 0)
        coarser, stack = self.coarser(), list(np.flatnonzero(chosen & ((away**2).sum(1) <= reach**2)))
        wanted = np.zeros(self.sink + 1, bool)
        while stack:
            node = stack.pop()
            if node != self.sink and not wanted[node]:
                wanted[node] = True
                stack += coarser[node]
        return wanted

    def write_cut(self, chosen, path):
        """The surface of these nodes, from an uncompressed file; exact duplicates are welded."""
        data = np.memmap(self.path, np.uint8, "r")
        positions, triangles, base = [], [], 0
        for node in np.flatnonzero(chosen[:-1]):
            at, count = self.offsets[node], int(self.nodes["vertices"][node])
            points = data[at:at + 12 * count].view("<f4").reshape(-1, 3)
            faces = data[at + self.vertex_bytes * count:][:6 * int(self.nodes["faces"][node])].view("<u2").reshape(-1, 3)
            drawn = [faces[first:end] for finer, first, end in self.runs(node) if not chosen[finer]]
            if drawn:
                positions.append(points)
                triangles.append(np.concatenate(drawn).astype(np.int64) + base)
                base += count
        write_ply(path, *weld(np.concatenate(positions), np.concatenate(triangles)))


def weld(positions, triangles):
    """Keeps triangles without area: they may be all that remains of specks of the surface."""
    unique, inverse = np.unique(np.ascontiguousarray(positions, np.float32), axis=0, return_inverse=True)
    used, inverse = np.unique(inverse.reshape(-1)[triangles], return_inverse=True)
    return unique[used], inverse.reshape(-1, 3)


def truncated(source, path, step):
    """A mesh as decoded from the compressor's files: multiples of the step, rounded toward zero (compared with its
    JavaScript decoder)."""
    positions, triangles = read_ply(source)
    write_ply(path, *weld(np.trunc(positions.astype(float) / step) * step, triangles))
