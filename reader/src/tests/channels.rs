//! Channels: texels come back as they were written, and only to those who ask for them.

use std::{collections::BTreeSet, ops::Range};

use super::synthetic::{Options, add_channels, cube, file_of, model};
use crate::{
    Error, Fetched, File, Index, Limits, Opener, Query, Result,
    format::header::kind,
    index::{Scale, TexelBytes},
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
    let images = channels.iter().map(|&channel| vec![stream(1 + usize::from(channel))]).collect();
    TexelBytes { level, scale: Scale::Full, map: stream(0), images }
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
            let found = file.texels(&wanted, channels, Scale::Full).unwrap();
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

/// The same with a first channel whose images are in scales, which have random bytes, too.
fn scaled(n: i64, heights: u8) -> (Model, Vec<u8>, Vec<u32>) {
    let (mut model, ..) = channels(n, heights);
    model.channels[0].is_scaled = true;
    for texels in
        model.roots.iter_mut().flat_map(|root| root.blocks.iter_mut().flatten()).map(|block| &mut block.texels)
    {
        if texels.is_empty() {
            continue;
        }
        let image = texels.remove(1);
        let parts: Vec<Vec<u8>> =
            [0, 1, 2, 3].map(|k| image[image.len() * k / 4..image.len() * (k + 1) / 4].to_vec()).into();
        texels.splice(1..1, parts);
    }
    let mut bytes = Vec::new();
    let order = write_file(&model, &mut bytes).unwrap().root_order;
    (model, bytes, order)
}

#[test]
fn images_in_scales_survive_and_each_scale_reads_its_part() {
    for (n, heights) in [(1, 0), (9, 0), (4, 3)] {
        let (model, bytes, order) = scaled(n, heights);
        let file = File::open(bytes, Limits::default()).unwrap();
        file.verify_checksums().unwrap();
        assert_eq!(file.channels(), model.channels);
        assert_eq!(file.index().version(), (4, 4));
        let wanted: Vec<(u32, u8)> =
            (0..file.root_count()).rev().flat_map(|root| (0..3).map(move |level| (root, level))).collect();
        for (scale, count) in [(Scale::Eighth, 1), (Scale::Quarter, 2), (Scale::Half, 3), (Scale::Full, 4)] {
            let found = file.texels(&wanted, &[1, 0], scale).unwrap();
            for (&(root, level), found) in wanted.iter().zip(found) {
                let level = expected(&model, order[root as usize], level, &[]).level;
                let block = model.roots[order[root as usize] as usize].blocks[usize::from(level)].as_ref().unwrap();
                let stream = |k: usize| block.texels.get(k).cloned().unwrap_or_default();
                let images = vec![vec![stream(5)], (1..=count).map(stream).collect()];
                assert_eq!(found, TexelBytes { level, scale, map: stream(0), images });
            }
        }
    }
}

#[test]
fn a_scale_of_many_images_lies_together() {
    let (_, bytes, _) = scaled(9, 0);
    let file = File::open(Recording::new(bytes), Limits::default()).unwrap();
    file.summary().unwrap();
    let cluster = &file.index().clusters().unwrap()[0];
    let has_finest = |root: &u32| file.root_contents(*root).unwrap().blocks.iter().any(|block| block.level == 2);
    let roots = (cluster.first_root..).take(cluster.root_count as usize).filter(has_finest);
    let wanted: Vec<(u32, u8)> = roots.map(|root| (root, 2)).collect();
    file.texels(&wanted, &[0], Scale::Full).unwrap();
    file.source().take();
    let bytes = |scale: Scale| {
        let found = file.texels(&wanted, &[0], scale).unwrap();
        let all = found.iter().map(|texels| texels.map.len() + texels.images[0].concat().len()).sum::<usize>();
        let read = file.source().take();
        // Maps, and what is beside them.
        assert_eq!(read.len(), 1, "{scale:?} {read:?}");
        assert_eq!(read[0].end - read[0].start, all as u64);
        all
    };
    let [eighth, quarter] = [Scale::Eighth, Scale::Quarter].map(bytes);
    assert!(eighth < quarter);
}

#[test]
fn what_does_not_exist_is_a_query_error() {
    let (_, bytes, _) = channels(1, 0);
    let file = File::open(bytes, Limits::default()).unwrap();
    for (wanted, channels) in
        [((6, 0), &[0_u8][..]), ((u32::MAX, 0), &[]), ((0, 3), &[0]), ((0, 0), &[2]), ((0, 0), &[0, 255])]
    {
        let result = file.texels(&[wanted], channels, Scale::Full);
        assert!(matches!(result, Err(Error::Query { .. })), "{result:?}");
    }
    let without = File::open(file_of(&cube(1), OPTIONS), Limits::default()).unwrap();
    assert!(without.channels().is_empty() && without.index().texel_bytes().is_empty());
    assert!(matches!(without.texels(&[(0, 0)], &[0], Scale::Full), Err(Error::Query { .. })));
    let none = without.texels(&[(0, 2)], &[], Scale::Full).unwrap();
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
        .find(|&root| !expected(&model, order[root as usize], 2, &[0, 1]).images.concat().concat().is_empty())
        .unwrap();
    let all = file.texels(&[(root, 2)], &[0, 1], Scale::Full).unwrap();
    let requests = file.source().take();
    // The table has one chunk; streams of a block are adjacent.
    let table = u64::from(file.index().cluster_count()) * 16 + 12;
    assert_eq!(requests.len(), 3, "{requests:?}");
    assert_eq!(requests[0], texels.start..texels.start + table);
    let own = (all[0].map.len() + all[0].images.concat().concat().len()) as u64;
    assert_eq!(requests[2].end - requests[2].start, own);
    // Table and directories stay.
    file.texels(&[(root, 2)], &[0, 1], Scale::Eighth).unwrap();
    assert_eq!(file.source().take(), [requests[2].clone()]);
    file.texels(&[(root, 2)], &[0], Scale::Full).unwrap();
    let first = file.source().take();
    assert_eq!(first[0].end - first[0].start, (all[0].map.len() + all[0].images[0].concat().len()) as u64);
}

#[test]
fn without_a_source_the_same_texels_are_asked_for_and_found() {
    let (_, bytes, _) = channels(6, 0);
    let file = File::open(Recording::new(bytes.clone()), Limits::default()).unwrap();
    let wanted: Vec<(u32, u8)> = (0..file.root_count()).step_by(7).map(|root| (root, (root % 3) as u8)).collect();
    let found = file.texels(&wanted, &[1], Scale::Full).unwrap();

    let read = |range: Range<u64>| bytes[range.start as usize..(range.end as usize).min(bytes.len())].to_vec();
    let mut asked = vec![Opener::FIRST_READ];
    let mut opener = Opener::new(Limits::default());
    opener.start(read(Opener::FIRST_READ), bytes.len() as u64);
    let index = opener.finish().unwrap();
    let mut fetched = index.fetched();
    let answer: Result<Vec<TexelBytes>> = loop {
        match index.texels(&wanted, &[1], Scale::Full, &fetched) {
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
    let again = index.texels(&wanted, &[1], Scale::Full, &Fetched::default());
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
        assert_eq!(file.texels(&all, &[0, 1], Scale::Full).unwrap_err().to_string(), error, "byte {at}");
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
    // Four streams of an image where there is one, and numbers in scales.
    refused(&|model| model.channels[0].is_scaled = true);
    refused(&|model| model.channels[1].is_scaled = true);
    refused(&|model| model.channels = vec![]);
    refused(&|model| drop(model.channels.pop()));
    refused(&|model| model.roots[5].blocks[0].as_mut().unwrap().texels = vec![vec![]; 4]);
}
