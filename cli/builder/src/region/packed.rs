//! Meshes in few bytes, for files that every worker writes and reads: differences of numbers, each in as many bytes as
//! it takes.
//!
//! Numbers are written in groups of seven bits, the lowest first; the high bit says that another group follows. Signed
//! numbers alternate: 0, -1, 1, -2 and so on. Neighbours in an input usually have near numbers, so a triangle takes
//! about four bytes and its neighbours two to three. A general compressor makes hardly less of this, and takes more
//! time than everything else that a stage does with a file.

use glam::DVec3;

use lodpack_mesh::NONE;
use lodpack_runtime::storage::Record;

/// Appends triangles: the first corner less that of the triangle before, the others less the first.
pub(super) fn put_triangles(bytes: &mut Vec<u8>, triangles: &[[u32; 3]]) {
    let mut before = 0;
    for &[a, b, c] in triangles {
        [a.wrapping_sub(before), b.wrapping_sub(a), c.wrapping_sub(a)].into_iter().for_each(|by| put_signed(bytes, by));
        before = a;
    }
}

/// The given number of triangles. None if there are fewer.
pub(super) fn get_triangles(bytes: &mut &[u8], count: usize) -> Option<Vec<[u32; 3]>> {
    // Each takes three bytes at least.
    if count > bytes.len() / 3 {
        return None;
    }
    let (mut triangles, mut before) = (Vec::with_capacity(count), 0_u32);
    for _ in 0..count {
        before = before.wrapping_add(get_signed(bytes)?);
        triangles.push([before, before.wrapping_add(get_signed(bytes)?), before.wrapping_add(get_signed(bytes)?)]);
    }
    Some(triangles)
}

/// Appends ascending numbers.
pub(super) fn put_ascending(bytes: &mut Vec<u8>, numbers: &[u32]) {
    let mut before = 0;
    for &number in numbers {
        put_number(bytes, number.wrapping_sub(before));
        before = number;
    }
}

/// The given number of ascending numbers. None if there are fewer.
pub(super) fn get_ascending(bytes: &mut &[u8], count: usize) -> Option<Vec<u32>> {
    if count > bytes.len() {
        return None;
    }
    let mut before = 0_u32;
    let next = |_| {
        before = before.wrapping_add(get_number(bytes)?);
        Some(before)
    };
    (0..count).map(next).collect()
}

/// Appends which half-edges are opposite each other: for each whose partner is not known yet, how far on that lies,
/// or 0.
pub(super) fn put_opposites(bytes: &mut Vec<u8>, opposites: &[u32]) {
    for (half_edge, &opposite) in (0..).zip(opposites) {
        if opposite == NONE {
            put_number(bytes, 0);
        } else if opposite > half_edge {
            put_number(bytes, opposite - half_edge);
        }
        debug_assert!(
            opposite == NONE || opposites[opposite as usize] == half_edge,
            "half-edges are opposite each other"
        );
    }
}

/// The partners of the given number of half-edges. None if there are fewer, or two have the same.
pub(super) fn get_opposites(bytes: &mut &[u8], count: usize) -> Option<Vec<u32>> {
    // At most two are said by a byte.
    if count > bytes.len().saturating_mul(2) {
        return None;
    }
    let mut opposites = vec![NONE; count];
    for half_edge in 0..count {
        if opposites[half_edge] != NONE {
            continue;
        }
        let by = get_number(bytes)? as usize;
        if by > 0 {
            let opposite = opposites.get_mut(half_edge + by).filter(|opposite| **opposite == NONE)?;
            *opposite = half_edge as u32;
            opposites[half_edge] = (half_edge + by) as u32;
        }
    }
    Some(opposites)
}

/// Appends labels: runs of equal ones, each with its length and by how much its label is more than the one before.
pub(super) fn put_labels(bytes: &mut Vec<u8>, labels: &[u32]) {
    let mut before = 0;
    for run in labels.chunk_by(|a, b| a == b) {
        put_number(bytes, run.len() as u32);
        put_signed(bytes, run[0].wrapping_sub(before));
        before = run[0];
    }
}

/// The given number of labels. None if there are fewer or more.
pub(super) fn get_labels(bytes: &mut &[u8], count: usize) -> Option<Vec<u32>> {
    let (mut labels, mut before) = (vec![], 0_u32);
    while labels.len() < count {
        let length = get_number(bytes)? as usize;
        if length == 0 || length > count - labels.len() {
            return None;
        }
        before = before.wrapping_add(get_signed(bytes)?);
        labels.resize(labels.len() + length, before);
    }
    Some(labels)
}

/// Appends positions: with single precision if that is exact for all of them, as it is where an input has no more.
pub(super) fn put_positions(bytes: &mut Vec<u8>, positions: &[DVec3]) {
    let is_single = |x: f64| f64::from(x as f32).to_bits() == x.to_bits();
    let all_single = positions.iter().all(|position| position.to_array().into_iter().all(is_single));
    bytes.push(u8::from(all_single));
    for position in positions {
        match all_single {
            true => position.to_array().iter().for_each(|&x| (x as f32).put(bytes)),
            false => position.put(bytes),
        }
    }
}

/// The given number of positions. None if there are fewer.
pub(super) fn get_positions(bytes: &mut &[u8], count: usize) -> Option<Vec<DVec3>> {
    let (&all_single, rest) = bytes.split_first()?;
    let each = if all_single == 1 { 3 * f32::BYTES } else { DVec3::BYTES };
    let (positions, rest) = rest.split_at_checked(count.checked_mul(each)?)?;
    *bytes = rest;
    let single = |bytes: &[u8]| DVec3::from([0, 4, 8].map(|at| f64::from(f32::get(&bytes[at..]))));
    let position = |bytes| if all_single == 1 { single(bytes) } else { DVec3::get(bytes) };
    Some(positions.chunks_exact(each).map(position).collect())
}

#[inline]
fn put_number(bytes: &mut Vec<u8>, mut number: u32) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

#[inline]
fn get_number(bytes: &mut &[u8]) -> Option<u32> {
    let (mut number, mut shift) = (0, 0);
    loop {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7F) << shift;
        if byte < 0x80 {
            return u32::try_from(number).ok();
        }
        shift += 7;
        if shift > 28 {
            return None;
        }
    }
}

/// The number may be a difference below 0, in two's complement.
#[inline]
fn put_signed(bytes: &mut Vec<u8>, number: u32) {
    let sign = (number as i32 >> 31) as u32;
    put_number(bytes, number << 1 ^ sign);
}

#[inline]
fn get_signed(bytes: &mut &[u8]) -> Option<u32> {
    let number = get_number(bytes)?;
    Some(number >> 1 ^ (number & 1).wrapping_neg())
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_mesh::Adjacency;

    /// A grid with far numbers here and there.
    fn triangles() -> Vec<[u32; 3]> {
        let grid = (0..30_u32).flat_map(|y| (0..40).map(move |x| y * 41 + x));
        let mut triangles: Vec<[u32; 3]> = grid.flat_map(|a| [[a, a + 1, a + 42], [a, a + 42, a + 41]]).collect();
        triangles.extend([[0, u32::MAX, 1 << 31], [u32::MAX, 0, 7], [300_000, 5, (1 << 31) - 1]]);
        triangles
    }

    #[test]
    fn what_is_packed_comes_back() {
        let (triangles, mut bytes) = (triangles(), vec![]);
        put_triangles(&mut bytes, &triangles);
        assert!(bytes.len() < 4 * triangles.len() + 30, "{} bytes", bytes.len());
        let opposites = Adjacency::new(&triangles[..2400], 41 * 31).opposite;
        put_opposites(&mut bytes, &opposites);
        let labels: Vec<u32> = (0..2400).map(|t: u32| if t % 700 == 3 { u32::MAX } else { t / 100 * 7 % 11 }).collect();
        put_labels(&mut bytes, &labels);
        let numbers = [0, 5, 6, 6, 1 << 30, u32::MAX];
        put_ascending(&mut bytes, &numbers);
        let single: Vec<DVec3> = (0..50).map(|i| DVec3::new(f64::from(i) * 0.5, -0.0, 1e-40_f32.into())).collect();
        let double = [DVec3::splat(0.1), DVec3::splat(1e300)];
        put_positions(&mut bytes, &single);
        put_positions(&mut bytes, &double);
        let mut rest = &bytes[..];
        assert_eq!(get_triangles(&mut rest, triangles.len()), Some(triangles));
        assert_eq!(get_opposites(&mut rest, opposites.len()), Some(opposites));
        assert_eq!(get_labels(&mut rest, labels.len()), Some(labels));
        assert_eq!(get_ascending(&mut rest, numbers.len()).as_deref(), Some(&numbers[..]));
        let before = rest.len();
        let back = get_positions(&mut rest, single.len()).unwrap();
        assert_eq!(before - rest.len(), 1 + 12 * single.len());
        assert_eq!(
            back.iter().map(|p| p.to_array().map(f64::to_bits)).collect::<Vec<_>>(),
            single.iter().map(|p| p.to_array().map(f64::to_bits)).collect::<Vec<_>>()
        );
        assert_eq!(get_positions(&mut rest, 2).as_deref(), Some(&double[..]));
        assert!(rest.is_empty());
    }

    #[test]
    fn what_is_cut_short_or_lies_is_refused() {
        let (triangles, mut bytes) = (triangles(), vec![]);
        put_triangles(&mut bytes, &triangles);
        let last = bytes.len() - 1;
        assert_eq!(get_triangles(&mut &bytes[..last], triangles.len()), None);
        assert_eq!(get_triangles(&mut &bytes[..], usize::MAX), None);
        assert_eq!(get_ascending(&mut &[1_u8, 2][..], usize::MAX), None);
        assert_eq!(get_labels(&mut &[5_u8, 0][..], 4), None);
        assert_eq!(get_labels(&mut &[0_u8, 0][..], 4), None);
        assert_eq!(get_opposites(&mut &[9_u8; 9][..], 6), None, "beyond the end");
        assert_eq!(get_opposites(&mut &[2_u8, 1, 0][..], 3), None, "two have the same partner");
        assert_eq!(get_positions(&mut &[1_u8; 12][..], 1), None);
        assert_eq!(get_positions(&mut &[0_u8; 30][..], usize::MAX), None);
        assert_eq!(get_number(&mut &[0xFF_u8; 9][..]), None);
        assert_eq!(get_number(&mut &[0xFF_u8, 0xFF, 0xFF, 0xFF, 0x7F][..]), None);
        assert_eq!(get_number(&mut &[0xFF_u8, 0xFF, 0xFF, 0xFF, 0x0F][..]), Some(u32::MAX));
    }
}
