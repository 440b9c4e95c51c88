#!/usr/bin/env python3
"""Compares files of heights with LERC, LERC and zlib, 16-bit PNG and compressed differences, and their triangles with martini and delatin.

usage: heights.py LODPACK RASTER:TOLERANCE[,TOLERANCE...] ... [--triangles]

Needs numpy, Pillow and lerc; with --triangles also pymartini and pydelatin, and square rasters of 2^k+1 samples. All codecs get the same
largest error. Sizes are bits a sample; those of lodpack are of the whole file, with all levels, their errors and the index."""
import io, os, resource, subprocess, sys, tempfile, zlib
import numpy as np
from PIL import Image


def cpu(children=True):
    usage = resource.getrusage(resource.RUSAGE_CHILDREN if children else resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def sizes(lodpack, path, tolerance, folder):
    import lerc
    z = np.asarray(Image.open(path)).astype("float32")
    bits = lambda count: 8 * count / z.size
    out = os.path.join(folder, "out.lodpack")
    before = cpu()
    subprocess.run([lodpack, "build", path, "-o", out, "--heights", "--force", "--tolerance", str(tolerance)], check=True, capture_output=True)
    ours, our_time = bits(os.path.getsize(out)), cpu() - before
    before = cpu(False)
    _, length, blob, *_ = lerc.encode(z, 1, False, None, tolerance, 1)
    lerc_time, blob = cpu(False) - before, bytes(blob)[:length]
    steps = np.round((z - z.min()) / (2 * tolerance)).astype(np.int64)
    row = {"lodpack": ours, "LERC": bits(len(blob)), "LERC+zlib": bits(len(zlib.compress(blob, 9)))}
    if steps.max() < 65536:
        png = io.BytesIO()
        Image.fromarray(steps.astype("uint16")).save(png, "PNG", optimize=True)
        row["PNG"] = bits(png.getbuffer().nbytes)
    deltas = np.diff(steps, axis=1, prepend=0).astype("<i4")
    row["deltas"] = bits(len(zlib.compress(deltas.tobytes(), 9)))
    best = min(value for name, value in row.items() if name != "lodpack")
    text = "  ".join(f"{name} {value:.2f}" for name, value in row.items())
    speed = lambda seconds: f"{z.size / max(seconds, 1e-3) / 1e6:.1f}"
    print(f"{os.path.basename(path)} {z.shape[1]} x {z.shape[0]} at {tolerance}: {text}  of the best {ours / best:.2f}; "
          f"million samples a CPU second {speed(our_time)}, LERC {speed(lerc_time)}", flush=True)


def vertical(z, vertices, triangles):
    """The largest vertical distance of samples from triangles of samples."""
    heights, worst = z[vertices[:, 1], vertices[:, 0]].astype(float), 0.0
    for corners in triangles:
        (a, b, c), (p, q, r) = vertices[corners].astype(float), heights[corners]
        low, high = vertices[corners].min(0), vertices[corners].max(0)
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0:
            continue
        x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
        s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
        t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
        inside = (s > -1e-9) & (t > -1e-9) & (s + t < 1 + 1e-9)
        off = np.abs(p + s * (q - p) + t * (r - p) - z[low[1]:high[1] + 1, low[0]:high[0] + 1])[inside]
        worst = max(worst, off.max(initial=0.0))
    return worst


def triangles(lodpack, path, tolerances, folder):
    import json
    from pydelatin import Delatin
    from pymartini import Martini
    z = np.ascontiguousarray(np.asarray(Image.open(path)).astype("float32"))
    out, ply = os.path.join(folder, "out.lodpack"), os.path.join(folder, "out.ply")
    # Fine enough that rounding counts for nothing beside what is asked for.
    subprocess.run([lodpack, "build", path, "-o", out, "--heights", "--force", "--tolerance", str(min(tolerances) / 50)], check=True, capture_output=True)
    tile = Martini(z.shape[0]).create_tile(z)
    for tolerance in tolerances:
        said = subprocess.run([lodpack, "extract", out, "-o", ply, "--force", "--json", "--tolerance", str(tolerance)], check=True, capture_output=True)
        ours = json.loads(said.stdout)["triangles"]
        delatin = len(np.asarray(Delatin(z.copy(), max_error=tolerance).triangles).reshape(-1, 3))
        # Martini's own number is not the largest error: it is asked for less until the largest error is the same.
        low, high = 0.0, tolerance
        for _ in range(7):
            middle = 0.5 * (low + high)
            vertices, found = (np.asarray(part) for part in tile.get_mesh(middle))
            found = found.reshape(-1, 3)
            if vertical(z, vertices.reshape(-1, 2).astype(int), found) <= tolerance:
                low, martini = middle, len(found)
            else:
                high = middle
        print(f"{os.path.basename(path)} at {tolerance}: lodpack {ours}, delatin {delatin} ({ours / delatin:.2f}), martini {martini} "
              f"({ours / martini:.2f})", flush=True)


def main():
    args = [arg for arg in sys.argv[1:] if arg != "--triangles"]
    if len(args) < 2:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as folder:
        for arg in args[1:]:
            path, _, list_of = arg.rpartition(":")
            tolerances = [float(part) for part in list_of.split(",")]
            if "--triangles" in sys.argv:
                triangles(args[0], path, tolerances, folder)
            else:
                for tolerance in tolerances:
                    sizes(args[0], path, tolerance, folder)


main()
