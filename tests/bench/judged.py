#!/usr/bin/env python3
"""Compares `lodpack compare` with CGAL's bounded-error Hausdorff distance.

usage: judged.py LODPACK HAUSDORFF [PAIRS]

Makes pairs of meshes (20 by default: bumpy spheres, coarser, moved, turned, with holes), has both programs measure each
direction, and prints a Markdown table with the largest difference. Exits with 1 if any is above 2 %. Needs numpy, and
the program of hausdorff.cpp."""
import json, math, os, subprocess, sys, tempfile

import numpy as np

from accuracy import sphere

MOST = 0.02


def write_off(path, points, faces):
    with open(path, "w") as out:
        out.write(f"OFF\n{len(points)} {len(faces)} 0\n")
        out.writelines("%r %r %r\n" % tuple(map(float, p)) for p in points)
        out.writelines("3 %d %d %d\n" % tuple(f) for f in faces)


def pair(number):
    rng = lambda: np.random.default_rng(number)
    fine, coarse = 10 + number % 7, 6 + number % 5
    stretch = np.array([1.0, 1.0, [1.0, 0.2, 3.0][number % 3]])
    a = sphere(fine, 0.05 * (number % 4), stretch, 0.0, rng())
    b = sphere(coarse, 0.05 * (number % 4), stretch, [0.0, 0.03, 0.3][number % 3], rng())
    if number % 5 == 4:
        # Without a quarter of its triangles.
        b = b[0], b[1][: 3 * len(b[1]) // 4]
    if number % 2:
        c, s = math.cos(number), math.sin(number)
        b = b[0] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T, b[1]
    return a, b


def main():
    lodpack, judge = sys.argv[1:3]
    worst = 0.0
    print("| pair | A to B | CGAL | B to A | CGAL | difference |\n|---:|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        for number in range(int(sys.argv[3]) if len(sys.argv) > 3 else 20):
            paths = [os.path.join(folder, name) for name in ("a.off", "b.off")]
            for path, mesh in zip(paths, pair(number)):
                write_off(path, *mesh)
            level = json.loads(subprocess.run([lodpack, "compare", *paths, "--gap", "0.5%", "--json"], check=True, capture_output=True).stdout)["levels"][0]
            ours = [level[way]["upper"] for way in ("a_to_b", "b_to_a")]
            bound = 0.005 * max(min(ours), 1e-9)
            theirs = [float(x) for x in subprocess.run([judge, repr(bound), *paths], check=True, capture_output=True, text=True).stdout.split()]
            off = max(abs(a - b) / max(b, 1e-12) for a, b in zip(ours, theirs))
            worst = max(worst, off)
            print(f"| {number} | {ours[0]:.5f} | {theirs[0]:.5f} | {ours[1]:.5f} | {theirs[1]:.5f} | {100 * off:.2f} % |", flush=True)
    print(f"largest difference {100 * worst:.2f} %")
    return 1 if worst > MOST else 0


if __name__ == "__main__":
    sys.exit(main())
