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


class ArgumentError(QueryError, TypeError):
    """A value is of a type that the call does not take."""


class LimitError(Error):
    """The file asks for more than the limits allow. Open it with larger ``limits`` if it is trusted."""


class BuildError(Error, ValueError):
    """The input of a build is unusable, or the build ran out of memory or disk. The message names the file and the
    place."""


# What the system says of a path keeps its own type, too.


class MissingFile(SourceError, FileNotFoundError):
    """There is no such file."""


class IsDirectory(SourceError, IsADirectoryError):
    """It is a directory."""


class NoPermission(SourceError, PermissionError):
    """The system does not let this process read it."""


class OutputExists(BuildError, FileExistsError):
    """The output of a build is there already."""


class OutputIsDirectory(BuildError, IsADirectoryError):
    """The output of a build is a directory."""


class OutputError(BuildError, OSError):
    """The output of a build cannot be written there."""


def of_system(error: OSError) -> SourceError:
    """What the system said of a file that is read."""
    kinds: dict[type[OSError], type[SourceError]] = {
        FileNotFoundError: MissingFile, IsADirectoryError: IsDirectory, PermissionError: NoPermission
    }
    kind = kinds.get(type(error), SourceError)
    return kind(*error.args) if error.filename is None else kind(error.errno, error.strerror, error.filename)
