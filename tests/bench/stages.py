#!/usr/bin/env python3
"""Measures a job in stages beside one build: what each stage takes, what one process does alone, and how two workers
compare with one.

usage: stages.py MESH [--parts 16] [--range-bytes 64MiB] [--memory 512MiB] [--runs 3] [--work DIR] [--lodpack PATH]
                 [--costs COSTS.json] [--known COSTS.json]

Every task is a process of its own with one thread, as on a cluster, so its CPU seconds hold its start, too. Then one
and two workers do the whole job, `--runs` times each. Others may load the machine, so the time for which workers had no
processor is taken off (Linux tells it), and the least of the runs counts. All files must have the same bytes.
`--costs` writes what tests/bench/cluster.py simulates from. Python's standard library is enough."""
import argparse, filecmp, json, math, os, pathlib, shutil, statistics, subprocess, sys, tempfile, threading, time

import cluster

PROGRAM = pathlib.Path(__file__).resolve().parents[2] / "target/release/lodpack"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh")
    parser.add_argument("--parts", type=int, default=16)
    parser.add_argument("--range-bytes", default="64MiB")
    parser.add_argument("--memory", default="512MiB")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--work")
    parser.add_argument("--lodpack", default=PROGRAM)
    parser.add_argument("--costs")
    parser.add_argument("--known", help="costs of an earlier measurement: only workers are compared")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.work) as folder:
        Measurement(options, folder).run()


class Measurement:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.job, self.out, self.whole = (os.path.join(folder, name) for name in ("job", "out.lodpack", "whole.lodpack"))

    def start(self, *words):
        words = [self.options.lodpack, *map(str, words), "--progress", "none"]
        return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def end(self, process):
        """CPU seconds and most bytes of memory of a process that has been started."""
        message = process.stderr.read().decode()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            sys.exit(f"{process.args}: {message}")
        return used.ru_utime + used.ru_stime, 1024 * used.ru_maxrss

    def does(self, *words):
        return self.end(self.start(*words))

    def begin(self):
        shutil.rmtree(self.job, ignore_errors=True)
        options = self.options
        return self.does("plan", options.mesh, "-o", self.job, "--parts", options.parts, "--stages", "--range-bytes", options.range_bytes)

    def work(self, *words):
        return "work", self.job, "--threads", 1, "--memory", self.options.memory, *words

    def merge(self):
        merged = self.does("merge", self.job, "-o", self.out, "--force")
        if not filecmp.cmp(self.whole, self.out, shallow=False):
            sys.exit("the job gives other bytes than one build")
        return merged

    def run(self):
        if self.options.known:
            self.does("build", self.options.mesh, "-o", self.whole)
            return self.compare(json.load(open(self.options.known)), self.walls())
        one, rows = math.inf, []
        # In turn, so that a load that comes and goes meets both.
        for _ in range(self.options.runs):
            words = "--force", "--threads", 1, "--memory", self.options.memory
            one = min(one, self.does("build", self.options.mesh, "-o", self.whole, *words)[0])
            run = self.stages()
            rows = [min(both, key=lambda row: sum(row[1])) for both in zip(rows or run, run)]
        costs = self.table(rows, one)
        if self.options.costs:
            json.dump(costs, open(self.options.costs, "w"), indent=1)
        self.compare(costs, self.walls())

    def stages(self):
        """Does all tasks one after the other. Returns for each step its CPU seconds by task, and the most memory."""
        begun, memory = self.begin()
        rows = [("begin", (begun,), memory)]
        for stage, count in self.counts().items():
            times, memory = zip(*(self.does(*self.work("--stage", stage, "--task", task)) for task in range(count)))
            rows.append((stage, times, max(memory)))
        merged, memory = self.merge()
        return [*rows, ("merge", (merged,), memory)]

    def table(self, rows, one):
        """Prints what each stage took, and returns the costs that the simulator wants."""
        costs = cluster.measure(self.job)
        total = sum(sum(times) for _, times, _ in rows)
        print(f"\n{costs['triangles']:,} triangles in {costs['regions']} regions; one build {one:.1f} CPU s, the job {total:.1f} ({total / one:.2f} times)\n")
        print("| stage | tasks | CPU s | share | longest task | handed on | most memory |\n|---|---:|---:|---:|---:|---:|---:|")
        for stage, times, memory in rows:
            size = {"begin": 0, "merge": os.path.getsize(self.out)}.get(stage) or costs["stages"].get(stage, {"bytes": 0})["bytes"]
            print(f"| {stage} | {len(times)} | {sum(times):.2f} | {100 * sum(times) / total:.1f} % | {max(times):.2f} | {size / 1e6:.1f} MB | {memory / 2**20:.0f} MiB |")
            # Processes as a whole say more than their own reports. Those without a region say nothing of the others.
            times = [seconds for seconds in times if seconds > 0.03] or times
            costs["stages"][stage] = {"cpu": sum(times), "bytes": size, "memory": memory, "skew": cluster.skew(times)}
        alone = sum(sum(times) for stage, times, _ in rows if stage in ("begin", "import", *cluster.ALONE))
        print(f"\nalone: {alone:.2f} CPU s, {100 * alone / total:.2f} %", flush=True)
        return costs

    def counts(self):
        done = subprocess.run([self.options.lodpack, "status", self.job, "--json"], capture_output=True, text=True)
        return {stage["stage"]: stage["tasks"] for stage in json.loads(done.stdout)["stages"]}

    def walls(self):
        walls = {workers: [] for workers in (1, 2)}
        for _ in range(self.options.runs):
            for workers, runs in walls.items():
                runs.append(self.elapsed(workers))
        return walls

    def elapsed(self, workers):
        self.begin()
        start = time.monotonic()
        waiting = [self.start(*self.work()) for _ in range(workers)]
        delays = [threading.Thread(target=self.watch, args=(process,)) for process in waiting]
        for thread in delays:
            thread.start()
        cpu = sum(self.end(process)[0] for process in waiting)
        wall = time.monotonic() - start
        for thread in delays:
            thread.join()
        self.merge()
        return wall - statistics.fmean(process.delay for process in waiting), wall, cpu

    def watch(self, process):
        """Notes for how long a process could have run but had no processor, because others load the machine."""
        process.delay = 0.0
        while process.returncode is None:
            try:
                tasks = list(pathlib.Path(f"/proc/{process.pid}/task").iterdir())
                now = sum(int((task / "schedstat").read_text().split()[1]) for task in tasks) / 1e9
                process.delay = max(process.delay, now)
            except (OSError, IndexError):
                pass
            time.sleep(0.05)

    def compare(self, costs, walls):
        """Measured times beside simulated ones. Beginning and merge are in neither."""
        local = cluster.Cluster(bandwidth=cluster.MEMORY, per_worker=cluster.MEMORY, latency=0.02)
        spent = sum(stage["cpu"] for name, stage in costs["stages"].items() if name not in ("begin", "merge"))
        head = ["workers", "elapsed s", "without waiting for a processor", "CPU s", "simulated", "simulated, at the CPU s of this run"]
        print("\n| " + " | ".join(head) + " |\n|" + "---:|" * len(head))
        for workers, runs in walls.items():
            alone, wall, cpu = min(runs)
            took = cluster.simulate(costs, costs["triangles"], workers, self.options.parts, local)
            simulated = sum(seconds for stage, seconds in took.items() if stage != "merge")
            beside = lambda seconds: f"{seconds:.1f} ({100 * (seconds / alone - 1):+.0f} %)"
            print(f"| {workers} | {wall:.1f} | {alone:.1f} | {cpu:.1f} | {beside(simulated)} | {beside(simulated * cpu / spent)} |")


if __name__ == "__main__":
    main()
