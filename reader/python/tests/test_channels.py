"""Colours and numbers that the surface carries."""

import importlib.util
import pathlib
import tempfile
import unittest

import lodpack
import numpy as np

from .served import SCAN, VECTORS


def colour(points):
    """The colour at some points: a smooth function."""
    x, y, z = np.asarray(points).T
    return 127.5 + 100.0 * np.sin(np.stack([2 * x + y, 3 * y, 4 * z], axis=1))


def height(points):
    return 10.0 * np.asarray(points)[:, 2]


def sphere(path: pathlib.Path, side: int = 40) -> None:
    """Writes a sphere of 12 side^2 triangles with a colour and a number at each vertex."""
    numbers: dict[tuple[int, int, int], int] = {}
    faces = []
    for axis in range(3):
        a, b = [k for k in range(3) if k != axis]
        for at in (0, side):
            for i in range(side):
                for j in range(side):
                    corners = []
                    for u, v in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)):
                        point = [0, 0, 0]
                        point[axis], point[a], point[b] = at, u, v
                        corners.append(numbers.setdefault(tuple(point), len(numbers)))
                    if (at == side) == (axis == 1):
                        corners.reverse()
                    faces += [corners[:3], [corners[0], *corners[2:]]]
    points = np.array(list(numbers)) / side * 2 - 1
    points /= np.linalg.norm(points, axis=1)[:, None]
    vertices = np.zeros(len(points), dtype=[("p", "<f8", 3), ("c", "u1", 3), ("h", "<f4")])
    vertices["p"], vertices["c"], vertices["h"] = points, (colour(points) + 0.5).astype("u1"), height(points)
    triangles = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<u4", 3)])
    triangles["n"], triangles["i"] = 3, faces
    names = ["double x", "double y", "double z", "uchar red", "uchar green", "uchar blue", "float height"]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *(f"property {name}" for name in names)]
    header += [f"element face {len(faces)}", "property list uchar uint vertex_indices", "end_header\n"]
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + triangles.tobytes())


def rms(differences) -> float:
    return float(np.sqrt(np.mean(np.square(differences))))


class Channels(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with tempfile.TemporaryDirectory() as folder:
            mesh = pathlib.Path(folder) / "painted.ply"
            sphere(mesh, 80)
            lodpack.build(mesh, mesh.with_suffix(".lodpack"))
            cls.bytes = mesh.with_suffix(".lodpack").read_bytes()

    def test_are_listed(self):
        file = lodpack.open(self.bytes)
        self.assertEqual([(channel["name"], channel["kind"]) for channel in file.channels], [("colour", "colour"), ("height", "scalar")])
        self.assertEqual(file.info()["channels"], file.channels)
        self.assertEqual(lodpack.open(SCAN).channels, [])
        self.assertEqual([channel["lossless"] for channel in file.channels], [False, False])
        exact = lodpack.open(VECTORS / "exact_colours.lodpack")
        self.assertEqual([channel["lossless"] for channel in exact.channels], [True] * 4)

    def test_vertices_have_the_colours_and_numbers_of_the_input(self):
        mesh = lodpack.open(self.bytes).extract(channels="all")
        self.assertEqual((mesh.colours.dtype, mesh.colours.shape), (np.uint8, (len(mesh.positions), 4)))
        self.assertLess(rms(mesh.colours[:, :3] - colour(mesh.positions)), 5)
        self.assertTrue((mesh.colours[:, 3] == 255).all())
        self.assertEqual(mesh.values("height").shape, (len(mesh.positions), 1))
        self.assertLess(rms(mesh.values("height")[:, 0] - height(mesh.positions)), 0.3)
        np.testing.assert_array_equal(mesh.values("colour"), mesh.colours)

    def test_the_mesh_is_the_same_with_and_without(self):
        file = lodpack.open(self.bytes)
        bare, coloured = file.extract(), file.extract(channels="auto")
        np.testing.assert_array_equal(bare.positions, coloured.positions)
        np.testing.assert_array_equal(bare.triangles, coloured.triangles)
        np.testing.assert_array_equal(bare.triangle_nodes, coloured.triangle_nodes)
        self.assertEqual((bare.channels, bare.colours), ([], None))
        self.assertEqual([channel["name"] for channel in coloured.channels], ["colour"])

    def test_geometry_alone_reads_no_texel(self):
        bare, coloured = lodpack.open(self.bytes), lodpack.open(self.bytes)
        bare.extract(bare.select(max_triangles=100_000))
        coloured.extract(coloured.select(max_triangles=100_000), channels=["colour"])
        # The first read is of 12 KiB, whatever is there.
        self.assertLess(bare.bytes_read, coloured.bytes_read)
        self.assertLess(bare.bytes_read, len(self.bytes) - sum(channel["bytes"] for channel in bare.channels) + 12288)

    def test_texture_coordinates_lead_to_the_colours_of_the_input(self):
        textured = lodpack.open(self.bytes).extract(channels=["height", "colour"]).textured()
        image, numbers = textured.images["colour"], textured.images["height"]
        self.assertEqual((image.dtype, image.shape[2], numbers.dtype), (np.uint8, 3, np.uint16))
        self.assertEqual(image.shape[:2], numbers.shape[:2])
        self.assertEqual(textured.uv.shape, (len(textured.positions), 2))
        self.assertTrue(((textured.uv >= 0) & (textured.uv <= 1)).all())
        middles = textured.positions[textured.triangles].mean(axis=1)
        u, v = textured.uv[textured.triangles].mean(axis=1).T
        column = np.clip((u * image.shape[1]).astype(int), 0, image.shape[1] - 1)
        row = np.clip(((1 - v) * image.shape[0]).astype(int), 0, image.shape[0] - 1)
        self.assertLess(rms(image[row, column] - colour(middles)), 8)
        channel = textured.channels[0]
        self.assertLess(rms(channel["low"] + channel["step"] * numbers[row, column, 0] - height(middles)), 0.5)

    def test_trimesh_and_pyvista_get_colours(self):
        mesh = lodpack.open(self.bytes).extract(channels="all")
        np.testing.assert_array_equal(mesh.to_trimesh().visual.vertex_colors, mesh.colours)
        converted = mesh.to_pyvista()
        np.testing.assert_array_equal(converted.point_data["colour"], mesh.colours)
        np.testing.assert_array_equal(converted.point_data["height"], mesh.values("height")[:, 0])
        with_texture, texture = mesh.textured().to_pyvista()
        np.testing.assert_array_equal(with_texture.active_texture_coordinates, mesh.textured().uv)
        np.testing.assert_array_equal(texture.to_array(), mesh.textured().images["colour"])

    @unittest.skipUnless(importlib.util.find_spec("PIL"), "Pillow is not installed")
    def test_trimesh_gets_a_texture(self):
        textured = lodpack.open(self.bytes).extract(channels="auto").textured()
        converted = textured.to_trimesh()
        np.testing.assert_array_equal(converted.visual.uv, textured.uv)
        # The colour that trimesh finds for a vertex is that of the input.
        colours = np.asarray(converted.visual.to_color().vertex_colors)[:, :3]
        self.assertLess(rms(colours - colour(textured.positions)), 8)

    def test_what_makes_no_sense_is_refused_with_words(self):
        file = lodpack.open(self.bytes)
        for wrong, message in [(["color"], "it has colour, height"), ("colour", r"a list of names: give \['colour'\]")]:
            with self.assertRaisesRegex(lodpack.QueryError, message):
                file.extract(channels=wrong)
        mesh = file.extract(channels=["height"])
        self.assertIsNone(mesh.colours)
        with self.assertRaisesRegex(lodpack.QueryError, "extracted with height"):
            mesh.values("colour")
        with self.assertRaisesRegex(lodpack.QueryError, "needs a channel of colours"):
            mesh.textured().to_pyvista()
        with self.assertRaisesRegex(lodpack.QueryError, "extract it with channels"):
            file.extract().textured()
        with self.assertRaisesRegex(lodpack.QueryError, "it has none"):
            lodpack.open(SCAN).extract(channels=["x"])
        self.assertEqual(lodpack.open(SCAN).extract(channels="auto").channels, [])

    def test_damaged_texels_raise_and_the_surface_stays(self):
        damaged = bytearray(self.bytes)
        # Texels lie between the index and the pages, and are most of this file.
        damaged[len(damaged) // 2] ^= 0xFF
        file = lodpack.open(bytes(damaged))
        self.assertGreater(len(file.extract().triangles), 100)
        with self.assertRaisesRegex(lodpack.FormatError, "image|map|texel"):
            file.extract(channels="all")
