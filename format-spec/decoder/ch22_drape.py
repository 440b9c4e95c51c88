"""Chapter 22.10: the image over a grid of heights."""

import zlib

from .ch02_conventions import Bytes, must
from .ch06_resident import read_part
from .ch21_scales import decode_scaled

HEAD_SIZE, MOST_TEXELS = 68, 2**30


class Drape:
    """The image: for each level its tiles by column and row, each with its four streams, or None."""

    def __init__(self, section):
        head = Bytes(section[:HEAD_SIZE], "the head of DRAPE")
        covered = head.data[: HEAD_SIZE - 4]
        self.size = [head.number("Q"), head.number("Q")]
        self.numbers = [head.number("d") for _ in range(4)]
        self.components, self.side_log2 = head.number("B"), head.number("B")
        must(head.take(6) == bytes(6), "reserved bytes of DRAPE are not 0")
        length, crc = head.number("I"), head.number("I")
        must(head.number("I") == zlib.crc32(covered), "the checksum of the head of DRAPE is wrong")
        must(all(1 <= x <= MOST_TEXELS for x in self.size), "the image over the heights has no texels, or too many")
        must(all(abs(x) < 1e15 for x in self.numbers), "a number of DRAPE is out of range")
        must(all(x >= 1e-15 for x in self.numbers[2:]), "texels of DRAPE have no size")
        must(self.components in (3, 4) and 3 <= self.side_log2 <= 11, "DRAPE has other components or tiles")
        must(length or (crc == 0 and self.components == 4), "an image without opacity has a gap, or nothing a checksum")
        self.side = 2**self.side_log2
        count = 1
        while max(self.size_at(3 * (count - 1))) > self.side:
            count += 1
        self.levels = [{} for _ in range(count)]
        self.read(Bytes(section[HEAD_SIZE:], "DRAPE"), length, crc)

    def size_at(self, halvings):
        return [-(-x // 2**halvings) for x in self.size]

    def tiles(self, level, column, row):
        """The tiles of a level below the tile of the next one in this column and row."""
        columns, rows = (-(-x // self.side) for x in self.size_at(3 * level))
        for j in range(8 * row, min(8 * row + 8, rows)):
            for i in range(8 * column, min(8 * column + 8, columns)):
                yield i, j

    def read(self, data, length, crc):
        waiting, groups = [(len(self.levels) - 1, 0, 0, length, crc)] if length else [], []
        for level, column, row, length, crc in waiting:  # which grows
            bytes_ = data.take(length)
            must(zlib.crc32(bytes_) == crc, "the checksum of a directory of images is wrong")
            directory, tiles = Bytes(bytes_, "a directory of images"), list(self.tiles(level, column, row))
            first_stream, first_below = directory.number("Q"), directory.number("Q")
            scales = [[read_part(directory) for _ in tiles] for _ in range(4)]
            below = [read_part(directory) for _ in tiles] if level else []
            directory.end()
            for k, streams in enumerate(zip(*scales)):
                has_image = streams[0].length > 0
                must(has_image or not any(s.length for s in streams), "an image has a scale without the first one")
                must(has_image or self.components == 4, "an image without opacity has a gap")
                must(not below or has_image == (below[k].length > 0), "an image and those below it do not come together")
            groups.append((level, tiles, scales, first_stream, first_below))
            waiting += [(level - 1, i, j, p.length, p.crc) for (i, j), p in zip(tiles, below) if p.length]
        # Directories lie in the order in which they are mentioned, and so do the streams behind them.
        at, sizes = HEAD_SIZE, iter(waiting)
        at += next(sizes, (0, 0, 0, 0))[3]
        for level, tiles, _, _, first_below in groups:
            below = [size for l, i, j, size, _ in waiting if l == level - 1 and (i, j) in tiles]
            must(first_below == (at if below else 0), "directories of images are not where it is said")
            at += sum(below)
        for level, tiles, scales, first_stream, _ in groups:
            must(first_stream == HEAD_SIZE + data.at, "images are not where their directory says")
            streams = [[self.stream(data, part) for part in parts] for parts in scales]
            for tile, own in zip(tiles, zip(*streams)):
                self.levels[level][tile] = own if own[0] else None
        data.end()

    def stream(self, data, part):
        coded = data.take(part.length)
        must(not coded or zlib.crc32(coded) == part.crc, "the checksum of an image is wrong")
        return coded

    def image(self, halvings):
        """All texels of the image halved so often; what no tile shows is 0."""
        width, height = self.size_at(halvings)
        level = min(halvings // 3, len(self.levels) - 1)
        s = 3 - (halvings - 3 * level)
        whole, side = self.size_at(3 * level), self.side * 2**s // 8
        rows = [[(0,) * self.components] * width for _ in range(height)]
        for (i, j), streams in self.levels[level].items():
            if streams is None:
                continue
            size = (min(self.side, whole[k] - self.side * (i, j)[k]) for k in (0, 1))
            for y, row in enumerate(decode_scaled(list(streams[: s + 1]), *size, self.components)):
                for x, texel in enumerate(row):
                    if texel is not None:
                        rows[side * j + y][side * i + x] = texel
        return rows
