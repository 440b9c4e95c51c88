"""Chapter 10: corners and arcs."""

from collections import namedtuple

from .ch02_conventions import add, frame, lattice_point, lift, must, on_lattice, scale, slide, sub, vector

Knot = namedtuple("Knot", "parameter level size_class position")
WHOLE = 65536


def decode_corners(stream, cluster):
    corners, before = [], cluster.low
    for _ in cluster.corners:
        before = on_lattice(tuple(before[k] + stream.get_signed(13 + k) for k in range(3)))
        corners.append(before)
    return corners


def ends_of_arc(arc, corners):
    """The knots that an arc begins with: its corners."""
    a, b = arc.ends
    return [Knot(0, 0, 7, corners[a]), Knot(WHOLE, 0, 7, corners[b])]


def decode_samples(stream, knots, level, count, tangent_shift):
    """The knots of an arc with the new ones of a level."""
    left = count
    width = WHOLE
    while width >= 2:
        # Knots of this width's middles are inserted at its end: all that is read here sees those from its beginning.
        by_parameter = {knot.parameter: knot for knot in knots}
        longer = []
        for k, (p, q) in enumerate(zip(knots, knots[1:])):
            longer.append(p)
            if q.parameter - p.parameter != width or left == 0:
                continue
            if stream.flag(split_context(knots, k, level, width)):
                left -= 1
                longer.append(decode_middle(stream, p, q, level, by_parameter, tangent_shift))
        longer.append(knots[-1])
        knots = longer
        width //= 2
    must(left == 0, "an arc has fewer samples than its index says")
    return knots


def split_context(knots, k, level, width):
    p, q = knots[k], knots[k + 1]
    is_new = level > 0 and level in (p.level, q.level)
    shorter = int(k > 0 and p.parameter - knots[k - 1].parameter < width)
    shorter += int(k + 2 < len(knots) and knots[k + 2].parameter - q.parameter < width)
    depth = (WHOLE // width).bit_length() - 1
    return 16 + 12 * is_new + 4 * shorter + min(depth, 3)


def decode_middle(stream, p, q, level, by_parameter, tangent_shift):
    width = q.parameter - p.parameter
    # Of two neighbours one is an odd multiple of their distance: that is the one divisible by the smaller power of two.
    above = p if p.parameter & width else q
    f, point = forecast(p, q, by_parameter.get(p.parameter - width), by_parameter.get(q.parameter + width))
    r0 = stream.get_signed(40 + above.size_class)
    r1 = stream.get_signed(48 + min(abs(r0).bit_length(), 7))
    r2 = stream.get_signed(56 + above.size_class)
    moved = slide(f, point, r0, r1)
    position = lattice_point(lift(f, moved, r2 * 2**tangent_shift))
    size_class = min(max(abs(r0), abs(r1)).bit_length(), 6)
    return Knot((p.parameter + q.parameter) // 2, level, size_class, position)


def forecast(p, q, before, after):
    at_p, at_q = vector(p.position), vector(q.position)
    o = before and vector(before.position)
    r = after and vector(after.position)
    if o and r:
        point = scale(sub(scale(add(at_p, at_q), 9), add(o, r)), 0.0625)
    elif o:
        point = scale(sub(add(scale(at_p, 6), scale(at_q, 3)), o), 0.125)
    elif r:
        point = scale(sub(add(scale(at_q, 6), scale(at_p, 3)), r), 0.125)
    else:
        point = scale(add(at_p, at_q), 0.5)
    chord = sub(at_q, at_p)
    k = min(range(3), key=lambda axis: abs(chord[axis]))
    direction = tuple(1.0 if axis == k else 0.0 for axis in range(3))
    return frame(chord, direction), point
