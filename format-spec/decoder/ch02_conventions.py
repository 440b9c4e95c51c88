"""Chapter 2: numbers in bytes, arithmetic, local frames, error codes."""

import math
import struct
from collections import namedtuple


class Damaged(Exception):
    """The file breaks a *must* of SPEC.md, or exceeds a limit of this decoder."""


def must(condition, what):
    if not condition:
        raise Damaged(what)


# ---- 2.1 Numbers in
# bytes ------------------------------------------------------------------------------------------------


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


# ---- 2.2
# Arithmetic ------------------------------------------------------------------------------------------------------

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


# ---- 2.3 Local
# frames ----------------------------------------------------------------------------------------------------

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


# ---- 2.5 Error
# codes -----------------------------------------------------------------------------------------------------


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
