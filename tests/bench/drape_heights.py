#!/usr/bin/env python3
"""Compares images over files of heights with JPEGs of as many decibels.

usage: drape_heights.py LODPACK [--dem DEM] [--picture OUT.png] IMAGE...

Each image is laid over the whole DEM. What comes out of the file at full size is
compared with the image: decibels are those of all components. The JPEG is that of Pillow (4:4:4, and 4:2:0
where that is smaller; with tables made for it) whose quality reaches the same decibels, interpolated. Without --dem,
the DEM is that of Jacksboro which comes with matplotlib. Needs numpy, Pillow, rasterio and, for its DEM, matplotlib."""
import argparse, io, json, math, os, struct, subprocess, sys, tempfile
import numpy as np
import rasterio
from PIL import Image
from rasterio.transform import from_origin


def jacksboro(folder):
    from matplotlib import cbook
    with cbook.get_sample_data("jacksboro_fault_dem.npz") as data:
        heights, spacing = data["elevation"].astype("int16"), 10.0
    path = os.path.join(folder, "jacksboro.tif")
    write(path, heights[np.newaxis], from_origin(0, heights.shape[0] * spacing, spacing, spacing))
    return path


def write(path, bands, transform, **options):
    count, height, width = bands.shape
    with rasterio.open(path, "w", driver="GTiff", width=width, height=height, count=count, dtype=bands.dtype,
                       crs="EPSG:32616", transform=transform, **options) as out:
        out.write(bands)


def pixels(path):
    """Red, green and blue of an image; of several bands of a satellite the third to the first, stretched."""
    if path.endswith((".tif", ".tiff")):
        with rasterio.open(path) as source:
            bands = source.read([3, 2, 1] if source.count > 4 else list(range(1, source.count + 1))).astype(float)
        if bands.shape[0] < 3:
            bands = np.repeat(bands[:1], 3, axis=0)
        low, high = np.percentile(bands, [1, 99])
        return np.clip((bands[:3] - low) * (255 / (high - low)), 0, 255).astype("uint8").transpose(1, 2, 0)
    return np.asarray(Image.open(path).convert("RGB"))


def decibels(one, other):
    return 10 * math.log10(255**2 / np.mean((one.astype(float) - other.astype(float)) ** 2))


def jpeg_bytes(image, wanted):
    """Bytes of the JPEG with so many decibels, between the two qualities beside it."""
    best = math.inf
    for subsampling in (0, 2):
        before = None
        for quality in range(5, 101):
            out = io.BytesIO()
            Image.fromarray(image).save(out, "JPEG", quality=quality, subsampling=subsampling, optimize=True)
            now = decibels(np.asarray(Image.open(io.BytesIO(out.getvalue()))), image), len(out.getvalue())
            if now[0] >= wanted:
                share = (wanted - before[0]) / (now[0] - before[0]) if before else 1
                best = min(best, before[1] + share * (now[1] - before[1]) if before else now[1])
                break
            before = now
    return best


def page_of(path):
    """The first image of a GLB."""
    data = open(path, "rb").read()
    length = struct.unpack("<I", data[12:16])[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    start = view.get("byteOffset", 0)
    return np.asarray(Image.open(io.BytesIO(binary[start : start + view["byteLength"]])))


def run(*command):
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)}: {done.stderr}")
    return done.stdout


def measure(lodpack, dem, name, image, folder, keep=None):
    """Builds, and takes the image out again."""
    with rasterio.open(dem) as source:
        left, bottom, right, top = source.bounds
    height, width = image.shape[:2]
    drape, out, glb = (os.path.join(folder, file) for file in ("drape.tif", "out.lodpack", "out.glb"))
    place = rasterio.transform.from_bounds(left, bottom, right, top, width, height)
    write(drape, image.transpose(2, 0, 1), place, photometric="RGB")
    run(lodpack, "build", dem, "--heights", "--drape", drape, "-o", out, "--force")
    info = json.loads(run(lodpack, "info", out, "--json"))["drape"]
    run(lodpack, "verify", out)
    run(lodpack, "extract", out, "-o", glb, "--force", "--page-size", "16384")
    page = page_of(glb)
    # The first texel that interpolation takes at the first sample.
    first = [max(0, math.floor(-at / step)) for at, step in zip(info["first"], info["spacing"])]
    shown = image[first[1] : first[1] + page.shape[0], first[0] : first[0] + page.shape[1]]
    found = decibels(page, shown)
    jpeg = jpeg_bytes(np.ascontiguousarray(image), found)
    print(f"{name} {width} x {height}: {found:.1f} dB, {info['bytes']} bytes, {info['bits_per_texel']:.2f} bits a texel; "
          f"JPEG of as many {jpeg:.0f} bytes; ratio {info['bytes'] / jpeg:.2f}", flush=True)
    if keep:
        Image.fromarray(np.concatenate([shown, page], axis=1)).save(keep)
    return info["bytes"] / jpeg, found


def main():
    parser = argparse.ArgumentParser(usage=__doc__.split("\n\n")[1])
    parser.add_argument("lodpack")
    parser.add_argument("images", nargs="+")
    parser.add_argument("--dem")
    parser.add_argument("--picture")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        dem = args.dem or jacksboro(folder)
        rows = [measure(args.lodpack, dem, os.path.basename(path), pixels(path), folder, args.picture) for path in args.images]
    ratios, found = zip(*rows)
    print(f"{len(rows)} images: bytes are {np.exp(np.mean(np.log(ratios))):.2f} of those of JPEGs in the mean, "
          f"{min(ratios):.2f} to {max(ratios):.2f}; {min(found):.1f} to {max(found):.1f} dB")


if __name__ == "__main__":
    main()
