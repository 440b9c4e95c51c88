"""vectors/README.md: the JSON text, and checksums of texels."""

import json
import struct
import zlib

from .ch02_conventions import bound, must
from .ch11_patches import FILLINGS
from .ch14_cuts import Cut, open_edges
from .ch20_channels import CODED_AS_COLOURS, CODED_EXACTLY, KINDS, NORMALS
from .ch21_scales import decode_scaled
from .ch21_texels import decode_colours, decode_exact, decode_values, directions, Map
from .ch22_cuts import HeightsCut
from .ch22_heights import CELLS, SIDE
from .ch22_tiles import Drawn


def print_texels(file, out):
    """Per block with a map: its root and level, the size of its images, and for each image a checksum of what is
    coded, or of an image in scales one for each scale."""
    for number, patches in enumerate(file.patches):
        for l, patch in patches.items():
            streams = file.texels[number][l] if file.channels else [b""]
            if not streams[0]:
                continue
            map_ = Map(streams[0], patch)
            sums = []
            for channel, (stream, *finer) in zip(file.channels.channels, file.channels.divided(streams)):
                if not stream or channel.kind not in KINDS:
                    sums.append(None)
                    continue
                size = map_.width, map_.height, channel.components
                if finer:
                    scales = [decode_scaled([stream, *finer][: s + 1], *size) for s in range(4)]
                    sums.append([checksum(rows, channel, map_, s) for s, rows in enumerate(scales)])
                    continue
                decode = decode_values
                if channel.kind in CODED_AS_COLOURS + CODED_EXACTLY:
                    decode = decode_exact if channel.kind in CODED_EXACTLY else decode_colours
                sums.append(checksum(decode(stream, *size), channel, map_, 3))
            out.write(f"{number} {l} {map_.width} {map_.height} {json.dumps(sums)}\n")


def checksum(rows, channel, map_, s):
    """Of an image at a scale."""
    rows = [[texel or (0,) * channel.components for texel in row] for row in rows]
    if channel.kind in NORMALS:
        rows = directions(rows, map_, 2.0 ** (s - 3))
    code = "B" if channel.kind in CODED_AS_COLOURS + CODED_EXACTLY else "<H"
    return zlib.crc32(b"".join(struct.pack(code, x) for row in rows for texel in row for x in texel))


def bits_of(x):
    """A number as the 16 hexadecimal digits of its binary64 form."""
    return struct.pack(">d", x).hex()


def ascii_of(text):
    """Every character that could be written in two ways is written as UTF-16."""
    return "".join(c if "!" <= c <= "~" and c not in '"\\' else utf16(c) for c in text)


def print_json(file, out):
    step_log2 = file.header.step_log2

    def line(value):
        return json.dumps(value, separators=(",", ":"))

    def block(l, number, root, patch):
        error, deviation = (bits_of(bound(code, step_log2)) for code in (root.blocks[l].error, root.blocks[l].deviation))
        head = {"level": l, "error": error, "border_deviation": deviation, "triangle_count": len(patch.triangles)}
        texels = {"texels": [stream.hex() for stream in file.texels[number][l]]} if file.channels else {}
        return line(head | {"interior": patch.interior, "triangles": patch.triangles} | texels)

    def channel(x, scale_count):
        numbers = {name: bits_of(value) for name, value in zip(("low", "step", "bound"), x[3:])}
        kind = ("scaled " if scale_count == 4 else "") + KINDS.get(x.kind, "unknown")
        return {"name": x.name, "kind": kind, "components": x.components} | numbers

    def samples(knots):
        return [[knot.parameter, knot.level, knot.position] for knot in knots[1:-1]]

    def level(x):
        return {"tolerance": bits_of(x.tolerance), "max_error": bits_of(x.max_error), "triangle_count": x.triangle_count}

    parents = {child: number for number, r in enumerate(file.roots) for child in r.children}

    def root(number, r, patches):
        loops = [[[half.arc, half.reversed] for half in loop] for loop in r.loops]
        tree = {"parent": parents.get(number), "children": list(r.children)}
        head = tree | {"filling": FILLINGS[r.filling].name, "loops": loops, "low": r.low, "high": r.high}
        blocks = ",\n".join(block(l, number, r, patch) for l, patch in patches.items())
        return f'{line(head)[:-1]},"blocks":[\n{blocks}\n]}}'

    def array(name, lines):
        return f'"{name}":[' + "".join("\n" + x + "," for x in lines)[:-1] + "\n]"

    lattice = {"origin": [bits_of(x) for x in file.header.origin], "step_log2": step_log2}
    members = [
        f'"lattice":{line(lattice)}',
        array("levels", [line(level(x)) for x in file.levels.levels]),
        array("corners", [line([level, corner]) for level, corner in zip(file.corner_levels, file.corners)]),
        array("arcs", [line({"corners": arc.ends, "samples": samples(k)}) for arc, k in zip(file.arcs, file.knots)]),
        array("roots", [root(k, r, patches) for k, (r, patches) in enumerate(zip(file.roots, file.patches))]),
    ]
    if file.overview is not None:
        o = file.overview
        head = {"error": bits_of(bound(o.error, step_log2)), "loops": o.loops}
        members.append(f'"overview":{line(head | {"interior": o.patch.interior, "triangles": o.patch.triangles})}')
    if file.channels is not None:
        members.append(f'"texel_bytes":{line(file.channels.stream_bytes)}')
        members.append(array("channels", [line(channel(*x)) for x in zip(file.channels.channels, file.channels.scales)]))
    if file.placement is not None:
        up, unit, origin, crs = file.placement
        text = ascii_of(crs)
        head = line({"up": up, "unit": bits_of(unit or 0.0), "origin": [bits_of(x) for x in origin]})
        members.append(f'"placement":{head[:-1]},"crs":"{text}"}}')
    if file.objects is not None:
        def text_of(x):
            return "null" if x is None else f'"{ascii_of(x)}"'

        objects = file.objects
        members.append(f'"object_count":{objects.count}')
        nodes = [f"[{text_of(node.name)},{text_of(node.id)},{line(node.parent)}]" for node in objects.nodes]
        members.append(array("nodes", nodes))
        members.append(array("owners", [line([k, leaf.objects, leaf.blocks]) for k, leaf in objects.leaves.items()]))
    if file.ground is not None:
        heights = file.ground.heights
        places = [Drawn(heights, tile).places[SIDE**2 // 2] for tile in heights.tiles if tile[0] == 0]
        middles = [[bits_of(x) for x in file.ground.point(place)] for place in places]
        columns, rows = heights.counts
        ground = {"columns": columns, "rows": rows, "scale": bits_of(file.ground.scale), "middles": middles}
        members.append(f'"ground":{line(ground)}')
    out.write("{\n" + ",\n".join(members) + "\n}\n")


def print_heights(file, out):
    def line(value):
        return json.dumps(value, separators=(",", ":"))

    columns, rows = file.counts
    grid = {"columns": columns, "rows": rows, "wraps": file.wraps, "poles": file.poles, "depth": file.depth}
    numbers = {"is_globe": file.is_globe, "numbers": [bits_of(x) for x in file.numbers]}
    out.write(f'{{\n"grid":{line(grid)},\n"surface":{line(numbers)},\n"ramp":{line(file.ramp)},\n')
    if file.stops is not None:
        out.write(f'"stops":{line([[bits_of(height), colour] for height, colour in file.stops])},\n')
    if file.drape is not None:
        d = file.drape
        head = {"size": d.size, "numbers": [bits_of(x) for x in d.numbers], "components": d.components, "side": d.side_log2}
        lines = []
        for halvings in reversed(range(3 * len(d.levels) + 1)):
            texels = b"".join(bytes(texel) for row in d.image(halvings) for texel in row)
            lines.append("\n" + line([*d.size_at(halvings), zlib.crc32(texels)]))
        out.write(f'"drape":{line(head)[:-1]},"images":[{",".join(lines)}\n]}},\n')
    out.write('"tiles":[')
    for k, (tile, record) in enumerate(file.records.items()):
        values, drawn = file.tiles[tile], Drawn(file, tile)
        head = {"tile": tile, "children": record.children, "partial": record.partial}
        head |= {"lowest": record.lowest, "highest": record.highest}
        cells = [f"{row:016x}" for row in values.cells] if record.partial else None
        # What lies beyond the grid repeats its last column and its last row.
        width, height = (axis.index(axis[CELLS]) + 1 for axis in drawn.lines)
        samples = [[q if k else None for q, k in zip(values.samples, values.known)][b * SIDE :][:width] for b in range(height)]
        place = [bits_of(x) for x in drawn.places[SIDE**2 // 2]]
        resolutions = []
        for resolution in record.resolutions:
            triangles = drawn.triangles(resolution.tolerance)
            must(len(triangles) == resolution.triangle_count, "a resolution does not have as many triangles as it says")
            numbers = {"tolerance": bits_of(resolution.tolerance), "error": bits_of(resolution.error)}
            resolutions.append(numbers | {"triangles": triangles})
        text = line(head | {"cells": cells, "samples": samples, "middle": place, "resolutions": resolutions})
        out.write(("," if k else "") + "\n" + text)
    out.write("\n]\n}\n")


def utf16(character):
    units = character.encode("utf-16-be")
    return "".join(f"\\u{units[k]:02x}{units[k + 1]:02x}" for k in range(0, len(units), 2))


# ---- vectors/README.md:
# cuts ---------------------------------------------------------------------------------------------


def print_cuts(file, cuts, out):
    """Of each cut, a list of pairs of a root and a level: its counts, and a checksum of its mesh in the order of
    14.3."""
    origin, step = file.header.origin, 2.0**file.header.step_log2
    for cut in cuts:
        mesh = Cut(file, dict(cut))
        places = ([o + x * step for o, x in zip(origin, point)] for point in mesh.points)
        print_mesh(places, mesh.triangles, len(mesh.points), out)


def print_heights_cuts(file, cuts, out):
    """Of each cut, a list of depth, column, row and resolution: vertices by row and column, triangles in ascending
    order."""
    for cut in cuts:
        mesh = HeightsCut(file, {tuple(tile[:3]): tile[3] for tile in cut})
        samples = sorted({corner for triangle in mesh.triangles for corner in triangle}, key=lambda sample: sample[::-1])
        numbers = {sample: k for k, sample in enumerate(samples)}
        triangles = []
        for triangle in mesh.triangles:
            corners = [numbers[corner] for corner in triangle]
            first = corners.index(min(corners))
            triangles.append(tuple(corners[first:] + corners[:first]))
        print_mesh((mesh.places[sample] for sample in samples), sorted(triangles), len(samples), out)


def print_mesh(places, triangles, vertex_count, out):
    crc = 0
    for place in places:
        crc = zlib.crc32(struct.pack("<3d", *(x + 0.0 for x in place)), crc)  # no negative zeros
    for triangle in triangles:
        crc = zlib.crc32(struct.pack("<3I", *triangle), crc)
    out.write(f"{vertex_count} {len(triangles)} {open_edges(triangles)} {crc:08x}\n")
