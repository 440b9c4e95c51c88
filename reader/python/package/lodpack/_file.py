"""An open file: what it holds, which cut answers a query, and the mesh of a cut."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, BinaryIO, Iterable, Mapping, Sequence, cast, overload

from . import _lodpack
from ._checked import budget, corners, number, point
from ._errors import ArgumentError, QueryError
from ._info import Channel, Info
from ._kept import KeptCut
from ._mesh import Mesh, as_array, error_text
from ._opened import OpenFile
from ._source import open_native

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ._ground import Ground
    from ._objects import Objects, Pick

    Bounds = Sequence[Sequence[float]] | NDArray[np.floating[Any]]


def open(
    source: str | os.PathLike[str] | bytes | BinaryIO | Any, *, timeout: float = 30.0, limits: Mapping[str, int] | None = None
) -> File | Any:  # What a file holds is seen when it is open; checkers let attributes of both kinds pass.
    """Opens a lodpack file: a `File`, or a `HeightsFile` if it holds a grid of heights. It reads 8 kB of a small file,
    and the rest of the index's beginning of a large one.

    `source` is a path, an address (``http://``, ``https://``; others such as ``s3://`` where fsspec knows them), the
    file's bytes, or a binary file that can seek, such as what ``fsspec.open`` returns. Web servers have to support
    range requests. For headers, logins and caches give a file of fsspec.

    `timeout` is the longest time in seconds for one request to a web server; a request that fails for a time is sent up
    to four times.

    `limits` are upper limits on what a file may ask of this machine. The defaults suit files from untrusted places.
    Names:
    ``root_count``, ``root_vertex_count``, ``cluster_record_count``, ``part_bytes``, ``texel_count``.

    Raises `lodpack.Error` by culprit; what the system says of a path is a FileNotFoundError or its like, too.
    """
    native = open_native(source, timeout, limits)
    if isinstance(native, _lodpack.HeightsReader):
        from ._heights import HeightsFile  # It needs this module.

        return HeightsFile(native)
    return File(native)


class Cut:
    """A level for each root that is drawn: what a query is answered with, before anything is decoded.

    `File.select` makes it, and `File.extract` its mesh.
    """

    def __init__(self, native: _lodpack.Cut, file: File) -> None:
        self._native: Any = native
        self._file: File | None = file

    def __getstate__(self) -> dict[str, Any]:
        return {"_native": self._native if isinstance(self._native, KeptCut) else KeptCut(self._native), "_file": None}

    @property
    def error(self) -> float:
        """Bound of the two-sided distance to the input, of what is inside the box; of everything without a box."""
        return cast("float", self._native.error)

    @property
    def error_everywhere(self) -> float:
        """The same of everything that is drawn."""
        return cast("float", self._native.error_everywhere)

    @property
    def limited_by(self) -> str:
        """Why it is not finer: ``tolerance`` (it is as fine as was asked for), ``finest`` (the file has nothing finer),
        or the budget of ``triangles``, ``nodes`` or ``bytes`` (of pages)."""
        return cast("str", self._native.limited_by)

    @property
    def triangle_count(self) -> int:
        """Exact number of triangles of the mesh."""
        return cast("int", self._native.triangle_count)

    @property
    def node_count(self) -> int:
        """Number of nodes: roots at a level each."""
        return cast("int", self._native.node_count)

    def nodes(self) -> tuple[NDArray[np.uint32], NDArray[np.uint8], NDArray[np.float64]]:
        """Root, level and certified error of each node. `Mesh.triangle_nodes` has their positions in these arrays."""
        roots, levels, errors = self._native.nodes()
        return as_array(roots), as_array(levels), as_array(errors)

    def __repr__(self) -> str:
        return f"<lodpack.Cut of {self.triangle_count:,} triangles, {error_text(self)}, limited by {self.limited_by}>"


class File(OpenFile[_lodpack.Reader]):
    """An open lodpack file. Threads may share it; while one of them reads or decodes, the others go on."""

    @property
    def channels(self) -> list[Channel]:
        """What the surface carries besides positions: colours, measured numbers."""
        return self._native.info()["channels"]

    def info(self) -> Info:
        """What the file holds. Reads nothing."""
        return self._native.info()

    def overview(self) -> Mesh | None:
        """One small mesh of the complete surface, for a first picture. It came with opening, so nothing is read. Small
        files have none: their coarsest cut (``file.extract(tolerance=float("inf"))``) is as quick."""
        overview = self._native.overview()
        if overview is None:
            return None
        error, positions, triangles, _ = overview
        return Mesh(positions, triangles, error=error, error_everywhere=error, limited_by="finest")

    def select(
        self,
        *,
        tolerance: float | None = None,
        max_triangles: int | None = None,
        bbox: Bounds | None = None,
        context: bool = False,
        max_nodes: int | None = None,
        max_bytes: int | None = None,
        hide: int | str | Iterable[int | str] | None = None,
        only: int | str | Iterable[int | str] | None = None,
    ) -> Cut:
        """Finds the coarsest cut within the tolerance, or the finest one without a tolerance, that keeps every budget.
        Reads the index where the query needs it, and no surface.

        `tolerance`: the error to reach inside the box, in units of the file's coordinates.
        `max_triangles`: the most triangles. `max_nodes`: the most nodes. `max_bytes`: the most bytes of pages to read.
        `bbox`: smallest and largest corner; every root whose box touches it is drawn whole. A box beside the surface
        gives an empty cut.
        `context`: what is outside the box is drawn, too, at its coarsest.
        `hide`: objects and assemblies that are not drawn, with everything below them: numbers as `objects` has them,
        names, or ids. `only`: nothing else is drawn. Budgets then count whole roots, and the mesh may have fewer
        triangles.

        The cut is one that the file holds: with a budget of triangles it is a mixture of levels, which is up to 2.6
        times worse in RMS than what ``lodpack extract --triangles`` makes by simplifying a finer cut as a whole.

        Raises `QueryError` for what is not a number, and where even the coarsest cut exceeds a budget.
        """
        native = self._native.select(
            tolerance=None if tolerance is None else number(tolerance, "tolerance"),
            bbox=None if bbox is None else box_corners(bbox),
            context=bool(context),
            max_triangles=budget(max_triangles, "max_triangles"),
            max_nodes=budget(max_nodes, "max_nodes"),
            max_bytes=budget(max_bytes, "max_bytes"),
            hide=self._objects(hide, "hide"),
            only=self._objects(only, "only"),
        )
        return Cut(native, self)

    def _objects(self, wanted: int | str | Iterable[int | str] | None, name: str) -> list[int] | None:
        """The numbers of objects that a caller means."""
        if wanted is None:
            return None
        objects = self.objects()
        if objects is None:
            raise QueryError(f"{name}: this file has no objects; build it with --objects keep")
        return objects.numbers(wanted, name)

    @overload
    def extract(self, cut: Cut, *, channels: str | Sequence[str] | None = None) -> Mesh: ...

    @overload
    def extract(
        self,
        *,
        tolerance: float | None = None,
        max_triangles: int | None = None,
        bbox: Bounds | None = None,
        context: bool = False,
        max_nodes: int | None = None,
        max_bytes: int | None = None,
        hide: int | str | Iterable[int | str] | None = None,
        only: int | str | Iterable[int | str] | None = None,
        channels: str | Sequence[str] | None = None,
    ) -> Mesh: ...

    def extract(self, cut: Cut | None = None, *, channels: str | Sequence[str] | None = None, **query: Any) -> Mesh:
        """Reads and decodes the mesh of a cut, or of the cut that `select` finds for a query. Everything at the finest
        level without a query. The mesh is watertight where the whole surface is.

        `channels`: what of `channels` to read with it: ``"auto"`` (the first one of colours, if there is one),
        ``"all"``, or a list of names. `Mesh.colours`, `Mesh.values` and `Mesh.textured` have them. Without it nothing
        of them is read."""
        if cut is None:
            cut = self.select(**query)
        elif query:
            raise ArgumentError("give a cut or a query, not both")
        elif not isinstance(cut, Cut):
            raise ArgumentError(f"a cut comes from File.select; this is a {type(cut).__name__}; name queries: extract(tolerance=...)")
        elif isinstance(cut._native, KeptCut):
            raise QueryError("this cut was pickled without its file; select it again")
        numbers = [] if channels is None else self._channel_numbers(channels)
        known = self.channels if numbers else []
        textured = self._native.extract_textured(cut._native, numbers) if numbers else None
        positions, triangles, nodes = self._native.extract(cut._native) if textured is None else textured.mesh()
        error, error_everywhere, limited_by = cut._native.certificate
        return Mesh(
            positions,
            triangles,
            triangle_nodes=nodes,
            cut=cut,
            error=error,
            error_everywhere=error_everywhere,
            limited_by=limited_by,
            channels=[known[number] for number in numbers],
            textured=textured,
        )

    def _channel_numbers(self, wanted: str | Sequence[str]) -> list[int]:
        """The numbers of channels that a caller means."""
        known = self.channels
        if wanted == "none":
            return []
        if wanted == "auto":
            return [number for number, channel in enumerate(known) if channel["kind"] == "colour"][:1]
        if wanted == "all":
            return [number for number, channel in enumerate(known) if channel["kind"] != "unknown"]
        if isinstance(wanted, str):
            raise QueryError(f'channels is "auto", "all", "none" or a list of names: give [{wanted!r}]')
        names = [channel["name"] for channel in known]
        if not isinstance(wanted, Iterable):
            raise ArgumentError(f'channels is "auto", "all", "none" or a list of names, and not {wanted!r:.80}')
        for name in wanted:
            if name not in names:
                raise QueryError(f"the file has no channel {name!r}; it has {', '.join(names) or 'none'}")
        return [names.index(name) for name in dict.fromkeys(wanted)]

    def ground(self) -> Ground | None:
        """The heights that the mesh stands on, as a file of heights, and where they are in its space; None if the file
        has none. Reads 16 kB. They stay open when this file is closed."""
        from ._ground import Ground  # It needs this module.

        opened = self._native.ground()
        return None if opened is None else Ground(*opened)

    def objects(self) -> Objects | None:
        """What the input named: parts, houses, and the assemblies that they belong to; None if it named nothing."""
        from ._objects import Objects

        native = self._native.objects()
        return None if native is None else Objects(native)

    def pick(
        self,
        origin: Sequence[float],
        direction: Sequence[float],
        *,
        hide: int | str | Iterable[int | str] | None = None,
        only: int | str | Iterable[int | str] | None = None,
    ) -> Pick | None:
        """What a ray from `origin` meets first, from either side of the finest surface, and how far away; None if it
        meets nothing. It reads a few leaves. `hide` and `only`: as for `select`; it passes what is not drawn."""
        from ._objects import Pick

        start, along = point(origin, "origin"), point(direction, "direction")
        found = self._native.pick(start, along, hide=self._objects(hide, "hide"), only=self._objects(only, "only"))
        return None if found is None else Pick(*found)

    def verify(self) -> None:
        """Reads the complete file, with a ground that it has, checks every checksum and every rule of the format, and
        draws every root at every level. Raises
        `FormatError` with the first damage."""
        self._native.verify()

    def __repr__(self) -> str:
        if self._open is None:
            return f"<lodpack.File {self._name!r}, closed>"
        info = self.info()
        return f"<lodpack.File {self._name!r}: {len(info['levels'])} levels of {info['source_triangles']:,} triangles>"


def box_corners(bbox: Any) -> list[list[float]]:
    """The two corners of a box in space, as lists."""
    return corners(bbox, 3, "two corners: ((x0, y0, z0), (x1, y1, z1))")
