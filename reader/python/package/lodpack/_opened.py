"""What open files of both kinds have: a name, bounds, counters, and an end."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from . import _lodpack
from ._errors import QueryError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Native = TypeVar("Native", _lodpack.Reader, _lodpack.HeightsReader)
Self = TypeVar("Self", bound="OpenFile[Any]")


class OpenFile(Generic[Native]):
    """An open file. Threads may share it; while one of them reads or decodes, the others go on."""

    def __init__(self, native: Native) -> None:
        self._open: Native | None = native
        self._name = native.name

    @property
    def _native(self) -> Native:
        if self._open is None:
            raise QueryError(f"{self._name} is closed")
        return self._open

    @property
    def name(self) -> str:
        """Path or address."""
        return self._name

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """Smallest and largest coordinates in space, as an array of two rows; None for an empty file."""
        import numpy as np

        bounds = self._native.bounds
        return None if bounds is None else np.array(bounds)

    @property
    def bytes_read(self) -> int:
        """Bytes read so far."""
        return self._native.bytes_read

    @property
    def request_count(self) -> int:
        """Requests made so far, each for one range of bytes."""
        return self._native.request_count

    def close(self) -> None:
        """Lets go of the file or the connection. What has been extracted stays."""
        self._open = None

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
