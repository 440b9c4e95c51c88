"""Seams of a textured mesh: whether both sides of each border of its map show the same.

    python3 tests/bench/seams.py INPUT STEP OUTPUT [OUTPUT ...]

Looks at five points of each edge at which the map is cut, within nodes and along arcs, and compares the colours of both sides, interpolated in linear light, in
components of sRGB from 0 to 255. STEP is the step of quantisation: 9 at the usual quality, 1 at quality 100. Where the input jumps from one colour to
another, or changes within less than a texel, two images of different lattices differ as well, and no eye sees a line there that the input does not have. So
what the input shows within a texel of each point is looked at, too, on both sides and along the edge: how far its colours differ is its range. Printed are

- the points, and the share at which sides differ by more than STEP;
- the same of even points, at which the input's range is at most 4;
- seams: points at which sides differ by more than STEP beyond the input's range,

of all, and of those where the texels of one side are larger than the other's, as where levels meet. Shares no code with lodpack; needs what
`colours.py` needs, and scipy.
"""

import sys

import numpy as np

import colours
import lines

POINTS, EVEN, LARGER = 5, 4, 1.2
# How far from a point the input is looked at, in texels: into both sides, and along the edge.
INWARDS, ALONG = (0.05, 0.25, 0.5, 0.75, 1.0), (-0.5, 0.0, 0.5)
# And at most this share of a triangle's height.
MOST_INWARDS = 0.9


def texels(output):
    """How long a texel is in each triangle, in the direction in which it is shortest: projections keep lengths along one direction."""
    surface, corners = output.surface, output.corners
    sizes = np.array([image.shape[1::-1] if image is not None else (0, 0) for _, image in surface.images])
    places = surface.places[surface.place_triangles] * sizes[surface.image_of][:, None, :]
    on_image = np.stack([places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]], axis=2)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.maximum(np.linalg.norm(first, axis=1), 1e-300)
    along = (second * first).sum(axis=1) / length
    height = np.maximum(np.linalg.norm(np.cross(first, second), axis=1) / length, 1e-300)
    inverse = np.zeros((len(length), 2, 2))
    inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1] = 1 / length, -along / (length * height), 1 / height
    return 1 / np.maximum(np.linalg.svd(on_image @ inverse, compute_uv=False)[:, 0], 1e-300)


class Border:
    """Points of the edges at which the map of a mesh is cut."""

    def __init__(self, output):
        self.surface, self.corners = output.surface, output.corners
        is_cut = output.piece[output.beside[0]] != output.piece[output.beside[1]]
        self.triangles = [np.repeat(side[is_cut], POINTS) for side in output.beside]
        self.ends = np.repeat(output.ends[is_cut], POINTS, axis=0)
        self.share = np.tile((np.arange(POINTS) + 0.5) / POINTS, is_cut.sum())
        self.points = self.ends[:, 0] + (self.ends[:, 1] - self.ends[:, 0]) * self.share[:, None]
        size = texels(output)
        self.texels = [size[side] for side in self.triangles]

    def difference(self):
        """How far the colours of both sides differ, in the component that differs most."""
        shown = [self.surface.colour(side, colours.weights_at(self.surface, side, self.points), True) for side in self.triangles]
        return np.abs(shown[0] - shown[1]).max(axis=1)

    def input_range(self, source):
        """How far the colours of the input differ within a texel of each point."""
        edge = self.ends[:, 1] - self.ends[:, 0]
        length = np.linalg.norm(edge, axis=1)
        edge /= np.maximum(length, 1e-300)[:, None]
        low, high = np.full(self.points.shape, np.inf), np.full(self.points.shape, -np.inf)
        for side, texel in zip(self.triangles, self.texels):
            inwards = self.corners[side].mean(axis=1) - self.points
            inwards -= edge * (inwards * edge).sum(axis=1)[:, None]
            # The middle of a triangle is at a third of its height.
            third = np.linalg.norm(inwards, axis=1)
            inwards /= np.maximum(third, 1e-300)[:, None]
            for depth in INWARDS:
                inside = self.points + inwards * np.minimum(depth * texel, MOST_INWARDS * 3 * third)[:, None]
                for step in ALONG:
                    aside = np.clip(step * texel, -self.share * length, (1 - self.share) * length)
                    colour = source.colour(inside + edge * aside[:, None])
                    low, high = np.minimum(low, colour), np.maximum(high, colour)
        return (high - low).max(axis=1)


def share(of, among):
    return f"{of.sum()} of {among.sum()} ({100 * of.sum() / max(among.sum(), 1):.3f} %)"


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    source, step = lines.Input(sys.argv[1]), float(sys.argv[2])
    for path in sys.argv[3:]:
        output = lines.Output(path)
        border = Border(output)
        difference, input_range = border.difference(), border.input_range(source)
        one, other = border.texels
        is_larger = np.maximum(one, other) > LARGER * np.minimum(one, other)
        print(f"{path}: {len(output.corners)} triangles, {len(difference) // POINTS} edges of borders")
        for name, which in [("all", np.ones(len(difference), bool)), ("where texels of one side are larger", is_larger)]:
            even = which & (input_range <= EVEN)
            differs = difference > step
            seams = which & (difference > step + input_range)
            print(
                f"  {name}: beyond {step:g} at {share(which & differs, which)} points, at {share(even & differs, even)} even ones; "
                f"seams at {share(seams, which)}, by {(difference - input_range)[seams].max(initial=0):.0f} at most",
                flush=True,
            )


if __name__ == "__main__":
    main()
