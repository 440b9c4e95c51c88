//! Damaged files are named, never trusted: no panic, no wrong geometry.

use super::{
    cuts::open_edges,
    synthetic::{Options, Random, cube, file_of, file_with_channels, listed_file_of},
};
use crate::{
    File, Limits, Mesh, Query, Result,
    codec::bytes::Cursor,
    format::{
        cluster_lists::{parse_clusters, parse_list, write_clusters, write_list},
        clusters::Entry,
        header::kind,
        sections::{Extent, Part},
        texels::{chunk_extent, chunk_of},
    },
};

const OPTIONS: Options = Options { levels: 3, seed: 8, grids_of_four: 1, heights: 0 };

fn draw(bytes: &[u8]) -> Result<Mesh> {
    let file = File::open(bytes, Limits::default())?;
    let cut = file.select(&Query::default())?;
    file.extract(&cut)
}

#[test]
fn truncation_at_every_byte_is_an_error() {
    for bytes in [file_of(&cube(1), OPTIONS), file_with_channels(&cube(1), OPTIONS)] {
        draw(&bytes).unwrap();
        assert!((0..bytes.len()).all(|end| draw(&bytes[..end]).is_err()));
        let longer: Vec<u8> = bytes.iter().copied().chain([0]).collect();
        assert!(draw(&longer).is_err());
    }
}

#[test]
fn prefixes_draw_what_they_hold_or_nothing() {
    let bytes = file_of(&cube(1), OPTIONS);
    let whole = File::open(bytes.as_slice(), Limits::default()).unwrap();
    for end in 0..bytes.len() {
        if let Ok(file) = File::open_prefix(&bytes[..end], Limits::default()) {
            let cut = file.select(&Query::default()).unwrap();
            assert_eq!(file.extract(&cut).unwrap(), whole.extract(&cut).unwrap());
        }
    }
}

#[test]
fn every_flipped_bit_is_found() {
    every_flipped_bit(&file_of(&cube(1), OPTIONS));
    every_flipped_bit(&file_with_channels(&cube(1), OPTIONS));
}

fn every_flipped_bit(bytes: &[u8]) {
    let good = draw(bytes).unwrap();
    let mut changed = bytes.to_vec();
    for bit in 0..bytes.len() * 8 {
        changed[bit / 8] ^= 1 << (bit % 8);
        assert!(File::open(changed.as_slice(), Limits::default()).and_then(|file| file.verify_checksums()).is_err());
        if let Ok(mesh) = draw(&changed) {
            assert_eq!(mesh, good, "bit {bit}");
        }
        changed[bit / 8] ^= 1 << (bit % 8);
    }
}

/// Where an index block has the checksums of its streams, and which streams these are.
fn stream_checksums(file: &File<&[u8]>, number: u32, block: &[u8]) -> Vec<(usize, Part)> {
    let mut cursor = Cursor::new(block);
    for _ in 0..2 {
        let length = cursor.varint().unwrap();
        cursor.bytes(length as usize).unwrap();
    }
    let index = file.cluster_index(number).unwrap();
    let mut places = Vec::new();
    for part in
        (0..file.level_count() as u8).flat_map(|level| index.parts(file.index().levels().index_arc_levels, level))
    {
        assert_eq!(cursor.varint().unwrap(), part.length);
        if part.length > 0 {
            places.push((block.len() - cursor.left(), part));
            cursor.u32().unwrap();
        }
    }
    cursor.finish().unwrap();
    places
}

/// Makes the checksums of what entries stand for right again, where that was not changed itself.
fn reseal_entries(file: &File<&[u8]>, good: &[u8], bytes: &mut [u8], mut entries: Vec<Entry>) -> Vec<Entry> {
    let start = |kind| file.index().header().section(kind).unwrap().offset as usize;
    for entry in &mut entries {
        let first = start(kind::INDEX) + entry.sums.index.offset as usize;
        let range = first..first + entry.sums.index.length as usize;
        if entry.height > 0 && bytes[range.clone()] == good[range.clone()] {
            let below = parse_list(&good[range.clone()], entry, &Limits::default()).unwrap();
            let below = reseal_entries(file, good, bytes, below);
            bytes[range.clone()].copy_from_slice(&write_list(&below));
        } else if entry.height == 0 {
            for (place, part) in stream_checksums(file, entry.first_cluster, &good[range.clone()]) {
                let page = start(kind::PAGES) + part.offset as usize;
                let checksum = crc32fast::hash(&bytes[page..page + part.length as usize]);
                bytes[first + place..first + place + 4].copy_from_slice(&checksum.to_le_bytes());
            }
        }
        entry.sums.index.checksum = crc32fast::hash(&bytes[range]);
    }
    entries
}

/// Makes the checksums in section TEXELS right again, where they were not changed themselves.
fn reseal_texels(file: &File<&[u8]>, good: &[u8], bytes: &mut [u8]) {
    let Some(section) = file.index().header().section(kind::TEXELS) else { return };
    let (start, cluster_count) = (section.offset as usize, file.index().cluster_count());
    for cluster in 0..cluster_count {
        let directory = file.ask(|index, fetched| index.texel_entry(cluster, fetched)).unwrap().directory;
        let range = start + directory.offset as usize..start + (directory.offset + directory.length) as usize;
        let streams = file.ask(|index, fetched| index.texel_directory(cluster, fetched)).unwrap().unwrap();
        let mut cursor = Cursor::new(&good[range.clone()]);
        for (_, part) in streams.streams().filter(|_| bytes[range.clone()] == good[range.clone()]).collect::<Vec<_>>() {
            assert_eq!(cursor.varint().unwrap(), part.length);
            if part.length > 0 {
                let place = range.end - cursor.left();
                cursor.u32().unwrap();
                let first = start + part.offset as usize;
                let checksum = crc32fast::hash(&bytes[first..first + part.length as usize]);
                bytes[place..place + 4].copy_from_slice(&checksum.to_le_bytes());
            }
        }
        let Extent { offset, .. } = chunk_extent(chunk_of(cluster), cluster_count);
        let entry = start + offset as usize + 16 * (cluster % 256) as usize;
        if directory.length > 0 {
            let checksum = crc32fast::hash(&bytes[range]);
            bytes[entry + 12..entry + 16].copy_from_slice(&checksum.to_le_bytes());
        }
    }
    for cluster in (0..cluster_count).step_by(256) {
        let Extent { offset, length } = chunk_extent(chunk_of(cluster), cluster_count);
        let (chunk, end) = (start + offset as usize, start + (offset + length) as usize);
        let checksum = crc32fast::hash(&bytes[chunk..end - 4]);
        bytes[end - 4..end].copy_from_slice(&checksum.to_le_bytes());
    }
}

/// Makes all checksums of a changed file right again; `good` is the file before the change.
pub(super) fn reseal(good: &[u8], changed: &[u8]) -> Vec<u8> {
    let file = File::open(good, Limits::default()).unwrap();
    let mut header = file.index().header().clone();
    let range = |kind| {
        let section = file.index().header().section(kind).unwrap();
        section.offset as usize..(section.offset + section.length) as usize
    };
    let mut bytes = changed.to_vec();
    let clusters = range(kind::CLUSTERS);
    if bytes[clusters.clone()] == good[clusters.clone()] {
        let levels = file.index().levels();
        let length = file.index().header().section(kind::INDEX).unwrap().length;
        let top = parse_clusters(&good[clusters.clone()], levels, length, &Limits::default()).unwrap();
        let top = reseal_entries(&file, good, &mut bytes, top);
        bytes[clusters].copy_from_slice(&write_clusters(&top));
    }
    reseal_texels(&file, good, &mut bytes);
    for section in header.sections.iter_mut().filter(|section| section.checksum.is_some()) {
        section.checksum = Some(crc32fast::hash(&bytes[range(section.kind)]));
    }
    let head = header.write();
    bytes[..head.len()].copy_from_slice(&head);
    bytes
}

#[test]
fn hostile_files_with_right_checksums_never_panic() {
    let limits = Limits {
        root_count: 1 << 10,
        root_vertex_count: 1 << 10,
        cluster_record_count: 1 << 12,
        part_bytes: 1 << 20,
        texel_count: 1 << 16,
    };
    let of = |seed, grids_of_four| Options { levels: 3, seed, grids_of_four, heights: 0 };
    let goods = [
        file_of(&cube(1), of(1, 0)),
        file_of(&cube(1), of(2, 2)),
        listed_file_of(&cube(3), of(3, 0)),
        file_with_channels(&cube(1), of(4, 1)),
    ];
    for (seed, good) in (1..).zip(goods) {
        let first = File::open(good.as_slice(), limits).unwrap().index().sections()[0].1 as usize;
        let mut random = Random::new(seed);
        let mut refused = 0;
        for bit in first * 8..good.len() * 8 {
            let mut changed = good.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            if random.below(2) == 0 {
                let at = first + random.below((good.len() - first) as u64) as usize;
                changed[at] = random.below(256) as u8;
            }
            let sealed = reseal(&good, &changed);
            let result = File::open(sealed.as_slice(), limits).and_then(|file| {
                let cut = file.select(&Query::default())?;
                let mesh = file.extract(&cut)?;
                assert_eq!(mesh.triangles.len() as u64, cut.triangle_count);
                assert_eq!(open_edges(&mesh), 0, "borders match whatever the samples are");
                let channels: Vec<u8> = (0..file.channels().len() as u8).collect();
                let nodes: Vec<(u32, u8)> = cut.nodes.iter().map(|node| (node.root, node.level)).collect();
                if let Ok(texels) = file.texels(&nodes, &channels, crate::index::Scale::Full) {
                    assert!(texels.iter().all(|texels| texels.images.len() == channels.len()));
                }
                file.verify()
            });
            refused += usize::from(result.is_err());
        }
        assert!(refused > 1000, "{refused}");
    }
}
