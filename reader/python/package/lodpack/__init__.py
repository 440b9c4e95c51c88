"""Any part of a huge triangle mesh, at any certified error, from one .lodpack file.

    import lodpack

    file = lodpack.open("https://example.org/scan.lodpack")
    mesh = file.extract(bbox=((0, 0, 0), (1, 1, 1)), tolerance=0.002)
    print(len(mesh.triangles), "triangles, at most", mesh.error, "off the input")

Lengths are in the units of the file's coordinates. Opening reads 8 kB; what is asked for later is read then.
"""

from ._build import build
from ._errors import ArgumentError, BuildError, Error, FormatError, LimitError, QueryError, SourceError, UnsupportedError
from ._file import Cut, File, open
from ._ground import Ground
from ._heights import HeightsFile, Image, Window
from ._info import Channel, DrapeInfo, GroundInfo, HeightsInfo, Info, Level, OverviewInfo, RampInfo
from ._lodpack import VERSION as __version__
from ._mesh import Mesh, TexturedMesh
from ._objects import Object, Objects, Pick

__all__ = [
    "ArgumentError",
    "BuildError",
    "Channel",
    "Cut",
    "DrapeInfo",
    "Error",
    "File",
    "FormatError",
    "Ground",
    "GroundInfo",
    "HeightsFile",
    "HeightsInfo",
    "Image",
    "Info",
    "Level",
    "LimitError",
    "Mesh",
    "Object",
    "Objects",
    "OverviewInfo",
    "Pick",
    "QueryError",
    "RampInfo",
    "SourceError",
    "TexturedMesh",
    "UnsupportedError",
    "Window",
    "__version__",
    "build",
    "open",
]
