#!/usr/bin/env python3
"""Builds meshes with lodpack and with its peers in one run and prints Markdown tables.

usage: bench.py [--tables speed,size,triangles,verify] [--work DIR] MESH...

Needs the release binaries (cargo build --release --workspace) and tests/bench/requirements.txt in the Python that runs it.
Peers: Nexus (nxs_build + nxs_compress, from pymeshlab), Draco (DracoPy), simplify + Draco (pymeshlab's quadric simplifier),
meshoptimizer's simplifier, clusterlod. All distances come from the program `distance` (RMS by 300,000 points evenly over the
area, maximum by branch and bound), both ways, worse of the two, in mean edge lengths of the input."""
import argparse, json, os, resource, struct, subprocess, sys, time
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BIN = os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target")), "release")


def run(*command, **kwargs):
    """Runs a program; returns its stdout, CPU seconds, elapsed seconds and peak memory in bytes."""
    start, before = time.time(), resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, **kwargs) as child:
        out, err = child.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if child.returncode != 0:
        raise RuntimeError(f"{command[0]} failed: {err.decode()[-400:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return out.decode(), cpu, time.time() - start


def lodpack(*args):
    return run(os.path.join(BIN, "lodpack"), *args)


def distance(a, b):
    """(RMS, largest found, bound on the largest), worse direction, in mean edge lengths of a."""
    d = json.loads(run(os.path.join(BIN, "distance"), a, b)[0])
    edge = d["mean_edge_a"]
    return (
        max(d["rms_ab"], d["rms_ba"]) / edge,
        max(d["max_ab"][0], d["max_ba"][0]) / edge,
        max(d["max_ab"][1], d["max_ba"][1]) / edge,
    )


def read_ply(path):
    """Positions and triangles of the welded input, through lodpack's own importer: a build at full resolution is not needed."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(path)
    meshes.apply_filter("meshing_remove_duplicate_vertices")
    return meshes


def write_ply(path, positions, triangles):
    positions = np.ascontiguousarray(positions, np.float32)
    rows = np.empty(len(triangles), dtype=[("n", "u1"), ("i", "<i4", 3)])
    rows["n"], rows["i"] = 3, triangles
    with open(path, "wb") as f:
        f.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(positions)}\nproperty float x\nproperty float y\n"
            f"property float z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n".encode()
        )
        f.write(positions.tobytes())
        f.write(rows.tobytes())


def nexus(mesh, work):
    """nxs_build and nxs_compress in a process of their own; (bytes, CPU seconds)."""
    code = (
        "import sys,pymeshlab\nms=pymeshlab.MeshSet()\n"
        "ms.apply_filter('nxs_build',input_file=sys.argv[1],output_file=sys.argv[2],ram=2000)\n"
        "ms.apply_filter('nxs_compress',input_file=sys.argv[2],output_file=sys.argv[3])\n"
    )
    nxs, nxz = os.path.join(work, "peer.nxs"), os.path.join(work, "peer.nxz")
    _, idle, _ = run(sys.executable, "-c", "import pymeshlab\npymeshlab.MeshSet()")
    _, cpu, wall = run(sys.executable, "-c", code, mesh, nxs, nxz)
    return os.path.getsize(nxz), cpu - idle, wall


def draco(meshes, bits, work, name):
    import DracoPy

    mesh = meshes.current_mesh()
    positions, triangles = mesh.vertex_matrix().astype(np.float32), mesh.face_matrix().astype(np.uint32)
    data = DracoPy.encode(positions, triangles, quantization_bits=bits, compression_level=10)
    decoded = DracoPy.decode(data)
    path = os.path.join(work, name + ".ply")
    write_ply(path, decoded.points, decoded.faces)
    return len(data), path


def simplified(mesh, ratio):
    meshes = read_ply(mesh)
    meshes.apply_filter(
        "meshing_decimation_quadric_edge_collapse",
        targetfacenum=int(meshes.current_mesh().face_number() * ratio),
        qualitythr=0.3, preserveboundary=True, preservenormal=True,
    )
    return meshes


def meshopt_simplified(mesh, ratio, path):
    import meshoptimizer

    m = read_ply(mesh).current_mesh()
    positions, indices = m.vertex_matrix().astype(np.float32), m.face_matrix().astype(np.uint32).ravel()
    out = np.zeros_like(indices)
    count = meshoptimizer.simplify(out, indices, positions, target_index_count=int(len(indices) / 3 * ratio) * 3, target_error=1.0)
    triangles = out[:count].reshape(-1, 3)
    used, inverse = np.unique(triangles, return_inverse=True)
    write_ply(path, positions[used], inverse.reshape(-1, 3))


def name_of(mesh):
    return os.path.splitext(os.path.basename(mesh))[0]


def table(title, head, rows):
    print(f"\n### {title}\n\n| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(str(c) for c in row) + " |")
    sys.stdout.flush()


def speed(args):
    rows = []
    for mesh in args.meshes:
        size, peer_cpu, peer_wall = nexus(mesh, args.work)
        clod = json.loads(run(os.path.join(BIN, "clusterlod"), mesh)[0])
        n = clod["triangles"]
        rows.append([name_of(mesh), "Nexus", f"{n / peer_cpu / 1e3:.0f} k", "1.00", f"{peer_wall / peer_cpu:.2f}", "", f"{size:,}", ""])
        rows.append(["", "clusterlod (no output)", f"{n / clod['cpu_seconds'] / 1e3:.0f} k", f"{peer_cpu / clod['cpu_seconds']:.2f}", "", "", "", ""])
        for effort in ("fast", "default"):
            out = os.path.join(args.work, f"{name_of(mesh)}-{effort}.lodpack")
            s = json.loads(lodpack("build", mesh, "-o", out, "--effort", effort, "--force", "--json")[0])
            stages = ", ".join(f"{t['stage']} {t['cpu_seconds']:.2f}" for t in s["stages"])
            rows.append(["", f"lodpack {effort}", f"{n / s['cpu_seconds'] / 1e3:.0f} k", f"{peer_cpu / s['cpu_seconds']:.2f}",
                         f"{s['wall_seconds'] / s['cpu_seconds']:.2f}", f"{s['peak_memory_bytes'] / 1e6:.0f} MB", f"{s['bytes']:,}", stages])
    table("Speed", ["mesh", "program", "triangles per CPU s", "times Nexus", "wall / CPU", "peak memory", "bytes", "CPU s by stage"], rows)


def size(args):
    rows = []
    for mesh in args.meshes:
        out = os.path.join(args.work, name_of(mesh) + ".lodpack")
        s = json.loads(lodpack("build", mesh, "-o", out, "--force", "--json")[0])
        finest = os.path.join(args.work, name_of(mesh) + "-finest.ply")
        lodpack("extract", out, "-o", finest, "--force")
        vertices, edge = s["input_vertices"], s["mean_edge_length"]
        line = lambda what, size, path: rows.append([name_of(mesh), what, f"{size:,}", f"{size * 8 / vertices:.2f}",
                                                     *(f"{e:.4f}" for e in distance(mesh, path)[::2])])
        line(f"lodpack, {len(s['levels'])} levels (certified {s['certified_error'] / edge:.3f})", s["bytes"], finest)
        if args.peers:
            rows.append(["", "Nexus .nxz, whole pyramid with normals", f"{nexus(mesh, args.work)[0]:,}", "", "input", ""])
            meshes = read_ply(mesh)
            for bits in (9, 10, 11, 12):
                line(f"Draco {bits} bits, one level", *draco(meshes, bits, args.work, "draco"))
            for ratio, bits in ((0.1, 11), (0.1, 12), (0.3, 12)):
                line(f"simplify {ratio:.0%} + Draco {bits}, one level", *draco(simplified(mesh, ratio), bits, args.work, "simplified"))
    table("Size", ["mesh", "file", "bytes", "bits per vertex", "RMS", "max"], rows)


def triangles(args):
    rows = []
    for mesh in args.meshes:
        fine = os.path.join(args.work, name_of(mesh) + "-fine.lodpack")
        lodpack("build", mesh, "-o", fine, "--tolerance", args.fine, "--force", "--json")
        prefix = os.path.join(args.work, "clod")
        n = json.loads(run(os.path.join(BIN, "clusterlod"), mesh, prefix)[0])["triangles"]
        for percent in (50, 10, 2):
            path = os.path.join(args.work, f"cut{percent}.ply")
            default = os.path.join(args.work, name_of(mesh) + ".lodpack")
            cut = lambda file: json.loads(lodpack("extract", file, "--triangles", int(n * percent / 100), "-o", path, "--force", "--json")[0])
            entries = [(f"lodpack, file of --tolerance {args.fine}", cut(fine)["triangles"], distance(mesh, path))]
            if os.path.exists(default):
                entries.append(("lodpack, default file", cut(default)["triangles"], distance(mesh, path)))
            meshopt_simplified(mesh, percent / 100, path)
            entries.append(("meshopt", None, distance(mesh, path)))
            s = simplified(mesh, percent / 100)
            s.save_current_mesh(path, binary=True)
            entries.append(("quadric, optimal placement", s.current_mesh().face_number(), distance(mesh, path)))
            entries.append(("clusterlod level", None, distance(mesh, f"{prefix}_{percent}.ply")))
            reference = next(e[2][0] for e in entries if e[0] == "meshopt")
            for what, count, (rms, _, largest) in entries:
                rows.append([name_of(mesh), f"{percent} %", what, f"{count:,}" if count else "", f"{rms:.4f}", f"{largest:.3f}", f"{rms / reference:.2f}"])
    table("Error at equal triangles", ["mesh", "share", "program", "triangles", "RMS", "max (certified)", "RMS over meshopt"], rows)


def verify(args):
    rows = []
    for mesh in args.meshes:
        out = os.path.join(args.work, name_of(mesh) + ".lodpack")
        lodpack("build", mesh, "-o", out, "--force", "--json")
        r = json.loads(lodpack("verify", out, "--against", mesh, "--cuts", "1000", "--json")[0])
        for level in r["levels"]:
            rows.append([name_of(mesh), level["level"], f"{level['triangles']:,}", f"{level['stored']:.4g}", f"{level['measured']:.4g}",
                         f"{level['ratio_median']:.3f}", f"{level['ratio_max']:.2f}"])
        rows.append([name_of(mesh), "all", "", "", "", f"{r['ratio_median']:.3f}", f"{r['cuts']} cuts, {len(r['problems'])} problems"])
    table("Stored over measured error", ["mesh", "level", "triangles", "stored", "measured", "median ratio", "largest ratio"], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", default="speed,size,triangles,verify")
    parser.add_argument("--work", default="bench-work")
    parser.add_argument("--fine", default="0.1edge", help="tolerance of the file that the 50 %% cut comes from")
    parser.add_argument("--no-peers", dest="peers", action="store_false")
    parser.add_argument("meshes", nargs="+")
    args = parser.parse_args()
    os.makedirs(args.work, exist_ok=True)
    for name in args.tables.split(","):
        {"speed": speed, "size": size, "triangles": triangles, "verify": verify}[name](args)


if __name__ == "__main__":
    main()
