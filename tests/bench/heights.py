#!/usr/bin/env python3
"""Compares files of heights with LERC, LERC and zlib, 16-bit PNG and compressed differences, and their triangles with
martini and delatin.

usage: heights.py LODPACK RASTER:TOLERANCE[,TOLERANCE...] ... [--triangles]

Needs numpy, Pillow and lerc; with --triangles also pymartini and pydelatin, and square rasters of 2^k+1 samples. All
codecs get the same largest error; where all samples are integers, numbers within it of one another are as good for all
of them. Sizes are bits a sample; those of lodpack are of the whole file, with all levels, their errors and the
index."""
import io, os, resource, subprocess, sys, tempfile, zlib
import numpy as np
from PIL import Image


def cpu(children=True):
    usage = resource.getrusage(resource.RUSAGE_CHILDREN if children else resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def sizes(lodpack, path, tolerance, folder):
    import lerc
    image = Image.open(path)
    z = np.asarray(image).astype("float32")
    # Samples without data are known to all codecs, and do not count.
    nodata = getattr(image, "tag_v2", {}).get(42113)
    known = z != np.float32(nodata) if nodata else np.ones(z.shape, bool)
    bits = lambda count: 8 * count / known.sum()
    out = os.path.join(folder, "out.lodpack")
    before = cpu()
    subprocess.run([lodpack, "build", path, "-o", out, "--heights", "--force", "--tolerance", str(tolerance)], check=True, capture_output=True)
    ours, our_time = bits(os.path.getsize(out)), cpu() - before
    # A number that is less than one and a half off rounds to an integer that is one off.
    is_whole = bool(np.all(z[known] == np.round(z[known])))
    step, off = (2 * int(tolerance) + 1, int(tolerance) + 0.49) if is_whole else (2 * tolerance, tolerance)
    before = cpu(False)
    _, length, blob, *_ = lerc.encode(z, 1, not known.all(), None if known.all() else known.astype("uint8"), off, 1)
    lerc_time, blob = cpu(False) - before, bytes(blob)[:length]
    steps = np.where(known, np.round((z - z[known].min()) / step) + (not known.all()), 0).astype(np.int64)
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
    """The largest vertical distance of samples from triangles of samples. Triangles of one shape are looked at
    together."""
    corners = vertices[triangles]
    shapes, kinds = np.unique((corners - corners[:, :1])[:, 1:].reshape(-1, 4), axis=0, return_inverse=True)
    heights, worst = z.astype(float), 0.0
    order = np.argsort(kinds.reshape(-1), kind="stable")
    ends = np.searchsorted(kinds.reshape(-1)[order], np.arange(len(shapes) + 1))
    for number, (bx, by, cx, cy) in enumerate(shapes.astype(float)):
        area = bx * cy - cx * by
        if area == 0:
            continue
        x, y = np.meshgrid(np.arange(min(0, bx, cx), max(0, bx, cx) + 1), np.arange(min(0, by, cy), max(0, by, cy) + 1))
        s, t = (x * cy - cx * y) / area, (bx * y - x * by) / area
        inside = (s > -1e-9) & (t > -1e-9) & (s + t < 1 + 1e-9)
        x, y, s, t = x[inside].astype(int), y[inside].astype(int), s[inside], t[inside]
        own = order[ends[number]:ends[number + 1]]
        for part in np.array_split(own, max(1, len(own) * len(x) // 4_000_000)):
            a, p = corners[part, 0], heights[corners[part, :, 1], corners[part, :, 0]]
            drawn = p[:, :1] + s * (p[:, 1:2] - p[:, :1]) + t * (p[:, 2:] - p[:, :1])
            worst = max(worst, np.abs(drawn - heights[a[:, 1:] + y, a[:, :1] + x]).max(initial=0.0))
    return worst


def triangles(lodpack, path, tolerances, folder):
    import json
    from pydelatin import Delatin
    from pymartini import Martini
    z = np.ascontiguousarray(np.asarray(Image.open(path)).astype("float32"))
    out, ply = os.path.join(folder, "out.lodpack"), os.path.join(folder, "out.ply")
    # Fine enough that rounding counts for nothing beside what is asked for.
    before = cpu()
    subprocess.run([lodpack, "build", path, "-o", out, "--heights", "--force", "--tolerance", str(min(tolerances) / 50)], check=True, capture_output=True)
    build_time, before = cpu() - before, cpu(False)
    tile = Martini(z.shape[0]).create_tile(z)
    tile_time = cpu(False) - before

    def extract(*options):
        before = cpu()
        said = subprocess.run([lodpack, "extract", out, "-o", ply, "--force", "--json", *options], check=True, capture_output=True)
        return json.loads(said.stdout)["triangles"], cpu() - before

    for tolerance in tolerances:
        ours, our_time = extract("--tolerance", str(tolerance))
        tin, tin_time = extract("--tin", "--tolerance", str(tolerance))
        before = cpu(False)
        delatin = len(np.asarray(Delatin(z.copy(), max_error=tolerance).triangles).reshape(-1, 3))
        delatin_time = cpu(False) - before
        # Martini's own number is not the largest error: it is asked for less until the largest error is the same.
        low, high, martini = 0.0, tolerance, 2 * (z.shape[0] - 1) ** 2
        for _ in range(6):
            middle, before = 0.5 * (low + high), cpu(False)
            vertices, found = (np.asarray(part) for part in tile.get_mesh(middle))
            mesh_time = cpu(False) - before
            found = found.reshape(-1, 3)
            if vertical(z, vertices.reshape(-1, 2).astype(int), found) <= tolerance:
                low, martini = middle, len(found)
            else:
                high = middle
        print(f"{os.path.basename(path)} at {tolerance}: lodpack {ours}, --tin {tin}, delatin {delatin}, martini {martini}; --tin {tin / delatin:.2f} of "
              f"delatin, {tin / martini:.2f} of martini; CPU s build {build_time:.2f} (once), cut {our_time:.2f}, --tin {tin_time:.2f}, delatin {delatin_time:.2f}, "
              f"martini {tile_time:.2f} (once) and {mesh_time:.2f}", flush=True)


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
