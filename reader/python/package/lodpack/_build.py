"""Builds lodpack files from meshes."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any, Callable, Sequence, cast

from . import _lodpack
from ._carried import CarriedMesh, checked_mesh, of_pyvista, of_trimesh
from ._checked import number, text as checked_text, threads as checked_threads, whole
from ._errors import ArgumentError, BuildError, Error, OutputError, OutputExists, OutputIsDirectory, QueryError

Paths = str | os.PathLike[str]
Progress = Callable[[str, int, int], object]


def build(
    source: Paths | Sequence[Paths] | tuple[Any, Any] | Any,
    output: Paths | None = None,
    *,
    tolerance: float | str = "auto",
    unit: str | None = None,
    effort: str = "default",
    levels: str = "all",
    threads: int = 0,
    memory: int | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Builds a file, as ``lodpack build`` does, and returns the summary that it prints with ``--json``, with ``output``
    and ``notes`` added.

    `source`: a mesh file (OBJ, OFF, PLY, STL, glTF, GLB), several that make one model, or a mesh in memory:
    ``(positions, triangles)``, or an object of trimesh or PyVista, with colours, a texture and numbers of its vertices;
    of PyVista ``(mesh, texture)``, too, as
    `TexturedMesh.to_pyvista` makes it. ``notes`` say what of it is left out.
    `output`: the file to write; by default it lies beside the first mesh file and has its name. It gets its name when
    it is complete, and replaces another one only with `force`.
    `tolerance`: the largest certified error of the finest level: a length in the input's units, or a text as for the
    program, such as
    ``"0.05mm"`` (with `unit`), ``"0.01%"`` of the diagonal or ``"0.4edge"``.
    `effort`: ``fast``, ``default`` or ``best``. `levels`: ``all`` or ``finest``.
    `threads`: 0 takes all cores. `memory`: bytes that the build may take; what does not fit goes to temporary files
    beside the output. By default half of the machine's memory. The file depends on neither.
    `progress`: called in this thread some times a second with the stage, how much of it is done, and of what (0 if that
    is not known).

    Other threads go on meanwhile. Ctrl-C, or an exception of `progress`, stops the build, and nothing of it is left.

    Raises `BuildError` for what cannot be built, which is a FileExistsError, too, where the output exists, and
    `QueryError` for options that make no sense.
    """
    if not hasattr(_lodpack, "build"):
        raise Error("this wheel was made without the feature build; make one with it, or run the program `lodpack build`")
    # Before a large mesh is looked at.
    if not isinstance(tolerance, str):
        tolerance = number(tolerance, "tolerance")
    effort, levels, threads = checked_text(effort, "effort"), checked_text(levels, "levels"), checked_threads(threads)
    unit = None if unit is None else checked_text(unit, "unit")
    if memory is not None and not 0 < (memory := whole(memory, "memory")) < 2**64:
        raise QueryError(f"memory is a number of bytes, and not {memory}")
    if progress is not None and not callable(progress):
        raise ArgumentError(f"progress has to be a function, and is {progress!r:.80}")
    mesh, inputs = _mesh_or_paths(source)
    target = _path(output) if output is not None else _beside(inputs)
    if target.is_dir():
        raise OutputIsDirectory(f"{target} is a directory; name a file")
    if target.exists() and not force:
        raise OutputExists(f"{target} exists; pass force=True to overwrite it, or name another file")
    if any(target.exists() and path.exists() and path.samefile(target) for path in inputs):
        raise BuildError(f"{target} is an input and cannot be the output, too")
    # In the same folder, so that it can be renamed.
    try:
        room = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    except OSError as error:
        raise OutputError(error.errno, f"cannot write there: {error.strerror}", str(target)) from None
    try:
        request = _lodpack.BuildRequest()
        request.inputs, request.output, request.work = inputs, room / target.name, room / "work"
        request.tolerance, request.unit = str(tolerance), unit
        request.effort, request.levels, request.threads, request.memory = effort, levels, threads, memory
        if mesh is not None and mesh.carries_more():
            request.inputs = [mesh.write_ply(room)]
        arrays = None if mesh is None or mesh.carries_more() else (mesh.positions.tobytes(), mesh.triangles.tobytes())
        text, notes = _lodpack.build(request, arrays, progress)
        if mesh is not None:
            notes = mesh.notes + [note.replace(str(room / "mesh.ply"), "the mesh in memory") for note in notes]
        # Not through tempfile, whose files nobody else may read.
        _name(room / target.name, target, force)
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(room)
    return {**cast("dict[str, Any]", json.loads(text)), "output": target, "notes": notes}


def _name(built: Path, target: Path, force: bool) -> None:
    """Gives the file its name: over another one, which may have appeared meanwhile, only with `force`."""
    try:
        if force:
            os.replace(built, target)
            return
        try:
            os.link(built, target)  # Unlike renaming, it never replaces.
        except FileExistsError:
            raise OutputExists(f"{target} appeared during the build; pass force=True to overwrite it") from None
        except OSError:  # Not every file system has links.
            if target.exists():
                raise OutputExists(f"{target} appeared during the build; pass force=True to overwrite it") from None
            os.rename(built, target)
    except OSError as error:
        if isinstance(error, Error):
            raise
        raise OutputError(error.errno, f"cannot write there: {error.strerror}", str(target)) from None


def _path(value: Any) -> Path:
    try:
        return Path(value)
    except TypeError:
        raise ArgumentError(f"a path has to be a text or a path, and is {value!r:.80}") from None


def _beside(inputs: list[Path]) -> Path:
    if not inputs:
        raise ArgumentError("a mesh in memory has no name: give an output")
    return inputs[0].with_suffix(".lodpack")


def _mesh_or_paths(source: Any) -> tuple[CarriedMesh | None, list[Path]]:
    """A mesh in memory, or the paths of mesh files."""
    if isinstance(source, (str, os.PathLike)):
        return None, [Path(source)]
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        return of_trimesh(source), []
    if hasattr(source, "points") and hasattr(source, "triangulate"):
        return of_pyvista(source), []
    try:
        parts = list(source)
    except TypeError:
        raise ArgumentError(f"give a mesh file, several, or a mesh, and not {source!r:.80}") from None
    if parts and all(isinstance(part, (str, os.PathLike)) for part in parts):
        return None, [Path(part) for part in parts]
    if len(parts) == 2 and hasattr(parts[0], "points") and hasattr(parts[1], "to_array"):
        return of_pyvista(*parts), []
    if len(parts) == 2:
        return checked_mesh(*parts), []
    raise ArgumentError("give a mesh file, several, (positions, triangles), or a mesh of trimesh or PyVista")
