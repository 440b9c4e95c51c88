"""Chapters 4 and 5: the header and the section directory."""

import zlib

from .ch02_conventions import Bytes, must


# ---- 4
# Header ------------------------------------------------------------------------------------------------------------

MAGIC = b"\x8fLOD\r\n\x1a\n"
HEADER_SIZE = 64
SECTION_SIZE = 32


class Header:
    def __init__(self, file):
        must(file[:8] == MAGIC[: len(file)] and len(file) >= 8, "this is no lodpack file")
        data = Bytes(file[8:HEADER_SIZE], "the header")
        major = data.number("H")
        must(major == 4, f"major version {major} is unknown")
        self.minor = data.number("H")  # a larger one only adds optional sections
        must(data.number("I") == 0, "flags of the header are not 0")
        self.origin = [data.number("d") for _ in range(3)]
        self.step_log2 = data.number("i")
        must(-256 <= self.step_log2 <= 256, "the lattice step is out of range")
        self.section_count = data.number("I")
        must(self.section_count <= 256, "there are more than 256 sections")
        must(data.number("Q") == HEADER_SIZE, "the directory is not at 64")
        self.directory_crc = data.number("I")
        must(data.number("I") == zlib.crc32(file[:0x3C]), "the header's checksum is wrong")


# ---- 5 Section
# directory -------------------------------------------------------------------------------------------------

SOURCE, LEVELS, TABLES, CLUSTERS, INDEX, PAGES, OVERVIEW, CHANNELS, TEXELS, PLACEMENT, HEIGHTS, HEIGHT_INDEX, RAMP, GROUND, SCALES, DRAPE, OBJECTS, OBJECT_PAGES = range(1, 19)
SECTION_FLAGS = {SOURCE: 0, LEVELS: 1, TABLES: 1, CLUSTERS: 1, INDEX: 3, PAGES: 3, OVERVIEW: 0, CHANNELS: 0, TEXELS: 2, PLACEMENT: 0}
SECTION_FLAGS |= {HEIGHTS: 1, HEIGHT_INDEX: 3, RAMP: 0, GROUND: 2, SCALES: 1, DRAPE: 2, OBJECTS: 0, OBJECT_PAGES: 2}
FIRST_PRIVATE_KIND = 0x80000000


def read_sections(file, header):
    """The bytes of every section, by kind."""
    size = SECTION_SIZE * header.section_count
    data = Bytes(Bytes(file[HEADER_SIZE:], "the directory").take(size), "the directory")
    must(zlib.crc32(data.data) == header.directory_crc, "the directory's checksum is wrong")
    sections, last_kind, end = {}, None, HEADER_SIZE + size
    for _ in range(header.section_count):
        kind, flags, offset, length = (data.number(code) for code in "IIQQ")
        checksum, reserved = data.number("I"), data.number("I")
        name = f"section {kind}"
        must(kind not in sections, f"{name} is there twice")
        must(flags < 4, f"{name} has unknown flags")
        must(kind in SECTION_FLAGS or not flags & 1, f"{name} is required but unknown")
        must(flags == SECTION_FLAGS.get(kind, flags), f"{name} has other flags than it must have")
        must(reserved == 0, f"reserved bytes of {name} are not 0")
        must(offset == end, f"{name} does not begin where the one before it ends")
        end += length
        must(end <= len(file), f"the file is truncated within {name}")
        sections[kind], last_kind = file[offset:end], kind
        must(checksum == (0 if flags & 2 else zlib.crc32(sections[kind])), f"the checksum of {name} is wrong")
    of_a_mesh = (LEVELS, CLUSTERS, INDEX)
    has_heights = HEIGHTS in sections
    must(has_heights == (HEIGHT_INDEX in sections), "HEIGHTS is there without HEIGHT_INDEX, or HEIGHT_INDEX without HEIGHTS")
    for kind in (TABLES, PAGES) + (() if has_heights else of_a_mesh):
        must(kind in sections, f"section {kind} is missing")
    must(has_heights or RAMP not in sections, "RAMP lies beside a mesh")
    must(has_heights or DRAPE not in sections, "DRAPE lies beside a mesh")
    must(DRAPE not in sections or header.minor >= 5, "a file of a version before 4.5 has an image over heights")
    must(not has_heights or GROUND not in sections, "GROUND lies beside heights")
    must(GROUND not in sections or header.minor >= 3, "a file of a version before 4.3 has a ground")
    must(not has_heights or header.minor >= 2, "a file of a version before 4.2 has heights")
    must(not has_heights or not any(kind in sections for kind in of_a_mesh + (CHANNELS,)), "heights lie beside a mesh")
    must(not has_heights or (header.origin, header.step_log2) == ([0.0] * 3, 0), "heights have a lattice")
    must((CHANNELS in sections) == (TEXELS in sections), "CHANNELS is there without TEXELS, or TEXELS without CHANNELS")
    must(CHANNELS not in sections or header.minor >= 1, "a file of version 4.0 has channels")
    must(SCALES not in sections or CHANNELS in sections, "SCALES is there without CHANNELS")
    must(SCALES not in sections or header.minor >= 4, "a file of a version before 4.4 has images in scales")
    must((OBJECTS in sections) == (OBJECT_PAGES in sections), "OBJECTS is there without OBJECT_PAGES, or OBJECT_PAGES without OBJECTS")
    must(OBJECTS not in sections or not has_heights, "a file of heights has objects")
    must(OBJECTS not in sections or header.minor >= 6, "a file of a version before 4.6 has objects")
    must(last_kind == PAGES, "PAGES is not the last section")
    must(end == len(file), "there are bytes after the last section")
    return sections
