"""Lines between pieces of a textured mesh: pictures from 200 places, and where the colour steps along a border more
than the input's does.

    python3 tests/bench/lines.py INPUT STEP OUTPUT [OUTPUT ...]

Each picture looks at a point of the surface, up to 50 degrees aslant, and a pixel is as large as a texel of the output
(384 x 384 pixels, no perspective, unlit, interpolated in linear light). Of each two pixels side by side that show one
surface the colours are compared with those of the input at the points of it that are closest to what both pixels show.
Counted are those where the output steps further than the input by more than STEP of 255 in some component (9 is the
step of quantisation at the usual quality, 1 at quality 100): where the map is cut between the two pixels, and, beside
that, within pieces, where nothing but texels and their quantisation is seen. A line is where at least eight such pixels
lie together.

Where a line of the input runs within a pixel of a border and the output has it a fraction of a texel aside, that counts
as well, though the output shows no line that the input does not have. So all is counted once more where the output
steps further by more than STEP than the input's colours differ within a pixel of the two. Shares no code with lodpack;
needs what `colours.py` needs, and scipy.
"""

import sys

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

import colours

VIEWS, SIDE, SLANT, LINE = 200, 384, 50, 8
# Pixels of one surface are at most this many of their widths apart.
NEAR = 4


class Output:
    """A mesh with the pieces that its map consists of."""

    def __init__(self, path):
        self.surface = surface = colours.read(path)
        points, index = np.unique(surface.positions, axis=0, return_inverse=True)
        self.corners = surface.positions[surface.triangles]
        triangles = index.ravel()[surface.triangles]
        edges = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
        places = np.concatenate([surface.place_triangles[:, [k, (k + 1) % 3]] for k in range(3)])
        flipped = edges[:, 0] > edges[:, 1]
        edges[flipped], places[flipped] = edges[flipped, ::-1], places[flipped, ::-1]
        of = np.tile(np.arange(len(triangles)), 3)
        key = edges[:, 0].astype(np.int64) * len(points) + edges[:, 1]
        order = np.argsort(key, kind="stable")
        same = np.flatnonzero(np.diff(key[order]) == 0)
        one, other = order[same], order[same + 1]
        apart = np.abs(surface.places[places[one]] - surface.places[places[other]]).max(axis=(1, 2)) > 1e-6
        joined = ~apart & (surface.image_of[of[one]] == surface.image_of[of[other]])
        pairs = of[one[joined]], of[other[joined]]
        # The triangles on both sides of each edge, and where it begins and ends.
        self.beside, self.ends = (of[one], of[other]), points[edges[one]]
        graph = coo_matrix((np.ones(len(pairs[0])), pairs), shape=(len(triangles),) * 2)
        self.piece = connected_components(graph, directed=False)[1]
        self.texel = self.texel_size()

    def texel_size(self):
        """The median over triangles of the length of a texel."""
        surface = self.surface
        sizes = np.array([image.shape[1::-1] if image is not None else (0, 0) for _, image in surface.images])
        places = surface.places[surface.place_triangles] * sizes[surface.image_of][:, None, :]
        (ax, ay), (bx, by) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
        flat = np.abs(ax * by - ay * bx)
        area = np.linalg.norm(np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]), axis=1)
        return np.median(np.sqrt(area[flat > 0] / flat[flat > 0]))


def drawn(output, look_at, frame):
    """For each pixel the triangle that is seen (-1 for none) and its point."""
    half = SIDE / 2
    seen = (output.corners - look_at) @ frame.T / output.texel
    seen[:, :, :2] += half
    low, high = seen[:, :, :2].min(axis=1), seen[:, :, :2].max(axis=1)
    triangle, depth = np.full((SIDE, SIDE), -1), np.full((SIDE, SIDE), -np.inf)
    for number in np.flatnonzero(((low < SIDE) & (high > 0)).all(axis=1)):
        (x0, y0), (x1, y1) = np.maximum(np.ceil(low[number] - 0.5), 0).astype(int), np.minimum(np.floor(high[number] - 0.5) + 1, SIDE).astype(int)
        if x0 >= x1 or y0 >= y1:
            continue
        a, b, c = seen[number]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0:
            continue
        x, y = np.arange(x0, x1)[None, :] + 0.5, np.arange(y0, y1)[:, None] + 0.5
        of_b = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
        of_c = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
        z = a[2] + of_b * (b[2] - a[2]) + of_c * (c[2] - a[2])
        inside = (of_b >= 0) & (of_c >= 0) & (of_b + of_c <= 1) & (z > depth[y0:y1, x0:x1])
        triangle[y0:y1, x0:x1][inside], depth[y0:y1, x0:x1][inside] = number, z[inside]
    rows, columns = np.indices((SIDE, SIDE))
    points = np.stack([columns + 0.5 - half, rows + 0.5 - half, np.where(triangle >= 0, depth, 0)], axis=-1)
    return triangle, points * output.texel @ frame + look_at


class Input:
    def __init__(self, path):
        self.surface = colours.read(path)
        self.mesh = self.surface.mesh()

    def colour(self, points):
        found, closest = self.mesh.find_closest_cell(points, return_closest_point=True)
        return self.surface.colour(found, colours.weights_at(self.surface, found, closest), True)


class Around:
    """The smallest and the largest colours of the input within a pixel of pixels."""

    def __init__(self, source, points, is_seen, near):
        wanted = ndimage.binary_dilation(is_seen, np.ones((3, 3))) & ~np.isnan(points).any(axis=2)
        colours_of = np.full(points.shape, np.nan)
        if wanted.any():
            colours_of[wanted] = source.colour(points[wanted])
        padded, places = (np.pad(of, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan) for of in (colours_of, points))
        self.low, self.high = np.full(points.shape, np.inf), np.full(points.shape, -np.inf)
        for row in range(3):
            for column in range(3):
                beside = np.s_[row : row + SIDE, column : column + SIDE]
                is_near = (np.linalg.norm(places[beside] - points, axis=2) < near)[:, :, None] & ~np.isnan(padded[beside])
                self.low = np.where(is_near, np.fmin(self.low, padded[beside]), self.low)
                self.high = np.where(is_near, np.fmax(self.high, padded[beside]), self.high)

    def range(self, one, other):
        low, high = self.low.reshape(-1, 3), self.high.reshape(-1, 3)
        return np.maximum(high[one], high[other]) - np.minimum(low[one], low[other])


def views(output):
    """Points of the surface and frames to look at them with: across, down, towards the viewer."""
    random = np.random.default_rng(7)
    normals = np.cross(output.corners[:, 1] - output.corners[:, 0], output.corners[:, 2] - output.corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    for triangle in random.choice(len(areas), VIEWS, p=areas / areas.sum()):
        towards = normals[triangle] / areas[triangle]
        across = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
        across /= np.linalg.norm(across)
        around, slant = random.uniform(0, 2 * np.pi), np.radians(random.uniform(0, SLANT))
        aside = np.cos(around) * across + np.sin(around) * np.cross(towards, across)
        towards = np.cos(slant) * towards + np.sin(slant) * aside
        across = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
        across /= np.linalg.norm(across)
        yield output.corners[triangle].mean(axis=0), np.stack([across, np.cross(towards, across), towards])


def main():
    source, step = Input(sys.argv[1]), float(sys.argv[2])
    random = np.random.default_rng(7)
    for path in sys.argv[3:]:
        output = Output(path)
        surface = output.surface
        # Beside the input's step between the same points, and beside its range within a pixel of them.
        counts, pixels, lines, views_with_lines, within = np.zeros((2, 4)), 0, [0, 0], [0, 0], np.zeros(3)
        for look_at, frame in views(output):
            triangle, points = drawn(output, look_at, frame)
            points[triangle < 0] = np.nan
            t, p = triangle.ravel(), points.reshape(-1, 3)
            pairs, is_seen = [], np.zeros(SIDE * SIDE, bool)
            for axis in range(2):
                one = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
                other = np.moveaxis(np.moveaxis(one, axis, 0)[1:], 0, axis).ravel()
                one = np.moveaxis(np.moveaxis(one, axis, 0)[:-1], 0, axis).ravel()
                both = (t[one] >= 0) & (t[other] >= 0)
                one, other = one[both], other[both]
                # One surface, and not what lies behind its rim.
                near = np.linalg.norm(p[one] - p[other], axis=1) < NEAR * output.texel
                one, other = one[near], other[near]
                cut = output.piece[t[one]] != output.piece[t[other]]
                inner = np.flatnonzero(~cut)
                inner = random.choice(inner, min(len(inner), 500), replace=False)
                for chosen, is_border in [(np.flatnonzero(cut), True), (inner, False)]:
                    if len(chosen) > 0:
                        pairs.append((one[chosen], other[chosen], is_border))
                        is_seen[one[chosen]] = is_seen[other[chosen]] = True
            around = Around(source, points, is_seen.reshape(SIDE, SIDE), NEAR * output.texel)
            is_off = np.zeros((2, SIDE * SIDE), bool)
            for a, b, is_border in pairs:
                shown = [surface.colour(t[k], colours.weights_at(surface, t[k], p[k]), True) for k in (a, b)]
                wanted = [source.colour(p[k]) for k in (a, b)]
                stepped = np.abs(shown[0] - shown[1])
                excess = [(stepped - of_input).max(axis=1) for of_input in (np.abs(wanted[0] - wanted[1]), around.range(a, b))]
                if is_border:
                    pixels += len(a)
                    for k in range(2):
                        counts[k] += [(excess[k] > limit).sum() for limit in (step, 2 * step, 16, 32)]
                        is_off[k, a[excess[k] > step]] = True
                else:
                    within += [len(a), *((of_kind > step).sum() for of_kind in excess)]
            for k in range(2):
                labels, _ = ndimage.label(is_off[k].reshape(SIDE, SIDE), np.ones((3, 3)))
                sizes = np.bincount(labels.ravel())[1:]
                lines[k] += (sizes >= LINE).sum()
                views_with_lines[k] += (sizes >= LINE).any()
        print(f"{path}: {len(surface.triangles)} triangles, {VIEWS} views, {pixels} pairs of pixels across borders", flush=True)
        for k, name in enumerate(["the input does", "the input's colours differ within a pixel"]):
            shares = ", ".join(f"{100 * count / max(pixels, 1):.2f} %" for count in counts[k])
            print(
                f"  more than {name} by more than {step:g}, {2 * step:g}, 16, 32: {shares}; within pieces by more than {step:g}: "
                f"{100 * within[k + 1] / max(within[0], 1):.2f} %; {lines[k]} lines of {LINE} pixels or more, in {views_with_lines[k]} views",
                flush=True,
            )


if __name__ == "__main__":
    main()
