"""What other readers see in a file: area, box, triangles and mean colours of meshes; samples, place and CRS of
rasters."""
import json
import pathlib
import subprocess

import numpy as np
from PIL import Image

NODE = pathlib.Path(__file__).with_name("gltf.mjs")
Image.MAX_IMAGE_PIXELS = None


def area_of(points, corners):
    p = points[corners]
    return 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)


def measured(points, corners, loose=False, colours=(), faces=None):
    """Figures of triangles as lodpack repairs them: welded, without those that have no area, each once. `loose`: the
    area hangs on how polygons are divided; `faces` says which triangles are of one polygon, whose area is at least that
    of its outline."""
    points, corners = np.asarray(points, float).reshape(-1, 3), np.asarray(corners, np.int64).reshape(-1, 3)
    repeated = (corners == np.roll(corners, 1, axis=1)).any(1).sum()
    out = {"raw": [int(len(corners) - repeated), len(corners)], "loose": bool(loose), "colours": [list(map(float, c)) for c in colours if c is not None]}
    if len(corners):
        _, same = np.unique(points, axis=0, return_inverse=True)
        welded = np.sort(same.reshape(-1)[corners], axis=1)
        areas = area_of(points, corners)
        first = np.zeros(len(corners), bool)
        first[np.unique(welded, axis=0, return_index=True)[1]] = True
        keep = first & (areas > 0) & (welded[:, 0] != welded[:, 1]) & (welded[:, 1] != welded[:, 2])
        corners, areas = corners[keep], areas[keep]
        if faces is not None:
            p, flat = points[corners], np.zeros((int(faces.max()) + 1, 3))
            np.add.at(flat, faces[keep], np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) / 2)
            out["least"] = float(np.linalg.norm(flat, axis=1).sum())
    if len(corners):
        used = points[corners.reshape(-1)]
        out |= {"area": float(areas.sum()), "low": used.min(0).tolist(), "high": used.max(0).tolist()}
    return out | {"triangles": int(len(corners))}


def fans(faces):
    return np.array([(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)], np.int64).reshape(-1, 3)


def sampled(points, corners, look, count=20000):
    """Mean of look(triangle, weights) over points spread evenly by area."""
    areas = area_of(points, corners)
    if not areas.sum() > 0:
        return None
    chance = np.random.default_rng(1)
    chosen = np.searchsorted(np.cumsum(areas) / areas.sum(), (np.arange(count) + chance.random(count)) / count).clip(0, len(areas) - 1)
    r, s = np.sqrt(chance.random(count)), chance.random(count)
    return look(chosen, np.column_stack([1 - r, r * (1 - s), r * s])).mean(0)


def texels(image, uv, wrap=(10497, 10497)):
    """Values of an image (RGB, 0 to 1) at coordinates whose v points down."""
    data, out = np.asarray(image.convert("RGB")) / 255.0, []
    for axis, size in ((0, data.shape[1]), (1, data.shape[0])):
        u = uv[:, axis]
        u = np.clip(u, 0, 1) if wrap[axis] == 33071 else 1 - np.abs(u % 2 - 1) if wrap[axis] == 33648 else u % 1
        out.append((u * size).astype(int).clip(0, size - 1))
    return data[out[1], out[0]]


def obj(path):
    import tinyobjloader

    reader, config = tinyobjloader.ObjReader(), tinyobjloader.ObjReaderConfig()
    config.triangulate = False
    if not reader.ParseFromFile(str(path), config):
        raise ValueError(reader.Error() or "tinyobjloader reads nothing")
    attributes, materials = reader.GetAttrib(), reader.GetMaterials()
    points = np.array(attributes.vertices, float).reshape(-1, 3)
    uv, own = np.array(attributes.texcoords, float).reshape(-1, 2), np.array(attributes.colors, float).reshape(-1, 3)
    corners, texts, used, owners, loose, faces_seen = [], [], [], [], False, 0
    for shape in reader.GetShapes():
        mesh, at = shape.mesh, 0
        indices = [(i.vertex_index, i.texcoord_index) for i in mesh.indices]
        for count, material in zip(mesh.num_face_vertices, mesh.material_ids):
            face = indices[at : at + count]
            at, loose, faces_seen = at + count, loose or count > 3, faces_seen + 1
            for k in range(1, count - 1):
                corners.append([face[j][0] for j in (0, k, k + 1)])
                texts.append([face[j][1] for j in (0, k, k + 1)])
                used.append(material)
                owners.append(faces_seen)
    corners, texts, used = (np.array(part, np.int64) for part in (corners, texts, used))
    colours = []
    if len(corners) and (own == 1).all() and (used >= 0).all():
        kd = np.array([m.diffuse for m in materials])
        images = {k: open_image(path.parent, m.diffuse_texname) for k, m in enumerate(materials) if m.diffuse_texname and (used == k).any()}
        for multiply in (False, True):
            def look(chosen, weights):
                out = kd[used[chosen]].copy()
                for k, image in images.items():
                    on = (used[chosen] == k) & (texts[chosen] >= 0).all(1)
                    if image is not None and on.any():
                        place = (uv[texts[chosen[on]]] * weights[on, :, None]).sum(1)
                        seen = texels(image, np.column_stack([place[:, 0], 1 - place[:, 1]]))
                        out[on] = seen * out[on] if multiply else seen
                return out
            colours.append(sampled(points, corners, look))
    return measured(points, corners, loose, colours, np.array(owners) if owners else None)


def open_image(folder, name):
    try:
        return Image.open(folder / name.replace("\\", "/"))
    except OSError:
        return None


def ply(path):
    from plyfile import PlyData

    data = PlyData.read(str(path))
    names = {element.name for element in data.elements}
    vertices = data["vertex"]
    points = np.column_stack([vertices[axis] for axis in "xyz"]).astype(float)
    faces = []
    if "face" in names:
        lists = [p.name for p in data["face"].properties if p.name in ("vertex_indices", "vertex_index")]
        faces = [list(face) for face in data["face"][lists[0]]] if lists else []
    corners = fans(faces)
    colours = []
    have = [p.name for p in vertices.properties]
    if {"red", "green", "blue"} <= set(have) and vertices["red"].dtype == np.uint8 and len(corners):
        own = np.column_stack([vertices[c] for c in ("red", "green", "blue")]) / 255.0
        colours = [sampled(points, corners, lambda chosen, weights: (own[corners[chosen]] * weights[:, :, None]).sum(1))]
    owners = np.repeat(np.arange(len(faces)), [max(len(face) - 2, 0) for face in faces]) if len(corners) else None
    return measured(points, corners, any(len(face) > 3 for face in faces), colours, owners)


def by_trimesh(path):
    import trimesh

    found = trimesh.load(str(path), process=False, maintain_order=True)
    if isinstance(found, trimesh.Scene):
        found = found.to_geometry() if len(found.geometry) else trimesh.Trimesh()
    return measured(getattr(found, "vertices", []), getattr(found, "faces", []), loose=path.suffix.lower() in (".obj", ".off", ".ply"))


def by_meshio(path):
    import meshio

    mesh = meshio.read(path)
    faces = [face for cells in mesh.cells if cells.type in ("triangle", "quad", "polygon") for face in cells.data]
    return measured(mesh.points[:, :3], fans(faces), loose=any(len(face) > 3 for face in faces))


def linear(c):
    return np.where(c <= 0.04045, c / 12.92, ((np.maximum(c, 0) + 0.055) / 1.055) ** 2.4)


def srgb(c):
    return np.where(c <= 0.0031308, c * 12.92, 1.055 * np.maximum(c, 0) ** (1 / 2.4) - 0.055)


def gltf(path, node, scratch, validate=False):
    """By glTF Transform; with `validate` also what the official validator says."""
    import io

    head, body = scratch / "gltf.json", scratch / "gltf.bin"
    words = ["node", str(NODE), str(path.resolve()), str(head), str(body)] + (["--validate"] if validate else [])
    subprocess.run(words, cwd=node, check=True, timeout=120, capture_output=True)
    said, data = json.loads(head.read_text()), body.read_bytes()
    if validate:
        return {key: said.get(key) for key in ("validator", "required", "error", "version")}
    if "error" in said:
        raise ValueError(said["error"])
    array = lambda place, kind: np.frombuffer(data, kind, place[1] // np.dtype(kind).itemsize, place[0])
    images = [Image.open(io.BytesIO(data[i[0] : i[0] + i[1]])) if i and i[1] else None for i in said["images"]]
    points, corners, looks, sums = [], [], True, []
    for part in said["primitives"]:
        own, faces = array(part["positions"], "<f8").reshape(-1, 3), array(part["corners"], "<u4").reshape(-1, 3).astype(np.int64)

        def look(chosen, weights):
            mix = lambda values: (values[faces[chosen]] * weights[:, :, None]).sum(1)
            out = np.ones((len(chosen), 3)) * part["factor"][:3]
            if "colours" in part:
                out = out * mix(array(part["colours"][0], "<f8").reshape(-1, part["colours"][1])[:, :3])
            if "uv" in part and images[part["image"]] is not None:
                u, v, turn, a, b = part["move"]
                place = mix(array(part["uv"], "<f8").reshape(-1, 2)) * [a, b]
                c, s = np.cos(turn), np.sin(turn)
                out = out * linear(texels(images[part["image"]], place @ np.array([[c, -s], [s, c]]) + [u, v], part["wrap"]))
            return srgb(out.clip(0, 1))

        looks = looks and part["looks"]
        for matrix in part["matrices"]:
            m = np.array(matrix).reshape(4, 4).T
            there = own @ m[:3, :3].T + m[:3, 3]
            area = area_of(there, faces).sum()
            mean = sampled(there, faces, look) if len(faces) else None
            if mean is not None:
                sums.append((area, mean))
            corners.append(faces + sum(map(len, points)))
            points.append(there)
    total = sum(area for area, _ in sums)
    colours = [sum(area * mean for area, mean in sums) / total] if looks and total > 0 else []
    join = lambda parts, width: np.concatenate(parts) if parts else np.zeros((0, width))
    return measured(join(points, 3), join(corners, 3), colours=colours)


def raster(path):
    """By rasterio: samples as floats, where there are any, the place, and the CRS."""
    import rasterio

    with rasterio.open(path) as file:
        place = [*file.transform][:6]
        return {"bands": file.count, "data": file.read(1).astype(float), "known": file.read_masks(1) > 0, "place": place if place != [1, 0, 0, 0, 1, 0] else None,
                "crs": file.crs, "unit": file.units[0], "type": file.dtypes[0], "tags": file.tags()}


def exr(path):
    import OpenEXR

    part = OpenEXR.File(str(path), separate_channels=True).parts[0]
    channel = part.channels.get("Z") or next(iter(part.channels.values()))
    data = np.asarray(channel.pixels, float)
    return {"bands": len(part.channels), "data": data, "known": np.isfinite(data), "place": None, "crs": None, "unit": None, "type": "float32", "tags": {}}


def picture(path):
    image = Image.open(path)
    data = np.asarray(image.convert("L") if image.mode in ("1", "LA", "La", "P") else image).astype(float)
    return {"bands": 1, "data": data, "known": np.ones(data.shape, bool), "place": None, "crs": None, "unit": None, "type": "uint8", "tags": {}}
