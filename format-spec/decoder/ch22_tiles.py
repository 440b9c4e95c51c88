"""Chapters 22.2 and 22.5: samples in space, and drawn tiles."""

import math

from .ch02_conventions import dot, sub
from .ch22_heights import bit, CELLS, COSINE, SIDE, SINE


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
