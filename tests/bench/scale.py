#!/usr/bin/env python3
"""Measures how builds scale with the input at fixed memory, and with the number of parts. Prints Markdown tables.

usage: scale.py [--memory 512MiB] [--work DIR] [--nexus] [--parts N,N,...] [--no-growth] MESH...
       scale.py [--memory 512MiB] [--work DIR] --add MORE --tolerance T MESH

MESH is a file, or sphere:N for a generated mesh of 12 N^2 triangles (sphere:289 1 M, sphere:817 8 M, sphere:1634 32 M,
sphere:3266 128 M). Needs the release binaries (cargo build --release --workspace); --nexus needs the requirements of
bench.py.

First table: each mesh built with that memory, also by Nexus if asked for. Second table: each mesh planned, built part
by part in sequence, and merged; the total cost compared with a single build, and the speed of the merge compared with
copying the file to the same disk. Then a model fitted to the second table estimates the time of a billion triangles on
several workers, and what would limit them.

With --add there is one table: a job of MESH to which MORE is added, compared with a job of both at once, which must
give the same bytes."""
import argparse, filecmp, os, shutil, sys, tempfile, time

import bench


def lodpack(*args):
    return bench.program("lodpack", *args)


def given(mesh, work):
    """The file of a mesh, generated in single precision if necessary."""
    kind, _, n = mesh.partition(":")
    if not n or os.path.exists(mesh):
        return mesh
    path = os.path.join(work, f"{kind}{n}.ply")
    bench.program("generate", kind, n, path, "--single")
    return path


def megabytes(memory):
    number = float(memory.rstrip("GMiB"))
    return int(number * (1024 if "G" in memory else 1))


def growth(args, meshes):
    rows, first = [], None
    for name, path in meshes:
        out = os.path.join(args.work, name + ".lodpack")
        run = lodpack("build", path, "-o", out, "--force", "--memory", args.memory, "--progress", "none", "--json")
        s = run.json()
        per = run.cpu / s["triangles"]
        # Extrapolated linearly from the mesh of about 8 million triangles, or from the largest smaller one.
        if first is None or s["triangles"] < 9e6:
            first = per
        rows.append([name, f"{s['triangles']:,}", f"{run.cpu:.1f}", f"{run.wall:.1f}", f"{s['triangles'] / run.cpu / 1e3:,.0f} k",
                     f"{per / first:.2f}", f"{run.memory / 2**20:.0f} MiB", f"{s['temporary_bytes'] / 1e9:.2f} GB", f"{s['bytes']:,}"])
        if args.nexus:
            try:
                size, run, cpu, wall = bench.nexus(path, args.work, ram=megabytes(args.memory))
                rows.append([name + ", Nexus", f"{s['triangles']:,}", f"{cpu:.1f}", f"{wall:.1f}",
                             f"{s['triangles'] / cpu / 1e3:,.0f} k", "", f"{run.memory / 2**20:.0f} MiB", "", f"{size:,}"])
            except Exception as error:
                rows.append([name + ", Nexus", f"failed: {error}"] + [""] * 7)
    bench.table(f"Growth at --memory {args.memory}",
                ["mesh", "triangles", "CPU s", "elapsed s", "triangles per CPU s", "times linear", "peak memory", "temporary files", "bytes"],
                rows)


def copied(path, target):
    """Seconds for a copy that has reached the disk, the best of five."""
    best = float("inf")
    for _ in range(5):
        start = time.time()
        shutil.copyfile(path, target)
        with open(target, "rb") as file:
            os.fsync(file.fileno())
        best = min(best, time.time() - start)
    return best


def in_parts(args, meshes):
    rows, facts = [], []
    for name, path in meshes:
        whole = os.path.join(args.work, name + ".lodpack")
        single = lodpack("build", path, "-o", whole, "--force", "--memory", args.memory, "--progress", "none", "--json")
        size, triangles = os.path.getsize(whole), single.json()["triangles"]
        for wanted in args.parts:
            job, out = os.path.join(args.work, "job"), os.path.join(args.work, "merged.lodpack")
            shutil.rmtree(job, ignore_errors=True)
            plan = lodpack("plan", path, "-o", job, "--parts", str(wanted), "--memory", args.memory, "--progress", "none", "--json")
            used = [k for k, part in enumerate(plan.json()["parts"]) if part["regions"]]
            if len(used) < wanted and wanted != args.parts[0]:
                print(f"{name}: only {len(used)} of {wanted} parts have any work", file=sys.stderr)
            parts = [lodpack("build", "--job", job, "--part", str(k), "--progress", "none", "--json") for k in range(wanted)]
            merges = [lodpack("merge", job, "-o", out, "--force", "--progress", "none", "--json") for _ in range(3)]
            if not filecmp.cmp(whole, out, shallow=False):
                sys.exit(f"{name}: {wanted} parts give different bytes")
            merge = min(merges, key=lambda run: run.wall)
            copy = copied(out, out + ".copy")
            cpu = plan.cpu + sum(part.cpu for part in parts) + merge.cpu
            rows.append([name, wanted, f"{single.cpu:.1f}", f"{plan.cpu:.1f}", f"{sum(part.cpu for part in parts):.1f}",
                         f"{merge.cpu:.2f}", f"{cpu / single.cpu:.2f}", f"{max(part.memory for part in parts) / 2**20:.0f} MiB",
                         f"{merge.memory / 2**20:.0f} MiB", f"{size / merge.wall / 1e6:.1f} MB/s", f"{size / copy / 1e6:.0f} MB/s"])
            facts.append((triangles, plan.cpu, plan.wall, sum(part.cpu for part in parts), merge.wall, len(used)))
            shutil.rmtree(job, ignore_errors=True)
    bench.table("In parts, one after the other",
                ["mesh", "parts", "one build, CPU s", "plan", "all parts", "merge", "sum over one build", "most memory of a part",
                 "memory of the merge", "merged", "copied to disk"], rows)
    model(facts)


def job_of(args, path, command, *words):
    """Plans a job with `command`, builds its parts and merges them. Returns the seconds of each step, the output of the
    plan, and the memory of the largest step."""
    plan = lodpack(command, *words, "-o", path, "--memory", args.memory, "--progress", "none", "--json")
    said = plan.json()
    count = len((said["manifest"] if "manifest" in said else said)["parts"])
    parts = lodpack("build", "--job", path, "--part", f"0-{count - 1}", "--progress", "none", "--json")
    merge = lodpack("merge", path, "-o", path + ".lodpack", "--progress", "none", "--json")
    return [run.cpu for run in (plan, parts, merge)], said, max(run.memory for run in (plan, parts, merge))


def adding(args, mesh):
    first, later, fresh = (os.path.join(args.work, name) for name in ("first", "later", "fresh"))
    options = ["--extensible", "--tolerance", args.tolerance]
    begun = job_of(args, first, "plan", mesh, *options)
    added = job_of(args, later, "add", first, args.add)
    at_once = job_of(args, fresh, "plan", mesh, args.add, *options)
    if not filecmp.cmp(later + ".lodpack", fresh + ".lodpack", shallow=False):
        sys.exit("the file that was added to differs from the file built at once")
    whole = os.path.join(args.work, "whole.lodpack")
    lodpack("build", mesh, args.add, "-o", whole, "--tolerance", args.tolerance, "--memory", args.memory, "--progress", "none", "--json")
    row = lambda what, seconds, memory, regions: [what, regions] + [f"{s:.1f}" for s in seconds] + [
        f"{sum(seconds):.1f}", f"{sum(seconds) / sum(at_once[0]):.2f}", f"{memory / 2**20:.0f} MiB"]
    said = added[1]
    bench.table("Adding to a job", ["", "regions", "plan, CPU s", "parts", "merge", "sum", "over both at once", "most memory"], [
        row("the first alone", begun[0], begun[2], len(begun[1]["parts"])),
        row("the second added to it", added[0], added[2], f"{said['regions']}, {said['taken_over']} of them taken over"),
        row("both at once", at_once[0], at_once[2], said["regions"])])
    size, balanced = os.path.getsize(fresh + ".lodpack"), os.path.getsize(whole)
    print(f"\n{size:,} bytes, {size / balanced - 1:+.2%} compared with a build that is not extensible ({balanced:,})")


def model(facts):
    """Seconds for a billion triangles, extrapolated from the largest measured mesh: all costs are linear in the
    triangles."""
    triangles, _, plan_wall, parts_cpu, merge_wall, _ = max(facts)
    billion = 1e9 / triangles
    rows = []
    for workers in (1, 35, 1000):
        # A region of two million triangles is the smallest unit of work, and a worker is one core.
        regions = 1e9 / 2**21 * 1.3
        rounds = -(-regions // workers)
        parts = parts_cpu * billion * rounds / regions
        total = plan_wall * billion + parts + merge_wall * billion
        share = max((plan_wall * billion, "plan"), (parts, "parts"), (merge_wall * billion, "merge"))
        rows.append([workers, f"{plan_wall * billion / 60:.1f}", f"{parts / 60:.1f}", f"{merge_wall * billion / 60:.1f}",
                     f"{total / 60:.1f}", f"{share[1]} ({share[0] / total:.0%})"])
    bench.table("A billion triangles, on paper: minutes, from the largest mesh above",
                ["workers (cores)", "plan (one machine)", "parts", "merge", "together", "limited first by"], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+")
    parser.add_argument("--memory", default="512MiB")
    parser.add_argument("--work")
    parser.add_argument("--nexus", action="store_true")
    parser.add_argument("--parts", type=lambda text: [int(n) for n in text.split(",")], default=[])
    parser.add_argument("--no-growth", action="store_true")
    parser.add_argument("--add", metavar="MORE")
    parser.add_argument("--tolerance", help="with --add, in the unit of the meshes")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.work) as work:
        args.work = work
        meshes = [(bench.name_of(mesh), given(mesh, work)) for mesh in args.meshes]
        if args.add:
            return adding(args, meshes[0][1])
        if not args.no_growth:
            growth(args, meshes)
        if args.parts:
            in_parts(args, meshes)


if __name__ == "__main__":
    main()
