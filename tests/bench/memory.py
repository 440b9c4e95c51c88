#!/usr/bin/env python3
"""Measures whether --memory is kept: python tests/bench/memory.py [options] INPUT...

Each input is built with each limit. The peak of anonymous memory (RssAnon in /proc, sampled every few milliseconds) is
compared with the limit; pages of mapped files, which the system takes back when it needs them, do not count. Prints
Markdown: the peak in MiB and over the limit, or the least memory that a build which was refused before it began asks
for. Exits with 1 if a build took more than the limit and a twentieth, or ended in any other way. Linux only.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]


def anonymous(pid):
    """Bytes of anonymous memory of a process; 0 if it has ended."""
    try:
        for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("RssAnon:"):
                return int(line.split()[1]) << 10
    except OSError:
        pass
    return 0


def build(lodpack, path, limit, options):
    """The peak in bytes, the seconds, the exit status and the last line on stderr."""
    with tempfile.TemporaryDirectory(dir=options.work) as folder:
        words = [lodpack, "build", path, "-o", f"{folder}/out.lodpack", "--progress", "none", "--threads", options.threads]
        words += ["--memory", f"{limit}MiB"] if limit else []
        words += options.build.split()
        began = time.monotonic()
        process = subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        peak = 0
        while process.poll() is None:
            peak = max(peak, anonymous(process.pid))
            time.sleep(0.003)
        lines = process.stderr.read().strip().splitlines()
        return peak, time.monotonic() - began, process.returncode, lines[-1] if lines else ""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="+", type=pathlib.Path)
    parser.add_argument("--lodpack", type=pathlib.Path, default=ROOT / "target/release/lodpack")
    parser.add_argument("--limits", default="150,300,600", help="MiB")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--build", default="", help="further options of the builds, as one word")
    parser.add_argument("--work", help="where outputs and temporary files go")
    options = parser.parse_args()
    limits, failed = [int(limit) for limit in options.limits.split(",")], False
    print("| input | " + " | ".join(f"{limit} MiB" for limit in limits) + " |\n|---|" + "---|" * len(limits))
    for path in options.inputs:
        cells = []
        for limit in limits:
            peak, seconds, status, said = build(options.lodpack.resolve(), path, limit, options)
            over = peak / (limit << 20)
            if status == 0:
                cells.append(f"{peak / (1 << 20):.0f} MiB, {over:.2f} ({seconds:.0f} s)")
                failed |= over > 1.05
            elif "--memory" in said:
                cells.append("refused: " + said.split("needs")[-1].strip())
            else:
                cells.append(f"status {status}: {said}")
                failed = True
        print(f"| {path.name} | " + " | ".join(cells) + " |", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
