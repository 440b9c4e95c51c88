"""Hostile files, missing libraries, and leaks."""

import gc
import os
import subprocess
import sys
import unittest

import lodpack

from .served import SCAN, SMALL, VECTORS


def resident_bytes() -> int:
    with open("/proc/self/statm") as text:
        return int(text.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class Robust(unittest.TestCase):
    def test_every_invalid_file_is_refused(self):
        invalid = sorted((VECTORS / "invalid").glob("*.lodpack"))
        self.assertGreater(len(invalid), 100)
        for path in invalid:
            with self.subTest(path.stem), self.assertRaises((lodpack.FormatError, lodpack.UnsupportedError, lodpack.LimitError)):
                file = lodpack.open(path)
                file.verify()

    def test_an_invalid_file_that_opens_never_does_worse_than_an_exception(self):
        for path in (VECTORS / "invalid").glob("*.lodpack"):
            with self.subTest(path.stem):
                try:
                    file = lodpack.open(path)
                    queries = [{}, {"tolerance": float("inf")}, {"max_nodes": 4}, {"max_bytes": 100}]
                    if isinstance(file, lodpack.HeightsFile):
                        queries = [*queries[:2], {"max_triangles": 100}]
                    for query in queries:
                        file.extract(**query)
                    if isinstance(file, lodpack.File):
                        file.overview()
                except lodpack.Error:
                    pass

    def test_every_sound_file_is_verified(self):
        for path in VECTORS.glob("*.lodpack"):
            with self.subTest(path.stem):
                file = lodpack.open(path)
                file.verify()
                file.extract()

    def test_files_that_end_early_are_refused(self):
        content = SMALL.read_bytes()
        for length in range(0, len(content), 7):
            with self.subTest(length), self.assertRaises(lodpack.FormatError):
                lodpack.open(content[:length]).verify()

    @unittest.skipUnless(os.path.exists("/proc/self/statm"), "memory is measured on Linux")
    def test_ten_thousand_opens_leak_nothing(self):
        def open_often(count):
            for _ in range(count):
                file = lodpack.open(SMALL)
                file.extract(tolerance=float("inf"))
                file.select().nodes()
            del file
            gc.collect()

        open_often(1000)
        memory, files = resident_bytes(), len(os.listdir("/proc/self/fd"))
        open_often(10_000)
        grown = resident_bytes() - memory
        # Tests before this one may have left files to collect.
        self.assertLessEqual(len(os.listdir("/proc/self/fd")), files)
        # A leak of a hundred bytes each would be more.
        self.assertLess(grown, 1_000_000, f"{grown} bytes more after 10,000 opens")

    def test_without_numpy_only_meshes_are_missing(self):
        program = f"""
import sys
sys.modules["numpy"] = None
import lodpack
file = lodpack.open({os.fspath(SCAN)!r})
print(file.info()["source_triangles"], file.select().triangle_count)
try:
    file.extract()
except ImportError as error:
    print(error)
"""
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("pip install numpy", done.stdout)

    def test_a_missing_library_is_named(self):
        mesh = lodpack.open(SMALL).extract()
        for name in ("trimesh", "pyvista", "open3d"):
            before = sys.modules.get(name)
            sys.modules[name] = None
            try:
                with self.assertRaisesRegex(ImportError, f"pip install {name}"):
                    getattr(mesh, f"to_{name}")()
            finally:
                del sys.modules[name]
                if before is not None:
                    sys.modules[name] = before
