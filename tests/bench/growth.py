#!/usr/bin/env python3
"""Measures how the processor time of a build grows with its input, for every family of shapes. Prints a Markdown table.

usage: growth.py [--sizes N,N,...] [--only KIND,KIND,...] [--limit SECONDS] [--most EXPONENT] [--work DIR]
                 [--lodpack PROGRAM] [--generate PROGRAM]

Each family that the program `generate` knows, and a few of rasters, is built with about as many triangles (corners of
a polygon, samples of a raster) as each size says, on one thread. The exponent is the slope of a line through the
logarithms of size and time: 1 is linear, 2 quadratic. A size whose build takes longer than the limit is named as such,
and larger ones are left out. The exit status is 1 if a family has an exponent beyond --most, or a build that did not
end. Small builds, of less than .05 s, say little of growth and are left out of the fit.

Needs the release binaries (cargo build --release --workspace), or those that are named."""
import argparse, math, os, resource, subprocess, sys, tempfile

TRIANGLES = 12
# What `generate` is to be given for so many triangles.
MESHES = {
    **{kind: lambda n: max(8, round(math.sqrt(n / 12) / 8) * 8) for kind in ("sphere", "rough", "part")},
    "torus": lambda n: round(math.sqrt(n)),
    "sheet": lambda n: round(math.sqrt(n / 1.78)),
    "pipes": lambda n: max(1, n // 96),
    "boxes": lambda n: max(1, n // TRIANGLES),
    **{kind: lambda n: n for kind in ("fan", "cone", "star", "comb", "needles", "flat", "stairs", "spiral", "screw", "shells",
                                      "sheets", "stack", "soup")},
}
POLYGONS = ("crossing", "wandering")
# Heights of rasters, by column and row as shares of the width.
RASTERS = {
    "flat raster": lambda x, y: 7.0,
    "island": lambda x, y: 7.0 + max(0.0, 0.01 - (x - 0.3) ** 2 - (y - 0.4) ** 2) * 500,
    "terraces": lambda x, y: float(int(8 * x) + int(6 * y)),
    "ramp": lambda x, y: 50.0 * x + 20.0 * y,
}


def polygon(generate, kind, n, work):
    path = os.path.join(work, "polygon.obj")
    subprocess.run([generate, kind, str(n), path], check=True, stdout=subprocess.DEVNULL)
    return path, n


def mesh(generate, kind, n, work):
    path = os.path.join(work, "mesh.ply")
    said = subprocess.run([generate, kind, str(MESHES[kind](n)), path], check=True, capture_output=True, text=True).stdout
    return path, int(said.split(",")[1].split()[0])


def raster(kind, n, work):
    """An ESRI ASCII grid of about n samples."""
    side, path = round(math.sqrt(n)), os.path.join(work, "raster.asc")
    with open(path, "w") as file:
        file.write(f"ncols {side}\nnrows {side}\nxllcorner 0\nyllcorner 0\ncellsize 1\n")
        for row in range(side):
            file.write(" ".join(f"{RASTERS[kind](column / side, row / side):.4g}" for column in range(side)) + "\n")
    return path, side * side


def cpu_seconds(lodpack, path, work, limit):
    """Processor time of a build; none if it takes longer than the limit."""
    command = [lodpack, "build", path, "-o", os.path.join(work, "out.lodpack"), "--force", "--threads", "1", "--progress", "none"]
    cap = lambda: resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=cap)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode < 0:
        return None
    if done.returncode:
        sys.exit(f"{path}: {done.stderr.strip()}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def exponent(points):
    """The slope of the line that fits best through the logarithms."""
    points = [(math.log(n), math.log(seconds)) for n, seconds in points if seconds >= 0.05]
    if len(points) < 2:
        return None
    middle = [sum(values) / len(points) for values in zip(*points)]
    across = sum((x - middle[0]) ** 2 for x, _ in points)
    return sum((x - middle[0]) * (y - middle[1]) for x, y in points) / across


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    numbers = lambda text: [int(n) for n in text.split(",")]
    parser.add_argument("--sizes", type=numbers, default=[50_000, 100_000, 200_000, 400_000])
    parser.add_argument("--only", type=lambda text: text.split(","))
    parser.add_argument("--limit", type=int, default=120, help="seconds of processor time for a build")
    parser.add_argument("--most", type=float, default=1.2, help="the largest exponent")
    parser.add_argument("--work")
    target = os.path.join(os.path.dirname(__file__), "..", "..", "target", "release")
    parser.add_argument("--lodpack", default=os.path.join(target, "lodpack"))
    parser.add_argument("--generate", default=os.path.join(target, "generate"))
    args = parser.parse_args()
    kinds = [*MESHES, *POLYGONS, *RASTERS]
    unknown = set(args.only or []) - set(kinds)
    if unknown:
        sys.exit(f"unknown: {', '.join(sorted(unknown))}; there are {', '.join(kinds)}")
    print("| family | " + " | ".join(f"{n:,}" for n in args.sizes) + " | us each | exponent |")
    print("|---|" + "---|" * (len(args.sizes) + 2))
    failed = []
    with tempfile.TemporaryDirectory(dir=args.work) as work:
        for kind in args.only or kinds:
            points, cells = [], []
            for n in args.sizes:
                if kind in RASTERS:
                    path, count = raster(kind, n, work)
                else:
                    path, count = (polygon if kind in POLYGONS else mesh)(args.generate, kind, n, work)
                seconds = cpu_seconds(args.lodpack, path, work, args.limit)
                os.remove(path)
                if seconds is None:
                    cells.append(f"> {args.limit} s")
                    failed.append(kind)
                    break
                points.append((count, seconds))
                cells.append(f"{seconds:.2f} s")
            cells += [""] * (len(args.sizes) - len(cells))
            slope = exponent(points)
            if slope is not None and slope > args.most:
                failed.append(kind)
            each = f"{points[-1][1] / points[-1][0] * 1e6:.1f}" if points else ""
            print(f"| {kind} | " + " | ".join(cells) + f" | {each} | {'' if slope is None else f'{slope:.2f}'} |", flush=True)
    if failed:
        sys.exit(f"beyond {args.most}: {', '.join(dict.fromkeys(failed))}")


if __name__ == "__main__":
    main()
