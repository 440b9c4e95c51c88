"""What `lodpack.open` takes, and how it is read: paths, addresses, bytes, and files of Python or fsspec.

The native half reads paths, bytes and web servers itself. Everything else becomes an object with `size()` and
`read_ranges([(offset, length), ...])`, which returns a `bytes` for each range, shorter where the file ends.
"""

from __future__ import annotations

import io
import os
import threading
from datetime import timedelta
from typing import Any, Mapping, Sequence
from urllib.parse import urlsplit
from urllib.request import url2pathname

from . import _lodpack
from ._checked import limits as checked_limits, seconds
from ._errors import ArgumentError, Error, SourceError, of_system

Ranges = Sequence[tuple[int, int]]


class FileRanges:
    """A binary file with `read` and `seek`, which threads use by turns."""

    def __init__(self, file: Any) -> None:
        self._file, self._lock = file, threading.Lock()

    def size(self) -> int:
        with self._lock:
            return int(self._file.seek(0, os.SEEK_END))

    def read_ranges(self, ranges: Ranges) -> list[bytes]:
        with self._lock:
            return [self._read(offset, length) for offset, length in ranges]

    def _read(self, offset: int, length: int) -> bytes:
        self._file.seek(offset)
        found = bytearray()
        # An unbuffered file may return less than it has.
        while len(found) < length:
            more = self._file.read(length - len(found))
            if not more:
                break
            found += more
        return bytes(found)


class FsspecRanges:
    """A file of a file system of fsspec. It is asked for all ranges at once, and for nothing around them."""

    def __init__(self, file_system: Any, path: str) -> None:
        self._file_system, self._path = file_system, path

    def size(self) -> int:
        size = self._file_system.info(self._path)["size"]
        if size is None:
            raise OSError(f"{self._path}: the size of the file is not known, so its parts cannot be read")
        return int(size)

    def read_ranges(self, ranges: Ranges) -> list[bytes]:
        starts = [offset for offset, _ in ranges]
        ends = [offset + length for offset, length in ranges]
        paths = [self._path] * len(starts)
        return [bytes(part) for part in self._file_system.cat_ranges(paths, starts, ends, on_error="raise")]


def open_native(source: Any, timeout: float, limits: Mapping[str, int] | None) -> _lodpack.Reader | _lodpack.HeightsReader:
    """Opens whatever `source` is."""
    timeout, checked = seconds(timeout, "timeout"), checked_limits(limits)
    try:
        return _open(source, timeout, checked)
    except OSError as error:
        if isinstance(error, Error):
            raise
        raise of_system(error) from error.__cause__


def _open(source: Any, timeout: float, checked: dict[str, int] | None) -> _lodpack.Reader | _lodpack.HeightsReader:
    if isinstance(source, (bytes, bytearray, memoryview)):
        return _lodpack.open_bytes(bytes(source), f"<{len(source)} bytes>", checked)
    if isinstance(source, (str, os.PathLike)) and isinstance(path := os.fspath(source), str):
        if "\0" in path:
            raise ArgumentError(f"a path has no zeros in it: {path!r:.80}")
        scheme = urlsplit(path).scheme.lower() if "://" in path else ""
        if scheme in ("http", "https"):
            return _lodpack.open_url(path, timedelta(seconds=timeout), checked)
        if scheme == "file":
            return _lodpack.open_path(url2pathname(urlsplit(path).path), checked)
        if scheme:
            return _open_with_fsspec(path, checked)
        return _lodpack.open_path(path, checked)
    if isinstance(source, io.TextIOBase):
        raise ArgumentError("the file is open in text mode; open it with mode 'rb'")
    # What `fsspec.open` returns: a file that is yet to be opened.
    file_system, path = getattr(source, "fs", None), getattr(source, "path", None)
    if hasattr(file_system, "cat_ranges") and isinstance(path, str):
        return _lodpack.open_object(FsspecRanges(file_system, path), path, checked)
    if hasattr(source, "read") and hasattr(source, "seek"):
        if hasattr(source, "seekable") and not source.seekable():
            raise SourceError("the file cannot seek, so its parts cannot be read; copy it to a disk or into memory")
        name = getattr(source, "name", None)
        name = name if isinstance(name, str) else f"<{type(source).__name__}>"
        return _lodpack.open_object(FileRanges(source), name, checked)
    raise ArgumentError(f"cannot open {type(source).__name__}; give a path, an address, bytes, or a binary file that can seek")


def _open_with_fsspec(address: str, limits: dict[str, int] | None) -> _lodpack.Reader | _lodpack.HeightsReader:
    scheme = address.split("://")[0]
    try:
        import fsspec
    except ImportError as error:
        what = f"{address}: addresses with {scheme}:// are read by fsspec; pip install fsspec, or use an https address or a path"
        raise SourceError(what) from error
    try:
        file_system, path = fsspec.core.url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise SourceError(f"{address}: {error}") from error
    return _lodpack.open_object(FsspecRanges(file_system, path), address, limits)
