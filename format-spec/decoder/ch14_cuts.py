"""Chapter 14: cuts and stitching."""

from collections import Counter

from .ch02_conventions import must


def check_cut(nodes, parents):
    """None of the nodes of a cut lies above another one; `parents` has the node above each that has one."""
    chosen = set(nodes)
    must(len(chosen) == len(nodes), "a cut names something twice")
    for node in chosen:
        above = parents(node)
        while above is not None:
            must(above not in chosen, "a part of a cut lies above another")
            above = parents(above)


# ---- 14.1
# Cuts -----------------------------------------------------------------------------------------------------------


def drawn_level(root, level):
    """The level of the block of a root that is drawn at a level: the finest that is not finer, or its coarsest
    (6.3)."""
    return max((l for l in root.blocks if l <= level), default=min(root.blocks))


class Cut:
    """The mesh of a cut: lattice points and triangles, in the order of 14.3."""

    def __init__(self, file, levels):
        """`levels`: the level of each root of the cut, by its number."""
        parents = {child: number for number, root in enumerate(file.roots) for child in root.children}
        check_cut(list(levels), parents.get)
        self.file = file
        self.drawn = {number: drawn_level(file.roots[number], level) for number, level in sorted(levels.items())}
        self.find_drawn_borders()
        self.numbers, self.points, self.triangles = {}, [], []
        for number, level in self.drawn.items():
            self.add_root(number, level)

    # ---- 14.2 Stitching

    def find_drawn_borders(self):
        """Rule 1: the level at which each arc is drawn, and the finest one around each corner."""
        self.arc_levels, self.levels_at_corners = {}, {}
        for number, level in self.drawn.items():
            for arc in (half.arc for loop in self.file.roots[number].loops for half in loop):
                self.arc_levels[arc] = max(level, self.arc_levels.get(arc, 0))
                for corner in self.file.arcs[arc].ends:
                    self.levels_at_corners[corner] = max(level, self.levels_at_corners.get(corner, 0))

    def drawn_corner(self, half):
        """The corner where a half-arc begins, if it is drawn."""
        corner = self.file.arcs[half.arc].ends[half.reversed]
        return corner if self.file.corner_levels[corner] <= self.levels_at_corners[corner] else None

    def along(self, half):
        """What is drawn of a half-arc, in its direction, with the coarsest level that has it: the corner where it
        begins, and its samples."""
        corner = self.drawn_corner(half)
        if corner is not None:
            yield ("corner", corner), self.file.corner_levels[corner]
        knots = self.samples(half.arc)
        for knot in reversed(knots) if half.reversed else knots:
            yield ("sample", half.arc, knot.parameter), knot.level

    def samples(self, arc):
        return [knot for knot in self.file.knots[arc][1:-1] if knot.level <= self.arc_levels[arc]]

    def add_root(self, number, level):
        root, patch = self.file.roots[number], self.file.patches[number][level]
        border, inserted = [], {}  # the names of the border's vertices; what is inserted after each, by its number in the patch
        for loop in root.loops:
            first = len(border)
            for half in loop:
                for name, own in self.along(half):
                    if own <= level:
                        border.append(name)
                    else:
                        # A loop begins with a corner that is a vertex (8.1), so there is one before.
                        inserted.setdefault(len(border) - 1, []).append(name)
            for k in range(first, len(border)):
                after = k + 1 if k + 1 < len(border) else first
                inserted[k, after] = inserted.pop(k, [])
        must(len(border) == len(patch.border), "a border has other vertices than its patch")
        self.number_border(root)
        vertices = [self.numbers[name] for name in border]
        for point in patch.interior:
            vertices.append(len(self.points))
            self.points.append(point)
        inserted = {edge: [self.numbers[name] for name in names] for edge, names in inserted.items()}
        for triangle in patch.triangles:
            edges = [(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]
            own = [vertices[v] for v in triangle]
            self.triangles += stitch(own, [inserted.get(edge, []) for edge in edges])

    # ---- 14.3 Order

    def number_border(self, root):
        for half in (half for loop in root.loops for half in loop):
            corner = self.drawn_corner(half)
            if corner is not None:
                self.number(("corner", corner), self.file.corners[corner])
            for knot in self.samples(half.arc):
                self.number(("sample", half.arc, knot.parameter), knot.position)

    def number(self, name, point):
        if name not in self.numbers:
            self.numbers[name] = len(self.points)
            self.points.append(point)


def stitch(v, x):
    """The triangles that stand for one into whose edges `x` is inserted."""
    if not any(x):
        return [tuple(v)]
    b = min(k for k in range(3) if x[k])
    start, end, apex = (v[(b + k) % 3] for k in range(3))
    on_base, after_base, before_base = (x[(b + k) % 3] for k in range(3))

    def fan(centre, chain):
        return [(centre, s, t) for s, t in zip(chain, chain[1:])]

    found = fan(on_base[0], [apex] + before_base + [start])
    found += fan(apex, on_base)
    return found + fan(on_base[-1], [end] + after_base + [apex])


def open_edges(triangles):
    """How many edges have a triangle on one side alone."""
    edges = Counter((t[k], t[(k + 1) % 3]) for t in triangles for k in range(3))
    return sum(max(0, count - edges[b, a]) for (a, b), count in edges.items())
