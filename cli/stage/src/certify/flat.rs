//! Flat regions that are triangulated otherwise, such as the cap of a cylinder whose middle is gone.
//!
//! # Why the bound holds
//!
//! Two sets of triangles whose oriented boundaries are the same are seen from a direction in which all of their
//! triangles face up. How many of a set's triangles lie over a point is then how often its boundary winds around the
//! point, and that is the same for both. So both cover the same points, whatever else is known of them, and over each
//! point both have heights between the least and the largest one of a vertex.

use glam::DVec3;

use lodpack_mesh::union_find::{find, unite};

/// The least cosine between the normals of neighbours in a region, and between each of them and their mean.
const ALIKE: f64 = 0.9;
/// Triangles that are thinner than this share of their length have no direction.
const THIN: f64 = 1e-9;

/// Which triangles of two sets lie in flat regions.
#[derive(Debug)]
pub(super) struct Flat {
    /// Of each triangle of each of the sets.
    pub is_flat: [Vec<bool>; 2],
    /// How far a point of these is at most from what the other set has there.
    pub height: f64,
}

/// A triangle of one of the sets.
struct Facing {
    /// Twice the area, along the normal; none if it has no direction.
    doubled_area: Option<DVec3>,
    corners: [u32; 3],
    set: usize,
}

impl Flat {
    /// Regions that are flat enough. Vertices of both sets are numbered alike, and `place` says where they are.
    pub fn new(sets: [&[[u32; 3]]; 2], place: impl Fn(u32) -> DVec3, enough: f64) -> Self {
        let facing = |&corners: &[u32; 3], set: usize| Facing { doubled_area: area(corners.map(&place)), corners, set };
        let triangles: Vec<Facing> =
            (0..2).flat_map(|set| sets[set].iter().map(move |corners| facing(corners, set))).collect();
        let mut this = Self { is_flat: sets.map(|set| vec![false; set.len()]), height: 0.0 };
        for region in regions(&triangles) {
            let members: Vec<&Facing> = region.iter().map(|&t| &triangles[t]).collect();
            if let Some(height) = height(&members, &place).filter(|&height| height <= enough) {
                this.height = this.height.max(height);
                for &t in &region {
                    let set = triangles[t].set;
                    this.is_flat[set][t - set * sets[0].len()] = true;
                }
            }
        }
        this
    }
}

/// Twice the area of a triangle, along its normal, if it has a direction.
fn area([a, b, c]: [DVec3; 3]) -> Option<DVec3> {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    Some((b - a).cross(c - a)).filter(|area| area.length() > THIN * longest)
}

fn is_alike(one: DVec3, other: DVec3) -> bool {
    one.dot(other) >= ALIKE * one.length() * other.length()
}

/// An edge from its lesser vertex, and whether a triangle has it in this direction.
fn edges([a, b, c]: [u32; 3]) -> [([u32; 2], bool); 3] {
    [[a, b], [b, c], [c, a]].map(|[from, to]| ([from.min(to), from.max(to)], from < to))
}

/// Sets of triangles of which neighbours face alike, in whichever set they are. Each has the numbers of its triangles,
/// ascending.
fn regions(triangles: &[Facing]) -> Vec<Vec<usize>> {
    let mut beside: Vec<([u32; 2], u32)> = vec![];
    for (number, Facing { corners, .. }) in (0..).zip(triangles) {
        beside.extend(edges(*corners).map(|(edge, _)| (edge, number)));
    }
    beside.sort_unstable();
    let mut region: Vec<u32> = (0..triangles.len() as u32).collect();
    for around in beside.chunk_by(|one, other| one.0 == other.0) {
        for (k, &(_, one)) in around.iter().enumerate() {
            // Four have an edge in common where both sets are surfaces.
            for &(_, other) in &around[k + 1..around.len().min(k + 4)] {
                let areas = [one, other].map(|number| triangles[number as usize].doubled_area);
                if let [Some(a), Some(b)] = areas
                    && is_alike(a, b)
                {
                    unite(&mut region, one, other);
                }
            }
        }
    }
    let mut found: Vec<(u32, usize)> = (0..triangles.len()).map(|t| (find(&mut region, t as u32), t)).collect();
    found.sort_unstable();
    found.chunk_by(|one, other| one.0 == other.0).map(|some| some.iter().map(|&(_, t)| t).collect()).collect()
}

/// The difference of heights in a region; none if its triangles do not all face up, or have other boundaries in the two
/// sets.
fn height(members: &[&Facing], place: impl Fn(u32) -> DVec3) -> Option<f64> {
    let areas: Option<Vec<DVec3>> = members.iter().map(|triangle| triangle.doubled_area).collect();
    let (areas, up) = areas.and_then(|areas| areas.iter().sum::<DVec3>().try_normalize().map(|up| (areas, up)))?;
    if !areas.iter().all(|&area| is_alike(area, up)) {
        return None;
    }
    let mut boundary: Vec<([u32; 2], i32)> = vec![];
    for Facing { corners, set, .. } in members {
        boundary.extend(edges(*corners).map(|(edge, forward)| (edge, if forward == (*set == 0) { 1 } else { -1 })));
    }
    boundary.sort_unstable();
    let is_same = |edge: &[([u32; 2], i32)]| edge.iter().map(|(_, sign)| sign).sum::<i32>() == 0;
    if !boundary.chunk_by(|one, other| one.0 == other.0).all(is_same) {
        return None;
    }
    let base = members.first().map(|triangle| place(triangle.corners[0]))?;
    let heights = members.iter().flat_map(|triangle| triangle.corners).map(|v| (place(v) - base).dot(up));
    let [low, high] = heights.fold([0.0f64; 2], |[low, high], height| [low.min(height), high.max(height)]);
    Some(high - low)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A fan around the middle of a polygon with the given number of corners on a circle; the middle is the last
    /// vertex.
    pub fn cap(count: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        // Without sines, which differ between machines.
        let corner = |k: u32| {
            let t = 2.0 * f64::from(k) / f64::from(count) - 1.0;
            let half = |t: f64| DVec3::new(1.0 - t * t, 2.0 * t, 0.0) / (1.0 + t * t);
            let point = half(t);
            // The other half of the circle: the angle is doubled.
            DVec3::new(point.x * point.x - point.y * point.y, 2.0 * point.x * point.y, 0.0)
        };
        let positions = (0..count).map(corner).chain([DVec3::ZERO]).collect();
        (positions, (0..count).map(|k| [k, (k + 1) % count, count]).collect())
    }

    /// The polygon from one of its corners.
    pub fn around(apex: u32, count: u32) -> Vec<[u32; 3]> {
        (1..count - 1).map(|k| [apex, (apex + k) % count, (apex + k + 1) % count]).collect()
    }

    #[test]
    fn caps_lie_where_they_were() {
        let (positions, fan) = cap(24);
        for apex in [0, 5] {
            let flat = Flat::new([&fan, &around(apex, 24)], |v| positions[v as usize], 1e-3);
            assert!(flat.is_flat.iter().flatten().all(|&is_flat| is_flat) && flat.height < 1e-12, "{flat:?}");
        }
    }

    #[test]
    fn what_is_not_flat_enough_or_covers_less_is_left() {
        let (mut positions, fan) = cap(24);
        let none_is = |positions: &[DVec3], other: &[[u32; 3]], enough: f64| {
            let flat = Flat::new([&fan, other], |v| positions[v as usize], enough);
            flat.is_flat.iter().flatten().all(|&is_flat| !is_flat)
        };
        let mut other = around(3, 24);
        assert!(!none_is(&positions, &other, 0.1));
        // A triangle is missing, a triangle lies upside down over others, or nothing may be far.
        other.pop();
        assert!(none_is(&positions, &other, 0.1));
        assert!(none_is(&positions, &around(3, 24), -1.0));
        positions[24] = DVec3::new(1.5, 0.1, 0.0);
        assert!(none_is(&positions, &around(3, 24), 0.1));
        // The middle is higher than what is allowed.
        positions[24] = DVec3::new(0.0, 0.0, 0.05);
        assert!(none_is(&positions, &around(3, 24), 0.04));
        let flat = Flat::new([&fan, &around(3, 24)], |v| positions[v as usize], 0.06);
        assert!((0.05..0.0501).contains(&flat.height), "{flat:?}");
    }

    #[test]
    fn both_sides_of_a_prism_are_regions_of_their_own() {
        let (positions, bottom) = cap(24);
        let place = |v: u32| positions[v as usize % 25] + DVec3::Z * f64::from(v / 25) * 3.0;
        let both = |cap: &[[u32; 3]]| -> Vec<[u32; 3]> {
            let top = cap.iter().map(|corners| corners.map(|v| v + 25));
            cap.iter().map(|&[a, b, c]| [a, c, b]).chain(top).collect()
        };
        let flat = Flat::new([&both(&bottom), &both(&around(7, 24))], place, 1e-3);
        assert!(flat.is_flat.iter().flatten().all(|&is_flat| is_flat) && flat.height < 1e-12, "{flat:?}");
    }
}
