#!/usr/bin/env python3
"""Names, ids and the tree of what an input names, before and after lodpack.

    objects_round_trip.py LODPACK INPUT.glb|INPUT.obj|INPUT.city.json ... [--work DIR] [--against FILE.lodpack]

Each input is built (unless --against is that file, of the one input), `info --objects --json` lists it, `extract`
writes all of it as GLB, and that GLB is built again. Compared are the objects (name, id, and the names and ids of all
above) and the whole tree of objects and assemblies, each as often as it comes. Inputs and the extracted GLB are read
here as plain JSON and text, by no code of lodpack. A CityJSON file becomes a GLB first, around its middle, whose nodes
are its city objects below their parents, named by their types; its surfaces must be triangles, which
`cjio IN.json upgrade triangulate --sloppy save OUT.city.json` makes of them (PyPI's cjio[export] 0.10.1). Prints a
table; exit status 1: something is lost, added or elsewhere.
"""
import argparse
import collections
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

IDS = ("id", "globalid", "guid")


def glb_document(path):
    data = path.read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    return json.loads(data[20 : 20 + length])


def glb_nodes(path):
    """Of each node that the default scene shows: name, id, parent and whether it has a mesh."""
    document, nodes = glb_document(path), []
    listed = document["nodes"]
    scenes = document.get("scenes")
    roots = scenes[document.get("scene", 0)]["nodes"] if scenes else range(len(listed))
    open_nodes = [(root, None) for root in roots]
    while open_nodes:
        number, parent = open_nodes.pop()
        node = listed[number]
        extras = node.get("extras")
        extras = extras if isinstance(extras, dict) else {}
        ids = {key.lower(): value for key, value in extras.items()}
        found = next((ids[key] for key in IDS if key in ids), None)
        nodes.append((node.get("name") or None, None if found is None else str(found), parent, "mesh" in node))
        open_nodes += [(child, len(nodes) - 1) for child in node.get("children", [])]
    return nodes


def obj_nodes(path):
    """Each pair of `o` and `g` with faces is an object, each `o` without a name a new one; a `g` lies below its `o`."""
    nodes, numbers, above, group, unnamed = [], {}, None, None, 0

    def number(key, name, parent):
        if key not in numbers:
            numbers[key] = len(nodes)
            nodes.append([name, None, parent, False])
        return numbers[key]

    with open(path, encoding="utf-8") as lines:
        for line in lines:
            word, _, rest = line.strip().partition(" ")
            if word == "o":
                unnamed += not rest.strip()
                above, group = rest.strip() or unnamed, None
            elif word == "g":
                group = rest.strip() or None
            elif word == "f":
                parent = None
                if above is not None or group is None:
                    parent = number((above,), above if isinstance(above, str) else None, None)
                at = parent if group is None else number((above, group), group, parent)
                nodes[at][3] = True
    return [tuple(node) for node in nodes]


def file_nodes(lodpack, path):
    """What `info --objects` lists."""
    done = subprocess.run([lodpack, "info", path, "--objects", "--json"], capture_output=True, text=True, check=True)
    listed = json.loads(done.stdout)["objects"]["list"]
    places = {node["number"]: place for place, node in enumerate(listed)} | {None: None}
    return [(node["name"], node["id"], places[node["parent"]], node["leaves"] is not None) for node in listed]


def used(nodes):
    """Without nodes on no path to an object."""
    keep = [is_object for *_, is_object in nodes]
    for place, node in enumerate(nodes):
        parent = node[2] if keep[place] else None
        while parent is not None and not keep[parent]:
            keep[parent] = True
            parent = nodes[parent][2]
    return [place for place in range(len(nodes)) if keep[place]]


def facts(nodes):
    """The multiset of objects with the path of each, and the tree without the order of children."""
    kept = used(nodes)
    children = collections.defaultdict(list)
    for place in kept:
        children[nodes[place][2]].append(place)
    paths, order, open_nodes = {None: ()}, [], list(children[None])
    while open_nodes:
        place = open_nodes.pop()
        name, id_, parent, _ = nodes[place]
        paths[place] = (*paths[parent], (name, id_))
        order.append(place)
        open_nodes += children[place]
    objects = collections.Counter(paths[place] for place in kept if nodes[place][3])
    # Equal trees get equal numbers: of each node what it is and the numbers of its children, sorted.
    numbers = {}
    for place in reversed(order):
        name, id_, _, is_object = nodes[place]
        shape = (name, id_, is_object, tuple(sorted(numbers[child] for child in children[place])))
        numbers[place] = SHAPES.setdefault(shape, len(SHAPES))
    tree = collections.Counter(numbers[place] for place in children[None])
    return objects, tree, len(kept) - objects.total()


SHAPES = {}


def city_glb(city, path):
    """A CityJSON file of triangles as GLB."""
    document = json.loads(city.read_text())
    scale = document["transform"]["scale"]
    points = [[at * by for at, by in zip(vertex, scale)] for vertex in document["vertices"]]
    middle = [sum(ends) / 2 for ends in zip(map(min, zip(*points)), map(max, zip(*points)))]
    objects, nodes, meshes, views, accessors, binary = document["CityObjects"], [], [], [], [], bytearray()
    turn = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]
    nodes.append({"name": city.name.split(".")[0], "matrix": turn, "children": []})
    numbers = {key: place for place, key in enumerate(objects, 1)}

    def view(data, **accessor):
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        accessors.append({"bufferView": len(views) - 1, **accessor})
        binary.extend(data)
        return len(accessors) - 1

    def rings(boundaries):
        if boundaries and isinstance(boundaries[0], int):
            yield boundaries
        else:
            for boundary in boundaries:
                yield from rings(boundary)

    for key, thing in objects.items():
        node = {"name": thing["type"], "extras": {"id": key}}
        children = [numbers[child] for child in thing.get("children", []) if child in numbers]
        node |= {"children": children} if children else {}
        triangles = [ring for geometry in thing.get("geometry", []) for ring in rings(geometry["boundaries"])]
        if triangles:
            if any(len(ring) != 3 for ring in triangles):
                sys.exit(f"{city}: {key} has surfaces that are no triangles; let cjio triangulate them")
            places = {vertex: place for place, vertex in enumerate(dict.fromkeys(sum(triangles, [])))}
            corners = [[at - by for at, by in zip(points[vertex], middle)] for vertex in places]
            flat = struct.pack(f"<{3 * len(corners)}f", *sum(corners, []))
            floats = [struct.unpack("<3f", flat[at : at + 12]) for at in range(0, len(flat), 12)]
            ends = {"min": list(map(min, zip(*floats))), "max": list(map(max, zip(*floats)))}
            position = view(flat, componentType=5126, count=len(corners), type="VEC3", **ends)
            order = [places[vertex] for ring in triangles for vertex in ring]
            indices = view(struct.pack(f"<{len(order)}I", *order), componentType=5125, count=len(order), type="SCALAR")
            meshes.append({"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]})
            node["mesh"] = len(meshes) - 1
        nodes.append(node)
        if not any(parent in numbers for parent in thing.get("parents", [])):
            nodes[0]["children"].append(numbers[key])
    result = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(result, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<III", 0x46546C67, 2, 28 + len(text) + len(binary)) + struct.pack("<II", len(text), 0x4E4F534A)
    path.write_bytes(head + text + struct.pack("<II", len(binary), 0x4E4942) + binary)


def compare(wanted, nodes, where):
    objects, tree, _ = facts(nodes)
    lost, added = wanted[0] - objects, objects - wanted[0]
    for what, counts in (("lost", lost), ("added", added)):
        for path, count in list(counts.items())[:3]:
            print(f"{where}: {what} {count} x {path}", file=sys.stderr)
    if not lost and not added and tree == wanted[1]:
        return True, "all"
    tree_is = "the same" if tree == wanted[1] else "another"
    return False, f"{lost.total()} lost, {added.total()} added, the tree is {tree_is}"


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("lodpack")
    arguments.add_argument("inputs", nargs="+", type=pathlib.Path)
    arguments.add_argument("--work", type=pathlib.Path)
    arguments.add_argument("--against", type=pathlib.Path)
    args = arguments.parse_args()
    temporary = tempfile.TemporaryDirectory()
    work = args.work or pathlib.Path(temporary.name)
    work.mkdir(parents=True, exist_ok=True)
    if args.against and len(args.inputs) > 1:
        arguments.error("--against is the file of one input")

    def run(*words):
        subprocess.run([args.lodpack, *words], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    print("| input | objects | assemblies | names, ids | in the file | in its GLB | in the file of that GLB |")
    print("|---|---:|---:|---:|---|---|---|")
    is_right = True
    for given in args.inputs:
        source = given
        if given.suffix == ".json":
            source = work / (given.name.split(".")[0] + ".glb")
            city_glb(given, source)
        nodes = obj_nodes(source) if source.suffix == ".obj" else glb_nodes(source)
        wanted = facts(nodes)
        first, glb, again = (work / f"{source.stem}-{name}" for name in ("1.lodpack", "1.glb", "2.lodpack"))
        if args.against:
            first = args.against
        else:
            run("build", source, "-o", first, "--force", "--objects", "keep")
        run("extract", first, "-o", glb, "--force")
        run("build", glb, "-o", again, "--force", "--objects", "keep")
        results = [
            compare(wanted, file_nodes(args.lodpack, first), f"{given}, file"),
            compare(wanted, glb_nodes(glb), f"{given}, GLB"),
            compare(wanted, file_nodes(args.lodpack, again), f"{given}, file of the GLB"),
        ]
        is_right &= all(same for same, _ in results)
        kept = [nodes[place] for place in used(nodes)]
        names, ids = ({node[at] for node in kept} - {None} for at in (0, 1))
        cells = [given.name, f"{wanted[0].total():,}", f"{wanted[2]:,}", f"{len(names):,}, {len(ids):,}"]
        print("| " + " | ".join(cells + [said for _, said in results]) + " |", flush=True)
    sys.exit(0 if is_right else 1)


if __name__ == "__main__":
    main()
