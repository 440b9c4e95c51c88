//! The checks of the fuzz targets, on a few thousand changed files with right checksums.

use std::path::Path;

use super::{
    damage::reseal,
    objects,
    painted::painted_file,
    synthetic::{Options, Random, cube, file_of, file_with_channels, listed_file_of},
    terrain::Terrain,
};
use crate::{File, Limits, codec::bytes::ANY_CHECKSUM};

#[allow(dead_code, reason = "a library there, a module here")]
#[path = "../../fuzz/src/checks.rs"]
mod checks;

/// How often each file is changed.
const CHANGES: usize = 100;

/// The valid vectors of the format.
fn vectors() -> Vec<Vec<u8>> {
    let vectors = Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors");
    let mut paths: Vec<_> = std::fs::read_dir(vectors).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "lodpack"));
    paths.sort();
    assert!(paths.len() > 10);
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

fn check_all(bytes: &[u8]) {
    checks::open(bytes);
    checks::index(bytes);
    checks::page(bytes);
    checks::session(bytes);
}

#[test]
fn changed_heights_are_refused_or_keep_every_promise() {
    let island = |column: u64, row: u64| column.abs_diff(40).pow(2) + row.abs_diff(20).pow(2) < 250;
    let terrains = [
        Terrain::plane([100, 70]),
        Terrain::plane([100, 70]).with_cells(island),
        Terrain::globe([90, 45]),
        Terrain::plane([1100, 2]),
    ];
    ANY_CHECKSUM.set(true);
    let mut random = Random::new(6);
    for good in terrains.map(|terrain| terrain.file(20.0)) {
        checks::heights(&good);
        for _ in 0..CHANGES {
            let mut changed = good.clone();
            for _ in 0..=random.below(4) {
                let at = random.below(good.len() as u64) as usize;
                changed[at] = [0, 1, 0x7f, 0x80, 0xff, random.below(256) as u8][random.below(6) as usize];
            }
            checks::heights(&changed);
            checks::open(&changed);
            checks::heights(&good[..random.below(good.len() as u64) as usize]);
        }
    }
    ANY_CHECKSUM.set(false);
}

#[test]
fn changed_vectors_are_refused_or_keep_every_promise() {
    check_changed(vectors());
}

#[test]
fn changed_files_of_several_clusters_are_refused_or_keep_every_promise() {
    let options = Options { levels: 3, seed: 1, grids_of_four: 1, heights: 0 };
    let of = |seed, heights| file_of(&cube(2), Options { seed, grids_of_four: seed, heights, ..options });
    let listed = listed_file_of(&cube(4), Options { seed: 4, ..options });
    let channels = |n, heights| file_with_channels(&cube(n), Options { heights, ..options });
    let painted = |n, heights| painted_file(&cube(n), Options { heights, ..options });
    let with_channels = [channels(4, 0), channels(2, 2), painted(2, 0), painted(2, 2)];
    let named = [objects::file_of(1, 3, 4), objects::file_of(2, 40, 3)];
    let files = [of(1, 0), of(2, 0), of(1, 2), of(3, 2), listed];
    check_changed(files.into_iter().chain(with_channels).chain(named).collect());
}

fn check_changed(seeds: Vec<Vec<u8>>) {
    let mut random = Random::new(5);
    for good in seeds {
        check_all(&good);
        let first = File::open(good.as_slice(), Limits::default()).unwrap().index().sections()[0].1;
        for _ in 0..CHANGES {
            let mut changed = good.clone();
            for _ in 0..=random.below(3) {
                let at = (first + random.below((good.len() as u64 - first).max(1))) as usize;
                let Some(byte) = changed.get_mut(at) else { continue };
                match random.below(3) {
                    0 => *byte ^= 1 << random.below(8),
                    1 => *byte = [0, 1, 0x7f, 0x80, 0xff][random.below(5) as usize],
                    _ => *byte = random.below(256) as u8,
                }
            }
            check_all(&reseal(&good, &changed));
            check_all(&good[..random.below(good.len() as u64) as usize]);
        }
    }
}
