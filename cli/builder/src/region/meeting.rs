//! Which objects of an input meet at open edges, as the tiles of a scan do: such objects are one surface that somebody
//! has cut, and would show cracks if each of them were simplified by itself.

use glam::DVec3;

use lodpack_mesh::attributes::Attributes;

/// Visits all triangles of an input in order.
pub type ForEachTriangle<'a, E> = dyn FnMut(&mut dyn FnMut([DVec3; 3])) -> Result<(), E> + 'a;

/// Slots of the table of places, by bytes of memory: at least, and at most.
const SLOTS: [u64; 2] = [1 << 16, 1 << 28];
/// Edges that are compared at a time, at least.
const LEAST_EDGES: u64 = 1 << 16;

/// With this many shares of edges, each is compared whatever it takes: very many may be one edge.
const MOST_SHARES: u64 = 4096;

/// A place that no object has, and one that several may have.
const FREE: u32 = u32::MAX;
const SEVERAL: u32 = u32::MAX - 1;

/// How many objects have an open edge, one with a single triangle of theirs, that is also an open edge of another one.
///
/// A table of hashed places tells most edges apart whose ends no other object has. The others are compared by hashes of
/// 128 bits of their ends, as many at a time as memory allows; the result does not depend on it. Triangles are visited
/// at least twice.
///
/// # Errors
/// Those of `for_each`.
pub fn meeting_objects<E>(
    attributes: &Attributes,
    triangles: u64,
    memory: u64,
    for_each: &mut ForEachTriangle<'_, E>,
) -> Result<u64, E> {
    let slots = triangles.saturating_mul(2).next_power_of_two().min(memory / 16 + 1);
    let slots = slots.clamp(SLOTS[0], SLOTS[1]).next_power_of_two();
    let mut places = vec![FREE; slots as usize];
    let mask = slots - 1;
    with_objects(attributes, for_each, &mut |object, corners| {
        for corner in corners {
            let place = &mut places[(hash(key(corner), SEEDS[0]) & mask) as usize];
            *place = if *place == FREE || *place == object { object } else { SEVERAL };
        }
    })?;
    let most = (memory / 8 / size_of::<Edge>() as u64).max(LEAST_EDGES) as usize;
    let mut meets = vec![false; attributes.nodes.len()];
    let (mut shares, mut share) = (1, 0);
    while share < shares {
        let mut edges: Vec<Edge> = vec![];
        with_objects(attributes, for_each, &mut |object, corners| {
            let keys = corners.map(key);
            let is_shared = keys.map(|key| places[(hash(key, SEEDS[0]) & mask) as usize] == SEVERAL);
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                if is_shared[a] && is_shared[b] && (edges.len() <= most || shares >= MOST_SHARES) {
                    let ends = [keys[a].min(keys[b]), keys[a].max(keys[b])];
                    let [one, other] = SEEDS.map(|seed| hash(ends[1], hash(ends[0], seed)));
                    if one % shares == share {
                        edges.push((one, other, object));
                    }
                }
            }
        })?;
        if edges.len() > most && shares < MOST_SHARES {
            // What earlier shares have found stays true.
            (shares, share) = (shares * 4, 0);
            continue;
        }
        edges.sort_unstable();
        for edge in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let open = || edge.chunk_by(|a, b| a.2 == b.2).filter(|of_object| of_object.len() == 1);
            if open().nth(1).is_some() {
                open().for_each(|of_object| meets[of_object[0].2 as usize] = true);
            }
        }
        share += 1;
    }
    Ok(meets.into_iter().filter(|&meets| meets).count() as u64)
}

/// The hashes of an edge, and the object of a triangle at it.
type Edge = (u64, u64, u32);

const SEEDS: [u64; 2] = [0x9E37_79B1_85EB_CA87, 0x1656_67B1_9E37_79F9];

/// Visits triangles with their objects.
fn with_objects<E>(
    attributes: &Attributes,
    for_each: &mut ForEachTriangle<'_, E>,
    visit: &mut dyn FnMut(u32, [DVec3; 3]),
) -> Result<(), E> {
    let (mut runs, mut number, mut object) = (attributes.objects.iter().peekable(), 0u32, 0);
    for_each(&mut |corners| {
        while let Some(run) = runs.next_if(|run| run.first_triangle <= number) {
            object = run.node;
        }
        number += 1;
        visit(object, corners);
    })
}

/// The bits of a position; 0.0 and -0.0 are the same.
fn key(position: DVec3) -> [u64; 3] {
    (position + DVec3::ZERO).to_array().map(f64::to_bits)
}

/// Mixes as SplitMix64 does.
fn hash(key: [u64; 3], seed: u64) -> u64 {
    key.into_iter().fold(seed, |hash, word| {
        let mut hash = (hash ^ word).wrapping_add(0x9E37_79B9_7F4A_7C15);
        hash = (hash ^ hash >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        hash = (hash ^ hash >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        hash ^ hash >> 31
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_mesh::attributes::{ObjectNode, ObjectRun};
    use std::convert::Infallible;

    fn meeting(objects: &[Vec<[DVec3; 3]>], memory: u64) -> u64 {
        let mut attributes = Attributes::default();
        let mut first_triangle = 0;
        for (node, triangles) in (0..).zip(objects) {
            attributes.nodes.push(ObjectNode::default());
            attributes.objects.push(ObjectRun { first_triangle, node });
            first_triangle += triangles.len() as u32;
        }
        let for_each = &mut |visit: &mut dyn FnMut([DVec3; 3])| -> Result<(), Infallible> {
            objects.iter().flatten().for_each(|&corners| visit(corners));
            Ok(())
        };
        match meeting_objects(&attributes, u64::from(first_triangle), memory, for_each) {
            Ok(count) => count,
            Err(never) => match never {},
        }
    }

    /// A sheet of n x n squares whose first corner is given.
    fn sheet(n: u32, at: DVec3) -> Vec<[DVec3; 3]> {
        let place = |x: u32, y: u32| at + DVec3::new(x.into(), y.into(), 0.0);
        let square = |x: u32, y: u32| {
            let [a, b, c, d] = [place(x, y), place(x + 1, y), place(x + 1, y + 1), place(x, y + 1)];
            [[a, b, c], [a, c, d]]
        };
        (0..n * n).flat_map(|i| square(i / n, i % n)).collect()
    }

    /// A tetrahedron.
    fn solid(at: DVec3) -> Vec<[DVec3; 3]> {
        let [a, b, c, d] = [at, at + DVec3::X, at + DVec3::Y, at + DVec3::Z];
        vec![[a, c, b], [a, b, d], [b, c, d], [c, a, d]]
    }

    #[test]
    fn tiles_meet_and_closed_objects_do_not() {
        let tiles = [0.0, 40.0, 80.0, 200.0].map(|x| sheet(40, DVec3::new(x, 0.0, 0.0)));
        // With little memory, edges are compared in shares.
        for memory in [0, 1 << 20, u64::MAX / 2] {
            assert_eq!(meeting(&tiles, memory), 3, "{memory}");
            assert_eq!(meeting(&[solid(DVec3::ZERO), solid(DVec3::ZERO), solid(DVec3::X)], memory), 0);
            let mixed = [sheet(3, DVec3::ZERO), solid(DVec3::ZERO), sheet(3, DVec3::Y * 3.0), solid(DVec3::ONE)];
            assert_eq!(meeting(&mixed, memory), 2);
            // The same sheet again and again: every edge is compared.
            let doubled: Vec<_> = (0..20).map(|_| sheet(60, DVec3::ZERO)).collect();
            assert_eq!(meeting(&doubled, memory), 20, "{memory}");
        }
        assert_eq!(meeting(&[sheet(3, DVec3::ZERO), sheet(3, DVec3::ONE * 3.0)], 1 << 20), 0, "one corner is no edge");
        assert_eq!(meeting(&[sheet(3, DVec3::ZERO)], 1 << 20), 0);
    }
}
