#!/usr/bin/env python3
"""Terrain: size, time and vertical error of files built from grids of heights, beside pydelatin and pymartini.

usage: terrain.py [--work DIR] [--samples N]

Needs numpy, matplotlib, rasterio, pydelatin and pymartini (requirements.txt), and the programs `lodpack` and `terrain` of this
repository in target/release. Two real grids come with matplotlib (Jacksboro fault, 3 seconds of arc; the sea and the land around Vancouver,
2 minutes); the fractal ones are generated. Every triangle mesh is judged by the same code: matplotlib's triangle finder looks up its height
at every sample of the grid, and the largest vertical difference counts. Delatin and martini are then asked for as much error as lodpack's
mesh has by that judge, so triangles stand beside each other at equal largest error. Times are CPU seconds."""
import argparse
import pathlib
import resource
import subprocess

import matplotlib
import numpy as np
import rasterio
from matplotlib import tri
from rasterio.transform import from_origin

PROGRAMS = pathlib.Path(__file__).parents[2] / "target" / "release"


def run(*words):
    """Runs a program; its CPU seconds and its largest memory in MB so far."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def real_grids(work):
    """GeoTIFFs of the grids that come with matplotlib, in metres on a plane so that heights can be compared."""
    data = pathlib.Path(matplotlib.__file__).parent / "mpl-data" / "sample_data"
    jacksboro = np.load(data / "jacksboro_fault_dem.npz")["elevation"].astype("int16")
    sea = np.load(data / "topobathy.npz")["topo"].astype("float32")
    # Rows from the north; a second of arc is 24.9 m to the east there, and 30.8 m to the north.
    for name, heights, spacing in [("jacksboro", jacksboro, (74.6, 92.5)), ("vancouver", sea[::-1], (2425.0, 2432.0))]:
        path = work / f"{name}.tif"
        form = dict(driver="GTiff", count=1, crs="EPSG:32617", compress="deflate", predictor=2 if heights.dtype == "int16" else 3)
        size = dict(height=heights.shape[0], width=heights.shape[1], dtype=heights.dtype)
        with rasterio.open(path, "w", transform=from_origin(500000, 4000000, *spacing), **form, **size) as out:
            out.write(heights, 1)
        yield name, path


def read_ply(path):
    """Vertices and triangles of a binary PLY with double coordinates."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    counts = [int(line.split()[2]) for line in data[:end].decode().splitlines() if line.startswith("element")]
    vertices = np.frombuffer(data, "<f8", 3 * counts[0], end).reshape(-1, 3)
    faces = np.frombuffer(data, np.dtype([("n", "u1"), ("v", "<u4", 3)]), counts[1], end + 24 * counts[0])
    return vertices, faces["v"].astype(np.int32)


def vertical(vertices, triangles, grid):
    """Largest and root mean square vertical difference at the samples of a grid; samples on its very border may be missed."""
    xs, ys, heights = grid
    found = tri.Triangulation(vertices[:, 0], vertices[:, 1], triangles)
    interpolated = tri.LinearTriInterpolator(found, vertices[:, 2])(*np.meshgrid(xs, ys))
    off = np.abs(interpolated - heights)[1:-1, 1:-1]
    return off.max(), np.sqrt((off**2).mean())


def least_triangles(make, judge, wanted):
    """The mesh of fewest triangles whose largest vertical difference is at most so much, by bisection of what it is asked for."""
    low, high, best = wanted * 0.2, wanted * 2.0, None
    for _ in range(12):
        middle = (low + high) / 2
        vertices, triangles = make(middle)
        if judge(vertices, triangles)[0] <= wanted:
            low, best = middle, len(triangles) if best is None else min(best, len(triangles))
        else:
            high = middle
    return best


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("work-data/terrain"))
    parser.add_argument("--samples", type=int, default=1025)
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    grids = list(real_grids(args.work))
    fractal = args.work / "fractal.tif"
    subprocess.run([PROGRAMS / "terrain", "flat", str(args.samples), str(args.samples), fractal], check=True)
    grids.append((f"fractal {args.samples}", fractal))
    print("| grid | tolerance | samples | file, bits a sample | CPU s | samples a CPU s | triangles | largest vertical | RMS | delatin, triangles | martini |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    for name, path in grids:
        with rasterio.open(path) as file:
            heights, place = file.read(1).astype(float), file.transform
        xs = place.c + (np.arange(heights.shape[1]) + 0.5) * place.a
        ys = place.f + (np.arange(heights.shape[0]) + 0.5) * place.e
        grid = (xs, ys, heights)
        for tolerance in ["auto", "5m"]:
            built, mesh = args.work / "out.lodpack", args.work / "out.ply"
            seconds = run(PROGRAMS / "lodpack", "build", path, "-o", built, "--force", "--tolerance", tolerance)
            run(PROGRAMS / "lodpack", "extract", built, "-o", mesh, "--force")
            vertices, triangles = read_ply(mesh)
            largest, rms = vertical(vertices, triangles, grid)
            peers = [delatin(grid, largest), martini(grid, largest)]
            peers = ["" if count is None else f"{count:,} ({len(triangles) / count:.2f})" for count in peers]
            bits = built.stat().st_size * 8 / heights.size
            print(
                f"| {name} | {tolerance} | {heights.size:,} | {bits:.2f} | {seconds:.1f} | {heights.size / seconds:,.0f} | {len(triangles):,} |"
                f" {largest:.2f} | {rms:.3f} | {peers[0]} | {peers[1]} |",
                flush=True,
            )


def delatin(grid, wanted):
    from pydelatin import Delatin

    xs, ys, heights = grid

    def make(error):
        mesh = Delatin(heights[::-1].astype("float32"), max_error=error)
        columns, rows = mesh.vertices[:, 0], mesh.vertices[:, 1]
        return np.column_stack([xs[0] + columns * (xs[1] - xs[0]), ys[-1] + rows * (ys[0] - ys[1]), mesh.vertices[:, 2]]), mesh.triangles

    return least_triangles(make, lambda v, t: vertical(v, np.asarray(t, np.int32), grid), wanted)


def martini(grid, wanted):
    from pymartini import Martini

    xs, ys, heights = grid
    size = heights.shape[0]
    if heights.shape[0] != heights.shape[1] or size & (size - 1) != 1:
        return None  # It takes squares of a power of two and one samples.
    tile = Martini(size).create_tile(heights.astype("float32"))

    def make(error):
        corners, triangles = tile.get_mesh(error)
        corners, triangles = corners.reshape(-1, 2).astype(int), triangles.reshape(-1, 3).astype(np.int32)
        columns, rows = corners[:, 0], corners[:, 1]
        return np.column_stack([xs[columns], ys[rows], heights[rows, columns]]), triangles

    return least_triangles(make, lambda v, t: vertical(v, t, grid), wanted)


main()
