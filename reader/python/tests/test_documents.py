"""What the documents show runs as it stands there."""

import os
import re
import subprocess
import sys
import tempfile
import unittest

import lodpack

from .served import PACKAGE, SCAN, VECTORS, served, served_scan


def run(*arguments: str) -> str:
    """Runs Python in an empty folder, where nothing but what is installed can be imported."""
    with tempfile.TemporaryDirectory() as empty:
        done = subprocess.run([sys.executable, *arguments], cwd=empty, capture_output=True, text=True)
    if done.returncode:
        raise AssertionError(done.stdout + done.stderr)
    return done.stdout


class Documents(unittest.TestCase):
    def test_the_first_example_of_the_readme_reads_a_served_file_in_part(self):
        text = (PACKAGE / "README.md").read_text()
        example = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
        self.assertLessEqual(len([line for line in example.splitlines() if line.startswith(("file", "mesh", "import"))]), 3)
        with served_scan() as url:
            said = run("-c", example.replace("https://example.org/scan.lodpack", url))
        expected = lodpack.open(SCAN).extract(bbox=((0, 0, 0), (1, 1, 1)), tolerance=0.02)
        self.assertEqual(said, f"{len(expected.triangles)} triangles, at most {expected.error} off the input\n")
        self.assertGreater(len(expected.triangles), 0)

    def test_the_tour_runs_to_its_end(self):
        with served(SCAN.read_bytes()) as (url, _):
            said = run(os.fspath(PACKAGE / "examples" / "tour.py"), url)
        self.assertRegex(said, r"area \d")
        self.assertNotIn("samples; to the mesh", said)

    def test_the_tour_sees_a_ground(self):
        self.assertIn("samples; to the mesh", run(os.fspath(PACKAGE / "examples" / "tour.py"), os.fspath(VECTORS / "ground.lodpack")))

    def test_what_the_package_documents_is_there(self):
        for name in lodpack.__all__:
            self.assertTrue(getattr(lodpack, name).__doc__ or name == "__version__", name)
        self.assertIn("numpy", (PACKAGE / "pyproject.toml").read_text())
