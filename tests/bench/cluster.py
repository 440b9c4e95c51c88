#!/usr/bin/env python3
"""Simulates a job in stages on a cluster, from the measured cost of its tasks.

usage: cluster.py measure JOB [-o COSTS.json]
       cluster.py run COSTS.json [--triangles N] [--workers N,N,...] [--parts N] [options of the cluster]
       cluster.py table COSTS.json
       cluster.py limits COSTS.json
       cluster.py check

`measure` reads the reports that `lodpack work` has left in a job's directory, after `lodpack merge`. `run` simulates
jobs of other sizes on any number of workers by discrete events: a task reads, computes and writes; all transfers share
the bandwidth of the disk evenly; a worker takes the next task that is free (of regions the longest), and a stage begins
when the one before it is done. `table` prints the Markdown table of tests/RESULTS.md, and `limits` the size of a job
and the bandwidth of the disk from which a number of workers is as many times faster as it should be. `check` runs the
simulator's own tests.

Costs grow in proportion to the input: ranges and regions keep their size, so there are more of them. Their CPU seconds
are drawn from the measured tasks, so the skew between regions stays. What one process does grows with the number of
ranges (`cut`), of regions (`match`, `seams`, `arrange`) or with the bytes of the file (`merge`). Smaller regions cost
more of their borders, which are not simulated."""
import argparse, heapq, json, math, os, random, statistics, struct, sys

# What a triangle of binary PLY takes: 13 bytes, and half a vertex of 12.
INPUT_BYTES = 19
# Bytes a second of files that are in memory.
MEMORY = 1e12
# Stages with a task for each range of the input, for each share of the regions, and for one process.
OF_RANGES, OF_REGIONS = ("scan", "count", "divide"), ("repair", "segment", "build", "encode")
ALONE = ("cut", "match", "seams", "arrange", "merge")
ORDER = ("scan", "count", "cut", "divide", "repair", "match", "segment", "seams", "build", "arrange", "encode", "merge")
# Parts for each task of `encode`, and the most tasks.
PARTS_PER_ENCODER, MAX_ENCODERS = 4, 500
# How often the tasks of `encode` read a part together: their clusters reach across borders of parts (202 reads of 64
# parts were counted).
ENCODER_READS = 3.2
# Bytes that a stage reads, as multiples of the input and of what an earlier stage has handed on. `repair` looks its
# vertices up in the input.
READS = {
    "scan": {"input": 1.0}, "count": {"input": 1.0}, "cut": {"count": 1.0}, "divide": {"input": 1.0},
    "repair": {"divide": 1.0, "input": 0.32}, "match": {"stats": 1.0}, "segment": {"repair": 1.0, "stats": 1.0},
    "seams": {"stats": 1.0, "match": 1.0}, "build": {"repair": 1.0, "segment": 1.0}, "arrange": {"heads": 1.0},
    "encode": {"build": ENCODER_READS, "arrange": 1.0}, "merge": {"encode": 1.0},
}
# Small files of every range that a task reads, and of every region that it reads or writes.
FILES_OF_RANGES = {"count": 1, "cut": 2, "repair": 1}
FILES_OF_REGIONS = {"match": 1, "seams": 3, "arrange": 1, "merge": 1 / PARTS_PER_ENCODER}


def measure(job):
    """The costs of a job that is done: for each stage CPU seconds and bytes written, by task and for one triangle."""
    manifest = json.load(open(os.path.join(job, "job.json")))
    triangles = sum(part["triangles"] for part in manifest["parts"])
    regions = sum(part["regions"] for part in manifest["parts"])
    stages = {}
    for folder, prefix in (("stages", ""), ("parts", "part-")):
        for name in os.listdir(os.path.join(job, folder)):
            if not name.endswith(".json") or not name.startswith(prefix):
                continue
            report = json.load(open(os.path.join(job, folder, name)))
            stage = "build" if folder == "parts" else name.rsplit("-", 1)[0]
            stages.setdefault(stage, []).append([report["cpu_seconds"], report["bytes"], report["peak_memory_bytes"]])
    stats = sum(os.path.getsize(os.path.join(job, name)) for name in os.listdir(job) if name.endswith((".stats", ".known", ".seams")))
    return {
        "triangles": triangles,
        "regions": regions,
        "input_bytes": sum(file["bytes"] for file in manifest["inputs"]),
        "stats_bytes": stats,
        "heads_bytes": sum(heads(os.path.join(job, "parts", name)) for name in os.listdir(os.path.join(job, "parts")) if name.endswith(".lodpart")),
        "stages": {
            stage: {
                "cpu": sum(task[0] for task in tasks),
                "bytes": sum(task[1] for task in tasks),
                "memory": max(task[2] for task in tasks),
                # Tasks without a region cost nothing, and say nothing about skew.
                "skew": skew([task[0] for task in tasks if task[1] > 1000 or stage not in OF_REGIONS]),
            }
            for stage, tasks in stages.items()
        },
    }


def heads(part):
    """Bytes of a part that are read to arrange it: all but every third value of its regions, which are symbols."""
    with open(part, "rb") as file:
        size, at, number, read = os.path.getsize(part) - 8, file.seek(32), 0, 32
        while at < size:
            length = 8 + struct.unpack("<Q", file.read(8))[0]
            read += 8 if number > 0 and number % 3 == 0 else length
            at, number = file.seek(at + length), number + 1
    return read


def skew(times):
    """The times of tasks over their mean, sorted."""
    mean = statistics.fmean(times) if times else 0.0
    return sorted(time / mean for time in times) if mean > 0 else [1.0]


class Disk:
    """A disk whose bandwidth all transfers share evenly, up to what one machine can take. Transfers all progress at the
    same rate, so one ends when the service that each has had since the beginning reaches a number that is known when it
    begins."""

    def __init__(self, bandwidth, per_worker):
        self.bandwidth, self.per_worker = bandwidth, per_worker
        self.service, self.time, self.active = 0.0, 0.0, []

    def rate(self):
        return min(self.per_worker, self.bandwidth / len(self.active)) if self.active else 0.0

    def advance(self, time):
        self.service += (time - self.time) * self.rate()
        self.time = time

    def begin(self, time, size, what):
        self.advance(time)
        heapq.heappush(self.active, (self.service + size, what))

    def next_end(self):
        return self.time + max(0.0, self.active[0][0] - self.service) / self.rate() if self.active else math.inf

    def end(self, time):
        self.advance(time)
        return heapq.heappop(self.active)[1]


def run_stage(tasks, workers, cluster, start, dice):
    """Simulates the tasks of a stage, each (bytes read, seconds, bytes written), largest as they come. Returns when the
    last one ends."""
    disk, waiting, events, free = Disk(cluster.bandwidth, cluster.per_worker), list(range(len(tasks)))[::-1], [], workers
    disk.time, now, left, state, number = start, start, len(tasks), {}, 0
    while left:
        while free and waiting:
            task, free, number = waiting.pop(), free - 1, number + 1
            read, seconds, written = tasks[task]
            factor = cluster.straggler if dice.random() < cluster.straggling else 1.0
            lifetime = dice.expovariate(cluster.failures) if cluster.failures > 0 else math.inf
            # The task's phases, and the moment at which its worker would die.
            state[number] = [task, [("cpu", cluster.overhead), ("io", read), ("cpu", seconds * factor), ("io", written)], now + lifetime]
            heapq.heappush(events, (now, number))
        ending = disk.next_end()
        if events and events[0][0] <= ending:
            now, who = heapq.heappop(events)
        else:
            now, who = ending, disk.end(ending)
        task, phases, death = state[who]
        if now >= death:
            # Somebody else does the task from its beginning, and the worker is started again.
            waiting.append(task)
            del state[who]
            heapq.heappush(events, (now + cluster.latency, -1))
            state[-1] = [None, [], math.inf]
            continue
        while phases and phases[0][1] <= 0:
            phases.pop(0)
        if not phases:
            free += 1
            left -= task is not None
            if who >= 0:
                del state[who]
            continue
        kind, amount = phases.pop(0)
        if kind == "cpu":
            heapq.heappush(events, (now + amount, who))
        else:
            disk.begin(now, amount, who)
    return now


def stage_tasks(costs, stage, triangles, parts, workers, cluster, dice):
    """The tasks of a stage of a job, given its triangles."""
    measured, grow = costs["stages"].get(stage, {"cpu": 0.0, "bytes": 0, "skew": [1.0]}), triangles / costs["triangles"]
    known = {name: costs[f"{name}_bytes"] for name in ("input", "stats", "heads")}
    handed_on = lambda name: known[name] if name in known else costs["stages"].get(name, {}).get("bytes", 0)
    read = grow * sum(share * handed_on(name) for name, share in READS[stage].items())
    cpu, written = grow * measured["cpu"], grow * measured["bytes"]
    ranges = max(1, min(parts, math.ceil(grow * costs["input_bytes"] / cluster.range_bytes)))
    # Smaller regions than the measured ones, so more of them.
    regions = max(1, round(costs["regions"] * grow * cluster.finer))
    opens = cluster.open_seconds * (FILES_OF_RANGES.get(stage, 0) * ranges + FILES_OF_REGIONS.get(stage, 0) * regions)
    if stage == "cut":
        # Its counts are added and cut once, whatever the size of the input.
        cpu = measured["cpu"]
    if stage in ("match", "seams"):
        # Their work lies along the borders of regions, which halve when a side halves.
        cpu, read, written = (amount * math.sqrt(cluster.finer) for amount in (cpu, read, written))
    if stage in ALONE:
        return [(read, cpu + opens, written)]
    count = ranges if stage in OF_RANGES else min(parts, regions)
    if stage == "encode":
        count = math.ceil(count / max(PARTS_PER_ENCODER, math.ceil(count / MAX_ENCODERS)))
    if stage == "repair":
        # Each worker reads the lists of all ranges once.
        opens *= min(1.0, workers / count)
    skew = measured["skew"]
    # A job of the measured size has the measured tasks; a larger one has more of their kind.
    factors = dice.sample(skew, count) if count == len(skew) else dice.choices(skew, k=count)
    scale = 1.0 / sum(factors)
    tasks = [(read * f * scale, opens + cpu * f * scale, written * f * scale) for f in factors]
    return sorted(tasks, key=lambda task: -task[1]) if stage in ("repair", "segment", "build") else tasks


def simulate(costs, triangles, workers, parts, cluster, seed=1):
    """Elapsed seconds of each stage."""
    dice, now, took = random.Random(seed), 0.0, {}
    for stage in ORDER:
        start = now
        if stage not in costs["stages"]:
            continue
        now = run_stage(stage_tasks(costs, stage, triangles, parts, workers, cluster, dice), workers, cluster, now + cluster.latency, dice)
        took[stage] = now - start
    return took


class Cluster:
    def __init__(self, **changes):
        # Bytes a second of the shared disk and of one machine's connection to it.
        self.bandwidth, self.per_worker = 5e9, 1e9
        # Seconds from the end of a stage to the start of the next one, or to the restart of a worker (waiting workers
        # look again after a sixteenth of the time that they have waited); and of every task.
        self.latency, self.overhead = 0.1, 0.01
        # Deaths of a worker in a second; the share of tasks that straggle, and how much slower these are.
        self.failures, self.straggling, self.straggler = 0.0, 0.0, 3.0
        # Least bytes of a range, seconds to open a small file, and how many regions there are for each measured one.
        self.range_bytes, self.open_seconds, self.finer = 64 << 20, 2e-4, 1.0
        vars(self).update(changes)


def cluster_of(options):
    names = ("bandwidth", "per_worker", "latency", "failures", "straggling", "straggler", "open_seconds", "finer")
    return Cluster(**{name: getattr(options, name) for name in names if getattr(options, name) is not None})


def serial(costs):
    """The share of the CPU seconds that one process spends alone."""
    total = sum(stage["cpu"] for stage in costs["stages"].values())
    return sum(costs["stages"].get(name, {"cpu": 0})["cpu"] for name in ALONE) / total


def one_worker(costs, triangles, cluster):
    """What one worker would need with a disk of its own and nothing to wait for."""
    alone = Cluster(**{**vars(cluster), "latency": 0.0, "failures": 0.0, "straggling": 0.0, "bandwidth": MEMORY, "per_worker": MEMORY})
    return sum(simulate(costs, triangles, 1, max(64, round(costs["regions"] * triangles / costs["triangles"])), alone).values())


def speedup(costs, triangles, workers, cluster):
    """Elapsed seconds of each stage, and how many times one worker's are theirs."""
    parts = max(4 * workers, round(costs["regions"] * triangles / costs["triangles"] * cluster.finer))
    took = simulate(costs, triangles, workers, parts, cluster)
    return took, one_worker(costs, triangles, cluster) / sum(took.values())


def table(costs):
    print("| triangles | workers | disk, GB/s | elapsed | times one worker | with 1 % stragglers | longest stages |\n|---:|---:|---:|---:|---:|---:|---|")
    for triangles in (1e9, 1e10, 1e11):
        for workers in (35, 1000):
            for bandwidth in (5e9, 50e9, 500e9):
                connection = max(1e9, min(10e9, bandwidth / workers))
                cluster = Cluster(bandwidth=bandwidth, per_worker=connection, failures=1 / 86400)
                took, times = speedup(costs, triangles, workers, cluster)
                cluster.straggling = 0.01
                straggling = speedup(costs, triangles, workers, cluster)[1]
                total, longest = sum(took.values()), sorted(took, key=took.get, reverse=True)[:3]
                words = ", ".join(f"{name} {100 * took[name] / total:.0f} %" for name in longest)
                print(f"| {triangles:.0e} | {workers} | {bandwidth / 1e9:.0f} | {total:.0f} s | {times:.1f} | {straggling:.1f} | {words} |".replace("e+", "e"))


def limits(costs):
    print("| triangles | workers | aim | with a disk without limits | of that one process alone | aim reached from |\n|---:|---:|---:|---:|---:|---:|")
    for workers, aim in ((35, 31), (1000, 300)):
        for triangles in (3e8, 1e9, 3e9, 1e10, 3e10):
            reached = lambda bandwidth: speedup(costs, triangles, workers, Cluster(bandwidth=bandwidth, per_worker=max(1e9, bandwidth / workers)))
            took, best = reached(MEMORY)
            alone = sum(took.get(name, 0.0) for name in ALONE)
            low, high = 1e8, MEMORY
            while best >= aim and high / low > 1.05:
                middle = math.sqrt(low * high)
                low, high = (low, middle) if reached(middle)[1] >= aim else (middle, high)
            words = f"{high / 1e9:.0f} GB/s" if best >= aim else "never"
            print(f"| {triangles:.0e} | {workers} | {aim} | {best:.1f} | {alone:.1f} of {sum(took.values()):.1f} s | {words} |".replace("e+", "e"))


def check():
    cluster = Cluster(latency=0.0, overhead=0.0, bandwidth=100.0, per_worker=100.0)
    dice = random.Random(1)
    near = lambda a, b: math.isclose(a, b, rel_tol=1e-9)
    # Three tasks of a second on two workers.
    assert near(run_stage([(0, 1, 0)] * 3, 2, cluster, 5.0, dice), 7.0)
    # Two transfers share a disk that one has for itself afterwards.
    assert near(run_stage([(100, 0, 0), (200, 0, 0)], 2, cluster, 0.0, dice), 3.0)
    # A machine's own connection limits it.
    slow = Cluster(latency=0.0, overhead=0.0, bandwidth=100.0, per_worker=10.0)
    assert near(run_stage([(100, 1, 50)], 4, slow, 0.0, dice), 16.0)
    # Deaths cost time but lose nothing.
    dying = Cluster(latency=0.0, overhead=0.0, bandwidth=1e9, failures=0.2)
    assert run_stage([(0, 1, 0)] * 40, 4, dying, 0.0, dice) > 10.0
    stage = lambda cpu, size: {"cpu": cpu, "bytes": size, "memory": 0, "skew": [0.5, 1.0, 1.5]}
    costs = {"triangles": 10**7, "regions": 8, "input_bytes": 19 * 10**7, "stats_bytes": 10**6, "heads_bytes": 10**5,
             "stages": {name: stage(0.01 if name in ALONE else 3.0, 10**7) for name in ORDER}}
    # More workers are never slower, and never faster than their number allows.
    cluster = Cluster(bandwidth=MEMORY, per_worker=MEMORY, latency=0.0)
    totals = [sum(simulate(costs, 1e9, workers, 4000, cluster).values()) for workers in (1, 2, 10, 100)]
    assert all(later < earlier for earlier, later in zip(totals, totals[1:])), totals
    assert totals[0] / totals[2] < 10.01
    # A disk that is too slow limits everything.
    slow = Cluster(bandwidth=1e8, latency=0.0)
    assert sum(simulate(costs, 1e9, 1000, 4000, slow).values()) > costs["input_bytes"] * 100 / 1e8
    print("the simulator keeps its promises")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    measuring = commands.add_parser("measure")
    measuring.add_argument("job")
    measuring.add_argument("--merge-cpu", type=float, default=0.1, help="CPU seconds that the merge took")
    measuring.add_argument("-o", "--output")
    running = commands.add_parser("run")
    running.add_argument("costs")
    running.add_argument("--triangles", type=float)
    running.add_argument("--workers", default="1,2,35,1000")
    running.add_argument("--parts", type=int)
    for name in ("bandwidth", "per_worker", "latency", "failures", "straggling", "straggler", "open_seconds", "finer"):
        running.add_argument("--" + name.replace("_", "-"), type=float)
    commands.add_parser("table").add_argument("costs")
    commands.add_parser("limits").add_argument("costs")
    commands.add_parser("check")
    options = parser.parse_args()
    if options.command == "check":
        return check()
    if options.command == "measure":
        costs = measure(options.job)
        size = costs["stages"]["encode"]["bytes"]
        costs["stages"]["merge"] = {"cpu": options.merge_cpu, "bytes": size, "memory": 0, "skew": [1.0]}
        text = json.dumps(costs, indent=1)
        print(text) if options.output is None else open(options.output, "w").write(text)
        return print(f"serial share {100 * serial(costs):.2f} %", file=sys.stderr)
    costs = json.load(open(options.costs))
    if options.command in ("table", "limits"):
        return table(costs) if options.command == "table" else limits(costs)
    cluster, triangles = cluster_of(options), options.triangles or costs["triangles"]
    for workers in map(int, options.workers.split(",")):
        parts = options.parts or max(4 * workers, round(costs["regions"] * triangles / costs["triangles"]))
        took = simulate(costs, triangles, workers, parts, cluster)
        print(f"{workers} workers: {sum(took.values()):.1f} s;", ", ".join(f"{name} {seconds:.2f}" for name, seconds in took.items()))


if __name__ == "__main__":
    main()
