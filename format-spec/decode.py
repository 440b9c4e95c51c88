#!/usr/bin/env python3
"""Decodes a lodpack file. It is written from SPEC.md alone, to be read beside it and to check other decoders.

    python3 decode.py FILE

prints everything that the file holds as JSON, which vectors/README.md describes, and exits with code 0. For a damaged or
non-conforming file it prints one line to stderr and exits with code 1.

This is plain Python 3.11 without packages. It is one file, and therefore long, so that it follows the order of SPEC.md; headings
name the chapters. It decodes the whole file and checks every checksum and every *must* on the way; speed is no goal. Python's
floats are binary64, and its operators round every operation on its own, as chapter 2.2 demands. Its integers are unbounded.
"""

import json
import math
import struct
import sys
import zlib
from collections import Counter, namedtuple


class Damaged(Exception):
    """The file breaks a *must* of SPEC.md, or exceeds a limit of this decoder."""


def must(condition, what):
    if not condition:
        raise Damaged(what)


# ---- 2.1 Numbers in bytes -------------------------------------------------------------------------------------------------


class Bytes:
    """A run of bytes that is read from its beginning to its end."""

    def __init__(self, data, name):
        self.data, self.name, self.at = data, name, 0

    def take(self, size):
        must(size <= len(self.data) - self.at, f"{self.name} is too short")
        self.at += size
        return self.data[self.at - size : self.at]

    def number(self, code):
        """A fixed-size number; codes are those of `struct`: B, H, I, Q are u8, u16, u32, u64; i is i32; d is f64."""
        (value,) = struct.unpack("<" + code, self.take(struct.calcsize("<" + code)))
        must(code != "d" or math.isfinite(value), f"{self.name} holds a number that is not finite")
        return value

    def varint(self):
        value, k = 0, 0
        while True:
            (byte,) = self.take(1)
            must(k < 9 or byte <= 1, f"{self.name} holds a varint above 64 bits")
            must(k == 0 or byte != 0, f"{self.name} holds a varint that is not in its shortest form")
            value |= (byte & 0x7F) << (7 * k)
            if byte < 0x80:
                return value
            k += 1

    def end(self):
        must(self.at == len(self.data), f"{self.name} has bytes left over")


def unzigzag(u):
    return u // 2 if u % 2 == 0 else -(u + 1) // 2


# ---- 2.2 Arithmetic -------------------------------------------------------------------------------------------------------

LATTICE_LIMIT = 2**40


def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a, s):
    return (a[0] * s, a[1] * s, a[2] * s)


def dot(a, b):
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def vector(point):
    """A lattice point as a vector."""
    return (float(point[0]), float(point[1]), float(point[2]))


def lattice_point(v):
    shifted = [x + 0.5 for x in v]
    # Before rounding, since NaN and infinity have no floor.
    must(all(abs(x) < 2 * LATTICE_LIMIT for x in shifted), "a position lies outside the lattice")
    return on_lattice(tuple(math.floor(x) for x in shifted))


def on_lattice(point):
    must(all(abs(x) <= LATTICE_LIMIT for x in point), "a position lies outside the lattice")
    return point


# ---- 2.3 Local frames -----------------------------------------------------------------------------------------------------

Frame = namedtuple("Frame", "along across normal")
AXES = Frame((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def unit(a):
    s = dot(a, a)
    if not 0 < s < math.inf:
        return None
    return scale(a, 1 / math.sqrt(s))


def frame(normal, direction):
    across = unit(cross(normal, direction))
    n = unit(normal)
    if across is None or n is None:
        return AXES
    return Frame(cross(across, n), across, n)


def slide(f, point, a, b):
    return add(add(point, scale(f.along, a)), scale(f.across, b))


def lift(f, point, h):
    return add(point, scale(f.normal, h))


# ---- 2.5 Error codes ------------------------------------------------------------------------------------------------------


def bound(code, step_log2):
    """The bound that a code stands for, in world units."""
    return 0.0 if code == 0 else math.ldexp(256 + code % 256, code // 256 - 64 + step_log2)


def code_at_least(x, step_log2):
    low, high = 0, 65536
    while low < high:
        middle = (low + high) // 2
        if bound(middle, step_log2) >= x:
            high = middle
        else:
            low = middle + 1
    must(low < 65536, "an error is too large for an error code")
    return low


def bound_sum(a, b):
    return a if b == 0 else (a + b) * (1 + 2.0**-52)


# ---- 4 Header -------------------------------------------------------------------------------------------------------------

MAGIC = b"\x8fLOD\r\n\x1a\n"
HEADER_SIZE = 64
SECTION_SIZE = 32


class Header:
    def __init__(self, file):
        must(file[:8] == MAGIC[: len(file)] and len(file) >= 8, "this is no lodpack file")
        data = Bytes(file[8:HEADER_SIZE], "the header")
        major = data.number("H")
        must(major == 4, f"major version {major} is unknown")
        self.minor = data.number("H")  # a larger one only adds optional sections
        must(data.number("I") == 0, "flags of the header are not 0")
        self.origin = [data.number("d") for _ in range(3)]
        self.step_log2 = data.number("i")
        must(-256 <= self.step_log2 <= 256, "the lattice step is out of range")
        self.section_count = data.number("I")
        must(self.section_count <= 256, "there are more than 256 sections")
        must(data.number("Q") == HEADER_SIZE, "the directory is not at 64")
        self.directory_crc = data.number("I")
        must(data.number("I") == zlib.crc32(file[:0x3C]), "the header's checksum is wrong")


# ---- 5 Section directory --------------------------------------------------------------------------------------------------

SOURCE, LEVELS, TABLES, CLUSTERS, INDEX, PAGES, OVERVIEW, CHANNELS, TEXELS, PLACEMENT, HEIGHTS, HEIGHT_INDEX, RAMP, GROUND = range(1, 15)
SECTION_FLAGS = {SOURCE: 0, LEVELS: 1, TABLES: 1, CLUSTERS: 1, INDEX: 3, PAGES: 3, OVERVIEW: 0, CHANNELS: 0, TEXELS: 2, PLACEMENT: 0}
SECTION_FLAGS |= {HEIGHTS: 1, HEIGHT_INDEX: 3, RAMP: 0, GROUND: 2}
FIRST_PRIVATE_KIND = 0x80000000


def read_sections(file, header):
    """The bytes of every section, by kind."""
    size = SECTION_SIZE * header.section_count
    data = Bytes(Bytes(file[HEADER_SIZE:], "the directory").take(size), "the directory")
    must(zlib.crc32(data.data) == header.directory_crc, "the directory's checksum is wrong")
    sections, last_kind, end = {}, None, HEADER_SIZE + size
    for _ in range(header.section_count):
        kind, flags, offset, length = (data.number(code) for code in "IIQQ")
        checksum, reserved = data.number("I"), data.number("I")
        name = f"section {kind}"
        must(kind not in sections, f"{name} is there twice")
        must(flags < 4, f"{name} has unknown flags")
        must(kind in SECTION_FLAGS or not flags & 1, f"{name} is required but unknown")
        must(flags == SECTION_FLAGS.get(kind, flags), f"{name} has other flags than it must have")
        must(reserved == 0, f"reserved bytes of {name} are not 0")
        must(offset == end, f"{name} does not begin where the one before it ends")
        end += length
        must(end <= len(file), f"the file is truncated within {name}")
        sections[kind], last_kind = file[offset:end], kind
        must(checksum == (0 if flags & 2 else zlib.crc32(sections[kind])), f"the checksum of {name} is wrong")
    of_a_mesh = (LEVELS, CLUSTERS, INDEX)
    has_heights = HEIGHTS in sections
    must(has_heights == (HEIGHT_INDEX in sections), "HEIGHTS is there without HEIGHT_INDEX, or HEIGHT_INDEX without HEIGHTS")
    for kind in (TABLES, PAGES) + (() if has_heights else of_a_mesh):
        must(kind in sections, f"section {kind} is missing")
    must(has_heights or RAMP not in sections, "RAMP lies beside a mesh")
    must(not has_heights or GROUND not in sections, "GROUND lies beside heights")
    must(GROUND not in sections or header.minor >= 3, "a file of a version before 4.3 has a ground")
    must(not has_heights or header.minor >= 2, "a file of a version before 4.2 has heights")
    must(not has_heights or not any(kind in sections for kind in of_a_mesh + (CHANNELS,)), "heights lie beside a mesh")
    must(not has_heights or (header.origin, header.step_log2) == ([0.0] * 3, 0), "heights have a lattice")
    must((CHANNELS in sections) == (TEXELS in sections), "CHANNELS is there without TEXELS, or TEXELS without CHANNELS")
    must(CHANNELS not in sections or header.minor >= 1, "a file of version 4.0 has channels")
    must(last_kind == PAGES, "PAGES is not the last section")
    must(end == len(file), "there are bytes after the last section")
    return sections


# ---- 6.1 Section SOURCE ---------------------------------------------------------------------------------------------------


def check_source(section):
    data = Bytes(section, "SOURCE")
    for code in "QQdd":  # triangle count, vertex count, mean edge length, area
        data.number(code)
    try:
        data.take(len(section) - 32).decode("utf-8")
    except UnicodeDecodeError:
        raise Damaged("the generator in SOURCE is not UTF-8") from None


# ---- 6.2 Section LEVELS ---------------------------------------------------------------------------------------------------

Level = namedtuple("Level", "tolerance max_error triangle_count page_offset page_bytes")


class Levels:
    def __init__(self, section, page_bytes):
        data = Bytes(section, "LEVELS")
        count, self.arc_tangent_shift, self.index_arc_levels, filling_count = (data.number("B") for _ in range(4))
        must(1 <= count <= 24, "the level count is not 1 to 24")
        must(self.arc_tangent_shift <= 40, "the arc tangent shift is above 40")
        must(1 <= self.index_arc_levels <= count, "index blocks hold the arc samples of no level, or of more than there are")
        self.arc_run_samples = data.number("H")
        must(self.arc_run_samples >= 1, "arc runs have no size")
        must(data.take(2) == bytes(2), "reserved bytes of LEVELS are not 0")
        self.levels, page_end = [], 0
        for _ in range(count):
            level = Level(*(data.number(code) for code in "ddQQQ"))
            must(level.tolerance >= 0, "a tolerance is negative")
            must(not self.levels or level.tolerance <= self.levels[-1].tolerance, "a level's tolerance is above the coarser level's")
            must(level.page_offset == page_end, "a level's pages do not begin where the coarser level's end")
            page_end += level.page_bytes
            self.levels.append(level)
        self.fillings, self.steps = [], {}  # codes; by code the steps of each level
        for _ in range(filling_count):
            code, size = data.number("H"), data.number("H")
            must(code in FILLINGS, f"filling {code} is unknown")
            must(not self.fillings or code > self.fillings[-1], "the codes of fillings do not ascend")
            must(size == 2 * count, "a filling's parameters have a wrong size")
            self.fillings.append(code)
            self.steps[code] = [read_steps(data) for _ in range(count)]
        data.end()
        must(page_end == page_bytes, "the last level's pages do not end with PAGES")


# ---- 6.3 Section CLUSTERS -------------------------------------------------------------------------------------------------

Part = namedtuple("Part", "length crc")
PageParts = namedtuple("PageParts", "arc_bytes block_bytes triangle_count max_error")
Cluster = namedtuple("Cluster", "roots arcs corners children low high index pages")  # the first four: ranges of numbers
NUMBER_LIMIT = 2**32 - 2
CLUSTER_ITEM_LIMIT = 2**22  # chapter 16.3


def read_part(data):
    length = data.varint()
    return Part(length, data.number("I") if length > 0 else 0)


MAX_LIST_HEIGHT = 8
Entry = namedtuple("Entry", "height clusters counts low high index_bytes pages")  # of a list: sums over its clusters


def read_clusters(section, index, level_count):
    """All clusters, and their index blocks."""
    data, index = Bytes(section, "CLUSTERS"), Bytes(index, "INDEX")
    totals = [data.varint() for _ in range(3)]
    must(max(totals) <= NUMBER_LIMIT, "there are too many roots, arcs or corners")
    clusters, blocks = [], []
    entries = read_list(data, MAX_LIST_HEIGHT + 1, index, level_count, clusters, blocks)
    index.end()
    must([sum(e.counts[k] for e in entries) for k in range(3)] == totals, "the counts of the clusters do not add up to those of the file")
    return number_children(clusters, totals[0]), blocks


def read_list(data, height, index, level_count, clusters, blocks):
    """The entries of a list of at most this height, each followed through INDEX down to its clusters."""
    entries = []
    for _ in range(data.varint()):
        root_count, entry_height, cluster_count = data.varint(), 0, 1
        must(root_count <= 32, "a cluster has not 1 to 32 roots")
        if root_count == 0:
            entry_height, cluster_count, root_count = (data.varint() for _ in range(3))
            must(1 <= entry_height < height, "a list has a wrong height")
        counts = [root_count] + [data.varint() for _ in range(3)]
        low = [unzigzag(data.varint()) for _ in range(3)]
        high = [x + data.varint() for x in low]
        must(min(low) >= -(2**41) and max(high) <= 2**41, "a cluster's box is too large")
        part = read_part(data)
        below = data.varint() if entry_height > 0 else 0
        pages = [read_page_parts(data) for _ in range(level_count)]
        bytes_of_part = index.take(part.length)
        must(part.length == 0 or zlib.crc32(bytes_of_part) == part.crc, "the checksum of a part of INDEX is wrong")
        entry = Entry(entry_height, cluster_count, counts, low, high, part.length + below, pages)
        if entry_height == 0:
            must(counts[1] + counts[2] <= CLUSTER_ITEM_LIMIT, "a cluster has too many arcs or corners for this decoder")
            first = [r.stop for r in clusters[-1][:3]] if clusters else [0, 0, 0]
            ranges = [range(f, f + c) for f, c in zip(first, counts)]
            clusters.append(Cluster(*ranges, counts[3], low, high, part, pages))
            blocks.append(bytes_of_part)
        else:
            inner = read_list(Bytes(bytes_of_part, "a list of clusters"), entry_height, index, level_count, clusters, blocks)
            must(entry == sum_of_entries(inner, part.length), "a list does not add up to what its entry says")
        entries.append(entry)
    data.end()
    return entries


def sum_of_entries(entries, list_length):
    must(entries, "a list has no entries")
    pages = [
        PageParts(sum(p.arc_bytes for p in of_level), sum(p.block_bytes for p in of_level), sum(p.triangle_count for p in of_level), max(p.max_error for p in of_level))
        for of_level in zip(*(e.pages for e in entries))
    ]
    return Entry(
        1 + max(e.height for e in entries),
        sum(e.clusters for e in entries),
        [sum(e.counts[k] for e in entries) for k in range(4)],
        [min(e.low[k] for e in entries) for k in range(3)],
        [max(e.high[k] for e in entries) for k in range(3)],
        list_length + sum(e.index_bytes for e in entries),
        pages,
    )


def read_page_parts(data):
    arc_bytes, block_bytes, triangle_count = (data.varint() for _ in range(3))
    return PageParts(arc_bytes, block_bytes, triangle_count, data.number("H") if triangle_count > 0 else 0)


def number_children(clusters, root_count):
    """Children have numbers, too: those of the first cluster's roots follow the tops."""
    next_child = root_count - sum(c.children for c in clusters)
    must(next_child > 0 or root_count == next_child == 0, "every root is a child")
    numbered = []
    for cluster in clusters:
        numbered.append(cluster._replace(children=range(next_child, next_child + cluster.children)))
        next_child += cluster.children
    return numbered


def check_levels(levels, clusters, step_log2):
    """Max errors and triangle counts of LEVELS follow from those of the clusters."""
    for l, level in enumerate(levels):
        pages = [c.pages[l] for c in clusters]
        worst = max((p.max_error for p in pages), default=0)
        must(level.max_error == bound(worst, step_log2), "a level's max error is not that of its clusters")
        must(level.triangle_count == sum(p.triangle_count for p in pages), "a level's triangle count is not that of its clusters")


def cut_parts(section, sizes_and_crcs, name):
    """Parts that follow each other and fill a run of bytes, each checked."""
    data, parts = Bytes(section, name), []
    for length, crc in sizes_and_crcs:
        parts.append(data.take(length))
        must(length == 0 or zlib.crc32(parts[-1]) == crc, f"the checksum of a part of {name} is wrong")
    data.end()
    return parts


# ---- 6.4 Section OVERVIEW -------------------------------------------------------------------------------------------------

class Overview:
    """One small patch of everything; its border belongs to no arc."""

    def __init__(self, section, tables):
        data = Bytes(section, "OVERVIEW")
        self.error = data.number("H")
        steps = read_steps(data)
        patch = Patch([], data.number("I"))
        self.loops, last = [], (0, 0, 0)
        for _ in range(data.varint()):
            count = data.varint()
            must(count >= 3, "a loop of OVERVIEW has less than three vertices")
            loop = []
            for _ in range(count):
                last = on_lattice(tuple(x + unzigzag(data.varint()) * 2**steps.normal_shift for x in last))
                loop.append(last)
            self.loops.append(loop)
        patch.loop_sizes = [len(loop) for loop in self.loops]
        patch.border = [p for loop in self.loops for p in loop]
        stream = Stream(data.take(len(section) - data.at), tables)
        IrregularBlock(stream, patch, steps, {})
        stream.end()
        patch.check()
        self.patch = patch


# ---- 6.5 Section PLACEMENT ------------------------------------------------------------------------------------------------

Placement = namedtuple("Placement", "up unit origin crs")


def read_placement(section):
    data = Bytes(section, "PLACEMENT")
    up = data.number("B")
    must(up <= 2 and data.take(7) == bytes(7), "PLACEMENT has an unknown up axis, or reserved bytes that are not 0")
    unit, *origin = (data.number("d") for _ in range(4))
    must(unit >= 0 and math.isfinite(unit), "the unit in PLACEMENT is no length")
    must(all(math.isfinite(x) for x in origin), "the origin in PLACEMENT is not finite")
    must(len(section) - 40 <= 65536, "the CRS in PLACEMENT is too long")
    try:
        return Placement(up, unit, origin, bytes(data.take(len(section) - 40)).decode("utf-8"))
    except UnicodeDecodeError:
        raise Damaged("the CRS in PLACEMENT is not UTF-8") from None


# ---- 7.3 Section TABLES ---------------------------------------------------------------------------------------------------

FREQUENCY_SUM = 4096


class Bits:
    def __init__(self, data):
        self.data, self.at = data, 0

    def number(self, count):
        must(self.at + count <= 8 * len(self.data), "TABLES is too short")
        value = 0
        for k in range(count):
            value |= (self.data[self.at // 8] >> (self.at % 8) & 1) << k
            self.at += 1
        return value

    def gamma(self):
        k = 0
        while self.number(1) == 0:
            k += 1
            must(k <= 23, "a gamma code in TABLES is too long")
        return (1 << k) + self.number(k)


def read_tables(section):
    """The table of each context that has one: for each s below 4096, (token, its frequency, its start)."""
    bits = Bits(section)
    table_count = bits.gamma() - 1
    must(table_count <= 255, "there are more than 255 tables")
    tables = [read_frequencies(bits) for _ in range(table_count)]
    index_bits = (table_count - 1).bit_length() if table_count > 0 else 0
    table_of_context, used, context = {}, set(), -1
    for _ in range(bits.gamma() - 1):
        context += bits.gamma()
        must(context <= 4095, "a context is above 4095")
        table = bits.number(index_bits)
        must(table < table_count, "a context uses a table that is not there")
        table_of_context[context] = tables[table]
        used.add(table)
    must(len(used) == table_count, "a table is used by no context")
    must(bits.number(-bits.at % 8) == 0 and bits.at == 8 * len(section), "TABLES does not end with its last byte")
    return table_of_context


def read_frequencies(bits):
    frequencies, rest = [], None  # by token
    while True:
        code = bits.number(4)
        must(code != 15, "a frequency has code 15")
        if code == 14:
            break
        if code == 0:
            frequencies += [0] * min(bits.gamma(), 257)
        elif code == 13:
            must(rest is None, "two tokens of a table take the rest")
            rest = len(frequencies)
            frequencies.append(0)
        else:
            n = min(code - 1, 3)
            frequencies.append((1 << (code - 1)) + (bits.number(n) << (code - 1 - n)))
        must(len(frequencies) <= 256, "a table has more than 256 tokens")
    must(rest is not None, "no token of a table takes the rest")
    frequencies[rest] = FREQUENCY_SUM - sum(frequencies)
    must(frequencies[rest] >= 1, "the frequencies of a table add up to more than 4096")
    table = []
    for token, frequency in enumerate(frequencies):
        table += [(token, frequency, len(table))] * frequency
    return table


# ---- 7.4 Streams ----------------------------------------------------------------------------------------------------------

FIRST_STATE = 65536


class Stream:
    def __init__(self, data, tables):
        self.tables, self.at = tables, 4
        if not data:
            self.state, self.words = FIRST_STATE, ()
            self.next_word = iter(())
            return
        must(len(data) >= 4 and len(data) % 2 == 0, "a stream has a wrong size")
        (self.state,) = struct.unpack("<I", data[:4])
        self.words = struct.unpack(f"<{len(data) // 2 - 2}H", data[4:])
        must(self.state >= FIRST_STATE, "a stream begins with a wrong state")
        must(self.state != FIRST_STATE or self.words, "a stream without symbols has bytes")
        self.next_word = iter(self.words)

    def renormalise(self):
        if self.state < FIRST_STATE:
            word = next(self.next_word, None)
            must(word is not None, "a stream is too short")
            self.state = self.state * 65536 + word

    def get(self, context):
        table = self.tables.get(context)
        must(table is not None, f"a symbol has context {context}, which has no table")
        s = self.state % FREQUENCY_SUM
        token, frequency, start = table[s]
        self.state = frequency * (self.state // FREQUENCY_SUM) + s - start
        self.renormalise()
        if token < 16:
            return token
        n, e, done = (token - 16) // 4 + 2, 0, 0
        while done < n:
            k = min(n - done, 16)
            e += (self.state % (1 << k)) << done
            self.state >>= k
            self.renormalise()
            done += k
        return ((4 + token % 4) << n) + e

    def get_signed(self, context):
        return unzigzag(self.get(context))

    def flag(self, context):
        value = self.get(context)
        must(value <= 1, "a flag is neither 0 nor 1")
        return value

    def end(self):
        must(self.state == FIRST_STATE and next(self.next_word, None) is None, "a stream does not end with its last symbol")


# ---- 8 Section INDEX: index blocks ----------------------------------------------------------------------------------------

HalfArc = namedtuple("HalfArc", "arc reversed")
Root = namedtuple("Root", "filling loops low high children blocks")  # children: numbers; blocks: by level, those that are there
Block = namedtuple("Block", "error deviation triangle_count begins")
Arc = namedtuple("Arc", "ends new")  # new: number of new samples, by level


def uniform_level(root, is_top, level):
    """The level of the block of a root that is drawn where everything is drawn at a level (6.3), or None."""
    if not is_top and min(root.blocks) > level or root.children and max(root.blocks) < level:
        return None
    return max((l for l in root.blocks if l <= level), default=min(root.blocks))


class References:
    """Numbers of arcs or corners; d = 0 is a new one, which gets the next number."""

    def __init__(self, numbers):
        self.next, self.end = numbers.start, numbers.stop

    def get(self, d):
        must(d <= self.next, "a reference goes back too far")
        if d == 0:
            self.next += 1
            must(self.next <= self.end, "a cluster uses more new arcs or corners than it has")
        return self.next - max(d, 1)


def arc_runs(numbers, arcs, levels):
    """Runs of a cluster's arcs whose samples are coded together."""
    runs, run, samples = [], [], 0
    for number, arc in zip(numbers, arcs):
        run.append(number)
        samples += sum(arc.new[levels.index_arc_levels :])
        if samples >= levels.arc_run_samples:
            runs.append(run)
            run, samples = [], 0
    return runs + [run] if run else runs


class IndexBlock:
    """What one part of INDEX says about a cluster's roots, arcs and corners."""

    def __init__(self, part, cluster, top_count, section_levels, tables, step_log2):
        data = Bytes(part, "an index block")
        records = Stream(data.take(data.varint()), tables)
        self.arc_stream = Stream(data.take(data.varint()), tables)
        levels = section_levels.levels
        arcs, corners = References(cluster.arcs), References(cluster.corners)
        tolerance_codes = [code_at_least(level.tolerance, step_log2) for level in levels]
        self.roots, next_child = [], cluster.children.start
        for number in cluster.roots:
            root = read_root(records, cluster, arcs, next_child, section_levels.fillings, tolerance_codes)
            must(not root.children or next_child > number, "a root is its own child, or one of its children comes before it")
            next_child = root.children.stop
            self.roots.append(root)
        must(next_child == cluster.children.stop, "a cluster's roots have more or fewer children than it says")
        self.arcs, self.corner_levels = [], []
        for _ in cluster.arcs:
            self.arcs.append(read_arc(records, corners, self.corner_levels, len(levels)))
        records.end()
        must(arcs.next == arcs.end, "a cluster's roots do not use all of its arcs")
        must(corners.next == corners.end, "a cluster's arcs do not use all of its corners")
        self.arc_runs = arc_runs(cluster.arcs, self.arcs, section_levels)
        self.arc_parts, self.block_parts = [], []  # by level
        for l in range(len(levels)):
            in_pages = self.arc_runs if l >= section_levels.index_arc_levels else []
            self.arc_parts.append([read_part(data) for _ in in_pages])
            blocks = [root.blocks[l] for root in self.roots if l in root.blocks]
            must(not blocks or blocks[0].begins, "the first block of a level does not begin a stream")
            self.block_parts.append([read_part(data) for block in blocks if block.begins])
            sizes = [sum(part.length for part in parts[l]) for parts in (self.arc_parts, self.block_parts)]
            must(sizes[0] == cluster.pages[l].arc_bytes, "arc pages do not add up to their size in the cluster")
            must(sizes[1] == cluster.pages[l].block_bytes, "block pages do not add up to their size in the cluster")
        data.end()
        self.check_pages(cluster, top_count, len(levels), step_log2)

    def check_pages(self, cluster, top_count, level_count, step_log2):
        """Max errors and triangle counts of CLUSTERS follow from the drawn blocks (6.3)."""
        for l in range(level_count):
            worst, triangles = 0, 0
            for number, root in zip(cluster.roots, self.roots):
                drawn = uniform_level(root, number < top_count, l)
                if drawn is None:
                    continue
                block = root.blocks[drawn]
                error = block.error
                if drawn < l:
                    total = bound_sum(bound(error, step_log2), bound(block.deviation, step_log2))
                    error = code_at_least(total, step_log2)
                worst, triangles = max(worst, error), triangles + block.triangle_count
            worst = worst if triangles > 0 else 0
            must(cluster.pages[l].max_error == worst, "a cluster's max error is not that of its roots")
            must(cluster.pages[l].triangle_count == triangles, "a cluster's triangle count is not that of its roots")


def read_root(records, cluster, arcs, first_child, fillings, tolerance_codes):
    must(fillings, "a root has a filling, but LEVELS lists none")
    v = records.get(0)
    filling = fillings[v % len(fillings)]
    loops, half_arcs = [], 0
    for _ in range(v // len(fillings)):
        n = records.get(1)
        must(n >= 2, "a loop has less than two half-arcs")
        half_arcs += n
        must(half_arcs <= CLUSTER_ITEM_LIMIT, "a root has too many half-arcs for this decoder")
        codes = (records.get(2) for _ in range(n))
        loops.append([HalfArc(arcs.get(c // 2), c % 2) for c in codes])
    FILLINGS[filling].check_loops(loops)
    low, high = read_box(records, cluster)
    child_count = records.get(246)
    must(child_count < 2**32, "a root has too many children")
    present = records.get(4)
    must(present >> len(tolerance_codes) == 0, "a root has blocks at levels that are not there")
    must(present != 0, "a root has no block")
    blocks = {}
    for l, tolerance_code in enumerate(tolerance_codes):
        if present >> l & 1:
            error = error_code(records.get(5), tolerance_code)
            deviation = error_code(records.get(6), error)
            triangle_count = records.get(7)
            must(triangle_count < 2**32, "a block has too many triangles")
            blocks[l] = Block(error, deviation, triangle_count, records.flag(8))
    return Root(filling, loops, low, high, range(first_child, first_child + child_count), blocks)


def read_box(records, cluster):
    low = [records.get(3) for _ in range(3)]
    size = [records.get(3) for _ in range(3)]
    must(all(a + b <= 255 for a, b in zip(low, size)), "a root's box leaves that of its cluster")
    extent = [b - a for a, b in zip(cluster.low, cluster.high)]
    return (
        [b + e * a // 255 for b, e, a in zip(cluster.low, extent, low)],
        [b + (e * (a + s) + 254) // 255 for b, e, a, s in zip(cluster.low, extent, low, size)],
    )


def error_code(v, expected):
    if v == 0:
        return 0
    code = expected + unzigzag(v - 1)
    must(1 <= code <= 65535, "an error code is out of range")
    return code


def read_arc(records, corners, corner_levels, level_count):
    ends = []
    for _ in range(2):
        d = records.get(9)
        ends.append(corners.get(d))
        if d == 0:
            corner_levels.append(records.get(247 if corner_levels and corner_levels[-1] > 0 else 248))
            must(corner_levels[-1] < level_count, "a corner is a vertex from a level on that is not there")
    must(ends[0] != ends[1], "an arc ends where it begins")
    new = []
    for l in range(level_count):
        new.append(records.get(10 if l == 0 else 11 if new[-1] == 0 else 12))
    must(sum(new) <= 65535, "an arc has too many samples")
    return Arc(ends, new)


def check_loops(roots, arcs, corner_levels):
    for root in roots:
        for loop in root.loops:
            for half, after in zip(loop, loop[1:] + loop[:1]):
                to = arcs[half.arc].ends[1 - half.reversed]
                must(to == arcs[after.arc].ends[after.reversed], "half-arcs of a loop do not join")
            first = arcs[loop[0].arc].ends[loop[0].reversed]
            must(corner_levels[first] <= min(root.blocks), "a loop begins with a corner that is no vertex")


def check_tree(roots, extent_of_root):
    uses = Counter(half.arc for root in roots if not root.children for loop in root.loops for half in loop)
    for root in roots:
        check_group(root, [roots[number] for number in root.children], uses)
        for number in root.children:
            child = roots[number]
            must(min(child.blocks) == max(root.blocks) + 1, "a child's levels do not follow its parent's")
            for axis, extent in enumerate(extent_of_root[number]):
                reach = extent // 255 + 1  # boxes are rounded outward
                inside = root.low[axis] <= child.low[axis] + reach and child.high[axis] - reach <= root.high[axis]
                must(inside, "a child's box leaves its parent's")


def check_group(group, children, uses):
    """A group has the border of its children; arcs between them may be left out, and loops of arcs with one user, around holes that it closes."""
    if not children:
        return
    below = Counter(half for child in children for loop in child.loops for half in loop)
    own = Counter(half for loop in group.loops for half in loop)
    for arc in {half.arc for half in below | own}:
        sides = [HalfArc(arc, 0), HalfArc(arc, 1)]
        is_kept = all(own[side] == below[side] for side in sides)
        is_left_out = sum(own[side] for side in sides) == 0 and sum(below[side] for side in sides) == 2
        is_closed = not any(own[side] for side in sides) and uses[arc] == 1
        must(is_kept or is_left_out or is_closed, "a group has another border than its children")


def check_uses(roots, top_count, arcs, corner_levels, level_count):
    """How often arcs are used, and how corners are passed, where everything is drawn at a level."""
    for level in range(level_count):
        uses, passing = Counter(), {}
        for number, root in enumerate(roots):
            drawn = uniform_level(root, number < top_count, level)
            if drawn is None:
                continue
            used = [half.arc for loop in root.loops for half in loop]
            uses.update(used)
            for arc in used:
                for corner in arcs[arc].ends:
                    if corner_levels[corner] > drawn:
                        passing.setdefault(corner, set()).add(arc)
        must(all(uses[a] <= 2 for a in range(len(arcs))), "an arc is used three times")
        must(level < level_count - 1 or all(uses[a] >= 1 for a in range(len(arcs))), "an arc is used by no root")
        must(all(len(found) <= 2 for found in passing.values()), "three arcs end at a corner that is no vertex")


# ---- 10 Corners and arcs --------------------------------------------------------------------------------------------------

Knot = namedtuple("Knot", "parameter level size_class position")
WHOLE = 65536


def decode_corners(stream, cluster):
    corners, before = [], cluster.low
    for _ in cluster.corners:
        before = on_lattice(tuple(before[k] + stream.get_signed(13 + k) for k in range(3)))
        corners.append(before)
    return corners


def ends_of_arc(arc, corners):
    """The knots that an arc begins with: its corners."""
    a, b = arc.ends
    return [Knot(0, 0, 7, corners[a]), Knot(WHOLE, 0, 7, corners[b])]


def decode_samples(stream, knots, level, count, tangent_shift):
    """The knots of an arc with the new ones of a level."""
    left = count
    shortest = min(q.parameter - p.parameter for p, q in zip(knots, knots[1:]))
    width = WHOLE
    while width >= max(shortest, 2):
        # Knots of this width's middles are inserted at its end: all that is read here sees those from its beginning.
        by_parameter = {knot.parameter: knot for knot in knots}
        longer = []
        for k, (p, q) in enumerate(zip(knots, knots[1:])):
            longer.append(p)
            if q.parameter - p.parameter != width or left == 0:
                continue
            if stream.flag(split_context(knots, k, level, width)):
                left -= 1
                longer.append(decode_middle(stream, p, q, level, by_parameter, tangent_shift))
        longer.append(knots[-1])
        if len(longer) > len(knots):
            shortest = min(shortest, width // 2)
        knots = longer
        width //= 2
    must(left == 0, "an arc has fewer samples than its index says")
    return knots


def split_context(knots, k, level, width):
    p, q = knots[k], knots[k + 1]
    is_new = level > 0 and level in (p.level, q.level)
    shorter = int(k > 0 and p.parameter - knots[k - 1].parameter < width)
    shorter += int(k + 2 < len(knots) and knots[k + 2].parameter - q.parameter < width)
    depth = (WHOLE // width).bit_length() - 1
    return 16 + 12 * is_new + 4 * shorter + min(depth, 3)


def decode_middle(stream, p, q, level, by_parameter, tangent_shift):
    width = q.parameter - p.parameter
    # Of two neighbours one is an odd multiple of their distance: that is the one divisible by the smaller power of two.
    above = p if p.parameter & width else q
    f, point = forecast(p, q, by_parameter.get(p.parameter - width), by_parameter.get(q.parameter + width))
    r0 = stream.get_signed(40 + above.size_class)
    r1 = stream.get_signed(48 + min(abs(r0).bit_length(), 7))
    r2 = stream.get_signed(56 + above.size_class)
    moved = slide(f, point, r0, r1)
    position = lattice_point(lift(f, moved, r2 * 2**tangent_shift))
    size_class = min(max(abs(r0), abs(r1)).bit_length(), 6)
    return Knot((p.parameter + q.parameter) // 2, level, size_class, position)


def forecast(p, q, before, after):
    at_p, at_q = vector(p.position), vector(q.position)
    o = before and vector(before.position)
    r = after and vector(after.position)
    if o and r:
        point = scale(sub(scale(add(at_p, at_q), 9), add(o, r)), 0.0625)
    elif o:
        point = scale(sub(add(scale(at_p, 6), scale(at_q, 3)), o), 0.125)
    elif r:
        point = scale(sub(add(scale(at_q, 6), scale(at_p, 3)), r), 0.125)
    else:
        point = scale(add(at_p, at_q), 0.5)
    chord = sub(at_q, at_p)
    k = min(range(3), key=lambda axis: abs(chord[axis]))
    direction = tuple(1.0 if axis == k else 0.0 for axis in range(3))
    return frame(chord, direction), point


# ---- 11.1 Patches ---------------------------------------------------------------------------------------------------------


class Side:
    """A half-arc at a level: the corner where it begins (parameter 0), if it is a vertex, and its samples, in its direction."""

    def __init__(self, half_arc, knots, level, corner_level):
        points = [(knot.parameter, knot.position) for knot in knots if knot.level <= level]
        if half_arc.reversed:
            points = [(WHOLE - parameter, position) for parameter, position in reversed(points)]
        # without the corner where it ends
        self.points = points[:-1] if corner_level <= level else points[1:-1]


class Patch:
    def __init__(self, loops, triangle_count):
        """Loops are lists of sides."""
        self.loops, self.triangle_count = loops, triangle_count
        self.loop_sizes = [sum(len(side.points) for side in loop) for loop in loops]
        self.border = [p for loop in loops for side in loop for _, p in side.points]
        self.interior, self.triangles = [], []

    def add_triangle(self, a, b, c):
        must(a != b and b != c and c != a, "two vertices of a triangle are the same")
        must(len(self.triangles) < self.triangle_count, "a patch has more triangles than its index says")
        self.triangles.append((a, b, c))

    def check(self):
        must(len(self.triangles) == self.triangle_count, "a patch has fewer triangles than its index says")
        edges = Counter((t[k], t[(k + 1) % 3]) for t in self.triangles for k in range(3))
        first = 0
        for size in self.loop_sizes:
            for k in range(size):
                edge = (first + k, first + (k + 1) % size)
                must(edges[edge] == 1, "a border edge is not in exactly one triangle")
            first += size


# ---- 11.2 Fillings --------------------------------------------------------------------------------------------------------

Steps = namedtuple("Steps", "normal_shift tangent_shift")
FILLINGS = {}  # by code: a class that decodes a block, with its name


def read_steps(data):
    steps = Steps(data.number("B"), data.number("B"))
    must(max(steps) <= 40, f"a shift in {data.name} is above 40")
    return steps


# ---- 12.1 The cut-border machine ------------------------------------------------------------------------------------------

END_BOUNDS = (0.1, 0.25, 0.45, 0.65, 0.9, 1.2, 1.5)
START_BOUNDS = (1.9, 2.2, 3.0)
SIZE_BOUNDS = (2, 2.8, 4, 5.7, 8, 11.3, 16, 22.6)


def bound_class(x, bounds):
    return sum(b <= x for b in bounds)


class Slot:
    __slots__ = ("vertex", "next", "previous", "outer", "angle")

    def __init__(self, vertex, outer):
        self.vertex, self.outer = vertex, outer


class IrregularBlock:
    """Decodes a block into its patch."""

    name = "irregular"

    @staticmethod
    def check_loops(loops):
        """Every topology is possible."""

    def __init__(self, stream, patch, steps, _state):
        self.stream, self.patch = stream, patch
        self.points = list(patch.border)  # integers: border, then interior
        self.pos = [vector(p) for p in self.points]
        self.nor, self.stack, self.walked = [], [], 0
        for size in patch.loop_sizes:
            self.stack.append(self.border_loop(size))
        self.stack.reverse()  # the first loop lies on top, and the end of the list is the top
        head = stream.get(64)
        components, refinement = head // 4, head % 4
        self.normal_step = 2.0**steps.normal_shift
        self.tangent_step = 2.0 ** (steps.normal_shift + max(steps.tangent_shift - refinement, 0))
        while True:
            while self.stack:
                self.fill_loop(*self.stack.pop())
            if components == 0:
                break
            components -= 1
            self.seed()
        patch.interior = self.points[len(patch.border) :]

    def border_loop(self, m):
        must(m >= 3, "a border loop has less than three vertices")
        first = len(self.nor)
        points = self.pos[first : first + m]
        area = (0.0, 0.0, 0.0)
        for k in range(m - 1):
            area = add(area, cross(sub(points[k], points[0]), sub(points[k + 1], points[0])))
        self.nor += [scale(area, 2.0**-20)] * m
        slots = [Slot(first + k, None) for k in range(m)]
        return self.ring(slots), m

    def ring(self, slots):
        for k, slot in enumerate(slots):
            slots[k - 1].next, slot.previous = slot, slots[k - 1]
        for slot in slots:
            self.measure(slot)
        return slots[0]

    def add_vertex(self, point):
        self.points.append(point)
        self.pos.append(vector(point))
        self.nor.append((0.0, 0.0, 0.0))
        must(len(self.points) <= 2**31, "a patch has too many vertices")
        return len(self.points) - 1

    def seed(self):
        last, new = self.points[-1] if self.points else (0, 0, 0), []
        for _ in range(3):
            last = on_lattice(tuple(last[k] + self.stream.get_signed(65) * int(self.normal_step) for k in range(3)))
            new.append(self.add_vertex(last))
        a, b, c = new
        self.add_triangle(a, b, c)
        self.stack.append((self.ring([Slot(a, b), Slot(c, a), Slot(b, c)]), 3))

    def add_triangle(self, a, b, c):
        self.patch.add_triangle(a, b, c)
        n = cross(sub(self.pos[b], self.pos[a]), sub(self.pos[c], self.pos[a]))
        for v in (a, b, c):
            self.nor[v] = add(self.nor[v], n)

    def measure(self, slot):
        v = slot.vertex
        leaving = sub(self.pos[slot.next.vertex], self.pos[v])
        entering = sub(self.pos[slot.previous.vertex], self.pos[v])
        squares = dot(leaving, leaving) * dot(entering, entering)
        if squares == 0:
            slot.angle = 2.0
        else:
            cosine = dot(leaving, entering) / math.sqrt(squares)
            turn = dot(cross(leaving, entering), self.nor[v])
            slot.angle = 1 - cosine if turn >= 0 else 3 + cosine

    def fill_loop(self, gate, length):
        operations = (self.new, self.next, self.previous, self.split, self.union)
        while length > 2:
            gate = sharpest(gate)
            end, start = bound_class(gate.next.angle, END_BOUNDS), bound_class(gate.angle, START_BOUNDS)
            operation = self.stream.get(69 + 4 * end + start)
            must(operation < len(operations), "an operation is unknown")
            gate, length = operations[operation](gate, length)

    def new(self, g, length):
        h = g.next
        c = self.add_vertex(self.new_vertex(g))
        self.add_triangle(g.vertex, h.vertex, c)
        s = Slot(c, g.vertex)
        s.next, s.previous = h, g
        g.next, g.outer, h.previous = s, h.vertex, s
        for slot in (g, s, h):
            self.measure(slot)
        return s, length + 1

    def next(self, g, length):
        h = g.next
        e = h.next
        self.add_triangle(g.vertex, h.vertex, e.vertex)
        g.next, g.outer, e.previous = e, h.vertex, g
        self.measure(g)
        self.measure(e)
        return g, length - 1

    def previous(self, g, length):
        h, d = g.next, g.previous
        self.add_triangle(d.vertex, g.vertex, h.vertex)
        d.next, d.outer, h.previous = h, g.vertex, d
        self.measure(d)
        self.measure(h)
        return d, length - 1

    def split(self, g, length):
        o = self.stream.get_signed(66)
        offset = o + 2 if o >= 0 else o - 1
        must(2 <= abs(offset) <= (length - 1) // 2, "a split reaches too far")
        far = self.walk(g.next if offset > 0 else g, offset)
        s = self.bridge(g, far)
        ahead = offset if offset > 0 else length - 1 - abs(offset)
        self.stack.append((g, length - ahead))
        return s, ahead + 1

    def union(self, g, length):
        index, offset = self.stream.get(67), self.stream.get_signed(68)
        must(index < len(self.stack), "a union names a loop that is not there")
        place = len(self.stack) - 1 - index
        other, other_length = self.stack[place]
        self.stack[place] = self.stack[-1]
        self.stack.pop()
        must(abs(offset) <= other_length // 2, "a union reaches too far")
        s = self.bridge(g, self.walk(other, offset))
        return s, length + other_length + 1

    def bridge(self, g, far):
        h, e = g.next, far.previous
        a, b, c = g.vertex, h.vertex, far.vertex
        self.add_triangle(a, b, c)
        s = Slot(c, a)
        s.next, s.previous = h, e
        e.next = h.previous = s
        far.previous, g.next, g.outer = g, far, b
        for slot in (g, far, s, h):
            self.measure(slot)
        return s

    def walk(self, slot, offset):
        self.walked += abs(offset)
        must(self.walked <= 64 * len(self.points), "a patch walks too far")
        for _ in range(abs(offset)):
            slot = slot.next if offset > 0 else slot.previous
        return slot

    # -- 12.2 New vertices --

    def new_vertex(self, g):
        pos, h = self.pos, g.next
        a, b, n = g.vertex, h.vertex, h.next.vertex
        gate_edge, next_edge = sub(pos[b], pos[a]), sub(pos[n], pos[b])
        f = frame(add(self.nor[a], self.nor[b]), gate_edge)

        reach = dot(gate_edge, f.along)
        x, y = dot(next_edge, f.along), dot(next_edge, f.across)
        span = math.sqrt(x * x + y * y)
        d0, d1 = -0.5, 0.8660254037844386
        if h.angle < 1.875 and span > 0:
            b0, b1 = x - span, y
            size = math.sqrt(b0 * b0 + b1 * b1)
            if size > 0:
                d0, d1 = b0 / size, b1 / size
        length = (reach + span) * 0.5
        point = slide(f, pos[b], length * d0, length * d1)
        height = abs(dot(next_edge, f.normal)) + 2 * abs(dot(gate_edge, f.normal))
        if g.outer is not None:
            behind = sub(pos[a], pos[g.outer])
            height = height + abs(dot(behind, f.normal))
            point = add(scale(point, 0.5), scale(add(behind, add(pos[a], pos[n])), 0.25))

        t = bound_class(length / self.tangent_step, SIZE_BOUNDS)
        u = bound_class(height / self.normal_step, SIZE_BOUNDS)
        r0, r1, r2 = (self.stream.get_signed(context) for context in (101 + t, 110 + t, 119 + u))
        moved = slide(f, point, r0 * self.tangent_step, r1 * self.tangent_step)
        bend = 0.25 * (self.plane_height(f, moved, a) + self.plane_height(f, moved, b))
        level = lift(f, moved, bend)
        return lattice_point(lift(f, level, r2 * self.normal_step))

    def plane_height(self, f, p, v):
        m = self.nor[v]
        upright = dot(m, f.normal)
        if upright > 0 and upright * upright > 0.1 * dot(m, m):
            away = sub(p, self.pos[v])
            return dot(away, f.normal) - dot(away, m) / upright
        return 0.0


def sharpest(gate):
    candidates = (gate, gate.next, gate.previous, gate.next.next, gate.previous.previous)
    return min(candidates, key=lambda s: s.next.angle)  # the first of equals


# ---- 13.1 Quads, cells, sites ---------------------------------------------------------------------------------------------

U = 32768
MAX_DEPTH = 12
CENTRE = (0, 0, 0)


class Cell(namedtuple("Cell", "quad depth x y")):
    @property
    def size(self):
        return U >> self.depth

    def corners(self):
        x, y, s = self.x, self.y, self.size
        return [(x, y), (x + s, y), (x + s, y + s), (x, y + s)]

    def children(self):
        x, y, h = self.x, self.y, self.size // 2
        return [Cell(self.quad, self.depth + 1, *at) for at in ((x, y), (x + h, y), (x + h, y + h), (x, y + h))]


def middle(a, b):
    return ((a[0] + b[0]) // 2, (a[1] + b[1]) // 2)


class Node:
    def __init__(self, cell, magnitude):
        self.cell, self.magnitude, self.is_split = cell, magnitude, False


class GridState:
    """What a root's grid carries from level to level."""

    def __init__(self):
        self.shape, self.nodes, self.points, self.sites, self.centre_magnitude = 0, [], [], {}, 0


def magnitude_class(m):
    return (m >= 2) + (m >= 4) + (m >= 8)


def size_class(m):
    return min(m.bit_length(), 7)


# ---- 13.2 Decoding a block ------------------------------------------------------------------------------------------------


class GridBlock:
    """Decodes a block into its patch. `state` is what the root's coarser blocks left behind, empty at first."""

    name = "grid"

    @staticmethod
    def check_loops(loops):
        must(len(loops) == 1 and 3 <= len(loops[0]) <= 4096, "a grid is no disk of 3 to 4096 sides")

    def __init__(self, stream, patch, steps, state):
        self.stream, self.patch, self.state = stream, patch, state.setdefault(self.name, GridState())
        self.sides = patch.loops[0]
        self.n = len(self.sides)
        must(all(side.points and side.points[0][0] == 0 for side in self.sides), "a corner of a grid is no vertex")
        self.normal_step = 2.0**steps.normal_shift
        self.tangent_step = 2.0 ** (steps.normal_shift + steps.tangent_shift)
        self.border = {}  # vertex by (side, parameter)
        for i, side in enumerate(self.sides):
            for parameter, _ in side.points:
                self.border[i, parameter] = len(self.border)
        self.decode()
        patch.interior = list(self.state.points)
        self.draw()

    def place(self, i, x, y):
        """A border place (side, parameter) or a site (quad, x, y)."""
        n = self.n
        if y == U:
            return (i % n, U - x)
        if x == U:
            return ((i - 1) % n, U + y)
        if x == y == 0:
            return CENTRE
        if y == 0:
            return ((i - 1) % n, 0, x)
        return (i % n, x, y)

    def vertex(self, i, at):
        """Number of the vertex at coordinates of a quad, or None if it is not there."""
        place = self.place(i, *at)
        if len(place) == 2:
            return self.border.get(place)
        site = self.state.sites.get(place)
        return None if site is None else len(self.patch.border) + site

    def position(self, vertex):
        border = self.patch.border
        return vector(border[vertex] if vertex < len(border) else self.state.points[vertex - len(border)])

    def decode(self):
        state, stream = self.state, self.stream
        state.shape += stream.get(128 + state.shape)
        must(state.shape <= 2, "the shape of a grid is unknown")
        if state.shape >= 1 and not state.points:
            self.decode_centre()
        if state.shape < 2:
            return
        if not state.nodes:
            for i in range(self.n):
                must((i, U) in self.border, "a side of a grid has no sample in its middle")
            state.nodes = [Node(Cell(i, 0, 0, 0), state.centre_magnitude) for i in range(self.n)]
        candidates = [[] for _ in range(MAX_DEPTH + 1)]
        for node in state.nodes:
            if not node.is_split:
                candidates[node.cell.depth].append((node, 0))
        for d in range(MAX_DEPTH):
            for node, is_new in candidates[d]:
                self.examine(node, is_new, candidates[d + 1])

    def examine(self, node, is_new, next_candidates):
        """Splits a node's cell where the stream says so."""
        cell = node.cell
        corners = cell.corners()
        must(all(self.vertex(cell.quad, at) is not None for at in corners), "a corner of a cell is not there")
        finer = 0
        for e in range(4):
            at = middle(corners[e], corners[(e + 1) % 4])
            is_there = self.vertex(cell.quad, at) is not None
            if len(self.place(cell.quad, *at)) == 2:
                if not is_there:
                    return
            else:
                finer += is_there
        if not self.stream.flag(134 + 16 * is_new + 4 * magnitude_class(node.magnitude) + min(finer, 3)):
            return
        node.magnitude, node.is_split = self.split(node), True
        children = [Node(cell, node.magnitude) for cell in cell.children()]
        self.state.nodes += children
        next_candidates += [(child, 1) for child in children]

    def decode_centre(self):
        chain = []
        for side in self.sides:
            chain += [vector(position) for parameter, position in side.points if parameter in (0, U)]
        total = (0.0, 0.0, 0.0)
        for p in chain:
            total = add(total, p)
        mean = scale(total, 1 / len(chain))
        area = (0.0, 0.0, 0.0)
        for p, q in zip(chain, chain[1:] + chain[:1]):
            area = add(area, cross(sub(p, mean), sub(q, mean)))
        f = frame(area, sub(chain[0], mean))
        self.state.centre_magnitude = self.decode_vertex(CENTRE, mean, f, (131, 132, 132, 133, 133))

    def split(self, node):
        cell, old, total, count = node.cell, node.magnitude, 0, 0
        corners = cell.corners()
        c = [self.position(self.vertex(cell.quad, at)) for at in corners]
        across = cross(sub(c[2], c[0]), sub(c[3], c[1]))

        def size():
            shown = total // count if count > 0 else old
            return size_class(2 * shown // 3 + (old + 2) // 3)

        m = []
        for e in range(4):
            at = middle(corners[e], corners[(e + 1) % 4])
            if self.vertex(cell.quad, at) is None:
                k = size()
                contexts = (166 + k, 182 + 4 * k, 182 + 4 * k + 1, 182 + 4 * k + 2, 182 + 4 * k + 3)
                f = frame(across, sub(c[(e + 1) % 4], c[e]))
                total += self.decode_vertex(self.place(cell.quad, *at), self.edge_middle(cell, e), f, contexts)
                count += 1
            m.append(self.position(self.vertex(cell.quad, at)))
        k = size()
        contexts = (174 + k, 214 + 4 * k, 214 + 4 * k + 1, 214 + 4 * k + 2, 214 + 4 * k + 3)
        edges = scale(add(add(m[0], m[1]), add(m[2], m[3])), 0.5)
        prediction = sub(edges, scale(add(add(c[0], c[1]), add(c[2], c[3])), 0.25))
        f = frame(cross(sub(m[1], m[3]), sub(m[2], m[0])), sub(m[1], m[3]))
        site = self.place(cell.quad, *middle(corners[0], corners[2]))
        total += self.decode_vertex(site, prediction, f, contexts)
        return total // (count + 1)

    def edge_middle(self, cell, e):
        start, end = cell.corners()[e], cell.corners()[(e + 1) % 4]
        at_a, at_b = (self.position(self.vertex(cell.quad, at)) for at in (start, end))
        # From the middle by 1.5 sizes is a whole size beyond either end.
        step = (end[0] - start[0], end[1] - start[1])

        def beyond(at, sign):
            at = (at[0] + sign * step[0], at[1] + sign * step[1])
            if not (0 <= at[0] <= U and 0 <= at[1] <= U):
                return None
            vertex = self.vertex(cell.quad, at)
            return None if vertex is None else self.position(vertex)

        before, after = beyond(start, -1), beyond(end, 1)
        if before and after:
            return sub(scale(add(at_a, at_b), 0.5625), scale(add(before, after), 0.0625))
        if before:
            return add(add(scale(at_a, 0.75), scale(at_b, 0.375)), scale(before, -0.125))
        if after:
            return add(add(scale(at_b, 0.75), scale(at_a, 0.375)), scale(after, -0.125))
        return scale(add(at_a, at_b), 0.5)

    def decode_vertex(self, site, prediction, f, contexts):
        """Adds the vertex of a site; how large its residual was."""
        normal, first_if_0, first, second_if_0, second = contexts
        r0 = self.stream.get_signed(normal)
        r1 = self.stream.get_signed(first_if_0 if r0 == 0 else first)
        r2 = self.stream.get_signed(second_if_0 if r0 == 0 else second)
        moved = slide(f, prediction, r1 * self.tangent_step, r2 * self.tangent_step)
        self.state.sites[site] = len(self.state.points)
        self.state.points.append(lattice_point(lift(f, moved, r0 * self.normal_step)))
        return abs(r0) + (abs(r1) + abs(r2)) // 2

    # -- 13.3 Polygons: lists of (vertex, lines) --

    def draw(self):
        if self.state.shape == 0:
            polygons = [[v for i in range(self.n) for v in self.side_vertices(i, -1, WHOLE, i, (i, (i - 1) % self.n))]]
        elif self.state.shape == 1:
            polygons = (self.fan_polygon(i) for i in range(self.n))
        else:
            polygons = (self.cell_polygon(node.cell) for node in self.state.nodes if not node.is_split)
        for polygon in polygons:
            positions = [self.position(vertex) for vertex, _ in polygon]
            for t in Polygon(positions, [lines for _, lines in polygon]).triangulate():
                self.patch.add_triangle(*(polygon[k][0] for k in t))

    def side_vertices(self, i, low, high, line, corner_lines):
        """Vertices of a side strictly between two parameters; corner i, if it is among them, has lines of its own."""
        parameters = [parameter for parameter, _ in self.sides[i % self.n].points if low < parameter < high]
        return [(self.border[i % self.n, t], (line, line) if t > 0 else corner_lines) for t in parameters]

    def fan_polygon(self, i):
        centre = (self.vertex(i, (0, 0)), (2, 0))
        end = (self.border[(i + 1) % self.n, 0], (1, 2))
        return [centre] + self.side_vertices(i, -1, WHOLE, 1, (0, 1)) + [end]

    def cell_polygon(self, cell):
        polygon, corners, size = [], cell.corners(), cell.size
        for e in range(4):
            a, b = corners[e], corners[(e + 1) % 4]
            polygon.append((self.vertex(cell.quad, a), (e, (e - 1) % 4)))
            if e == 1 and cell.x + size == U:
                polygon += self.side_vertices(cell.quad - 1, U + a[1], U + b[1], e, None)
            elif e == 2 and cell.y + size == U:
                polygon += self.side_vertices(cell.quad, U - a[0], U - b[0], e, None)
            else:
                polygon += [(v, (e, e)) for v in self.between(cell.quad, a, b)]
        return polygon

    def between(self, i, a, b):
        if abs(a[0] - b[0]) + abs(a[1] - b[1]) < 2:
            return []
        m = middle(a, b)
        vertex = self.vertex(i, m)
        if vertex is None:
            return []
        return self.between(i, a, m) + [vertex] + self.between(i, m, b)


# ---- 13.4 Triangles of a polygon ------------------------------------------------------------------------------------------


class Polygon:
    def __init__(self, positions, lines):
        self.p, self.lines, self.triangles = positions, [set(pair) for pair in lines], []

    def flat(self, a, b, c):
        return bool(self.lines[a] & self.lines[b] & self.lines[c])

    def shared(self, a, b):
        return bool(self.lines[a] & self.lines[b])

    def square(self, a, b):
        d = sub(self.p[a], self.p[b])
        return dot(d, d)

    def triangulate(self):
        m = len(self.p)
        if m < 3:
            return []
        if m == 3:
            return [(0, 1, 2)]
        if m == 4 and not any(self.flat(k, (k + 1) % 4, (k + 2) % 4) for k in range(4)):
            if self.square(1, 3) <= self.square(0, 2):
                return [(0, 1, 3), (1, 2, 3)]
            return [(0, 1, 2), (0, 2, 3)]
        self.pieces(list(range(m)))
        return self.triangles

    def pieces(self, P):
        N = len(P)
        if N <= 48:
            self.optimal(P)
            return
        half = N // 2
        for s in range(N):
            if not self.shared(P[s], P[(s + half) % N]):
                self.pieces([P[(s + j) % N] for j in range(half + 1)])
                self.pieces([P[(s + half + j) % N] for j in range(N - half + 1)])
                return
        self.triangles += [(P[0], P[j], P[j + 1]) for j in range(1, N - 1)]

    def optimal(self, P):
        N = len(P)
        cost = [[0.0] * N for _ in range(N)]
        apex = [[0] * N for _ in range(N)]
        for span in range(2, N):
            for i in range(N - span):
                j = i + span
                least, apex[i][j] = math.inf, i + 1
                for k in range(i + 1, j):
                    if self.flat(P[i], P[k], P[j]):
                        continue
                    c = cost[i][k] + cost[k][j]
                    if c < least:
                        least, apex[i][j] = c, k
                base = self.square(P[i], P[j]) if span < N - 1 else 0.0
                cost[i][j] = least + base

        def emit(i, j):
            if j < i + 2:
                return
            k = apex[i][j]
            self.triangles.append((P[i], P[k], P[j]))
            emit(i, k)
            emit(k, j)

        emit(0, N - 1)


FILLINGS.update({0: IrregularBlock, 1: GridBlock})


# ---- A whole file ---------------------------------------------------------------------------------------------------------


# ---- 20.1 Section CHANNELS ------------------------------------------------------------------------------------------------

Channel = namedtuple("Channel", "name kind components low step bound")
KINDS = {1: "colour", 2: "scalar", 3: "normal", 4: "label", 5: "factor", 6: "drawing"}
KINDS |= {7: "exact colour", 8: "exact normal", 9: "exact factor"}
COLOURS, NORMALS = (1, 7), (3, 8)
CODED_AS_COLOURS, CODED_EXACTLY = (1, 3, 5), (7, 8, 9)


class Channels:
    def __init__(self, section):
        data = Bytes(section, "CHANNELS")
        count = data.varint()
        must(1 <= count <= 64, "there are not 1 to 64 channels")
        self.channels, self.stream_bytes = [], [data.varint()]  # the latter: of maps, then of the images of each channel
        for _ in range(count):
            try:
                name = data.take(data.varint()).decode("utf-8")
            except UnicodeDecodeError:
                raise Damaged("the name of a channel is not UTF-8") from None
            must(1 <= len(name.encode("utf-8")) <= 255, "the name of a channel does not have 1 to 255 bytes")
            must(not any(c < " " or "\x7f" <= c <= "\x9f" for c in name), "the name of a channel has control characters")
            must(name not in [c.name for c in self.channels], "two channels have the same name")
            channel = Channel(name, *(data.number(code) for code in "BBddd"))
            must(1 <= channel.components <= 4, "a channel does not have 1 to 4 components")
            must(channel.kind not in COLOURS or channel.components >= 3, "a colour does not have 3 or 4 components")
            must(channel.kind not in NORMALS or channel.components == 2, "a normal does not have two components")
            must(channel.kind != 6 or channel.components == 1, "a drawing does not have one component")
            must(channel.kind != 6 or (channel.low, channel.step) == (0, 1), "drawings do not count from 0 in steps of 1")
            must(channel.kind != 6 or 6 not in [c.kind for c in self.channels], "two channels say how the surface is drawn")
            must(channel.step > 0, "the step of a channel is not above 0")
            must(channel.bound >= 0, "the bound of a channel is negative")
            self.channels.append(channel)
            self.stream_bytes.append(data.varint())
        data.end()


# ---- 20.2 Section TEXELS --------------------------------------------------------------------------------------------------

CHUNK_CLUSTERS = 256


def read_texels(section, channels, index):
    """The texel streams of all blocks: by root a dictionary of lists, by level."""
    stream_count = len(channels.stream_bytes)
    entries, ends = read_texel_table(section, len(index))
    texels, sums = [], [0] * stream_count
    data = Bytes(section, "TEXELS")
    data.take(16 * len(index) + 12 * -(-len(index) // CHUNK_CLUSTERS))
    for block, (offset, length, crc), end in zip(index, entries, ends):
        must(offset == data.at, "the texels of a cluster do not begin where those before end")
        directory = Bytes(data.take(length), "a texel directory")
        must(crc == (zlib.crc32(directory.data) if length > 0 else 0), "the checksum of a texel directory is wrong")
        keys = sorted((l, k) for k, root in enumerate(block.roots) for l in root.blocks)
        of_cluster = [{} for _ in block.roots]
        parts = {key: [read_part(directory) for _ in range(stream_count)] if length > 0 else [Part(0, 0)] * stream_count for key in keys}
        directory.end()
        for (l, k), of_block in parts.items():
            of_cluster[k][l] = [data.take(part.length) for part in of_block]
            for number, (part, stream) in enumerate(zip(of_block, of_cluster[k][l])):
                must(part.length == 0 or zlib.crc32(stream) == part.crc, "the checksum of a texel stream is wrong")
                sums[number] += part.length
        must(data.at == end, "the texels of a cluster do not have the size that the table gives")
        must(length == 0 or end > offset + length, "a texel directory has only empty streams")
        texels += of_cluster
    data.end()
    must(sums == channels.stream_bytes, "the texels do not have the sizes that CHANNELS gives")
    return texels


def read_texel_table(section, cluster_count):
    """Offset, length and checksum of each directory, and where the texels of each cluster end."""
    data, entries, ends = Bytes(section, "the texel table"), [], []
    for first in range(0, cluster_count, CHUNK_CLUSTERS):
        start = data.at
        of_chunk = [(data.number("Q"), data.number("I"), data.number("I")) for _ in range(min(CHUNK_CLUSTERS, cluster_count - first))]
        end = data.number("Q")
        chunk = data.data[start : data.at]
        must(data.number("I") == zlib.crc32(chunk), "the checksum of a chunk of the texel table is wrong")
        entries += of_chunk
        ends += [offset for offset, _, _ in of_chunk[1:]] + [end]
    return entries, ends


# ---- 21.1 Bits ------------------------------------------------------------------------------------------------------------


class Chance:
    def __init__(self):
        self.fast = self.slow = 32768


class NumberChances:
    def __init__(self):
        self.unary, self.length = [Chance() for _ in range(16)], [Chance() for _ in range(32)]


class BitStream:
    def __init__(self, data):
        self.data, self.at, self.range = data, 0, 2**32 - 1
        self.code = 0
        for _ in range(4):
            self.code = self.code * 256 + self.byte()

    def byte(self):
        self.at += 1
        return self.data[self.at - 1] if self.at <= len(self.data) else 0

    def below(self, bound):
        yes = self.code < bound
        if yes:
            self.range = bound
        else:
            self.code, self.range = self.code - bound, self.range - bound
        while self.range < 2**24:
            self.range, self.code = self.range * 256, self.code * 256 + self.byte()
        return yes

    def bit(self, chance):
        b = 0 if self.below((self.range >> 12) * ((chance.fast + chance.slow) >> 5)) else 1
        if b == 0:
            chance.fast += (65535 - chance.fast) >> 4
            chance.slow += (65535 - chance.slow) >> 7
        else:
            chance.fast -= chance.fast >> 4
            chance.slow -= chance.slow >> 7
        return b

    def raw(self, count):
        value = 0
        for _ in range(count):
            value = 2 * value + (0 if self.below(self.range >> 1) else 1)
        return value

    def number(self, chances):
        for v in range(16):
            if self.bit(chances.unary[v]) == 0:
                return v
        k = 0
        while self.bit(chances.length[k]) == 1:
            k += 1
            must(k < 32, "a number among texels exceeds 32 bits")
        value = 15 + 2**k + self.raw(k)
        must(value < 2**32, "a number among texels exceeds 32 bits")
        return value

    def signed(self, chances):
        return unzigzag(self.number(chances))

    def end(self):
        must(self.at <= len(self.data) + 5, "texels end early")
        must(self.at >= len(self.data), "texels have bytes left over")


# ---- 21.2 Maps ------------------------------------------------------------------------------------------------------------

TURNS = [
    (1.0, 0.0),
    (0.9807852804032304, 0.19509032201612827),
    (0.9238795325112867, 0.3826834323650898),
    (0.8314696123025452, 0.5555702330196022),
    (0.7071067811865476, 0.7071067811865475),
    (0.5555702330196023, 0.8314696123025452),
    (0.3826834323650898, 0.9238795325112867),
    (0.19509032201612833, 0.9807852804032304),
]


FINE_TURNS = [
    (1.0, 0.0),
    (0.9996988186962042, 0.024541228522912288),
    (0.9987954562051724, 0.049067674327418015),
    (0.9972904566786902, 0.07356456359966743),
    (0.9951847266721969, 0.0980171403295606),
    (0.99247953459871, 0.1224106751992162),
    (0.989176509964781, 0.14673047445536175),
    (0.9852776423889412, 0.17096188876030122),
]


def turned(along, across, turn):
    c, s = turn
    return add(scale(along, c), scale(across, s)), sub(scale(across, c), scale(along, s))


def texel_size(exponent):
    e = min(exponent, 127)
    return float(2 ** (e // 2)) * (1.4142135623730951 if e % 2 == 1 else 1.0)


class Map:
    """The map of a block: `place(triangle, point)` says where a point of a triangle lies."""

    def __init__(self, data, patch):
        bits = BitStream(data)
        exponent = bits.raw(7)
        piece_count = bits.number(NumberChances()) + 1
        must(piece_count <= min(len(patch.triangles), 65535), "a map has more pieces than its patch has triangles")
        width = bits.number(NumberChances())
        self.axes, self.normals, self.sizes = [], [], []
        for _ in range(piece_count):
            first, larger, longer, is_down, fine_turn = bits.raw(6), 0, 0, 0, None
            if first == 63:
                larger, first = bits.raw(5), bits.raw(6)
            if first == 63:
                longer, is_down, fine_turn, first = bits.raw(4), bits.raw(1), bits.raw(3), bits.raw(6)
            texel = [texel_size(exponent + larger + (longer if is_down == k else 0)) for k in range(2)]
            axis = (first - 31, bits.raw(6) - 31, bits.raw(6) - 31)
            must(max(axis) <= 31 and axis != (0, 0, 0), "a piece of a map has no axis")
            k = min(range(3), key=lambda k: abs(axis[k]))
            f = frame(vector(axis), tuple(1.0 if j == k else 0.0 for j in range(3)))
            u, v = turned(f.along, f.across, TURNS[bits.raw(3)])
            if fine_turn is not None:
                u, v = turned(u, v, FINE_TURNS[fine_turn])
            self.axes.append((scale(u, 1 / texel[0]), scale(v, 1 / texel[1])))
            self.normals.append(f.normal)
            self.sizes.append(tuple(texel))
        self.labels = decode_labels(bits, piece_count, patch.triangles)
        bits.end()
        points = [vector(p) for p in patch.border + patch.interior]
        self.place_pieces(width, points, patch.triangles)

    def place_pieces(self, width, points, triangles):
        lows = [[float("inf")] * 2 for _ in self.axes]
        highs = [[float("-inf")] * 2 for _ in self.axes]
        for label, triangle in zip(self.labels, triangles):
            for corner in triangle:
                for k in range(2):
                    product = dot(points[corner], self.axes[label][k])
                    lows[label][k] = min(lows[label][k], product)
                    highs[label][k] = max(highs[label][k], product)
        must(all(low[0] != float("inf") for low in lows), "a piece of a map has no triangle")
        left = top = height = 0
        self.offsets, self.ranges = [], []
        for low, high in zip(lows, highs):
            w, h = (math.floor(b) - math.floor(a) + 3 for a, b in zip(low, high))
            must(max(w, h) <= 16384, "a piece of a map is longer than 16384 texels")
            must(w <= width, "the pieces of a map do not fit into its width")
            if left + w > width:
                left, top, height = 0, top + height, 0
            self.offsets.append(tuple(float(place) + 1.0 - math.floor(a) for place, a in zip((left, top), low)))
            self.ranges.append(((left + 0.5, left + w - 0.5), (top + 0.5, top + h - 0.5)))
            left, height = left + w, max(height, h)
        self.width, self.height = width, top + height
        must(max(self.width, self.height) <= 16384, "a map is longer than 16384 texels")

    def place(self, triangle, point):
        label = self.labels[triangle]
        places = (dot(vector(point), axis) + offset for axis, offset in zip(self.axes[label], self.offsets[label]))
        return tuple(min(max(x, low), high) for x, (low, high) in zip(places, self.ranges[label]))


def decode_labels(bits, piece_count, triangles):
    if piece_count == 1:
        return [0] * len(triangles)
    is_first, is_second, label_of, labels = [Chance(), Chance()], Chance(), {}, []
    for a, b, c in triangles:
        edges = [frozenset(edge) for edge in ((a, b), (b, c), (c, a))]
        found = [label_of[edge] for edge in edges if edge in label_of]
        if len(found) == 3 and found[1] == found[2] != found[0]:
            expected = [found[1], found[0]]
        else:
            expected = found[:1] + [x for x in found[1:] if x != found[0]][:1]
        label = None
        if expected and bits.bit(is_first[len(expected) - 1]) == 1:
            label = expected[0]
        elif len(expected) == 2 and bits.bit(is_second) == 1:
            label = expected[1]
        else:
            label = bits.raw((piece_count - 1).bit_length())
        must(label < piece_count, "a triangle names a piece of a map that does not exist")
        label_of.update({edge: label for edge in edges})
        labels.append(label)
    return labels


# ---- 21.3 Colours ---------------------------------------------------------------------------------------------------------


def cosine(k, n):
    weight = math.sqrt(1 / 8) if k == 0 else 0.5
    return round(4096 * weight * math.cos((2 * n + 1) * k * math.pi / 16))


COSINES = [[cosine(k, n) for n in range(8)] for k in range(8)]
DIAGONALS = [[(y, d - y) for y in range(8) if 0 <= d - y < 8] for d in range(15)]
ORDER = [8 * y + x for d, cells in enumerate(DIAGONALS) for y, x in (cells if d % 2 == 1 else cells[::-1])]


def band(i):
    return 0 if i <= 2 else 1 if i <= 9 else 2 if i <= 27 else 3


def within(i):
    return [i, i - 3, min(i - 10, 15), min((i - 28) // 3, 15)][band(i)]


class PlaneChances:
    def __init__(self):
        self.constant = [NumberChances() for _ in range(4)]
        self.more = [[Chance() for _ in range(16)] for _ in range(4)]
        self.significant = [[[Chance() for _ in range(3)] for _ in range(16)] for _ in range(4)]
        self.magnitude = [[NumberChances() for _ in range(3)] for _ in range(4)]


def decode_colours(data, width, height, components):
    """Rows of texels; None for those that are not coded."""
    must(len(data) > 0, "an image has no bytes")
    step = data[0]
    if step == 0:
        must(len(data) == 1 + components, "an image of one colour does not have the bytes of one")
        return [[tuple(data[1:])] * width for _ in range(height)]
    bits = BitStream(data[1:])
    skip_chances, kinds = [Chance() for _ in range(3)], [PlaneChances(), PlaneChances()]
    is_difference = [components >= 3 and c in (1, 2) for c in range(components)]
    rows, known = [[None] * width for _ in range(height)], {}
    for block_row in range((height + 7) // 8):
        for column in range((width + 7) // 8):
            left, above = known.get((block_row, column - 1)), known.get((block_row - 1, column))
            coded = [block for block in (left, above) if block is not None]
            if bits.bit(skip_chances[len(coded)]) == 1:
                continue
            planes, this = [], []
            for c in range(components):
                chances, plane_step = kinds[is_difference[c]], (3 * step + 1) // 2 if is_difference[c] else step
                n = sum(block[c][1] for block in coded)
                a = 0 if n == 0 else 1 if n <= 4 else 2 if n <= 14 else 3
                mean = sum(block[c][0] for block in coded)
                mean = mean >> 1 if len(coded) == 2 else mean
                mean += bits.signed(chances.constant[a])
                coefficients, count = decode_coefficients(bits, chances, a, plane_step)
                coefficients[0] = mean * plane_step
                must(max(abs(x) for x in coefficients) <= 4095, "a coefficient of an image is too large")
                planes.append(inverse(coefficients))
                this.append((mean, count))
            known[block_row, column] = this
            for y in range(min(8, height - 8 * block_row)):
                for x in range(min(8, width - 8 * column)):
                    rows[8 * block_row + y][8 * column + x] = colour([plane[8 * y + x] for plane in planes])
    bits.end()
    return rows


def decode_coefficients(bits, chances, a, step):
    coefficients, count, i, before = [0] * 64, 0, 1, 0
    while i < 64 and bits.bit(chances.more[a][min(i, 15)]) == 1:
        while i < 63 and bits.bit(chances.significant[band(i)][within(i)][before]) == 0:
            i, before = i + 1, 0
        m = bits.number(chances.magnitude[band(i)][before]) + 1
        coefficients[ORDER[i]] = -m * step if bits.raw(1) == 1 else m * step
        i, before, count = i + 1, 1 if m == 1 else 2, count + 1
    return coefficients, count


def inverse(coefficients):
    t = [[(sum(coefficients[8 * k + x] * COSINES[k][y] for k in range(8)) + 256) >> 9 for x in range(8)] for y in range(8)]
    return [(sum(t[y][k] * COSINES[k][x] for k in range(8)) + 16384) >> 15 for y in range(8) for x in range(8)]


def colour(values):
    if len(values) >= 3:
        b, u, v = values[0] + 128, values[1], values[2]
        red, green, blue = b + ((359 * v + 128) >> 8), b - ((88 * u + 183 * v + 128) >> 8), b + ((454 * u + 128) >> 8)
        values = [red, green, blue] + [w + 128 for w in values[3:]]
    else:
        values = [x + 128 for x in values]
    return tuple(min(max(x, 0), 255) for x in values)


# ---- 21.4 Values ----------------------------------------------------------------------------------------------------------


def decode_values(data, width, height, components):
    bits, rows = BitStream(data), []
    chances = [[NumberChances() for _ in range(17)] for _ in range(components)]
    for y in range(height):
        rows.append([])
        for x in range(width):
            texel = []
            for c in range(components):
                left = rows[y][x - 1][c] if x > 0 else None
                up = rows[y - 1][x][c] if y > 0 else None
                if left is not None and up is not None:
                    corner = rows[y - 1][x - 1][c]
                    expected = min(max(left + up - corner, min(left, up)), max(left, up))
                    kind = min((abs(left - corner) + abs(up - corner)).bit_length(), 16)
                elif left is None and up is None:
                    expected, kind = 0, 16
                else:
                    expected, kind = left if left is not None else up, 3
                value = expected + bits.signed(chances[c][kind])
                must(0 <= value <= 65535, "a texel's value exceeds 16 bits")
                texel.append(value)
            rows[y].append(tuple(texel))
    bits.end()
    return rows


# ---- 21.5 Normals ---------------------------------------------------------------------------------------------------------


def directions(rows, map_):
    """Directions as three bytes, 128 + 127 times each coordinate; 0 beside all pieces."""
    result = [[(0, 0, 0)] * map_.width for _ in range(map_.height)]
    pieces = zip(map_.axes, map_.normals, map_.sizes, map_.ranges)
    for (u, v), normal, (length, width), ((left, right), (top, bottom)) in pieces:
        u, v = scale(u, length), scale(v, width)
        for y in range(int(top), int(bottom) + 1):
            for x in range(int(left), int(right) + 1):
                a, b = ((byte - 128) / 127 for byte in rows[y][x])
                square = a * a + b * b
                if square > 1:
                    a, b, square = a / math.sqrt(square), b / math.sqrt(square), 1.0
                reach = math.sqrt(2 - square)
                along = add(add(scale(u, a * reach), scale(v, b * reach)), scale(normal, 1 - square))
                result[y][x] = tuple(int(k * 127 + 128 + 0.5) for k in along)
    return result


# ---- 21.7 Exact colours ---------------------------------------------------------------------------------------------------


def decode_exact(data, width, height, components):
    must(len(data) > 0, "an image has no bytes")
    must(data[0] in (0, 255), "an exact image begins with neither 0 nor 255")
    if data[0] == 0:
        must(len(data) == 1 + components, "an image of one colour does not have the bytes of one")
        return [[tuple(data[1:])] * width for _ in range(height)]
    order = [1, 0, 2, 3][:components] if components >= 3 else range(components)
    bits, rows, deltas = BitStream(data[1:]), [], []
    chances = [[(NumberChances(), NumberChances()) for _ in range(12)] for _ in range(components)]
    for y in range(height):
        rows.append([[0] * components for _ in range(width)])
        deltas.append([[0] * components for _ in range(width)])
        for x in range(width):
            for c in order:
                is_difference = components >= 3 and c in (0, 2)

                def v(x, y):
                    return rows[y][x][c] - (rows[y][x][1] if is_difference else 0)

                left = v(x - 1, y) if x > 0 else None
                up = v(x, y - 1) if y > 0 else None
                if left is not None and up is not None:
                    corner = v(x - 1, y - 1)
                    right = v(x + 1, y - 1) if x + 1 < width else up
                    p = min(max(left + up - corner, min(left, up)), max(left, up))
                    kind = (abs(left - corner) + abs(up - corner) + abs(right - up)).bit_length()
                else:
                    p, kind = left if left is not None else up if up is not None else 0, 11
                expected = min(max(p + (rows[y][x][1] if is_difference else 0), 0), 255)
                is_quiet = (x == 0 or deltas[y][x - 1][c] == 0) and (y == 0 or deltas[y - 1][x][c] == 0)
                delta = bits.signed(chances[c][kind][is_quiet])
                must(0 <= expected + delta <= 255, "a component of an exact image exceeds 8 bits")
                rows[y][x][c], deltas[y][x][c] = expected + delta, delta
    bits.end()
    return rows


def print_texels(file, out):
    """Per block with a map: its root and level, the size of its images, and for each image a checksum of what is coded."""
    for number, patches in enumerate(file.patches):
        for l, patch in patches.items():
            streams = file.texels[number][l] if file.channels else [b""]
            if not streams[0]:
                continue
            map_ = Map(streams[0], patch)
            sums = []
            for channel, stream in zip(file.channels.channels, streams[1:]):
                if not stream or channel.kind not in KINDS:
                    sums.append(None)
                    continue
                decode, code = decode_values, "<H"
                if channel.kind in CODED_AS_COLOURS + CODED_EXACTLY:
                    decode, code = decode_exact if channel.kind in CODED_EXACTLY else decode_colours, "B"
                rows = decode(stream, map_.width, map_.height, channel.components)
                rows = [[texel or (0,) * channel.components for texel in row] for row in rows]
                if channel.kind in NORMALS:
                    rows = directions(rows, map_)
                texels = (texel for row in rows for texel in row)
                sums.append(zlib.crc32(b"".join(struct.pack(code, x) for texel in texels for x in texel)))
            out.write(f"{number} {l} {map_.width} {map_.height} {json.dumps(sums)}\n")


class File:
    """Everything that a file holds."""

    def __init__(self, data):
        self.header = Header(data)
        sections = read_sections(data, self.header)
        if SOURCE in sections:
            check_source(sections[SOURCE])
        self.levels = Levels(sections[LEVELS], len(sections[PAGES]))
        self.tables = read_tables(sections[TABLES])
        self.clusters, parts = read_clusters(sections[CLUSTERS], sections[INDEX], len(self.levels.levels))
        check_levels(self.levels.levels, self.clusters, self.header.step_log2)

        top_count = self.clusters[0].children.start if self.clusters else 0
        self.index = [
            IndexBlock(part, cluster, top_count, self.levels, self.tables, self.header.step_log2)
            for part, cluster in zip(parts, self.clusters)
        ]
        self.roots = [root for index in self.index for root in index.roots]
        self.arcs = [arc for index in self.index for arc in index.arcs]
        self.corner_levels = [level for index in self.index for level in index.corner_levels]
        extent_of_root = [[b - a for a, b in zip(c.low, c.high)] for c in self.clusters for _ in c.roots]
        check_loops(self.roots, self.arcs, self.corner_levels)
        check_tree(self.roots, extent_of_root)
        check_uses(self.roots, top_count, self.arcs, self.corner_levels, len(self.levels.levels))
        self.overview = Overview(sections[OVERVIEW], self.tables) if OVERVIEW in sections else None
        self.placement = read_placement(sections[PLACEMENT]) if PLACEMENT in sections else None

        self.corners, self.patches = [], [{} for _ in self.roots]  # patches: of each root, by level
        for cluster, index in zip(self.clusters, self.index):
            self.corners += decode_corners(index.arc_stream, cluster)
        # arcs may end at corners of other clusters
        self.knots = [ends_of_arc(arc, self.corners) for arc in self.arcs]
        for cluster, index in zip(self.clusters, self.index):
            for l in range(self.levels.index_arc_levels):
                self.decode_arcs(l, cluster.arcs, index.arc_stream)
            index.arc_stream.end()
        states = [{} for _ in self.roots]  # what nested fillings carry from level to level
        for l, level in enumerate(self.levels.levels):
            page = sections[PAGES][level.page_offset : level.page_offset + level.page_bytes]
            self.decode_page(l, page, states)
        self.channels = Channels(sections[CHANNELS]) if CHANNELS in sections else None
        self.texels = read_texels(sections[TEXELS], self.channels, self.index) if self.channels else None
        self.ground = Ground(sections[GROUND], self.placement) if GROUND in sections else None

    def decode_arcs(self, l, numbers, stream):
        for a in numbers:
            count = self.arcs[a].new[l]
            if count > 0:
                self.knots[a] = decode_samples(stream, self.knots[a], l, count, self.levels.arc_tangent_shift)

    def decode_page(self, l, page, states):
        """The arc pages of all clusters, then their block pages."""
        arc_parts = [part for index in self.index for part in index.arc_parts[l]]
        block_parts = [part for index in self.index for part in index.block_parts[l]]
        streams = iter(cut_parts(page, arc_parts + block_parts, f"the pages of level {l}"))
        for index in self.index:
            for run in index.arc_runs if index.arc_parts[l] else []:
                stream = Stream(next(streams), self.tables)
                self.decode_arcs(l, run, stream)
                stream.end()
        for cluster, index in zip(self.clusters, self.index):
            self.decode_blocks(l, cluster, index, streams, states)

    def side(self, half, l):
        corner = self.arcs[half.arc].ends[half.reversed]
        return Side(half, self.knots[half.arc], l, self.corner_levels[corner])

    def decode_blocks(self, l, cluster, index, streams, states):
        stream = None
        for number, root in zip(cluster.roots, index.roots):
            block = root.blocks.get(l)
            if block is None:
                continue
            if block.begins:
                if stream is not None:
                    stream.end()
                stream = Stream(next(streams), self.tables)
            loops = [[self.side(half, l) for half in loop] for loop in root.loops]
            patch = Patch(loops, block.triangle_count)
            FILLINGS[root.filling](stream, patch, self.levels.steps[root.filling][l], states[number])
            patch.check()
            for point in patch.border + patch.interior:
                must(all(a <= x <= b for a, x, b in zip(root.low, point, root.high)), "a root leaves its box")
            self.patches[number][l] = patch
        if stream is not None:
            stream.end()


# ---- 22 Heights -----------------------------------------------------------------------------------------------------------

SIDE, CELLS = 65, 64
ALL_CELLS = [(1 << CELLS) - 1] * CELLS
CORNER, BEYOND, CENTRES, EDGES, CELL = 249, 250, 251, 283, 315
Record = namedtuple("Record", "tile children partial lowest highest resolutions block")
Resolution = namedtuple("Resolution", "tolerance error triangle_count")
Tile = namedtuple("Tile", "samples cells known")  # cells: a number per row; known: which samples are
SINE = (-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04)
SINE += (2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10)
COSINE = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05)
COSINE += (-2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11)


def bit(number, k):
    return number >> k & 1


class Heights:
    """A file of heights: the records of all its tiles, and their samples."""

    def __init__(self, header, sections):
        tables = read_tables(sections[TABLES])
        data = Bytes(sections[HEIGHTS], "HEIGHTS")
        self.counts = [data.number("Q"), data.number("Q")]
        must(all(1 <= count <= 2**30 for count in self.counts), "a grid has too few or too many cells")
        flags, base = data.number("B"), data.number("B")
        must(flags < 8 and base < 2 and data.take(6) == bytes(6), "HEIGHTS has a flag or a base that is unknown")
        self.wraps, self.poles = bool(flags & 1), [bool(flags & 2), bool(flags & 4)]
        numbers = [data.number("d") for _ in range(11)]
        must(all(abs(x) < 1e15 for x in numbers), "a number of HEIGHTS is out of range")
        self.is_globe, self.numbers, self.place = base == 1, numbers, numbers[2:6]
        self.axis, self.eccentricity, _, _, dx, dy, self.height_scale, self.zero, self.step, sample_error, unit = numbers
        must(dx > 0 > dy and self.height_scale > 0 and self.step > 0, "a number of HEIGHTS has a wrong sign")
        must(sample_error >= 0 and unit >= 0, "a number of HEIGHTS has a wrong sign")
        if self.is_globe:
            must(self.axis > 0 and 0 <= self.eccentricity < 0.5, "HEIGHTS has no ellipsoid")
        else:
            must(self.axis == self.eccentricity == 0 and flags == 0, "a plane has an axis, wraps or has poles")
        must(not self.wraps or abs(self.counts[0] * dx - 360) < 0.5 * dx, "a grid that wraps does not go around")
        length = data.varint()
        must(length <= 255, "the name of the ramp is too long")
        try:
            self.ramp = bytes(data.take(length)).decode("utf-8")
        except UnicodeDecodeError:
            raise Damaged("the name of the ramp is not UTF-8") from None
        self.depth = 0
        while math.prod(self.roots()) > 2:
            self.depth += 1
        columns, rows = self.roots()
        tops = [(0, i, j) for j in range(rows) for i in range(columns)]
        pages = [(tile, math.inf, read_part(data)) for tile in tops]
        root_blocks = Bytes(data.take(len(data.data) - data.at), "the blocks in HEIGHTS")
        self.records, self.tiles = {}, {}
        blocks = Bytes(sections[PAGES], "PAGES")
        index = Bytes(sections[HEIGHT_INDEX], "HEIGHT_INDEX")
        pages = [page for page in pages if page[2].length > 0]
        while pages:
            below = []
            for tile, coarser, part in pages:
                page = index.take(part.length)
                must(zlib.crc32(page) == part.crc, "the checksum of an index page is wrong")
                below.append((self.read_page(Bytes(page, "an index page"), tile, coarser, root_blocks, blocks, tables)))
            at = index.at
            for first_page, children in below:
                must(first_page == (at if children else 0), "the pages below a page are not where it says")
                at += sum(part.length for _, _, part in children)
            pages = [child for _, children in below for child in children]
        for rest in (root_blocks, blocks, index):
            rest.end()
        if self.is_globe:
            self.add_level_tiles(sample_error * self.height_scale + self.axis * 2.0**-48)
        self.placement = read_placement(sections[PLACEMENT]) if PLACEMENT in sections else None
        self.stops = self.read_ramp(Bytes(sections[RAMP], "RAMP")) if RAMP in sections else None
        if SOURCE in sections:
            check_source(sections[SOURCE])

    # 22.8 Section RAMP

    def read_ramp(self, data):
        count = data.varint()
        must(1 <= count <= 1024, "a ramp has no stops, or too many")
        stops = [(data.number("d"), list(data.take(3))) for _ in range(count)]
        data.end()
        must(all(abs(height) < 1e15 for height, _ in stops), "a height of a ramp is out of range")
        must(all(a <= b for (a, _), (b, _) in zip(stops, stops[1:])), "the heights of a ramp fall")
        return stops

    # 22.1 The grid

    def roots(self):
        return [-(-count // (CELLS << self.depth)) for count in self.counts]

    def lines(self, tile):
        d, i, j = tile
        starts = zip(self.counts, (CELLS * i, CELLS * j))
        return [[min(count, (start + k) << (self.depth - d)) for k in range(SIDE)] for count, start in starts]

    def has(self, tile):
        return tile[0] <= self.depth and all(lines[0] < lines[CELLS] for lines in self.lines(tile))

    # 22.3 Section HEIGHT_INDEX

    def read_page(self, data, top, coarser, root_blocks, blocks, tables):
        first_block, first_page = data.number("Q"), data.number("Q")
        depth, tolerances, lowest, first = [(top, coarser)], [0] * 8, 0, None
        start = blocks.at
        for _ in range(4):
            below = []
            for tile, coarser in depth:
                flags = data.number("B")
                block = read_part(data)
                lowest += unzigzag(data.varint())
                highest = lowest + data.varint()
                must(-(2**31) <= lowest <= highest < 2**31, "a height exceeds 32 bits")
                resolutions = []
                for k in range((flags >> 5) + 1):
                    tolerances[k] += unzigzag(data.varint())
                    error = tolerances[k] + unzigzag(data.varint())
                    must(0 <= tolerances[k] < 65536 and 0 <= error < 65536, "an error code exceeds 16 bits")
                    resolutions.append(Resolution(bound(tolerances[k], 0), bound(error, 0), data.varint()))
                    must(resolutions[-1].error <= coarser, "errors grow")
                    must(resolutions[-1].triangle_count <= 8192, "a tile has too many triangles")
                    coarser = resolutions[-1].error
                source = root_blocks if tile[0] == 0 else blocks
                if block.length > 0 and tile[0] > 0 and first is None:
                    first = source.at
                coded = source.take(block.length)
                must(block.length == 0 or zlib.crc32(coded) == block.crc, "the checksum of a block is wrong")
                record = Record(tile, flags & 15, bool(flags & 16), lowest, highest, resolutions, block)
                self.records[tile] = record
                self.tiles[tile] = self.read_block(record, coded, tables)
                d, i, j = tile
                quarters = [(d + 1, 2 * i + x, 2 * j + y) for y in range(2) for x in range(2)]
                quarters = [quarter for k, quarter in enumerate(quarters) if bit(flags, k)]
                must(all(self.has(quarter) for quarter in quarters), "a tile has a quarter that is not in the grid")
                below += [(quarter, coarser) for quarter in quarters]
            depth = below
        must(first_block == (first or 0) and (first is not None or blocks.at == start), "blocks are not where a page says")
        children = [(tile, coarser, read_part(data)) for tile, coarser in depth]
        must(all(part.length > 0 for _, _, part in children), "an index page has no bytes")
        data.end()
        return first_page, children

    def add_level_tiles(self, least):
        """Adds the tiles below level ones, which follow from these."""
        waiting = [r for r in self.records.values() if not r.children and not r.partial and r.lowest == r.highest]
        for record in waiting:
            d, i, j = record.tile
            quarters = [(d + 1, 2 * i + x, 2 * j + y) for y in range(2) for x in range(2)]
            children = sum(self.has(quarter) << k for k, quarter in enumerate(quarters))
            self.records[record.tile] = record._replace(children=children)
            error = record.resolutions[-1].error
            error = min(error, least + (error - least) * (0.2578125 if d + 1 < self.depth else 0.0))
            for quarter in (quarter for k, quarter in enumerate(quarters) if bit(children, k)):
                columns, rows = self.lines(quarter)
                width, height = (sum(a < b for a, b in zip(lines, lines[1:])) for lines in (columns, rows))
                poles = (self.poles[0] and rows[0] == 0) + (self.poles[1] and rows[CELLS] == self.counts[1])
                resolution = Resolution(0.0, error, width * (2 * height - poles))
                below = record._replace(tile=quarter, resolutions=[resolution], block=None)
                self.records[quarter], self.tiles[quarter] = below, self.read_block(below, b"", None)
                waiting.append(below)
        # In the order that they would have in the file.
        interleaved = lambda i, j: sum(bit(i, k) << 2 * k | bit(j, k) << 2 * k + 1 for k in range(32))

        def order(tile):
            d, i, j = tile
            up = d % 4
            return d - up, j >> d, i >> d, interleaved(i >> up, j >> up), d, interleaved(i, j)

        self.records = dict(sorted(self.records.items(), key=lambda item: order(item[0])))

    # 22.4 Blocks

    def read_block(self, record, block, tables):
        tile, lines = record.tile, self.lines(record.tile)
        d, i, j = tile
        samples, can_be = [0] * SIDE**2, ALL_CELLS
        if d > 0:
            parent = self.tiles[d - 1, i // 2, j // 2]
            x, y = 32 * (i % 2), 32 * (j % 2)
            can_be = [sum(bit(parent.cells[y + b // 2], x + a // 2) << a for a in range(CELLS)) for b in range(CELLS)]
            for b, row in enumerate(fill(parent, x, y)):
                samples[2 * b * SIDE : 2 * b * SIDE + SIDE : 2] = row
        must(record.partial or can_be == ALL_CELLS, "a tile draws cells that the tile above it does not draw")
        must(block or record.partial == (can_be != ALL_CELLS), "a tile without a block does not draw what it can")
        stream = Stream(block, tables) if block else Predicted()
        cells = can_be
        if record.partial and block:
            cells = [0] * CELLS
            drawn = lambda a, b: bit(cells[b], a) if a >= 0 and b >= 0 else 0
            for b in range(CELLS):
                for a in (a for a in range(CELLS) if bit(can_be[b], a)):
                    before = drawn(a - 1, b) + 2 * drawn(a - 1, b - 1) + 4 * drawn(a, b - 1) + 8 * drawn(a + 1, b - 1)
                    cells[b] |= stream.flag(CELL + before) << a
        known = known_samples(cells, lines)
        if d == 0:
            before = 0
            for at in (0, CELLS, SIDE * CELLS, SIDE * SIDE - 1):
                if known[at]:
                    before += stream.get_signed(CORNER)
                    must(-(2**31) <= before < 2**31, "a height exceeds 32 bits")
                samples[at] = before
        for stride in (32, 16, 8, 4, 2, 1) if d == 0 else (1,):
            Refinement(samples, lines, stride, known, stream)
        stream.end()
        own = [samples[at] for at in range(SIDE**2) if known[at]]
        must(not own or record.lowest <= min(own) and max(own) <= record.highest, "a sample is out of the range of its tile")
        return Tile(samples, cells, known)


class Predicted:
    """The stream of a block without bytes."""

    def get(self, context):
        return 0

    def get_signed(self, context):
        return 0

    def end(self):
        pass


def known_samples(cells, lines):
    touched = [[False] * SIDE for _ in range(SIDE)]
    for b in range(CELLS):
        for a in (a for a in range(CELLS) if bit(cells[b], a)):
            for x, y in ((a, b), (a + 1, b), (a, b + 1), (a + 1, b + 1)):
                touched[y][x] = True
    places = {(lines[0][a], lines[1][b]) for b in range(SIDE) for a in range(SIDE) if touched[b][a]}
    return [(lines[0][a], lines[1][b]) in places for b in range(SIDE) for a in range(SIDE)]


def fill(parent, x, y):
    """The samples of a quarter of a tile: 33 rows of 33."""
    rows = []
    for b in range(33):
        at = [(y + b) * SIDE + x + a for a in range(33)]
        values = [parent.samples[k] if parent.known[k] else None for k in at]
        last = next((value for value in values if value is not None), None)
        for a, value in enumerate(values):
            last = values[a] = last if value is None else value
        rows.append(values if last is not None else None)
    last = next((row for row in rows if row is not None), [0] * 33)
    for b, row in enumerate(rows):
        last = rows[b] = last if row is None else row
    return rows


class Refinement:
    def __init__(self, samples, lines, stride, known, stream):
        self.samples, self.known, self.stream, self.stride, self.sizes = samples, known, stream, stride, {}
        s = stride
        last = [axis.index(axis[CELLS]) for axis in lines]
        new = [range(s, end, 2 * s) for end in last]
        old = [range(0, end + 2 * s, 2 * s) for end in last]
        along = [{m: weights(axis, m, s, SIDE) for m in marks} for axis, marks in zip(lines, new)]
        across = [
            {m: weights(axis, m, s, end) for m in marks if 0 < m and m + s < end}
            for axis, marks, end in zip(lines, old, last)
        ]
        for y in new[1]:
            values = {x: sum(w * self.at(x, k) for k, w in along[1][y]) for x in old[0]}
            for x in new[0]:
                self.centre(x, y, sum(w * values[k] for k, w in along[0][x]))
        for y in range(0, SIDE, s):
            if y in new[1]:
                for x in old[0]:
                    u = sum(w * self.at(x, k) for k, w in along[1][y])
                    slope = abs(self.at(x, y - s) - self.at(x, y + s))
                    other = None
                    if x in across[0]:
                        v = sum(w * self.at(k, y) for k, w in across[0][x])
                        other = v, abs(self.at(x - s, y) - self.at(x + s, y))
                    self.edge(x, y, u, slope, other, ((x - s, y), (x + s, y)))
            elif y in old[1]:
                for x in new[0]:
                    u = sum(w * self.at(k, y) for k, w in along[0][x])
                    slope = abs(self.at(x - s, y) - self.at(x + s, y))
                    other = None
                    if y in across[1]:
                        v = sum(w * self.at(x, k) for k, w in across[1][y])
                        other = v, abs(self.at(x, y - s) - self.at(x, y + s))
                    self.edge(x, y, u, slope, other, ((x, y - s), (x, y + s)))
        column, row = (next(k for k in axis if k >= end) for axis, end in zip(old, last))
        for y in sorted([*new[1], *old[1]]):
            for x in (x for x in range(0, SIDE, s) if x >= last[0]):
                samples[y * SIDE + x] = samples[y * SIDE + column]
        for y in (y for y in range(0, SIDE, s) if y >= last[1]):
            samples[y * SIDE : y * SIDE + SIDE] = samples[row * SIDE : row * SIDE + SIDE]

    def at(self, x, y):
        return self.samples[y * SIDE + x]

    def mean(self, places):
        """12 times the mean size of residuals; none if there are none."""
        sizes = [self.sizes[place] for place in places if place in self.sizes]
        return 12 * sum(sizes) // len(sizes) if sizes else None

    def centre(self, x, y, value):
        s = self.stride
        prediction = (value + (1 << 23)) >> 24
        a, b, c, e = self.at(x - s, y - s), self.at(x + s, y - s), self.at(x - s, y + s), self.at(x + s, y + s)
        bend = abs(a + e - b - c) + abs(4 * prediction - (a + b + c + e))
        spread = max(a, b, c, e) - min(a, b, c, e)
        mean = self.mean(((x - 2 * s, y), (x - 2 * s, y - 2 * s), (x, y - 2 * s), (x + 2 * s, y - 2 * s)))
        mean = 2 * bend if mean is None else mean
        self.sample(x, y, CENTRES, (16 * mean + 6 * bend + 3 * spread) // 12, prediction)

    def edge(self, x, y, u, slope, other, centres):
        s = self.stride
        mean = self.mean((*centres, (x - s, y - s), (x + s, y - s)))
        if other is not None:
            prediction, difference = (u + other[0] + (1 << 12)) >> 13, abs(u - other[0]) >> 10
            slopes = slope + other[1]
        else:
            prediction, difference, slopes = (u + (1 << 11)) >> 12, (mean or 0) // 3, 2 * slope
        mean = 3 * difference if mean is None else mean
        self.sample(x, y, EDGES, (24 * difference + 16 * mean + 3 * slopes) // 24, prediction)

    def sample(self, x, y, first, measure, prediction):
        at = y * SIDE + x
        if not self.known[at]:
            self.samples[at] = max(-(2**31), min(prediction, 2**31 - 1))
            return
        k = measure.bit_length() - 1
        class_ = measure if measure < 2 else min(31, 2 * k + bit(measure, k - 1))
        escape = 1 << (class_ // 2 + 3)
        residual = self.stream.get(first + class_)
        if residual >= escape:
            residual += self.stream.get(BEYOND)
        residual = unzigzag(residual)
        self.sizes[x, y] = abs(residual)
        self.samples[at] = prediction + residual
        must(-(2**31) <= self.samples[at] < 2**31, "a height exceeds 32 bits")


def weights(line, m, s, end):
    """Pairs of an index coordinate and its weight."""
    near = [m - s, m + s]
    far = [m - 3 * s] if m >= 3 * s else []
    far += [m + 3 * s] if m + 3 * s < end else []
    is_far = lambda k: abs(line[k] - line[m]) >= 2 * abs(line[near[k > m]] - line[m])
    at = near + [k for k in far if is_far(k)]
    d = [line[k] - line[m] for k in at]
    shift = max(0, max(map(abs, d)).bit_length() - 16)
    d = [x >> shift for x in d]
    w = []
    for k, own in enumerate(d):
        others = d[:k] + d[k + 1 :]
        p, q = math.prod(-x for x in others), math.prod(own - x for x in others)
        p, q = (-p, -q) if q < 0 else (p, q)
        w.append((8192 * p + q) // (2 * q))
    w[0] += 4096 - sum(w)
    return list(zip(at, w))


# ---- 22.2 Places, 22.5 Drawn tiles ----------------------------------------------------------------------------------------


def sine_and_cosine(degrees):
    t = degrees - 360.0 * math.floor(degrees / 360.0)
    k = math.floor(t / 90.0 + 0.5)
    x = (t - 90.0 * k) * (math.pi / 180.0)
    z = x * x
    w = z * z
    s1, s2, s3, s4, s5, s6 = SINE
    c1, c2, c3, c4, c5, c6 = COSINE
    odd = s2 + z * (s3 + z * s4) + z * w * (s5 + z * s6)
    sine = x + z * x * (s1 + z * odd)
    even = z * (c1 + z * (c2 + z * c3)) + w * w * (c4 + z * (c5 + z * c6))
    half = 0.5 * z
    rest = 1.0 - half
    cosine = rest + (((1.0 - rest) - half) + z * even)
    return ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[k % 4]


class Drawn:
    """A tile in space, and what each of its samples needs."""

    def __init__(self, heights, tile):
        self.heights, self.lines, values = heights, heights.lines(tile), heights.tiles[tile]
        self.cells, self.is_even = values.cells, (tile[1] + tile[2]) % 2 == 0
        self.h = [q * heights.step * heights.height_scale for q in values.samples]
        self.x, self.y = ([float(line - axis[0]) for line in axis] for axis in self.lines)
        self.places = [self.place(at, values.samples[at]) for at in range(SIDE**2)]
        self.pole_rows = list(zip((0, CELLS), (0, heights.counts[1]), heights.poles))
        self.need = {}
        self.find_needs()

    def place(self, at, q):
        file = self.heights
        column, row = self.lines[0][at % SIDE], self.lines[1][at // SIDE]
        if file.wraps and column == file.counts[0]:
            column = 0
        x0, y0, dx, dy = file.place
        x, y = x0 + column * dx, y0 + row * dy
        g = (file.zero + q * file.step) * file.height_scale
        if not file.is_globe:
            return (x, y, g)
        (sin_x, cos_x), (sin_y, cos_y) = sine_and_cosine(x), sine_and_cosine(max(-90.0, min(y, 90.0)))
        n = file.axis / math.sqrt(1.0 - file.eccentricity * sin_y * sin_y)
        u = (n + g) * cos_y
        return (u * cos_x, u * sin_x, (n * (1.0 - file.eccentricity) + g) * sin_y)

    def bend(self, p, q):
        if not self.heights.is_globe:
            return 0.0
        rows, half = (p // SIDE, q // SIDE), abs(p % SIDE - q % SIDE) // 2
        first, last = (is_pole and self.lines[1][k] == row for k, row, is_pole in self.pole_rows)
        if rows == (0, 0) and first or rows == (CELLS, CELLS) and last:
            row = half if rows[0] == 0 else CELLS - half
            chord = sub(self.places[row * SIDE + p % SIDE], self.places[row * SIDE + q % SIDE])
            return 0.5 * math.sqrt(dot(chord, chord))
        chord = sub(self.places[p], self.places[q])
        return dot(chord, chord) / (8.0 * self.heights.axis * (1.0 - self.heights.eccentricity))

    def masked(self, need, a, b, width, height):
        """A need of triangles in a rectangle of cells, as far as it lies within the tile."""
        columns = range(max(a, 0), min(a + width, CELLS))
        drawn = [bit(self.cells[y], x) for y in range(max(b, 0), min(b + height, CELLS)) for x in columns]
        return need if all(drawn) else math.inf if any(drawn) else 0.0

    def find_needs(self):
        h, need, at = self.h, self.need, lambda a, b: b * SIDE + a
        share = lambda axis, m: (axis[m] - axis[m - 1]) / (axis[m + 1] - axis[m - 1]) if axis[m - 1] < axis[m + 1] else 0.0
        x, y = ({m: share(axis, m) for m in range(1, CELLS, 2)} for axis in (self.x, self.y))
        side = lambda p, m, q, part, factor: factor * abs(h[p] + part * (h[q] - h[p]) - h[m]) + self.bend(p, q)
        for line in range(0, SIDE, 2):
            factor = 2.0 if line % CELLS == 0 else 1.0
            for m in range(1, CELLS, 2):
                row = [at(m + k, line) for k in (-1, 0, 1)]
                need[row[1]] = self.masked(side(*row, x[m], factor), m - 1, line - 1, 2, 2)
                column = [at(line, m + k) for k in (-1, 0, 1)]
                need[column[1]] = self.masked(side(*column, y[m], factor), line - 1, m - 1, 2, 2)
        for l in range(0, CELLS, 2):
            for k in range(0, CELLS, 2):
                corners = nw, ne, sw, se = at(k, l), at(k + 2, l), at(k, l + 2), at(k + 2, l + 2)
                a, b, c, d = (h[p] for p in corners)
                m, s, t = at(k + 1, l + 1), x[k + 1], y[l + 1]
                if (k + l) // 2 % 2 == 0:
                    both, ends = (a + s * (b - a) + t * (d - b), a + t * (c - a) + s * (d - c)), (nw, se)
                else:
                    both = (a + s * (b - a) + t * (c - a), d + (1.0 - s) * (c - d) + (1.0 - t) * (b - d))
                    ends = (ne, sw)
                own = max(abs(both[0] - h[m]), abs(both[1] - h[m])) + self.bend(*ends)
                sides = (at(k + 1, l), at(k + 1, l + 2), at(k, l + 1), at(k + 2, l + 1))
                need[m] = self.masked(max(own, *(need[p] for p in sides)), k, l, 2, 2)
        n = 4
        while n <= CELLS:
            self.find_needs_of_size(n, at)
            n *= 2

    def find_needs_of_size(self, n, at):
        need, half = self.need, n // 2
        for line in range(0, SIDE, n):
            for start in range(0, CELLS, n):
                for turn in (lambda a, b: (a, b)), (lambda a, b: (b, a)):
                    here = lambda along, across: at(*turn(along, across))
                    p, q = here(start, line), here(start + n, line)
                    apexes = [here(start + half, k) for k in (line - half, line + half) if 0 <= k <= CELLS]
                    value = max(self.distance(p, q, apex) for apex in apexes) + self.bend(p, q)
                    if line % CELLS == 0:
                        axis = self.x if p // SIDE == q // SIDE else self.y
                        value = max(value, 2.0 * self.along(axis, p, q, n) + self.bend(p, q))
                    for k in (line - half // 2, line + half // 2):
                        if 0 <= k <= CELLS:
                            value = max(value, need[here(start + half // 2, k)], need[here(start + half + half // 2, k)])
                    rectangle = turn(start, line - half) + turn(n, n)
                    need[here(start + half, line)] = self.masked(value, *rectangle)
        for l in range(0, CELLS, n):
            for k in range(0, CELLS, n):
                nw, ne, sw, se = at(k, l), at(k + n, l), at(k, l + n), at(k + n, l + n)
                falls = (k + l) // n % 2 == 0 if n < CELLS else self.is_even
                p, q, one, two = (nw, se, ne, sw) if falls else (ne, sw, nw, se)
                value = max(self.distance(p, q, one), self.distance(p, q, two)) + self.bend(p, q)
                sides = (at(k + half, l), at(k + half, l + n), at(k, l + half), at(k + n, l + half))
                need[at(k + half, l + half)] = self.masked(max(value, *(need[s] for s in sides)), k, l, n, n)

    def along(self, axis, p, q, n):
        """The largest distance of the n - 1 samples on a side along a row or a column."""
        step, line = (q - p) // n, (lambda s: s % SIDE) if axis is self.x else (lambda s: s // SIDE)
        length = axis[line(q)] - axis[line(p)]
        if length <= 0.0:
            return 0.0
        share = lambda s: (axis[line(s)] - axis[line(p)]) / length
        return max(abs(self.h[p] + share(s) * (self.h[q] - self.h[p]) - self.h[s]) for s in range(p, q, step))

    def distance(self, a, b, c):
        (xa, ya, ha), (xb, yb, hb), (xc, yc, hc) = ((self.x[p % SIDE], self.y[p // SIDE], self.h[p]) for p in (a, b, c))
        u, v, p, x, y, q = xb - xa, yb - ya, hb - ha, xc - xa, yc - ya, hc - ha
        det = u * y - x * v
        if det == 0.0:
            return 0.0
        east, south = (p * y - q * v) / det, (q * u - p * x) / det
        first = ha - east * xa - south * ya
        most = 0.0
        for column, row in inside([(k % SIDE, k // SIDE) for k in (a, b, c)]):
            off = abs(first + south * self.y[row] + east * self.x[column] - self.h[row * SIDE + column])
            most = max(most, off)
        return most

    def triangles(self, tolerance):
        nw, ne, sw, se = (0, 0), (CELLS, 0), (0, CELLS), (CELLS, CELLS)
        halves = [(se, nw, sw), (nw, se, ne)] if self.is_even else [(ne, sw, se), (sw, ne, nw)]
        found = []
        for half in halves:
            waiting = [half]
            while waiting:
                a, b, c = waiting.pop()
                m = ((a[0] + b[0]) // 2, (a[1] + b[1]) // 2)
                if abs(a[0] - b[0]) != 1 and self.need[m[1] * SIDE + m[0]] > tolerance:
                    waiting += [(b, c, m), (c, a, m)]
                    continue
                column, row = (min(63, (a[k] + b[k] + c[k]) // 3) for k in (0, 1))
                if bit(self.cells[row], column) and self.remains(a, b, c):
                    found.append([y * SIDE + x for x, y in (a, b, c)])
        return found

    def remains(self, *corners):
        columns, rows = self.lines
        at = [(columns[a], rows[b]) for a, b in corners]
        poles = [row for row, is_pole in zip((0, self.heights.counts[1]), self.heights.poles) if is_pole]
        has_area = len({c for c, _ in at}) > 1 and len({r for _, r in at}) > 1 and len(set(at)) == 3
        return has_area and sum(row in poles for _, row in at) < 2


def inside(corners):
    """The samples in a triangle, its sides included."""
    (xa, ya), (xb, yb), (xc, yc) = corners
    area = (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
    sign = 1 if area > 0 else -1
    for y in range(min(ya, yb, yc), max(ya, yb, yc) + 1):
        for x in range(min(xa, xb, xc), max(xa, xb, xc) + 1):
            one = (xb - xa) * (y - ya) - (yb - ya) * (x - xa)
            two = (xc - xb) * (y - yb) - (yc - yb) * (x - xb)
            three = (xa - xc) * (y - yc) - (ya - yc) * (x - xc)
            if min(sign * one, sign * two, sign * three) >= 0:
                yield x, y


# ---- vectors/README.md: the JSON text -------------------------------------------------------------------------------------


def bits_of(x):
    """A number as the 16 hexadecimal digits of its binary64 form."""
    return struct.pack(">d", x).hex()


# ---- 23 Section GROUND ----------------------------------------------------------------------------------------------------


class Ground:
    """The heights that a mesh stands on, and what takes them to the space of the mesh."""

    def __init__(self, data, placement):
        header = Header(data)
        sections = read_sections(data, header)
        must(HEIGHTS in sections, "GROUND holds a mesh")
        self.heights = Heights(header, sections)
        must(not self.heights.is_globe, "GROUND lies on a globe")
        nothing = Placement(0, 0.0, [0.0] * 3, "")
        own, mesh = self.heights.placement or nothing, placement or nothing
        must(own.crs == mesh.crs or "" in (own.crs, mesh.crs), "GROUND is in another coordinate reference system than the mesh")
        self.units = [own.unit or 1.0, mesh.unit or 1.0]
        must(all(u <= 1e15 and 1 / u <= 1e15 for u in self.units), "GROUND or the mesh on it has a unit beyond 10^15")
        must(all(abs(x) <= 1e15 for x in own.origin + mesh.origin), "GROUND or the mesh on it has an origin beyond 10^15")
        self.origins = [own.origin, mesh.origin]
        self.is_in_place = self.units[0] == self.units[1] and own.origin == mesh.origin
        self.is_y_up = mesh.up == 1
        self.scale = 1.0 if self.is_in_place else self.units[0] / self.units[1]

    def point(self, p):
        if not self.is_in_place:
            p = [((a * self.units[0] + b) - c) / self.units[1] for a, b, c in zip(p, *self.origins)]
        return (p[0], p[2], -p[1]) if self.is_y_up else tuple(p)


def print_json(file, out):
    step_log2 = file.header.step_log2

    def line(value):
        return json.dumps(value, separators=(",", ":"))

    def block(l, number, root, patch):
        error, deviation = (bits_of(bound(code, step_log2)) for code in (root.blocks[l].error, root.blocks[l].deviation))
        head = {"level": l, "error": error, "border_deviation": deviation, "triangle_count": len(patch.triangles)}
        texels = {"texels": [stream.hex() for stream in file.texels[number][l]]} if file.channels else {}
        return line(head | {"interior": patch.interior, "triangles": patch.triangles} | texels)

    def channel(x):
        numbers = {name: bits_of(value) for name, value in zip(("low", "step", "bound"), x[3:])}
        return {"name": x.name, "kind": KINDS.get(x.kind, "unknown"), "components": x.components} | numbers

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
        members.append(array("channels", [line(channel(x)) for x in file.channels.channels]))
    if file.placement is not None:
        up, unit, origin, crs = file.placement
        # Every character that could be written in two ways is written as UTF-16.
        text = "".join(c if "!" <= c <= "~" and c not in '"\\' else utf16(c) for c in crs)
        head = line({"up": up, "unit": bits_of(unit or 0.0), "origin": [bits_of(x) for x in origin]})
        members.append(f'"placement":{head[:-1]},"crs":"{text}"}}')
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


def main():
    names = [argument for argument in sys.argv[1:] if argument != "--texels"]
    if len(names) != 1:
        print("usage: decode.py [--texels] FILE", file=sys.stderr)
        return 2
    try:
        with open(names[0], "rb") as source:
            data = source.read()
        header = Header(data)
        sections = read_sections(data, header)
        if HEIGHTS in sections:
            print_heights(Heights(header, sections), sys.stdout)
        else:
            (print_texels if "--texels" in sys.argv else print_json)(File(data), sys.stdout)
    except (Damaged, OSError) as error:
        print(f"{names[0]}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
