"""Chapter 8: index blocks."""

from collections import Counter, namedtuple

from .ch02_conventions import bound, bound_sum, Bytes, code_at_least, must, unzigzag
from .ch06_resident import CLUSTER_ITEM_LIMIT, read_part
from .ch07_entropy import Stream
from .ch11_patches import FILLINGS

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
    """A group has the border of its children; arcs between them may be left out, and loops of arcs with one user,
    around holes that it closes."""
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
