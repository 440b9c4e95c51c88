"""Chapter 21: maps and images."""

import math

from .ch02_conventions import add, dot, frame, must, scale, sub, unzigzag, vector


# ---- 21.1
# Bits -----------------------------------------------------------------------------------------------------------


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
        must(self.at <= len(self.data) + 5, "a string of bits ends early")
        must(self.at >= len(self.data), "a string of bits has bytes left over")


# ---- 21.2
# Maps -----------------------------------------------------------------------------------------------------------

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


# ---- 21.3
# Colours --------------------------------------------------------------------------------------------------------


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


# ---- 21.4
# Values ---------------------------------------------------------------------------------------------------------


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


# ---- 21.5
# Normals --------------------------------------------------------------------------------------------------------


def directions(rows, map_, share=1.0):
    """Directions as three bytes, 128 + 127 times each coordinate; 0 beside all pieces. Places of the map are multiplied
    by a share where the image is a smaller one (21.8)."""
    result = [[(0, 0, 0)] * len(rows[0]) for _ in rows]
    pieces = zip(map_.axes, map_.normals, map_.sizes, map_.ranges)
    for (u, v), normal, (length, width), ((left, right), (top, bottom)) in pieces:
        u, v = scale(u, length), scale(v, width)
        for y in range(int(top * share), int(bottom * share) + 1):
            for x in range(int(left * share), int(right * share) + 1):
                a, b = ((byte - 128) / 127 for byte in rows[y][x])
                square = a * a + b * b
                if square > 1:
                    a, b, square = a / math.sqrt(square), b / math.sqrt(square), 1.0
                reach = math.sqrt(2 - square)
                along = add(add(scale(u, a * reach), scale(v, b * reach)), scale(normal, 1 - square))
                result[y][x] = tuple(int(k * 127 + 128 + 0.5) for k in along)
    return result


# ---- 21.7 Exact
# colours --------------------------------------------------------------------------------------------------


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
