"""Programs that build a hierarchy of levels: lodpack itself, Nexus, clusterlod, deepmonkey-geometry."""
import os

from peer import nexus
from peer.run import Distance, Run, lodpack, program, python, read_ply

BUILD = ("cpu", "cpu_written", "memory")


def least(run, budget=20.0, most=3):
    """CPU seconds and memory, the best of three runs or of as many as take 20 CPU seconds; and the result of the last
    run."""
    cpu, memory, spent = [], [], 0.0
    while len(cpu) < most and spent < budget:
        last, seconds, peak = run()
        cpu.append(seconds)
        memory.append(peak)
        spent += seconds
    return min(cpu), min(memory), last


def measure_lodpack(result, mesh, work):
    """The default file, its finest level and its first picture, at the same path that bench.py uses."""
    out, level = os.path.join(work, result.mesh + ".lodpack"), os.path.join(work, "level.ply")

    def build():
        run = program("lodpack", "build", mesh, "-o", out, "--force", "--json", "--progress", "none")
        return run.json(), run.cpu, run.memory

    ours = result.ours
    ours.cpu, ours.memory, summary = least(build)
    lodpack("extract", out, "-o", level, "--force", "--json")
    distance = Distance(mesh, level)
    result.edge, ours.bytes = distance.edge, summary["bytes"]
    ours.triangles, ours.rms, ours.max = distance.triangles, distance.rms, distance.max
    info = lodpack("info", out, "--json")
    if not info["overview"]:
        # Coarser than any level: all roots at level 0.
        info = lodpack("extract", out, "--tolerance", "1e300", "-o", level, "--force", "--json")
    ours.first = info["requests"], info["bytes_read"]


def measure_clusterlod(result, mesh, work):
    """Runs in memory and writes nothing. Three of its levels are measured."""
    cpu, memory, _ = least(lambda: (lambda run: (run, run.cpu, run.memory))(program("clusterlod", mesh)))
    result.add("clusterlod", "", cpu=cpu, memory=memory, hierarchy=True)
    prefix = os.path.join(work, "clod")
    for percent in (50, 10, 2):
        nexus.fresh(f"{prefix}_{percent}.ply")
    program("clusterlod", mesh, prefix)
    for percent in (50, 10, 2):
        if os.path.exists(f"{prefix}_{percent}.ply"):
            result.add("clusterlod", f"level of {percent} %", cpu=cpu, distance=Distance(mesh, f"{prefix}_{percent}.ply"))


def measure_deepmonkey(result, command, source, work):
    """Reads only OBJ. Its finest level is the input, and it makes no levels between that and a few hundred
    triangles."""
    obj, out = os.path.join(work, "source.obj"), os.path.join(work, "peer.dgc")
    positions, triangles = read_ply(source)
    with open(obj, "w") as f:
        f.writelines("v %.9g %.9g %.9g\n" % tuple(p) for p in positions.tolist())
        f.writelines("f %d %d %d\n" % tuple(t) for t in (triangles + 1).tolist())

    def build():
        nexus.fresh(out)
        run = Run(command, "build", obj, out)
        return os.path.getsize(out), run.cpu, run.memory

    cpu, memory, size = least(build)
    result.add("deepmonkey", "", cpu=cpu, memory=memory, bytes=size, triangles=len(triangles), hierarchy=True, writes=True)
    os.remove(obj)


def measure_nexus(result, mesh, source, work, step_of):
    """The default pyramid; then positions as coarse as our error allows, and as many of its nodes as reach our
    errors."""
    idle = python(nexus.IDLE).memory
    cpu, memory, (size, seconds) = least(lambda: (lambda n: ((n[0], n[2]), n[2], n[1].memory))(nexus.nexus(mesh, work, keep=True)))
    nxs, nxz, cut = (os.path.join(work, name) for name in ("peer.nxs", "peer.nxz", "cut.ply"))
    raw, coded = nexus.Index(nxs), nexus.Index(nxz)
    nexus.truncated(source, cut, raw.default_step())
    result.add("Nexus", "", cpu=cpu, memory=max(memory - idle, 1), bytes=size, hierarchy=True, writes=True, pyramid=True,
               first=coded.first_picture(), distance=Distance(mesh, cut))
    for measure in ("rms", "max"):
        step = step_of(measure)
        coarse = os.path.join(work, "coarse.nxz")
        nexus.compress(nxs, coarse, step)
        index = nexus.Index(coarse)
        errors = sorted({float(error) for error in raw.nodes["error"][:raw.sink]}, reverse=True) + [-1.0]
        tried = {}

        low, high = -1, len(errors) - 1
        while high - low > 1:
            middle = (low + high) // 2
            tried[middle] = cut_row(result, mesh, raw, index, errors[middle], step, cut)
            if getattr(tried[middle], measure) <= getattr(result.ours, measure):
                high = middle
            else:
                low = middle
        if high not in tried:
            cut_row(result, mesh, raw, index, errors[high], step, cut)


def cut_row(result, mesh, raw, index, error, step, path):
    chosen = raw.selected(error)
    raw.write_cut(chosen, path)
    nexus.truncated(path, path, step)
    return result.add("Nexus cut", f"down to error {error:.3g} step {step:.3g}", bytes=index.bytes_of(chosen),
                      pyramid=bool(chosen.sum() > 1), first=index.first_picture(), distance=Distance(mesh, path))
