"""Chapter 22: files of heights: the grid, the index, and blocks of samples."""

import math
import zlib
from collections import namedtuple

from .ch02_conventions import bound, Bytes, Damaged, must, unzigzag
from .ch04_header import DRAPE, HEIGHT_INDEX, HEIGHTS, PAGES, PLACEMENT, RAMP, SOURCE, TABLES
from .ch06_resident import check_source, read_part, read_placement
from .ch07_entropy import read_tables, Stream
from .ch22_drape import Drape

SIDE, CELLS = 65, 64
ALL_CELLS = [(1 << CELLS) - 1] * CELLS
CORNER, BEYOND, CENTRES, EDGES, CELL = 249, 250, 251, 283, 315
Record = namedtuple("Record", "tile children partial lowest highest resolutions block")
Resolution = namedtuple("Resolution", "tolerance error triangle_count")
Tile = namedtuple("Tile", "samples cells known")  # cells: a number per row; known: which samples are
SINE = (-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04)
SINE += (2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10)
COSINE = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05)
COSINE += (-2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11)


def bit(number, k):
    return number >> k & 1


class Heights:
    """A file of heights: the records of all its tiles, and their samples."""

    def __init__(self, header, sections):
        tables = read_tables(sections[TABLES])
        data = Bytes(sections[HEIGHTS], "HEIGHTS")
        self.counts = [data.number("Q"), data.number("Q")]
        must(all(1 <= count <= 2**30 for count in self.counts), "a grid has too few or too many cells")
        flags, base = data.number("B"), data.number("B")
        must(flags < 8 and base < 2 and data.take(6) == bytes(6), "HEIGHTS has a flag or a base that is unknown")
        self.wraps, self.poles = bool(flags & 1), [bool(flags & 2), bool(flags & 4)]
        numbers = [data.number("d") for _ in range(11)]
        must(all(abs(x) < 1e15 for x in numbers), "a number of HEIGHTS is out of range")
        self.is_globe, self.numbers, self.place = base == 1, numbers, numbers[2:6]
        self.axis, self.eccentricity, _, _, dx, dy, self.height_scale, self.zero, self.step, sample_error, unit = numbers
        must(dx > 0 > dy and self.height_scale > 0 and self.step > 0, "a number of HEIGHTS has a wrong sign")
        must(sample_error >= 0 and unit >= 0, "a number of HEIGHTS has a wrong sign")
        if self.is_globe:
            must(self.axis > 0 and 0 <= self.eccentricity < 0.5, "HEIGHTS has no ellipsoid")
        else:
            must(self.axis == self.eccentricity == 0 and flags == 0, "a plane has an axis, wraps or has poles")
        must(not self.wraps or abs(self.counts[0] * dx - 360) < 0.5 * dx, "a grid that wraps does not go around")
        length = data.varint()
        must(length <= 255, "the name of the ramp is too long")
        try:
            self.ramp = bytes(data.take(length)).decode("utf-8")
        except UnicodeDecodeError:
            raise Damaged("the name of the ramp is not UTF-8") from None
        self.depth = 0
        while math.prod(self.roots()) > 2:
            self.depth += 1
        columns, rows = self.roots()
        tops = [(0, i, j) for j in range(rows) for i in range(columns)]
        pages = [(tile, math.inf, read_part(data)) for tile in tops]
        root_blocks = Bytes(data.take(len(data.data) - data.at), "the blocks in HEIGHTS")
        self.records, self.tiles = {}, {}
        self.drawn = {}  # tiles in space that a cut has drawn
        blocks = Bytes(sections[PAGES], "PAGES")
        index = Bytes(sections[HEIGHT_INDEX], "HEIGHT_INDEX")
        pages = [page for page in pages if page[2].length > 0]
        while pages:
            below = []
            for tile, coarser, part in pages:
                page = index.take(part.length)
                must(zlib.crc32(page) == part.crc, "the checksum of an index page is wrong")
                below.append((self.read_page(Bytes(page, "an index page"), tile, coarser, root_blocks, blocks, tables)))
            at = index.at
            for first_page, children in below:
                must(first_page == (at if children else 0), "the pages below a page are not where it says")
                at += sum(part.length for _, _, part in children)
            pages = [child for _, children in below for child in children]
        for rest in (root_blocks, blocks, index):
            rest.end()
        if self.is_globe:
            self.add_level_tiles(sample_error * self.height_scale + self.axis * 2.0**-48)
        self.placement = read_placement(sections[PLACEMENT]) if PLACEMENT in sections else None
        self.stops = self.read_ramp(Bytes(sections[RAMP], "RAMP")) if RAMP in sections else None
        self.drape = Drape(sections[DRAPE]) if DRAPE in sections else None
        if SOURCE in sections:
            check_source(sections[SOURCE])

    # 22.8 Section RAMP

    def read_ramp(self, data):
        count = data.varint()
        must(1 <= count <= 1024, "a ramp has no stops, or too many")
        stops = [(data.number("d"), list(data.take(3))) for _ in range(count)]
        data.end()
        must(all(abs(height) < 1e15 for height, _ in stops), "a height of a ramp is out of range")
        must(all(a <= b for (a, _), (b, _) in zip(stops, stops[1:])), "the heights of a ramp fall")
        return stops

    # 22.1 The grid

    def roots(self):
        return [-(-count // (CELLS << self.depth)) for count in self.counts]

    def lines(self, tile):
        d, i, j = tile
        starts = zip(self.counts, (CELLS * i, CELLS * j))
        return [[min(count, (start + k) << (self.depth - d)) for k in range(SIDE)] for count, start in starts]

    def has(self, tile):
        return tile[0] <= self.depth and all(lines[0] < lines[CELLS] for lines in self.lines(tile))

    # 22.3 Section HEIGHT_INDEX

    def read_page(self, data, top, coarser, root_blocks, blocks, tables):
        first_block, first_page = data.number("Q"), data.number("Q")
        depth, tolerances, lowest, first = [(top, coarser)], [0] * 8, 0, None
        start = blocks.at
        for _ in range(4):
            below = []
            for tile, coarser in depth:
                flags = data.number("B")
                block = read_part(data)
                lowest += unzigzag(data.varint())
                highest = lowest + data.varint()
                must(-(2**31) <= lowest <= highest < 2**31, "a height exceeds 32 bits")
                resolutions = []
                for k in range((flags >> 5) + 1):
                    tolerances[k] += unzigzag(data.varint())
                    error = tolerances[k] + unzigzag(data.varint())
                    must(0 <= tolerances[k] < 65536 and 0 <= error < 65536, "an error code exceeds 16 bits")
                    resolutions.append(Resolution(bound(tolerances[k], 0), bound(error, 0), data.varint()))
                    must(resolutions[-1].error <= coarser, "errors grow")
                    must(resolutions[-1].triangle_count <= 8192, "a tile has too many triangles")
                    coarser = resolutions[-1].error
                source = root_blocks if tile[0] == 0 else blocks
                if block.length > 0 and tile[0] > 0 and first is None:
                    first = source.at
                coded = source.take(block.length)
                must(block.length == 0 or zlib.crc32(coded) == block.crc, "the checksum of a block is wrong")
                record = Record(tile, flags & 15, bool(flags & 16), lowest, highest, resolutions, block)
                self.records[tile] = record
                self.tiles[tile] = self.read_block(record, coded, tables)
                d, i, j = tile
                quarters = [(d + 1, 2 * i + x, 2 * j + y) for y in range(2) for x in range(2)]
                quarters = [quarter for k, quarter in enumerate(quarters) if bit(flags, k)]
                must(all(self.has(quarter) for quarter in quarters), "a tile has a quarter that is not in the grid")
                below += [(quarter, coarser) for quarter in quarters]
            depth = below
        must(first_block == (first or 0) and (first is not None or blocks.at == start), "blocks are not where a page says")
        children = [(tile, coarser, read_part(data)) for tile, coarser in depth]
        must(all(part.length > 0 for _, _, part in children), "an index page has no bytes")
        data.end()
        return first_page, children

    def add_level_tiles(self, least):
        """Adds the tiles below level ones, which follow from these."""
        waiting = [r for r in self.records.values() if not r.children and not r.partial and r.lowest == r.highest]
        for record in waiting:
            d, i, j = record.tile
            quarters = [(d + 1, 2 * i + x, 2 * j + y) for y in range(2) for x in range(2)]
            children = sum(self.has(quarter) << k for k, quarter in enumerate(quarters))
            self.records[record.tile] = record._replace(children=children)
            error = record.resolutions[-1].error
            error = min(error, least + (error - least) * (0.2578125 if d + 1 < self.depth else 0.0))
            for quarter in (quarter for k, quarter in enumerate(quarters) if bit(children, k)):
                columns, rows = self.lines(quarter)
                width, height = (sum(a < b for a, b in zip(lines, lines[1:])) for lines in (columns, rows))
                poles = (self.poles[0] and rows[0] == 0) + (self.poles[1] and rows[CELLS] == self.counts[1])
                resolution = Resolution(0.0, error, width * (2 * height - poles))
                below = record._replace(tile=quarter, resolutions=[resolution], block=None)
                self.records[quarter], self.tiles[quarter] = below, self.read_block(below, b"", None)
                waiting.append(below)
        # In the order that they would have in the file.
        interleaved = lambda i, j: sum(bit(i, k) << 2 * k | bit(j, k) << 2 * k + 1 for k in range(32))

        def order(tile):
            d, i, j = tile
            up = d % 4
            return d - up, j >> d, i >> d, interleaved(i >> up, j >> up), d, interleaved(i, j)

        self.records = dict(sorted(self.records.items(), key=lambda item: order(item[0])))

    # 22.4 Blocks

    def read_block(self, record, block, tables):
        tile, lines = record.tile, self.lines(record.tile)
        d, i, j = tile
        samples, can_be = [0] * SIDE**2, ALL_CELLS
        if d > 0:
            parent = self.tiles[d - 1, i // 2, j // 2]
            x, y = 32 * (i % 2), 32 * (j % 2)
            can_be = [sum(bit(parent.cells[y + b // 2], x + a // 2) << a for a in range(CELLS)) for b in range(CELLS)]
            for b, row in enumerate(fill(parent, x, y)):
                samples[2 * b * SIDE : 2 * b * SIDE + SIDE : 2] = row
        must(record.partial or can_be == ALL_CELLS, "a tile draws cells that the tile above it does not draw")
        must(block or record.partial == (can_be != ALL_CELLS), "a tile without a block does not draw what it can")
        stream = Stream(block, tables) if block else Predicted()
        cells = can_be
        if record.partial and block:
            cells = [0] * CELLS
            drawn = lambda a, b: bit(cells[b], a) if a >= 0 and b >= 0 else 0
            for b in range(CELLS):
                for a in (a for a in range(CELLS) if bit(can_be[b], a)):
                    before = drawn(a - 1, b) + 2 * drawn(a - 1, b - 1) + 4 * drawn(a, b - 1) + 8 * drawn(a + 1, b - 1)
                    cells[b] |= stream.flag(CELL + before) << a
        known = known_samples(cells, lines)
        if d == 0:
            before = 0
            for at in (0, CELLS, SIDE * CELLS, SIDE * SIDE - 1):
                if known[at]:
                    before += stream.get_signed(CORNER)
                    must(-(2**31) <= before < 2**31, "a height exceeds 32 bits")
                samples[at] = before
        for stride in (32, 16, 8, 4, 2, 1) if d == 0 else (1,):
            Refinement(samples, lines, stride, known, stream)
        stream.end()
        own = [samples[at] for at in range(SIDE**2) if known[at]]
        must(not own or record.lowest <= min(own) and max(own) <= record.highest, "a sample is out of the range of its tile")
        return Tile(samples, cells, known)


class Predicted:
    """The stream of a block without bytes."""

    def get(self, context):
        return 0

    def get_signed(self, context):
        return 0

    def end(self):
        pass


def known_samples(cells, lines):
    touched = [[False] * SIDE for _ in range(SIDE)]
    for b in range(CELLS):
        for a in (a for a in range(CELLS) if bit(cells[b], a)):
            for x, y in ((a, b), (a + 1, b), (a, b + 1), (a + 1, b + 1)):
                touched[y][x] = True
    places = {(lines[0][a], lines[1][b]) for b in range(SIDE) for a in range(SIDE) if touched[b][a]}
    return [(lines[0][a], lines[1][b]) in places for b in range(SIDE) for a in range(SIDE)]


def fill(parent, x, y):
    """The samples of a quarter of a tile: 33 rows of 33."""
    rows = []
    for b in range(33):
        at = [(y + b) * SIDE + x + a for a in range(33)]
        values = [parent.samples[k] if parent.known[k] else None for k in at]
        last = next((value for value in values if value is not None), None)
        for a, value in enumerate(values):
            last = values[a] = last if value is None else value
        rows.append(values if last is not None else None)
    last = next((row for row in rows if row is not None), [0] * 33)
    for b, row in enumerate(rows):
        last = rows[b] = last if row is None else row
    return rows


class Refinement:
    def __init__(self, samples, lines, stride, known, stream):
        self.samples, self.known, self.stream, self.stride, self.sizes = samples, known, stream, stride, {}
        s = stride
        last = [axis.index(axis[CELLS]) for axis in lines]
        new = [range(s, end, 2 * s) for end in last]
        old = [range(0, end + 2 * s, 2 * s) for end in last]
        along = [{m: weights(axis, m, s, SIDE) for m in marks} for axis, marks in zip(lines, new)]
        across = [
            {m: weights(axis, m, s, end) for m in marks if 0 < m and m + s < end}
            for axis, marks, end in zip(lines, old, last)
        ]
        for y in new[1]:
            values = {x: sum(w * self.at(x, k) for k, w in along[1][y]) for x in old[0]}
            for x in new[0]:
                self.centre(x, y, sum(w * values[k] for k, w in along[0][x]))
        for y in range(0, SIDE, s):
            if y in new[1]:
                for x in old[0]:
                    u = sum(w * self.at(x, k) for k, w in along[1][y])
                    slope = abs(self.at(x, y - s) - self.at(x, y + s))
                    other = None
                    if x in across[0]:
                        v = sum(w * self.at(k, y) for k, w in across[0][x])
                        other = v, abs(self.at(x - s, y) - self.at(x + s, y))
                    self.edge(x, y, u, slope, other, ((x - s, y), (x + s, y)))
            elif y in old[1]:
                for x in new[0]:
                    u = sum(w * self.at(k, y) for k, w in along[0][x])
                    slope = abs(self.at(x - s, y) - self.at(x + s, y))
                    other = None
                    if y in across[1]:
                        v = sum(w * self.at(x, k) for k, w in across[1][y])
                        other = v, abs(self.at(x, y - s) - self.at(x, y + s))
                    self.edge(x, y, u, slope, other, ((x, y - s), (x, y + s)))
        column, row = (next(k for k in axis if k >= end) for axis, end in zip(old, last))
        for y in sorted([*new[1], *old[1]]):
            for x in (x for x in range(0, SIDE, s) if x >= last[0]):
                samples[y * SIDE + x] = samples[y * SIDE + column]
        for y in (y for y in range(0, SIDE, s) if y >= last[1]):
            samples[y * SIDE : y * SIDE + SIDE] = samples[row * SIDE : row * SIDE + SIDE]

    def at(self, x, y):
        return self.samples[y * SIDE + x]

    def mean(self, places):
        """12 times the mean size of residuals; none if there are none."""
        sizes = [self.sizes[place] for place in places if place in self.sizes]
        return 12 * sum(sizes) // len(sizes) if sizes else None

    def centre(self, x, y, value):
        s = self.stride
        prediction = (value + (1 << 23)) >> 24
        a, b, c, e = self.at(x - s, y - s), self.at(x + s, y - s), self.at(x - s, y + s), self.at(x + s, y + s)
        bend = abs(a + e - b - c) + abs(4 * prediction - (a + b + c + e))
        spread = max(a, b, c, e) - min(a, b, c, e)
        mean = self.mean(((x - 2 * s, y), (x - 2 * s, y - 2 * s), (x, y - 2 * s), (x + 2 * s, y - 2 * s)))
        mean = 2 * bend if mean is None else mean
        self.sample(x, y, CENTRES, (16 * mean + 6 * bend + 3 * spread) // 12, prediction)

    def edge(self, x, y, u, slope, other, centres):
        s = self.stride
        mean = self.mean((*centres, (x - s, y - s), (x + s, y - s)))
        if other is not None:
            prediction, difference = (u + other[0] + (1 << 12)) >> 13, abs(u - other[0]) >> 10
            slopes = slope + other[1]
        else:
            prediction, difference, slopes = (u + (1 << 11)) >> 12, (mean or 0) // 3, 2 * slope
        mean = 3 * difference if mean is None else mean
        self.sample(x, y, EDGES, (24 * difference + 16 * mean + 3 * slopes) // 24, prediction)

    def sample(self, x, y, first, measure, prediction):
        at = y * SIDE + x
        if not self.known[at]:
            self.samples[at] = max(-(2**31), min(prediction, 2**31 - 1))
            return
        k = measure.bit_length() - 1
        class_ = measure if measure < 2 else min(31, 2 * k + bit(measure, k - 1))
        escape = 1 << (class_ // 2 + 3)
        residual = self.stream.get(first + class_)
        if residual >= escape:
            residual += self.stream.get(BEYOND)
        residual = unzigzag(residual)
        self.sizes[x, y] = abs(residual)
        self.samples[at] = prediction + residual
        must(-(2**31) <= self.samples[at] < 2**31, "a height exceeds 32 bits")


def weights(line, m, s, end):
    """Pairs of an index coordinate and its weight."""
    near = [m - s, m + s]
    far = [m - 3 * s] if m >= 3 * s else []
    far += [m + 3 * s] if m + 3 * s < end else []
    is_far = lambda k: abs(line[k] - line[m]) >= 2 * abs(line[near[k > m]] - line[m])
    at = near + [k for k in far if is_far(k)]
    d = [line[k] - line[m] for k in at]
    shift = max(0, max(map(abs, d)).bit_length() - 16)
    d = [x >> shift for x in d]
    w = []
    for k, own in enumerate(d):
        others = d[:k] + d[k + 1 :]
        p, q = math.prod(-x for x in others), math.prod(own - x for x in others)
        p, q = (-p, -q) if q < 0 else (p, q)
        w.append((8192 * p + q) // (2 * q))
    w[0] += 4096 - sum(w)
    return list(zip(at, w))
