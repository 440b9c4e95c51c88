#!/usr/bin/env python3
"""What CesiumJS says of objects that it picks in exported 3D Tiles, beside what the input has there.

    cesium_picks.py LODPACK INPUT.glb WORK [--hide NAME,NAME] [--picture PICTURE.png]

Builds INPUT, exports it, and installs npm's cesium and playwright-core in WORK (Chromium must be there). CesiumJS picks
at 1,100 pixels (cesium_picks.mjs). The ray of that pixel meets a triangle of the input first (found here, from
plain JSON, by no code of lodpack): its node's name, id and the names above must be what Cesium's feature says. Where
they are not, one of 24 rays within a pixel may meet what Cesium says, as at an edge. Objects of the names after --hide
are hidden by a style. Exit status 1: a pick is of something else. Needs numpy.
"""
import argparse
import json
import pathlib
import struct
import subprocess
import sys

import numpy as np

NPM = ["cesium@1.140.0", "playwright-core@1.65.0"]
TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


def from_node(node):
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]), float)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def triangles_of(path):
    """Corners of all triangles, the object of each, and of each object its name, id and the names above."""
    data = path.read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def values(number):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        width, kind = {"SCALAR": 1, "VEC3": 3}[accessor["type"]], np.dtype(TYPES[accessor["componentType"]])
        start, stride = view.get("byteOffset", 0) + accessor.get("byteOffset", 0), view.get("byteStride")
        rows = np.ndarray((accessor["count"], width), kind, binary, start, (stride or width * kind.itemsize, kind.itemsize))
        return rows.astype(float if kind.kind == "f" else np.int64)

    corners, owners, objects = [], [], []
    roots = document["scenes"][document.get("scene", 0)]["nodes"]
    open_nodes = [(root, np.eye(4), "", False) for root in roots]
    while open_nodes:
        number, above, path_above, has_above = open_nodes.pop()
        node = document["nodes"][number]
        world, name = above @ from_node(node), node.get("name", "")
        if "mesh" in node:
            for primitive in document["meshes"][node["mesh"]]["primitives"]:
                points = values(primitive["attributes"]["POSITION"]) @ world[:3, :3].T + world[:3, 3]
                order = values(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(points))
                corners.append(points[order.reshape(-1, 3)])
                owners.append(np.full(len(order) // 3, len(objects)))
            extras = {key.lower(): value for key, value in (node.get("extras") or {}).items()}
            found = next((str(extras[key]) for key in ("id", "globalid", "guid") if key in extras), "")
            objects.append([name, found, path_above])
        path_here = f"{path_above}/{name}" if has_above else name
        open_nodes += [(child, world, path_here, True) for child in node.get("children", [])]
    return np.concatenate(corners), np.concatenate(owners), objects


def first_met(corners, ray):
    """The triangle that a ray meets first, or none."""
    origin, direction = np.array(ray)
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / np.einsum("ij,ij->i", u, p)
        s = origin - a
        along = np.einsum("ij,ij->i", s, p) * scale
        q = np.cross(s, u)
        across, away = q @ direction * scale, np.einsum("ij,ij->i", v, q) * scale
        away[~((along >= 0) & (across >= 0) & (along + across <= 1) & (away > 0))] = np.inf
    nearest = np.nanargmin(away)
    return nearest if np.isfinite(away[nearest]) else None


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("lodpack")
    arguments.add_argument("input", type=pathlib.Path)
    arguments.add_argument("work", type=pathlib.Path)
    arguments.add_argument("--hide", default="")
    arguments.add_argument("--picture")
    args = arguments.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    file, tiles, modules = (args.work / name for name in (args.input.stem + ".lodpack", args.input.stem, "node_modules"))
    if not (modules / "cesium").is_dir():
        subprocess.run(["npm", "install", "--no-audit", "--no-fund", "--prefix", args.work, *NPM], check=True)
    for words in (["build", args.input, "-o", file, "--objects", "keep"], ["export", file, "--as", "3dtiles", "-o", tiles]):
        subprocess.run([args.lodpack, *words, "--force", "--progress", "none"], check=True, stdout=subprocess.DEVNULL)
    script = pathlib.Path(__file__).with_suffix(".mjs")
    picked = subprocess.run(["node", script, tiles, modules, args.hide, *filter(None, [args.picture])], check=True, capture_output=True)
    picked = json.loads(picked.stdout)
    corners, owners, objects = triangles_of(args.input)
    shown = ~np.isin(owners, [at for at, (name, *_) in enumerate(objects) if name in args.hide.split(",") and name])
    corners, owners = corners[shown], owners[shown]
    counts = dict.fromkeys(("same object", "nothing in both", "beside an edge", "something else"), 0)
    seen = set()

    def object_at(ray):
        # Tilesets have z up.
        met = first_met(corners, [[x, z, -y] for x, y, z in ray])
        return None if met is None else objects[owners[met]]

    for pick in picked["picks"]:
        wanted = object_at(pick["rays"][0])
        if pick["said"] == wanted:
            counts["nothing in both" if wanted is None else "same object"] += 1
            seen |= {tuple(wanted)} if wanted else set()
        elif pick["said"] in map(object_at, pick["rays"][1:]):
            counts["beside an edge"] += 1
        else:
            counts["something else"] += 1
            if counts["something else"] <= 10:
                print(f"{pick['pixel']}: Cesium says {pick['said']}, the input has {wanted}", file=sys.stderr)
    print(f"CesiumJS {picked['version']}: {len(picked['picks'])} picks, {len(seen)} different objects:", counts)
    print(*picked["problems"][:5], sep="\n")
    sys.exit(1 if counts["something else"] or not counts["same object"] else 0)


if __name__ == "__main__":
    main()
