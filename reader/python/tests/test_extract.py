"""Queries, cuts, and arrays."""

import copy
import json
import math
import pickle
import unittest

import lodpack
import numpy as np

from .served import SCAN, SMALL, VECTORS


class Extracting(unittest.TestCase):
    def test_arrays_are_what_the_decoder_wrote_and_not_copies(self):
        mesh = lodpack.open(SCAN).extract()
        count = len(mesh.triangles)
        self.assertEqual((mesh.positions.dtype, mesh.positions.shape[1:]), (np.float64, (3,)))
        self.assertEqual((mesh.triangles.dtype, mesh.triangles.shape), (np.uint32, (count, 3)))
        self.assertEqual((mesh.triangle_nodes.dtype, mesh.triangle_nodes.shape), (np.uint32, (count,)))
        for array in (mesh.positions, mesh.triangles, mesh.triangle_nodes):
            self.assertFalse(array.flags.owndata)
            self.assertEqual(type(array.base).__module__, "lodpack._lodpack")
            self.assertTrue(array.flags.c_contiguous and array.flags.aligned and array.flags.writeable)
        mesh.positions += 1.0
        self.assertLess(mesh.triangles.max(), len(mesh.positions))

    def test_arrays_outlive_mesh_and_file(self):
        positions = lodpack.open(SMALL).extract().positions
        again = lodpack.open(SMALL).extract().positions
        np.testing.assert_array_equal(positions, again)

    def test_a_mesh_can_be_pickled_and_copied_with_all_that_it_knows(self):
        def same(a, b):
            for name in ["positions", "triangles", "triangle_nodes", "normals", "colours"]:
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
            self.assertEqual((repr(a), a.channels), (repr(b), b.channels))
            for channel in a.channels:
                np.testing.assert_array_equal(a.values(channel["name"]), b.values(channel["name"]))
            if a.cut is not None:
                for numbers, others in zip(a.cut.nodes(), b.cut.nodes()):
                    np.testing.assert_array_equal(numbers, others)
                self.assertEqual((a.cut.triangle_count, a.cut.node_count, repr(a.cut)), (b.cut.triangle_count, b.cut.node_count, repr(b.cut)))
            if a.channels:
                paged, others = a.textured(), pickle.loads(pickle.dumps(b.textured()))
                for name in ["positions", "triangles", "triangle_nodes", "uv"]:
                    np.testing.assert_array_equal(getattr(paged, name), getattr(others, name))
                self.assertEqual(list(paged.images), list(others.images))
                for name, image in paged.images.items():
                    np.testing.assert_array_equal(image, others.images[name])

        file = lodpack.open(VECTORS / "scales.lodpack")
        heights = lodpack.open(VECTORS / "heights" / "hills.lodpack")
        for mesh in [file.extract(), file.extract(channels="all"), lodpack.open(SMALL).extract(), heights.extract()]:
            again = pickle.loads(pickle.dumps(mesh))
            same(mesh, again)
            same(mesh, pickle.loads(pickle.dumps(again)))
            same(mesh, copy.deepcopy(mesh))
        with self.assertRaisesRegex(lodpack.QueryError, "select it again"):
            file.extract(pickle.loads(pickle.dumps(file.select())))

    def test_info_is_json_and_agrees_with_cuts(self):
        file = lodpack.open(SCAN)
        info = file.info()
        self.assertEqual(json.loads(json.dumps(info))["version"], info["version"])
        np.testing.assert_array_equal(file.bounds, info["bounds"])
        finest = file.extract()
        self.assertEqual(len(finest.triangles), info["levels"][-1]["triangles"])
        self.assertEqual(finest.limited_by, "finest")
        self.assertLessEqual(finest.error, info["levels"][-1]["certified_error"])
        low, high = file.bounds
        self.assertTrue((finest.positions >= low).all() and (finest.positions <= high).all())

    def test_a_tolerance_is_kept_with_fewer_triangles(self):
        file = lodpack.open(SCAN)
        levels = file.info()["levels"]
        tolerance = levels[len(levels) // 2]["certified_error"]
        mesh = file.extract(tolerance=tolerance)
        self.assertLessEqual(mesh.error, tolerance)
        self.assertEqual(mesh.limited_by, "tolerance")
        self.assertLess(len(mesh.triangles), levels[-1]["triangles"])

    def test_budgets_are_kept(self):
        file = lodpack.open(SCAN)
        coarsest = file.select(tolerance=math.inf)
        budget = coarsest.triangle_count + 50
        mesh = file.extract(max_triangles=np.int64(budget))
        self.assertLessEqual(len(mesh.triangles), budget)
        self.assertEqual(mesh.limited_by, "triangles")
        self.assertEqual(file.select(max_nodes=coarsest.node_count, tolerance=0).node_count, coarsest.node_count)
        self.assertEqual(file.select(max_triangles=10**30).limited_by, "finest")

    def test_a_box_takes_what_touches_it_and_context_the_rest(self):
        file = lodpack.open(SCAN)
        low, high = file.bounds
        box = (low, low + (high - low) / 2)
        inside, around = file.extract(bbox=box), file.extract(bbox=[list(corner) for corner in box], context=True)
        whole = file.extract()
        self.assertLess(0, len(inside.triangles))
        self.assertLessEqual(len(inside.triangles), len(around.triangles))
        self.assertLessEqual(len(around.triangles), len(whole.triangles))
        self.assertGreaterEqual(around.error_everywhere, around.error)

    def test_a_box_beside_the_surface_gives_an_empty_mesh(self):
        file = lodpack.open(SMALL)
        beside = file.bounds[1] + 1000
        mesh = file.extract(bbox=(beside, beside + 1))
        self.assertEqual((mesh.positions.shape, mesh.triangles.shape), ((0, 3), (0, 3)))

    def test_a_cut_says_beforehand_what_its_mesh_will_be(self):
        file = lodpack.open(SCAN)
        cut = file.select(tolerance=file.info()["levels"][1]["certified_error"])
        read = file.bytes_read
        roots, levels, errors = cut.nodes()
        self.assertEqual({len(roots), len(levels), len(errors)}, {cut.node_count})
        self.assertEqual((roots.dtype, levels.dtype, errors.dtype), (np.uint32, np.uint8, np.float64))
        mesh = file.extract(cut)
        self.assertGreaterEqual(file.bytes_read, read)
        self.assertEqual(len(mesh.triangles), cut.triangle_count)
        self.assertEqual(set(mesh.triangle_nodes), set(range(cut.node_count)))
        self.assertEqual(errors.max(), cut.error)
        self.assertIs(mesh.cut, cut)

    def test_the_same_bytes_come_out_every_time(self):
        first, second = (lodpack.open(SCAN).extract(max_triangles=5000) for _ in range(2))
        self.assertEqual(first.positions.tobytes(), second.positions.tobytes())
        self.assertEqual(first.triangles.tobytes(), second.triangles.tobytes())

    def test_bad_queries_are_the_callers_fault(self):
        file, other = lodpack.open(SMALL), lodpack.open(SMALL)
        nan, box = math.nan, ((0, 0, 0), (1, 1, 1))
        for query, message in [
            ({"tolerance": nan}, "tolerance must be zero or more"),
            ({"tolerance": -1}, "tolerance must be zero or more"),
            ({"bbox": ((nan, 0, 0), (1, 1, 1))}, "not a number"),
            ({"bbox": box[::-1]}, "smallest corner"),
            ({"bbox": (0, 0, 0, 1, 1, 1)}, "two corners"),
            ({"bbox": ((0, 0), (1, 1))}, "two corners"),
            ({"max_triangles": 1}, "at least"),
            ({"max_triangles": -1}, "zero or more"),
            ({"max_nodes": 0}, "at least"),
        ]:
            with self.subTest(query), self.assertRaisesRegex(lodpack.QueryError, message):
                file.extract(**query)
        torus = lodpack.open(SMALL.parent / "torus.lodpack")
        with self.assertRaisesRegex(lodpack.QueryError, "another file"):
            file.extract(torus.select())
        # Files of the same bytes share their cuts.
        self.assertEqual(len(file.extract(other.select()).triangles), len(file.extract().triangles))
        for wrong in [
            {"tolerance": "1mm"}, {"tolerance": []}, {"max_triangles": 1.5}, {"max_nodes": "3"}, {"bbox": 5}, {"bbox": (("a", 0, 0), (1, 1, 1))},
            {"channels": 5}, {"cut": 0.002}, {"cut": file.select(), "tolerance": 1},
        ]:
            with self.subTest(wrong), self.assertRaises(lodpack.QueryError):
                file.extract(**wrong)
        # That is Python's own.
        with self.assertRaises(TypeError):
            file.extract(tolerence=1)
