"""Simplifies a mesh to about a given number of triangles. As a program, it runs one simplification in its own process:

    simplify.py TOOL IN.ply TRIANGLES OUT.ply

IN.ply must be written by `write_ply`. Prints the CPU seconds of the simplification alone as JSON."""
import json, os, sys, time
import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from peer.run import Distance, Run, read_ply, write_ply


def decimate(meshes, triangles):
    meshes.apply_filter("meshing_decimation_quadric_edge_collapse", targetfacenum=int(triangles),
                        qualitythr=0.3, preserveboundary=True, preservenormal=True)


def meshopt(positions, triangles, ratio):
    import meshoptimizer

    indices = triangles.ravel()
    out = np.zeros_like(indices)
    count = meshoptimizer.simplify(out, indices, positions, target_index_count=int(len(triangles) * ratio) * 3, target_error=1.0)
    used, inverse = np.unique(out[:count], return_inverse=True)
    return positions[used], inverse.reshape(-1, 3)


def _pymeshlab(positions, triangles, count):
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(positions.astype(float), triangles.astype(np.int32)))
    yield
    decimate(meshes, count)
    yield meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix()


def _vtk(positions, triangles, count):
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(positions, triangles.astype(int))
    yield
    mesh = mesh.decimate(1 - count / len(triangles))
    yield mesh.points, mesh.regular_faces


def _fast_simplification(positions, triangles, count):
    import fast_simplification

    yield
    yield fast_simplification.simplify(positions, triangles.astype(np.int32), target_reduction=1 - count / len(triangles))


def _pyfqmr(positions, triangles, count):
    import pyfqmr

    simplifier = pyfqmr.Simplify()
    simplifier.setMesh(positions, triangles)
    yield
    simplifier.simplify_mesh(target_count=int(count), aggressiveness=7, preserve_border=True, verbose=False)
    yield simplifier.getMesh()[:2]


def _meshoptimizer(positions, triangles, count):
    import meshoptimizer  # noqa: F401, loaded before timing starts

    yield
    yield meshopt(positions, triangles, count / len(triangles))


# Each loads the mesh first, which is not timed.
TOOLS = {"pymeshlab": _pymeshlab, "VTK": _vtk, "fast-simplification": _fast_simplification, "pyfqmr": _pyfqmr,
         "meshoptimizer": _meshoptimizer}
# Takes minutes and gigabytes on millions of triangles.
LONG = {"pymeshlab", "VTK"}


class Simplifier:
    """One tool on one mesh. Keeps the results already computed."""

    def __init__(self, tool, source, triangles, reference, work):
        self.tool, self.source, self.triangles, self.reference = tool, source, triangles, reference
        self.folder = os.path.join(work, "simplified")
        os.makedirs(self.folder, exist_ok=True)
        self.kept, self.measured = {}, {}

    def mesh(self, count):
        """The file and CPU seconds for about `count` triangles."""
        count = int(count)
        if count not in self.kept:
            path = os.path.join(self.folder, f"{self.tool}-{count}.ply")
            seconds = Run(sys.executable, os.path.abspath(__file__), self.tool, self.source, count, path).json()
            self.kept[count] = path, seconds
        return self.kept[count]

    def distance(self, count):
        count = int(count)
        if count not in self.measured:
            self.measured[count] = Distance(self.reference, self.mesh(count)[0])
        return self.measured[count]

    def guess(self, measure, limit):
        """The number of triangles that should reach this error, from the nearest measured one: errors are about
        inversely proportional to triangles."""
        known = [(getattr(d, measure), d.triangles) for d in self.measured.values() if getattr(d, measure) > 0]
        error, triangles = min(known, key=lambda pair: abs(np.log(pair[0] / limit)))
        return triangles * error / limit


def main():
    tool, source, count, out = sys.argv[1:]
    positions, triangles = read_ply(source)
    steps = TOOLS[tool](positions, triangles, int(count))
    next(steps)
    start = time.process_time()
    simplified = next(steps)
    seconds = time.process_time() - start
    positions, triangles = (np.asarray(a) for a in simplified)
    # Unused vertices would count in a coder's bytes.
    used, inverse = np.unique(triangles, return_inverse=True)
    write_ply(out, positions[used], inverse.reshape(-1, 3))
    print(json.dumps(seconds))


if __name__ == "__main__":
    main()
