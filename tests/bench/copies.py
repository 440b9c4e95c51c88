#!/usr/bin/env python3
"""Writes moved copies of a mesh beside each other, as an input of any size that is made in no time.

usage: copies.py MESH.ply COUNT FOLDER

MESH is a little-endian binary PLY whose vertices are three floats, as `generate` writes them with `--single`. The
copies, FOLDER/copy-0.ply and so on, stand in a square grid, so that none touches another. Only numpy is needed."""
import math, pathlib, sys

import numpy as np

HEADER_END = b"end_header\n"
# Vertices that are moved at once.
CHUNK = 1 << 22


def main(mesh, count, folder):
    mesh, count, folder = pathlib.Path(mesh), int(count), pathlib.Path(folder)
    with open(mesh, "rb") as file:
        start = file.read(1 << 16)
    header = start[: start.index(HEADER_END) + len(HEADER_END)]
    lines = header.decode().splitlines()
    elements = [line for line in lines if line.startswith(("element", "property"))]
    expected = ["property float x", "property float y", "property float z"]
    if "format binary_little_endian 1.0" not in lines or elements[1:4] != expected or not elements[4].startswith("element face"):
        sys.exit(f"{mesh} is not a binary PLY whose vertices are three floats")
    vertices = int(elements[0].split()[-1])
    bytes_of = np.memmap(mesh, dtype=np.uint8, mode="r")
    positions = np.frombuffer(bytes_of, dtype="<f4", count=3 * vertices, offset=len(header)).reshape(-1, 3)
    faces = bytes_of[len(header) + 12 * vertices :]
    width = 1.5 * float(np.ptp(positions[:, 0]) + np.ptp(positions[:, 1]))
    side = math.isqrt(count - 1) + 1
    folder.mkdir(parents=True, exist_ok=True)
    for copy in range(count):
        moved = np.array([copy % side * width, copy // side * width, 0], dtype="<f4")
        with open(folder / f"copy-{copy}.ply", "wb") as file:
            file.write(header)
            for first in range(0, vertices, CHUNK):
                file.write((positions[first : first + CHUNK] + moved).tobytes())
            for first in range(0, len(faces), 16 * CHUNK):
                file.write(faces[first : first + 16 * CHUNK].tobytes())


if __name__ == "__main__":
    main(*sys.argv[1:])
