#!/usr/bin/env bash
# What one would guess: `jpegxl_encode(image, distance=0)` of imagecodecs is lossless, as distance 0 is by definition in
# JPEG XL, and as `webp_encode(image, level=100)` is in the same package.
# What is so (imagecodecs 2026.3.6): it is lossy (off by up to 3 of 255), and so is level=100, in more bytes than
# lossless takes. Without any argument, and with lossless=True, nothing is lost.
# Consequence: programs that compare textures ask for lossless by name.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 imagecodecs==2026.3.6
env/bin/python - <<'PY'
import imagecodecs, numpy as np
image = np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)
def off(encode, decode, **options):
    encoded = encode(image, **options)
    off = int(np.abs(decode(encoded).astype(int) - image).max())
    print(f"imagecodecs {imagecodecs.__version__}: {encode.__name__} {options}: {len(encoded)} bytes, off by {off}")
    return off
jxl = imagecodecs.jpegxl_encode, imagecodecs.jpegxl_decode
assert off(imagecodecs.webp_encode, imagecodecs.webp_decode, level=100) == 0
assert off(*jxl) == off(*jxl, lossless=True) == 0
assert off(*jxl, distance=0) > 0 and off(*jxl, level=100) > 0, "this has changed"
PY
