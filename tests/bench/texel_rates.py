"""What colours cost, beside JPEG and WebP at equal PSNR.

    python3 tests/bench/texel_rates.py IMAGE [IMAGE ...]

Each image is cut to at most 1024 x 1024 texels, coded by lodpack's example `texel_rates`, and by pillow's JPEG (4:4:4,
optimised tables) and WebP (method 6) at qualities from 5 to 99; their bytes at the PSNR of each of lodpack's steps are
interpolated. Needs numpy and pillow.
"""

import io
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


def decibels(a, b):
    return 10 * np.log10(255**2 / np.mean((a.astype(float) - b.astype(float)) ** 2))


def curve(image, form, **options):
    points = []
    for quality in [5, 10, 20, 30, 40, 50, 60, 70, 75, 80, 85, 90, 93, 95, 97, 99]:
        out = io.BytesIO()
        image.save(out, form, quality=quality, **options)
        back = Image.open(io.BytesIO(out.getvalue())).convert("RGB")
        points.append((decibels(np.asarray(image), np.asarray(back)), len(out.getvalue())))
    return sorted(points)


def at(points, wanted):
    known, sizes = zip(*points)
    if not known[0] <= wanted <= known[-1]:
        return None
    return float(np.exp(np.interp(wanted, known, np.log(sizes))))


def main():
    for path in sys.argv[1:]:
        image = Image.open(path).convert("RGB")
        image = image.crop((0, 0, min(1024, image.width), min(1024, image.height)))
        texels = image.width * image.height
        peers = {"JPEG": curve(image, "JPEG", subsampling=0, optimize=True), "WebP": curve(image, "WEBP", method=6)}
        with tempfile.NamedTemporaryFile(suffix=".ppm") as file:
            image.save(file.name)
            command = ["cargo", "run", "--release", "-q", "-p", "lodpack", "--features", "write", "--example", "texel_rates"]
            out = subprocess.run([*command, "--", file.name], cwd=REPOSITORY, check=True, capture_output=True, text=True)
        print(f"{path}: {image.width} x {image.height}")
        print("step  PSNR dB  bits/texel  of JPEG's  of WebP's")
        for line in out.stdout.splitlines()[1:]:
            step, bits, found, _ = (float(x) for x in line.split())
            ratios = [at(points, found) for points in peers.values()]
            shown = ["       -" if size is None else f"{bits * texels / 8 / size:8.2f}" for size in ratios]
            print(f"{step:4.0f} {found:8.2f} {bits:11.3f}  {shown[0]}   {shown[1]}")


if __name__ == "__main__":
    main()
