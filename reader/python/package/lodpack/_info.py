"""What `File.info` returns. The names are those of `lodpack info --json`."""

from __future__ import annotations

from typing import TypedDict

Point = tuple[float, float, float]


class Level(TypedDict):
    """What a file says about a level."""

    level: int
    """0 is the coarsest."""
    triangles: int
    """Triangles with everything drawn at this level."""
    certified_error: float
    """Bound of the two-sided distance to the input with everything drawn at this level."""
    tolerance: float
    """The error that the level was built for."""
    page_bytes: int
    """Bytes that this level adds to the coarser ones."""


class OverviewInfo(TypedDict):
    """What a file says about its overview: one small mesh of everything."""

    triangles: int
    certified_error: float


class Channel(TypedDict):
    """Something that the surface carries besides positions."""

    name: str
    kind: str
    """``colour`` (sRGB), ``scalar`` (measured numbers), ``normal``, ``label`` (numbers of classes), ``factor`` (from 0
    to 1), ``drawing`` (how the surface is drawn: SPEC.md, 21.6), or ``unknown``."""
    lossless: bool
    """Whether colours, normals or factors are stored without loss; False for other kinds."""
    components: int
    """Numbers of a value, 1 to 4."""
    low: float
    step: float
    """A stored number n stands for the value ``low + n * step``."""
    bound: float
    """Stated bound on the error of a value; 0 where none is stated."""
    bytes: int
    """Of all its images in the file."""


class RampInfo(TypedDict):
    """Colours by height."""

    name: str
    stops: list[tuple[float, tuple[int, int, int]]]
    """Heights, and red, green and blue as screens show them (sRGB)."""


class DrapeInfo(TypedDict):
    """An image over heights."""

    size: tuple[int, int]
    """Texels in a row, and rows."""
    first: tuple[float, float]
    """Where the centre of its first texel is: column and row of samples, which need not be whole."""
    spacing: tuple[float, float]
    """Columns and rows of samples from a texel to the next one."""
    has_opacity: bool
    bytes: int
    """Of it in the file."""


class HeightsInfo(TypedDict):
    """What is known about a file of heights as soon as it is open."""

    holds: str
    """``heights``."""
    version: str
    """Version of the format."""
    generator: str
    """Program and version that wrote the file."""
    columns: int
    """Of samples."""
    rows: int
    surface: str
    """What heights stand on: ``plane``, ``sphere`` or ``ellipsoid``."""
    first: tuple[float, float]
    """Of the first sample, in the north-west: x and y, or degrees of longitude and latitude."""
    spacing: tuple[float, float]
    """What each column and each row adds. The second one is negative."""
    wraps: bool
    """Whether the grid closes around the globe."""
    poles: tuple[bool, bool]
    """Whether the first and the last row are a pole."""
    step: float
    """The difference of two neighbouring stored heights."""
    sample_error: float
    """How far a stored height may be from that of the input, in units of heights."""
    unit: float | None
    """Metres in a unit of heights, where that is known."""
    height_scale: float
    """Coordinates in a unit of heights."""
    depth_count: int
    ramp: RampInfo | None
    drape: DrapeInfo | None
    """The image over the heights."""
    crs: str
    """The coordinate reference system, as EPSG and a number or as WKT; empty if there is none."""
    origin: tuple[float, float, float]
    """What is added to coordinates and heights to have those of the CRS."""
    bounds: tuple[Point, Point] | None
    """Smallest and largest coordinates in space; None for an empty file."""


class GroundInfo(TypedDict):
    """What a file says about the heights that its mesh stands on, before they are opened."""

    bytes: int
    """Of them in the file."""


class Info(TypedDict):
    """What is known about a file as soon as it is open."""

    version: str
    """Version of the format."""
    generator: str
    """Program and version that wrote the file."""
    source_triangles: int
    """Triangles of the input after repair."""
    source_vertices: int
    mean_edge_length: float
    """Of the input."""
    bounds: tuple[Point, Point] | None
    """Smallest and largest coordinates; None for an empty file."""
    lattice_step: float
    """Coordinates are multiples of it, from the file's origin on."""
    roots: int
    arcs: int
    corners: int
    levels: list[Level]
    """Coarse to fine."""
    overview: OverviewInfo | None
    channels: list[Channel]
    """What the surface carries besides positions."""
    ground: GroundInfo | None
    """The heights that the mesh stands on: `File.ground` opens them."""
    objects: int
    """How many objects the input named: `File.objects` has them."""
