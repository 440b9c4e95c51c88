"""Shading over the surface: the angle between the normals that meshes show and those of their input.

    python3 tests/bench/normals.py INPUT.ply OUTPUT.glb [OUTPUT.glb ...]

Spreads 100,000 points by area over the input, takes the closest point of each on the output, and compares the input's normal (between
vertices, whose normals are the means of their triangles') with that of the output's triangle, and with that of its normal texture, as glTF
2.0 says (section 3.9.3), where it has one. Needs numpy, pillow and pyvista, and shares no code with lodpack.
"""

import io
import json
import struct
import sys

import numpy as np
import pyvista
from PIL import Image

POINTS = 100_000


def unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def face_normals(positions, triangles):
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def weights_at(positions, triangles, points):
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.maximum((normal * normal).sum(axis=1), 1e-300)
    of_b = (np.cross(points - a, c - a) * normal).sum(axis=1) / squared
    of_c = (np.cross(b - a, points - a) * normal).sum(axis=1) / squared
    weights = np.clip(np.stack([1 - of_b - of_c, of_b, of_c], axis=1), 0, 1)
    return (weights / weights.sum(axis=1, keepdims=True))[:, :, None]


class Glb:
    """One mesh whose primitives share their vertices, as lodpack writes it."""

    def __init__(self, path):
        with open(path, "rb") as file:
            data = file.read()
        length = struct.unpack_from("<I", data, 12)[0]
        self.document, self.binary = json.loads(data[20 : 20 + length]), data[28 + length :]
        mesh = self.document["meshes"][0]["primitives"]
        attributes = mesh[0]["attributes"]
        self.positions = self.accessor(attributes["POSITION"]).astype(float) + self.document["nodes"][0].get("translation", [0, 0, 0])
        corners = [self.accessor(primitive["indices"]).reshape(-1, 3).astype(int) for primitive in mesh]
        self.triangles = np.concatenate(corners)
        self.material_of = np.concatenate([np.full(len(own), p.get("material", -1)) for own, p in zip(corners, mesh)])
        self.frames = None
        if "TANGENT" in attributes:
            normal, tangent = self.accessor(attributes["NORMAL"]).astype(float), self.accessor(attributes["TANGENT"]).astype(float)
            across = np.cross(normal, tangent[:, :3]) * tangent[:, 3:]
            self.frames = np.stack([tangent[:, :3], across, normal], axis=1)
            self.places = self.accessor(attributes["TEXCOORD_0"]).astype(float)

    def accessor(self, number):
        a = self.document["accessors"][number]
        view = self.document["bufferViews"][a["bufferView"]]
        kind, count = {5123: "<u2", 5125: "<u4", 5126: "<f4"}[a["componentType"]], {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[a["type"]]
        start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
        return np.frombuffer(self.binary, kind, a["count"] * count, start).reshape(a["count"], count)

    def image(self, material):
        texture = self.document["materials"][material]["normalTexture"]["index"]
        view = self.document["bufferViews"][self.document["images"][self.document["textures"][texture]["source"]]["bufferView"]]
        start = view.get("byteOffset", 0)
        return np.asarray(Image.open(io.BytesIO(self.binary[start : start + view["byteLength"]])).convert("RGB")).astype(float)

    def mapped(self, found, weights):
        corners = self.triangles[found]
        frames = (self.frames[corners] * weights[..., None]).sum(axis=1)
        places = (self.places[corners] * weights).sum(axis=1)
        result = np.zeros((len(found), 3))
        for material in np.unique(self.material_of):
            of_image = self.material_of[found] == material
            image = self.image(material)
            height, width, _ = image.shape
            x, y = places[of_image, 0] * width - 0.5, places[of_image, 1] * height - 0.5
            left, top = np.clip(np.floor(x).astype(int), 0, width - 2), np.clip(np.floor(y).astype(int), 0, height - 2)
            right, down = (x - left)[:, None], (y - top)[:, None]
            above = image[top, left] * (1 - right) + image[top, left + 1] * right
            below = image[top + 1, left] * (1 - right) + image[top + 1, left + 1] * right
            local = (above * (1 - down) + below * down) / 127.5 - 1
            result[of_image] = (frames[of_image] * local[:, :, None]).sum(axis=1)
        return unit(result)


class Judge:
    """Points spread by area over a mesh, and its normals there."""

    def __init__(self, positions, triangles):
        of_faces = face_normals(positions, triangles)
        self.of_vertices = np.zeros_like(positions)
        for k in range(3):
            np.add.at(self.of_vertices, triangles[:, k], of_faces)
        self.of_vertices = unit(self.of_vertices)
        random = np.random.default_rng(7)
        areas = np.linalg.norm(of_faces, axis=1)
        chosen = random.choice(len(areas), POINTS, p=areas / areas.sum())
        weights = random.dirichlet([1, 1, 1], POINTS)[:, :, None]
        self.points = (positions[triangles[chosen]] * weights).sum(axis=1)
        self.wanted = unit((self.of_vertices[triangles[chosen]] * weights).sum(axis=1))

    def closest(self, positions, triangles):
        """The triangles on which the closest points lie, and the weights of their corners."""
        faces = np.concatenate([np.full((len(triangles), 1), 3), triangles], axis=1)
        found, closest = pyvista.PolyData(positions, faces.ravel()).find_closest_cell(self.points, return_closest_point=True)
        return found, weights_at(positions, triangles[found], closest)

    def angles(self, shown):
        """Median and root mean square, degrees."""
        degrees = np.degrees(np.arccos(np.clip((shown * self.wanted).sum(axis=1), -1, 1)))
        return np.median(degrees), np.sqrt((degrees**2).mean())


def read_mesh(path):
    mesh = pyvista.read(path)
    return np.asarray(mesh.points, dtype=float), mesh.faces.reshape(-1, 4)[:, 1:]


def main():
    judge = Judge(*read_mesh(sys.argv[1]))
    for path in sys.argv[2:]:
        output = Glb(path)
        found, weights = judge.closest(output.positions, output.triangles)
        flat = judge.angles(unit(face_normals(output.positions, output.triangles))[found])
        print(f"{path}: {len(output.triangles)} triangles, flat median {flat[0]:.2f}, RMS {flat[1]:.2f} degrees")
        if output.frames is not None:
            mapped = judge.angles(output.mapped(found, weights))
            print(f"    with its image of normals median {mapped[0]:.2f}, RMS {mapped[1]:.2f} degrees")


if __name__ == "__main__":
    main()
