#!/usr/bin/env bash
# What one would guess: a GLB that has three vertices of its own for each triangle of a box, none of them shared, has
# the normals of the walls (for what else are they apart?), outwards as the triangles are; and ids of city objects are
# names of nodes, each under that of its parent.
# What is so (cjio 0.10.1): triangles are outwards, and all normals point inwards. They are means over the triangles at a
# corner, one for each triangle that the cut of the walls puts there: the same for all vertices at a corner, different
# from corner to corner, 103 to 157 degrees off every wall. Ids are names of meshes; nodes have none, and a part lies
# beside its building.
# Consequence: normals of a GLB are kept as they come, so a city by way of cjio's GLB is dark and round where a program
# lights by them; `lodpack build --channels none` leaves them out. Its OBJ has ids, and no normals.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q 'cjio[export]==0.10.1' 'numpy==2.4.6'
cat > city.py <<'PY'
import json

vertices, objects = [], {}
for number, (name, x) in enumerate([("house", 0), ("part", 20)]):
    first, high = len(vertices), 5000 + 1000 * number
    corners = [[x, 0, 0], [x + 10, 0, 0], [x + 10, 10, 0], [x, 10, 0]]
    vertices += [[1000 * c for c in corner] for corner in corners]
    vertices += [[1000 * corner[0], 1000 * corner[1], high] for corner in corners]
    faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    boundaries = [[[[first + corner for corner in face]] for face in faces]]
    objects[name] = {
        "type": "BuildingPart" if number else "Building",
        "geometry": [{"type": "Solid", "lod": "1.2", "boundaries": boundaries}],
    }
objects["house"]["children"], objects["part"]["parents"] = ["part"], ["house"]
city = {"type": "CityJSON", "version": "2.0", "transform": {"scale": [0.001] * 3, "translate": [0, 0, 0]}, "CityObjects": objects, "vertices": vertices}
json.dump(city, open("city.city.json", "w"))
PY
venv/bin/python city.py
venv/bin/cjio city.city.json export glb city.glb
cat > judge.py <<'PY'
import json
import struct

import numpy as np

data = open("city.glb", "rb").read()
length = struct.unpack_from("<I", data, 12)[0]
gltf, binary = json.loads(data[20 : 20 + length]), data[28 + length :]


def values(number):
    accessor = gltf["accessors"][number]
    view = gltf["bufferViews"][accessor["bufferView"]]
    kind, width = {5126: ("<f4", 4), 5125: ("<u4", 4)}[accessor["componentType"]]
    columns = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
    at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    return np.frombuffer(binary, kind, accessor["count"] * columns, at).reshape(-1, columns)


for mesh in gltf["meshes"]:
    [primitive] = mesh["primitives"]
    positions, normals = (values(primitive["attributes"][name]) for name in ("POSITION", "NORMAL"))
    corners = values(primitive["indices"]).reshape(-1, 3)
    faces = np.cross(positions[corners[:, 1]] - positions[corners[:, 0]], positions[corners[:, 2]] - positions[corners[:, 0]])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(np.einsum("tcx,tx->tc", normals[corners], faces), -1, 1)))
    inside = positions - positions.mean(0)
    volume = np.einsum("tx,tx->", inside[corners[:, 0]], np.cross(inside[corners[:, 1]], inside[corners[:, 2]])) / 6
    inward = np.einsum("vx,vx->v", normals, inside) < 0
    pairs = np.unique(np.round(np.hstack([positions, normals]), 5), axis=0)
    print(f"{mesh['name']}: {len(positions)} vertices, {len(corners)} triangles, {len(pairs)} different ones; "
          f"volume {volume:.0f}; {inward.sum()} normals inwards, {angles.min():.0f} to {angles.max():.0f} degrees off their triangles")
    assert len(positions) == 3 * len(corners) == 36 and len(pairs) == 8, "this has changed"
    assert volume > 0 and inward.all() and angles.min() > 100, "this has changed"
nodes = gltf["nodes"]
print("nodes:", [{key: node[key] for key in ("name", "mesh", "children") if key in node} for node in nodes])
assert [mesh["name"] for mesh in gltf["meshes"]] == ["house", "part"], "this has changed"
assert all("name" not in node and "children" not in node for node in nodes if "mesh" in node), "this has changed"
PY
venv/bin/python judge.py
