//! Truncated and flipped files are never trusted and never panic.

use crate::build_mesh;
use lodpack::{File, Limits, Query};
use lodpack_tests::generate::{bumpy_sphere, punched_sheet};

/// Positions and triangles.
type Geometry = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// The finest mesh of a file, or the error of reading it.
fn read_all(bytes: &[u8]) -> lodpack::Result<Geometry> {
    let file = File::open(bytes, Limits::default())?;
    file.verify_checksums()?;
    let mesh = file.extract(&file.select(&Query::default())?)?;
    Ok((mesh.positions, mesh.triangles))
}

#[test]
fn a_file_cut_off_at_any_byte_gives_an_error() {
    let (bytes, _) = build_mesh(&bumpy_sphere(8), "auto");
    read_all(&bytes).expect("the whole file is sound");
    for length in 0..bytes.len() {
        assert!(read_all(&bytes[..length]).is_err(), "{length} of {} bytes were accepted", bytes.len());
    }
}

#[test]
fn flipped_bits_never_give_wrong_geometry_silently() {
    let (mut bytes, _) = build_mesh(&punched_sheet(48), "auto");
    let sound = read_all(&bytes).expect("the whole file is sound");
    // A fixed sequence of 10,000 positions spread over the file.
    let bit_count = bytes.len() as u64 * 8;
    for i in 0..10_000u64 {
        let bit = i.wrapping_mul(0x9E37_79B9_7F4A_7C15) % bit_count;
        bytes[(bit / 8) as usize] ^= 1 << (bit % 8);
        if let Ok(read) = read_all(&bytes) {
            assert!(read == sound, "bit {bit} changes the geometry unnoticed");
        }
        bytes[(bit / 8) as usize] ^= 1 << (bit % 8);
    }
}

#[test]
fn appended_bytes_are_noticed_or_harmless() {
    let (mut bytes, _) = build_mesh(&bumpy_sphere(8), "auto");
    let sound = read_all(&bytes).expect("the whole file is sound");
    bytes.extend([0; 100]);
    if let Ok(read) = read_all(&bytes) {
        assert!(read == sound);
    }
}
