"""Seams of a textured mesh: whether both sides of each border of its map show the same.

    python3 tests/bench/seams.py [--nodes FILE.lodpack] [--list] INPUT STEP OUTPUT [OUTPUT ...]

Looks at five points of each edge at which the map is cut, within nodes and along arcs, and compares the colours of both
sides, interpolated in linear light, in components of sRGB from 0 to 255. STEP is the step of quantisation: 9 at the
usual quality, 1 at quality 100. What is stored is brightness, with that step, and two differences of colour with half
as much again (SPEC.md, 21.3): sides are beyond a step where one of these three differs by more than its own. Where the
input itself jumps along a border, each side shows what the input does there: so edges are told apart at one of whose
points the input differs by more than 4 between a twentieth of a texel inside of one side and of the other (half a texel
where these meet at more than 45 degrees). Where the input changes within less than a texel, two images of different
lattices may differ, and no eye sees a line there that the input does not have: how far the input's colours differ
within a texel of a point, on both sides and along the edge, is its range. Printed are, of all points and of those of
edges along which the input does not jump,

- how many are beyond a step of what is stored, and by how much brightness differs at most;
- at how many some component of sRGB differs by more than STEP;
- seams: at how many it differs by more than STEP beyond the input's range,

of all, and of those where the texels of one side are larger than the other's, as where levels meet. With --nodes the
same is printed of arcs alone, which are the borders between nodes, and of those between nodes of two levels; OUTPUT is
then what `lodpack extract --raw` wrote of FILE, and the package for Python (`reader/python`) says which triangle is of
which node. --list prints each point beyond a step of edges along which the input does not jump, of arcs where nodes are
known: its place, by how many steps brightness and the two differences are off, and what the input shows there. Shares
no code with lodpack; needs what `colours.py` needs, and scipy.
"""

import argparse

import numpy as np
from scipy.spatial import cKDTree

import colours
import lines

POINTS, SAME, LARGER = 5, 4, 1.2
# Red, green and blue in brightness, and how much blue and red less brightness are of a difference that is stored
# (SPEC.md).
BRIGHTNESS, DIFFERENCES = np.array([0.299, 0.587, 0.114]), (256 / 454, 256 / 359)
# How far from a point the input is looked at, in texels: into both sides, and along the edge.
INWARDS, ALONG = (0.05, 0.25, 0.5, 0.75, 1.0), (-0.5, 0.0, 0.5)
# Cosine of the angle beyond which sides are folded.
FOLD = 0.7
# And at most this share of a triangle's height.
MOST_INWARDS = 0.9


def texels(output):
    """How long a texel is in each triangle, in the direction in which it is shortest: projections keep lengths along
    one direction."""
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
        """By how much the colours of both sides differ."""
        one, other = (self.surface.colour(side, colours.weights_at(self.surface, side, self.points), True) for side in self.triangles)
        return one - other

    def inwards(self):
        """For each side the direction from each point into it, and how far it reaches."""
        edge = self.along()
        for side in self.triangles:
            towards = self.corners[side].mean(axis=1) - self.points
            towards -= edge * (towards * edge).sum(axis=1)[:, None]
            # The middle of a triangle is at a third of its height.
            third = np.linalg.norm(towards, axis=1)
            yield towards / np.maximum(third, 1e-300)[:, None], 3 * third

    def along(self):
        edge = self.ends[:, 1] - self.ends[:, 0]
        return edge / np.maximum(np.linalg.norm(edge, axis=1), 1e-300)[:, None]

    def input_jump(self, source):
        """How far the colours of the input differ a little inside of both sides, and where these are folded, further
        inside: a closest point may lie on the other side."""
        normals = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        is_fold = (normals[self.triangles[0]] * normals[self.triangles[1]]).sum(axis=1) < FOLD
        depth = np.where(is_fold, INWARDS[2], INWARDS[0])
        one, other = (
            source.colour(self.points + towards * np.minimum(depth * texel, MOST_INWARDS * height)[:, None])
            for (towards, height), texel in zip(self.inwards(), self.texels)
        )
        return np.abs(one - other).max(axis=1)

    def input_range(self, source):
        """How far the colours of the input differ within a texel of each point."""
        edge, length = self.along(), np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)
        low, high = np.full(self.points.shape, np.inf), np.full(self.points.shape, -np.inf)
        for (towards, height), texel in zip(self.inwards(), self.texels):
            for depth in INWARDS:
                inside = self.points + towards * np.minimum(depth * texel, MOST_INWARDS * height)[:, None]
                for step in ALONG:
                    aside = np.clip(step * texel, -self.share * length, (1 - self.share) * length)
                    colour = source.colour(inside + edge * aside[:, None])
                    low, high = np.minimum(low, colour), np.maximum(high, colour)
        return (high - low).max(axis=1)


def nodes(output, path):
    """The node and the level of each triangle of an output that is a cut of a file."""
    import lodpack

    with lodpack.open(path) as file:
        mesh = file.extract(max_triangles=len(output.corners), channels="auto")
        textured = mesh.textured()
        levels = mesh.cut.nodes()[1]
    if len(textured.triangles) != len(output.corners):
        raise SystemExit(f"{path}: its cut has {len(textured.triangles)} triangles, not {len(output.corners)}; write the output with --raw")
    # GLB has positions in single precision: the closest middle is the triangle's own. Slivers may share one, and then
    # their corners tell.
    corners = textured.positions[textured.triangles]
    size = np.ptp(corners.reshape(-1, 3), axis=0).max()
    middles = np.stack([each.mean(axis=1) for each in (corners, output.corners)])
    _, near = cKDTree(middles[0]).query(middles[1], k=min(4, len(corners)))
    sorted_corners = [np.sort(each, axis=1) for each in (corners, output.corners)]
    off = np.abs(sorted_corners[0][near] - sorted_corners[1][:, None]).max(axis=(2, 3))
    best, off = near[np.arange(len(near)), off.argmin(axis=1)], off.min(axis=1)
    if off.max() > 1e-6 * size:
        raise SystemExit(f"{path}: a triangle of the output is {off.max():g} from those of its cut; write the output with --raw")
    of = textured.triangle_nodes[best]
    return of, levels[of]


def share(of, among):
    return f"{of.sum()} of {among.sum()} ({100 * of.sum() / max(among.sum(), 1):.3f} %)"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", metavar="FILE.lodpack")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("input")
    parser.add_argument("step", type=float)
    parser.add_argument("outputs", nargs="+")
    arguments = parser.parse_args()
    source, step = lines.Input(arguments.input), arguments.step
    for path in arguments.outputs:
        output = lines.Output(path)
        border = Border(output)
        difference, input_range = border.difference(), border.input_range(source)
        brightness = difference @ BRIGHTNESS
        in_steps = [brightness / step]
        for component, factor in zip((2, 0), DIFFERENCES):
            in_steps.append((difference[:, component] - brightness) * factor / ((3 * step + 1) // 2))
        is_beyond, most = np.abs(in_steps).max(axis=0) > 1, np.abs(difference).max(axis=1)
        one, other = border.texels
        is_larger = np.maximum(one, other) > LARGER * np.minimum(one, other)
        jump = border.input_jump(source).reshape(-1, POINTS).max(axis=1)
        is_same = np.repeat(jump <= SAME, POINTS)
        all_points = np.ones(len(difference), bool)
        kinds, listed = [("all", all_points), ("where texels of one side are larger", is_larger)], all_points
        print(f"{path}: {len(output.corners)} triangles, {len(difference) // POINTS} edges of borders")
        if arguments.nodes is not None:
            of_nodes, of_levels = nodes(output, arguments.nodes)
            is_arc, of_two_levels = (of[border.triangles[0]] != of[border.triangles[1]] for of in (of_nodes, of_levels))
            kinds += [("arcs", is_arc), ("arcs where texels of one side are larger", is_arc & is_larger)]
            kinds += [("arcs between levels", of_two_levels)] if of_two_levels.any() else []
            listed = is_arc
        for name, which in kinds:
            for of, among in [("", which), (", of edges along which the input does not jump", which & is_same)]:
                print(
                    f"  {name}{of}: beyond a step at {share(among & is_beyond, among)}, brightness by {np.abs(brightness)[among].max(initial=0):.1f} at most; "
                    f"beyond {step:g} in sRGB at {(among & (most > step)).sum()}; seams at {(among & (most > step + input_range)).sum()}",
                    flush=True,
                )
        for point in np.flatnonzero(listed & is_same & is_beyond) if arguments.list else []:
            length = np.linalg.norm(border.ends[point, 1] - border.ends[point, 0])
            print(
                f"  at {border.points[point].round(6).tolist()}: off by {', '.join(f'{steps[point]:.2f}' for steps in in_steps)} steps, "
                f"{np.abs(difference[point]).max():.1f} in sRGB; texels {one[point] / length:.3g} and {other[point] / length:.3g} of the edge; "
                f"the input's colours differ by {input_range[point]:.1f} within a texel, {jump[point // POINTS]:.1f} across"
            )


if __name__ == "__main__":
    main()
