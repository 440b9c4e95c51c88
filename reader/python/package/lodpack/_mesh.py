"""The mesh of a cut as arrays, and as objects of other libraries."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, cast

from ._errors import QueryError
from ._kept import KeptTextured

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from . import _lodpack
    from ._file import Cut
    from ._info import Channel


class Mesh:
    """Triangles with a certified error. The arrays are those that the decoder has written: nothing is copied."""

    positions: NDArray[np.float64]
    """World positions: an array of shape (n, 3). Vertices that several roots share occur once."""
    triangles: NDArray[np.uint32]
    """Indices of positions, counter-clockwise seen from outside: an array of shape (m, 3)."""
    cut: Cut | None
    """The cut whose mesh this is; None for an overview."""
    error: float
    """Bound of the two-sided distance to the input, of what is inside the box; of everything without a box."""
    error_everywhere: float
    """The same of everything that is drawn. It differs from `error` where a box has context."""
    limited_by: str
    """Why it is not finer: see `Cut.limited_by`."""
    channels: list[Channel]
    """The channels that were extracted with it."""
    normals: NDArray[np.float32] | None
    """Of heights the normal of each vertex, from the slopes of the heights: an array of shape (n, 3). None for other
    meshes."""

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
        channels: list[Channel] | None = None,
        textured: _lodpack.Textured | KeptTextured | None = None,
        normals: Any = None,
        vertex_colours: Any = None,
    ) -> None:
        self.positions, self.triangles = as_array(positions), as_array(triangles)
        self._triangle_nodes = triangle_nodes
        self.cut, self.error, self.error_everywhere, self.limited_by = cut, error, error_everywhere, limited_by
        self.channels, self._textured = channels or [], textured
        self.normals = None if normals is None else as_array(normals)
        self._colours = None if vertex_colours is None else as_array(vertex_colours)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the file: copies and pickled meshes have all numbers of this one."""
        state = dict(self.__dict__)
        state["_triangle_nodes"] = self.triangle_nodes
        if self._textured is not None:
            state["_textured"] = KeptTextured(self._textured, self.channels)
        return state

    @property
    def triangle_nodes(self) -> NDArray[np.uint32] | None:
        """For each triangle the position of its node in ``cut.nodes()``; None for an overview."""
        return None if self._triangle_nodes is None else cast("NDArray[np.uint32]", as_array(self._triangle_nodes))

    def values(self, channel: str) -> NDArray[Any]:
        """What a channel has at each vertex: colours as `colours` has them, all else as an array of shape (n,
        components) of float64, NaN where nothing is known. The mean of what the triangles around a vertex show there;
        of labels what one of them shows."""
        number = self._number(channel)
        if self._textured is None:  # For mypy: without it there is no number.
            raise QueryError("this mesh has no channels")
        if self.channels[number]["kind"] == "colour":
            return cast("NDArray[Any]", as_array(self._textured.vertex_colours(number)))
        return cast("NDArray[Any]", as_array(self._textured.vertex_values(number)))

    @property
    def colours(self) -> NDArray[np.uint8] | None:
        """Red, green, blue and opacity of each vertex (sRGB): an array of shape (n, 4), from the first channel of
        colours that was extracted. None without one. Those of heights come from the file's ramp."""
        if self._colours is not None:
            import numpy as np

            return np.concatenate([self._colours, np.full((len(self._colours), 1), 255, np.uint8)], axis=1)
        name = _first(self.channels)
        return None if name is None else self.values(name)

    def textured(self) -> TexturedMesh:
        """The mesh with texture coordinates, and one image for each channel that was extracted."""
        if self._textured is None:
            raise QueryError("this mesh has no channels; extract it with channels=\"auto\" or their names")
        positions, triangles, nodes, uv, images = self._textured.paged()
        return TexturedMesh(self, positions, triangles, nodes, uv, [as_array(image) for image in images])

    def _number(self, channel: str) -> int:
        names = [known["name"] for known in self.channels]
        if channel not in names:
            raise QueryError(f"this mesh has no channel {channel!r}; it was extracted with {', '.join(names) or 'none'}")
        return names.index(channel)

    def to_trimesh(self, **options: Any) -> Any:
        """The mesh as a ``trimesh.Trimesh``, vertex by vertex, with `colours`; `options` go to its constructor. The
        certified error of all of it is in its ``metadata``, and that in the box where it differs. `textured` has a
        ``to_trimesh`` with a texture."""
        trimesh = _library("trimesh", "to_trimesh")
        options = {"process": False, "metadata": _errors_of(self), **options}
        colours = self.colours
        if colours is not None and "visual" not in options:
            options.setdefault("vertex_colors", colours)
        return trimesh.Trimesh(vertices=self.positions, faces=self.triangles, **options)

    def to_pyvista(self) -> Any:
        """The mesh as a ``pyvista.PolyData``. Its cells have the arrays ``level`` and ``certified_error``, and its
        field data has the ``certified_error`` of the whole, and ``certified_error_in_box`` where it differs. Its points
        have an array for each channel, by name: `textured` has a ``to_pyvista`` with a texture."""
        pyvista = _library("pyvista", "to_pyvista")
        mesh = pyvista.PolyData.from_regular_faces(self.positions, self.triangles)
        if self.cut is not None and self.triangle_nodes is not None:
            _, levels, errors = self.cut.nodes()
            mesh.cell_data["level"] = levels[self.triangle_nodes]
            mesh.cell_data["certified_error"] = errors[self.triangle_nodes]
        for name, error in _errors_of(self).items():
            mesh.field_data[name] = [error]
        for channel in self.channels:
            mesh.point_data[channel["name"]] = _columns(self.values(channel["name"]))
        return mesh

    def to_open3d(self) -> Any:
        """The mesh as an ``open3d.geometry.TriangleMesh``."""
        open3d = _library("open3d", "to_open3d")
        vectors = open3d.utility
        mesh = open3d.geometry.TriangleMesh(
            vectors.Vector3dVector(self.positions), vectors.Vector3iVector(self.triangles.astype("int32"))
        )
        colours = self.colours
        if colours is not None:
            mesh.vertex_colors = vectors.Vector3dVector(colours[:, :3] / 255.0)
        return mesh

    def __repr__(self) -> str:
        return f"<lodpack.Mesh of {len(self.triangles):,} triangles, {error_text(self)}, limited by {self.limited_by}>"


class TexturedMesh:
    """A mesh with texture coordinates and images."""

    positions: NDArray[np.float64]
    """World positions: an array of shape (n, 3). Where triangles do not agree about the place of a vertex, it is there
    several times."""
    triangles: NDArray[np.uint32]
    """Indices of positions: an array of shape (m, 3), in another order than those of the mesh."""
    triangle_nodes: NDArray[np.uint32]
    """For each triangle the position of its node in ``cut.nodes()``."""
    uv: NDArray[np.float32]
    """Places in the images, from 0 to 1: (0, 0) is the lower left corner, and the first row of an image is at v = 1."""
    images: dict[str, NDArray[Any]]
    """By channel an array of shape (height, width, components): bytes of sRGB, or stored numbers n, which stand for
    ``low + n * step``."""
    channels: list[Channel]

    def __init__(self, mesh: Mesh, positions: Any, triangles: Any, nodes: Any, uv: Any, images: list[Any]) -> None:
        self.positions, self.triangles, self.triangle_nodes = as_array(positions), as_array(triangles), as_array(nodes)
        self.uv, self.channels = as_array(uv), mesh.channels
        self.error, self.error_everywhere = mesh.error, mesh.error_everywhere
        self.images = {channel["name"]: image for channel, image in zip(mesh.channels, images)}

    def _image(self, method: str) -> NDArray[np.uint8]:
        name = _first(self.channels)
        if name is None:
            raise QueryError(f"TexturedMesh.{method} needs a channel of colours; this mesh has {', '.join(self.images)}")
        return self.images[name]

    def to_trimesh(self, **options: Any) -> Any:
        """The mesh as a ``trimesh.Trimesh`` with a texture, which also needs Pillow."""
        image = self._image("to_trimesh")
        trimesh, pillow = _library("trimesh", "to_trimesh"), _library("PIL.Image", "to_trimesh")
        visual = trimesh.visual.TextureVisuals(uv=self.uv, image=pillow.fromarray(image))
        options = {"process": False, "visual": visual, "metadata": _errors_of(self), **options}
        return trimesh.Trimesh(vertices=self.positions, faces=self.triangles, **options)

    def to_pyvista(self) -> tuple[Any, Any]:
        """The mesh as a ``pyvista.PolyData`` with texture coordinates, and its ``pyvista.Texture``:
        ``mesh.plot(texture=texture)``."""
        image = self._image("to_pyvista")
        pyvista = _library("pyvista", "to_pyvista")
        mesh = pyvista.PolyData.from_regular_faces(self.positions, self.triangles)
        mesh.active_texture_coordinates = self.uv
        for name, error in _errors_of(self).items():
            mesh.field_data[name] = [error]
        texture = pyvista.Texture(image)
        texture.SetUseSRGBColorSpace(True)
        return mesh, texture

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name} {image.shape[1]} x {image.shape[0]}" for name, image in self.images.items())
        return f"<lodpack.TexturedMesh of {len(self.triangles):,} triangles with {sizes}>"


def _errors_of(mesh: Mesh | TexturedMesh) -> dict[str, float]:
    """The errors of a mesh, under the names that ``lodpack extract --json`` has for them."""
    whole = {"certified_error": mesh.error_everywhere}
    return whole if mesh.error == mesh.error_everywhere else {**whole, "certified_error_in_box": mesh.error}


def error_text(drawn: Mesh | Cut) -> str:
    """The errors of what is drawn in words."""
    if drawn.error == drawn.error_everywhere:
        return f"error at most {drawn.error:g}"
    return f"error at most {drawn.error:g} in the box, {drawn.error_everywhere:g} everywhere"


def _first(channels: list[Channel]) -> str | None:
    """The first channel of colours."""
    return next((channel["name"] for channel in channels if channel["kind"] == "colour"), None)


def _columns(values: Any) -> Any:
    """Numbers of one component as a plain list of them."""
    return values[:, 0] if values.shape[1] == 1 else values


def as_array(native: Any) -> Any:
    """An array of numpy in memory that the native half has filled."""
    return _asarray()(native)


@cache
def _asarray() -> Any:
    """``numpy.asarray``: small meshes are extracted so often that importing it for each would be seen."""
    try:
        import numpy
    except ImportError as error:
        raise ImportError("meshes of lodpack are arrays of numpy, which is not installed: pip install numpy") from error
    return numpy.asarray


def _library(name: str, method: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"Mesh.{method} needs {name}: pip install {name}", name=name) from error
