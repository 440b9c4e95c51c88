#!/usr/bin/env python3
"""Builds meshes with lodpack and its peers in one run, and prints Markdown tables.

usage: bench.py [--tables size,triangles,budgets,raw,floors,verify,speed,decode] [--work DIR] [--no-peers] MESH...

A MESH is a file, or part:N, sphere:N, pipes:N and so on for a generated one (part:48 is a CAD part with sharp creases).
Needs the release binaries (cargo build --release --workspace), and tests/bench/requirements.txt in the Python that runs
it.

Peers: Nexus (nxs_build + nxs_compress, from pymeshlab), Draco (DracoPy), simplification + Draco (pymeshlab's quadric
simplifier), meshoptimizer's simplifier, clusterlod. All distances come from the program `distance` (RMS at 300,000
points spread evenly over the area, maximum by branch and bound), in both directions, the larger of the two, in mean
edge lengths of the input. A peer that fails, or takes longer than an hour, gets a row that says so."""
import argparse, os, sys
import numpy as np

from peer.coders import decoders, draco
from peer.nexus import nexus
from peer.run import Distance, arrays, extent, given, lodpack, name_of, program, welded, write_ply
from peer.simplify import decimate, meshopt


def attempt(rows, label, make):
    """Adds what `make` returns as rows; a failure of a peer becomes a row too."""
    try:
        rows.extend(make())
    except Exception as error:
        rows.append(["", label, f"failed: {error}".replace("\n", " ").replace("|", "/")[:160]])


def table(title, head, rows):
    print(f"\n### {title}\n\n| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(str(c) for c in row + [""] * (len(head) - len(row))) + " |")
    sys.stdout.flush()


def default_file(mesh, work):
    out = os.path.join(work, name_of(mesh) + ".lodpack")
    return out, lodpack("build", mesh, "-o", out, "--force", "--json")


def size(args):
    """Bytes at an error no larger than that of lodpack's finest level, for RMS and for the maximum."""
    rows, all_rows = [], []
    for mesh in args.meshes:
        name, path = name_of(mesh), os.path.join(args.work, "level.ply")
        out, s = default_file(mesh, args.work)
        lodpack("extract", out, "-o", path, "--force", "--json")
        ours, edge = Distance(mesh, path), s["mean_edge_length"]
        vertices = s["input_vertices"]
        row = lambda what, size, d: [name, what, f"{size:,}", f"{size * 8 / vertices:.2f}", f"{d.rms:.4f}", f"{d.max:.3f}"]
        all_rows.append(row(f"lodpack, {len(s['levels'])} levels, {s['levels'][-1]['triangles']:,} triangles (certified "
                            f"{s['certified_error'] / edge:.3f})", s["bytes"], ours))
        found = {"Draco": [], "simplify + Draco": []}

        def one(kind, positions, triangles, share, bits):
            size = draco(positions, triangles, bits, path)
            d = Distance(mesh, path)
            found[kind].append((size, d))
            label = f"Draco {bits} bits" if share == 1 else f"simplify {share:.0%} + Draco {bits} bits"
            return row(f"{label}, one level", size, d)

        # Coarse first, and no finer than necessary to reach both of our errors.
        reached = lambda kind: any(d.rms <= ours.rms for _, d in found[kind]) and any(d.max <= ours.max for _, d in found[kind])
        nexus_bytes = "failed"
        if args.peers:
            try:
                nexus_bytes = f"{nexus(mesh, args.work)[0]:,}"
            except Exception as error:
                all_rows.append([name, "Nexus", f"failed: {error}"])
            meshes = welded(mesh)
            whole = arrays(meshes)
            for bits in range(8, 17):
                if not reached("Draco"):
                    attempt(all_rows, "Draco", lambda: [one("Draco", *whole, 1, bits)])
            large = len(whole[1]) > 3_000_000
            for share in (0.3, 0.15, 0.08) if large else (0.5, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05):
                try:
                    decimate(meshes, len(whole[1]) * share)
                except Exception as error:
                    all_rows.append([name, "simplify", f"failed: {error}"])
                    break
                coarse = arrays(meshes)
                finest = min(max((b for b in range(8, 17) if 2.0 ** -b * extent(whole[0]) > 0.02 * edge), default=8) + 1, 16)
                for bits in range(max(finest - 3, 8), finest + 1):
                    attempt(all_rows, "simplify + Draco", lambda: [one("simplify + Draco", *coarse, share, bits)])
        smallest = lambda kind, measure: min((size for size, d in found[kind] if getattr(d, measure) <= getattr(ours, measure)), default=None)
        times = lambda size: f"{size:,} ({size / s['bytes']:.1f}x)" if size else "not reached"
        rows.append([name, f"{ours.rms:.4f}", f"{ours.max:.3f}", f"{s['certified_error'] / edge:.3f}", f"{s['bytes']:,}", f"{s['bytes'] * 8 / vertices:.2f}"]
                    + [times(smallest(kind, measure)) for measure in ("rms", "max") for kind in found] + [nexus_bytes])
    table("Size: bytes at equal error (lodpack: all levels; Draco: one level; Nexus: whole pyramid down to the input, with normals)",
          ["mesh", "RMS", "max", "certified", "lodpack", "bits per vertex", "Draco, equal RMS", "simplify + Draco, equal RMS",
           "Draco, equal max", "simplify + Draco, equal max", "Nexus .nxz"], rows)
    table("Size: everything measured", ["mesh", "file", "bytes", "bits per vertex", "RMS", "max"], all_rows)


def triangles(args):
    """Error at equal numbers of triangles, with two rows for lodpack: a file whose finest level has about that many
    triangles (which shows the simplifier), and the cut of that many triangles from the default file (which a user of
    that file gets)."""
    rows = []
    for mesh in args.meshes:
        name, path = name_of(mesh), os.path.join(args.work, "level.ply")
        default, s = default_file(mesh, args.work)
        n, edge = s["triangles"], s["mean_edge_length"]
        prefix = os.path.join(args.work, "clod")
        attempt(rows, "clusterlod", lambda: program("clusterlod", mesh, prefix) and [])
        meshes = welded(mesh)
        whole = arrays(meshes)
        for percent in (50, 10, 2):
            entries = []
            entry = lambda what, certified=None: entries.append((what, Distance(mesh, path), certified))
            fine, certified = file_of(mesh, n * percent / 100, edge, args.work)
            lodpack("extract", fine, "-o", path, "--force", "--json")
            entry("lodpack, finest level", certified / edge)
            try:
                cut = lodpack("extract", default, "--raw", "--triangles", int(n * percent / 100), "-o", path, "--force", "--json")
                if cut["triangles"] > 0.8 * n * percent / 100:
                    entry("lodpack, cut of the default file", cut["certified_error"] / edge)
            except RuntimeError:
                pass  # fewer than the coarsest cut has
            # As many as lodpack's file actually has, which differs a little from the wanted number: errors depend on
            # it.
            count = entries[0][1].triangles
            write_ply(path, *meshopt(*whole, count / len(whole[1])))
            entry("meshopt")
            decimate(meshes, count)
            write_ply(path, *arrays(meshes))
            entry("quadric, optimal placement")
            path_before, path = path, f"{prefix}_{percent}.ply"
            if os.path.exists(path):
                entry("clusterlod level")
            path = path_before
            reference = next(d.rms for what, d, _ in entries if what == "meshopt")
            for what, d, certified in entries:
                rows.append([name, f"{percent} %", what, f"{d.triangles:,}", f"{d.rms:.4f}", f"{d.max:.3f}",
                             f"{certified:.3f}" if certified else "", f"{d.rms / reference:.2f}"])
    table("Error at equal triangles", ["mesh", "share", "program", "triangles", "RMS", "max (bound)", "certified", "RMS over meshopt"], rows)


def budgets(args):
    """What `extract --triangles` makes of the default file, beside simplifiers that have the whole input, at equal
    triangles."""
    rows = []
    for mesh in args.meshes:
        name, path = name_of(mesh), os.path.join(args.work, "budget.ply")
        default, s = default_file(mesh, args.work)
        n, edge = s["triangles"], s["mean_edge_length"]
        whole = arrays(welded(mesh))
        for share in (None, 2, 0.5, 0.2):
            wanted = s["levels"][-1]["triangles"] if share is None else int(n * share / 100)
            label = "finest level" if share is None else f"{share} %"
            try:
                cut = lodpack("extract", default, "--triangles", wanted, "-o", path, "--force", "--json")
            except RuntimeError as error:
                rows.append([name, label, f"{wanted:,}", f"failed: {error}".replace("\n", " ").replace("|", "/")[:120]])
                continue
            ours = Distance(mesh, path)
            row = [name, label, f"{ours.triangles:,}", cut["topology"], f"{ours.rms:.4f}", f"{ours.max:.2f}", f"{cut['certified_error'] / edge:.2f}"]
            peers = [("meshopt", lambda: write_ply(path, *meshopt(*whole, ours.triangles / len(whole[1]))))]
            if n <= 3_000_000:
                def optimal():
                    meshes = welded(mesh)
                    decimate(meshes, ours.triangles)
                    write_ply(path, *arrays(meshes))
                peers.append(("optimal", optimal))
            for _, make in peers:
                try:
                    make()
                    peer = Distance(mesh, path)
                    row += [f"{peer.triangles:,}", f"{ours.rms / peer.rms:.2f}", f"{ours.max / peer.max:.2f}"]
                except Exception as error:
                    row += [f"failed: {error}"[:60], "", ""]
            rows.append(row)
    head = ["mesh", "asked for", "triangles", "topology", "RMS", "largest (bound)", "certified"]
    for peer in ("meshoptimizer", "optimal placement"):
        head += [f"{peer}: triangles", "RMS, ours over theirs", "largest, ours over theirs"]
    table("Triangle budgets", head, rows)


def raw(args):
    """Cuts of the default file as a viewer's budget makes them (`extract --raw`), at twenty budgets from the finest
    level's own number down to a thousandth of it, beside meshoptimizer's simplifier, which has the whole input, at the
    number of triangles of the cut."""
    rows = []
    for mesh in args.meshes:
        name, path = name_of(mesh), os.path.join(args.work, "raw.ply")
        default, s = default_file(mesh, args.work)
        whole, finest = arrays(welded(mesh)), s["levels"][-1]["triangles"]
        ratios, before = [], None
        for step in range(20):
            wanted = int(finest * 10 ** (-3 * step / 19))
            try:
                lodpack("extract", default, "--raw", "--triangles", wanted, "-o", path, "--force", "--json")
            except RuntimeError:
                break  # fewer than the coarsest cut has
            ours = Distance(mesh, path)
            if ours.triangles == before:
                continue
            before = ours.triangles
            write_ply(path, *meshopt(*whole, ours.triangles / len(whole[1])))
            peer = Distance(mesh, path)
            ratios.append(ours.rms / peer.rms)
            rows.append([name, f"{wanted:,}", f"{ours.triangles:,}", f"{ours.rms:.4f}", f"{ours.max:.2f}", f"{peer.triangles:,}",
                         f"{peer.rms:.4f}", f"{peer.max:.2f}", f"{ratios[-1]:.2f}"])
        rows.append([name, f"all {len(ratios)}", "", "", "", "", "", "", f"mean {np.mean(ratios):.2f}, worst {max(ratios):.2f}"])
    table("Raw cuts", ["mesh", "budget", "triangles", "RMS", "largest", "meshoptimizer: triangles", "RMS", "largest", "RMS over meshoptimizer"], rows)


def floors(args):
    """The smallest surface that a default file ends in, beside a quadric simplifier at the same number of triangles."""
    rows = []
    for mesh in args.meshes:
        name, path = name_of(mesh), os.path.join(args.work, "floor.ply")
        default, s = default_file(mesh, args.work)
        edge = s["mean_edge_length"]
        levels = lodpack("info", default, "--json")
        coarsest = s["levels"][0]["triangles"]
        cut = lodpack("extract", default, "--triangles", 500, "-o", path, "--force", "--json")
        ours = Distance(mesh, path)
        _, triangles = arrays(welded(path))
        edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
        boundary = int((np.unique(edges, axis=0, return_counts=True)[1] % 2).sum())
        overview = levels.get("overview") or {}
        row = [name, f"{s['triangles']:,}", f"{coarsest:,}", f"{overview.get('triangles', '')}", f"{ours.triangles:,}", cut["topology"],
               f"{ours.rms:.2f}", f"{ours.max:.1f}", f"{cut['certified_error'] / edge:.1f}", boundary]
        if s["triangles"] <= 3_000_000:
            try:
                meshes = welded(mesh)
                decimate(meshes, ours.triangles)
                write_ply(path, *arrays(meshes))
                peer = Distance(mesh, path)
                row += [f"{peer.triangles:,}", f"{peer.rms:.2f}", f"{peer.max:.1f}"]
            except Exception as error:
                row.append(f"failed: {error}".replace("\n", " ").replace("|", "/")[:80])
        rows.append(row)
    table("Floors", ["mesh", "input", "coarsest level", "overview", "triangles", "topology", "RMS", "largest", "certified", "boundary edges",
                     "optimal placement: triangles", "RMS", "largest"], rows)


def file_of(mesh, wanted, edge, work):
    """A file whose finest level has about `count` triangles, and its certified error, by searching for the
    tolerance."""
    out = os.path.join(work, "wanted.lodpack")
    tolerance, step, best = 0.5, None, None
    low, high = 1e-4, 1e4
    for _ in range(12):
        s = lodpack("build", mesh, "-o", out, "--tolerance", repr(tolerance * edge), "--force", "--json")
        count = s["levels"][-1]["triangles"]
        off = abs(np.log(count / wanted))
        if best is None or off < best[0]:
            best = (off, s["certified_error"])
            os.replace(out, out + ".best")
        if off < 0.005:
            break
        low, high = (tolerance, high) if count > wanted else (low, tolerance)
        # The number of triangles is about inversely proportional to the error.
        guess = tolerance * count / wanted
        tolerance = guess if low * 1.02 < guess < high / 1.02 else (low * high) ** 0.5
    return out + ".best", best[1]


def verify(args):
    rows, total = [], []
    for mesh in args.meshes:
        out, _ = default_file(mesh, args.work)
        run = program("lodpack", "verify", out, "--against", mesh, "--cuts", "1000", "--json")
        r = run.json()
        total.append([name_of(mesh), f"{r['nodes']:,}", len(r["problems"]), r["unproven_nodes"], f"{r['ratio_median']:.3f}",
                      f"{max(level['ratio_max'] for level in r['levels']):.2f}", f"{r['cuts']:,}", f"{r['measured_cuts']:,}", f"{r['boundary_edges']:,}",
                      f"{r['crowded_edges']:,}", f"{run.cpu:.1f}"])
        for level in r["levels"]:
            rows.append([name_of(mesh), level["level"], f"{level['triangles']:,}", f"{level['stored']:.4g}", f"{level['measured']:.4g}",
                         f"{level['ratio_median']:.3f}", f"{level['ratio_max']:.2f}"])
    table("Verification", ["mesh", "nodes compared", "problems", "undecided", "median of stored over true", "largest", "cuts stitched", "of these measured", "boundary edges", "crowded edges", "CPU s"], total)
    table("Stored over measured error by level", ["mesh", "level", "triangles", "stored", "measured", "median ratio", "largest ratio"], rows)


def speed(args):
    rows = []
    for mesh in args.meshes:
        name = name_of(mesh)
        n = program("clusterlod", mesh).json()
        peer_cpu = None
        row = lambda what, cpu, wall, memory, size, stages="": rows.append(
            [name, what, f"{cpu:.1f}", f"{wall:.1f}", f"{n['triangles'] / cpu / 1e3:.0f} k", f"{peer_cpu / cpu:.2f}" if peer_cpu else "",
             f"{wall / cpu:.2f}", f"{memory / 1e6:.0f} MB", f"{memory / n['triangles']:.0f} B", size, stages])
        if args.peers:
            try:
                size, run, peer_cpu, wall = nexus(mesh, args.work)
                row("Nexus (without the start of Python)", peer_cpu, wall, run.memory, f"{size:,}")
            except Exception as error:
                rows.append([name, "Nexus", f"failed: {error}"])
        for effort in ("default", "best"):
            out = os.path.join(args.work, f"{name}-{effort}.lodpack")
            run = program("lodpack", "build", mesh, "-o", out, "--effort", effort, "--force", "--json")
            s = run.json()
            stages = ", ".join(f"{t['stage']} {t['cpu_seconds']:.2f}" for t in s["stages"])
            row(f"lodpack {effort}", run.cpu, run.wall, run.memory, f"{s['bytes']:,}", stages)
        if args.peers:
            run = program("clusterlod", mesh)
            row("clusterlod (no output, no certificate)", run.cpu, run.wall, run.memory, "")
    table("Speed", ["mesh", "program", "CPU s", "wall s", "triangles per CPU s", "times Nexus", "wall / CPU", "peak memory", "per input triangle", "bytes", "CPU s by stage"], rows)


def decode(args):
    """Speed of decoders on the same mesh, our finest level: lodpack's, which decodes one of all levels of its file,
    beside those of single-level files, each with the fewest bits per coordinate that add at most 5 % to our RMS."""
    rows = []
    for mesh in args.meshes:
        name, path = name_of(mesh), os.path.join(args.work, "level.ply")
        out, s = default_file(mesh, args.work)
        lodpack("extract", out, "-o", path, "--force", "--json")
        ours = Distance(mesh, path)
        *_, alone, joined, _ = program("examples/decode_bench", out).out.splitlines()[1].split()
        row = lambda what, size, rms, speed: rows.append(
            [name, what, f"{size:,}", f"{size / s['bytes']:.2f}", f"{rms:.4f}", f"{speed:.2f}", f"{speed / float(joined):.2f}"])
        row(f"lodpack, all {len(s['levels'])} levels", s["bytes"], ours.rms, float(joined))
        row("lodpack, root after root", s["bytes"], ours.rms, float(alone))
        if args.peers:
            whole, coded = arrays(welded(path)), os.path.join(args.work, "coded.ply")
            reached = lambda bits: draco(*whole, bits, coded) and Distance(mesh, coded).rms <= 1.05 * ours.rms
            bits = next(bits for bits in range(8, 17) if bits == 16 or reached(bits))
            rms = Distance(mesh, coded).rms
            for what, size, speed in decoders(*whole, bits):
                row(f"{what}, {bits} bits", size, rms, speed)
    table("Decoding the finest level, one thread", ["mesh", "decoder", "bytes", "over lodpack's", "RMS", "million vertices per CPU s",
          "times lodpack's speed"], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", default="size,triangles,verify,speed")
    parser.add_argument("--work", default="bench-work")
    parser.add_argument("--no-peers", dest="peers", action="store_false")
    parser.add_argument("meshes", nargs="+", metavar="MESH")
    args = parser.parse_args()
    os.makedirs(args.work, exist_ok=True)
    args.meshes = [given(mesh, args.work) for mesh in args.meshes]
    for name in args.tables.split(","):
        {"speed": speed, "size": size, "triangles": triangles, "budgets": budgets, "raw": raw, "floors": floors, "verify": verify, "decode": decode}[name](args)


if __name__ == "__main__":
    main()
