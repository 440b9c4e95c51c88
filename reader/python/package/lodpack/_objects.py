"""What the input named: the parts of a machine, the houses of a city."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple, SupportsIndex

from ._checked import text, whole
from ._errors import ArgumentError, QueryError

if TYPE_CHECKING:
    from . import _lodpack


class Object(NamedTuple):
    """An object, or an assembly of others."""

    number: int
    """By which all else knows it: those of objects come first."""
    name: str | None
    """What the input called it; names may repeat."""
    id: str | None
    """What other programs know it by, such as ``extras.id`` of glTF or a GlobalId of IFC."""
    parent: int | None
    """The number of what it is a part of."""


class Pick(NamedTuple):
    """What a ray meets first."""

    object: int | None
    """The number of the object; None in a file without objects."""
    point: tuple[float, float, float]
    """Where."""
    distance: float
    """From where the ray begins, in units of the file's coordinates."""
    error: float
    """Bound of the distance between the surface that was met and the input."""
    root: int
    """The leaf that was met."""


class Objects:
    """The objects of a file, and the assemblies that they are parts of. `File.objects` has them.

    Nothing is held: each question reads the page or two that its answer needs."""

    def __init__(self, native: _lodpack.Objects) -> None:
        self._native = native

    def __len__(self) -> int:
        """How many objects there are. Assemblies have the numbers behind theirs, up to `node_count`."""
        return self._native.counts[0]

    @property
    def node_count(self) -> int:
        """How many objects and assemblies there are."""
        return self._native.counts[1]

    def __getitem__(self, number: int) -> Object:
        """The object or assembly of a number, from 0 to `node_count` - 1."""
        number = self._number(number)
        return Object(number, *self._native.node(number))

    def find(self, name: str) -> list[int]:
        """The numbers of all objects and assemblies of a name, ascending."""
        return self._native.find_name(text(name, "a name"))

    def find_id(self, id: str) -> list[int]:
        """The numbers of all objects and assemblies of an id, ascending."""
        return self._native.find_id(text(id, "an id"))

    def children(self, parent: int | None = None) -> list[int]:
        """The numbers of what an object or assembly consists of, ascending; without one, of all that is a part of
        nothing."""
        return self._native.children(None if parent is None else self._number(parent))

    def above(self, number: int) -> list[int]:
        """What an object or assembly is a part of: its parent, that one's parent, and so on."""
        return self._native.above(self._number(number))

    def bounds(self, objects: int | str | Iterable[int | str]) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
        """The box around some objects and assemblies, named as for `File.extract`, with everything below them: smallest
        and largest corner; None around nothing."""
        return self._native.bounds(self.numbers(objects, "objects"))

    def numbers(self, objects: int | str | Iterable[int | str], name: str) -> list[int]:
        """The numbers of objects and assemblies that a caller means: numbers, names, or ids where nothing has the
        name."""
        found: list[int] = []
        if isinstance(objects, str | SupportsIndex):
            all_wanted: Iterable[int | str | SupportsIndex] = [objects]
        elif isinstance(objects, Iterable):
            all_wanted = objects
        else:
            raise ArgumentError(f"{name}: expected numbers, names or ids of objects, not {objects!r}")
        for wanted in all_wanted:
            if not isinstance(wanted, str):
                found.append(self._number(wanted))
                continue
            numbers = self.find(wanted) or self.find_id(wanted)
            if not numbers:
                raise QueryError(f"{name}: no object has the name or id {wanted!r}")
            found.extend(numbers)
        return found

    def leaves(self, number: int) -> list[int]:
        """The roots that hold an object, ascending; none for an assembly."""
        number = self._number(number)
        return self._native.leaves(number) if number < len(self) else []

    def _number(self, which: SupportsIndex) -> int:
        number = whole(which, "the number of an object")
        if not 0 <= number < self.node_count:
            raise IndexError(f"there is no object {number}; they are numbered from 0 to {self.node_count - 1}")
        return number

    def __repr__(self) -> str:
        return f"<lodpack.Objects: {len(self):,} objects, {self.node_count - len(self):,} assemblies>"
