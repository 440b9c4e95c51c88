"""What of a mesh's native half remains where it is pickled or copied: its numbers, without the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Sequence

from ._errors import QueryError

if TYPE_CHECKING:
    from . import _lodpack
    from ._info import Channel


class KeptCut:
    """The answers of a cut, and none of its file."""

    def __init__(self, cut: Any) -> None:
        self.error, self.error_everywhere, self.limited_by = cut.certificate
        self.triangle_count, self.node_count = cut.triangle_count, cut.node_count
        self._nodes = tuple(_array(numbers) for numbers in cut.nodes())

    @property
    def certificate(self) -> tuple[float, float, str]:
        return self.error, self.error_everywhere, self.limited_by

    def nodes(self) -> Any:
        return self._nodes


class KeptTextured:
    """The values of each vertex, and the pages, of the channels that a mesh was extracted with."""

    def __init__(self, textured: _lodpack.Textured | KeptTextured, channels: Sequence[Channel]) -> None:
        self._values = [
            _array(textured.vertex_colours(number) if channel["kind"] == "colour" else textured.vertex_values(number))
            for number, channel in enumerate(channels)
        ]
        *arrays, images = textured.paged()
        self._paged = (*map(_array, arrays), [_array(image) for image in images])

    def mesh(self) -> Any:
        raise QueryError("this mesh was pickled: its file is elsewhere")

    def vertex_colours(self, channel: int) -> Any:
        return self._values[channel]

    def vertex_values(self, channel: int) -> Any:
        return self._values[channel]

    def paged(self) -> Any:
        return self._paged


def _array(native: Any) -> Any:
    from ._mesh import as_array  # It needs this module.

    return as_array(native)
