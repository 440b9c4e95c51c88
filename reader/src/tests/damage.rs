//! Damaged files are named, never trusted: no panic, no wrong geometry.

use super::{
    cuts::open_edges,
    synthetic::{Options, Random, cube, file_of},
};
use crate::{
    File, Limits, Mesh, Query, Result,
    codec::bytes::Cursor,
    format::{
        header::kind,
        sections::{Part, write_clusters},
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
    let bytes = file_of(&cube(1), OPTIONS);
    draw(&bytes).unwrap();
    assert!((0..bytes.len()).all(|end| draw(&bytes[..end]).is_err()));
    let longer: Vec<u8> = bytes.iter().copied().chain([0]).collect();
    assert!(draw(&longer).is_err());
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
    let bytes = file_of(&cube(1), OPTIONS);
    let good = draw(&bytes).unwrap();
    let mut changed = bytes.clone();
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

/// Makes all checksums of a changed file right again; `good` is the file before the change.
pub(super) fn reseal(good: &[u8], changed: &[u8]) -> Vec<u8> {
    let file = File::open(good, Limits::default()).unwrap();
    let mut header = file.index().header().clone();
    let range = |kind| {
        let section = file.index().header().section(kind).unwrap();
        section.offset as usize..(section.offset + section.length) as usize
    };
    let mut bytes = changed.to_vec();
    if bytes[range(kind::CLUSTERS)] == good[range(kind::CLUSTERS)] {
        let mut clusters = file.index().clusters().to_vec();
        for (number, cluster) in (0..).zip(&mut clusters) {
            let start = range(kind::INDEX).start + cluster.index.offset as usize;
            let block = start..start + cluster.index.length as usize;
            for (place, part) in stream_checksums(&file, number, &good[block.clone()]) {
                let first = range(kind::PAGES).start + part.offset as usize;
                let checksum = crc32fast::hash(&changed[first..first + part.length as usize]);
                bytes[start + place..start + place + 4].copy_from_slice(&checksum.to_le_bytes());
            }
            cluster.index.checksum = crc32fast::hash(&bytes[block]);
        }
        bytes[range(kind::CLUSTERS)].copy_from_slice(&write_clusters(&clusters));
    }
    for section in header.sections.iter_mut().filter(|section| section.checksum.is_some()) {
        section.checksum = Some(crc32fast::hash(&bytes[range(section.kind)]));
    }
    let head = header.write();
    bytes[..head.len()].copy_from_slice(&head);
    bytes
}

#[test]
fn hostile_files_with_right_checksums_never_panic() {
    let limits =
        Limits { root_count: 1 << 10, root_vertex_count: 1 << 10, cluster_record_count: 1 << 12, part_bytes: 1 << 20 };
    for (seed, grids_of_four) in [(1, 0), (2, 2)] {
        let good = file_of(&cube(1), Options { levels: 3, seed, grids_of_four, heights: 0 });
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
                file.verify()
            });
            refused += usize::from(result.is_err());
        }
        assert!(refused > 1000, "{refused}");
    }
}
