"""A reader for PyVista. The package's entry point registers it, so that ``pyvista.read("scan.lodpack")`` needs no
import of lodpack.

Addresses are read in part, like paths: ``pyvista.read("https://example.org/scan.lodpack", max_triangles=100_000)``.
"""

from __future__ import annotations

from typing import Any

from ._file import open


def read(path: str, **query: Any) -> Any:
    """Reads a lodpack file as a ``pyvista.PolyData``; `query` goes to `File.extract`."""
    with open(path) as file:
        return file.extract(**query).to_pyvista()


def register() -> None:
    """Registers the reader where entry points are not looked at, such as in a folder that is not installed."""
    import pyvista

    # PyVista's own types are stricter about names of arguments than it is.
    handler: Any = read
    pyvista.register_reader(".lodpack", handler, override=True)
