"""Chapter 13: grid blocks."""

import math
from collections import namedtuple

from .ch02_conventions import add, cross, dot, frame, lattice_point, lift, must, scale, slide, sub, vector
from .ch10_arcs import WHOLE
from .ch11_patches import FILLINGS
from .ch12_irregular import IrregularBlock


# ---- 13.1 Quads, cells,
# sites --------------------------------------------------------------------------------------------

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


# ---- 13.2 Decoding a
# block -----------------------------------------------------------------------------------------------


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


# ---- 13.4 Triangles of a
# polygon -----------------------------------------------------------------------------------------


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
