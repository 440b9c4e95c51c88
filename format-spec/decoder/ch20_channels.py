"""Chapter 20: the sections CHANNELS, SCALES and TEXELS."""

import zlib
from collections import namedtuple

from .ch02_conventions import Bytes, Damaged, must
from .ch06_resident import read_part


# ---- 20.1 Section
# CHANNELS -----------------------------------------------------------------------------------------------

Channel = namedtuple("Channel", "name kind components low step bound")
KINDS = {1: "colour", 2: "scalar", 3: "normal", 4: "label", 5: "factor", 6: "drawing"}
KINDS |= {7: "exact colour", 8: "exact normal", 9: "exact factor"}
COLOURS, NORMALS = (1, 7), (3, 8)
CODED_AS_COLOURS, CODED_EXACTLY = (1, 3, 5), (7, 8, 9)


class Channels:
    def __init__(self, section):
        data = Bytes(section, "CHANNELS")
        count = data.varint()
        must(1 <= count <= 64, "there are not 1 to 64 channels")
        self.channels, self.stream_bytes = [], [data.varint()]  # the latter: of maps, then of the images of each channel
        for _ in range(count):
            try:
                name = data.take(data.varint()).decode("utf-8")
            except UnicodeDecodeError:
                raise Damaged("the name of a channel is not UTF-8") from None
            must(1 <= len(name.encode("utf-8")) <= 255, "the name of a channel does not have 1 to 255 bytes")
            must(not any(c < " " or "\x7f" <= c <= "\x9f" for c in name), "the name of a channel has control characters")
            must(name not in [c.name for c in self.channels], "two channels have the same name")
            channel = Channel(name, *(data.number(code) for code in "BBddd"))
            must(1 <= channel.components <= 4, "a channel does not have 1 to 4 components")
            must(channel.kind not in COLOURS or channel.components >= 3, "a colour does not have 3 or 4 components")
            must(channel.kind not in NORMALS or channel.components == 2, "a normal does not have two components")
            must(channel.kind != 6 or channel.components == 1, "a drawing does not have one component")
            must(channel.kind != 6 or (channel.low, channel.step) == (0, 1), "drawings do not count from 0 in steps of 1")
            must(channel.kind != 6 or 6 not in [c.kind for c in self.channels], "two channels say how the surface is drawn")
            must(channel.step > 0, "the step of a channel is not above 0")
            must(channel.bound >= 0, "the bound of a channel is negative")
            self.channels.append(channel)
            self.stream_bytes.append(data.varint())
        data.end()
        self.scales = [1] * count  # into how many streams an image is divided (20.3)

    def read_scales(self, section):
        must(len(section) == len(self.channels), "SCALES does not have a byte for each channel")
        must(set(section) <= {1, 4} and 4 in section, "SCALES says neither 1 nor 4, or never 4")
        for channel, count in zip(self.channels, section):
            must(count == 1 or channel.kind in CODED_AS_COLOURS, "a channel of such a kind is not in scales")
        self.scales = list(section)

    def streams(self):
        """For each stream of a block the number of its size in `stream_bytes`."""
        return [0] + [1 + c for c, count in enumerate(self.scales) for _ in range(count)]

    def divided(self, streams):
        """The streams of each channel's image, of those of a block."""
        firsts = [1 + sum(self.scales[:c]) for c in range(len(self.scales))]
        return [streams[first : first + count] for first, count in zip(firsts, self.scales)]


# ---- 20.2 Section
# TEXELS -------------------------------------------------------------------------------------------------

CHUNK_CLUSTERS = 256


def read_texels(section, channels, index):
    """The texel streams of all blocks: by root a dictionary of lists, by level."""
    streams = channels.streams()
    entries, ends = read_texel_table(section, len(index))
    texels, sums = [], [0] * len(channels.stream_bytes)
    data = Bytes(section, "TEXELS")
    data.take(16 * len(index) + 12 * -(-len(index) // CHUNK_CLUSTERS))
    for block, (offset, length, crc), end in zip(index, entries, ends):
        must(offset == data.at, "the texels of a cluster do not begin where those before end")
        directory = Bytes(data.take(length), "a texel directory")
        must(crc == (zlib.crc32(directory.data) if length > 0 else 0), "the checksum of a texel directory is wrong")
        keys = sorted((l, k) for k, root in enumerate(block.roots) for l in root.blocks)
        of_cluster = [{l: [b""] * len(streams) for l in root.blocks} for root in block.roots]
        places = [(l, k, number) for l, k in keys for number in range(len(streams))]
        if 4 in channels.scales:
            places.sort(key=lambda place: (place[0], place[2], place[1]))
        parts = [(place, read_part(directory)) for place in places] if length > 0 else []
        directory.end()
        for (l, k, number), part in parts:
            stream = of_cluster[k][l][number] = data.take(part.length)
            must(part.length == 0 or zlib.crc32(stream) == part.crc, "the checksum of a texel stream is wrong")
            sums[streams[number]] += part.length
        must(data.at == end, "the texels of a cluster do not have the size that the table gives")
        must(length == 0 or end > offset + length, "a texel directory has only empty streams")
        texels += of_cluster
    data.end()
    must(sums == channels.stream_bytes, "the texels do not have the sizes that CHANNELS gives")
    return texels


def read_texel_table(section, cluster_count):
    """Offset, length and checksum of each directory, and where the texels of each cluster end."""
    data, entries, ends = Bytes(section, "the texel table"), [], []
    for first in range(0, cluster_count, CHUNK_CLUSTERS):
        start = data.at
        of_chunk = [(data.number("Q"), data.number("I"), data.number("I")) for _ in range(min(CHUNK_CLUSTERS, cluster_count - first))]
        end = data.number("Q")
        chunk = data.data[start : data.at]
        must(data.number("I") == zlib.crc32(chunk), "the checksum of a chunk of the texel table is wrong")
        entries += of_chunk
        ends += [offset for offset, _, _ in of_chunk[1:]] + [end]
    return entries, ends
