"""The mesh of a cut as arrays, and as objects of other libraries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ._file import Cut


class Mesh:
    """Triangles with a certified error. The arrays are those that the decoder has written: nothing is copied."""

    positions: NDArray[np.float64]
    """World positions: an array of shape (n, 3). Vertices that several roots share occur once."""
    triangles: NDArray[np.uint32]
    """Indices of positions, counter-clockwise seen from outside: an array of shape (m, 3)."""
    triangle_nodes: NDArray[np.uint32] | None
    """For each triangle the position of its node in ``cut.nodes()``; None for an overview."""
    cut: Cut | None
    """The cut whose mesh this is; None for an overview."""
    error: float
    """Bound of the two-sided distance to the input, of what is inside the box; of everything without a box."""
    error_everywhere: float
    """The same of everything that is drawn. It differs from `error` where a box has context."""
    limited_by: str
    """Why it is not finer: see `Cut.limited_by`."""

    def __init__(
        self,
        positions: Any,
        triangles: Any,
        *,
        error: float,
        error_everywhere: float,
        limited_by: str,
        triangle_nodes: Any = None,
        cut: Cut | None = None,
    ) -> None:
        self.positions, self.triangles = as_array(positions), as_array(triangles)
        self.triangle_nodes = None if triangle_nodes is None else as_array(triangle_nodes)
        self.cut, self.error, self.error_everywhere, self.limited_by = cut, error, error_everywhere, limited_by

    def to_trimesh(self, **options: Any) -> Any:
        """The mesh as a ``trimesh.Trimesh``, vertex by vertex; `options` go to its constructor. The certified error is in its
        ``metadata``."""
        trimesh = _library("trimesh", "to_trimesh")
        options = {"process": False, "metadata": {"certified_error": self.error}, **options}
        return trimesh.Trimesh(vertices=self.positions, faces=self.triangles, **options)

    def to_pyvista(self) -> Any:
        """The mesh as a ``pyvista.PolyData``. Its cells have the arrays ``level`` and ``certified_error``, and its field data has
        the ``certified_error`` of the whole."""
        pyvista = _library("pyvista", "to_pyvista")
        mesh = pyvista.PolyData.from_regular_faces(self.positions, self.triangles)
        if self.cut is not None and self.triangle_nodes is not None:
            _, levels, errors = self.cut.nodes()
            mesh.cell_data["level"] = levels[self.triangle_nodes]
            mesh.cell_data["certified_error"] = errors[self.triangle_nodes]
        mesh.field_data["certified_error"] = [self.error]
        return mesh

    def to_open3d(self) -> Any:
        """The mesh as an ``open3d.geometry.TriangleMesh``."""
        open3d = _library("open3d", "to_open3d")
        vectors = open3d.utility
        return open3d.geometry.TriangleMesh(
            vectors.Vector3dVector(self.positions), vectors.Vector3iVector(self.triangles.astype("int32"))
        )

    def __repr__(self) -> str:
        return f"<lodpack.Mesh of {len(self.triangles):,} triangles, error at most {self.error:g}, limited by {self.limited_by}>"


def as_array(native: Any) -> Any:
    """An array of numpy in memory that the native half has filled."""
    try:
        import numpy
    except ImportError as error:
        raise ImportError("meshes of lodpack are arrays of numpy, which is not installed: pip install numpy") from error
    return numpy.asarray(native)


def _library(name: str, method: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"Mesh.{method} needs {name}: pip install {name}", name=name) from error
