"""Chapter 23: section GROUND."""

from .ch02_conventions import must
from .ch04_header import Header, HEIGHTS, read_sections
from .ch06_resident import Placement
from .ch22_heights import Heights


class Ground:
    """The heights that a mesh stands on, and what takes them to the space of the mesh."""

    def __init__(self, data, placement):
        header = Header(data)
        sections = read_sections(data, header)
        must(HEIGHTS in sections, "GROUND holds a mesh")
        self.heights = Heights(header, sections)
        must(not self.heights.is_globe, "GROUND lies on a globe")
        nothing = Placement(0, 0.0, [0.0] * 3, "")
        own, mesh = self.heights.placement or nothing, placement or nothing
        must(own.crs == mesh.crs or "" in (own.crs, mesh.crs), "GROUND is in another coordinate reference system than the mesh")
        self.units = [own.unit or 1.0, mesh.unit or 1.0]
        must(all(u <= 1e15 and 1 / u <= 1e15 for u in self.units), "GROUND or the mesh on it has a unit beyond 10^15")
        must(all(abs(x) <= 1e15 for x in own.origin + mesh.origin), "GROUND or the mesh on it has an origin beyond 10^15")
        self.origins = [own.origin, mesh.origin]
        self.is_in_place = self.units[0] == self.units[1] and own.origin == mesh.origin
        self.is_y_up = mesh.up == 1
        self.scale = 1.0 if self.is_in_place else self.units[0] / self.units[1]

    def point(self, p):
        if not self.is_in_place:
            p = [((a * self.units[0] + b) - c) / self.units[1] for a, b, c in zip(p, *self.origins)]
        return (p[0], p[2], -p[1]) if self.is_y_up else tuple(p)
