"""The table of queries that every language answers alike: tests/data/queries.txt. reader/src/tests/queries.rs says what
its lines mean."""

import unittest

import lodpack
import numpy as np

from .served import PACKAGE, VECTORS

KINDS = {
    lodpack.QueryError: "query",
    lodpack.FormatError: "format",
    lodpack.LimitError: "limit",
    lodpack.UnsupportedError: "unsupported",
    lodpack.SourceError: "source",
}


def hash_of(*arrays):
    """FNV-1a of 64 bits."""
    value = 0xCBF29CE484222325
    for byte in b"".join(array.tobytes() for array in arrays):
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return f"{value:016x}"


def vector(name):
    return lodpack.open(VECTORS / f"{name}.lodpack")


def answer(asked):
    name, *words = asked.split(" ")
    file, query, drawer, channels = vector(name), {}, None, None
    is_of_heights = isinstance(file, lodpack.HeightsFile)
    for word in words:
        part, _, value = word.partition("=")
        if part == "box":
            numbers = [float(number) for number in value.split(",")]
            size = 2 if is_of_heights else 3
            query["bbox"] = (numbers[:size], numbers[3 : 3 + size])
        elif part == "context":
            query["context"] = True
        elif part == "channel":
            channels = [value]
        elif part == "drawn-by":
            drawer = vector(value)
        elif part == "tolerance":
            query["tolerance"] = float(value)
        else:
            query[f"max_{part}"] = int(value)
    try:
        if is_of_heights:
            mesh = file.extract(**query)
            count = len(np.unique(mesh.triangle_nodes))
        else:
            mesh = (drawer or file).extract(file.select(**query), channels=channels)
            count = mesh.cut.node_count
    except lodpack.Error as error:
        return KINDS[type(error)]
    numbers = [mesh.error, mesh.error_everywhere, mesh.limited_by, hash_of(mesh.positions, mesh.triangles)]
    carried = [f"{channel['name']}:{channel['kind']}" for channel in mesh.channels]
    return [count, len(mesh.triangles), len(mesh.positions), *numbers, *carried]


class Queries(unittest.TestCase):
    def test_queries_are_answered_as_in_every_other_language(self):
        lines = (PACKAGE.parent.parent / "tests" / "data" / "queries.txt").read_text().splitlines()
        self.assertGreaterEqual(len(lines), 40)
        for line in lines:
            asked, expected = line.split(" = ")
            # Cuts of heights are not seen in Python.
            if "drawn-by=heights" in asked:
                continue
            wanted = expected.split(" ")
            if len(wanted) > 1:
                wanted = [*map(int, wanted[:3]), *map(float, wanted[3:5]), *wanted[5:]]
            else:
                wanted = wanted[0]
            with self.subTest(asked):
                self.assertEqual(answer(asked), wanted)
