#!/usr/bin/env bash
# What one would guess: decoding a JPEG at half its size (libjpeg's scale 1/2, Pillow's `draft`) gives about the means
# of 2 x 2 pixels of the whole picture, only faster.
# What is so (Pillow 13.0.0): with 4:2:0, which most photographs have, it shows more colour than those means. Red and
# blue stripes of two pixels stay (254 0 0) and (0 0 254) at half size, and are (202 12 75) and (50 0 179) in the means:
# colour is stored at half size, and decoding the whole picture first interpolates it. Grey is the same in both.
# Consequence: lodpack decodes whole pictures and averages them itself, so that all levels show the same colour.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pillow==13.0.0
env/bin/python - <<'PY'
import io
import numpy as np, PIL
from PIL import Image
def both(first, second, subsampling):
    stripes = np.tile(np.array([first, first, second, second], np.uint8), (64, 16, 1))
    encoded = io.BytesIO()
    Image.fromarray(stripes).save(encoded, "JPEG", quality=95, subsampling=subsampling)
    half = Image.open(encoded)
    half.draft("RGB", (32, 32))
    assert half.size == (32, 32)
    half = np.asarray(half).astype(float)
    means = np.asarray(Image.open(encoded)).reshape(32, 2, 32, 2, 3).mean((1, 3))
    print(f"{subsampling} {first} {second}: half {half[16, 8:10].tolist()}, means {means[16, 8:10].round().tolist()}")
    return np.abs(half - means).max()
print("Pillow", PIL.__version__)
RED, BLUE, BLACK, WHITE = (255, 0, 0), (0, 0, 255), (0, 0, 0), (255, 255, 255)
assert both(RED, BLUE, "4:4:4") < 12
assert both(BLACK, WHITE, "4:2:0") < 12
assert both(RED, BLUE, "4:2:0") > 50, "this has changed"
PY
