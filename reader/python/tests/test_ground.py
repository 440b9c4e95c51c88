"""A mesh on its ground: heights in the same file, and where they are."""

import json
import unittest

import lodpack
import numpy as np

from .served import SMALL, VECTORS, served

TOWN = VECTORS / "ground.lodpack"
# Its mesh has y up, a unit of a quarter of a metre, and this origin; its ground says nothing of its place.
UNIT, ORIGIN = 0.25, np.array([16.0, -4.0, 0.5])


def placed(points):
    x, y, z = ((points - ORIGIN) / UNIT).T
    return np.stack([x, z, -y], axis=1)


class OnItsGround(unittest.TestCase):
    def test_a_ground_is_a_file_of_heights(self):
        file = lodpack.open(TOWN)
        ground = file.ground()
        self.assertIsInstance(ground, lodpack.Ground)
        self.assertIsInstance(ground.heights, lodpack.HeightsFile)
        self.assertEqual(ground.heights.info()["holds"], "heights")
        self.assertGreater(file.info()["ground"]["bytes"], 100)
        self.assertFalse(np.isnan(ground.heights.window().heights).any())
        self.assertIn("ground of", repr(ground))
        self.assertIsNone(lodpack.open(SMALL).ground())
        self.assertIsNone(lodpack.open(SMALL).info()["ground"])

    def test_its_mesh_is_in_the_space_of_the_mesh_on_it(self):
        ground = lodpack.open(TOWN).ground()
        own, seen = ground.heights.extract(), ground.extract()
        np.testing.assert_allclose(seen.positions, placed(own.positions), atol=1e-9)
        np.testing.assert_array_equal(seen.triangles, own.triangles)
        x, y, z = own.normals.T
        np.testing.assert_allclose(seen.normals, np.stack([x, z, -y], axis=1), atol=1e-6)
        self.assertEqual((ground.scale, seen.error), (1 / UNIT, own.error / UNIT))
        # What the vectors say of the middle of the only tile, whose last sample is the second one.
        said = json.loads(TOWN.with_suffix(".json").read_text())["ground"]["middles"]
        middle = np.array([int(number, 16) for number in said[0]], np.uint64).view(np.float64)
        self.assertEqual(ground.transform.shape, (4, 4))
        window = ground.heights.window()
        last = [first + step for first, step in zip(window.first, window.spacing)] + [window.heights[1, 1]]
        np.testing.assert_allclose(ground.points([last]), [middle], atol=1e-9)

    def test_queries_are_in_the_space_of_the_mesh(self):
        ground = lodpack.open(TOWN).ground()
        low, high = ground.extract().positions.min(axis=0), ground.extract().positions.max(axis=0)
        whole = ground.extract(bbox=(low, high), tolerance=0)
        self.assertEqual(len(whole.triangles), len(ground.heights.extract().triangles))
        column = ((low[0], -np.inf, low[2]), (np.inf, np.inf, np.inf))
        self.assertEqual(len(ground.extract(bbox=column).triangles), len(whole.triangles))
        beside = ((high[0] + 1, -np.inf, -np.inf), (np.inf, np.inf, np.inf))
        self.assertEqual(len(ground.extract(bbox=beside).triangles), 0)
        with self.assertRaises(lodpack.QueryError):
            ground.extract(bbox=((0, 0), (1, 1)))

    def test_it_is_read_when_it_is_asked_for_and_stays_when_the_file_is_closed(self):
        with served(TOWN.read_bytes()) as (url, _):
            file = lodpack.open(url)
            before = file.bytes_read
            file.extract()
            ground = file.ground()
            self.assertGreater(ground.heights.bytes_read, 0)
            self.assertGreaterEqual(file.bytes_read - before, ground.heights.bytes_read)
            file.close()
            self.assertGreater(len(ground.extract().triangles), 0)

    def test_damage_of_a_ground_is_found(self):
        good = TOWN.read_bytes()
        lodpack.open(good).verify()
        self.assertIsInstance(lodpack.open(good).ground(), lodpack.Ground)
        for name in ["ground_damaged", "ground_of_a_mesh", "ground_on_a_globe", "ground_elsewhere"]:
            file = lodpack.open(VECTORS / "invalid" / f"{name}.lodpack")
            with self.assertRaises(lodpack.FormatError, msg=name):
                file.ground().heights.verify()


if __name__ == "__main__":
    unittest.main()
