//! One broken rule each.

use super::Symbol::{self, Bit, Number, Signed};
use super::symbols::{CONTEXT_COUNT, contexts, flat_table_numbers};
use super::{
    BOX_SIZE, CHANNELS, CHILD_CHILDREN, CHILD_HALF_ARCS, CHILD_TRIANGLES, CHILDREN, CLUSTERS, COARSE_ERROR, Container,
    DRAPE, FINE_BEGINS, FIRST_ARC, FIRST_ARC_SAMPLES, FIRST_CORNER_LEVEL, GROUND, HALF_ARC_COUNT, HALF_ARCS, Handmade,
    HandmadeChannel, HandmadeObjects, HandmadeTexels, INDEX, LAST_ARC, LEVEL_SET, LEVELS, OBJECT_PAGES, OBJECTS, PAGES,
    PLACEMENT, ROOT, SCALES, SECOND_CORNER_LEVEL, Section, TABLES, TEXELS, coded, ground, pack_bits,
};

/// A file that must be refused.
#[derive(Clone, Debug)]
pub struct Fault {
    /// Name of the file, without its ending.
    pub name: &'static str,
    /// What is wrong, and the chapter of SPEC.md that says so.
    pub what: &'static str,
    /// The file.
    pub bytes: Vec<u8>,
}

/// All faults, mostly in the order of SPEC.md. Checksums are sound except where these are the fault.
pub fn faults() -> Vec<Fault> {
    let whole = bytes_faults().into_iter().map(|(name, what, edit)| {
        let mut bytes = Handmade::example().container().bytes();
        edit(&mut bytes);
        Fault { name, what, bytes }
    });
    let sections = section_faults().into_iter().map(|(name, what, edit)| {
        let mut container = Handmade::example().container();
        edit(&mut container);
        Fault { name, what, bytes: container.bytes() }
    });
    let tables = table_faults().into_iter().map(|(name, what, edit)| {
        let (mut container, mut numbers) = (Handmade::example().container(), flat_table_numbers(CONTEXT_COUNT));
        edit(&mut numbers);
        container.section(TABLES).content = pack_bits(&numbers);
        Fault { name, what, bytes: container.bytes() }
    });
    let symbols = symbol_faults().into_iter().map(|(name, what, edit)| {
        let mut file = Handmade::example();
        edit(&mut file);
        Fault { name, what, bytes: file.container().bytes() }
    });
    let grids = grid_faults().into_iter().map(|(name, what, edit)| {
        let mut file = Handmade::grid();
        edit(&mut file);
        Fault { name, what, bytes: file.container().bytes() }
    });
    let trees = tree_faults().into_iter().map(|(name, what, edit)| {
        let mut file = Handmade::tree();
        edit(&mut file);
        Fault { name, what, bytes: file.container().bytes() }
    });
    let lists = list_faults().into_iter().map(|(name, what, edit)| {
        let mut file = Handmade::listed(&[1]);
        edit(&mut file);
        Fault { name, what, bytes: file.container().bytes() }
    });
    let with_channels = channel_section_faults().into_iter().map(|(name, what, edit)| {
        let mut container = HandmadeTexels::example().put_into(Handmade::example().container());
        edit(&mut container);
        Fault { name, what, bytes: container.bytes() }
    });
    let drawn = drawing_faults().into_iter().map(|(name, what, edit)| {
        let mut texels = HandmadeTexels::drawn();
        edit(&mut texels);
        Fault { name, what, bytes: texels.put_into(Handmade::example().container()).bytes() }
    });
    let channels = channel_faults().into_iter().map(|(name, what, edit)| {
        let mut texels = HandmadeTexels::example();
        edit(&mut texels);
        Fault { name, what, bytes: texels.put_into(Handmade::example().container()).bytes() }
    });
    let grounded = ground_faults().into_iter().map(|(name, what, edit)| {
        let mut container = ground::grounded();
        edit(&mut container);
        Fault { name, what, bytes: container.bytes() }
    });
    let geometry = whole.chain(sections).chain(tables).chain(lists).chain(symbols).chain(trees).chain(grids);
    let scaled = scale_faults().into_iter().map(|(name, what, edit)| {
        let mut container = HandmadeTexels::scaled().put_into(Handmade::example().container());
        edit(&mut container);
        Fault { name, what, bytes: container.bytes() }
    });
    let draped = drape_faults().into_iter().map(|(name, what, edit)| {
        let mut container = ground::draped();
        edit(&mut container);
        Fault { name, what, bytes: container.bytes() }
    });
    let named = object_faults().into_iter().map(|(name, what, edit)| {
        let mut objects = HandmadeObjects::example();
        edit(&mut objects);
        Fault { name, what, bytes: objects.put_into(Handmade::example().container()).bytes() }
    });
    let object_sections = object_section_faults().into_iter().map(|(name, what, edit)| {
        let mut container = HandmadeObjects::example().put_into(Handmade::example().container());
        edit(&mut container);
        Fault { name, what, bytes: container.bytes() }
    });
    let all = geometry.chain(with_channels).chain(channels).chain(drawn).chain(scaled).chain(grounded).chain(draped);
    all.chain(object_sections).chain(named).collect()
}

type Edit<T> = (&'static str, &'static str, fn(&mut T));

fn bytes_faults() -> Vec<Edit<Vec<u8>>> {
    vec![
        ("empty", "no bytes (4)", |b| b.clear()),
        ("header_cut", "the file ends within the header (4)", |b| b.truncate(40)),
        ("magic_as_text", "CR LF has become LF (4)", |b| {
            b.remove(4);
        }),
        ("header_checksum", "a bit of the origin is flipped (4)", |b| b[0x12] ^= 1),
        ("directory_checksum", "a bit of a section's length is flipped (4)", |b| b[0x50] ^= 1),
        ("directory_cut", "the file ends within the directory (5)", |b| b.truncate(100)),
        ("pages_cut", "the last byte is missing (5)", |b| {
            b.pop();
        }),
        ("bytes_after_end", "a byte follows the last section (5)", |b| b.push(0)),
    ]
}

fn overview(flags: u32, content: &[u8]) -> Section {
    Section { kind: 7, flags, content: content.to_vec(), reserved: 0 }
}

fn placement(edit: fn(&mut Vec<u8>)) -> Section {
    let mut section = super::placement();
    edit(&mut section.content);
    section
}

fn section_faults() -> Vec<Edit<Container>> {
    vec![
        ("newer_version", "major version 5 (4)", |c| c.version[0] = 5),
        ("older_version", "major version 3 (4)", |c| c.version[0] = 3),
        ("header_flags", "a reserved flag of the header is set (4)", |c| c.flags = 1),
        ("origin_not_a_number", "the origin is not finite (4)", |c| c.origin[1] = f64::NAN),
        ("step_out_of_range", "step log2 is 257 (4)", |c| c.step_log2 = 257),
        ("directory_elsewhere", "the directory is not at 64 (4)", |c| c.directory_offset = 96),
        ("unknown_required_section", "an unknown section of kind 99 is required (5)", |c| {
            c.sections.insert(0, Section { kind: 99, flags: 1, content: vec![1, 2, 3], reserved: 0 });
        }),
        ("section_twice", "the section LEVELS occurs twice (5)", |c| c.sections.insert(0, c.sections[0].clone())),
        ("section_missing", "the section TABLES is missing (5)", |c| c.sections.retain(|s| s.kind != TABLES)),
        ("section_order", "PAGES is not the last section (5)", |c| c.sections.swap(3, 4)),
        ("section_flag_unknown", "an unknown flag of an optional section is set (5)", |c| {
            c.sections.insert(0, Section { kind: 0x8000_0000, flags: 4, content: vec![], reserved: 0 });
        }),
        ("section_flags", "the section TABLES is not marked as required (5)", |c| c.section(TABLES).flags = 0),
        ("overview_shift", "the normal shift of the overview is 41 (6.4)", |c| {
            c.sections.insert(0, overview(0, &[0, 0, 41, 0, 0, 0, 0, 0, 0]));
        }),
        ("overview_loop", "a loop of the overview has two vertices (6.4)", |c| {
            c.sections.insert(0, overview(0, &[0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 0, 0, 0, 2, 2, 2]));
        }),
        ("overview_far", "a border vertex of the overview lies outside the lattice (6.4)", |c| {
            c.sections.insert(0, overview(0, &[0, 0, 40, 0, 1, 0, 0, 0, 1, 3, 4, 0, 0, 0, 2, 0, 0, 0, 2]));
        }),
        ("overview_triangles", "the overview claims to have a triangle, but has none (6.4)", |c| {
            c.sections.insert(0, overview(0, &[0, 0, 0, 0, 1, 0, 0, 0, 0]));
        }),
        ("placement_axis", "the up axis of the placement is 3 (6.5)", |c| {
            c.sections.insert(0, placement(|b| b[0] = 3))
        }),
        ("placement_reserved", "a reserved byte of the placement is not 0 (6.5)", |c| {
            c.sections.insert(0, placement(|b| b[5] = 1));
        }),
        ("placement_unit", "the unit of the placement is negative (6.5)", |c| {
            c.sections.insert(0, placement(|b| b[8..16].copy_from_slice(&(-1.0_f64).to_le_bytes())));
        }),
        ("placement_origin", "the origin of the placement is not finite (6.5)", |c| {
            c.sections.insert(0, placement(|b| b[24..32].copy_from_slice(&f64::INFINITY.to_le_bytes())));
        }),
        ("placement_text", "the CRS of the placement is not UTF-8 (6.5)", |c| {
            c.sections.insert(0, placement(|b| b[42] = 0xFF));
        }),
        ("placement_short", "the placement ends within its origin (6.5)", |c| {
            c.sections.insert(0, placement(|b| b.truncate(39)));
        }),
        ("section_reserved", "reserved bytes of a section are not 0 (5)", |c| c.section(INDEX).reserved = 1),
        ("section_gap", "there are bytes between two sections (5)", |c| c.gap = 4),
        ("level_count_zero", "there are no levels (6.2)", |c| c.section(LEVELS).content[0] = 0),
        ("arc_shift", "the arc tangent shift is 41 (6.2)", |c| c.section(LEVELS).content[1] = 41),
        ("index_arc_levels_zero", "index blocks hold the arc samples of no level (6.2)", |c| {
            c.section(LEVELS).content[2] = 0;
        }),
        ("index_arc_levels", "index blocks hold the arc samples of 3 of 2 levels (6.2)", |c| {
            c.section(LEVELS).content[2] = 3;
        }),
        ("levels_reserved", "a reserved byte of LEVELS is not 0 (6.2)", |c| c.section(LEVELS).content[6] = 1),
        ("arc_run_samples", "arc runs end with 0 samples (6.2)", |c| {
            c.section(LEVELS).content[4..6].copy_from_slice(&[0; 2]);
        }),
        ("tolerance_grows", "level 1 has a larger tolerance than level 0 (6.2)", |c| {
            c.section(LEVELS).content[48..56].copy_from_slice(&0.5_f64.to_le_bytes());
        }),
        ("tolerance_negative", "a tolerance is negative (6.2)", |c| {
            c.section(LEVELS).content[48..56].copy_from_slice(&(-0.5_f64).to_le_bytes());
        }),
        ("level_error", "the max error of level 1 is not that of its cluster (6.2)", |c| {
            c.section(LEVELS).content[56..64].copy_from_slice(&0.03125_f64.to_le_bytes());
        }),
        ("level_triangles", "the triangle count of level 1 is not that of its cluster (6.2)", |c| {
            c.section(LEVELS).content[64] += 1;
        }),
        ("level_pages_overlap", "the pages of level 1 begin before those of level 0 end (6.2)", |c| {
            c.section(LEVELS).content[72] -= 1;
        }),
        ("filling_unknown", "LEVELS lists filling 32767 (6.2)", |c| {
            // The last code that is not for private use, so a further filling hardly gets it.
            c.section(LEVELS).content[88..90].copy_from_slice(&0x7fff_u16.to_le_bytes());
        }),
        ("filling_twice", "LEVELS lists a filling twice (6.2)", |c| {
            let levels = &mut c.section(LEVELS).content;
            levels[3] = 2;
            levels.extend_from_within(88..);
        }),
        ("filling_parameters", "a filling has a byte of parameters too many (6.2)", |c| {
            let levels = &mut c.section(LEVELS).content;
            levels[90] += 1;
            levels.push(0);
        }),
        ("filling_shift", "the tangent shift of a filling is 41 (6.2)", |c| c.section(LEVELS).content[93] = 41),
        ("filling_missing", "a root has a filling, but LEVELS lists none (8.1)", |c| {
            let levels = &mut c.section(LEVELS).content;
            levels[3] = 0;
            levels.truncate(88);
        }),
        ("levels_longer", "bytes follow the last filling (6.2)", |c| c.section(LEVELS).content.push(0)),
        ("varint_long_form", "the root count 1 takes two bytes (2.1)", |c| {
            c.section(CLUSTERS).content.splice(0..1, [0x81, 0]);
        }),
        ("clusters_longer", "bytes follow the last cluster (6.3)", |c| c.section(CLUSTERS).content.push(0)),
        ("index_checksum", "a bit of an index block is flipped (6.3)", |c| c.section(INDEX).content[6] ^= 1),
        ("page_checksum", "a bit of a page is flipped (6.3)", |c| c.section(PAGES).content[20] ^= 0x80),
        ("list_checksum", "a bit of a list is flipped (6.3)", |c| {
            *c = Handmade::listed(&[1]).container();
            c.section(INDEX).content[3] ^= 1;
        }),
        ("index_longer", "a byte follows the last index block (6.3)", |c| c.section(INDEX).content.push(0)),
    ]
}

fn table_faults() -> Vec<Edit<Vec<(u64, u32)>>> {
    vec![
        ("table_code_unknown", "a frequency has code 15 (7.3)", |n| n[2] = (15, 4)),
        ("table_two_rests", "two tokens take the rest (7.3)", |n| {
            n.splice(2..4, [(13, 4)]);
        }),
        ("table_no_rest", "no token takes the rest (7.3)", |n| n[512] = (5, 4 + 3)),
        ("table_sum", "frequencies add up to more than 4096 (7.3)", |n| n[2] = (12, 4)),
        ("table_run", "a run of absent tokens ends at 257 (7.3)", |n| {
            // After the last token.
            n.splice(513..513, [(0, 4), (1, 1)]);
        }),
        ("table_unused", "no context uses the second table (7.3)", |n| {
            let used = n.len() - CONTEXT_COUNT as usize;
            // Now each context says which of two tables it uses.
            let second: Vec<_> = n.split_off(used).into_iter().flat_map(|gap| [gap, (0, 1)]).collect();
            n.splice(514..514, [(13, 4), (14, 4)]);
            n.extend(second);
            n[0] = (2, 2);
            n[1] = (1, 1);
        }),
        ("context_without_table", "symbols have contexts without a table (7.3)", |n| {
            n.truncate(514);
            n.extend(contexts(100));
        }),
        ("context_beyond_limit", "a context is above 4095 (7.3)", |n| {
            // The last one is 4095 above the one before.
            n.pop();
            n.extend([(1 << 11, 12), (4095 - (1 << 11), 11)]);
        }),
        ("tables_padding", "TABLES does not end with zero bits (7.3)", |n| n.push((1, 1))),
        ("tables_longer", "a byte follows TABLES (7.3)", |n| n.push((0, 16))),
    ]
}

fn list_faults() -> Vec<Edit<Handmade>> {
    vec![
        ("list_height", "a list of height 1 says that it has height 2 (6.3)", |f| f.lists[0].height = 2),
        ("list_height_zero", "a cluster has no roots, or a list has height 0 (6.3)", |f| f.lists[0].height = 0),
        ("list_height_200", "a list has height 200 (6.3)", |f| f.lists[0].height = 200),
        ("list_in_itself", "a list of height 1 is in a list of height 1 (6.3)", |f| *f = Handmade::listed(&[1, 1])),
        ("list_too_deep", "nine lists lie one below another (6.3)", |f| {
            *f = Handmade::listed(&[9, 8, 7, 6, 5, 4, 3, 2, 1]);
        }),
        ("list_without_entries", "a list says that it has no entries, and has one (6.3)", |f| f.lists[0].entries = 0),
        ("list_short", "a list ends before its last entry (6.3)", |f| f.lists[0].entries = 2),
        ("list_longer", "a byte follows the last entry of a list (6.3)", |f| f.lists[0].excess = vec![0]),
        ("list_clusters", "a list has fewer clusters than its entry says (6.3)", |f| f.lists[0].clusters = 2),
        ("list_arcs", "a list has more arcs than its entry says (6.3)", |f| {
            (f.lists[0].counts[1], f.totals[1]) = (2, 2);
        }),
        ("list_children", "a list has fewer children than its entry says (6.3)", |f| {
            *f = Handmade { lists: f.lists.clone(), ..Handmade::tree() };
            f.lists[0].counts = [2, 3, 3, 0];
        }),
        ("list_box", "the box of a list is larger than that of its clusters (6.3)", |f| f.lists[0].extent[2] += 1),
        ("list_below", "there is less below a list than its entry says (6.3)", |f| f.lists[0].below_excess = 1),
    ]
}

fn symbol_faults() -> Vec<Edit<Handmade>> {
    vec![
        ("totals", "the clusters have fewer corners than the file (6.3)", |f| f.totals[2] = 4),
        ("cluster_of_33_roots", "a cluster has 33 roots (6.3)", |f| (f.totals[0], f.counts[0]) = (33, 33)),
        ("cluster_box", "a cluster's box reaches beyond 2^41 (6.3)", |f| f.extent[0] = 1 << 42),
        ("cluster_error", "the max error of a cluster is not that of its roots (6.3)", |f| {
            f.levels[1].error = (14592, 0.03125)
        }),
        ("stream_odd", "a stream has an odd size (7.4)", |f| f.arc_excess = vec![0]),
        ("stream_longer", "a stream has a word that no symbol reads (7.4)", |f| f.arc_excess = vec![0; 2]),
        ("stream_state", "a stream begins with a state below 65536 (7.4)", |f| {
            f.levels[1].arcs = vec![];
            f.arc_excess = vec![0xff, 0xff, 0, 0, 1, 0];
        }),
        ("stream_short", "a stream ends before its last symbol (7.4)", |f| f.levels[1].arcs.truncate(2)),
        ("symbols_left", "a symbol follows the last block of a stream (7.4)", |f| f.levels[0].blocks.push(7)),
        ("stream_sizes", "the block pages do not add up to their size in the cluster (8)", |f| f.part_excess[1] = 1),
        ("arc_stream_sizes", "the arc pages do not add up to their size in the cluster (8)", |f| f.part_excess[0] = 1),
        ("loop_of_one", "a loop has one half-arc (8.1)", |f| f.records[HALF_ARC_COUNT] = 1),
        ("arc_before_first", "a half-arc uses arc -1 (8.1)", |f| f.records[HALF_ARCS + 2] = 2 * 3),
        ("arc_not_used", "the cluster has an arc that no root uses (8.1)", |f| {
            (f.totals[1], f.counts[1]) = (4, 4);
            f.records.extend([1, 2, 0, 0]);
        }),
        ("loop_open", "a half-arc does not begin where the one before it ends (8.1)", |f| f.records[HALF_ARCS + 2] = 1),
        ("arc_three_times", "three half-arcs use one arc (8.1)", |f| {
            // There and back between two corners, and once more there.
            f.records[HALF_ARC_COUNT] = 5;
            f.records.splice(HALF_ARCS..HALF_ARCS + 3, [0, 3, 2, 0, 0]);
        }),
        ("box_beyond_cluster", "a root's box is larger than its cluster's (8.1)", |f| f.records[BOX_SIZE] = 256),
        ("level_unknown", "a root has a block at level 2 of 2 (8.1)", |f| f.records[LEVEL_SET] = 7),
        ("level_none", "a root has no block (8.1)", |f| f.records[LEVEL_SET] = 0),
        ("error_code_large", "an error code is above 65535 (8.1)", |f| f.records[COARSE_ERROR] = 200_001),
        ("begins_no_stream", "the first block of a level does not begin a stream (8.1)", |f| {
            f.records[FINE_BEGINS] = 0
        }),
        ("begins_flag", "the flag for a new stream is 2 (8.1)", |f| f.records[FINE_BEGINS] = 2),
        ("arc_end_missing", "an arc ends at corner -1 (8.1)", |f| f.records[LAST_ARC + 1] = 4),
        ("arc_ends_equal", "an arc ends where it begins (8.1)", |f| f.records[LAST_ARC + 1] = 1),
        ("corner_not_used", "a cluster has a corner that no arc uses (8.1)", |f| (f.totals[2], f.counts[2]) = (4, 4)),
        ("corner_level", "a corner is a vertex from level 2 of 2 on (8.1)", |f| f.records[FIRST_CORNER_LEVEL] = 2),
        ("loop_begins_between", "a loop begins with a corner that is no vertex at level 0 (8.1)", |f| {
            f.records[FIRST_CORNER_LEVEL] = 1;
            // In its place, the border of level 0 has the sample of level 1.
            f.records[FIRST_ARC_SAMPLES..][..2].copy_from_slice(&[1, 0]);
            f.corners.append(&mut f.levels[1].arcs);
        }),
        ("corner_between_three", "at a corner that is no vertex at level 0, three arcs end (8.1)", |f| {
            // The loop leads from corner 1 to corner 2 and back.
            (f.totals, f.counts) = ([1, 4, 4], [1, 4, 4, 0]);
            f.corners = [[2, 18, 2], [128, 0, 0], [95, 32, 0], [31, 96, 0]].concat();
            f.records.truncate(FIRST_ARC);
            f.records
                .extend([[0, 0, 0, 1, 0, 1].as_slice(), &[1, 0, 0, 0, 0], &[2, 0, 0, 0, 0], &[1, 4, 0, 0]].concat());
            f.records.splice(HALF_ARC_COUNT..HALF_ARCS + 3, [5, 0, 0, 3, 0, 0]);
            f.levels[1].blocks = vec![0, 1, 1, 1, 1];
        }),
        ("samples_too_many", "an arc has 65536 samples (8.1)", |f| f.records[FIRST_ARC_SAMPLES + 1] = 65536),
        ("corner_beyond_lattice", "a corner lies beyond 2^40 (10.1)", |f| f.corners[0] = 1 << 42),
        ("split_flag", "a split flag is 2 (10.2)", |f| f.levels[1].arcs[0] = 2),
        ("samples_missing", "an arc has fewer samples than the index says (10.2)", |f| {
            f.records[FIRST_ARC_SAMPLES + 1] = 2;
            f.levels[1].arcs.extend([0; 2]);
        }),
        ("sample_beyond_lattice", "a sample lies beyond 2^40 (10.2)", |f| f.levels[1].arcs[1] = 1 << 43),
        ("sample_beyond_box", "a sample lies outside its root's box (8.1)", |f| f.levels[1].arcs[1] = 199),
        ("triangle_count", "the triangle count of a patch differs from the index (11.1)", |f| {
            f.set_fine_triangles(5);
        }),
        ("border_edge_twice", "a border edge is in two triangles (11.1)", |f| {
            // Back to the gate with a triangle behind the first one, then all the rest.
            f.levels[1].blocks = vec![0, 0, 26, 11, 20, 2, 1, 1];
        }),
        ("operation_unknown", "an operation is 5 (12.1)", |f| f.levels[0].blocks[1] = 5),
        ("split_too_far", "a Split reaches around its loop (12.1)", |f| {
            f.levels[1].blocks = vec![0, 3, 0, 1, 1];
        }),
        ("union_with_nothing", "a Union names a loop that is not there (12.1)", |f| {
            f.levels[1].blocks = vec![0, 4, 0, 0];
        }),
        ("seed_beyond_count", "a component without border has more triangles than the index says (11.1)", |f| {
            f.levels[0].blocks = vec![4, 1, 2, 2, 0, 2, 0, 0, 0, 2, 0, 1];
        }),
        ("vertex_beyond_lattice", "an interior vertex lies beyond 2^40 (12.2)", |f| f.levels[1].blocks[2] = 1 << 45),
    ]
}

fn tree_faults() -> Vec<Edit<Handmade>> {
    vec![
        ("no_top", "every root is a child (6.3)", |f| {
            (f.counts[3], f.records[CHILD_CHILDREN]) = (2, 1);
        }),
        ("children_too_many", "a cluster and its first root have 2^31 children (6.3)", |f| {
            (f.counts[3], f.records[CHILDREN]) = (1 << 31, 1 << 31);
        }),
        ("children_of_nobody", "a cluster has a child, but none of its roots has (8.1)", |f| f.records[CHILDREN] = 0),
        ("children_beyond_count", "a cluster has a child, but its roots have 2^32 more (8.1)", |f| {
            f.records[CHILD_CHILDREN] = 1 << 32;
        }),
        ("child_of_itself", "a root is its own child (8.1)", |f| {
            (f.records[CHILDREN], f.records[CHILD_CHILDREN]) = (0, 1);
        }),
        ("group_of_other_side", "a group uses arcs against the direction of its child (8.1)", |f| {
            f.records[CHILD_HALF_ARCS..][..3].copy_from_slice(&[3, 5, 7]);
            (f.records[CHILD_TRIANGLES], f.levels[1].triangle_count) = (2, 2);
            f.levels[1].blocks = vec![0, 1, 1];
        }),
        ("child_levels", "a child begins two levels after its parent ends (8.1)", |f| *f = Handmade::tree_with_a_gap()),
        ("child_beyond_box", "a child's box is larger than its parent's (8.1)", |f| f.records[BOX_SIZE + 2] = 20),
    ]
}

fn grid_faults() -> Vec<Edit<Handmade>> {
    vec![
        ("grid_shape", "a grid has shape 3 (13.2)", |f| f.levels[1].blocks[0] = 3),
        ("grid_without_middles", "a grid has quads, but a side has no sample in its middle (13.2)", |f| {
            f.levels[1].blocks = vec![2, 0, 0, 0];
        }),
        ("grid_of_two_loops", "a grid has two loops (13)", |f| {
            f.records[ROOT] = 2;
            // The other side of the same triangle.
            f.records.splice(HALF_ARCS + 3..HALF_ARCS + 3, [3, 3, 5, 7]);
        }),
        ("grid_corner", "a corner of a grid is no vertex at level 0 (13)", |f| {
            // In its place, there is a sample; the border does not begin there.
            f.records[SECOND_CORNER_LEVEL] = 1;
            f.records[FIRST_ARC_SAMPLES..][..2].copy_from_slice(&[1, 0]);
            f.corners.append(&mut f.levels[1].arcs);
        }),
        ("grid_triangle_count", "the triangle count of a grid differs from the index (11.1)", |f| {
            f.set_fine_triangles(3);
        }),
    ]
}

fn channel_section_faults() -> Vec<Edit<Container>> {
    vec![
        ("channels_of_version_4_0", "a file of version 4.0 has channels (4)", |c| c.version[1] = 0),
        ("channels_alone", "CHANNELS is there without TEXELS (5)", |c| c.sections.retain(|s| s.kind != TEXELS)),
        ("texels_alone", "TEXELS is there without CHANNELS (5)", |c| c.sections.retain(|s| s.kind != CHANNELS)),
        ("channels_flags", "CHANNELS is marked as required (5)", |c| c.section(CHANNELS).flags = 1),
        ("texels_flags", "TEXELS is not checked by parts (5)", |c| c.section(TEXELS).flags = 0),
        ("channels_longer", "a byte follows the last channel (20.1)", |c| c.section(CHANNELS).content.push(0)),
        ("channels_short", "CHANNELS ends within a channel (20.1)", |c| c.section(CHANNELS).content.truncate(20)),
    ]
}

fn ground_faults() -> Vec<Edit<Container>> {
    vec![
        ("ground_of_version_4_2", "a file of version 4.2 has a ground (4)", |c| c.version[1] = 2),
        ("ground_flags", "GROUND is marked as required (5)", |c| c.section(GROUND).flags = 3),
        ("ground_checksum", "GROUND has a checksum of its own (5)", |c| c.section(GROUND).flags = 0),
        ("ground_empty", "GROUND has no bytes (23)", |c| c.section(GROUND).content.clear()),
        ("ground_short", "GROUND ends within its file (23)", |c| {
            c.section(GROUND).content.pop();
        }),
        ("ground_longer", "a byte follows the file in GROUND (23)", |c| c.section(GROUND).content.push(0)),
        ("ground_damaged", "a byte of the heights in GROUND has changed (23)", |c| c.section(GROUND).content[400] ^= 1),
        ("ground_of_a_mesh", "GROUND holds a mesh (23)", |c| {
            c.section(GROUND).content = Handmade::example().container().bytes();
        }),
        ("ground_in_ground", "the heights in GROUND have a ground (23)", |c| {
            c.section(GROUND).content = ground::ground_in_ground();
        }),
        ("ground_on_a_globe", "the heights in GROUND lie on an ellipsoid (23)", |c| {
            c.section(GROUND).content = ground::globe();
        }),
        ("ground_elsewhere", "the heights in GROUND name another CRS than the mesh (23)", |c| {
            *c.section(PLACEMENT) = ground::placement(1, 0.25, [16.0, -4.0, 0.5], "EPSG:32632");
            c.section(GROUND).content = ground::heights_in("EPSG:32633");
        }),
        ("ground_beside_heights", "heights lie beside a mesh and its ground (5)", ground::heights_beside),
    ]
}

fn scale_faults() -> Vec<Edit<Container>> {
    vec![
        ("scales_without_channels", "SCALES is there without CHANNELS (20.3)", |c| {
            c.sections.retain(|s| ![CHANNELS, TEXELS].contains(&s.kind));
        }),
        ("scales_version", "a file of version 4.3 has SCALES (20.3)", |c| c.version[1] = 3),
        ("scales_optional", "SCALES is not required (5)", |c| c.section(SCALES).flags = 0),
        ("scales_short", "SCALES has no byte for the last channel (20.3)", |c| c.section(SCALES).content.truncate(1)),
        ("scales_longer", "a byte follows that of the last channel in SCALES (20.3)", |c| {
            c.section(SCALES).content.push(1);
        }),
        ("scales_two", "an image is divided into two streams (20.3)", |c| c.section(SCALES).content[0] = 2),
        ("scales_none", "SCALES says that no image is divided (20.3)", |c| c.section(SCALES).content[0] = 1),
        ("scales_of_numbers", "images of numbers are divided (20.3)", |c| c.section(SCALES).content[1] = 4),
    ]
}

/// The head of DRAPE ends with its checksum.
fn in_drape_head(container: &mut Container, edit: impl FnOnce(&mut [u8])) {
    let content = &mut container.section(DRAPE).content;
    edit(&mut content[..64]);
    let checksum = crc32fast::hash(&content[..64]);
    content[64..68].copy_from_slice(&checksum.to_le_bytes());
}

/// The top directory follows the head, which has its checksum.
fn in_top_directory(container: &mut Container, edit: impl FnOnce(&mut [u8])) {
    let content = &mut container.section(DRAPE).content;
    let length = u32::from_le_bytes([content[56], content[57], content[58], content[59]]) as usize;
    edit(&mut content[68..68 + length]);
    let checksum = crc32fast::hash(&content[68..68 + length]);
    in_drape_head(container, |head| head[60..64].copy_from_slice(&checksum.to_le_bytes()));
}

fn drape_faults() -> Vec<Edit<Container>> {
    vec![
        ("drape_of_version_4_4", "a file of version 4.4 has an image over heights (4)", |c| c.version[1] = 4),
        ("drape_flags", "DRAPE is marked as required (5)", |c| c.section(DRAPE).flags = 3),
        ("drape_over_a_mesh", "an image for heights lies beside a mesh (5)", |c| {
            let drape = c.section(DRAPE).content.clone();
            *c = Handmade::example().container();
            c.version[1] = 5;
            let pages = c.sections.len() - 1;
            c.sections.insert(pages, Section { kind: DRAPE, flags: 2, content: drape, reserved: 0 });
        }),
        ("drape_short", "DRAPE ends within its head (22.10)", |c| c.section(DRAPE).content.truncate(60)),
        ("drape_checksum", "the checksum of the head of DRAPE is wrong (22.10)", |c| c.section(DRAPE).content[0] ^= 1),
        ("drape_empty", "the image over the heights has no columns (22.10)", |c| in_drape_head(c, |b| b[..8].fill(0))),
        ("drape_reserved", "a reserved byte of DRAPE is set (22.10)", |c| in_drape_head(c, |b| b[52] = 1)),
        ("drape_components", "the image over the heights has two components (22.10)", |c| {
            in_drape_head(c, |b| b[48] = 2);
        }),
        ("drape_side", "tiles of the image over the heights have four texels along a side (22.10)", |c| {
            in_drape_head(c, |b| b[49] = 2);
        }),
        ("drape_spacing", "texels of the image over the heights lie at one column (22.10)", |c| {
            in_drape_head(c, |b| b[32..40].fill(0));
        }),
        ("drape_gap", "the image over the heights has three components and a tile without an image (22.10)", |c| {
            in_drape_head(c, |b| b[48] = 3);
        }),
        ("drape_nothing_three", "an image of three components has no tiles (22.10)", |c| {
            in_drape_head(c, |b| {
                b[48] = 3;
                b[56..64].fill(0);
            });
            c.section(DRAPE).content.truncate(68);
        }),
        ("drape_directory_checksum", "the checksum of a directory of images is wrong (22.10)", |c| {
            c.section(DRAPE).content[68] ^= 1;
        }),
        ("drape_directory_short", "a directory of images ends early (22.10)", |c| {
            let content = &mut c.section(DRAPE).content;
            content[56] -= 1;
            let length = content[56] as usize;
            let checksum = crc32fast::hash(&content[68..68 + length]);
            in_drape_head(c, |b| b[60..64].copy_from_slice(&checksum.to_le_bytes()));
        }),
        ("drape_first_stream", "images do not begin where their directory says (22.10)", |c| {
            in_top_directory(c, |b| b[0] += 1);
        }),
        ("drape_first_below", "directories do not begin where the one above says (22.10)", |c| {
            in_top_directory(c, |b| b[8] += 1);
        }),
        ("drape_image_checksum", "the checksum of an image is wrong (22.10)", |c| {
            if let Some(last) = c.section(DRAPE).content.last_mut() {
                *last ^= 1;
            }
        }),
        ("drape_longer", "a byte follows the last image (22.10)", |c| c.section(DRAPE).content.push(0)),
    ]
}

fn object_section_faults() -> Vec<Edit<Container>> {
    vec![
        ("objects_of_version_4_5", "a file of version 4.5 has objects (4)", |c| c.version[1] = 5),
        ("objects_flags", "OBJECTS is marked as required (5)", |c| c.section(OBJECTS).flags = 1),
        ("object_pages_flags", "OBJECT_PAGES has a checksum of its own (5)", |c| c.section(OBJECT_PAGES).flags = 0),
        ("objects_alone", "OBJECTS is there without OBJECT_PAGES (5)", |c| {
            c.sections.retain(|section| section.kind != OBJECT_PAGES);
        }),
        ("object_pages_alone", "OBJECT_PAGES is there without OBJECTS (5)", |c| {
            c.sections.retain(|section| section.kind != OBJECTS);
        }),
        ("objects_short", "OBJECTS ends within the root of a list (24.2)", |c| {
            c.section(OBJECTS).content.truncate(10);
        }),
        ("object_pages_short", "OBJECT_PAGES ends within a page (24.3)", |c| {
            let _ = c.section(OBJECT_PAGES).content.pop();
        }),
        ("objects_of_nothing", "a file without roots has objects (24.2)", |c| {
            *c = HandmadeObjects::example().put_into(Handmade::nothing().container());
        }),
    ]
}

/// A leaf of two objects, both new, with an island of the first one at each level.
const OWNERS_OF_TWO: [Symbol; 7] = [
    Number("count", 2),
    Bit("new", true),
    Bit("new", true),
    Signed("first", -1),
    Bit("next", true),
    Signed("later", 0),
    Bit("next", true),
];

/// A page of owners that begins as that of the example.
fn owners(objects: &mut HandmadeObjects, symbols: &[Symbol]) {
    objects.lists[0].pages[0].1 = coded(symbols);
}

/// A page of three nodes without names.
fn nodes(objects: &mut HandmadeObjects, parents: &[Symbol]) {
    let none = ["name", "id"].iter().flat_map(|name| [Bit(name, false); 3]);
    objects.lists[1].pages[0].1 = coded(&parents.iter().copied().chain(none).collect::<Vec<_>>());
}

/// The page of children.
fn children(objects: &mut HandmadeObjects, steps: &[u32], place: i32) {
    let mut symbols = vec![Signed("place", place)];
    symbols.extend(steps.iter().flat_map(|&step| [Number("step", step), Signed("place", 0)]));
    objects.lists[4].pages[0].1 = coded(&symbols);
    objects.pairs[2] = steps.len() as u64 + 1;
}

fn object_faults() -> Vec<Edit<HandmadeObjects>> {
    vec![
        ("objects_none", "OBJECTS says that there are none (24.2)", |o| o.counts = [0, 3]),
        ("objects_too_many", "there are 2^31 objects and assemblies (24.2)", |o| o.counts = [1 << 31, 0]),
        ("objects_longer", "a byte follows the last root in OBJECTS (24.2)", |o| o.excess[0] = vec![0]),
        ("objects_pairs", "a list of pairs has more of them than there are nodes (24.2)", |o| o.pairs[2] = 4),
        ("objects_root_missing", "the list of nodes has no root (24.2)", |o| o.lists[1].pages.clear()),
        ("objects_root_idle", "a list without pairs has a root (24.2)", |o| {
            o.lists[2] = o.lists[4].clone();
        }),
        ("objects_root_checksum", "the checksum of a root is wrong (24.3)", |o| o.checksum_excess = 1),
        ("object_directory_short", "a directory of objects has no entry for a page (24.3)", |o| {
            o.counts[1] = 1024;
            nodes(o, &[]);
        }),
        ("object_directory_longer", "a byte follows the last entry of a directory of objects (24.3)", |o| {
            o.lists[0].excess = vec![0];
        }),
        ("object_pages_gap", "a page does not lie where its directory says (24.3)", |o| {
            o.lists[1].offset_excess = 1;
        }),
        ("object_pages_longer", "a byte follows the last page of objects (24.3)", |o| o.excess[1] = vec![0]),
        ("object_key", "the page of owners says that it begins with object 1 (24.3)", |o| o.lists[0].pages[0].0 = 1),
        ("owners_missing", "a cluster with a leaf has no owners (24.4)", |o| o.lists[0].pages[0].1.clear()),
        ("owner_beyond_count", "a leaf has two objects of a file with one (24.4)", |o| {
            owners(o, &OWNERS_OF_TWO);
        }),
        ("owner_before_first", "a leaf has an object before the first one (24.4)", |o| {
            owners(
                o,
                &[Number("count", 1), Bit("new", false), Number("back", 0), Signed("first", 0), Signed("later", 0)],
            );
        }),
        ("owner_twice", "a leaf has an object twice (24.4)", |o| {
            owners(
                o,
                &[
                    Number("count", 2),
                    Bit("new", true),
                    Bit("new", false),
                    Number("back", 0),
                    Signed("first", -1),
                    Bit("next", true),
                    Signed("later", 0),
                    Bit("next", true),
                ],
            );
        }),
        ("owners_none", "a leaf has no object, and an island (24.4)", |o| {
            owners(o, &[Number("count", 0), Signed("first", 1), Signed("later", 0)]);
        }),
        ("owners_of_more", "a block of one triangle has two islands (24.4)", |o| {
            owners(o, &[Number("count", 1), Bit("new", true), Signed("first", 1), Signed("later", 0)]);
        }),
        ("owners_of_others", "a block has no island, and triangles (24.4)", |o| {
            owners(o, &[Number("count", 1), Bit("new", true), Signed("first", -1), Signed("later", 1)]);
        }),
        ("owner_beyond_leaf", "an island belongs to the second of one object (24.4)", |o| {
            o.counts[0] = 2;
            owners(
                o,
                &[
                    Number("count", 2),
                    Bit("new", true),
                    Bit("new", true),
                    Signed("first", -1),
                    Bit("next", false),
                    Bit("same", false),
                    Signed("other", 3),
                    Signed("later", 0),
                    Bit("next", true),
                ],
            );
        }),
        ("object_of_no_leaf", "no leaf has the second object (24.4)", |o| o.counts = [2, 1]),
        ("object_of_no_island", "the second object of a leaf has no island (24.4)", |o| {
            o.counts = [2, 1];
            // Parents count from the first assembly, which is node 2 here, too.
            nodes(
                o,
                &[Number("rank", 1), Signed("parent", 1), Number("rank", 1), Number("rank", 2), Signed("parent", -1)],
            );
            owners(o, &OWNERS_OF_TWO);
        }),
        ("owners_longer", "a byte follows the last bit of a page of owners (24.4)", |o| {
            o.lists[0].pages[0].1.push(0);
        }),
        ("parent_beyond_count", "the parent of an object is node 3 of three (24.5)", |o| {
            nodes(o, &[Number("rank", 1), Signed("parent", 3), Number("rank", 1), Number("rank", 1)]);
        }),
        ("parent_rank", "a parent is one of two before, the fourth (24.5)", |o| {
            nodes(o, &[Number("rank", 1), Signed("parent", 2), Number("rank", 3), Number("rank", 0)]);
        }),
        ("parents_in_a_circle", "two assemblies lie in each other (24.5)", |o| {
            // Object 0 lies in node 2, node 1 in node 2, and node 2 in node 1.
            nodes(
                o,
                &[Number("rank", 1), Signed("parent", 2), Number("rank", 0), Number("first", 2), Signed("parent", -1)],
            );
            o.lists[4].pages[0].0 = 2;
            children(o, &[1], 0);
        }),
        ("assembly_without_parts", "nothing lies in an assembly (24.5)", |o| {
            // Object 0 lies in node 2, and both assemblies in nothing.
            nodes(o, &[Number("rank", 1), Signed("parent", 2), Number("rank", 1), Number("rank", 0)]);
            children(o, &[3], 0);
        }),
        ("children_missing", "what lies in node 1 is not found (24.6)", |o| children(o, &[3], 0)),
        ("children_elsewhere", "what lies in node 1 is looked for in a page that is not there (24.6)", |o| {
            children(o, &[2, 1], 1);
        }),
        ("name_without_node", "a name is found that no node has (24.6)", |o| {
            o.pairs[0] = 1;
            o.lists[2] = o.lists[4].clone();
            o.lists[2].pages[0].1 = coded(&[]);
        }),
    ]
}

fn drawing_faults() -> Vec<Edit<HandmadeTexels>> {
    vec![
        ("drawing_components", "a drawing has two components (20.1)", |t| t.channels[1].components = 2),
        ("drawing_low", "drawings count from 1 (20.1)", |t| t.channels[1].numbers[0] = 1.0),
        ("drawing_step", "drawings count in steps of a half (20.1)", |t| t.channels[1].numbers[1] = 0.5),
        ("drawing_twice", "two channels are of kind drawing (20.1)", |t| {
            let name = b"again".to_vec();
            t.channels[0] = HandmadeChannel { name, ..t.channels[1].clone() };
        }),
    ]
}

fn channel_faults() -> Vec<Edit<HandmadeTexels>> {
    vec![
        ("channels_none", "there is no channel (20.1)", |t| {
            t.channels.clear();
            t.streams.truncate(2);
        }),
        ("channels_65", "there are 65 channels (20.1)", |t| {
            let channel = |k: u8| {
                let mut channel = t.channels[1].clone();
                channel.name.push(b'0' + k);
                channel
            };
            t.channels = (0..65).map(channel).collect();
            t.streams = vec![vec![]; 132];
        }),
        ("channel_missing", "there are fewer channels than CHANNELS says (20.1)", |t| t.channel_excess = 1),
        ("channel_name_empty", "a channel has no name (20.1)", |t| t.channels[0].name.clear()),
        ("channel_name_long", "a channel's name has 256 bytes (20.1)", |t| t.channels[0].name = vec![b'x'; 256]),
        ("channel_name_control", "a channel's name has a control character (20.1)", |t| {
            t.channels[0].name = b"\x1b[31mred".to_vec();
        }),
        ("channel_name_bytes", "a channel's name is not UTF-8 (20.1)", |t| t.channels[0].name = vec![b'x', 0xff]),
        ("channel_name_twice", "two channels have the same name (20.1)", |t| {
            t.channels[1].name = t.channels[0].name.clone();
        }),
        ("channel_components", "a channel has five components (20.1)", |t| t.channels[1].components = 5),
        ("channel_components_zero", "a channel has no components (20.1)", |t| t.channels[1].components = 0),
        ("channel_colour", "a colour has two components (20.1)", |t| t.channels[0].components = 2),
        ("exact_colour", "an exact colour has two components (20.1)", |t| {
            (t.channels[0].kind, t.channels[0].components) = (7, 2);
        }),
        ("exact_normal", "an exact normal has three components (20.1)", |t| t.channels[0].kind = 8),
        ("channel_low", "the low value of a channel is not a number (20.1)", |t| t.channels[0].numbers[0] = f64::NAN),
        ("channel_step", "the step of a channel is 0 (20.1)", |t| t.channels[0].numbers[1] = 0.0),
        ("channel_bound", "the bound of a channel is negative (20.1)", |t| t.channels[0].numbers[2] = -1.0),
        ("channel_bytes", "CHANNELS says that images take a byte more than they do (20.1)", |t| t.size_excess = 1),
        ("texel_table_checksum", "the checksum of the texel table is wrong (20.2)", |t| t.checksums[2] = 1),
        ("texel_table_short", "TEXELS ends within its table (20.2)", |t| {
            t.streams = vec![vec![]; 6];
            t.table_missing = 4;
        }),
        ("texel_gap", "the directory of a cluster does not follow the table (20.2)", |t| t.gaps[0] = 1),
        ("texel_directory_checksum", "the checksum of a texel directory is wrong (20.2)", |t| t.checksums[0] = 1),
        ("texel_directory_longer", "a byte follows the last part of a texel directory (20.2)", |t| {
            t.directory_excess = vec![0];
        }),
        ("texel_directory_short", "a texel directory lacks a part (20.2)", |t| drop(t.streams.pop())),
        ("texel_directory_idle", "a texel directory has only empty streams (20.2)", |t| {
            t.streams = vec![vec![]; 6];
            t.always_has_directory = true;
        }),
        ("texel_checksum_idle", "a cluster without texels has a checksum (20.2)", |t| {
            t.streams = vec![vec![]; 6];
            t.checksums[0] = 1;
        }),
        ("texel_sizes", "a byte follows the last stream of a cluster (20.2)", |t| t.gaps[1] = 1),
        ("texel_checksum", "the checksum of a texel stream is wrong (20.2)", |t| t.checksums[1] = 1),
        ("texels_longer", "a byte follows the texels of the last cluster (20.2)", |t| t.gaps[2] = 1),
    ]
}
