"""Textured and coloured models at equal triangles, beside gltfpack: bytes, triangles, and PSNR of colour over the surface.

    python3 tests/bench/textured.py LODPACK MESH.ply [PHOTOGRAPH] [--gltfpack PROGRAM]

With a photograph, the mesh gets it by spherical coordinates about its middle; without one, it must have colours of vertices. Each cut of
the file is compared with the input by `colours.py`; `gltfpack -noq -si` simplifies to the same triangles. Needs what `colours.py` needs.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np
import pyvista
from PIL import Image

JUDGE = pathlib.Path(__file__).with_name("colours.py")


def textured(mesh_path, image_path, folder):
    mesh = pyvista.read(mesh_path)
    points, triangles = np.asarray(mesh.points, float), mesh.faces.reshape(-1, 4)[:, 1:]
    from_middle = points - (points.min(axis=0) + points.max(axis=0)) / 2
    u = np.arctan2(from_middle[:, 1], from_middle[:, 0]) / (2 * np.pi) + 0.5
    v = np.arcsin(np.clip(from_middle[:, 2] / np.linalg.norm(from_middle, axis=1), -1, 1)) / np.pi + 0.5
    u = u[triangles]
    wraps = (u.max(axis=1) - u.min(axis=1)) > 0.5
    u = np.where(wraps[:, None] & (u < 0.5), u + 1, u)
    Image.open(image_path).convert("RGB").save(folder / "photo.png")
    (folder / "photo.mtl").write_text("newmtl photo\nKd 1 1 1\nmap_Kd photo.png\n")
    with open(folder / "photo.obj", "w") as out:
        out.write("mtllib photo.mtl\n")
        out.writelines("v %r %r %r\n" % tuple(map(float, point)) for point in points)
        out.writelines("vt %.7f %.7f\n" % (u[t, k], v[triangles[t, k]]) for t in range(len(triangles)) for k in range(3))
        out.write("usemtl photo\n")
        for t, corners in enumerate(triangles):
            out.write("f " + " ".join(f"{corner + 1}/{3 * t + k + 1}" for k, corner in enumerate(corners)) + "\n")
    return folder / "photo.obj"


def judged(source, path):
    out = subprocess.run([sys.executable, JUDGE, source, path], check=True, capture_output=True, text=True).stdout
    triangles, decibels = re.search(r": (\d+) triangles, ([\d.]+) dB", out).groups()
    return int(triangles), float(decibels)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("lodpack")
    parser.add_argument("mesh")
    parser.add_argument("photograph", nargs="?")
    parser.add_argument("--gltfpack")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        source = textured(options.mesh, options.photograph, folder) if options.photograph else pathlib.Path(options.mesh)
        file = folder / "model.lodpack"
        built = subprocess.run([options.lodpack, "build", source, "-o", file, "--channels", "colour"], check=True, capture_output=True, text=True)
        print(next(line.strip() for line in built.stdout.splitlines() if line.strip().startswith("CPU")))
        print(f"all levels: {os.path.getsize(file)} bytes")
        print("triangles   lodpack dB   gltfpack triangles, dB, bytes")
        whole, last = None, None
        for share in [1, 4, 20, 100]:
            cut = folder / f"cut{share}.obj"
            budget = [] if whole is None else ["--triangles", str(whole // share)]
            extracted = subprocess.run([options.lodpack, "extract", file, "-o", cut, "--force", *budget], capture_output=True, text=True)
            if extracted.returncode != 0:
                continue
            triangles, decibels = judged(source, cut)
            whole = whole or triangles
            if triangles == last:
                continue
            last, peer = triangles, ""
            if options.gltfpack and options.photograph:
                ratio = triangles / int(re.search(r"input\s+([\d,]+) triangles", built.stdout).group(1).replace(",", ""))
                packed = folder / "packed.glb"
                subprocess.run([options.gltfpack, "-i", source, "-o", packed, "-noq", "-si", f"{ratio:.5f}"], check=True, capture_output=True)
                of_peer, decibels_of_peer = judged(source, packed)
                size = os.path.getsize(packed)
                peer = f"{of_peer:8} {decibels_of_peer:8.2f} {size:9}"
            print(f"{triangles:9} {decibels:12.2f}   {peer}")


if __name__ == "__main__":
    main()
