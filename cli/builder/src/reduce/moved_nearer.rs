//! Vertices of a reduced surface, moved so that it is nearer to what it was made from.
//!
//! Quadrics know the planes that were merged into a vertex, not the surface that is drawn. Here points of both surfaces
//! are compared with the other one, and all vertices are moved to the least squares of what lies between them, a few
//! times over. With few triangles that takes off a tenth to a third of the mean distance. Points that are far off weigh
//! more, so that the largest distance falls, too.

use glam::DVec3;

use super::spread_points::for_each_point;
use lodpack_mesh::Mesh;
use lodpack_stage::bake::barycentric;
use lodpack_stage::certify::{Hint, TriangleBvh, exceeding};
use lodpack_stage::least_squares::{Symmetric, System};

/// Points for each triangle of the reduced surface, on each of the two; and how many there are at least.
const POINTS: usize = 12;
const LEAST_POINTS: usize = 4000;
/// How often points are compared and vertices moved.
const ROUNDS: usize = 4;
/// The additional weight of a point whose square is the mean square of all.
const FAR: f64 = 0.5;
/// Weight of what lies between two points along the surface, where it hardly matters, beside that across it.
const ALONG: f64 = 0.05;
/// Weight of a vertex that stays where it is, beside all that moves it.
const STAYS: f64 = 0.01;
/// Steps of conjugate gradients.
const STEPS: usize = 40;
/// The cosine of the largest angle by which a triangle may turn.
const TURNS: f64 = 0.5;
/// Closest-point queries and cuts that finding what is far may take in each direction, after one pass over all
/// triangles.
const WORK: u64 = 30_000;

/// A surface, and what a reduced one has to be near to.
#[derive(Clone, Copy)]
pub(super) struct Whole<'a> {
    pub mesh: &'a Mesh,
    /// Its triangles.
    pub bvh: &'a TriangleBvh,
}

/// What lies between a point of the reduced surface and one of the whole.
struct Between {
    /// Of the reduced surface, with the weights of its corners.
    triangle: u32,
    weights: [f64; 3],
    /// From there to the whole.
    offset: DVec3,
}

/// The reduced surface with its vertices moved nearer to the whole one.
pub(super) fn moved_nearer(reduced: &Mesh, whole: Whole<'_>) -> Mesh {
    let mut moved = reduced.clone();
    let count = (POINTS * reduced.triangles.len()).max(LEAST_POINTS);
    let areas = whole.mesh.doubled_areas();
    for _ in 0..ROUNDS {
        let all = between(&moved, whole, &areas, count);
        let mean = all.iter().map(|between| between.offset.length_squared()).sum::<f64>() / all.len() as f64;
        if mean.is_nan() || mean <= 0.0 {
            break;
        }
        let edges = moved.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let mut system = System::new(moved.positions.len(), edges);
        for Between { triangle, weights, offset } in &all {
            let weight = 1.0 + FAR * offset.length_squared() / mean;
            let across = Symmetric::along(normal(&moved, *triangle), weight, weight * ALONG);
            system.add(moved.triangles[*triangle as usize], DVec3::from_array(*weights), &across, *offset);
        }
        system.hold(STAYS * all.len() as f64 / moved.positions.len() as f64);
        let offsets = system.solve(STEPS);
        let positions = moved.positions.iter().zip(&offsets).map(|(&p, &offset)| p + offset).collect();
        let mut next = Mesh { positions, triangles: moved.triangles };
        keep_unturned(&mut next, &moved.positions);
        moved = next;
    }
    moved
}

/// Takes vertices back to where they were before the surface was moved, near which it is farther off than `bound` now.
/// Returns whether there are some.
pub(super) fn take_back(moved: &mut Mesh, before: &Mesh, whole: Whole<'_>, bound: f64) -> bool {
    let drawn = TriangleBvh::new(&moved.positions, &moved.triangles);
    let mut far = exceeding(&drawn, whole.bvh, bound, WORK);
    let mut hint = Hint::default();
    for triangle in exceeding(whole.bvh, &drawn, bound, WORK) {
        far.extend(whole.mesh.corners(triangle).map(|corner| drawn.closest(corner, &mut hint).triangle));
    }
    let mut some = false;
    for v in far.into_iter().flat_map(|triangle| moved.triangles[triangle as usize]) {
        let before = before.positions[v as usize];
        some |= moved.positions[v as usize] != before;
        moved.positions[v as usize] = before;
    }
    some
}

/// What lies between points spread over each of two surfaces and the other one.
fn between(moved: &Mesh, whole: Whole<'_>, areas_of_whole: &[f64], count: usize) -> Vec<Between> {
    let drawn = TriangleBvh::new(&moved.positions, &moved.triangles);
    let mut all = Vec::with_capacity(2 * count);
    let mut hint = Hint::default();
    for_each_point(areas_of_whole, count, |triangle, weights| {
        let point = at(whole.mesh, triangle as u32, weights);
        let closest = drawn.closest(point, &mut hint);
        let weights = barycentric(moved.corners(closest.triangle), closest.point);
        all.push(Between { triangle: closest.triangle, weights, offset: point - closest.point });
    });
    let mut hint = Hint::default();
    for_each_point(&moved.doubled_areas(), count, |triangle, weights| {
        let point = at(moved, triangle as u32, weights);
        let offset = whole.bvh.closest(point, &mut hint).point - point;
        all.push(Between { triangle: triangle as u32, weights, offset });
    });
    all
}

/// Takes vertices back to where they were before, if a triangle at them would turn too far.
fn keep_unturned(next: &mut Mesh, before: &[DVec3]) {
    let is_bad = |&v: &u32| !next.positions[v as usize].is_finite();
    let turns = |&triangle: &u32| {
        let corners = next.triangles[triangle as usize];
        let [a, b, c] = corners.map(|v| before[v as usize]);
        let cosine = (b - a).cross(c - a).normalize_or_zero().dot(normal(next, triangle));
        corners.iter().any(is_bad) || cosine < TURNS
    };
    let turned: Vec<u32> = (0..next.triangles.len() as u32).filter(turns).collect();
    for v in turned.into_iter().flat_map(|triangle| next.triangles[triangle as usize]) {
        next.positions[v as usize] = before[v as usize];
    }
}

fn normal(mesh: &Mesh, triangle: u32) -> DVec3 {
    mesh.doubled_area(triangle).normalize_or_zero()
}

fn at(mesh: &Mesh, triangle: u32, [u, v, w]: [f64; 3]) -> DVec3 {
    let [a, b, c] = mesh.corners(triangle);
    a * u + b * v + c * w
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_tests::generate::displaced_cube;

    /// A fine sphere, and a coarse one whose vertices lie on it.
    fn spheres() -> [Mesh; 2] {
        [24, 3].map(|n| displaced_cube(n, DVec3::normalize))
    }

    fn squares(of: &Mesh, whole: Whole<'_>) -> f64 {
        let all = between(of, whole, &whole.mesh.doubled_areas(), LEAST_POINTS);
        all.iter().map(|between| between.offset.length_squared()).sum::<f64>() / all.len() as f64
    }

    #[test]
    fn an_inscribed_sphere_grows_until_it_lies_on_both_sides() {
        let [fine, coarse] = spheres();
        let bvh = TriangleBvh::new(&fine.positions, &fine.triangles);
        let whole = Whole { mesh: &fine, bvh: &bvh };
        let moved = moved_nearer(&coarse, whole);
        assert_eq!(moved.triangles, coarse.triangles);
        assert!(squares(&moved, whole) < 0.3 * squares(&coarse, whole));
        assert!(moved.positions.iter().zip(&coarse.positions).all(|(a, b)| a.length() > b.length()));
    }

    #[test]
    fn what_is_too_far_off_is_taken_back_and_the_rest_is_not() {
        let [fine, coarse] = spheres();
        let bvh = TriangleBvh::new(&fine.positions, &fine.triangles);
        let whole = Whole { mesh: &fine, bvh: &bvh };
        let mut moved = moved_nearer(&coarse, whole);
        let nearer = moved.clone();
        assert!(!take_back(&mut moved, &coarse, whole, 1.0), "nothing is so far off");
        moved.positions[0] *= 2.0;
        assert!(take_back(&mut moved, &coarse, whole, 0.5));
        assert_eq!(moved.positions[0], coarse.positions[0]);
        let others = moved.positions.iter().zip(&nearer.positions).filter(|(a, b)| a == b).count();
        assert!(others > moved.positions.len() / 2, "{others}");
    }

    #[test]
    fn triangles_do_not_turn_over_and_numbers_stay_numbers() {
        let [_, coarse] = spheres();
        let mut next = coarse.clone();
        next.positions[3] *= -1.0;
        next.positions[9] = DVec3::NAN;
        keep_unturned(&mut next, &coarse.positions);
        assert_eq!(next, coarse);
    }
}
