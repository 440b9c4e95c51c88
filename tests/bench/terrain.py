#!/usr/bin/env python3
"""Terrain: size, time and vertical error of files built from grids of heights, beside pydelatin and pymartini.

usage: terrain.py [--work DIR] [--samples N] [--only NAME]

Needs numpy, matplotlib, rasterio, pydelatin and pymartini (requirements.txt), and the programs `lodpack` and `terrain`
of this repository in target/release. Two real grids come with matplotlib (Jacksboro fault, 3 seconds of arc; the sea
and the land around Vancouver, 2 minutes); the fractal ones are generated. Every triangle mesh is judged by the same
code: its height at every sample of the grid, and the largest vertical difference counts. Delatin and martini are then
asked for as much error as lodpack's mesh has by that judge, so triangles stand beside each other at equal largest
error. Times are CPU seconds."""
import argparse
import pathlib
import resource
import subprocess

import matplotlib
import numpy as np
import rasterio
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
    """Largest and root mean square vertical difference at the samples of a grid. Where several triangles lie above each
    other, the nearest one counts; samples on the very border may be missed, and do not count."""
    xs, ys, heights = grid
    columns, rows = (vertices[:, 0] - xs[0]) / (xs[1] - xs[0]), (vertices[:, 1] - ys[0]) / (ys[1] - ys[0])
    x, y, z = columns[triangles], rows[triangles], vertices[:, 2][triangles]
    off = np.full(heights.size, np.inf)
    low = [np.maximum(np.ceil(c.min(1) - 1e-9), 0).astype(int) for c in (x, y)]
    high = [np.minimum(np.floor(c.max(1) + 1e-9), size - 1).astype(int) for c, size in ((x, len(xs)), (y, len(ys)))]
    extent = [high[k] - low[k] + 1 for k in (0, 1)]
    area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    # Triangles of similar extent together: each sample of their box in turn.
    todo = np.flatnonzero((extent[0] > 0) & (extent[1] > 0) & (area != 0))
    order = todo[np.argsort(extent[0][todo] * extent[1][todo], kind="stable")]
    for chunk in np.array_split(order, max(1, len(order) // 20000)):
        for dy in range(extent[1][chunk].max(initial=0)):
            for dx in range(extent[0][chunk].max(initial=0)):
                t = chunk[(dx < extent[0][chunk]) & (dy < extent[1][chunk])]
                px, py = low[0][t] + dx, low[1][t] + dy
                u = ((px - x[t, 0]) * (y[t, 2] - y[t, 0]) - (x[t, 2] - x[t, 0]) * (py - y[t, 0])) / area[t]
                v = ((x[t, 1] - x[t, 0]) * (py - y[t, 0]) - (px - x[t, 0]) * (y[t, 1] - y[t, 0])) / area[t]
                inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
                at = (py * len(xs) + px)[inside]
                height = (z[t, 0] + u * (z[t, 1] - z[t, 0]) + v * (z[t, 2] - z[t, 0]))[inside]
                np.minimum.at(off, at, np.abs(height - heights.ravel()[at]))
    off = off.reshape(heights.shape)[1:-1, 1:-1]
    assert np.isfinite(off).all(), "a sample inside is not covered"
    return off.max(), np.sqrt((off**2).mean())


def least_triangles(make, judge, wanted):
    """Triangles, and RMS, of the smallest mesh whose largest vertical difference is at most so much, by bisection of
    what it is asked for."""
    low, high, best = wanted * 0.2, wanted * 2.0, None
    for _ in range(9):
        middle = (low + high) / 2
        vertices, triangles = make(middle)
        largest, rms = judge(vertices, triangles)
        if largest <= wanted:
            low, best = middle, min(best or (len(triangles), rms), (len(triangles), rms))
        else:
            high = middle
    return best


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("work-data/terrain"))
    parser.add_argument("--samples", type=int, default=513, help="samples of a side of the fractal grid")
    parser.add_argument("--only", default="", help="only grids whose name begins like this")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    grids = list(real_grids(args.work))
    fractal = args.work / "fractal.tif"
    subprocess.run([PROGRAMS / "terrain", "flat", str(args.samples), str(args.samples), fractal], check=True)
    grids.append((f"fractal {args.samples}", fractal))
    print("| grid | tolerance | samples | file, bits a sample | CPU s | samples a CPU s | triangles | largest vertical | RMS | delatin, triangles (times fewer) | RMS | martini | RMS |")
    print("|---|---|" + "---:|" * 11)
    for name, path in (grid for grid in grids if grid[0].startswith(args.only)):
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
            peers = [f"{peer[0]:,} ({len(triangles) / peer[0]:.2f}) | {peer[1]:.3f}" if peer else " | " for peer in peers]
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
        mesh = Delatin(heights.astype("float32"), max_error=error)
        # Its rows count from the last one.
        columns, rows = mesh.vertices[:, 0], heights.shape[0] - 1 - mesh.vertices[:, 1]
        return np.column_stack([xs[0] + columns * (xs[1] - xs[0]), ys[0] + rows * (ys[1] - ys[0]), mesh.vertices[:, 2]]), mesh.triangles

    return least_triangles(make, lambda v, t: vertical(v, np.asarray(t, np.int32), grid), wanted)


def martini(grid, wanted):
    from pymartini import Martini

    xs, ys, heights = grid
    size = heights.shape[0]
    if heights.shape[0] != heights.shape[1] or (size - 1) & (size - 2) != 0:
        return None  # It takes squares of a power of two and one samples.
    tile = Martini(size).create_tile(heights.astype("float32"))

    def make(error):
        corners, triangles = tile.get_mesh(error)
        corners, triangles = corners.reshape(-1, 2).astype(int), triangles.reshape(-1, 3).astype(np.int32)
        columns, rows = corners[:, 0], corners[:, 1]
        return np.column_stack([xs[columns], ys[rows], heights[rows, columns]]), triangles

    return least_triangles(make, lambda v, t: vertical(v, t, grid), wanted)


main()
