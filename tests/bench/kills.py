"""Kills builds at random moments and checks that no wrong file results: python tests/bench/kills.py MESH [options]

Each round runs a build on disk, a plan, its parts and its merge, or a job in stages. It sends SIGKILL at a random
moment, as often as --kills says, and resumes. After every kill, any file that has its final name must be correct; at
the end, all files must be. As root, some rounds run on a file system of their own that is too small, and is enlarged
after the error.

Prints a line per round and a summary. Exits with 1 if anything was wrong.
"""

import argparse
import collections
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

STAGES = {"scan": 0.02, "count": 0.04, "cut": 0.04, "divide": 0.06, "repair": 0.2, "match": 0.03, "segment": 0.2, "seams": 0.03, "build": 0.8, "arrange": 0.03, "encode": 0.03}
# How long a step takes at most, over the time of a build.
SHARES = {**STAGES, "build": 1.0, "build with workers": 1.0, "plan": 0.5, "part": 0.2, "merge": 0.1, "begin": 0.02}
ROOT = pathlib.Path(__file__).resolve().parents[2]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--lodpack", type=pathlib.Path, default=ROOT / "target/release/lodpack")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--stages", action="store_true", help="only jobs in stages")
    parser.add_argument("--full-disks", type=int, default=6, help="rounds on a file system that is too small (root only)")
    parser.add_argument("--regions", type=int, default=12, help="approximate number of regions")
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


class Driver:
    def __init__(self, options):
        self.options = options
        self.random = random.Random(options.seed)
        self.counts = collections.Counter()
        self.faults = []
        triangles = self.triangles()
        self.model = ["--region-triangles", str(max(1000, triangles // options.regions))]
        # The least memory with which one region can be built; the program says how much.
        refused = self.run(["build", options.mesh, *self.model, "--memory", "1MiB", "-o", os.devnull, "--force"], os.getcwd())
        self.memory = ["--memory", refused.stderr.split("--memory ")[-1].split()[0]]

    def triangles(self):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "out.lodpack"
            done = self.run(["build", self.options.mesh, "-o", out, "--json"], folder)
            import json

            return json.loads(done.stdout)["triangles"]

    def run(self, words, folder):
        return subprocess.run([self.options.lodpack.resolve(), *map(str, words)], cwd=folder, capture_output=True, text=True)

    def kill(self, words, folder, seconds):
        """Kills a process after a while. Returns whether it was still running."""
        program = self.options.lodpack.resolve()
        process = subprocess.Popen([program, *map(str, words)], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return True
        if process.returncode != 0:
            self.fault(f"{words}: {process.stderr.read().decode()}")
        return False

    def fault(self, what):
        self.faults.append(what)
        print("  WRONG:", what, flush=True)

    def steps(self):
        """The commands of a round, each with the file that it makes. All can be repeated."""
        mesh = self.options.mesh
        kind, parts = self.random.random(), self.random.choice([1, 2, 5, 30])
        if self.options.stages or kind < 0.4:
            return self.staged_steps(mesh, parts, kind)
        if kind < 0.65:
            return [("build", ["build", mesh, *self.model, *self.memory, "-o", "out.lodpack", "--resume"], "out.lodpack")]
        part = lambda number: ("part", ["build", "--job", "job", "--part", number], f"job/parts/part-{number}.lodpart")
        return [
            ("plan", ["plan", mesh, *self.model, *self.memory, "-o", "job", "--parts", parts, "--resume"], None),
            *(part(number) for number in range(parts)),
            ("merge", ["merge", "job", "-o", "out.lodpack", "--force"], "out.lodpack"),
        ]

    def staged_steps(self, mesh, parts, kind):
        """A job in stages, or a build with workers."""
        if kind < 0.1:
            words = ["build", mesh, *self.model, "--workers", 2, "-o", "out.lodpack", "--resume"]
            return [("build with workers", words, "out.lodpack")]
        begin = ["plan", mesh, *self.model, "-o", "job", "--parts", parts, "--stages", "--range-bytes", "1MB", "--resume"]
        return [
            ("begin", begin, None),
            *((stage, ["work", "job", "--stage", stage, *self.memory, "--threads", 1], None) for stage in STAGES),
            ("merge", ["merge", "job", "-o", "out.lodpack", "--force"], "out.lodpack"),
        ]

    def reference(self):
        with tempfile.TemporaryDirectory() as folder:
            done = self.run(["build", self.options.mesh, *self.model, "-o", "out.lodpack"], folder)
            if done.returncode != 0:
                sys.exit(done.stderr)
            started = time.monotonic()
            self.run(["build", self.options.mesh, *self.model, *self.memory, "-o", "again.lodpack"], folder)
            self.seconds = time.monotonic() - started
            self.expected = (pathlib.Path(folder) / "out.lodpack").read_bytes()

    def round(self, kills_left):
        """Makes one file from start to end. Returns the number of kills that took effect."""
        kills = 0
        with tempfile.TemporaryDirectory() as folder:
            for name, words, product in self.steps():
                path = product and pathlib.Path(folder) / product
                share = SHARES[name]
                # A process killed again and again in its first moments makes no progress, so the fourth try is not
                # killed.
                for attempt in range(4):
                    kill = kills < kills_left and attempt < 3 and self.random.random() < 0.6
                    seconds = self.random.random() * self.seconds * share if kill else 3600
                    if not self.kill(words, folder, seconds):
                        break
                    kills += 1
                    self.counts[name] += 1
                    if path and path.exists() and name != "part" and path.read_bytes() != self.expected:
                        self.fault(f"{product} exists after a kill and is wrong")
                if path and not path.exists():
                    self.fault(f"{product} is not there after {words}")
            if (pathlib.Path(folder) / "out.lodpack").read_bytes() != self.expected:
                self.fault("the result differs")
            left = [entry.name for entry in pathlib.Path(folder).iterdir() if entry.name not in ("out.lodpack", "job")]
            if left:
                self.fault(f"left behind: {left}")
        return kills

    def full_disk(self):
        """Gives every command a disk that is too small before one that is large enough."""
        with tempfile.TemporaryDirectory() as folder:
            mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", folder]
            if subprocess.run(mount, capture_output=True).returncode != 0:
                print("full disks skipped: cannot mount a file system")
                return False
            try:
                for name, words, product in self.steps():
                    for size in [64, self.random.randrange(100, 8000), self.random.randrange(1000, 30000), 1 << 20]:
                        # No smaller than its content.
                        size = max(size, shutil.disk_usage(folder).used // 1024 + 16)
                        subprocess.run(["mount", "-o", f"remount,size={size}k", folder], check=True)
                        done = self.run(words, folder)
                        path = product and pathlib.Path(folder) / product
                        if done.returncode == 0:
                            break
                        self.counts["full disk"] += 1
                        if done.returncode != 2 or "panicked" in done.stderr or "No space left" not in done.stderr:
                            self.fault(f"{words} on a disk of {size} kB: status {done.returncode}, {done.stderr}")
                        if path and path.exists():
                            self.fault(f"{product} is there although the disk was full")
                if (pathlib.Path(folder) / "out.lodpack").read_bytes() != self.expected:
                    self.fault("the result differs after full disks")
            finally:
                subprocess.run(["umount", folder])
        return True

    def main(self):
        self.reference()
        kills, rounds = 0, 0
        while kills < self.options.kills:
            kills += self.round(self.options.kills - kills)
            rounds += 1
            print(f"round {rounds}: {kills} kills so far", flush=True)
        full = 0
        while full < self.options.full_disks and self.full_disk():
            full += 1
            print(f"full disk, round {full}", flush=True)
        killed = ", ".join(f"{count} {name}" for name, count in sorted(self.counts.items()))
        print(f"{rounds} files after {kills} kills, {full} on full disks ({killed}): {len(self.faults)} faults")
        return 1 if self.faults else 0


if __name__ == "__main__":
    sys.exit(Driver(arguments()).main())
