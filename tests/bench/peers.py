#!/usr/bin/env python3
"""Runs lodpack and every peer that installs on meshes, and prints one Markdown table of ratios to the best peer.

usage: peers.py [--work DIR] [--csv DIR] [--only NAME,..] [--install] [--large] [--add] MESH...

A MESH is a file, or part:N, sphere:N or sheet:N for a generated one. The table has one row per mesh and one column per
measure. A cell shows the ratio (above 1: lodpack is better), the best peer, its figure : ours. Writes `peers-MESH.csv`,
with every measured file and setting, for `lodpack report --peers`, and `peers.json`, to --csv (by default --work);
--add keeps the meshes that are already in that file, with their rows. Progress goes to stderr.

Peers, by the names for --only:
- hierarchies: nexus (nxs_build + nxs_compress of pymeshlab), clusterlod (writes nothing), deepmonkey
  (deepmonkey-geometry);
- simplifiers: pymeshlab (quadric, optimal placement), VTK, fast-simplification, pyfqmr, meshoptimizer;
- files of one level: draco (alone, and after the two simplifiers that need the fewest triangles), gltfpack.
Nexus is tried with its defaults, cut off at the coarsest nodes that reach our error, and over the best simplified mesh.

Needs the release binaries (cargo build --release --workspace; LODPACK_BIN names another directory), and
requirements.txt in the Python that runs it. gltfpack comes from npm and deepmonkey-geometry from crates.io: --install
puts both into --work; otherwise they are looked for there and on PATH. Above three million triangles, tools that take
minutes per mesh (pymeshlab, VTK) or gigabytes are left out unless --large is given. Distances are those of bench.py.
CPU seconds and memory are the best of three builds of a hierarchy, or of as many as take 20 CPU seconds; for Nexus, the
time that Python takes to start with pymeshlab is not counted.

A peer reaches an error if the RMS, or the maximum, of its mesh as decoded from its file is no larger than that of
lodpack's finest level. A file is a pyramid if it has at least two levels, any part of which can be read without the
rest. First pictures are drawn from a pyramid's roots (lodpack: overview or coarsest level; Nexus: header, index, root
nodes), or from all of a file of one level."""
import argparse, importlib.metadata, json, os, platform, shutil, subprocess

from peer import hierarchies, single
from peer.coders import Gltfpack, write_glb
from peer.result import Result, say
from peer.run import arrays, given, name_of, welded, write_ply
from peer.simplify import LONG, TOOLS
from peer.verdict import table, verdicts

NAMES = ["nexus", "clusterlod", "deepmonkey", "draco", "gltfpack", *TOOLS]
MANY = 3_000_000
SIZE = ("rms", "rms_pyramid", "max", "max_pyramid")


def installed(work, install):
    """Commands of the peers that are not in Python: their paths, or None."""
    packed, deepmonkey = os.path.join(work, "node_modules/gltfpack/cli.js"), os.path.join(work, "bin/deepmonkey-geometry")
    if install:
        for path, command in ((packed, ["npm", "install", "--silent", "--prefix", work, "gltfpack@1.3.0"]),
                              (deepmonkey, ["cargo", "install", "--quiet", "--locked", "--root", work, "deepmonkey-geometry@0.1.0"])):
            if not os.path.exists(path):
                say(f"installs {command[-1]}")
                try:
                    subprocess.run(command, check=True, cwd=work, stdout=subprocess.DEVNULL)
                except (OSError, subprocess.CalledProcessError) as error:
                    say(f"{command[-1]} does not install: {error}")
    native = shutil.which("gltfpack")
    gltfpack = [native] if native else ["node", packed] if os.path.exists(packed) and shutil.which("node") else None
    return gltfpack, deepmonkey if os.path.exists(deepmonkey) else shutil.which("deepmonkey-geometry")


def measure(mesh, args, commands):
    positions, triangles = arrays(welded(mesh))
    result, many = Result(name_of(mesh), len(triangles), 1.0), len(triangles) > MANY and not args.large
    work = os.path.join(args.work, result.mesh)
    os.makedirs(work, exist_ok=True)
    source, glb = os.path.join(work, "source.ply"), os.path.join(work, "source.glb")
    write_ply(source, positions, triangles)
    hierarchies.measure_lodpack(result, mesh, work)
    scale = single.Scale(positions, result.edge)
    ours = result.ours
    say(f"{result.mesh}: lodpack: {ours.bytes:,} B, {ours.triangles:,} triangles, RMS {ours.rms:.4f} max {ours.max:.3f}")
    wanted = lambda name: name in args.only

    if wanted("clusterlod"):
        with result.guard("clusterlod", "cpu", "memory"):
            hierarchies.measure_clusterlod(result, mesh, work)
    if wanted("deepmonkey"):
        with result.guard("deepmonkey", *hierarchies.BUILD):
            if not commands[1]:
                raise RuntimeError("not installed")
            hierarchies.measure_deepmonkey(result, commands[1], source, work)
    if wanted("nexus"):
        with result.guard("Nexus", *hierarchies.BUILD, *SIZE):
            hierarchies.measure_nexus(result, mesh, source, work, lambda m: scale.lattice(m, getattr(ours, m)))
    if wanted("draco"):
        with result.guard("Draco", "rms", "max"):
            single.measure_draco(result, positions, triangles, scale, mesh, work)

    simplified = []
    for tool in TOOLS:
        if wanted(tool):
            with result.guard(tool, "triangles", "rms", "max"):
                if many and tool in LONG:
                    raise RuntimeError(f"left out above {MANY:,} triangles")
                simplified.append(single.measure_simplifier(result, tool, source, mesh, work))
    for which in ("rms", "max"):
        fit = sorted((pair for pair in simplified if pair[1][which]), key=lambda pair: pair[1][which])
        for simplifier, needs in fit[:2] if wanted("draco") else []:
            with result.guard(f"{simplifier.tool} + Draco", which):
                single.measure_coded(result, simplifier, needs, which, scale, work)
        for simplifier, needs in fit[:1] if wanted("nexus") else []:
            with result.guard(f"{simplifier.tool} + Nexus", which, f"{which}_pyramid"):
                single.measure_nexus_over(result, simplifier, needs, which, scale, work)
    if wanted("gltfpack"):
        with result.guard("gltfpack", "rms", "max"):
            if not commands[0]:
                raise RuntimeError("not installed")
            write_glb(glb, positions, triangles)
            packer = Gltfpack(commands[0], glb, len(triangles), work)
            own = next((needs for simplifier, needs in simplified if simplifier.tool == "meshoptimizer"), {})
            for which in ("rms", "max"):
                single.measure_gltfpack(result, packer, which, own.get(which) or ours.triangles, scale, mesh, work)
    shutil.rmtree(work)
    return result


def versions():
    names = ("pymeshlab", "DracoPy", "meshoptimizer", "fast-simplification", "pyfqmr", "pyvista", "vtk", "numpy")
    found = {}
    for name in names:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return {**found, "gltfpack": "1.3.0", "deepmonkey-geometry": "0.1.0", "python": platform.python_version()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", default="peers-work")
    parser.add_argument("--csv")
    parser.add_argument("--only", type=lambda text: text.split(","), default=NAMES)
    parser.add_argument("--install", action="store_true")
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--add", action="store_true")
    parser.add_argument("meshes", nargs="*", metavar="MESH")
    args = parser.parse_args()
    unknown = set(args.only) - set(NAMES)
    if unknown:
        parser.error(f"no peer {', '.join(sorted(unknown))}; there are {', '.join(NAMES)}")
    if not args.meshes and not args.add:
        parser.error("no mesh; --add alone prints the table again")
    args.work = os.path.abspath(args.work)
    args.csv = os.path.abspath(args.csv or args.work)
    for folder in (args.work, args.csv):
        os.makedirs(folder, exist_ok=True)
    commands, results, kept = installed(args.work, args.install), [], os.path.join(args.csv, "peers.json")
    if args.add and os.path.exists(kept):
        with open(kept) as earlier:
            results = [Result.of_json(values) for values in json.load(earlier)["meshes"]]
    for mesh in args.meshes:
        result = measure(given(mesh, args.work), args, commands)
        results = [result if other.mesh == result.mesh else other for other in results]
        results += [result] if result not in results else []
        with open(kept, "w") as out:
            whole = [{**result.json(), "verdicts": verdicts(result)} for result in results]
            json.dump({"versions": versions(), "meshes": whole}, out, indent=1)
    for result in results:
        result.write_csv(os.path.join(args.csv, f"peers-{result.mesh}.csv"))
    print("lodpack against the best peer: **ratio** peer, its figure : ours. Above 1 lodpack is better.\n")
    print(table(results))


if __name__ == "__main__":
    main()
