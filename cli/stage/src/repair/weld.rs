//! Welds vertices at exactly the same position, unless they are of different objects.

use glam::DVec3;

/// An empty slot of the table; no vertex has this number.
const EMPTY: u64 = u64::MAX;

/// Removes every vertex that repeats an earlier one and keeps the order of the others. Returns the new number of each
/// old vertex. `objects` are those of the vertices; it is empty where there is only one.
///
/// The hash table is open-addressed, with 8 bytes a slot: the upper half of the hash beside the number. So positions
/// are compared only when they are almost certainly equal.
pub(super) fn weld_vertices(positions: &mut Vec<DVec3>, mut objects: Vec<u32>) -> Vec<u32> {
    let capacity = (positions.len() + positions.len() / 2 + 1).next_power_of_two();
    let mask = capacity - 1;
    let mut table = vec![EMPTY; capacity];
    let mut new_number = Vec::with_capacity(positions.len());
    let mut kept = 0u32;
    for old in 0..positions.len() {
        let position = positions[old];
        let object = objects.get(old).copied();
        let hash = hash(position) ^ object.map_or(0, |object| u64::from(object).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let tag = hash >> 32 << 32;
        let mut slot = hash as usize & mask;
        let number = loop {
            let entry = table[slot];
            if entry == EMPTY {
                table[slot] = tag | u64::from(kept);
                positions[kept as usize] = position;
                object.into_iter().for_each(|object| objects[kept as usize] = object);
                kept += 1;
                break kept - 1;
            }
            let number = entry as u32;
            let is_same = (entry ^ tag) >> 32 == 0 && positions[number as usize] == position;
            if is_same && objects.get(number as usize).copied() == object {
                break number;
            }
            slot = (slot + 1) & mask;
        };
        new_number.push(number);
    }
    positions.truncate(kept as usize);
    new_number
}

/// Mixes the bits of the three coordinates. Adding zero turns -0.0 into 0.0.
fn hash(position: DVec3) -> u64 {
    let [x, y, z] = (position + DVec3::ZERO).to_array().map(f64::to_bits);
    // Odd constants from xxHash64, finalised as in SplitMix64.
    let mut hash = x.wrapping_mul(0x9E37_79B1_85EB_CA87)
        ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F).rotate_left(21)
        ^ z.wrapping_mul(0x1656_67B1_9E37_79F9).rotate_left(42);
    hash ^= hash >> 30;
    hash = hash.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    hash ^= hash >> 27;
    hash = hash.wrapping_mul(0x94D0_49BB_1331_11EB);
    hash ^ (hash >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_equal_positions_stays_and_zero_has_no_sign() {
        let mut positions = vec![DVec3::X, DVec3::ZERO, DVec3::X, DVec3::new(-0.0, 0.0, -0.0), DVec3::Y];
        assert_eq!(weld_vertices(&mut positions, vec![]), [0, 1, 0, 1, 2]);
        assert_eq!(positions, [DVec3::X, DVec3::ZERO, DVec3::Y]);
    }

    #[test]
    fn vertices_of_different_objects_stay_apart() {
        let mut positions = vec![DVec3::X, DVec3::ZERO, DVec3::X, DVec3::X, DVec3::ZERO, DVec3::X];
        assert_eq!(weld_vertices(&mut positions, vec![7, 7, 9, 7, 9, 9]), [0, 1, 2, 0, 3, 2]);
        assert_eq!(positions, [DVec3::X, DVec3::ZERO, DVec3::X, DVec3::ZERO]);
    }

    #[test]
    fn positions_one_rounding_step_apart_stay_apart() {
        let mut positions: Vec<DVec3> =
            (0..1000).map(|i| DVec3::splat(f64::from_bits(5e6f64.to_bits() + i / 2))).collect();
        let numbers = weld_vertices(&mut positions, vec![]);
        assert_eq!(positions.len(), 500);
        assert!((0..1000).all(|i| numbers[i] == i as u32 / 2));
        assert!(weld_vertices(&mut Vec::new(), vec![]).is_empty());
    }
}
