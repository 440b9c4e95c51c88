"""Chapter 6: the resident index: SOURCE, LEVELS, CLUSTERS, PLACEMENT."""

import math
import zlib
from collections import namedtuple

from .ch02_conventions import bound, Bytes, Damaged, must, unzigzag
from .ch11_patches import FILLINGS, read_steps


# ---- 6.1 Section
# SOURCE --------------------------------------------------------------------------------------------------


def check_source(section):
    data = Bytes(section, "SOURCE")
    for code in "QQdd":  # triangle count, vertex count, mean edge length, area
        data.number(code)
    try:
        data.take(len(section) - 32).decode("utf-8")
    except UnicodeDecodeError:
        raise Damaged("the generator in SOURCE is not UTF-8") from None


# ---- 6.2 Section
# LEVELS --------------------------------------------------------------------------------------------------

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


# ---- 6.3 Section
# CLUSTERS ------------------------------------------------------------------------------------------------

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


# ---- 6.5 Section
# PLACEMENT -----------------------------------------------------------------------------------------------

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
