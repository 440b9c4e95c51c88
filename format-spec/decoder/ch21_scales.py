"""Chapter 21.8: images in scales."""

from .ch02_conventions import must
from .ch21_texels import BitStream, COSINES, colour

# ---- Chances ---------------------------------------------------------------------------------------------------------

KNOWN = bytes.fromhex(
    """
    80641eef5cf4855146342d2823180e262313129c79eabc885f473a2c342727232124286b83bea88e7b5c56403d2e321d272d234a868e8e7f776563523f353b2c
    2c221e3885696c6d645d5a59514a3b3734352b56805a433e37322c2825211f1c1a17161b812f2e2e31333334333234313132300f7f1615141313121212121111
    111110f88afed68a7b44a71b1b1b1be5808080af84fae4b17f522b46433340302f051f8a7fe5d6bb9b8152503631285e671c466980c4c0ac968a6e645b463a33
    61031250829fa699847b71675556373c2e33249c839e807973695f554b47403c38342b278149454443403e3b3733312d292725127c1a191a1b1a1a1919181818
    18171580808080808080808080808080808080ef9355302c241e19fef3ddc2a8875f31e3ae8b73624f4b3e372e3229252ab7a78875685a534a403e33333b2960
    7a77685e534d48413d3b3433312d292b2b29262422201f1c1c1a1ae1f0eeee80808080808080808080808080808080feefbf946d533c23fff8ead4b2906231fa
    deb4a87e7691356a1b5e252525edd4baa0a18d678357b4158080c7b3bcad958a78726f6b626e3d54634d4f5049433d393633312c2b2826e1f3f2f3fce7bc9369
    3f1a0dfee6b4865d3c1f0f54484c453f393e23589ea9a29a8c713985625c4f4b44341dc3cfccb38b5f3e2001ebe4d4c1a67e3ea5acb7a88f704d2401d8d4bfa1
    7f5528edc19a8b6777444b1e4c2f77471ee2c09f867165595146514649262cc1ad9b8b7a6d60534b563a3e32265d5349423b35312e2a272523222080808080ff
    edcda57b57220dfff6d8a6775e1f0b776565584a3e341e81b3b5ae9a866031556e64605749351dcde5e2cda77d522601f7f1e2c7a0723bddd1cfbb99764f2801
    ede5d1ad84542bfdf1c7bce5808080808080808080f8e6c6a680a359801be580808080e1d8c5b39d937a5a4e7a1e9815157d7a6d62554d4b423d3c4038362d80
    808080fff5e0be935f3011fff6e0c19c6e3912bdac887256422d18e3c2b0a18c6d4b27f0d8b399816246278080808080808080d9d4c1b08e664620f2e7d7be9d
    76532bf4e4c9ad8e6c4b29cfd8cbb092714d2df6ecc8a37b543a1cfbf1d6b48f6e4b2dfbefceae8c6b4828f8edd3b691714d2cfdf8debb956b4422fef9e4c4a5
    7e552efdf7dcc09e79552efdf7e2c8a77e552cf8dabb9787733d5c4a9d5e252580ebd6ba9f8e72724b594e7747340ac0bcb0a08a7d786650656263583e60615c
    544e47433e39383534302e80808080fffef6e2c3a14b14fffef6e2bc953a0de5d9b18c67472812f3d4c2a98c6b4827fde7c5a98961411e8080808080808080f4
    f0dbbc94673b17fbf2e3c9a27b4e29fdeed7bb966d4620efe5d2bb956a4121fef7deb48758341afef8e3c39a6e4125fef5dab790663b1bfef3ddbd9363402eff
    fdebc68e5b300bfffdeecfa5734630fffce7c89d6a3e19fffbe5c69b6b4020fefceb8080808080808080808080faefe6ba9da239c7808080808080dde1dbcdd5
    80bc5e25db808080807a8d8a827b706d67765f5f65697680808080
    """
)
CLASSES = [0, 2, 7, 16]


class Chance:
    def __init__(self, known):
        self.slow = self.fast = 256 * known
        self.count = 4


class Bits(BitStream):
    def bit(self, chance):
        b = 0 if self.below((self.range >> 12) * min(max((chance.slow + chance.fast) >> 5, 4), 4091)) else 1
        r = 131072 // (2 * chance.count + 3)
        if b == 0:
            chance.slow += ((65535 - chance.slow) * r) >> 16
            chance.fast += (65535 - chance.fast) >> 4
        else:
            chance.slow -= (chance.slow * r) >> 16
            chance.fast -= chance.fast >> 4
        chance.count = min(chance.count + 1, 200)
        return b

    def number(self, unary):
        for v in range(14):
            if self.bit(unary[v]) == 0:
                return v
        k = 0
        while self.raw(1) == 1:
            k += 1
            must(k <= 16, "a coefficient of an image is too large")
        return 13 + 2**k + self.raw(k)


def chances_of(scale):
    """The skip chances, and for both kinds of planes a dictionary of lists."""
    at = 0
    for s in range(scale + 1):
        skip, kinds = [], []
        if s == 0:
            skip, at = [Chance(x) for x in KNOWN[at : at + 3]], at + 3
        for _ in range(2):
            of_plane = {}
            lists = [("mean", 8, 16)] if s == 0 else [("quarter", 2, 8), ("zero", CLASSES[s], 8), ("size", 4, 14), ("sign", 1, 4)]
            for name, count, length in lists:
                of_plane[name] = [[Chance(x) for x in KNOWN[at + length * k : at + length * (k + 1)]] for k in range(count)]
                at += count * length
            kinds.append(of_plane)
    return skip, kinds


def bin_of(total):
    return next((k for k, most in enumerate([0, 2, 4, 6, 9, 14, 24]) if total <= most), 7)


# ---- Levels ----------------------------------------------------------------------------------------------------------


class Levels:
    """Of each block that is not left out, by row and column, the levels of each plane by (u, v)."""

    def __init__(self, width, height, components):
        self.columns, self.rows = (width + 7) // 8, (height + 7) // 8
        self.is_difference = [components >= 3 and c in (1, 2) for c in range(components)]
        self.blocks = {}

    def places(self):
        return ((row, column) for row in range(self.rows) for column in range(self.columns))

    def mean(self, row, column, plane):
        block = self.blocks.get((row, column))
        return block[plane].get((0, 0), 0) if block else None

    def decode_means(self, bits):
        skip, kinds = chances_of(0)
        for row, column in self.places():
            beside = [(row, column - 1), (row - 1, column)]
            if bits.bit(skip[sum(place in self.blocks for place in beside)]) == 0:
                continue
            block, d = [], 0
            for c, is_difference in enumerate(self.is_difference):
                left, above = (self.mean(*place, c) for place in beside)
                expected, spread = 0, 10**9
                if left is not None and above is not None:
                    corner, right = self.mean(row - 1, column - 1, c), self.mean(row - 1, column + 1, c)
                    corner = (left + above) >> 1 if corner is None else corner
                    right = above if right is None else right
                    expected = min(max(left + above - corner, min(left, above)), max(left, above))
                    spread = abs(left - corner) + abs(above - corner) + abs(above - right)
                elif left is not None or above is not None:
                    expected, spread = left if left is not None else above, 12
                spread += min(abs(d), 8) if is_difference else 0
                zero, sign, *unary = kinds[is_difference]["mean"][bin_of(spread)]
                d = 0
                if bits.bit(zero) == 1:
                    is_negative = bits.bit(sign)
                    d = (bits.number(unary) + 1) * (-1 if is_negative else 1)
                must(abs(expected + d) <= 4095, "a coefficient of an image is too large")
                block.append({(0, 0): expected + d})
            self.blocks[row, column] = block

    def slope(self, p, q, m):
        if p is not None and q is not None:
            return p - q
        return 2 * (m - q) if q is not None else 2 * (p - m) if p is not None else 0

    def decode_band(self, bits, s):
        _, kinds = chances_of(s)
        h, nothing = 2 ** (s - 1), {}
        for (row, column), block in self.blocks.items():
            for c, is_difference in enumerate(self.is_difference):
                chances, own = kinds[is_difference], block[c]
                left, above = (self.blocks.get(place, {c: nothing})[c] for place in ((row, column - 1), (row - 1, column)))
                b = block[0] if is_difference else nothing
                u_plane = block[1] if is_difference and c == 2 else nothing

                def total(levels, x, y, side):
                    return sum(abs(levels.get((u, v), 0)) for v in range(y, y + side) for u in range(x, x + side))

                def o(u, v):
                    return abs(own.get((u, v), 0)) if (u, v) != (0, 0) else 0

                for x, y in ((h, 0), (0, h), (h, h)):
                    if s > 1:
                        e = total(left, x, y, h) + total(above, x, y, h) + 2 * total(own, x // 2, y // 2, h // 2)
                        e += 2 * min(total(u_plane, x, y, h), 4) + min(total(b, x, y, h), 8) // 2
                        if bits.bit(chances["quarter"][x == y][bin_of(e)]) == 0:
                            continue
                    for u, v in ((u, v) for v in range(y, y + h) for u in range(x, x + h)):
                        e = 2 * abs(left.get((u, v), 0)) + 2 * abs(above.get((u, v), 0)) + 2 * o(u - 1, v) + 2 * o(u, v - 1)
                        e += o(u - 1, v - 1) + o(u // 2, v // 2) + abs(b.get((u, v), 0)) + 2 * abs(u_plane.get((u, v), 0))
                        g = 0
                        if (u, v) == (1, 0):
                            g = self.slope(self.mean(row, column - 1, c), self.mean(row, column + 1, c), own[0, 0])
                        if (u, v) == (0, 1):
                            g = self.slope(self.mean(row - 1, column, c), self.mean(row + 1, column, c), own[0, 0])
                        q = bin_of(e + 2 * (abs(g) // 7))
                        if bits.bit(chances["zero"][class_of(s, u, v)][q]) == 0:
                            continue
                        size = bits.number(chances["size"][q // 2]) + 1
                        must(size <= 4095, "a coefficient of an image is too large")
                        if g == 0:
                            is_negative = bits.raw(1) == 1
                        else:
                            is_negative = (bits.bit(chances["sign"][0][min(abs(g) // 7, 3)]) == 1) != (g < 0)
                        own[u, v] = -size if is_negative else size


def class_of(s, u, v):
    a, c = max(u, v), min(u, v)
    if s < 3:
        return c if s == 1 or a == 2 else 3 + c
    return 4 * (a - 4) + (0 if c == 0 else 1 if c <= 2 else 2 if c <= 4 else 3)


# ---- Images ----------------------------------------------------------------------------------------------------------

COSINES_OF = {
    8: COSINES,
    4: [[2048, 2048, 2048, 2048], [2676, 1108, -1108, -2676], [2048, -2048, -2048, 2048], [1108, -2676, 2676, -1108]],
    2: [[2896, 2896], [2896, -2896]],
    1: [[4096]],
}


def decode_scaled(streams, width, height, components):
    """Rows of texels at the scale of the last stream; None for those of blocks that are left out."""
    s = len(streams) - 1
    n = 2**s
    size = [-(-length * n // 8) for length in (width, height)]
    must(len(streams[0]) > 0, "an image has no bytes")
    step = streams[0][0]
    if step == 0:
        must(len(streams[0]) == 1 + components, "an image of one colour does not have the bytes of one")
        must(not any(streams[1:]), "an image of one colour has finer scales")
        return [[tuple(streams[0][1:])] * size[0] for _ in range(size[1])]
    levels = Levels(width, height, components)
    bits = Bits(streams[0][1:])
    levels.decode_means(bits)
    bits.end()
    for scale, stream in enumerate(streams[1:], 1):
        if stream:
            bits = Bits(stream)
            levels.decode_band(bits, scale)
            bits.end()
    steps = [(3 * step + 1) // 2 if is_difference else step for is_difference in levels.is_difference]
    rows = [[None] * size[0] for _ in range(size[1])]
    for (row, column), block in levels.blocks.items():
        planes = [values(own, plane_step, n, s) for own, plane_step in zip(block, steps)]
        for y in range(min(n, size[1] - n * row)):
            for x in range(min(n, size[0] - n * column)):
                rows[n * row + y][n * column + x] = colour([plane[y][x] for plane in planes])
    return rows


def values(levels, step, n, s):
    must(all(abs(level) * step <= 4095 for level in levels.values()), "a coefficient of an image is too large")
    cosines, coefficient = COSINES_OF[n], lambda u, v: levels.get((u, v), 0) * step
    t = [[(sum(coefficient(x, v) * cosines[v][y] for v in range(n)) + 256) >> 9 for x in range(n)] for y in range(n)]
    half = 2 ** (17 - s)
    return [[(sum(t[y][u] * cosines[u][x] for u in range(n)) + half) >> (18 - s) for x in range(n)] for y in range(n)]
