"""Colour over the surface: how far what a mesh shows is from what another shows.

    python3 tests/bench/colours.py [--points N] INPUT OUTPUT [OUTPUT ...]

INPUT and OUTPUT are OBJ with MTL and images, GLB, or PLY with colours of vertices.

Spreads 100,000 points (or N) by area over the input, takes the closest point of each on the output, and compares
colours: PSNR over the three components, in sRGB as screens show it. Between texels and between vertices, colours of
both are interpolated in linear light, as renderers of glTF do; a second number is of bytes that are interpolated as
they are. Where few points have most of the error, other points would say something else: it prints twice the standard
error that comes of that. Needs numpy, pillow and pyvista, and shares no code with lodpack.
"""

import argparse
import io
import json
import os
import struct
import sys

import numpy as np
import pyvista
from PIL import Image

POINTS = 100_000


def srgb_to_linear(screen):
    share = screen / 255
    return np.where(share <= 0.04045, share / 12.92, ((np.maximum(share, 0.04045) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear):
    return 255 * np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


class Surface:
    """Triangles with a colour at each point. `images` are pairs of a factor, in linear light, and an image or none."""

    def __init__(self, positions, triangles, colours=None, places=None, place_triangles=None, images=None, image_of=None):
        self.positions, self.triangles = positions, triangles
        self.colours, self.places, self.place_triangles = colours, places, place_triangles
        self.images, self.image_of = images or [], image_of

    def mesh(self):
        faces = np.concatenate([np.full((len(self.triangles), 1), 3), self.triangles], axis=1)
        return pyvista.PolyData(self.positions, faces.ravel())

    def colour(self, triangles, weights, in_linear_light):
        """What is shown at points, in sRGB."""
        decoded, encoded = (srgb_to_linear, linear_to_srgb) if in_linear_light else (lambda x: x, lambda x: x)
        if self.colours is not None:
            corners = decoded(self.colours[self.triangles[triangles]])
            return encoded((corners * weights[:, :, None]).sum(axis=1))
        result = np.full((len(triangles), 3), 255.0)
        corners = self.places[self.place_triangles[triangles]]
        places = (corners * weights[:, :, None]).sum(axis=1)
        for number, (factor, image) in enumerate(self.images):
            of_image = self.image_of[triangles] == number
            if image is None:
                result[of_image] = linear_to_srgb(factor)
                continue
            height, width, _ = image.shape
            x = places[of_image, 0] * width - 0.5
            y = (1 - places[of_image, 1]) * height - 0.5
            left, top = np.floor(x).astype(int), np.floor(y).astype(int)
            right, down = (x - left)[:, None], (y - top)[:, None]
            texel = lambda x, y: decoded(image[y % height, x % width].astype(float))
            above = texel(left, top) * (1 - right) + texel(left + 1, top) * right
            below = texel(left, top + 1) * (1 - right) + texel(left + 1, top + 1) * right
            shown = encoded(above * (1 - down) + below * down)
            result[of_image] = shown if (factor == 1).all() else linear_to_srgb(srgb_to_linear(shown) * factor)
        return result


def read_materials(path):
    materials, name = {}, None
    with open(path, encoding="latin-1") as text:
        for line in text:
            words = line.split()
            if not words:
                continue
            if words[0] == "newmtl":
                name = " ".join(words[1:])
                materials[name] = [np.ones(3), None]
            elif words[0] == "Kd" and name is not None:
                materials[name][0] = srgb_to_linear(255 * np.array([float(x) for x in words[1:4]]))
            elif words[0] == "map_Kd" and name is not None:
                file = os.path.join(os.path.dirname(path), words[-1])
                materials[name][1] = np.asarray(Image.open(file).convert("RGB"))
    return materials


def read_obj(path):
    positions, places, triangles, place_triangles, image_of = [], [[0.0, 0.0]], [], [], []
    materials, names, material = {}, ["\0none"], 0
    with open(path, encoding="latin-1") as text:
        for line in text:
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                positions.append([float(x) for x in words[1:4]])
            elif words[0] == "vt":
                places.append([float(x) for x in words[1:3]])
            elif words[0] == "mtllib":
                materials.update(read_materials(os.path.join(os.path.dirname(path), " ".join(words[1:]))))
            elif words[0] == "usemtl":
                name = " ".join(words[1:])
                if name not in names:
                    names.append(name)
                material = names.index(name)
            elif words[0] == "f":
                corners = [[int(x) if x else 0 for x in word.split("/")] for word in words[1:]]
                vertex = [c[0] - 1 if c[0] > 0 else len(positions) + c[0] for c in corners]
                place = [(c[1] if c[1] >= 0 else len(places) + c[1]) if len(c) > 1 else 0 for c in corners]
                for k in range(1, len(corners) - 1):
                    triangles.append([vertex[0], vertex[k], vertex[k + 1]])
                    place_triangles.append([place[0], place[k], place[k + 1]])
                    image_of.append(material)
    images = [tuple(materials.get(name, [np.ones(3), None])) for name in names]
    # Where there is a texture, lodpack takes Kd for a leftover: programs that write OBJ disagree about it.
    images = [(np.ones(3) if image is not None else factor, image) for factor, image in images]
    return Surface(np.array(positions), np.array(triangles), None, np.array(places), np.array(place_triangles), images, np.array(image_of))


def read_ply(path):
    mesh = pyvista.read(path)
    triangles = mesh.faces.reshape(-1, 4)[:, 1:]
    names = [name for name in mesh.point_data if mesh.point_data[name].ndim == 2 and mesh.point_data[name].shape[1] >= 3]
    name = next(name for name in ["RGB", "RGBA", *names] if name in mesh.point_data)
    return Surface(np.asarray(mesh.points, dtype=float), triangles, np.asarray(mesh.point_data[name])[:, :3].astype(float))


def read_glb(path):
    """All nodes of the scene; base colours alone."""
    with open(path, "rb") as file:
        data = file.read()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def accessor(number):
        a = document["accessors"][number]
        view = document["bufferViews"][a["bufferView"]]
        kind = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[a["componentType"]]
        count = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[a["type"]]
        size = np.dtype(kind).itemsize * count
        start, stride = view.get("byteOffset", 0) + a.get("byteOffset", 0), view.get("byteStride", size)
        rows = [binary[start + k * stride : start + k * stride + size] for k in range(a["count"])] if stride != size else None
        raw = b"".join(rows) if rows else binary[start : start + a["count"] * size]
        return np.frombuffer(raw, kind).reshape(a["count"], count)

    def image(number):
        source = document["images"][document["textures"][number]["source"]]
        if "uri" in source:
            return np.asarray(Image.open(os.path.join(os.path.dirname(path), source["uri"])).convert("RGB"))
        view = document["bufferViews"][source["bufferView"]]
        start = view.get("byteOffset", 0)
        return np.asarray(Image.open(io.BytesIO(binary[start : start + view["byteLength"]])).convert("RGB"))

    def local(node):
        if "matrix" in node:
            return np.array(node["matrix"]).reshape(4, 4).T
        x, y, z, w = node.get("rotation", [0, 0, 0, 1])
        turned = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])
        matrix = np.eye(4)
        matrix[:3, :3] = turned * np.array(node.get("scale", [1, 1, 1]))
        matrix[:3, 3] = node.get("translation", [0, 0, 0])
        return matrix

    positions, places, triangles, images, image_of, first = [], [], [], [], [], 0
    waiting = [(number, np.eye(4)) for number in document["scenes"][document.get("scene", 0)]["nodes"]]
    while waiting:
        number, matrix = waiting.pop(0)
        node = document["nodes"][number]
        matrix = matrix @ local(node)
        waiting += [(child, matrix) for child in node.get("children", [])]
        for primitive in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            own = accessor(primitive["attributes"]["POSITION"]).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
            positions.append(own)
            uv = primitive["attributes"].get("TEXCOORD_0")
            # The first row of an image is at 0, other than in OBJ.
            places.append(accessor(uv).astype(float) * [1, -1] + [0, 1] if uv is not None else np.zeros((len(own), 2)))
            corners = accessor(primitive["indices"]).reshape(-1, 3).astype(int) + first
            triangles.append(corners)
            first += len(own)
            material = document.get("materials", [{}])[primitive.get("material", 0)].get("pbrMetallicRoughness", {})
            texture = material.get("baseColorTexture")
            image_of.append(np.full(len(corners), len(images)))
            images.append((np.array(material.get("baseColorFactor", [1, 1, 1])[:3]), image(texture["index"]) if texture else None))
    triangles = np.concatenate(triangles)
    return Surface(np.concatenate(positions), triangles, None, np.concatenate(places), triangles, images, np.concatenate(image_of))


def read(path):
    return {"obj": read_obj, "glb": read_glb}.get(path.lower().rsplit(".", 1)[-1], read_ply)(path)


def weights_at(surface, triangles, points):
    a, b, c = (surface.positions[surface.triangles[triangles, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.maximum((normal * normal).sum(axis=1), 1e-300)
    of_b = (np.cross(points - a, c - a) * normal).sum(axis=1) / squared
    of_c = (np.cross(b - a, points - a) * normal).sum(axis=1) / squared
    weights = np.clip(np.stack([1 - of_b - of_c, of_b, of_c], axis=1), 0, 1)
    return weights / weights.sum(axis=1, keepdims=True)


class Judge:
    """Points spread by area over a surface, and what it shows there."""

    def __init__(self, source, points=POINTS):
        random = np.random.default_rng(7)
        a, b, c = (source.positions[source.triangles[:, k]] for k in range(3))
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        self.triangles = random.choice(len(areas), points, p=areas / areas.sum())
        u, v = random.random((2, points))
        flip = u + v > 1
        u[flip], v[flip] = 1 - u[flip], 1 - v[flip]
        self.weights = np.stack([1 - u - v, u, v], axis=1)
        self.points = (source.positions[source.triangles[self.triangles]] * self.weights[:, :, None]).sum(axis=1)
        self.wanted = [source.colour(self.triangles, self.weights, in_linear_light) for in_linear_light in [True, False]]

    def squares(self, output):
        """Squares of what the output shows at its closest points; between texels in linear light, and as bytes."""
        found, closest = output.mesh().find_closest_cell(self.points, return_closest_point=True)
        return self.squares_at(output, found, weights_at(output, found, closest))

    def squares_at(self, output, triangles, weights):
        return [((output.colour(triangles, weights, linear) - self.wanted[not linear]) ** 2).mean(axis=1) for linear in [True, False]]


def decibels(squares):
    return 10 * np.log10(255**2 / squares.mean())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=POINTS)
    parser.add_argument("input")
    parser.add_argument("outputs", nargs="+")
    arguments = parser.parse_args()
    judge = Judge(read(arguments.input), arguments.points)
    for path in arguments.outputs:
        output = read(path)
        squares = judge.squares(output)
        of_light, of_bytes = (decibels(each) for each in squares)
        light = np.sort(squares[0])
        worst = np.sqrt(light[-max(len(light) // 100, 1) :].mean())
        error = 2 * 10 / np.log(10) * light.std() / light.mean() / np.sqrt(len(light)) if light.mean() > 0 else 0.0
        print(
            f"{path}: {len(output.triangles)} triangles, {of_light:.2f} dB ({of_bytes:.2f} between bytes; {error:.2f} dB either way by chance), "
            f"worst 1 % off by {worst:.1f} of 255 on average"
        )


if __name__ == "__main__":
    main()
