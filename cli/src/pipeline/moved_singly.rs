//! Vertices of a reduced cut of few triangles, moved one at a time so that it shows more.
//!
//! Where tens of triangles are left, collapsing edges has few places to choose from, and what colours a surface can show depends on where its few
//! edges run. So each vertex goes where the whole is better then: a search along axes with steps that become smaller (Hooke and Jeeves 1961).

use glam::DVec3;

use crate::mesh::Mesh;
use crate::stage::bake::{Sampled, Watched};

/// Steps begin with this share of the shortest edge at a vertex,
const FIRST_STEP: f64 = 0.5;
/// become half as long where no direction is better, and end with this share.
const LAST_STEP: f64 = 0.03;
/// How often all vertices are moved.
const ROUNDS: usize = 40;
/// It ends where a round leaves more than this share of what counts.
const GAIN: f64 = 0.997;

/// A reduced cut with its vertices moved to where it shows most of a surface for its distance from that. None if nothing is seen of it.
pub(super) fn moved_singly(surface: &Sampled, reduced: &Mesh) -> Option<Mesh> {
    let mut watched = Watched::new(surface, reduced.positions.clone(), &reduced.triangles)?;
    let mut steps = vec![FIRST_STEP; reduced.positions.len()];
    for _ in 0..ROUNDS {
        let before = watched.value();
        for (vertex, step) in steps.iter_mut().enumerate().filter(|(_, step)| **step >= LAST_STEP) {
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
    Some(Mesh { positions: watched.positions().to_vec(), triangles: reduced.triangles.clone() })
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
        assert!(moved_singly(&Sampled::new(vec![], 900.0, 0.0, |_, _| None), &reduced).is_none());
    }
}
