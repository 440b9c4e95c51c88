//! What is read, request by request.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
};

use super::synthetic::{Options, cube, file_of, model};
use crate::{
    Fetched, File, Index, Limits, Opener, Outside, Query, Result,
    decode::extract,
    format::{header::kind, sections::Part},
    index::needs::{Wanted, find_stream, parts_of},
    select::select_cut,
    source::{
        Recording,
        requests::{Before, plan, plan_after},
    },
    write::{ListSizes, write_listed},
};

const OPTIONS: Options = Options { levels: 4, seed: 6, grids_of_four: 1, heights: 0 };

fn size(ranges: &[Range<u64>]) -> u64 {
    ranges.iter().map(|range| range.end - range.start).sum()
}

/// Offset and end of a section.
fn section(file: &Index, wanted: u32) -> Range<u64> {
    let sections = file.sections();
    let (_, offset, length) = sections.iter().find(|(kind, ..)| *kind == wanted).unwrap();
    *offset..offset + length
}

#[test]
fn opening_reads_the_first_8_kib_and_the_rest_of_a_long_topmost_list() {
    let small = file_of(&cube(1), OPTIONS);
    let file = File::open(Recording::new(small.clone()), Limits::default()).unwrap();
    assert_eq!(file.source().take(), vec![0..small.len().min(8192) as u64]);

    // 4704 roots: 196 clusters, of which the topmost list has few.
    let large = file_of(&cube(28), OPTIONS);
    let file = File::open(Recording::new(large), Limits::default()).unwrap();
    assert_eq!(file.index().cluster_count(), 196);
    assert_eq!(file.source().take(), vec![0..8192]);

    let mut long = Vec::new();
    let sizes = ListSizes { entries: 1000, top_bytes: 1 << 20, ..ListSizes::default() };
    write_listed(&model(&cube(28), OPTIONS).0, sizes, &mut long).unwrap();
    let file = File::open(Recording::new(long), Limits::default()).unwrap();
    let clusters = section(file.index(), kind::CLUSTERS);
    assert!(clusters.end > 8192 && clusters.start < 8192, "{clusters:?}");
    assert_eq!(file.source().take(), [0..8192, 8192..clusters.end]);
}

#[test]
fn the_first_picture_is_two_requests_more() {
    let bytes = file_of(&cube(15), OPTIONS);
    let file = File::open(Recording::new(bytes), Limits::default()).unwrap();
    file.source().take();
    file.extract(&file.uniform_cut(0).unwrap()).unwrap();
    let pages = section(file.index(), kind::PAGES);
    let coarsest = pages.start..pages.start + file.level(0).unwrap().page_bytes;
    let index = section(file.index(), kind::INDEX);
    assert!(index.start < 8192);
    assert_eq!(file.source().take(), [8192..index.end, coarsest]);
}

#[test]
fn a_region_reads_its_own_index_blocks_and_streams_in_few_requests() {
    // 1014 roots, whose boxes reach one unit beyond their faces of three quarters of a unit.
    let bytes = file_of(&cube(13), OPTIONS);
    let mut counts = Vec::new();
    for k in 0..20 {
        // About a hundredth of the roots, anywhere on one side of the cube.
        let low = [(k * 37 % 17) as f64 * 0.4 + 1.5, ((k + 5) * 37 % 17) as f64 * 0.4 + 1.5, 0.0];
        let region = [low, low.map(|x| x + 0.05)];
        let file = File::open(Recording::new(bytes.clone()), Limits::default()).unwrap();
        file.source().take();
        let cut = file.select(&Query { volume: Some(region.into()), ..Query::default() }).unwrap();
        file.extract(&cut).unwrap();
        let requests = file.source().take();
        let own = file.own_bytes(&cut).unwrap();
        assert!((8..30).contains(&cut.nodes.len()), "{}", cut.nodes.len());
        // Nothing is read twice, not even from the head.
        let mut sorted = requests.clone();
        sorted.sort_by_key(|range| range.start);
        assert!(sorted.windows(2).all(|pair| pair[0].end <= pair[1].start), "{requests:?}");
        assert!(size(&requests) * 2 <= own * 3, "{} of {own}: {requests:?}", size(&requests));
        counts.push(requests.len());
        // What has been read of the index stays.
        file.select(&Query { volume: Some(region.into()), outside: Outside::Drop, ..Query::default() }).unwrap();
        assert!(file.source().take().is_empty());
    }
    counts.sort_unstable();
    // Few bytes and few requests pull apart: small roots whose streams lie far from each other cost more requests.
    assert!(counts[counts.len() / 2] <= 11 && counts[counts.len() - 1] <= 15, "{counts:?}");
}

#[test]
fn a_region_reads_exactly_its_parts_joined_by_the_plan() {
    let file = File::open(Recording::new(file_of(&cube(13), OPTIONS)), Limits::default()).unwrap();
    let region = [[3.1, 3.5, 0.0], [3.15, 3.55, 0.05]];
    file.source().take();
    let cut = file.select(&Query { volume: Some(region.into()), ..Query::default() }).unwrap();
    let near: Vec<usize> = file
        .index()
        .clusters()
        .unwrap()
        .iter()
        .enumerate()
        .filter(|(_, cluster)| {
            let [low, high] = cluster.bounds.map(|point| file.lattice().world(point));
            (0..3).all(|k| low[k] <= region[1][k] && region[0][k] <= high[k])
        })
        .map(|(number, _)| number)
        .collect();
    let (index, pages) = (section(file.index(), kind::INDEX).start, section(file.index(), kind::PAGES).start);
    let within = |base: u64, part: Part| base + part.offset..base + part.offset + part.length;
    let beyond_head = |range: Range<u64>| range.start.max(8192)..range.end.max(8192);
    let block = |number: &usize| beyond_head(within(index, file.index().clusters().unwrap()[*number].index));
    let first = file.source().take();
    assert_eq!(first, plan(near.iter().map(block)));

    file.extract(&cut).unwrap();
    let requests = file.source().take();
    // Of the index, the blocks that own arcs or corners of the region's roots; of the pages, the streams of both.
    let first_page = requests.partition_point(|range| range.start < pages);
    let mut arc_levels = BTreeMap::new();
    let mut wanted: Vec<Wanted> = Vec::new();
    for node in &cut.nodes {
        let entry = file.root_entry(node.root).unwrap();
        let level = entry.blocks[entry.block_at(node.level)].level;
        wanted.push(Wanted { root: node.root, level, arc_level: level });
        entry.half_arcs().for_each(|side| {
            let drawn = arc_levels.entry(side.arc).or_insert(level);
            *drawn = level.max(*drawn);
        });
    }
    for wanted in &mut wanted {
        let arcs = file.root_entry(wanted.root).unwrap().half_arcs();
        wanted.arc_level = arcs.map(|side| arc_levels[&side.arc]).max().unwrap();
    }
    let parts = parts_of(file.index(), &wanted).unwrap();
    let part_bytes: u64 = parts.iter().map(|(_, part)| part.length).sum();
    let own_index = file.own_bytes(&cut).unwrap() - part_bytes;
    let (mut own_blocks, mut corner_blocks) = (BTreeSet::new(), BTreeSet::new());
    for wanted in &wanted {
        let owner = file.index().owner(wanted.root, |cluster| cluster.first_root).unwrap();
        let (cluster, index) = (file.index().clusters().unwrap()[owner as usize], file.cluster_index(owner).unwrap());
        own_blocks.insert(owner as usize);
        // Blocks before it in its stream are decoded too.
        let local = wanted.root - cluster.first_root;
        let stream = &index.streams[find_stream(index, wanted.level, local).unwrap()];
        for before in stream.roots.start..=local {
            let entry = &index.roots[before as usize];
            let decoded = entry.blocks.iter().any(|block| block.level == wanted.level);
            for side in entry.half_arcs().filter(|_| decoded) {
                let arc_owner = file.index().owner(side.arc, |cluster| cluster.first_arc).unwrap();
                let local_arc = side.arc - file.index().clusters().unwrap()[arc_owner as usize].first_arc;
                let ends = file.cluster_index(arc_owner).unwrap().arc_ends[local_arc as usize];
                own_blocks.insert(arc_owner as usize);
                corner_blocks
                    .extend(ends.map(|end| file.index().owner(end, |cluster| cluster.first_corner).unwrap() as usize));
            }
        }
    }
    let all_blocks: Vec<usize> = own_blocks.union(&corner_blocks).copied().collect();
    assert_eq!(
        own_index,
        all_blocks.iter().map(|&number| file.index().clusters().unwrap()[number].index.length).sum::<u64>()
    );
    let is_in = |reads: &[Range<u64>], range: &Range<u64>| {
        range.is_empty() || reads.iter().any(|read| read.start <= range.start && range.end <= read.end)
    };
    let mut expected = plan(own_blocks.iter().map(block).filter(|range| !is_in(&first, range)));
    let known = [first, expected.clone()].concat();
    expected.extend(plan(corner_blocks.iter().map(block).filter(|range| !is_in(&known, range))));
    assert_eq!(requests[..first_page], expected);
    let before = Before { bytes: own_index, parts: all_blocks.len() };
    let streams = parts.iter().map(|&(_, part)| within(pages, part));
    assert_eq!(requests[first_page..], plan_after(before, streams));
}

#[test]
fn without_a_source_the_same_is_asked_for_and_decoded() {
    let bytes = file_of(&cube(6), OPTIONS);
    let file = File::open(Recording::new(bytes.clone()), Limits::default()).unwrap();
    let query = Query { volume: Some([[0.0; 3], [3.0; 3]].into()), ..Query::default() };
    let mesh = file.extract(&file.select(&query).unwrap()).unwrap();

    let read = |range: Range<u64>| bytes[range.start as usize..(range.end as usize).min(bytes.len())].to_vec();
    let mut asked = vec![Opener::FIRST_READ];
    let mut opener = Opener::new(Limits::default());
    opener.start(read(Opener::FIRST_READ), bytes.len() as u64);
    let index = loop {
        match opener.finish() {
            Err(crate::Error::Missing { ranges }) => {
                for range in ranges {
                    asked.push(range.clone());
                    opener.insert(range.start, read(range));
                }
            }
            done => break done.unwrap(),
        }
    };
    fn answer<T>(
        index: &Index,
        read: &mut dyn FnMut(Range<u64>) -> Vec<u8>,
        mut question: impl FnMut(&Fetched) -> Result<T>,
    ) -> T {
        let mut fetched = index.fetched();
        loop {
            match question(&fetched) {
                Err(crate::Error::Missing { ranges }) => {
                    ranges.into_iter().for_each(|range| fetched.insert(range.start, read(range)));
                    index.supply(&fetched);
                }
                done => return done.unwrap(),
            }
        }
    }
    let mut read = |range: Range<u64>| {
        asked.push(range.clone());
        read(range)
    };
    let cut = answer(&index, &mut read, |_| select_cut(&index, &query));
    assert_eq!(answer(&index, &mut read, |fetched| extract(&index, &cut, fetched)), mesh);
    assert_eq!(asked, file.source().take());
}

#[test]
fn a_damaged_stream_spoils_only_what_needs_it() {
    let bytes = file_of(&cube(6), OPTIONS);
    let whole = File::open(bytes.as_slice(), Limits::default()).unwrap();
    let mut damaged = bytes.clone();
    // The last stream of the finest level.
    *damaged.last_mut().unwrap() ^= 1;
    let file = File::open(damaged.as_slice(), Limits::default()).unwrap();
    let finest = file.level_count() as u8 - 1;
    let failed = (0..file.root_count()).filter(|&root| file.decode_root(root, finest).is_err()).count();
    assert!((1..=32).contains(&failed));
    for root in 0..file.root_count() {
        assert_eq!(file.decode_root(root, finest - 1).unwrap(), whole.decode_root(root, finest - 1).unwrap());
    }
}
