"""Coders of a single level: Draco, and gltfpack, which also simplifies."""
import gzip, json, os, struct, time
import numpy as np

from peer.run import Run, write_ply


def draco(positions, triangles, bits, path):
    """Bytes of one level. Writes the decoded mesh to `path`."""
    import DracoPy

    data = DracoPy.encode(positions, triangles, quantization_bits=bits, compression_level=10)
    decoded = DracoPy.decode(data)
    write_ply(path, decoded.points, decoded.faces)
    return len(data)


def draco_timed(positions, triangles, bits, path):
    """Bytes, and CPU seconds of coding and decoding."""
    start = time.process_time()
    size = draco(positions, triangles, bits, path)
    return size, time.process_time() - start


def decoders(positions, triangles, bits):
    """Name, bytes, and millions of vertices decoded per CPU second, of coders of a single level."""
    import DracoPy, meshoptimizer

    for level in (10, 7, 1):
        data = DracoPy.encode(positions, triangles, quantization_bits=bits, compression_level=level)
        yield f"Draco, level {level}", len(data), len(positions) / cpu_seconds(lambda: DracoPy.decode(data)) / 1e6
    indices, points = triangles.reshape(-1).copy(), positions
    # Prepared as its tools do for its codecs: indices by strips, vertices in the order of use, integers of 16 bits.
    meshoptimizer.optimize_vertex_cache(indices, indices.copy(), vertex_count=len(points))
    moved = np.empty_like(points)
    count = meshoptimizer.optimize_vertex_fetch(moved, indices, points.copy())
    low = moved[:count].min(0)
    whole = np.round((moved[:count] - low) / float((moved[:count] - low).max()) * (2 ** bits - 1)).astype(np.uint16)
    rows = np.zeros((count, 4), np.uint16)
    rows[:, :3] = whole
    coded = meshoptimizer.encode_vertex_buffer(rows, count, 8), meshoptimizer.encode_index_buffer(indices, len(indices), count)
    both = lambda: (meshoptimizer.decode_vertex_buffer(count, 8, coded[0]), meshoptimizer.decode_index_buffer(len(indices), 4, coded[1]))
    yield "meshoptimizer's codecs", sum(map(len, coded)), count / cpu_seconds(both) / 1e6


def cpu_seconds(call):
    """Median of several calls; short calls are repeated often enough."""
    times = []
    for _ in range(7):
        start, count = time.process_time(), 0
        while time.process_time() - start < 0.05:
            call()
            count += 1
        times.append((time.process_time() - start) / count)
    return sorted(times)[3]


def write_glb(path, positions, triangles):
    points, indices = np.ascontiguousarray(positions, "<f4"), np.ascontiguousarray(triangles, "<u4")
    total = points.nbytes + indices.nbytes
    head = json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": total}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": points.nbytes},
                        {"buffer": 0, "byteOffset": points.nbytes, "byteLength": indices.nbytes}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
             "min": points.min(0).tolist(), "max": points.max(0).tolist()},
            {"bufferView": 1, "componentType": 5125, "count": indices.size, "type": "SCALAR"}]}).encode()
    head += b" " * (-len(head) % 4)
    with open(path, "wb") as f:
        f.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(head) + 8 + total))
        f.write(struct.pack("<I4s", len(head), b"JSON") + head + struct.pack("<I4s", total, b"BIN\0"))
        f.write(points.tobytes() + indices.tobytes())


def read_packed_glb(path):
    """Positions and triangles of a file of gltfpack: one mesh, compressed by meshoptimizer's codecs."""
    from meshoptimizer import decode_index_buffer, decode_vertex_buffer

    data = open(path, "rb").read()
    length, = struct.unpack_from("<I", data, 12)
    head = json.loads(data[20:20 + length])
    binary = data[20 + length + 8:]

    def view(accessor):
        coded = next(iter(head["bufferViews"][accessor["bufferView"]]["extensions"].values()))
        at = coded.get("byteOffset", 0)
        return coded, binary[at:at + coded["byteLength"]]

    positions, triangles, base = [], [], 0
    for node in head["nodes"]:
        for primitive in head["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            where, faces = (head["accessors"][primitive[k] if k == "indices" else primitive["attributes"]["POSITION"]]
                            for k in ("POSITION", "indices"))
            coded, part = view(where)
            kind = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}[where["componentType"]]
            rows = np.frombuffer(np.ascontiguousarray(decode_vertex_buffer(coded["count"], coded["byteStride"], part)).tobytes(), np.uint8)
            width = np.dtype(kind).itemsize * 3
            points = rows.reshape(coded["count"], coded["byteStride"])[:, :width].copy().view(kind).astype(float)
            if where.get("normalized"):
                points /= np.iinfo(kind).max
            scale, shift = (np.array(node.get(k, [d] * 3), float) for k, d in (("scale", 1), ("translation", 0)))
            coded, part = view(faces)
            # Decoded into 32 bits, whatever the file asks for: the binding has no other buffer.
            indices = decode_index_buffer(coded["count"], 4, part).astype(np.int64)
            positions.append(points * scale + shift)
            triangles.append(indices.reshape(-1, 3) + base)
            base += len(points)
    return np.concatenate(positions), np.concatenate(triangles)


class Gltfpack:
    """`command` is gltfpack, or node with its cli.js; `source` is a GLB of `triangles` triangles."""

    def __init__(self, command, source, triangles, work):
        self.command, self.source, self.triangles, self.work = command, source, triangles, work

    def pack(self, count, bits, path):
        """Bytes for about `count` triangles, the same sent with gzip, and CPU seconds. Writes the decoded mesh to
        `path`."""
        out = os.path.join(self.work, "packed.glb")
        share = min(count / self.triangles, 1)
        # Its manual calls -cz maximum compression, above -cc. Without -se it stops at 1 % of the extent.
        simplify = () if share >= 1 else ("-si", f"{share:.9f}", "-se", "1")
        run = Run(*self.command, "-i", self.source, "-o", out, "-cz", "-vp", bits, *simplify)
        data = open(out, "rb").read()
        write_ply(path, *read_packed_glb(out))
        return len(data), len(gzip.compress(data, 9)), run.cpu
