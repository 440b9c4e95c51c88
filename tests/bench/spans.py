#!/usr/bin/env python3
"""Computes work and span of builds: python tests/bench/spans.py [options] INPUT... [-- OPTIONS OF BUILD]

Each input is built on one thread with `lodpack build --trace`. Work is the time of all, by the clock or, with --cpu, by
the processor; the span is what it would take on any number of threads: of a loop whose passes may run side by side it
takes the longest one and what lies between them, of a loop of very many even passes a 64th. Then it is built on one
thread and on two, as often as --runs says, for the quotient of the shortest times. Prints Markdown, and with --serial
the stretches of which the span consists, longest first.
"""

import argparse
import collections
import json
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
# A loop of even passes is divided into so many.
EVEN = 64


class Node:
    def __init__(self, event, measure):
        self.name, self.kind = event["name"], event["cat"]
        self.begin, self.end = event["ts"], event["ts"] + event["dur"]
        self.time = event[measure]
        self.children = []

    def span(self, path, serial):
        """The span in microseconds; adds to `serial`, by names from the outside in, what it consists of."""
        path = (*path, self.name)
        if self.kind == "even":
            serial[path] += self.time / EVEN
            return self.time / EVEN
        own = max(0.0, self.time - sum(child.time for child in self.children))
        found = own
        serial[path] += own
        if self.kind == "loop":
            passes = [(child.span(path, part), part) for child in self.children for part in [collections.Counter()]]
            if passes:
                longest, of_longest = max(passes, key=lambda found: found[0])
                serial.update(of_longest)
                found += longest
            return found
        return own + sum(child.span(path, serial) for child in self.children)


def tree(events, measure):
    """The events of one thread as a tree under a root, by their times. With two threads, of which only one works at a
    time, theirs together are one."""
    begin, end = min(e["ts"] for e in events), max(e["ts"] + e["dur"] for e in events)
    root = Node({"name": "build", "cat": "step", "ts": begin, "dur": end - begin, "tdur": 0}, measure)
    nodes = [Node(event, measure) for event in events]
    nodes.sort(key=lambda node: (node.begin, -node.end))
    open_nodes = [root]
    for node in nodes:
        while len(open_nodes) > 1 and node.end > open_nodes[-1].end + 0.5:
            open_nodes.pop()
        open_nodes[-1].children.append(node)
        open_nodes.append(node)
    return root


def fill(node):
    """Processor time of a thread that waits for another one is that of what it waits for."""
    inner = sum(fill(child) for child in node.children)
    node.time = max(node.time, inner)
    return node.time


def build(lodpack, path, options, threads, trace=None):
    """Seconds, and seconds of processor time."""
    with tempfile.TemporaryDirectory() as folder:
        words = [lodpack, "build", path, "-o", f"{folder}/out.lodpack", "--threads", threads, "--progress", "none", *options]
        words += ["--trace", trace] if trace else []
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
        seconds, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(done.stderr)
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="+", type=pathlib.Path)
    parser.add_argument("--lodpack", type=pathlib.Path, default=ROOT / "target/release/lodpack")
    parser.add_argument("--cpu", action="store_true", help="measure processor time, where others use the machine, too")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--serial", type=int, default=0, metavar="N", help="the N longest stretches of the span")
    words = sys.argv[1:]
    at = words.index("--") if "--" in words else len(words)
    options, extra = parser.parse_args(words[:at]), words[at + 1 :]
    measure, lodpack = "tdur" if options.cpu else "dur", options.lodpack.resolve()
    print("| input | work | span | span over work | two threads over one |\n|---|---:|---:|---:|---:|")
    stretches = []
    for path in options.inputs:
        with tempfile.TemporaryDirectory() as folder:
            build(lodpack, path, extra, 1, f"{folder}/trace.json")
            root = tree(json.loads(pathlib.Path(folder, "trace.json").read_text()), measure)
        fill(root)
        serial = collections.Counter()
        span = root.span((), serial)
        stretches.append((path, serial))
        best = {n: min((build(lodpack, path, extra, n) for _ in range(options.runs)), default=(0, 0)) for n in (1, 2)}
        ratio = f"{best[2][0] / best[1][0]:.2f}" if options.runs else ""
        print(f"| {path.name} | {root.time / 1e6:.2f} s | {span / 1e6:.3f} s | 1/{root.time / span:.1f} | {ratio} |", flush=True)
    for path, serial in stretches if options.serial else []:
        print(f"\n{path.name}:")
        for names, microseconds in serial.most_common(options.serial):
            print(f"  {microseconds / 1e6:7.3f} s  {' > '.join(names[1:]) or 'outside'}")


if __name__ == "__main__":
    main()
