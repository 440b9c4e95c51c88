"""Bytes of GLB that get smaller with their triangles.

    python3 tests/bench/reduced_glb.py LODPACK CACHE [--before LODPACK] [--only NAME[,NAME]] [--options "WORDS"]

Twelve textured models become files: ten published ones from npm's WebXR controllers and Debian's assimp-testmodels,
which are downloaded into CACHE by npm and apt (corpus/packages.py), and two surfaces made here with photographs of the
latter. Of each the full cut is extracted, and cuts of 50, 30, 10, 3 and 1 % of its triangles. The table has the bytes,
by `--before` of another program beside them, their ratio to the full cut's, and the images. Exit status 1: a cut of
fewer triangles has more bytes, or that of a tenth more than .6 of the full cut's. Needs numpy and Pillow.
"""

import argparse
import io
import json
import pathlib
import shlex
import struct
import subprocess
import sys

import numpy as np
from PIL import Image

from corpus import packages

SHARES = [None, 0.5, 0.3, 0.1, 0.03, 0.01]
MOST_AT_A_TENTH = 0.6
CONTROLLERS = {
    "generic": "generic-trigger-squeeze-thumbstick/none.glb",
    "magicleap-two": "magicleap-two/none.glb",
    "vive-cosmos": "htc-vive-cosmos/right.glb",
    "vive": "htc-vive/none.glb",
    "touch": "oculus-touch/left.glb",
    "index": "valve-index/left.glb",
    "hp": "hp-mixed-reality/left.glb",
    "odyssey": "samsung-odyssey/left.glb",
    "magicleap-one": "magicleap-one/none.glb",
}
NPM, DEBIAN = "npm @webxr-input-profiles/assets", "deb assimp-testmodels"


def models(cache):
    """Names and files."""
    names = ("@webxr-input-profiles/assets", "assimp-testmodels")
    packages.PACKAGES[:] = [package for package in packages.PACKAGES if package[1] in names]
    folders = dict(packages.fetch(cache))
    if NPM in folders:
        for name, path in CONTROLLERS.items():
            yield name, next(folders[NPM].rglob(f"profiles/{path}"))
    if DEBIAN not in folders:
        return
    yield "spider", next(folders[DEBIAN].rglob("OBJ/spider.obj"))
    made = cache / "reduced"
    made.mkdir(exist_ok=True)
    u, v, triangles = grid(200, 100)
    height, turn = np.pi * (v * 0.998 + 0.001), 2 * np.pi * u
    radius = 1 + 0.12 * np.sin(5 * turn) * np.sin(4 * height) + 0.03 * np.sin(23 * turn) * np.sin(19 * height)
    around = [np.sin(height) * np.cos(turn), np.cos(height), np.sin(height) * np.sin(turn)]
    photograph = next(folders[DEBIAN].rglob("earthSpherical.jpg"))
    yield "bumpy-earth", save(made / "bumpy.obj", np.stack(around, 1) * radius[:, None], u, v, triangles, photograph)
    u, v, triangles = grid(160, 160)
    height = 0.05 * np.sin(9 * u + 3 * v) * np.cos(7 * v) + 0.01 * np.sin(40 * u) * np.sin(37 * v)
    photograph = next(folders[DEBIAN].rglob("IQM/Body.jpg"))
    yield "hills", save(made / "hills.obj", np.stack([u, v, height], 1), u, v, triangles, photograph)


def grid(columns, rows):
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    square = np.arange(columns * rows)
    first = square // columns * (columns + 1) + square % columns
    below = first + columns + 1
    return u.ravel(), v.ravel(), np.stack([first, first + 1, below + 1, first, below + 1, below], 1).reshape(-1, 3)


def save(path, positions, u, v, triangles, photograph):
    Image.open(photograph).convert("RGB").resize((2048, 2048), Image.LANCZOS).save(path.with_suffix(".png"))
    path.with_suffix(".mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {path.stem}.png\n")
    with path.open("w") as out:
        out.write(f"mtllib {path.stem}.mtl\nusemtl m\n")
        out.writelines(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in positions)
        out.writelines(f"vt {x:.6f} {y:.6f}\n" for x, y in zip(u, v))
        out.writelines(f"f {a}/{a} {b}/{b} {c}/{c}\n" for a, b, c in triangles + 1)
    return path


def images(path):
    """The images of a GLB, as text."""
    glb = path.read_bytes()
    length = struct.unpack_from("<I", glb, 12)[0]
    document, texts = json.loads(glb[20:20 + length]), []
    for image in document.get("images", []):
        view = document["bufferViews"][image["bufferView"]]
        first = 28 + length + view.get("byteOffset", 0)
        width, height = Image.open(io.BytesIO(glb[first:first + view["byteLength"]])).size
        texts.append(f"{image['mimeType'][6:]} {width}x{height} {view['byteLength'] / 1000:.0f}")
    return ", ".join(texts)


def extracted(program, file, output, triangles, options=()):
    words = [program, "extract", file, "-o", output, "--force", "--json", *options]
    words += [] if triangles is None else ["--triangles", str(triangles)]
    ran = subprocess.run(words, capture_output=True, text=True)
    if ran.returncode:
        print(f"  {triangles} triangles: {ran.stderr.strip()[-200:]}", flush=True)
        return None, None
    return json.loads(ran.stdout)["triangles"], output.stat().st_size


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("lodpack")
    parser.add_argument("cache", type=pathlib.Path)
    parser.add_argument("--before")
    parser.add_argument("--only", default="")
    parser.add_argument("--options", default="", help="more options of extract")
    args = parser.parse_args()
    args.cache.mkdir(parents=True, exist_ok=True)
    wrong, only = [], [name for name in args.only.split(",") if name]
    for name, path in models(args.cache.resolve()):
        if only and name not in only:
            continue
        file = args.cache / f"reduced-{name}.lodpack"
        if not file.exists():
            subprocess.run([args.lodpack, "build", path, "-o", file], check=True, capture_output=True)
        print(f"{name}: {path.stat().st_size:,} B")
        full, before, least, output = None, None, None, args.cache / "reduced.glb"
        for share in SHARES:
            wanted = None if share is None else int(full[0] * share)
            text = ""
            if args.before:
                _, size = extracted(args.before, file, output, wanted)
                before = before or size
                text = f"before {size or 0:>10,} B {(size or 0) / before:5.2f}   "
            triangles, size = extracted(args.lodpack, file, output, wanted, shlex.split(args.options))
            if size is None:
                continue
            full = full or (triangles, size)
            print(f"  {triangles:>7,} triangles   {text}{size:>10,} B {size / full[1]:5.2f}   {images(output)}", flush=True)
            if least is not None and size > least:
                wrong.append(f"{name}: {triangles:,} triangles have {size:,} B, more triangles {least:,}")
            if share == 0.1 and size > MOST_AT_A_TENTH * full[1]:
                wrong.append(f"{name}: a tenth of the triangles has {size / full[1]:.2f} of the bytes")
            least = min(size, least or size)
    print("\n".join(wrong) or "every cut of fewer triangles has fewer bytes")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
