#!/usr/bin/env python3
"""Interrupts every kind of job, and checks what is left: python tests/bench/interrupted.py FOLDER [options]

FOLDER holds inputs: mesh.ply and more.ply (two meshes), textured (a folder of meshes with images, `generate city`),
plant.glb (objects, `generate plant`), heights.asc (a raster), file.lodpack (for tilesets). Jobs are builds that can be
resumed, plans with parts and merges, stages, `add`, files of heights, 3D Tiles and their archives. Each step of a job
runs

* killed (SIGKILL) at random moments, --kills of them in all;
* with files that may not grow beyond a random size, as on a disk that is full, --full times in all;
* and --pairs times two builds write to one name at the same moment.

After each kill or error, a file with a final name must be the right one; a step that failed must say why and have the
exit status 2, must not panic, and must succeed when it is repeated; in the end all bytes must be those of a job that
nobody interrupted, and nothing else may be left. Prints a line per job and a summary; exits with 1 if anything was
wrong.
"""

import argparse
import collections
import pathlib
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
STAGES = "import scan count cut divide repair match segment seams build arrange encode".split()


def step(words, product=None):
    """A command, and the file or folder that it makes, if it makes one with a final name."""
    return [str(word) for word in words], product


def jobs(inputs):
    """The steps of each kind of job, all of which can be repeated."""
    mesh, more, textured = inputs / "mesh.ply", inputs / "more.ply", inputs / "textured"
    plant = inputs / "plant.glb"
    heights, file = inputs / "heights.asc", inputs / "file.lodpack"
    merge = step(["merge", "job", "-o", "out.lodpack", "--force"], "out.lodpack")

    def parts(job, count):
        return [step(["build", "--job", job, "--part", k]) for k in range(count)]

    def planned(path, count, *options):
        return [step(["plan", path, "-o", "job", "--parts", count, "--resume", *options]), *parts("job", count), merge]

    def staged(path, *options):
        begin = step(["plan", path, "-o", "job", "--parts", 3, "--stages", "--range-bytes", "1MB", "--resume", *options])
        return [begin, *(step(["work", "job", "--stage", stage]) for stage in STAGES), merge]

    small = ["--region-triangles", 8000]
    # Regions of jobs to which more is added are cut by position.
    later = ["--extensible", "--tolerance", "0.5", "--region-triangles", 20000]
    add = step(["add", "job", more, "-o", "second", "--parts", 2, "--resume"])
    joined = step(["merge", "second", "-o", "out.lodpack", "--force"], "out.lodpack")
    return {
        "resumed": [step(["build", mesh, *small, "-o", "out.lodpack", "--resume"], "out.lodpack")],
        "textured, resumed": [step(["build", textured, *small, "-o", "out.lodpack", "--resume"], "out.lodpack")],
        "textured parts": planned(textured, 3, *small),
        "textured stages": staged(textured, *small),
        "stages": staged(mesh, *small),
        "objects, resumed": [step(["build", plant, *small, "-o", "out.lodpack", "--resume"], "out.lodpack")],
        "parts of objects": planned(plant, 3, *small),
        "stages of objects": staged(plant, *small),
        "add": [*planned(mesh, 2, *later)[:-1], add, *parts("second", 2), joined],
        "heights": [step(["build", heights, "-o", "out.lodpack", "--force"], "out.lodpack")],
        "parts of heights": planned(heights, 3),
        "tileset": [step(["export", file, "--as", "3dtiles", "-o", "tiles"], "tiles")],
        "archive": [step(["export", file, "--as", "3dtiles", "-o", "out.3tz", "--force"], "out.3tz")],
    }


def content(path):
    """The bytes of a file, or of all files of a folder by name; none if there is nothing."""
    if path.is_dir():
        return {str(entry.relative_to(path)): entry.read_bytes() for entry in sorted(path.rglob("*")) if entry.is_file()}
    return path.read_bytes() if path.exists() else None


class Driver:
    def __init__(self, options):
        self.options, self.random = options, random.Random(options.seed)
        self.lodpack = str(options.lodpack.resolve())
        self.counts, self.faults = collections.Counter(), []
        self.expected, self.seconds, self.largest = {}, {}, {}

    def fault(self, what):
        self.faults.append(what)
        print("  WRONG:", what, flush=True)

    def run(self, words, folder, most=None):
        def limit():
            if most is not None:
                signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
                resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

        return subprocess.run([self.lodpack, *words], cwd=folder, capture_output=True, text=True, preexec_fn=limit)

    def reference(self, name, steps):
        with tempfile.TemporaryDirectory(dir=self.options.work) as folder:
            folder = pathlib.Path(folder)
            for number, (words, product) in enumerate(steps):
                began = time.monotonic()
                done = self.run(words, folder)
                self.seconds[name, number] = time.monotonic() - began
                if done.returncode:
                    sys.exit(f"{name}: {words}: {done.stderr}")
            self.expected[name] = content(folder / steps[-1][1])
            files = [entry for entry in folder.rglob("*") if entry.is_file()]
            self.largest[name] = max(entry.stat().st_size for entry in files)

    def interrupted(self, name, steps, way):
        """One job from start to end."""
        with tempfile.TemporaryDirectory(dir=self.options.work) as folder:
            folder = pathlib.Path(folder)
            for number, (words, product) in enumerate(steps):
                path = product and folder / product
                for attempt in range(4):
                    hit = attempt < 3 and self.random.random() < 0.7
                    if not (way(name, number, words, folder) if hit else self.plainly(name, words, folder)):
                        break
                    if path is not None and content(path) not in (None, self.expected[name]):
                        self.fault(f"{name}: {path.name} is wrong after an interrupted {words}")
                    if path is not None and path.is_dir():
                        # It was complete, and is not replaced without being asked to.
                        break
            if content(folder / steps[-1][1]) != self.expected[name]:
                self.fault(f"{name}: the result differs")
            made = {product for _, product in steps} | {"job", "second"}
            left = sorted(entry.name for entry in folder.iterdir() if entry.name not in made)
            if left:
                self.fault(f"{name}: left behind: {left}")

    def plainly(self, name, words, folder):
        done = self.run(words, folder)
        if done.returncode:
            self.fault(f"{name}: {words}: status {done.returncode}: {done.stderr.strip()}")
        return False

    def kill(self, name, number, words, folder):
        """Whether the step was killed."""
        process = subprocess.Popen([self.lodpack, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            process.wait(self.random.random() * 1.1 * self.seconds[name, number])
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            self.counts["kills"] += 1
            return True
        if process.returncode:
            self.fault(f"{name}: {words}: status {process.returncode}: {process.stderr.read().strip()}")
        return False

    def fill(self, name, number, words, folder):
        """Whether the step failed where no file may grow beyond a size."""
        most = int(self.largest[name] * self.random.random() ** 3)
        before = {entry.name for entry in folder.iterdir()}
        done = self.run(words, folder, most)
        if not done.returncode:
            return False
        self.counts["full disks"] += 1
        if done.returncode != 2 or "panicked" in done.stderr or "too large" not in done.stderr:
            self.fault(f"{name}: {words} with files of {most} bytes: status {done.returncode}: {done.stderr.strip()}")
        new = {entry.name for entry in folder.iterdir()} - before - {"job", "second"}
        # What can be resumed may stay.
        new = {entry for entry in new if not ("--resume" in words and entry.endswith(".building"))}
        if new:
            self.fault(f"{name}: {words} with files of {most} bytes left {sorted(new)}")
        return True

    def pair(self, inputs):
        """Two builds to one name."""
        with tempfile.TemporaryDirectory(dir=self.options.work) as folder:
            folder, names = pathlib.Path(folder), self.random.sample(["mesh.ply", "more.ply", "textured", "heights.asc"], 2)
            force = ["--force"] if self.random.random() < 0.5 else []
            started = []
            for name in names:
                words = [self.lodpack, "build", str(inputs / name), "-o", "out.lodpack", "--progress", "none", *force]
                started.append(subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True))
                time.sleep(self.random.random() * 0.1)
            said = [process.communicate()[1] for process in started]
            codes = [process.returncode for process in started]
            self.counts["pairs"] += 1
            found = content(folder / "out.lodpack")
            winners = [name for name, code in zip(names, codes) if code == 0]
            if not winners or found not in [self.alone[name] for name in winners]:
                self.fault(f"pair {names} {force}: status {codes}, and the file is of neither winner: {said}")
            if not force and len(winners) == 2:
                self.fault(f"pair {names}: both say that they wrote the file")
            for code, text in zip(codes, said):
                if code and (code != 2 or "panicked" in text or "out.lodpack" not in text):
                    self.fault(f"pair {names} {force}: status {code}: {text}")
            left = [entry.name for entry in folder.iterdir() if entry.name != "out.lodpack"]
            if left:
                self.fault(f"pair {names}: left behind: {left}")

    def main(self):
        options = self.options
        inputs = options.folder.resolve()
        all_jobs = jobs(inputs)
        if options.only:
            all_jobs = {name: steps for name, steps in all_jobs.items() if name in options.only.split(",")}
        for name, steps in all_jobs.items():
            self.reference(name, steps)
        for count, goal, way in (("kills", options.kills, self.kill), ("full disks", options.full, self.fill)):
            names, rounds = list(all_jobs), 0
            while self.counts[count] < goal and rounds < 20 * len(names):
                name = names[rounds % len(names)]
                before = self.counts[count]
                self.interrupted(name, all_jobs[name], way)
                rounds += 1
                print(f"{count} {self.counts[count]} (+{self.counts[count] - before}): {name}", flush=True)
        if options.pairs:
            self.alone = {}
            for name in ("mesh.ply", "more.ply", "textured", "heights.asc"):
                with tempfile.TemporaryDirectory(dir=options.work) as folder:
                    self.plainly(name, ["build", str(inputs / name), "-o", "out.lodpack"], folder)
                    self.alone[name] = content(pathlib.Path(folder) / "out.lodpack")
            for _ in range(options.pairs):
                self.pair(inputs)
        print(", ".join(f"{number} {what}" for what, number in self.counts.items()) + f": {len(self.faults)} faults")
        return 1 if self.faults else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--lodpack", type=pathlib.Path, default=ROOT / "target/release/lodpack")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--full", type=int, default=50)
    parser.add_argument("--pairs", type=int, default=50)
    parser.add_argument("--only", help="names of jobs, separated by commas")
    parser.add_argument("--work", help="where jobs lie")
    parser.add_argument("--seed", type=int, default=1)
    return Driver(parser.parse_args()).main()


if __name__ == "__main__":
    sys.exit(main())
