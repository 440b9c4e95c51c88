"""Builds: from files and from arrays, with progress, and stopped."""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

import lodpack
import numpy as np

from .served import PACKAGE, SCAN

MESH = PACKAGE.parent.parent / "tests" / "data" / "snowden.ply"


def grid(count):
    """Positions and triangles of a wavy sheet."""
    row, column = np.divmod(np.arange(count * count), count)
    positions = np.stack([column, row, 5 * np.sin(column / 9) * np.cos(row / 11)], axis=1).astype(float)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + count], axis=1)
    upper = np.stack([corner + 1, corner + count + 1, corner + count], axis=1)
    return positions, np.concatenate([lower, upper])


class Building(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def left(self):
        return sorted(path.name for path in self.folder.iterdir())

    def test_a_file_has_the_bytes_that_the_program_writes(self):
        stages = []
        output = self.folder / "scan.lodpack"
        summary = lodpack.build(MESH, output, threads=1, progress=lambda *stage: stages.append((threading.get_ident(), *stage)))
        self.assertEqual(output.read_bytes(), SCAN.read_bytes())
        self.assertEqual((summary["output"], summary["bytes"]), (output, output.stat().st_size))
        self.assertEqual(summary["certified_error"], lodpack.open(output).info()["levels"][-1]["certified_error"])
        self.assertEqual({thread for thread, *_ in stages}, {threading.get_ident()})
        self.assertGreater(len(stages), 1)
        self.assertEqual(self.left(), ["scan.lodpack"])
        self.assertEqual(output.stat().st_mode & 0o777, 0o666 & ~current_umask())

    def test_meshes_in_memory_build_like_files(self):
        import pyvista
        import trimesh

        positions, triangles = grid(60)
        mesh = trimesh.Trimesh(positions, triangles, process=False)
        surface = pyvista.PolyData.from_regular_faces(positions, triangles)
        mesh.export(self.folder / "grid.ply", encoding="ascii")
        contents = []
        for number, source in enumerate([(positions, triangles), [positions, triangles.astype("int32")], mesh, surface]):
            output = self.folder / f"{number}.lodpack"
            lodpack.build(source, output, tolerance=0.05)
            contents.append(output.read_bytes())
        self.assertEqual(contents, contents[:1] * 4)
        self.assertLessEqual(lodpack.open(contents[0]).extract().error, 0.05)
        named = lodpack.build(self.folder / "grid.ply", tolerance="0.4edge")
        self.assertEqual(named["output"], self.folder / "grid.lodpack")

    def test_meshes_in_memory_keep_what_they_carry(self):
        import pyvista
        import trimesh
        from PIL import Image

        positions, triangles = grid(40)
        colours = np.full((len(positions), 4), 255, np.uint8)
        colours[:, :3] = (np.stack([positions[:, 0], positions[:, 1], 20 + 0 * positions[:, 0]], axis=1) * 6).astype(np.uint8)
        faces = np.tile(np.array([200, 30, 60, 255], np.uint8), (len(triangles), 1))
        uv = positions[:, :2] / 39
        image = np.zeros((64, 64, 3), np.uint8)
        image[:32], image[32:] = (250, 20, 20), (20, 20, 250)
        painted = trimesh.Trimesh(positions, triangles, process=False, vertex_colors=colours)
        swatches = trimesh.Trimesh(positions, triangles, process=False, face_colors=faces)
        visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(image))
        textured = trimesh.Trimesh(positions, triangles, process=False, visual=visual)
        surface = pyvista.PolyData.from_regular_faces(positions, triangles)
        surface.point_data["RGB"], surface.point_data["depth"] = colours[:, :3], positions[:, 2]
        mapped = pyvista.PolyData.from_regular_faces(positions, triangles)
        mapped.active_texture_coordinates = uv.astype(np.float32)
        built = []
        for source in [painted, swatches, textured, surface, (mapped, pyvista.Texture(image))]:
            output = self.folder / f"{len(built)}.lodpack"
            built.append((lodpack.build(source, output, tolerance=0.05), lodpack.open(output).extract(channels="all")))
        for summary, mesh in built:
            self.assertEqual(mesh.channels[0]["kind"], "colour")
            self.assertFalse([note for note in summary["notes"] if "not kept" in note])
        for _, mesh in (built[0], built[3]):
            expected = mesh.positions[:, :2] * 6
            self.assertLess(np.abs(mesh.colours[:, :2] - expected).mean(), 6)
        self.assertLess(np.abs(built[1][1].colours.astype(int) - faces[0]).max(), 10)
        np.testing.assert_allclose(built[3][1].values("depth")[:, 0], built[3][1].positions[:, 2], atol=0.2)
        # The first rows of an image are at its top.
        for _, mesh in (built[2], built[4]):
            above = mesh.positions[:, 1] > 22
            below = mesh.positions[:, 1] < 17
            self.assertGreater(mesh.colours[above, 0].mean(), 200)
            self.assertGreater(mesh.colours[below, 2].mean(), 200)
        summary = lodpack.build(mapped, self.folder / "bare.lodpack", tolerance=0.05)
        self.assertIn("texture coordinates are not kept", " ".join(summary["notes"]))

    def test_what_cannot_be_built_is_named_and_leaves_nothing(self):
        positions, triangles = grid(5)
        output = self.folder / "out.lodpack"
        cases = [
            (lodpack.BuildError, "nowhere.ply", self.folder / "nowhere.ply", {}),
            (lodpack.BuildError, "not finite", (np.where(positions == 2, np.nan, positions), triangles), {}),
            (lodpack.BuildError, "does not exist", (positions, triangles + 20), {}),
            (lodpack.BuildError, "does not exist", (positions, triangles - 1), {}),
            (lodpack.BuildError, "three columns", (positions[:, :2], triangles), {}),
            (lodpack.BuildError, "numbers of vertices", (positions, triangles + 0.5), {}),
            (lodpack.QueryError, "not a tolerance", (positions, triangles), {"tolerance": "fine"}),
            (lodpack.QueryError, "not a tolerance", (positions, triangles), {"tolerance": float("nan")}),
            (lodpack.QueryError, "less than 0", (positions, triangles), {"tolerance": -1.0}),
            (lodpack.QueryError, "best", (positions, triangles), {"effort": "heroic"}),
            (lodpack.QueryError, "unknown unit", (positions, triangles), {"unit": "parsec"}),
            (lodpack.QueryError, "at most 1024 threads", (positions, triangles), {"threads": 2000}),
            (lodpack.QueryError, "zero or more", (positions, triangles), {"threads": -1}),
            (lodpack.QueryError, "bytes", (positions, triangles), {"memory": 2**64}),
            (lodpack.ArgumentError, "effort", (positions, triangles), {"effort": 3}),
            (lodpack.ArgumentError, "unit", (positions, triangles), {"unit": 1}),
            (lodpack.ArgumentError, "tolerance", (positions, triangles), {"tolerance": None}),
            (lodpack.ArgumentError, "progress", (positions, triangles), {"progress": 5}),
            (lodpack.ArgumentError, "mesh file", 5.0, {}),
            (lodpack.BuildError, "numbers", ("ab", triangles), {}),
        ]
        for kind, message, source, options in cases:
            with self.subTest(message), self.assertRaisesRegex(kind, message):
                lodpack.build(source, output, **options)
            self.assertEqual(self.left(), [])
        output.write_bytes(b"something")
        for kind in [FileExistsError, lodpack.BuildError]:
            with self.assertRaisesRegex(kind, "force=True"):
                lodpack.build((positions, triangles), output)
        with self.assertRaisesRegex(lodpack.BuildError, "No such file"):
            lodpack.build((positions, triangles), self.folder / "nowhere" / "out.lodpack")
        self.assertEqual(output.read_bytes(), b"something")
        lodpack.build((positions, triangles), output, force=True)
        lodpack.open(output).verify()
        with self.assertRaisesRegex(lodpack.QueryError, "give an output"):
            lodpack.build((positions, triangles))

    def test_a_file_that_appears_during_a_build_stays(self):
        output = self.folder / "out.lodpack"

        def appear(*_):
            output.write_bytes(b"something")

        with self.assertRaisesRegex(lodpack.BuildError, "appeared"):
            lodpack.build(MESH, output, effort="best", progress=appear)
        self.assertEqual(output.read_bytes(), b"something")
        self.assertEqual(self.left(), [output.name])

    def test_an_exception_of_progress_stops_a_build(self):
        class Enough(Exception):
            pass

        def stop(stage, done, total):
            raise Enough(stage)

        with self.assertRaises(Enough):
            lodpack.build(MESH, self.folder / "out.lodpack", effort="best", progress=stop)
        self.assertEqual(self.left(), [])

    def test_ctrl_c_stops_a_build_and_leaves_nothing(self):
        # Whoever runs the tests in the background may ignore the signal, which children inherit.
        program = f"""
import lodpack, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
told = []
lodpack.build({os.fspath(MESH)!r}, {os.fspath(self.folder / "out.lodpack")!r}, effort="best", threads=2,
              progress=lambda *stage: told or told.append(print("begun", flush=True)))
print("done")
"""
        child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.assertEqual(child.stdout.readline(), "begun\n")
        child.send_signal(signal.SIGINT)
        out, said = child.communicate(timeout=60)
        self.assertIn("KeyboardInterrupt", said)
        self.assertNotIn("panicked", said)
        self.assertEqual((out, self.left()), ("", []))

    def test_other_threads_go_on_during_a_build(self):
        ticks, ended = [], threading.Event()

        def tick():
            while not ended.is_set():
                ticks.append(time.monotonic())
                time.sleep(0.001)

        thread = threading.Thread(target=tick)
        thread.start()
        lodpack.build(MESH, self.folder / "out.lodpack", effort="best")
        ended.set()
        thread.join()
        # With the interpreter's lock held there would be one or two.
        self.assertGreater(len(ticks), 20)


def current_umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask
