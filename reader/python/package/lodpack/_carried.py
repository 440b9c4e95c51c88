"""Meshes in memory with what they carry: read from objects of trimesh and PyVista, and written as PLY for the
builder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._errors import BuildError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Names that PLY has for shape, colours and texture coordinates: an array of such a name is given another one.
_TAKEN = frozenset("x y z nx ny nz red green blue alpha r g b a s t u v texture_u texture_v texture_s texture_t".split())


@dataclass
class CarriedMesh:
    """A mesh in memory."""

    positions: NDArray[np.float64]
    triangles: NDArray[np.uint32]
    vertex_colours: NDArray[np.uint8] | None = None
    """Red, green, blue and opacity of each vertex."""
    face_colours: NDArray[np.uint8] | None = None
    """The same of each triangle."""
    uv: NDArray[np.float64] | None = None
    """Places of vertices in the image, from its lower left corner."""
    image: Any = None
    """A Pillow image."""
    numbers: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Numbers of vertices by name."""
    notes: list[str] = field(default_factory=list)
    """What of it is left out."""

    def carries_more(self) -> bool:
        """Whether there is more than the shape."""
        return self.vertex_colours is not None or self.face_colours is not None or self.image is not None or bool(self.numbers)

    def write_ply(self, folder: Path) -> Path:
        """Writes it with all that it carries, in double precision."""
        import numpy as np

        lines, comments, columns = [], [], list(zip("xyz", ["<f8"] * 3, self.positions.T))
        colours = self.vertex_colours
        if self.image is not None and self.uv is not None:
            self.image.save(folder / "texture.png")
            comments.append("comment TextureFile texture.png")
            columns += [("u", "<f8", self.uv[:, 0]), ("v", "<f8", self.uv[:, 1])]
        elif colours is not None:
            columns += [(name, "u1", colours[:, at]) for at, name in enumerate(["red", "green", "blue", "alpha"])]
        for name, values in self.numbers.items():
            name = "_".join(name.split()) or "values"
            columns.append((f"{name}_" if name in _TAKEN else name, "<f8", values))
        vertices = np.empty(len(self.positions), [(name, kind) for name, kind, _ in columns])
        lines.append(f"element vertex {len(vertices)}")
        for name, kind, values in columns:
            vertices[name] = values
            lines.append(f"property {'uchar' if kind == 'u1' else 'double'} {name}")
        face_columns = [("count", "u1"), ("corners", "<u4", 3)]
        lines += [f"element face {len(self.triangles)}", "property list uchar uint vertex_indices"]
        if self.face_colours is not None:
            face_columns.append(("colour", "u1", 4))
            lines += [f"property uchar {name}" for name in ["red", "green", "blue", "alpha"]]
        faces = np.empty(len(self.triangles), face_columns)
        faces["count"], faces["corners"] = 3, self.triangles
        if self.face_colours is not None:
            faces["colour"] = self.face_colours
        header = ["ply", "format binary_little_endian 1.0", *comments, *lines, "end_header", ""]
        path = folder / "mesh.ply"
        with path.open("wb") as out:
            out.write("\n".join(header).encode())
            out.write(vertices.tobytes())
            out.write(faces.tobytes())
        return path


def checked_mesh(positions: Any, triangles: Any) -> CarriedMesh:
    """The mesh of two arrays."""
    import numpy as np

    try:
        points, corners = np.asarray(positions, dtype=np.float64), np.asarray(triangles)
    except (TypeError, ValueError, OverflowError) as error:
        raise BuildError(f"positions and triangles are arrays of three columns of numbers: {error}") from None
    if points.ndim != 2 or points.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 3:
        raise BuildError(f"positions and triangles have three columns, not the shapes {points.shape} and {corners.shape}")
    if not np.issubdtype(corners.dtype, np.integer):
        raise BuildError(f"triangles are numbers of vertices, not of type {corners.dtype}")
    if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
        raise BuildError(f"a triangle names a vertex that does not exist: {corners.min()} or {corners.max()} of {len(points)}")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise BuildError(f"position {bad[0]} is not finite: {points[bad[0]].tolist()}")
    return CarriedMesh(points, corners.astype(np.uint32))


def of_trimesh(source: Any) -> CarriedMesh:
    """A mesh of trimesh with its colours, its texture, and numbers of its vertices."""
    import numpy as np

    mesh = checked_mesh(source.vertices, source.faces)
    visual = getattr(source, "visual", None)
    kind = getattr(visual, "kind", None)
    if visual is not None and kind == "vertex":
        mesh.vertex_colours = _bytes_of_colours(visual.vertex_colors, len(mesh.positions))
    elif visual is not None and kind == "face":
        mesh.face_colours = _bytes_of_colours(visual.face_colors, len(mesh.triangles))
    elif visual is not None and kind == "texture":
        material = visual.material
        image = getattr(material, "baseColorTexture", None)
        mesh.image = image if image is not None else getattr(material, "image", None)
        if visual.uv is not None:
            mesh.uv = np.asarray(visual.uv, dtype=np.float64)
        if mesh.image is None or mesh.uv is None or mesh.uv.shape != (len(mesh.positions), 2):
            mesh.image = None
            mesh.notes.append("the material has no image with texture coordinates: its colour is not kept; export the mesh as GLB, and build that")
        others = ["normalTexture", "metallicRoughnessTexture", "occlusionTexture", "emissiveTexture"]
        left = [name for name in others if getattr(material, name, None) is not None]
        if left:
            mesh.notes.append(f"{', '.join(left)} of the material are not kept; export the mesh as GLB, and build that")
    _take_numbers(mesh, dict(getattr(source, "vertex_attributes", {})))
    return mesh


def of_pyvista(source: Any, texture: Any = None) -> CarriedMesh:
    """A mesh of PyVista with the colours and numbers of its points, the colours of its cells, and a texture that is
    given with it."""
    import numpy as np

    surface = source.triangulate() if hasattr(source, "regular_faces") else source.extract_surface().triangulate()
    mesh = checked_mesh(surface.points, surface.regular_faces)
    arrays = {name: np.asarray(surface.point_data[name]) for name in surface.point_data.keys()}
    uv = surface.active_texture_coordinates
    if uv is not None:
        arrays = {name: values for name, values in arrays.items() if not (values.shape == uv.shape and np.array_equal(values, uv))}
    name = _colours_among(arrays, surface.active_scalars_name)
    if texture is not None and uv is not None:
        mesh.uv, mesh.image = np.asarray(uv, dtype=np.float64)[:, :2], _image_of(texture)
    elif uv is not None:
        mesh.notes.append("texture coordinates are not kept without their image: give the mesh and its texture as (mesh, texture)")
    elif texture is not None:
        mesh.notes.append("the texture is not kept: the mesh has no texture coordinates")
    if name is not None:
        mesh.vertex_colours = _bytes_of_colours(arrays.pop(name), len(mesh.positions))
    cells = {name: np.asarray(surface.cell_data[name]) for name in surface.cell_data.keys()}
    cell_name = _colours_among(cells, surface.active_scalars_name)
    if cell_name is not None and name is None and mesh.image is None and len(cells[cell_name]) == len(mesh.triangles):
        mesh.face_colours = _bytes_of_colours(cells.pop(cell_name), len(mesh.triangles))
    if cells:
        mesh.notes.append(f"arrays of cells are not kept: {', '.join(cells)}; surface.cell_data_to_point_data() keeps them")
    arrays = {name: values for name, values in arrays.items() if name != "Normals"}
    _take_numbers(mesh, arrays)
    return mesh


def _bytes_of_colours(colours: Any, count: int) -> NDArray[np.uint8]:
    """Colours with opacity."""
    import numpy as np

    colours = np.asarray(colours, dtype=np.uint8)
    if colours.ndim != 2 or colours.shape[0] != count or colours.shape[1] not in (3, 4):
        raise BuildError(f"colours have a row of three or four bytes for each of {count}, not the shape {colours.shape}")
    opaque = np.full((count, 1), 255, np.uint8)
    return colours if colours.shape[1] == 4 else np.concatenate([colours, opaque], axis=1)


def _colours_among(arrays: dict[str, Any], first: str | None) -> str | None:
    """The name of the array that has colours: the active one, or else the first."""
    found = [name for name, values in arrays.items() if values.dtype == "uint8" and values.ndim == 2 and values.shape[1] in (3, 4)]
    return first if first in found else next(iter(found), None)


def _take_numbers(mesh: CarriedMesh, arrays: dict[str, Any]) -> None:
    """Keeps arrays of one number for each vertex, and notes the others."""
    import numpy as np

    left = []
    for name, values in arrays.items():
        values = np.asarray(values)
        is_column = values.shape in [(len(mesh.positions),), (len(mesh.positions), 1)]
        if is_column and values.dtype.kind in "biuf":
            mesh.numbers[str(name)] = values.reshape(-1)
        else:
            left.append(str(name))
    if left:
        mesh.notes.append(f"arrays that are not one number for each vertex are not kept: {', '.join(left)}")


def _image_of(texture: Any) -> Any:
    from ._mesh import _library

    pillow = _library("PIL.Image", "build")
    return pillow.fromarray(texture.to_array())
