//! Vertices of a reduced cut of few triangles, moved one at a time so that it shows more.
//!
//! Where tens of triangles are left, collapsing edges has few places to choose from, and what colours a surface can
//! show depends on where its few edges run. So each vertex goes where the whole is better then: a search along axes
//! with steps that become smaller (Hooke and Jeeves 1961).

use glam::DVec3;

use super::cells::Sampled;
use super::grouped::Grouped;
use super::watched::Watched;
use lodpack_mesh::Mesh;

/// Steps begin with this share of the shortest edge at a vertex.
const FIRST_STEP: f64 = 0.5;
/// The same where vertices have been moved before.
const FIRST_STEP_AGAIN: f64 = 0.25;
/// Steps become half as long where no direction is better, and end with this share.
const LAST_STEP: f64 = 0.03;
/// How often all vertices are moved.
const ROUNDS: usize = 40;
/// The search ends where a round leaves more than this share of the value.
const GAIN: f64 = 0.997;
/// The number of triangles, of those that show most wrongly, whose edges are split.
const WORST: usize = 4;
/// The new vertex is moved this often before the results are compared.
const ROUNDS_OF_NEW: usize = 6;

/// A reduced cut with its vertices moved to where it shows most of a surface for its distance from that. None if
/// nothing is seen of it.
pub(super) fn moved_singly(surface: &Sampled, reduced: &Mesh) -> Option<Mesh> {
    let points = Grouped::new(surface);
    let mut watched = Watched::new(&points, reduced.positions.clone(), reduced.triangles.clone())?;
    search(&mut watched, 0, FIRST_STEP, ROUNDS);
    Some(Mesh { positions: watched.positions().to_vec(), triangles: reduced.triangles.clone() })
}

/// Moves the vertices once more, by a finer surface, and divides an edge where that is better and leaves at most `most`
/// triangles. Also returns for each triangle the number of the one that it was or was a part of.
pub(super) fn moved_again(surface: &Sampled, reduced: &Mesh, most: usize) -> Option<(Mesh, Vec<u32>)> {
    let points = Grouped::new(surface);
    let mut watched = Watched::new(&points, reduced.positions.clone(), reduced.triangles.clone())?;
    search(&mut watched, 0, FIRST_STEP_AGAIN, ROUNDS);
    let mut parts_of: Vec<u32> = (0..reduced.triangles.len() as u32).collect();
    if let Some(split) = best_split(&watched, most) {
        (watched, parts_of) = split;
        search(&mut watched, 0, FIRST_STEP_AGAIN, ROUNDS);
    }
    Some((Mesh { positions: watched.positions().to_vec(), triangles: watched.triangles().to_vec() }, parts_of))
}

/// A patch with that edge divided which gains most. None if none does with at most the given number of triangles.
fn best_split<'a>(watched: &Watched<'a>, most: usize) -> Option<(Watched<'a>, Vec<u32>)> {
    let room = most.saturating_sub(watched.triangles().len());
    let mut best: Option<(Watched<'a>, Vec<u32>)> = None;
    for edge in watched.worst_edges(WORST) {
        if watched.triangles_at(edge).len() > room {
            continue;
        }
        let Some((mut split, parts_of)) = watched.split(edge) else { continue };
        search(&mut split, watched.positions().len(), FIRST_STEP, ROUNDS_OF_NEW);
        if split.value() < best.as_ref().map_or(watched.value(), |(best, _)| best.value()) {
            best = Some((split, parts_of));
        }
    }
    best
}

/// Moves the vertices from a number on.
fn search(watched: &mut Watched<'_>, from: usize, first_step: f64, rounds: usize) {
    let mut steps = vec![first_step; watched.positions().len()];
    for _ in 0..rounds {
        let before = watched.value();
        for (vertex, step) in steps.iter_mut().enumerate().skip(from).filter(|(_, step)| **step >= LAST_STEP) {
            let mut has_moved = false;
            for axis in DVec3::AXES {
                let (place, length) = (watched.positions()[vertex], *step * watched.shortest_edge(vertex));
                let moved = |sign: f64| watched.moved(vertex, place + axis * (sign * length));
                let (one, other) = rayon::join(|| moved(1.0), || moved(-1.0));
                let best = one.into_iter().chain(other).min_by(|one, other| one.value.total_cmp(&other.value));
                if let Some(best) = best.filter(|best| best.value < watched.value()) {
                    watched.take(best);
                    has_moved = true;
                }
            }
            if !has_moved {
                *step *= 0.5;
            }
        }
        if watched.value() > GAIN * before {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_go_where_the_surface_is() {
        // A roof with its ridge at 3, and one with its ridge at 4, half as high.
        let roof = |x: f64, height: f64| {
            let along = |x: f64, z: f64| [0.0, 8.0].map(|y| DVec3::new(x, y, z));
            let positions = [along(0.0, 0.0), along(x, height), along(8.0, 0.0)].concat();
            Mesh { positions, triangles: vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]] }
        };
        let (whole, reduced) = (roof(3.0, 2.0), roof(4.0, 1.0));
        let corners = (0..4).map(|triangle| whole.corners(triangle)).collect();
        let surface = Sampled::new(corners, 900.0, 0.0, |_, [a, b, _]| Some([90.0 * (40.0 * a).sin(), 100.0 * b, 7.0]));
        let moved = moved_singly(&surface, &reduced).expect("it shows something");
        let distance = |mesh: &Mesh| surface.seen(mesh.positions.clone(), &mesh.triangles).distance();
        assert!(distance(&moved) < 0.2 * distance(&reduced), "{} {}", distance(&moved), distance(&reduced));
        assert_eq!(moved.triangles, reduced.triangles);
        // There is room for one more triangle, and for two.
        for (most, places) in [(4, 6), (5, 7), (6, 7)] {
            let (again, parts_of) = moved_again(&surface, &moved, most).expect("it shows something");
            assert!(distance(&again) <= distance(&moved), "{} {}", distance(&again), distance(&moved));
            assert!(again.triangles.len() <= most && again.triangles.len() == parts_of.len());
            assert!(again.positions.len() <= places);
        }
        assert!(moved_singly(&Sampled::new(vec![], 900.0, 0.0, |_, _| None), &reduced).is_none());
    }
}
