"""The native half: `reader/python/src`."""

from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Protocol, final, type_check_only

from ._info import Info, Point

__all__ = ["Array", "BuildRequest", "Cut", "Reader", "VERSION", "build", "open_bytes", "open_object", "open_path", "open_url"]

VERSION: str

@final
class Array:
    """Memory that `numpy.asarray` takes over without copying."""

    @property
    def __array_interface__(self) -> dict[str, object]: ...

@type_check_only
class Source(Protocol):
    def size(self) -> int: ...
    def read_ranges(self, ranges: Sequence[tuple[int, int]], /) -> list[bytes]: ...

@final
class Cut:
    @property
    def error(self) -> float: ...
    @property
    def error_everywhere(self) -> float: ...
    @property
    def triangle_count(self) -> int: ...
    @property
    def node_count(self) -> int: ...
    @property
    def limited_by(self) -> str: ...
    def nodes(self) -> tuple[Array, Array, Array]: ...

@final
class Reader:
    @property
    def name(self) -> str: ...
    @property
    def bytes_read(self) -> int: ...
    @property
    def request_count(self) -> int: ...
    @property
    def bounds(self) -> tuple[Point, Point] | None: ...
    def info(self) -> Info: ...
    def select(
        self,
        *,
        tolerance: float | None = None,
        bbox: Sequence[Sequence[float]] | None = None,
        context: bool = False,
        triangles: int | None = None,
        nodes: int | None = None,
        page_bytes: int | None = None,
    ) -> Cut: ...
    def extract(self, cut: Cut) -> tuple[Array, Array, Array]: ...
    def verify(self) -> None: ...
    def overview(self) -> tuple[float, Array, Array, Array] | None: ...

def open_path(path: str, limits: dict[str, int] | None = None) -> Reader: ...
def open_url(url: str, timeout: timedelta, limits: dict[str, int] | None = None) -> Reader: ...
def open_bytes(bytes: bytes, name: str, limits: dict[str, int] | None = None) -> Reader: ...
def open_object(source: Source, name: str, limits: dict[str, int] | None = None) -> Reader: ...

@final
class BuildRequest:
    inputs: list[Path]
    output: Path
    work: Path
    tolerance: str
    unit: str | None
    effort: str
    levels: str
    threads: int
    memory: int | None

def build(
    request: BuildRequest, mesh: tuple[bytes, bytes] | None = None, progress: Callable[[str, int, int], object] | None = None
) -> tuple[str, list[str]]: ...
