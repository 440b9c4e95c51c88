"""An open file of heights: a grid on a plane or around a globe."""

from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING, Any, NamedTuple, Sequence

from . import _lodpack
from ._checked import budget, corners as corners_of, number
from ._errors import QueryError
from ._info import HeightsInfo
from ._mesh import Mesh, as_array
from ._opened import OpenFile

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Bounds = Sequence[Sequence[float]] | NDArray[np.floating[Any]]


class Window(NamedTuple):
    """Samples of a rectangle of a grid, and where they are."""

    heights: NDArray[np.float64]
    """From the north-west, row by row: an array of two dimensions, with NaN where there are no heights."""
    first: tuple[float, float]
    """x and y of the first sample, or its degrees of longitude and latitude."""
    spacing: tuple[float, float]
    """What each column and each row adds. The second one is negative."""
    crs: str
    """The coordinate reference system, as EPSG and a number or as WKT; empty if there is none."""

    @property
    def transform(self) -> tuple[float, float, float, float, float, float]:
        """From column and row of a pixel's corner to coordinates, as rasterio and affine have it:
        ``Affine(*window.transform)``. Pixels lie around samples."""
        (x, y), (dx, dy) = self.first, self.spacing
        return (dx, 0.0, x - dx / 2, 0.0, dy, y - dy / 2)


class Image(NamedTuple):
    """A piece of the image over a grid, and where it is."""

    pixels: NDArray[np.uint8]
    """Rows, columns, and red, green and blue as screens show them; with straight opacity where a part is not
    covered."""
    first: tuple[float, float]
    """x and y of the corner of the first pixel, or its degrees of longitude and latitude."""
    spacing: tuple[float, float]
    """What each column and each row of pixels adds. The second one is negative."""
    crs: str
    """The coordinate reference system, as EPSG and a number or as WKT; empty if there is none."""

    @property
    def transform(self) -> tuple[float, float, float, float, float, float]:
        """From column and row of a pixel's corner to coordinates, as rasterio and affine have it."""
        (x, y), (dx, dy) = self.first, self.spacing
        return (dx, 0.0, x, 0.0, dy, y)


class HeightsFile(OpenFile[_lodpack.HeightsReader]):
    """An open file of heights. Threads may share it; while one of them reads or decodes, the others go on."""

    def info(self) -> HeightsInfo:
        """What the file holds. Reads nothing."""
        return self._native.info()

    def extract(
        self, *, tolerance: float | None = None, max_triangles: int | None = None, bbox: Bounds | None = None
    ) -> Mesh:
        """Reads and decodes the mesh of the coarsest cut within the tolerance, or of the finest one. It has no cracks,
        whatever is coarse or fine.

        `tolerance`: the error to reach, in units of coordinates.
        `max_triangles`: the most triangles, without those that tiles of different depths add where they meet.
        `bbox`: smallest and largest x and y, or longitude and latitude in degrees, as ((x0, y0), (x1, y1)); tiles that
        it touches are whole. It may be infinite.

        `Mesh.normals` are those of the slopes of the heights, and `Mesh.colours` those of the image over them or
        of the file's ramp, if it has one.

        Raises `QueryError` for what is not a number."""
        return self._mesh(tolerance, max_triangles, None if bbox is None else _corners(bbox))

    def _mesh(self, tolerance: float | None, max_triangles: int | None, bbox: list[list[float]] | None) -> Mesh:
        error, limited_by, (positions, corners, tiles, normals, colours) = self._native.extract(
            tolerance=None if tolerance is None else number(tolerance, "tolerance"),
            bbox=bbox,
            max_triangles=budget(max_triangles, "max_triangles"),
        )
        return Mesh(
            positions,
            corners,
            triangle_nodes=tiles,
            error=error,
            error_everywhere=error,
            limited_by=limited_by,
            normals=normals,
            vertex_colours=colours,
        )

    def window(
        self,
        *,
        bbox: Bounds | None = None,
        columns: tuple[int, int] | None = None,
        rows: tuple[int, int] | None = None,
    ) -> Window:
        """Reads the heights of a rectangle of samples: those within a box, or some columns and rows, from the first to
        before the last one; all without either. Around a globe, columns go on from the beginning: (350, 370) of 360
        crosses the end of the grid.

        The box may be infinite. Raises `QueryError` if there are no such samples, or more than fit in memory."""
        info = self._native.info()
        if bbox is not None:
            if columns is not None or rows is not None:
                raise QueryError("give a box, or columns and rows, not both")
            columns, rows = _within(info, _corners(bbox))
        first, last = _range(columns, info["columns"], "columns")
        north, south = _range(rows, info["rows"], "rows")
        if last <= first or south <= north:
            raise QueryError("a window has at least one column and one row")
        heights = as_array(self._native.window((first, last), (north, south)))
        (x, y), (dx, dy) = info["first"], info["spacing"]
        return Window(heights, (x + first * dx, y + north * dy), (dx, dy), info["crs"])

    def image(self, *, bbox: Bounds | None = None, max_pixels: int = 4096) -> Image | None:
        """Reads the image over the heights, or what of it lies within a box; None where there is none.

        `max_pixels`: how many pixels it has at most along each side, but for two more at its border. A larger image is
        halved until it has no more.

        Raises `QueryError` if no sample lies within the box, or no pixels are asked for."""
        info = self._native.info()
        columns, rows = (0, info["columns"]), (0, info["rows"])
        if bbox is not None:
            columns, rows = _within(info, _corners(bbox))
        if not 0 < operator.index(max_pixels) < 2**32:
            raise QueryError(f"max_pixels {max_pixels} is no number of pixels")
        # A grid that wraps ends where it begins.
        ends = [(float(first), float(last - (0 if wraps else 1))) for (first, last), wraps in ((columns, info["wraps"]), (rows, False))]
        found = self._native.image(ends[0], ends[1], max_pixels)
        if found is None:
            return None
        pixels, (column, row), steps = found
        (x, y), (dx, dy) = info["first"], info["spacing"]
        return Image(as_array(pixels), (x + column * dx, y + row * dy), (steps[0] * dx, steps[1] * dy), info["crs"])

    def verify(self) -> None:
        """Reads the complete file, and checks every checksum. Raises `FormatError` with the first damage."""
        self._native.verify()

    def __repr__(self) -> str:
        if self._open is None:
            return f"<lodpack.HeightsFile {self._name!r}, closed>"
        info = self.info()
        return f"<lodpack.HeightsFile {self._name!r}: {info['columns']:,} x {info['rows']:,} samples>"


def _corners(bbox: Any) -> list[list[float]]:
    """The two corners of a box on the map, as lists."""
    return corners_of(bbox, 2, "two corners of a map: ((x0, y0), (x1, y1))")


def _within(info: HeightsInfo, corners: list[list[float]]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The columns and rows of samples within a box."""
    (west, south), (east, north) = corners
    (x, y), (dx, dy) = info["first"], info["spacing"]
    # Beyond the grid one place is as good as another.
    south, north = (min(max(value, y + info["rows"] * dy), y - dy) for value in (south, north))
    around = info["columns"] * dx
    if not info["wraps"]:
        west, east = (min(max(value, x - dx), x + around) for value in (west, east))
    else:
        if math.inf in (-west, east) and west < math.inf and east > -math.inf:
            west, east = x, x + around
        elif not math.isfinite(west) or not math.isfinite(east):
            raise QueryError("no sample lies within the box")
        # East of the box, perhaps once more around the globe.
        east = west + min((east - west) % around if east < west else east - west, around - dx)
        shift = ((west - x) // around) * around
        west, east = west - shift, east - shift
    first, last = math.ceil((west - x) / dx - 1e-9), math.floor((east - x) / dx + 1e-9) + 1
    top, bottom = math.ceil((north - y) / dy - 1e-9), math.floor((south - y) / dy + 1e-9) + 1
    if not info["wraps"]:
        first, last = max(first, 0), min(last, info["columns"])
    elif first >= info["columns"]:
        first, last = first - info["columns"], last - info["columns"]
    top, bottom = max(top, 0), min(bottom, info["rows"])
    if last <= first or bottom <= top:
        raise QueryError("no sample lies within the box")
    return (first, last), (top, bottom)


def _range(wanted: tuple[int, int] | None, count: int, name: str) -> tuple[int, int]:
    if wanted is None:
        return 0, count
    try:
        first, last = (operator.index(number) for number in wanted)
    except (TypeError, ValueError):
        raise QueryError(f"give {name} as two whole numbers: the first one, and that behind the last one") from None
    if first < 0 or last < first or last > 2**63:
        raise QueryError(f"{name} {first} to {last} are not in a grid of {count}")
    return first, last
