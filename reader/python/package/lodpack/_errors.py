"""Exceptions by culprit: the type says who has to act to make the call succeed."""


class Error(Exception):
    """Why a call of lodpack failed."""


class SourceError(Error, OSError):
    """The bytes could not be read: a disk, a server or a network failed. Where a Python object was read, its exception
    is the cause."""


class FormatError(Error, ValueError):
    """The file is damaged, or not a lodpack file. Copy, download or build it again."""


class UnsupportedError(Error):
    """The file is sound but needs a newer lodpack."""


class QueryError(Error, ValueError):
    """The caller asked for something impossible; the message says what would be possible."""


class LimitError(Error):
    """The file asks for more than the limits allow. Open it with larger ``limits`` if it is trusted."""


class BuildError(Error, ValueError):
    """The input of a build is unusable, or the build ran out of memory or disk. The message names the file and the
    place."""
