#!/usr/bin/env python3
"""Compares certified errors with CGAL's bounded-error Hausdorff distance.

usage: cgal.py MESH [FILE.lodpack]

Builds the file unless it is given, extracts a cut at the error of each level, and lets CGAL measure it against the
input, in both directions, within 1 % of the certified error. Prints a Markdown table in mean edge lengths, and exits
with 1 if a bound is too small. Needs target/hausdorff (see hausdorff.cpp), the release binaries and pymeshlab
(requirements.txt)."""
import json, os, subprocess, sys, tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
LODPACK = os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target")), "release", "lodpack")


def output(*command):
    return subprocess.run([str(c) for c in command], capture_output=True, check=True, text=True).stdout


def to_off(source, target):
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(source)
    meshes.apply_filter("meshing_remove_duplicate_vertices")
    mesh = meshes.current_mesh()
    with open(target, "w") as out:
        out.write(f"OFF\n{mesh.vertex_number()} {mesh.face_number()} 0\n")
        out.writelines("%r %r %r\n" % tuple(float(x) for x in p) for p in mesh.vertex_matrix())
        out.writelines("3 %d %d %d\n" % tuple(t) for t in mesh.face_matrix())


def main():
    mesh = sys.argv[1]
    sound = True
    with tempfile.TemporaryDirectory() as work:
        at = lambda name: os.path.join(work, name)
        file = sys.argv[2] if len(sys.argv) > 2 else at("mesh.lodpack")
        if len(sys.argv) <= 2:
            output(LODPACK, "build", mesh, "-o", file)
        to_off(mesh, at("input.off"))
        info = json.loads(output(LODPACK, "info", file, "--json"))
        edge = info["mean_edge_length"]
        print(f"| {os.path.basename(mesh)}: triangles | certified | CGAL, input to cut | CGAL, cut to input |\n|---:|---:|---:|---:|")
        done = set()
        for level in info["levels"]:
            wanted = ("--tolerance", repr(level["certified_error"]))
            cut = json.loads(output(LODPACK, "extract", file, "-o", at("cut.ply"), "--force", "--json", *wanted))
            if cut["triangles"] in done:
                continue
            done.add(cut["triangles"])
            to_off(at("cut.ply"), at("cut.off"))
            certified = cut["certified_error"]
            found = [float(x) for x in output(os.path.join(ROOT, "target", "hausdorff"), certified * 0.01, at("input.off"), at("cut.off")).split()]
            # CGAL's figure is an upper bound, within 1 % of the certified error.
            sound &= max(found) <= certified * 1.01
            print(f"| {cut['triangles']:,} | {certified / edge:.4f} | {found[0] / edge:.4f} | {found[1] / edge:.4f} |", flush=True)
    print("sound" if sound else "A BOUND IS TOO SMALL")
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
