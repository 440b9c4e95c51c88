#!/usr/bin/env bash
# What one would guess: the GeoTIFF key VerticalUnitsGeoKey (4099) says in which unit heights are, whatever else is
# there.
# What is so (GDAL 3.10.3 in rasterio 1.4.4): it counts only where VerticalGeoKey (4096) is absent. With EPSG:6360 and
# metres in 4099 heights are in US feet, with EPSG:5703 and US feet they are in metres. The CRS that is shown has no
# vertical part at all: only the unit of the band tells.
# Consequence: lodpack takes the unit of key 4096 before that of 4099.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 rasterio==1.4.4 tifffile==2026.3.3
env/bin/python - <<'PY'
import numpy as np, rasterio, tifffile
METRE, US_FOOT = 9001, 9003
def unit_of(vertical, unit):
    keys = [(1024, 1), (1025, 1), (3072, 32612)] + [(4096, vertical)] * (vertical > 0) + [(4099, unit)]
    words = [1, 1, 0, len(keys)] + [word for key, value in keys for word in (key, 0, 1, value)]
    tags = [(33550, "d", 3, (10.0, 10.0, 0.0), True), (33922, "d", 6, (0, 0, 0, 5e5, 4e6, 0), True),
            (34735, "H", len(words), words, True)]
    tifffile.imwrite("a.tif", np.zeros((3, 4), np.float32), extratags=tags, metadata=None)
    with rasterio.open("a.tif") as file:
        assert "VERT" not in file.crs.to_wkt()
        return file.units[0]
print("rasterio", rasterio.__version__, "with GDAL", rasterio.__gdal_version__)
for vertical, unit, expected in [(0, METRE, "metre"), (0, US_FOOT, "US survey foot"),
                                 (6360, METRE, "US survey foot"), (5703, US_FOOT, "metre")]:
    seen = unit_of(vertical, unit)
    print(f"key 4096: {vertical or 'none'}, key 4099: {unit}: heights in {seen}")
    assert seen == expected, "this has changed"
PY
