#!/usr/bin/env python3
"""Open surfaces with ragged borders: coarse levels and reduced cuts of grids without data at their borders, beside
Delatin.

usage: ragged.py [--grids N] [--size SAMPLES] [--work DIR] [--jacksboro]

Needs numpy, scipy, matplotlib and pydelatin (requirements.txt), with --jacksboro rasterio, too; target/hausdorff (see
hausdorff.cpp); and the program `lodpack`, by default in target/release (or $LODPACK). The grids are windows of the
heights that come with matplotlib, from which seeded borders are cut: turned rectangles as reprojections leave them,
random walks, wedges, and some with holes. Each is built as a mesh. CGAL is the judge of all distances, both ways, from
the mesh that has two triangles per cell.

Delatin has no samples without data. So it runs on grids filled with the nearest height and on grids filled far below,
at the finest error that leaves as few triangles inside the border, and the nearer result counts. The table has both
distances at 230, 350 and 1,000 triangles and their ratio, the distance of the top, and whether the stated errors of the
levels fall strictly."""
import argparse
import json
import os
import pathlib
import subprocess
import sys

import matplotlib
import numpy as np
from pydelatin import Delatin
from scipy import ndimage

ROOT = pathlib.Path(__file__).parents[2]
LODPACK = os.environ.get("LODPACK", ROOT / "target" / "release" / "lodpack")
JUDGE = os.environ.get("HAUSDORFF", ROOT / "target" / "hausdorff")
COUNTS = (230, 350, 1000)
NODATA = -32768


def output(*command):
    return subprocess.run([str(word) for word in command], capture_output=True, check=True, text=True).stdout


def sample_grid():
    data = pathlib.Path(matplotlib.__file__).parent / "mpl-data" / "sample_data" / "jacksboro_fault_dem.npz"
    return np.load(data)["elevation"].astype(np.int16)


def ragged(seed, size):
    """A window of the grid with a border of one of four kinds."""
    random = np.random.default_rng(seed)
    grid = sample_grid()
    top, left = (random.integers(0, extent - size) for extent in grid.shape)
    window = grid[top : top + size, left : left + size].copy()
    rows, columns = np.mgrid[0:size, 0:size]
    x, y = columns - size / 2, rows - size / 2
    kind = seed % 4
    if kind == 0:
        # As a reprojection leaves it.
        turn = np.radians(random.uniform(0.5, 25.0)) * random.choice([-1, 1])
        across, down = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        reach = size / 2 / (abs(np.cos(turn)) + abs(np.sin(turn)))
        inside = (abs(across) < reach) & (abs(down) < reach)
    elif kind == 1:
        # Each side is a random walk.
        walk = lambda: np.abs(np.cumsum(random.integers(-2, 3, size)))
        north, south, west, east = (walk() for _ in range(4))
        inside = (rows >= north[columns]) & (rows < size - south[columns])
        inside &= (columns >= west[rows]) & (columns < size - east[rows])
    elif kind == 2:
        # A star of random radii.
        angles = np.arctan2(y, x)
        corners = np.sort(random.uniform(-np.pi, np.pi, 12))
        radii = random.uniform(0.25, 0.49, 12) * size
        inside = np.hypot(x, y) < np.interp(angles, corners, radii, period=2 * np.pi)
    else:
        # Wedges from the border inwards, and holes.
        inside = np.ones_like(window, bool)
        for _ in range(6):
            middle, half = random.uniform(-np.pi, np.pi), random.uniform(0.03, 0.25)
            off = np.abs((np.arctan2(y, x) - middle + np.pi) % (2 * np.pi) - np.pi)
            inside &= (off > half) | (np.hypot(x, y) < random.uniform(0.2, 0.45) * size)
        for _ in range(4):
            at = random.uniform(0.2, 0.8, 2) * size
            inside &= np.hypot(rows - at[0], columns - at[1]) > random.uniform(2.0, 0.06 * size)
    parts, _ = ndimage.label(inside)
    largest = np.argmax(np.bincount(parts.ravel())[1:]) + 1
    window[parts != largest] = NODATA
    return window, 80.0


def jacksboro(resampling):
    """The whole grid in UTM, as rasterio reprojects it."""
    import rasterio.transform
    import rasterio.warp

    data = pathlib.Path(matplotlib.__file__).parent / "mpl-data" / "sample_data" / "jacksboro_fault_dem.npz"
    west, south, east, north = (float(np.load(data)[key]) for key in ("xmin", "ymin", "xmax", "ymax"))
    grid = sample_grid()
    box = sorted([west, east]), sorted([south, north])
    (west, east), (south, north) = box
    height, width = grid.shape
    place, columns, rows = rasterio.warp.calculate_default_transform(
        "EPSG:4326", "EPSG:32616", width, height, west, south, east, north
    )
    result = np.full((rows, columns), NODATA, np.int16)
    before = rasterio.transform.from_bounds(west, south, east, north, width, height)
    rasterio.warp.reproject(
        grid,
        result,
        src_transform=before,
        src_crs="EPSG:4326",
        dst_transform=place,
        dst_crs="EPSG:32616",
        resampling=rasterio.warp.Resampling[resampling],
        src_nodata=NODATA,
        dst_nodata=NODATA,
    )
    return result, place.a


def whole_mesh(grid, spacing):
    """Two triangles per cell along the shorter diagonal, or one where a sample lacks, as lodpack has them."""
    rows, columns = grid.shape
    x = np.arange(columns)[None, :] * spacing + np.zeros((rows, 1))
    y = -np.arange(rows)[:, None] * spacing + np.zeros((1, columns))
    positions = np.stack([x, y, grid.astype(float)], axis=-1).reshape(-1, 3)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    height = positions[:, 2]
    first = np.abs(height[a] - height[c]) <= np.abs(height[b] - height[d])
    has = [height[v] != NODATA for v in (a, b, c, d)]
    # Where b or d lacks the diagonal is that from a to c, and the other way round.
    first = np.where(~has[1] | ~has[3], True, np.where(~has[0] | ~has[2], False, first))
    one = np.where(first, [a, c, b], [a, d, b]).T
    other = np.where(first, [a, d, c], [b, d, c]).T
    triangles = np.concatenate([one, other])
    return positions, triangles[(height[triangles] != NODATA).all(axis=1)]


def write_off(path, positions, triangles):
    used, numbers = np.unique(triangles, return_inverse=True)
    numbers = numbers.reshape(triangles.shape)
    with open(path, "w") as out:
        out.write(f"OFF\n{len(used)} {len(triangles)} 0\n")
        np.savetxt(out, positions[used], "%.17g")
        np.savetxt(out, np.insert(numbers, 0, 3, axis=1), "%d")


def write_asc(path, grid, spacing):
    rows, columns = grid.shape
    with open(path, "w") as out:
        out.write(f"ncols {columns}\nnrows {rows}\nxllcenter 0\nyllcenter {-(rows - 1) * spacing!r}\n")
        out.write(f"cellsize {spacing!r}\nNODATA_value {NODATA}\n")
        np.savetxt(out, grid, "%d")


def read_obj(path):
    lines = [line.split() for line in path.read_text().splitlines()]
    positions = np.array([line[1:4] for line in lines if line[:1] == ["v"]], float)
    triangles = np.array([[v.split("/")[0] for v in line[1:4]] for line in lines if line[:1] == ["f"]], int) - 1
    return positions, triangles


def distance(work, whole, mesh, bound):
    write_off(work / "mesh.off", *mesh)
    return max(float(word) for word in output(JUDGE, bound, whole, work / "mesh.off").split())


def delatin(grid, spacing, count):
    """Delatin's meshes of at most the given number of triangles inside, one for each way to fill what lacks."""
    has = grid != NODATA
    nearest = ndimage.distance_transform_edt(~has, return_distances=False, return_indices=True)
    low = grid[has].min() - 4.0 * (grid[has].max() - grid[has].min())
    for filled in (grid[tuple(nearest)].astype(float), np.where(has, grid, low)):
        best, fine, coarse = None, 0.5, 4000.0
        for _ in range(14):
            middle = np.sqrt(fine * coarse)
            made = Delatin(filled.astype(np.float32), max_error=middle)
            positions = np.asarray(made.vertices, float).reshape(-1, 3)
            triangles = np.asarray(made.triangles).reshape(-1, 3)
            column = np.clip(np.round(positions[triangles, 0].mean(axis=1)).astype(int), 0, grid.shape[1] - 1)
            # Delatin counts rows from below.
            row = grid.shape[0] - 1 - np.round(positions[triangles, 1].mean(axis=1)).astype(int)
            inside = has[np.clip(row, 0, grid.shape[0] - 1), column] & (positions[triangles, 2] > low + 1).all(axis=1)
            triangles = triangles[inside]
            if len(triangles) > count:
                fine = middle
            else:
                coarse = middle
                if len(triangles):
                    places = positions * [spacing, spacing, 1.0]
                    places[:, 1] -= (grid.shape[0] - 1) * spacing
                    best = (places, triangles)
        if best:
            yield best


def measure(name, grid, spacing, work):
    asc, file, whole, mesh = (work / f"{name}{end}" for end in (".asc", ".lodpack", ".off", ".obj"))
    write_asc(asc, grid, spacing)
    write_off(whole, *whole_mesh(grid, spacing))
    output(LODPACK, "build", asc, "-o", file, "--force")
    levels = json.loads(output(LODPACK, "info", file, "--json"))["levels"]
    errors = [level["certified_error"] for level in levels]
    falls = all(coarse > fine for coarse, fine in zip(errors, errors[1:]))
    extract = lambda *words: (output(LODPACK, "extract", file, "-o", mesh, "--force", *words), read_obj(mesh))[1]
    top = extract("--tolerance", repr(errors[0]))
    cells = [f"{name}", f"{len(top[1])}", f"{errors[0]:.0f}", f"{distance(work, whole, top, 1.0):.0f}"]
    ratios = []
    for count in COUNTS:
        ours = distance(work, whole, extract("--triangles", count), 1.0)
        theirs = min((distance(work, whole, other, 1.0) for other in delatin(grid, spacing, count)), default=np.inf)
        ratios.append(ours / theirs)
        cells.append(f"{ours:.0f} / {theirs:.0f} = {ratios[-1]:.2f}")
    print("| " + " | ".join(cells + ["fall" if falls else "DO NOT FALL: " + " ".join(f"{e:.4g}" for e in errors)]) + " |", flush=True)
    return ratios, falls


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grids", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--work", type=pathlib.Path, default=ROOT / "target" / "ragged")
    parser.add_argument("--jacksboro", action="store_true")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    print("| grid | top | stated | judged | " + " | ".join(f"at {count}" for count in COUNTS) + " | errors of levels |")
    print("|---|" + "---:|" * (3 + len(COUNTS)) + "---|")
    grids = [(f"seed {seed}", *ragged(seed, options.size)) for seed in range(options.first, options.first + options.grids)]
    if options.jacksboro:
        grids += [(f"Jacksboro, {way}", *jacksboro(way)) for way in ("nearest", "bilinear")]
    results = [measure(name, grid, spacing, options.work) for name, grid, spacing in grids]
    ratios = [ratio for of_grid, _ in results for ratio in of_grid]
    rising = sum(not falls for _, falls in results)
    print(f"largest ratio {max(ratios):.2f}, {sum(r > 1.5 for r in ratios)} of {len(ratios)} above 1.5; errors do not fall in {rising} files")
    return 1 if max(ratios) > 1.5 or rising else 0


if __name__ == "__main__":
    sys.exit(main())
