#!/usr/bin/env python3
"""Checks that the rooms of each house import in one direction, and draws them into ARCHITECTURE.md.

usage: rooms.py [--write] [--list] [--root DIR]

A house is a crate, or the crates of the builder, which only show in the picture as frames. A room is a folder or file
at the top of a crate's src, or a crate as a whole. HOUSES lists the rooms of each from the top down: a room may use
those below it in the list and nothing above. The script finds who uses whom in `use` items and in qualified paths
(crate::, super::, and the names of crates of the house); names that a crate re-exports at its root count for the room
that they are from. Inside a room files import in one direction, too: those that lead back to one another are named,
unless CIRCLES says why they may. What goes through the first page of a folder (mod.rs, lib.rs, or the file beside the
folder) does not count, since that page shows all of it. Test code is left out. It ends with 1 where an arrow points
upward, where a room is not in the list, or where the picture in ARCHITECTURE.md is not of the code as it is, or where
the crate that other programs use shows more names at its root than a newcomer can survey; --write draws that picture,
--list prints every arrow with the place of one import."""
import argparse
import os
import pathlib
import re
import sys

# Each house: its crates from the top down. Of each the name that others import it by, where its sources are, and its
# rooms from the top down; a room alone is the crate as a whole.
HOUSES = {
    "reader": [
        ("lodpack", "reader/src", "open verify ground file stream heights decode select index write objects format codec lattice source limits sorted islands error".split())
    ],
    "cli": [
        ("lodpack_cli", "cli/src", "bin/lodpack serve tileset measure".split()),
        ("lodpack_builder", "cli/builder/src", "job geometry_images heights pipeline reduce region".split()),
        ("lodpack_stage", "cli/stage/src", "stage"),
        ("lodpack_import", "cli/import/src", "import"),
        ("lodpack_mesh", "cli/mesh/src", "mesh"),
        ("lodpack_runtime", "cli/runtime/src", "trace storage progress machine text".split()),
    ],
    "viewer-min": [
        (
            "lodpack_view",
            "viewer-min/src",
            "main window wall headless check devices controls present frames overlay shot draw kept root_data pool scene surface report objects channel texels blocks gpu picture args camera".split(),
        )
    ],
}

# Files of a room that may lead back to one another, and why.
CIRCLES = {
    "reader/src/codec/entropy: sharing tables tally": "tables are shared by what their histograms cost, which is counted in tables",
    "reader/src/codec/filling/irregular: connectivity geometry": "the machine asks for forecasts, which walk over its triangles",
    "reader/src/codec/filling/irregular: encode target": "the target refuses with the encoder's error",
    "reader/src/codec/texels: colours image planes values": "an image is coded by what codes its kind, and that takes and gives images",
    "reader/src/decode: cut stitch": "a cut becomes the stitcher's mesh, and the stitcher takes what the cut draws",
    "reader/src/heights: bounds file index tiles tree": "the file reads its tree on demand, whose tiles lie in boxes that the index knows",
    "reader/src/heights: grid page": "the grid is as deep as pages reach",
    "reader/src/stream: frame history light picture": "a frame is the difference of two pictures, which keep their history and their light",
    "reader/src/write: arrangement assembly catalogue encoder order piece sorting texels": "clusters are encoded while they are sorted, so that no two are in memory",
    "cli/builder/src/job: add content encoded heights merge part plan planned stage stage_status status tasks": "steps of a job call one another: "
    "a plan may be all tasks of its stages, and a merge the last of them",
    "cli/import/src/raster: geoid mosaic": "a geoid may be a mosaic of files, and a mosaic of heights may stand on a geoid",
    "cli/src/tileset: finest quantized": "the last level is written as all others, but has the file's own samples",
    "cli/src/tileset: glb light material": "positions, normals and materials of a tile are made of one another's arrays",
}

# The most names at the root of a crate, modules aside.
MOST_NAMES = {"lodpack": 40}

TOKEN = re.compile(r"r?#?[A-Za-z_]\w*|::|[{}()\[\];,*#!<>=]")
# Comments and literals, which may hold anything; a lifetime is no literal.
OPAQUE = re.compile(
    r"""//[^\n]* | /\*.*?\*/ | b?r(?P<hashes>\#*)".*?"(?P=hashes) | b?"(?:\\.|[^"\\])*" | b?'(?:\\.[^']*|[^'\\])'""",
    re.VERBOSE | re.DOTALL,
)


class Problem(Exception):
    """Something in the sources that the script refuses."""


def tokens_of(text):
    """Tokens with their lines, without comments and literals."""
    clear = OPAQUE.sub(lambda match: re.sub(r"[^\n]", " ", match.group()), text)
    line, at, found = 1, 0, []
    for match in TOKEN.finditer(clear):
        line += clear.count("\n", at, match.start())
        at = match.start()
        found.append((match.group(), line))
    return found


def block_end(tokens, at):
    """Index behind the bracket that closes the one at `at`."""
    closing = {"{": "}", "(": ")", "[": "]"}
    depth, opening = 0, tokens[at][0]
    for index in range(at, len(tokens)):
        depth += (tokens[index][0] == opening) - (tokens[index][0] == closing[opening])
        if depth == 0:
            return index + 1
    return len(tokens)


def item_end(tokens, at):
    """Index behind the item that begins at `at`, further attributes included."""
    while tokens[at][0] == "#":
        at = block_end(tokens, at + 1)
    is_plain = any(tokens[at + step][0] in ("use", "static", "type") for step in range(2) if at + step < len(tokens))
    while at < len(tokens):
        token = tokens[at][0]
        if token in ("(", "[") or (token == "{" and is_plain):
            at = block_end(tokens, at)
        elif token == "{":
            return block_end(tokens, at)
        elif token in (";", ","):
            return at + 1
        elif token == "}":
            return at
        else:
            at += 1
    return at


def use_paths(tokens, at):
    """The paths of the use tree at `at`, and the index behind it."""
    prefix, paths = [], []
    while at < len(tokens):
        token = tokens[at][0]
        if token == "{":
            at += 1
            while tokens[at][0] != "}":
                inner, at = use_paths(tokens, at)
                paths += [prefix + path for path in inner]
                at += tokens[at][0] == ","
            return paths, at + 1
        if token == "as":
            at += 2
        elif token == "::":
            at += 1
        elif token in (";", ",", "}"):
            break
        else:
            prefix.append(token)
            at += 1
    return [prefix], at


class Crate:
    """A crate of a house: its sources, its rooms, and which room each name at its root is from."""

    def __init__(self, root, own_name, source, rooms):
        self.own_name, self.place, self.source = own_name, source, root / source
        # The room that the whole crate is, if it is one.
        self.whole = rooms if isinstance(rooms, str) else None
        self.rooms = [rooms] if self.whole else rooms
        self.files = sorted(self.source.rglob("*.rs"))
        self.exports, self.test_paths = {}, set()
        self.read_root()
        for path in self.files:
            self.find_test_modules(path)
        self.modules = {tuple(self.module_of(path)): path for path in self.files}
        self.first_pages = {path for path in self.files if path.name in ("lib.rs", "mod.rs") or path.with_suffix("").is_dir()}

    def read_files(self):
        """The files whose imports count. A root without anything of its own only shows names."""
        shown = (path for path in self.files if self.whole or path.name != "lib.rs")
        return [path for path in shown if not self.test_paths & {path, *path.parents}]

    def room_of_file(self, path):
        parts = path.relative_to(self.source).with_suffix("").parts
        return self.whole or ("/".join(parts[:2]) if parts[0] == "bin" else parts[0])

    def module_of(self, path):
        parts = list(path.relative_to(self.source).with_suffix("").parts)
        return parts[:-1] if parts[-1] in ("mod", "lib") else parts

    def read_root(self):
        """Which room each name at the crate's root is from; those that the root defines are from none."""
        tokens, at = tokens_of((self.source / "lib.rs").read_text()), 0
        items = {"struct", "enum", "union", "trait", "fn", "type", "const", "static"}
        for (visibility, _), (item, _), (name, _) in zip(tokens, tokens[1:], tokens[2:]):
            if visibility == "pub" and item in items:
                self.exports[name] = None
        while at < len(tokens):
            if tokens[at][0] == "use":
                paths, at = use_paths(tokens, at + 1)
                self.exports.update({path[-1]: path[0] for path in paths if len(path) > 1})
            else:
                at += 1

    def find_test_modules(self, path):
        text = path.read_text()
        folder = path.parent if path.name in ("lib.rs", "mod.rs", "main.rs") else path.with_suffix("")
        for module in re.findall(r"#\[cfg\(test\)\]\s*(?:pub(?:\(\w+\))?\s+)?mod\s+(\w+)\s*;", text):
            self.test_paths |= {folder / f"{module}.rs", folder / module}

    def file_of(self, target):
        """The file of the innermost module that a path from the crate's root leads to; none if that is the root."""
        for end in range(len(target), 0, -1):
            if file := self.modules.get(tuple(target[:end])):
                return file
        return None

    def room_of_name(self, name, rooms):
        """The room that a path from the crate's root leads to; none if there is none."""
        return self.whole or (name if name in rooms else self.exports.get(name))


class House:
    """The rooms of some crates, and the arrows between them."""

    def __init__(self, root, name, crates):
        self.root, self.name = root, name
        self.crates = [Crate(root, *crate) for crate in crates]
        self.order = [room for crate in self.crates for room in crate.rooms]
        self.by_name = {crate.own_name: crate for crate in self.crates}
        # Between rooms, and between files of a room.
        self.arrows, self.inside = {}, {}
        for crate in self.crates:
            for path in crate.read_files():
                self.read(crate, path)

    def read(self, crate, path):
        room, module = crate.room_of_file(path), crate.module_of(path)
        tokens, at, braces = tokens_of(path.read_text()), 0, []
        if room not in self.order:
            raise Problem(f"{path.relative_to(self.root)}: room {room} is not in HOUSES of tests/rooms.py: say there what it may use")
        while at < len(tokens):
            token, line = tokens[at]
            before = tokens[at - 1][0] if at else ""
            here = module + [name for name in braces if name]
            if token == "#" and tokens[at + 1][0] == "[":
                end = block_end(tokens, at + 1)
                words = [word for word, _ in tokens[at + 2 : end - 1]]
                is_test = words == ["test"] or (words[:1] == ["cfg"] and "test" in words and "not" not in words)
                at = item_end(tokens, end) if is_test else end
                continue
            if token == "{":
                is_module = at >= 2 and tokens[at - 2][0] == "mod"
                braces.append(before if is_module else None)
            elif token == "}" and braces:
                braces.pop()
            elif token == "use" and tokens[at + 1][0] != "<":
                paths, at = use_paths(tokens, at + 1)
                for used in paths:
                    self.note(crate, room, here, used, path, line)
                continue
            elif tokens[at + 1 : at + 2] and tokens[at + 1][0] == "::" and before != "::":
                # `pub(in crate::room)` uses nothing.
                is_visibility = before == "in" and tokens[at - 2][0] == "("
                used = [token]
                while at + 2 < len(tokens) and tokens[at + 1][0] == "::" and re.match(r"[A-Za-z_*]", tokens[at + 2][0]):
                    used.append(tokens[at + 2][0])
                    at += 2
                if not is_visibility:
                    self.note(crate, room, here, used, path, line)
            at += 1

    def note(self, crate, room, module, used, path, line):
        """Notes what a path leads to, if that is another room."""
        where = f"{path.relative_to(self.root)}:{line}"
        head, rest = used[0], used[1:]
        is_program = room.startswith("bin/") or room == "main"
        if head in self.by_name:
            crate, target = self.by_name[head], rest
        elif head == "crate" and not is_program:
            target = rest
        elif head == "super" and not is_program:
            target = module[:-1] + rest
            while rest and rest[0] == "super":
                module, rest = module[:-1], rest[1:]
                target = module[:-1] + rest
        else:
            return
        file = crate.file_of(target)
        if file and file != path and not {file, path} & crate.first_pages and crate.room_of_file(file) == room:
            self.inside.setdefault((path, file), where)
        if not crate.whole and (not target or target[0] == "*"):
            raise Problem(f"{where}: `{'::'.join(used)}` names no room: import what is used")
        to = crate.room_of_name(target[0] if target else None, self.order)
        if to is None:
            raise Problem(f"{where}: `{'::'.join(used)}`: {target[0]} is neither a room of HOUSES in tests/rooms.py nor a name at the crate's root")
        if to != room:
            self.arrows.setdefault((room, to), where)

    def upward(self):
        rank = {room: number for number, room in enumerate(self.order)}
        wrong = [(arrow, where) for arrow, where in self.arrows.items() if rank[arrow[0]] > rank[arrow[1]]]
        return [f"{where}: {self.name}: {a} uses {b}, but {b} stands above {a} in HOUSES of tests/rooms.py" for (a, b), where in sorted(wrong)]

    def circles(self):
        """The files of each room that lead back to one another, as paths below its crate."""
        after = {}
        for one, other in self.inside:
            after.setdefault(one, set()).add(other)
        reached = {}
        for start in after:
            seen, open_ = set(), [start]
            while open_:
                found = after.get(open_.pop(), set()) - seen
                seen |= found
                open_ += found
            reached[start] = seen
        circles = {frozenset(other for other in reached[start] if start in reached.get(other, ())) for start in after if start in reached[start]}
        return sorted(sorted(circle) for circle in circles)

    def untold_circles(self, tolerated):
        """Circles of files that nobody has given a reason for. The others are taken out of those that are tolerated."""
        for circle in self.circles():
            folder = pathlib.Path(os.path.commonpath([path.parent for path in circle]))
            names = [path.relative_to(folder).with_suffix("").as_posix() for path in circle]
            key = f"{folder.relative_to(self.root).as_posix()}: {' '.join(names)}"
            if tolerated.pop(key, None) is None:
                ways = [f"{where} to {other.name}" for (one, other), where in sorted(self.inside.items()) if one in circle and other in circle]
                yield f"{key} lead back to one another: give what they share a file below them, or say in CIRCLES of tests/rooms.py why not ({', '.join(ways)})"

    def below(self, room):
        """Everything that a room uses, directly or through others."""
        direct = {b for a, b in self.arrows if a == room}
        return direct.union(*(self.below(other) for other in direct))

    def picture(self):
        """The rooms as a Mermaid graph, those of each crate in a frame. An arrow that follows from others is left
        out."""
        lines = ["```mermaid", "graph TD"]
        if len(self.crates) > 1:
            for crate in self.crates:
                name = crate.own_name.replace("_", "-")
                lines += [f"    subgraph {name}", *(f"        {room}" for room in crate.rooms), "    end"]
        for room in self.order:
            direct = {b for a, b in self.arrows if a == room}
            through = set().union(*(self.below(other) for other in direct))
            shown = [other for other in self.order if other in direct - through]
            lines.append(f"    {room} --> {' & '.join(shown)}" if shown else f"    {room}")
        return "\n".join([*lines, "```"])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--write", action="store_true", help="draw the pictures into ARCHITECTURE.md")
    parser.add_argument("--list", action="store_true", help="print every arrow")
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parent.parent)
    args = parser.parse_args()
    document = args.root / "ARCHITECTURE.md"
    text = document.read_text()
    problems, drawn = [], text
    circles = dict(CIRCLES)
    for name, crates in HOUSES.items():
        try:
            house = House(args.root, name, crates)
        except Problem as problem:
            problems.append(str(problem))
            continue
        if args.list:
            for (a, b), where in sorted(house.arrows.items()):
                print(f"{name}: {a} -> {b}    {where}")
        for crate in house.crates:
            at = [crate.source / room for room in crate.rooms if not crate.whole]
            empty = [path.name for path in at if not path.exists() and not path.with_suffix(".rs").exists()]
            problems += [f"{name}: room {room} of HOUSES in tests/rooms.py is not in {crate.place}" for room in empty]
            shown = sorted(crate.exports)
            if len(shown) > MOST_NAMES.get(crate.own_name, len(shown)):
                most = MOST_NAMES[crate.own_name]
                problems.append(f"{crate.place}/lib.rs shows {len(shown)} names, more than {most}: leave some in their modules: {', '.join(shown)}")
            untold = [room for room in crate.rooms if f"`{room}`" not in text]
            problems += [f"ARCHITECTURE.md does not say what room {room} of {crate.place} holds" for room in untold]
        problems += house.untold_circles(circles)
        upward = house.upward()
        problems += upward
        if upward:
            continue
        begin, end = f"<!-- rooms of {name}: drawn by tests/rooms.py --write -->\n", "\n<!-- end of rooms -->"
        head, found, tail = drawn.partition(begin)
        if not found or end not in tail:
            problems.append(f"ARCHITECTURE.md has no lines `{begin.strip()}` and `{end.strip()}`")
            continue
        drawn = head + begin + house.picture() + tail[tail.index(end) :]
    problems += [f"{key} of CIRCLES in tests/rooms.py: there is no such circle any more" for key in circles]
    if args.write and not problems:
        document.write_text(drawn)
    elif drawn != text:
        problems.append("ARCHITECTURE.md does not show the rooms as they are: run tests/rooms.py --write and commit what it draws")
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
