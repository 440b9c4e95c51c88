"""How a textured mesh looks beside its input: FLIP and SSIM of pictures from six sides, unlit, on white.

    python3 tests/bench/look.py INPUT OUTPUT [OUTPUT ...]

Rays along the axes hit each mesh, and show its colour as `colours.py` has it, so that nothing is shared with lodpack.
FLIP is the mean over the picture at its usual 67 pixels a degree (0 for the same picture), SSIM that of the bytes (1
for the same picture), both means over the six sides. Needs what `colours.py` needs, flip-evaluator and scikit-image.
"""

import sys

import flip_evaluator
import numpy as np
import vtk
from skimage.metrics import structural_similarity

import colours

SIDE = 384


def pictures(surface, low, high):
    mesh = surface.mesh()
    locator = vtk.vtkStaticCellLocator()
    locator.SetDataSet(mesh)
    locator.BuildLocator()
    middle, reach = (low + high) / 2, (high - low).max() * 0.52
    steps = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    t, part, cell, hit, weights = vtk.mutable(0.0), vtk.mutable(0), vtk.mutable(0), [0.0] * 3, [0.0] * 3
    for axis in range(3):
        for sign in [-1, 1]:
            triangles, points, texels = [], [], []
            for row, down in enumerate(steps):
                for column, across in enumerate(steps):
                    start = middle.copy()
                    start[(axis + 1) % 3] += across * reach
                    start[(axis + 2) % 3] -= down * reach
                    end = start.copy()
                    start[axis] += sign * 2 * reach
                    end[axis] -= sign * 2 * reach
                    if locator.IntersectWithLine(start, end, 1e-9, t, hit, weights, part, cell):
                        triangles.append(int(cell))
                        points.append(hit[:])
                        texels.append((row, column))
            picture = np.full((SIDE, SIDE, 3), 255.0)
            triangles, points, texels = np.array(triangles), np.array(points), np.array(texels)
            picture[texels[:, 0], texels[:, 1]] = surface.colour(triangles, colours.weights_at(surface, triangles, points), True)
            yield np.clip(picture, 0, 255)


def main():
    source = colours.read(sys.argv[1])
    low, high = source.positions.min(axis=0), source.positions.max(axis=0)
    wanted = list(pictures(source, low, high))
    for path in sys.argv[2:]:
        output = colours.read(path)
        flips, similar = [], []
        for one, other in zip(wanted, pictures(output, low, high)):
            flips.append(flip_evaluator.evaluate((one / 255).astype(np.float32), (other / 255).astype(np.float32), "LDR")[1])
            similar.append(structural_similarity(one, other, channel_axis=2, data_range=255))
        print(f"{path}: {len(output.triangles)} triangles, FLIP {np.mean(flips):.4f}, SSIM {np.mean(similar):.4f}")


if __name__ == "__main__":
    main()
