"""Chapter 11: patches and fillings."""

from collections import Counter, namedtuple

from .ch02_conventions import must
from .ch10_arcs import WHOLE


# ---- 11.1
# Patches --------------------------------------------------------------------------------------------------------


class Side:
    """A half-arc at a level: the corner where it begins (parameter 0), if it is a vertex, and its samples, in its
    direction."""

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


# ---- 11.2
# Fillings -------------------------------------------------------------------------------------------------------

Steps = namedtuple("Steps", "normal_shift tangent_shift")
FILLINGS = {}  # by code: a class that decodes a block, with its name


def read_steps(data):
    steps = Steps(data.number("B"), data.number("B"))
    must(max(steps) <= 40, f"a shift in {data.name} is above 40")
    return steps
