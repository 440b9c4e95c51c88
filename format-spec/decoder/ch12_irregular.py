"""Chapter 12: irregular blocks."""

import math

from .ch02_conventions import add, cross, dot, frame, lattice_point, lift, must, on_lattice, scale, slide, sub, vector

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
