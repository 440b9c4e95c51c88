"""Shading over the surface: the angle between the normals that meshes show and those of their input.

    python3 tests/bench/normals.py INPUT.ply OUTPUT.glb [OUTPUT.glb ...]
    python3 tests/bench/normals.py creases INPUT.ply OUTPUT.glb [OUTPUT.glb ...]
    python3 tests/bench/normals.py creases --facets INPUT.ply OUTPUT.glb [OUTPUT.glb ...]

Spreads 100,000 points by area over the input, takes the closest point of each on the output, and compares the input's
normal (between vertices, whose normals are the means of their triangles') with that of the output's triangle, and with
that of its normal texture, as glTF 2.0 says (section 3.9.3), where it has one, or that of its vertices. With creases,
the output is also shaded by the rule of SPEC.md, 14.4, with several angles in place of its own; --facets has the
input's triangles in place of normals between vertices, for models that have creases. Needs numpy, pillow, pyvista and
scipy, and shares no code with lodpack.
"""

import io
import json
import struct
import sys

import numpy as np
import pyvista
from PIL import Image
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

POINTS = 100_000
CREASES = [0, 30, 45, 60, 75, 180]


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
        self.frames = self.normals = None
        if "NORMAL" in attributes and "TANGENT" not in attributes:
            self.normals = self.accessor(attributes["NORMAL"]).astype(float)
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


def smooth(positions, triangles, degrees, by_angle=False):
    """The normals of corners by SPEC.md, 14.4, with creases from an angle on; or with angles for weights."""
    _, welded = np.unique(positions, axis=0, return_inverse=True)
    corners = welded.ravel()[triangles]
    normals = unit(face_normals(positions, triangles))
    count = len(triangles)
    # Half-edge 3 f + k runs from corner k of triangle f to its next one.
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    key = np.minimum(start, end) * (corners.max() + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, of_edge = np.unique(key[order], return_index=True, return_counts=True)
    one = order[first[of_edge == 2]]
    other = order[first[of_edge == 2] + 1]
    cosines = (normals[one // 3] * normals[other // 3]).sum(axis=1)
    is_smooth = (start[one] == end[other]) & (start[one] != start[other]) & (cosines > np.cos(np.radians(degrees)) - (degrees == 180))
    one, other = one[is_smooth], other[is_smooth]
    following = lambda half: half // 3 * 3 + (half + 1) % 3
    pairs = np.concatenate([[one, following(other)], [following(one), other]], axis=1)
    graph = coo_matrix((np.ones(pairs.shape[1]), pairs), (3 * count, 3 * count))
    fans, fan_of = connected_components(graph, directed=False)
    points = positions[triangles]
    weighted = np.repeat(face_normals(positions, triangles)[:, None], 3, axis=1)
    if by_angle:
        to_next, to_previous = (unit(np.roll(points, turn, axis=1) - points) for turn in (-1, 1))
        weighted = normals[:, None] * np.arccos(np.clip((to_next * to_previous).sum(axis=2), -1, 1))[:, :, None]
    sums = np.zeros((fans, 3))
    np.add.at(sums, fan_of, weighted.reshape(-1, 3))
    return unit(sums)[fan_of].reshape(count, 3, 3)


class Judge:
    """Points spread by area over a mesh, and its normals there: between those of vertices, or of its triangles."""

    def __init__(self, positions, triangles, of_facets=False):
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
        self.wanted = unit(of_faces[chosen] if of_facets else (self.of_vertices[triangles[chosen]] * weights).sum(axis=1))

    def closest(self, positions, triangles):
        """The triangles on which the closest points lie, and the weights of their corners."""
        faces = np.concatenate([np.full((len(triangles), 1), 3), triangles], axis=1)
        found, closest = pyvista.PolyData(positions, faces.ravel()).find_closest_cell(self.points, return_closest_point=True)
        return found, weights_at(positions, triangles[found], closest)

    def degrees(self, shown):
        return np.degrees(np.arccos(np.clip((shown * self.wanted).sum(axis=1), -1, 1)))

    def angles(self, shown):
        """Median and root mean square, degrees."""
        degrees = self.degrees(shown)
        return np.median(degrees), np.sqrt((degrees**2).mean())


def read_mesh(path):
    mesh = pyvista.read(path)
    return np.asarray(mesh.points, dtype=float), mesh.faces.reshape(-1, 4)[:, 1:]


def creases(paths, of_facets):
    judge = Judge(*read_mesh(paths[0]), of_facets)
    for path in paths[1:]:
        output = Glb(path)
        found, weights = judge.closest(output.positions, output.triangles)
        print(f"{path}: {len(output.triangles)} triangles; mean, median and 95 % of the angles")

        def say(name, corners):
            shown = judge.degrees(unit((corners[found] * weights).sum(axis=1)))
            print(f"    {name:>12} {shown.mean():.2f} {np.median(shown):.2f} {np.percentile(shown, 95):.2f}")

        for angle in CREASES:
            say("flat" if angle == 0 else angle, smooth(output.positions, output.triangles, angle))
        say("30, by angle", smooth(output.positions, output.triangles, 30, by_angle=True))
        if output.normals is not None:
            say("its own", output.normals[output.triangles])


def main():
    if sys.argv[1] == "creases":
        of_facets = "--facets" in sys.argv
        return creases([path for path in sys.argv[2:] if path != "--facets"], of_facets)
    judge = Judge(*read_mesh(sys.argv[1]))
    for path in sys.argv[2:]:
        output = Glb(path)
        found, weights = judge.closest(output.positions, output.triangles)
        flat = judge.angles(unit(face_normals(output.positions, output.triangles))[found])
        print(f"{path}: {len(output.triangles)} triangles, flat median {flat[0]:.2f}, RMS {flat[1]:.2f} degrees")
        if output.frames is not None:
            mapped = judge.angles(output.mapped(found, weights))
            print(f"    with its image of normals median {mapped[0]:.2f}, RMS {mapped[1]:.2f} degrees")
        if output.normals is not None:
            shown = judge.angles(unit((output.normals[output.triangles[found]] * weights).sum(axis=1)))
            print(f"    with the normals of its vertices median {shown[0]:.2f}, RMS {shown[1]:.2f} degrees")


if __name__ == "__main__":
    main()
