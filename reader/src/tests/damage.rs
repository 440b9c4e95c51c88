//! Damaged files are named, never trusted: no panic, no wrong geometry.

use super::synthetic::{Options, cube, file_of};
use crate::{File, Limits, Mesh, Query, Result};

const OPTIONS: Options = Options { levels: 3, seed: 8, grids_of_four: 1 };

fn draw(bytes: &[u8]) -> Result<Mesh> {
    let file = File::open(bytes, Limits::default())?;
    let cut = file.cut(&Query::default())?;
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
            let cut = file.cut(&Query::default()).unwrap();
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
