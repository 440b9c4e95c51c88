"""A whole file with a mesh: chapters 4 to 13, 20, 21, 23 and 24 together."""

from .ch02_conventions import must
from .ch04_header import (
    CHANNELS,
    CLUSTERS,
    GROUND,
    Header,
    INDEX,
    LEVELS,
    OBJECT_PAGES,
    OBJECTS,
    OVERVIEW,
    PAGES,
    PLACEMENT,
    read_sections,
    SCALES,
    SOURCE,
    TABLES,
    TEXELS,
)
from .ch06_overview import Overview
from .ch06_resident import check_levels, check_source, cut_parts, Levels, read_clusters, read_placement
from .ch07_entropy import read_tables, Stream
from .ch08_index import check_loops, check_tree, check_uses, IndexBlock
from .ch10_arcs import decode_corners, decode_samples, ends_of_arc
from .ch11_patches import FILLINGS, Patch, Side
from .ch12_irregular import IrregularBlock
from .ch13_grid import GridBlock
from .ch20_channels import Channels, read_texels
from .ch23_ground import Ground
from .ch24_objects import Objects

FILLINGS.update({0: IrregularBlock, 1: GridBlock})


class File:
    """Everything that a file holds."""

    def __init__(self, data):
        self.header = Header(data)
        sections = read_sections(data, self.header)
        if SOURCE in sections:
            check_source(sections[SOURCE])
        self.levels = Levels(sections[LEVELS], len(sections[PAGES]))
        self.tables = read_tables(sections[TABLES])
        self.clusters, parts = read_clusters(sections[CLUSTERS], sections[INDEX], len(self.levels.levels))
        check_levels(self.levels.levels, self.clusters, self.header.step_log2)

        top_count = self.clusters[0].children.start if self.clusters else 0
        self.index = [
            IndexBlock(part, cluster, top_count, self.levels, self.tables, self.header.step_log2)
            for part, cluster in zip(parts, self.clusters)
        ]
        self.roots = [root for index in self.index for root in index.roots]
        self.arcs = [arc for index in self.index for arc in index.arcs]
        self.corner_levels = [level for index in self.index for level in index.corner_levels]
        extent_of_root = [[b - a for a, b in zip(c.low, c.high)] for c in self.clusters for _ in c.roots]
        check_loops(self.roots, self.arcs, self.corner_levels)
        check_tree(self.roots, extent_of_root)
        check_uses(self.roots, top_count, self.arcs, self.corner_levels, len(self.levels.levels))
        self.overview = Overview(sections[OVERVIEW], self.tables) if OVERVIEW in sections else None
        self.placement = read_placement(sections[PLACEMENT]) if PLACEMENT in sections else None

        self.corners, self.patches = [], [{} for _ in self.roots]  # patches: of each root, by level
        for cluster, index in zip(self.clusters, self.index):
            self.corners += decode_corners(index.arc_stream, cluster)
        # arcs may end at corners of other clusters
        self.knots = [ends_of_arc(arc, self.corners) for arc in self.arcs]
        for cluster, index in zip(self.clusters, self.index):
            for l in range(self.levels.index_arc_levels):
                self.decode_arcs(l, cluster.arcs, index.arc_stream)
            index.arc_stream.end()
        states = [{} for _ in self.roots]  # what nested fillings carry from level to level
        for l, level in enumerate(self.levels.levels):
            page = sections[PAGES][level.page_offset : level.page_offset + level.page_bytes]
            self.decode_page(l, page, states)
        self.channels = Channels(sections[CHANNELS]) if CHANNELS in sections else None
        if SCALES in sections:
            self.channels.read_scales(sections[SCALES])
        self.texels = read_texels(sections[TEXELS], self.channels, self.index) if self.channels else None
        self.objects = None
        if OBJECTS in sections:
            self.objects = Objects(sections[OBJECTS], sections[OBJECT_PAGES], self.clusters, self.index, self.patches)
        self.ground = Ground(sections[GROUND], self.placement) if GROUND in sections else None

    def decode_arcs(self, l, numbers, stream):
        for a in numbers:
            count = self.arcs[a].new[l]
            if count > 0:
                self.knots[a] = decode_samples(stream, self.knots[a], l, count, self.levels.arc_tangent_shift)

    def decode_page(self, l, page, states):
        """The arc pages of all clusters, then their block pages."""
        arc_parts = [part for index in self.index for part in index.arc_parts[l]]
        block_parts = [part for index in self.index for part in index.block_parts[l]]
        streams = iter(cut_parts(page, arc_parts + block_parts, f"the pages of level {l}"))
        for index in self.index:
            for run in index.arc_runs if index.arc_parts[l] else []:
                stream = Stream(next(streams), self.tables)
                self.decode_arcs(l, run, stream)
                stream.end()
        for cluster, index in zip(self.clusters, self.index):
            self.decode_blocks(l, cluster, index, streams, states)

    def side(self, half, l):
        corner = self.arcs[half.arc].ends[half.reversed]
        return Side(half, self.knots[half.arc], l, self.corner_levels[corner])

    def decode_blocks(self, l, cluster, index, streams, states):
        stream = None
        for number, root in zip(cluster.roots, index.roots):
            block = root.blocks.get(l)
            if block is None:
                continue
            if block.begins:
                if stream is not None:
                    stream.end()
                stream = Stream(next(streams), self.tables)
            loops = [[self.side(half, l) for half in loop] for loop in root.loops]
            patch = Patch(loops, block.triangle_count)
            FILLINGS[root.filling](stream, patch, self.levels.steps[root.filling][l], states[number])
            patch.check()
            for point in patch.border + patch.interior:
                must(all(a <= x <= b for a, x, b in zip(root.low, point, root.high)), "a root leaves its box")
            self.patches[number][l] = patch
        if stream is not None:
            stream.end()
