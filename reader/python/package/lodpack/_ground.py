"""The ground that a mesh stands on: heights in the same file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import _lodpack
from ._checked import number
from ._errors import QueryError
from ._file import box_corners
from ._heights import HeightsFile
from ._mesh import Mesh, as_array

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ._file import Bounds


class Ground:
    """Heights that a mesh stands on, and where they are in its space. `File.ground` opens it."""

    heights: HeightsFile
    """The heights in coordinates of their own: all that a file of heights can do."""
    transform: NDArray[np.float64]
    """The matrix of four rows and columns that takes coordinates of the heights to those of the mesh; trimesh's
    ``apply_transform`` takes it."""
    scale: float
    """Units of the mesh in a unit of the heights. Errors and tolerances grow by it."""

    def __init__(self, heights: _lodpack.HeightsReader, frame: _lodpack.GroundFrame) -> None:
        self.heights, self._frame = HeightsFile(heights), frame
        self.transform, self.scale = as_array(frame.transform()), frame.scale

    def points(self, points: Any) -> NDArray[np.float64]:
        """Points of the heights, an array of shape (n, 3), in the space of the mesh."""
        import numpy as np

        placed: NDArray[np.float64] = np.asarray(points, dtype=float) @ self.transform[:3, :3].T + self.transform[:3, 3]
        return placed

    def extract(self, *, tolerance: float | None = None, max_triangles: int | None = None, bbox: Bounds | None = None) -> Mesh:
        """As `HeightsFile.extract`, in the space of the mesh: `tolerance` and the error are in its units, and `bbox`
        are two corners of three coordinates as `File.extract` takes them. What is above or below the box belongs to
        it."""
        corners = None if bbox is None else box_corners(bbox)
        if corners is not None and any(low > high for low, high in zip(*corners)):
            raise QueryError("the smallest corner of a volume has to come first")
        mesh = self.heights._mesh(
            None if tolerance is None else number(tolerance, "tolerance") / self.scale,
            max_triangles,
            None if corners is None else self._frame.map_box(corners),
        )
        mesh.positions = self.points(mesh.positions)
        if mesh.normals is not None:
            turned = self.transform[:3, :3] / self.scale
            mesh.normals = (mesh.normals @ turned.T).astype(mesh.normals.dtype)
        mesh.error *= self.scale
        mesh.error_everywhere *= self.scale
        return mesh

    def __repr__(self) -> str:
        return f"<lodpack.Ground of {self.heights!r}>"
