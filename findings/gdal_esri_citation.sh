#!/usr/bin/env bash
# What one would guess: a GeoTIFF without an EPSG code whose citation has the CRS as text ("ESRI PE String = ...") is
# placed by GDAL wherever that text stands, as long as key 3072 says that the projected CRS is user-defined.
# What is so (GDAL 3.10.3 in rasterio 1.4.4): the text counts only in PCSCitationGeoKey (3073), and only if the *model
# type* (key 1024) is 32767. With model type 1, which projected coordinates have, or in GTCitationGeoKey (1026), the
# same text becomes the name of a local CRS without a place on the Earth. Key 3072 makes no difference.
# Consequence: `lodpack extract -o window.tif` writes model type 32767 where a CRS has a text and no code.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 rasterio==1.4.4 tifffile==2026.3.3
env/bin/python - <<'PY'
import itertools, warnings
import numpy as np, rasterio, tifffile
warnings.simplefilter("ignore")
text = ('ESRI PE String = PROJCS["Sheet",GEOGCS["GCS_WGS_1984",'
        'DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137,298.257223563]],PRIMEM["Greenwich",0],'
        'UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
        'PARAMETER["False_Easting",0],PARAMETER["False_Northing",0],PARAMETER["Central_Meridian",11],'
        'PARAMETER["Scale_Factor",1],PARAMETER["Latitude_Of_Origin",47],UNIT["Meter",1]]|')
print("rasterio", rasterio.__version__, "with GDAL", rasterio.__gdal_version__)
for model, projected, citation in itertools.product([1, 32767], [None, 32767], [1026, 3073]):
    keys = [(1024, 0, 1, model), (1025, 0, 1, 1), (citation, 34737, len(text), 0)]
    keys = sorted(keys + [(3072, 0, 1, projected)] * (projected is not None))
    words = [1, 1, 0, len(keys)] + [word for key in keys for word in key]
    tags = [(33550, "d", 3, (10.0, 10.0, 0.0), True), (33922, "d", 6, (0, 0, 0, 0, 0, 0), True),
            (34735, "H", len(words), words, True), (34737, "s", 0, text, True)]
    tifffile.imwrite("a.tif", np.zeros((3, 4), np.float32), extratags=tags, metadata=None)
    with rasterio.open("a.tif") as file:
        is_placed = file.crs.is_projected and file.crs.to_wkt().startswith('PROJCS["Sheet"')
    print(f"model type {model}, projected CRS {projected}, text in {citation}: {'placed' if is_placed else 'local'}")
    assert is_placed == (model == 32767 and citation == 3073), "this has changed"
PY
