#!/usr/bin/env python3
"""Measures what Python adds to the reader: overhead.py FILE...

Opens, selects and extracts each file at each of its levels' errors, in Python and in Rust by turns (bench/overhead.rs,
which
`cargo build --release --example overhead` has made), and prints the medians of the processor seconds per mesh and their
ratio."""
import math
import os
import pathlib
import statistics
import sys
import time

import lodpack

BUILT = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", pathlib.Path(__file__).parents[1] / "target"))
ROUNDS = 25
# Processor seconds of one round, about.
ROUND_SECONDS = 0.25


def in_python(path, count, tolerance):
    start = time.process_time()
    for _ in range(count):
        mesh = lodpack.open(path).extract(tolerance=tolerance)
        assert len(mesh.positions)
        del mesh
    return time.process_time() - start


def in_rust(path, count, tolerance):
    return child_seconds(path, count, tolerance) - child_seconds(path, 0, tolerance)


def child_seconds(path, count, tolerance):
    program = str(BUILT / "release" / "examples" / "overhead")
    child = os.posix_spawn(program, [program, path, str(count), repr(tolerance)], os.environ)
    _, status, usage = os.wait4(child, 0)
    assert status == 0, status
    return usage.ru_utime + usage.ru_stime


def main():
    # The first mesh of a process imports numpy, which takes longer than a thousand small meshes: without this, the
    # first row counts that.
    in_python(sys.argv[1], 1, math.inf)
    print("file  triangles  Rust, ms  Python, ms  ratio")
    for path in sys.argv[1:]:
        for level in lodpack.open(path).info()["levels"]:
            tolerance = level["certified_error"]
            count = max(1, round(ROUND_SECONDS / max(in_python(path, 1, tolerance), 1e-4)))
            pairs = [(in_rust(path, count, tolerance), in_python(path, count, tolerance)) for _ in range(ROUNDS)]
            rust, python = (statistics.median(values) / count * 1e3 for values in zip(*pairs))
            triangles = lodpack.open(path).select(tolerance=tolerance).triangle_count
            print(f"{pathlib.Path(path).name}  {triangles:9,}  {rust:8.3f}  {python:8.3f}  {python / rust:.3f}", flush=True)


main()
