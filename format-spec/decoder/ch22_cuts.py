"""Chapter 22.6: cuts and stitching of tiles of heights."""

from bisect import bisect_left, bisect_right

from .ch02_conventions import must
from .ch14_cuts import check_cut, stitch
from .ch22_tiles import Drawn
from .ch22_heights import SIDE


class HeightsCut:
    """The mesh of a cut: the place of each drawn sample, by its column and row, and triangles of samples."""

    def __init__(self, file, resolutions):
        """`resolutions`: the number of the resolution of each tile of the cut, the coarsest one being 0."""
        check_cut(list(resolutions), lambda tile: (tile[0] - 1, tile[1] // 2, tile[2] // 2) if tile[0] > 0 else None)
        self.file, self.places = file, {}
        found = []
        for tile, number in resolutions.items():
            record = file.records[tile]
            must(number < len(record.resolutions), "a tile has fewer resolutions")
            if tile not in file.drawn:
                file.drawn[tile] = Drawn(file, tile)
            drawn = file.drawn[tile]
            for corners in drawn.triangles(record.resolutions[number].tolerance):
                triangle = [self.sample(drawn.lines[0][at % SIDE], drawn.lines[1][at // SIDE]) for at in corners]
                self.places |= {sample: drawn.places[at] for sample, at in zip(triangle, corners)}
                # Sides have a length along the columns of the tile, of which column C may be column 0.
                found.append([(drawn.lines[0][at % SIDE], drawn.lines[1][at // SIDE]) for at in corners])
        self.rows, self.columns = {}, {}
        for column, row in self.places:
            self.columns.setdefault(column, []).append(row)
            self.rows.setdefault(row, []).append(column)
        for lines in (self.rows, self.columns):
            for line in lines.values():
                line.sort()
        self.triangles = []
        for triangle in found:
            sides = [self.inserted(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]
            pieces = stitch([self.sample(*corner) for corner in triangle], sides)
            self.triangles += [piece for piece in pieces if len(set(piece)) == 3]

    def sample(self, column, row):
        """The name of a point: column C of a grid that wraps is column 0, and all samples of a pole are one point
        (22.1)."""
        return (0 if self.is_pole(row) else self.column(column), row)

    def column(self, column):
        return 0 if self.file.wraps and column == self.file.counts[0] else column

    def is_pole(self, row):
        return any(is_pole and row == at for is_pole, at in zip(self.file.poles, (0, self.file.counts[1])))

    def inserted(self, a, b):
        """The drawn samples strictly between the ends of a side, from a to b."""
        if a[0] != b[0] and self.is_pole(a[1]) != self.is_pole(b[1]):
            # It runs along the column of the end that is no pole.
            column = b[0] if self.is_pole(a[1]) else a[0]
            a, b = (column, a[1]), (column, b[1])
        if a[0] == b[0]:
            column = self.column(a[0])
            return [(column, row) for row in between(self.columns.get(column, []), a[1], b[1])]
        if a[1] == b[1]:
            return [(column, a[1]) for column in between(self.rows.get(a[1], []), a[0], b[0])]
        return []


def between(line, start, end):
    """The numbers of a sorted line strictly between two others, in the order from start to end."""
    low, high = sorted((start, end))
    found = line[bisect_right(line, low) : bisect_left(line, high)]
    return found if start < end else found[::-1]
