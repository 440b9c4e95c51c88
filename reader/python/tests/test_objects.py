"""What the input named: names, ids, the tree of assemblies, and what a ray meets."""

import unittest

import lodpack
import numpy as np

from .served import SMALL, VECTORS

# Sixty boxes: some names repeat, some objects have none.
BOXES = VECTORS / "objects.lodpack"


def triangles(mesh):
    """The corners of each triangle, from the least one on, ascending."""
    corners = [[tuple(point) for point in triangle] for triangle in mesh.positions[mesh.triangles].tolist()]
    return sorted(min(tuple(of[first:] + of[:first]) for first in range(3)) for of in corners)


class Objects(unittest.TestCase):
    def setUp(self):
        self.file = lodpack.open(BOXES)
        self.objects = self.file.objects()

    def test_what_names_and_ids_say_is_found_again(self):
        objects = self.objects
        self.assertEqual((len(objects), self.file.info()["objects"]), (60, 60))
        self.assertGreater(objects.node_count, 60)
        for number in range(objects.node_count):
            node = objects[number]
            self.assertEqual(node.number, number)
            if node.name is not None:
                self.assertIn(number, objects.find(node.name))
            if node.id is not None:
                self.assertIn(number, objects.find_id(node.id))
            self.assertIn(number, objects.children(node.parent))
            above = objects.above(number)
            self.assertEqual(above[:1], [] if node.parent is None else [node.parent])
            self.assertEqual(bool(objects.leaves(number)), number < 60)
        self.assertEqual(objects.find("no such name"), [])
        self.assertIn("60 objects", repr(objects))
        self.assertIsNone(lodpack.open(SMALL).objects())
        self.assertEqual(lodpack.open(SMALL).info()["objects"], 0)

    def test_what_is_no_object_is_refused(self):
        with self.assertRaises(IndexError):
            self.objects[self.objects.node_count]
        for wrong in ("a", 1.5, None):
            with self.assertRaises(lodpack.Error):
                self.objects[wrong]
        with self.assertRaises(lodpack.Error):
            self.objects.find(7)

    def test_what_is_hidden_and_what_is_shown_alone_are_the_whole(self):
        whole = set(triangles(self.file.extract()))
        for some in ([3], [0, 7, self.objects.node_count - 1], range(0, 60, 2), []):
            rest = triangles(self.file.extract(hide=some))
            own = triangles(self.file.extract(only=some))
            self.assertEqual((set(rest) | set(own), len(rest) + len(own)), (whole, len(whole)))
            self.assertEqual(bool(own), bool(list(some)))
        coarse = self.file.extract(tolerance=1e9, hide=[3])
        self.assertLess(len(coarse.triangles), len(whole))
        named = next(node.name for node in map(self.objects.__getitem__, range(60)) if node.name)
        numbers = self.objects.find(named)
        self.assertEqual(triangles(self.file.extract(only=named)), triangles(self.file.extract(only=numbers)))
        low, high = self.objects.bounds(named)
        positions = self.file.extract(only=named).positions
        self.assertTrue((positions >= low).all() and (positions <= high).all())
        self.assertIsNone(self.objects.bounds([]))
        with self.assertRaises(lodpack.QueryError):
            self.file.extract(hide="no such name")
        with self.assertRaises(IndexError):
            self.file.extract(hide=[self.objects.node_count])
        with self.assertRaises(lodpack.QueryError):
            lodpack.open(SMALL).extract(hide=[0])

    def test_a_ray_passes_what_is_hidden(self):
        hits = 0
        for number in range(0, 60, 7):
            low, high = map(np.array, self.objects.bounds(number))
            origin = high + 1000
            direction = (low + high) / 2 - origin
            pick = self.file.pick(origin, direction, only=number)
            if pick is None:
                continue
            hits += 1
            self.assertEqual(pick.object, number)
            first = self.file.pick(origin, direction)
            self.assertLessEqual(first.distance, pick.distance)
            past = self.file.pick(origin, direction, hide=first.object)
            self.assertTrue(past is None or past.object != first.object)
        self.assertGreater(hits, 3)

    def test_a_ray_meets_what_the_mesh_has_there(self):
        mesh = self.file.extract()
        corners = mesh.positions[mesh.triangles]
        met = 0
        for middle in corners.mean(axis=1)[::37]:
            origin = middle + (0.01, 0.02, 1000.0)
            pick = self.file.pick(origin, (0.0, 0.0, -1.0))
            wanted = heights_below(corners, origin)
            self.assertEqual(pick is None, wanted is None)
            if pick is None:
                continue
            met += 1
            self.assertAlmostEqual(pick.point[2], wanted, places=6)
            self.assertAlmostEqual(pick.distance, origin[2] - wanted, places=6)
            self.assertIn(pick.root, self.objects.leaves(pick.object))
        self.assertGreater(met, 10)
        self.assertIsNone(self.file.pick((0, 0, 1e6), (0, 0, 1)))
        for origin, direction in [((0, 0), (0, 0, 1)), ((0, 0, 0), (0, 0, 0)), ((0, 0, float("nan")), (0, 0, 1))]:
            with self.assertRaises(lodpack.QueryError):
                self.file.pick(origin, direction)


def heights_below(corners, origin):
    """The greatest height at which a vertical line meets one of these triangles; None if it meets none."""
    a, b, c = (corners[:, k, :2] - origin[:2] for k in range(3))
    cross = lambda p, q: p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    weights = np.stack([cross(b, c), cross(c, a), cross(a, b)])
    area = weights.sum(axis=0)
    inside = (area != 0) & ((weights * np.sign(area)) >= 0).all(axis=0)
    if not inside.any():
        return None
    weights = weights[:, inside] / area[inside]
    return (weights * corners[inside, :, 2].T).sum(axis=0).max()
