"""What callers give, as the reader takes it: what cannot be one is refused by `ArgumentError`, with its name."""

from __future__ import annotations

import math
import operator
from typing import Any, Mapping

from ._errors import ArgumentError, QueryError

# The reader counts in 64 bits.
MOST = 2**64 - 1
# As the program has it: more threads than cores only take memory.
MOST_THREADS = 1024


def number(value: Any, name: str) -> float:
    """A number."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{name} has to be a number, and is {value!r:.80}") from None


def whole(value: Any, name: str) -> int:
    """A whole number from 0."""
    try:
        count = operator.index(value)
    except TypeError:
        raise ArgumentError(f"{name} has to be a whole number, and is {value!r:.80}") from None
    if count < 0:
        raise QueryError(f"{name} must be zero or more, and is {count}")
    return count


def budget(value: Any, name: str) -> int | None:
    """A budget; None for none."""
    return None if value is None else min(whole(value, f"the budget {name}"), MOST)


def threads(value: Any) -> int:
    """A number of threads; 0 stands for all cores."""
    count = whole(value, "threads")
    if count > MOST_THREADS:
        raise QueryError(f"at most {MOST_THREADS} threads are possible, not {count}; 0 takes all cores")
    return count


def text(value: Any, name: str) -> str:
    """A text."""
    if not isinstance(value, str):
        raise ArgumentError(f"{name} has to be a text, and is {value!r:.80}")
    return value


def seconds(value: Any, name: str) -> float:
    """A time above zero; what is longer than a year counts as one."""
    found = number(value, name)
    if not 0 < found < math.inf:
        raise QueryError(f"a {name} must be a positive number of seconds")
    return min(found, 365 * 86400.0)


def limits(given: Any) -> dict[str, int] | None:
    """Upper limits by name."""
    if given is None:
        return None
    if not isinstance(given, Mapping):
        raise ArgumentError(f"limits are numbers by name, such as {{'root_count': 1000}}, and not {given!r:.80}")
    return {text(name, "the name of a limit"): min(whole(value, f"the limit {name}"), MOST) for name, value in given.items()}


def point(value: Any, name: str) -> list[float]:
    """Three coordinates."""
    try:
        found = [number(coordinate, f"a coordinate of {name}") for coordinate in value]
    except TypeError:
        found = []
    if len(found) != 3:
        raise QueryError(f"give {name} as three coordinates: (x, y, z)")
    return found


def corners(bbox: Any, axis_count: int, example: str) -> list[list[float]]:
    """The two corners of a box, as lists."""
    try:
        found = [[number(value, "a coordinate of bbox") for value in corner] for corner in bbox]
    except TypeError:
        found = []
    if [len(corner) for corner in found] != [axis_count, axis_count]:
        # Six numbers in a row mean one thing to VTK and another to everybody else.
        raise QueryError(f"give bbox as {example}")
    if any(math.isnan(value) for corner in found for value in corner):
        raise QueryError(f"a coordinate of bbox is not a number: {found}")
    return found
