"""Files of heights: what they say, meshes, and windows of samples."""

import json
import unittest

import lodpack
import numpy as np

from .served import PACKAGE

VECTORS = PACKAGE.parent.parent / "format-spec" / "vectors" / "heights"
PLANES = ["cell", "hills", "islands", "ridge", "painted"]


def vector(name):
    return lodpack.open(VECTORS / f"{name}.lodpack")


class Heights(unittest.TestCase):
    def test_a_file_says_what_its_grid_is(self):
        for name in [*PLANES, "globe"]:
            grid = json.loads((VECTORS / f"{name}.json").read_text())["grid"]
            file = vector(name)
            info = file.info()
            self.assertIsInstance(file, lodpack.HeightsFile)
            self.assertEqual((info["columns"], info["rows"]), (grid["columns"] + (not grid["wraps"]), grid["rows"] + 1))
            self.assertEqual((info["holds"], info["wraps"], info["surface"] == "ellipsoid"), ("heights", grid["wraps"], name == "globe"))
            self.assertEqual((info["ramp"] is not None, info["depth_count"]), (name == "painted", grid["depth"] + 1))
            self.assertTrue((file.bounds[0] <= file.bounds[1]).all())
            self.assertIn(f"{info['columns']:,} x {info['rows']:,}", repr(file))

    def test_images_over_heights_are_those_of_the_vectors(self):
        self.assertIsNone(vector("cell").image())
        for name in ("draped", "photo"):
            said = json.loads((VECTORS / f"{name}.json").read_text())["drape"]
            file = vector(name)
            info = file.info()["drape"]
            self.assertEqual((list(info["size"]), info["has_opacity"]), (said["size"], said["components"] == 4))
            image = file.image()
            self.assertEqual((image.pixels.ndim, image.pixels.dtype), (3, np.uint8))
            self.assertLessEqual(max(file.image(max_pixels=10).pixels.shape[:2]), 12)
            self.assertGreater(image.spacing[0], 0)
            self.assertLess(image.spacing[1], 0)
            self.assertEqual(file.extract().colours.shape[1], 4)
        # A texel a sample, whose middle the sample is.
        self.assertEqual(image.pixels.shape, (13, 21, 3))

    def test_windows_have_the_samples_of_the_vectors(self):
        for name in [*PLANES, "globe"]:
            said = json.loads((VECTORS / f"{name}.json").read_text())
            zero, step = (np.array([int(said["surface"]["numbers"][k], 16)], np.uint64).view(np.float64)[0] for k in (7, 8))
            file, depth = vector(name), said["grid"]["depth"]
            heights = file.window().heights
            self.assertEqual(heights.shape, (file.info()["rows"], file.info()["columns"]))
            compared = 0
            for tile in said["tiles"]:
                if tile["tile"][0] != depth:
                    continue
                column, row = (64 * number for number in tile["tile"][1:])
                expected = np.array(tile["samples"], dtype=float) * step + zero
                window = heights[row : row + expected.shape[0], column : column + expected.shape[1]]
                # The last column of a grid that wraps is its first one.
                expected = expected[:, : window.shape[1]]
                both = ~np.isnan(expected)
                np.testing.assert_array_equal(window[both], expected[both])
                compared += both.sum()
            self.assertGreater(compared, 0 if name == "islands" else heights.size // 2)

    def test_windows_know_where_they_are(self):
        file = vector("hills")
        info, whole = file.info(), file.window()
        (x, y), (dx, dy) = info["first"], info["spacing"]
        part = file.window(bbox=((x + 3 * dx, y + 9 * dy), (x + 7.5 * dx, y + 4 * dy)))
        np.testing.assert_array_equal(part.heights, whole.heights[4:10, 3:8])
        self.assertEqual((part.first, part.spacing), ((x + 3 * dx, y + 4 * dy), (dx, dy)))
        a, b, c, d, e, f = part.transform
        self.assertEqual((a * 0.5 + b * 0.5 + c, d * 0.5 + e * 0.5 + f), part.first)
        same = file.window(columns=(3, 8), rows=(4, 10))
        np.testing.assert_array_equal(same.heights, part.heights)
        self.assertTrue(np.isnan(vector("islands").window().heights).any())

    def test_windows_of_infinite_boxes_end_with_the_grid(self):
        far = float("inf")
        for name in [*PLANES, "globe"]:
            file = vector(name)
            whole = file.window()
            for bbox in [((-far, -far), (far, far)), ((-far, -1e300), (1e300, far))]:
                window = file.window(bbox=bbox)
                np.testing.assert_array_equal(window.heights, whole.heights)
                self.assertEqual(window[1:], whole[1:])
            for bbox in [((far, far), (far, far)), ((-far, -far), (-far, far)), ((-far, far), (far, far))]:
                with self.assertRaisesRegex(lodpack.QueryError, "no sample lies within"):
                    file.window(bbox=bbox)

    def test_windows_go_around_the_globe(self):
        file = vector("globe")
        whole, count = file.window().heights, file.info()["columns"]
        around = file.window(columns=(count - 5, count + 6)).heights
        np.testing.assert_array_equal(around, np.concatenate([whole[:, -5:], whole[:, :6]], axis=1))
        date = file.window(bbox=((172.0, -10.0), (-172.0, 10.0)))
        self.assertEqual(date.heights.shape, (6, 5))
        self.assertEqual(date.first, (172.0, 10.0))
        self.assertEqual(file.window(bbox=((532.0, -10.0), (548.0, 10.0))).heights.tolist(), date.heights.tolist())

    def test_meshes_lie_on_the_samples(self):
        for name in PLANES:
            file = vector(name)
            info, heights = file.info(), file.window().heights
            mesh = file.extract()
            places = (mesh.positions[:, :2] - info["first"]) / info["spacing"]
            columns, rows = np.round(places).astype(int).T
            np.testing.assert_allclose(places, np.round(places), atol=1e-9)
            np.testing.assert_allclose(mesh.positions[:, 2], heights[rows, columns] * info["height_scale"])
            self.assertEqual(mesh.normals.shape, mesh.positions.shape)
            np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4)
            self.assertLess(mesh.triangles.max(), len(mesh.positions))
            self.assertEqual(len(mesh.triangle_nodes), len(mesh.triangles))

    def test_queries_are_kept(self):
        file = vector("hills")
        finest = file.extract()
        coarse = file.extract(tolerance=1e9)
        self.assertEqual((finest.limited_by, coarse.limited_by), ("finest", "tolerance"))
        self.assertLess(len(coarse.triangles), len(finest.triangles))
        self.assertLess(file.extract(tolerance=coarse.error / 2).error, coarse.error)
        self.assertEqual(file.extract(max_triangles=len(coarse.triangles)).limited_by, "triangles")
        (x, y), (dx, dy) = file.info()["first"], file.info()["spacing"]
        part = file.extract(bbox=((x, y + 5 * dy), (x + 5 * dx, y)))
        self.assertTrue(0 < len(part.triangles) < len(finest.triangles))

    def test_a_ramp_colours_meshes(self):
        file = vector("painted")
        stops = file.info()["ramp"]["stops"]
        self.assertEqual((file.info()["ramp"]["name"], len(stops)), ("hills", 4))
        mesh = file.extract()
        heights = [height + 1e-9 * number for number, (height, _) in enumerate(stops)]
        expected = np.stack([np.interp(mesh.positions[:, 2], heights, [colour[k] for _, colour in stops]) for k in range(3)], axis=1)
        between = np.abs(mesh.positions[:, 2] - 20.5) > 0.1
        np.testing.assert_allclose(mesh.colours[between, :3], expected[between], atol=0.51)
        self.assertTrue((mesh.colours[:, 3] == 255).all())
        self.assertIsNone(vector("hills").extract().colours)

    def test_what_makes_no_sense_is_refused(self):
        file = vector("hills")
        for query in [{"bbox": ((0, 0, 0), (1, 1, 1))}, {"bbox": ((0, np.nan), (1, 1))}, {"tolerance": -1}, {"max_triangles": -1}]:
            with self.assertRaises(lodpack.QueryError, msg=query):
                file.extract(**query)
        for window in [{"columns": (5, 5)}, {"columns": (0, 500)}, {"rows": (-1, 3)}, {"rows": "ab"}, {"bbox": ((9e9, 0), (9.1e9, 1))}]:
            with self.assertRaises(lodpack.QueryError, msg=window):
                file.window(**window)
        with self.assertRaises(lodpack.QueryError):
            file.window(columns=(0, 2), bbox=((0, 0), (1, 1)))
        file.close()
        with self.assertRaises(lodpack.QueryError):
            file.window()

    def test_damage_is_found(self):
        good = (VECTORS / "hills.lodpack").read_bytes()
        lodpack.open(good).verify()
        bad = bytearray(good)
        bad[-20] ^= 4
        with self.assertRaises(lodpack.FormatError):
            lodpack.open(bytes(bad)).verify()
        with self.assertRaises(lodpack.FormatError):
            lodpack.open(good[:-1])


if __name__ == "__main__":
    unittest.main()
