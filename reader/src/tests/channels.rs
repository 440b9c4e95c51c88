//! Channels: texels come back as they were written, and only to those who ask for them.

use std::{collections::BTreeSet, ops::Range};

use super::synthetic::{Options, add_channels, cube, file_of, model};
use crate::{
    Error, Fetched, File, Index, Limits, Opener, Query, Result,
    format::header::kind,
    index::TexelBytes,
    source::Recording,
    write::{Model, write_file},
};

const OPTIONS: Options = Options { levels: 3, seed: 4, grids_of_four: 1, heights: 0 };

/// A model with two channels, its file, and the model's number of each root.
fn channels(n: i64, heights: u8) -> (Model, Vec<u8>, Vec<u32>) {
    let (mut model, _) = model(&cube(n), Options { heights, ..OPTIONS });
    add_channels(&mut model, 7);
    let mut bytes = Vec::new();
    let report = write_file(&model, &mut bytes).unwrap();
    assert_eq!(report.total_bytes, bytes.len() as u64);
    assert_eq!(report.total_bytes, report.sections.iter().map(|section| section.1).sum::<u64>());
    (model, bytes, report.root_order)
}

fn section(index: &Index, wanted: u32) -> Range<u64> {
    let section = index.header().section(wanted).unwrap();
    section.offset..section.offset + section.length
}

/// What a model has of a root at a level.
fn expected(model: &Model, root: u32, level: u8, channels: &[u8]) -> TexelBytes {
    let blocks = &model.roots[root as usize].blocks;
    let has = |level: &u8| blocks[usize::from(*level)].is_some();
    let level = (0..=level).rev().find(has).or_else(|| (level..).find(has)).unwrap();
    let stream = |k: usize| blocks[usize::from(level)].as_ref().unwrap().texels.get(k).cloned().unwrap_or_default();
    TexelBytes { level, map: stream(0), images: channels.iter().map(|&c| stream(1 + usize::from(c))).collect() }
}

#[test]
fn texels_survive_writing_and_reading() {
    for (n, heights) in [(1, 0), (3, 0), (9, 0), (4, 3)] {
        let (model, bytes, order) = channels(n, heights);
        let file = File::open(bytes, Limits::default()).unwrap();
        file.verify().unwrap();
        assert_eq!(file.channels(), model.channels);
        assert_eq!(file.index().version(), (4, 1));
        let blocks = || model.roots.iter().flat_map(|root| root.blocks.iter().flatten());
        for (number, &bytes) in file.index().texel_bytes().iter().enumerate() {
            let length = |texels: &Vec<Vec<u8>>| texels.get(number).map_or(0, |stream| stream.len() as u64);
            assert_eq!(bytes, blocks().map(|block| length(&block.texels)).sum::<u64>());
        }
        for channels in [&[0_u8, 1][..], &[1], &[], &[1, 0, 1]] {
            // In any order, and twice.
            let roots = (0..file.root_count()).rev().chain([0]);
            let levels = 0..file.level_count() as u8;
            let wanted: Vec<(u32, u8)> =
                roots.flat_map(|root| levels.clone().map(move |level| (root, level))).collect();
            let found = file.texels(&wanted, channels).unwrap();
            assert_eq!(found.len(), wanted.len());
            for ((root, level), found) in wanted.into_iter().zip(found) {
                assert_eq!(
                    found,
                    expected(&model, order[root as usize], level, channels),
                    "root {root}, level {level}"
                );
            }
        }
    }
}

#[test]
fn what_does_not_exist_is_a_query_error() {
    let (_, bytes, _) = channels(1, 0);
    let file = File::open(bytes, Limits::default()).unwrap();
    for (wanted, channels) in
        [((6, 0), &[0_u8][..]), ((u32::MAX, 0), &[]), ((0, 3), &[0]), ((0, 0), &[2]), ((0, 0), &[0, 255])]
    {
        let result = file.texels(&[wanted], channels);
        assert!(matches!(result, Err(Error::Query { .. })), "{result:?}");
    }
    let without = File::open(file_of(&cube(1), OPTIONS), Limits::default()).unwrap();
    assert!(without.channels().is_empty() && without.index().texel_bytes().is_empty());
    assert!(matches!(without.texels(&[(0, 0)], &[0]), Err(Error::Query { .. })));
    let none = without.texels(&[(0, 2)], &[]).unwrap();
    assert!(none[0].map.is_empty() && none[0].images.is_empty());
}

#[test]
fn a_file_without_channels_has_no_byte_of_them() {
    let bytes = file_of(&cube(3), OPTIONS);
    let file = File::open(bytes.as_slice(), Limits::default()).unwrap();
    assert_eq!(file.index().version(), (4, 0));
    assert_eq!(file.index().sections().iter().filter(|section| section.0 >= kind::CHANNELS).count(), 0);
    // A file with channels has the same sections besides.
    let (_, with, _) = channels(3, 0);
    let with_channels = File::open(with.as_slice(), Limits::default()).unwrap();
    for &(kind, offset, length) in &file.index().sections() {
        let range = section(with_channels.index(), kind);
        let [same, other] = [(&bytes, offset..offset + length), (&with, range)]
            .map(|(bytes, range)| &bytes[range.start as usize..range.end as usize]);
        assert!(same == other, "section {kind}");
    }
}

#[test]
fn geometry_reads_no_byte_of_texels() {
    let (_, bytes, _) = channels(13, 0);
    let file = File::open(Recording::new(bytes), Limits::default()).unwrap();
    file.extract(&file.uniform_cut(0).unwrap()).unwrap();
    let region = [[3.1, 3.5, 0.0], [3.15, 3.55, 0.05]];
    let query = Query { volume: Some(region.into()), ..Query::default() };
    file.extract(&file.select(&query).unwrap()).unwrap();
    file.summary().unwrap();
    let texels = section(file.index(), kind::TEXELS);
    let requests = file.source().take();
    assert_eq!(requests[0], 0..8192);
    assert!(texels.end - texels.start > 100_000);
    // Only what comes with opening, and what lies in small gaps.
    let most = 8192;
    let read: u64 =
        requests.iter().map(|range| range.end.min(texels.end).saturating_sub(range.start.max(texels.start))).sum();
    assert!(read <= most, "{read} bytes of {texels:?}: {requests:?}");
    assert!(
        requests.iter().skip(1).all(|range| range.end <= texels.start || texels.end <= range.start),
        "{requests:?}"
    );
}

#[test]
fn a_region_takes_a_chunk_of_the_table_its_directories_and_its_streams() {
    let (model, bytes, order) = channels(13, 0);
    let file = File::open(Recording::new(bytes), Limits::default()).unwrap();
    let texels = section(file.index(), kind::TEXELS);
    file.summary().unwrap();
    file.source().take();
    let root = (0..file.root_count())
        .rev()
        .find(|&root| !expected(&model, order[root as usize], 2, &[0, 1]).images.concat().is_empty())
        .unwrap();
    let all = file.texels(&[(root, 2)], &[0, 1]).unwrap();
    let requests = file.source().take();
    // The table has one chunk; streams of a block are adjacent.
    let table = u64::from(file.index().cluster_count()) * 16 + 12;
    assert_eq!(requests.len(), 3, "{requests:?}");
    assert_eq!(requests[0], texels.start..texels.start + table);
    let own = (all[0].map.len() + all[0].images.concat().len()) as u64;
    assert_eq!(requests[2].end - requests[2].start, own);
    // Table and directories stay.
    file.texels(&[(root, 2)], &[0, 1]).unwrap();
    assert_eq!(file.source().take(), [requests[2].clone()]);
    file.texels(&[(root, 2)], &[0]).unwrap();
    let first = file.source().take();
    assert_eq!(first[0].end - first[0].start, (all[0].map.len() + all[0].images[0].len()) as u64);
}

#[test]
fn without_a_source_the_same_texels_are_asked_for_and_found() {
    let (_, bytes, _) = channels(6, 0);
    let file = File::open(Recording::new(bytes.clone()), Limits::default()).unwrap();
    let wanted: Vec<(u32, u8)> = (0..file.root_count()).step_by(7).map(|root| (root, (root % 3) as u8)).collect();
    let found = file.texels(&wanted, &[1]).unwrap();

    let read = |range: Range<u64>| bytes[range.start as usize..(range.end as usize).min(bytes.len())].to_vec();
    let mut asked = vec![Opener::FIRST_READ];
    let mut opener = Opener::new(Limits::default());
    opener.start(read(Opener::FIRST_READ), bytes.len() as u64);
    let index = opener.finish().unwrap();
    let mut fetched = index.fetched();
    let answer: Result<Vec<TexelBytes>> = loop {
        match index.texels(&wanted, &[1], &fetched) {
            Err(Error::Missing { ranges }) => {
                for range in ranges {
                    asked.push(range.clone());
                    fetched.insert(range.start, read(range));
                }
                index.supply(&fetched);
            }
            done => break done,
        }
    };
    assert_eq!(answer.unwrap(), found);
    assert_eq!(asked, file.source().take());
    // Bytes that are not there are named, whatever is known besides.
    let again = index.texels(&wanted, &[1], &Fetched::default());
    assert!(matches!(again, Err(Error::Missing { .. })), "{again:?}");
}

#[test]
fn damaged_texels_are_named_and_spoil_nothing_else() {
    let (_, good, _) = channels(6, 0);
    let whole = File::open(good.as_slice(), Limits::default()).unwrap();
    let mesh = whole.extract(&whole.uniform_cut(2).unwrap()).unwrap();
    let texels = section(whole.index(), kind::TEXELS);
    let all: Vec<(u32, u8)> = (0..whole.root_count()).flat_map(|root| (0..3).map(move |level| (root, level))).collect();
    let mut named = BTreeSet::new();
    for at in (texels.start..texels.end).step_by(31).chain([texels.end - 1]) {
        let mut bytes = good.clone();
        bytes[at as usize] ^= 0x10;
        let file = File::open(bytes.as_slice(), Limits::default()).unwrap();
        let error = file.verify_checksums().unwrap_err().to_string();
        assert_eq!(file.texels(&all, &[0, 1]).unwrap_err().to_string(), error, "byte {at}");
        let place = error.split(['(', ')']).nth(1).unwrap().to_string();
        named.insert(place.split(|c: char| c.is_ascii_digit()).next().unwrap().trim().to_string());
    }
    let mut changed = good.clone();
    changed[texels.start as usize..texels.end as usize].fill(0xaa);
    let file = File::open(changed.as_slice(), Limits::default()).unwrap();
    assert_eq!(file.extract(&file.uniform_cut(2).unwrap()).unwrap(), mesh);
    let places = ["chunk", "image of channel", "map of root", "texel directory of cluster"];
    assert_eq!(named.iter().collect::<Vec<_>>(), places);
}

#[test]
fn channels_that_break_a_rule_cannot_be_written() {
    let (good, ..) = channels(1, 0);
    let refused = |change: &dyn Fn(&mut Model)| {
        let mut changed = good.clone();
        change(&mut changed);
        let result = write_file(&changed, &mut Vec::new());
        assert!(matches!(result, Err(Error::Model { .. })), "{result:?}");
    };
    refused(&|model| model.channels[0].components = 2);
    refused(&|model| model.channels[0].name.clear());
    refused(&|model| model.channels[1].name = "colour".into());
    refused(&|model| model.channels[1].kind = crate::index::ChannelKind::Unknown(9));
    refused(&|model| model.channels[1].is_exact = true);
    refused(&|model| model.channels = vec![]);
    refused(&|model| drop(model.channels.pop()));
    refused(&|model| model.roots[5].blocks[0].as_mut().unwrap().texels = vec![vec![]; 4]);
}
