"""Meshes as objects of other libraries."""

import importlib.util
import unittest

import lodpack
import numpy as np

from .served import SCAN, SMALL, served


class Converting(unittest.TestCase):
    def test_trimesh_gets_every_vertex_and_the_error(self):
        mesh = lodpack.open(SCAN).extract()
        converted = mesh.to_trimesh()
        np.testing.assert_array_equal(converted.vertices, mesh.positions)
        np.testing.assert_array_equal(converted.faces, mesh.triangles)
        self.assertEqual(converted.metadata["certified_error"], mesh.error)

    def test_the_error_of_everything_goes_along_whatever_the_box(self):
        file = lodpack.open(SMALL)
        low, high = file.bounds
        whole = file.extract(max_nodes=3).error  # its tops
        for bbox in [(low, (low + high) / 2), (high + 1, high + 2)]:
            mesh = file.extract(bbox=bbox, context=True)
            self.assertGreater(mesh.error_everywhere, mesh.error)
            self.assertLessEqual(mesh.error_everywhere, whole)
            expected = {"certified_error": mesh.error_everywhere, "certified_error_in_box": mesh.error}
            self.assertEqual(mesh.to_trimesh().metadata, expected)
            fields = mesh.to_pyvista().field_data
            self.assertEqual({name: fields[name][0] for name in expected}, expected)
            for said in [repr(mesh), repr(mesh.cut)]:
                self.assertIn(f"{mesh.error:g} in the box, {mesh.error_everywhere:g} everywhere", said)

    def test_pyvista_gets_levels_and_errors(self):
        mesh = lodpack.open(SCAN).extract(max_triangles=5000)
        converted = mesh.to_pyvista()
        np.testing.assert_array_equal(converted.points, mesh.positions)
        np.testing.assert_array_equal(converted.regular_faces, mesh.triangles)
        self.assertEqual(converted.cell_data["certified_error"].max(), mesh.error)
        self.assertEqual(len(converted.cell_data["level"]), len(mesh.triangles))

    def test_an_overview_converts_like_a_cut(self):
        file = lodpack.open(SMALL.parent / "many_clusters.lodpack")
        overview = file.overview()
        if overview is None:
            self.fail("this vector has an overview")
        self.assertEqual(overview.to_pyvista().n_cells, len(overview.triangles))
        self.assertIsNone(overview.cut)

    def test_pyvista_reads_lodpack_files_by_itself(self):
        import pyvista

        tolerance = lodpack.open(SCAN).info()["levels"][1]["certified_error"]
        expected = lodpack.open(SCAN).extract(tolerance=tolerance)
        copy = pyvista.read(SCAN, tolerance=tolerance)
        np.testing.assert_array_equal(copy.points, expected.positions)
        with served(SCAN.read_bytes()) as (url, requests):
            streamed = pyvista.read(url, tolerance=tolerance)
        np.testing.assert_array_equal(streamed.points, expected.positions)
        self.assertTrue(requests and all(requests), "the reader asks for ranges")

    @unittest.skipUnless(importlib.util.find_spec("open3d"), "open3d is not installed")
    def test_open3d_gets_every_vertex(self):
        mesh = lodpack.open(SCAN).extract()
        converted = mesh.to_open3d()
        np.testing.assert_array_equal(np.asarray(converted.vertices), mesh.positions)
        np.testing.assert_array_equal(np.asarray(converted.triangles), mesh.triangles)
