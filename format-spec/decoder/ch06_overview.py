"""Chapter 6.4: section OVERVIEW, which holds a block as chapter 12 has them."""

from .ch02_conventions import Bytes, must, on_lattice, unzigzag
from .ch07_entropy import Stream
from .ch11_patches import Patch, read_steps
from .ch12_irregular import IrregularBlock


class Overview:
    """One small patch of everything; its border belongs to no arc."""

    def __init__(self, section, tables):
        data = Bytes(section, "OVERVIEW")
        self.error = data.number("H")
        steps = read_steps(data)
        patch = Patch([], data.number("I"))
        self.loops, last = [], (0, 0, 0)
        for _ in range(data.varint()):
            count = data.varint()
            must(count >= 3, "a loop of OVERVIEW has less than three vertices")
            loop = []
            for _ in range(count):
                last = on_lattice(tuple(x + unzigzag(data.varint()) * 2**steps.normal_shift for x in last))
                loop.append(last)
            self.loops.append(loop)
        patch.loop_sizes = [len(loop) for loop in self.loops]
        patch.border = [p for loop in self.loops for p in loop]
        stream = Stream(data.take(len(section) - data.at), tables)
        IrregularBlock(stream, patch, steps, {})
        stream.end()
        patch.check()
        self.patch = patch
