#!/usr/bin/env bash
# What one would guess: trimesh, which reads and keeps glTF attributes whose names begin with `_`, writes a scalar for
# each vertex as a scalar again.
# What is so (trimesh 5.2.0): `_FEATURE_ID_0` of UNSIGNED_SHORT comes in as 7, 8, 9 and is written as VEC2, since rows
# are padded to four bytes and the padding counts as components; UNSIGNED_BYTE becomes VEC4. FLOAT stays a scalar.
# Consequence: whoever wants ids of vertices to survive other programs writes them as FLOAT.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0
env/bin/python - <<'PY'
import base64, io, json
import numpy as np, trimesh
NAME = "_FEATURE_ID_0"
DATA = "data:application/octet-stream;base64,"
def written(component, kind):
    ids = np.zeros(3, np.dtype({"names": ["id"], "formats": [kind], "itemsize": 4}))
    ids["id"] = [7, 8, 9]
    data = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes() + ids.tobytes()
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, NAME: 1}}]}],
        "buffers": [{"byteLength": len(data), "uri": DATA + base64.b64encode(data).decode()}],
        "bufferViews": [{"buffer": 0, "byteLength": 36},
                        {"buffer": 0, "byteOffset": 36, "byteLength": 12, "byteStride": 4}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                       "min": [0, 0, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": component, "count": 3, "type": "SCALAR"}]}
    scene = trimesh.load(io.BytesIO(json.dumps(document).encode()), file_type="gltf", process=False)
    mesh = next(iter(scene.geometry.values()))
    assert mesh.vertex_attributes[NAME].ravel().tolist() == [7, 8, 9]
    out = scene.export(file_type="glb")
    document = json.loads(out[20 : 20 + int.from_bytes(out[12:16], "little")])
    accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"][NAME]]
    return accessor["componentType"], accessor["type"]
for component, kind, name, expected in [(5121, "<u1", "UNSIGNED_BYTE", "VEC4"), (5123, "<u2", "UNSIGNED_SHORT", "VEC2"),
                                        (5126, "<f4", "FLOAT", "SCALAR")]:
    seen = written(component, kind)
    print(f"trimesh {trimesh.__version__}: SCALAR of {name} is written as {seen[1]}")
    assert seen == (component, expected), "this has changed"
PY
