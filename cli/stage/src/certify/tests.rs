//! Tests of whole bounds.

use glam::DVec3;

use super::*;
use lodpack_mesh::Mesh;

/// A small generator of reproducible numbers (xorshift64*).
pub(super) struct Random(pub(super) u64);

impl Random {
    /// In 0..1.
    pub(super) fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In the cube -1..1.
    pub(super) fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

pub(super) fn surface(mesh: &Mesh) -> TriangleBvh {
    TriangleBvh::new(&mesh.positions, &mesh.triangles)
}

/// A height field over the unit square.
pub(super) fn height_field(n: u32, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let mut mesh = Mesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            mesh.positions.push(DVec3::new(x, y, height(x, y)));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let v = j * (n + 1) + i;
            mesh.triangles.extend([[v, v + 1, v + n + 2], [v, v + n + 2, v + n + 1]]);
        }
    }
    mesh
}

/// An octahedron with each face divided into n^2 triangles, projected onto the unit sphere.
pub(super) fn sphere(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for octant in 0..8 {
        let sign = |bit: u32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let axes = [DVec3::X * sign(0), DVec3::Y * sign(1), DVec3::Z * sign(2)];
        let corner = |i: u32, j: u32, k: u32| {
            (axes[0] * f64::from(i) + axes[1] * f64::from(j) + axes[2] * f64::from(k)).normalize()
        };
        for i in 0..n {
            for j in 0..n - i {
                let k = n - i - j;
                let mut add = |corners: [DVec3; 3]| {
                    let v = mesh.positions.len() as u32;
                    mesh.positions.extend(corners);
                    mesh.triangles.push([v, v + 1, v + 2]);
                };
                add([corner(i, j, k), corner(i + 1, j, k - 1), corner(i, j + 1, k - 1)]);
                if k > 1 {
                    add([corner(i + 1, j, k - 1), corner(i + 1, j + 1, k - 2), corner(i, j + 1, k - 1)]);
                }
            }
        }
    }
    mesh
}

/// Triangles of all sizes, some of them segments, points and needles.
fn soup(count: u32, random: &mut Random) -> Mesh {
    let mut mesh = Mesh::default();
    for t in 0..count {
        let centre = random.point();
        let size = 0.6 * random.unit();
        let mut corners = [(); 3].map(|()| centre + random.point() * size);
        match t % 5 {
            0 => corners[1] = corners[0],
            1 => corners[2] = corners[0].lerp(corners[1], random.unit()) + random.point() * 1e-9,
            2 if t % 15 == 2 => corners = [corners[0]; 3],
            _ => {}
        }
        mesh.positions.extend(corners);
        mesh.triangles.push([3 * t, 3 * t + 1, 3 * t + 2]);
    }
    mesh
}

/// The largest distance of sample points on each triangle.
pub(super) fn sampled(from: &Mesh, to: &TriangleBvh, per_side: u32) -> f64 {
    let mut hint = Hint::default();
    let mut largest = 0f64;
    for t in 0..from.triangles.len() as u32 {
        let [a, b, c] = from.corners(t);
        for i in 0..=per_side {
            for j in 0..=per_side - i {
                let point =
                    a + (b - a) * (f64::from(i) / f64::from(per_side)) + (c - a) * (f64::from(j) / f64::from(per_side));
                largest = largest.max(to.closest(point, &mut hint).distance);
            }
        }
    }
    largest
}

/// Checks everything that holds for any two meshes.
fn check(a: &Mesh, b: &Mesh) -> Bound {
    let (sa, sb) = (surface(a), surface(b));
    let options = CertifyOptions::default();
    let tiny = 1e-12 * (sa.reach + sb.reach + sa.origin.distance(sb.origin));
    let forward = one_sided(&sa, &sb, &options);
    let at_worst = sb.closest(forward.worst, &mut Hint::default()).distance;
    let rounding = tiny + sa.origin.length() * 1e-15;
    assert!((at_worst - forward.lower).abs() <= rounding, "{at_worst} {forward:?}");
    assert!(forward.lower <= forward.upper && forward.upper <= forward.lower * 1.051 + tiny, "{forward:?}");
    let largest = sampled(a, &sb, 12);
    assert!(largest <= forward.upper + rounding, "{largest} {forward:?}");
    let backward = one_sided(&sb, &sa, &options);
    let both = two_sided(&sa, &sb, &options);
    assert!(both.lower <= forward.upper.max(backward.upper) && both.upper >= forward.lower.max(backward.lower));
    assert!(both.upper <= both.lower * 1.051 + tiny, "{both:?}");
    both
}

pub(super) fn wavy(x: f64, y: f64) -> f64 {
    0.1 * (7.0 * x).sin() * (5.0 * y + x).cos()
}

#[test]
fn bounds_enclose_the_largest_sample() {
    check(&height_field(24, wavy), &height_field(7, wavy));
    check(&height_field(3, wavy), &height_field(20, |x, y| wavy(x, y) + 0.02 * (40.0 * x * y).sin()));
    check(&sphere(8), &sphere(3));
}

#[test]
fn soups_with_degenerate_triangles_are_bounded() {
    let mut random = Random(5);
    for count in [1, 2, 3, 10, 60] {
        for _ in 0..4 {
            check(&soup(count, &mut random), &soup(61 - count, &mut random));
        }
    }
}

#[test]
fn far_from_the_origin_and_at_tiny_scale_bounds_stay_tight() {
    let (fine, coarse) = (height_field(16, wavy), height_field(5, wavy));
    let expected = check(&fine, &coarse);
    for (scale, offset) in
        [(1.0, DVec3::new(5e6, -4e6, 3e6)), (1e-20, DVec3::ZERO), (1e12, DVec3::ZERO), (1e-100, DVec3::ZERO)]
    {
        let moved = |mesh: &Mesh| Mesh {
            positions: mesh.positions.iter().map(|&p| p * scale + offset).collect(),
            triangles: mesh.triangles.clone(),
        };
        let bound = check(&moved(&fine), &moved(&coarse));
        assert!((bound.lower / scale - expected.lower).abs() < 0.06 * expected.lower);
    }
}

#[test]
fn identical_surfaces_are_at_distance_zero() {
    for mesh in [height_field(20, wavy), sphere(6), soup(50, &mut Random(6))] {
        // Triangles and corners in another order: the result may not depend on equal indices.
        let other = Mesh {
            positions: mesh.positions.clone(),
            triangles: mesh.triangles.iter().rev().map(|&[a, b, c]| [c, a, b]).collect(),
        };
        let bound = two_sided(&surface(&mesh), &surface(&other), &CertifyOptions::default());
        assert!(bound.upper < 1e-12, "{bound:?}");
        assert!(bound.work < 8 * mesh.triangles.len() as u64 + 300, "{bound:?}");
    }
}

#[test]
fn a_translated_plane_is_as_far_as_it_was_moved() {
    let plane = height_field(9, |_, _| 0.0);
    let bound = check(&height_field(13, |_, _| 0.25), &plane);
    assert!((bound.lower - 0.25).abs() < 1e-15 && bound.upper <= 0.25 * 1.0501, "{bound:?}");
}

#[test]
fn a_coarse_sphere_is_as_far_as_its_faces_are_deep() {
    // The octahedron's faces are 1 / sqrt(3) from the centre, so the sphere's points stand out by the rest.
    let bound = check(&sphere(24), &sphere(1));
    let expected = 1.0 - 1.0 / 3f64.sqrt();
    assert!(bound.lower <= expected && expected <= bound.upper + 2e-3, "{bound:?} {expected}");
}

#[test]
fn a_thin_feature_between_the_samples_is_not_missed() {
    // A plate with a slit: the coarse surface covers the slit, so only points inside a large triangle are far.
    let strip = |x0: f64, x1: f64, base: u32| {
        let positions = [(x0, 0.0), (x1, 0.0), (x1, 10.0), (x0, 10.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        (positions, [[base, base + 1, base + 2], [base, base + 2, base + 3]])
    };
    let (left, right) = (strip(-10.0, 0.0, 0), strip(3.0, 10.0, 4));
    let slit = Mesh { positions: [left.0, right.0].concat(), triangles: [left.1, right.1].concat() };
    let (positions, triangles) = strip(-10.0, 10.0, 0);
    let plate = Mesh { positions: positions.to_vec(), triangles: triangles.to_vec() };
    let bound = check(&plate, &slit);
    assert!(bound.lower <= 1.5 && bound.upper >= 1.5 && bound.lower > 1.42, "{bound:?}");
    let vertices = plate.positions.iter().map(|&p| surface(&slit).closest(p, &mut Hint::default()).distance);
    assert!(vertices.fold(0.0, f64::max) < 1e-12);
}

#[test]
fn a_smaller_gap_gives_a_tighter_bound() {
    let (a, b) = (surface(&height_field(30, wavy)), surface(&height_field(6, wavy)));
    let at = |relative_gap| two_sided(&a, &b, &CertifyOptions { relative_gap, ..Default::default() });
    let (loose, tight) = (at(0.3), at(0.002));
    assert!(tight.upper <= 1.0021 * tight.lower && tight.upper < loose.upper && tight.lower >= loose.lower);
    assert!(tight.work > loose.work);
}

#[test]
fn a_reached_work_limit_leaves_a_valid_bound() {
    let (fine, coarse) = (height_field(30, wavy), height_field(3, wavy));
    let bound = one_sided(&surface(&coarse), &surface(&fine), &CertifyOptions { work_limit: 0, ..Default::default() });
    assert!(bound.upper >= sampled(&coarse, &surface(&fine), 40) && bound.upper > 1.5 * bound.lower);
}

#[test]
fn decisions_take_less_work_and_never_exceed_the_target() {
    let (a, b) = (surface(&height_field(40, wavy)), surface(&height_field(12, wavy)));
    let exact = two_sided(&a, &b, &CertifyOptions::default());
    let target = exact.upper * 1.1;
    let decided = two_sided(&a, &b, &CertifyOptions { target: Some(target), ..Default::default() });
    assert!(
        decided.upper <= target && decided.upper >= exact.lower && decided.work < exact.work,
        "{decided:?} {exact:?}"
    );
}

#[test]
fn exceeding_names_the_triangles_of_a_bump() {
    let flat = height_field(4, |_, _| 0.0);
    let mut bumpy = height_field(20, |_, _| 0.0);
    let peak = 10 * 21 + 10;
    bumpy.positions[peak].z = 0.1;
    let (flat, bumpy_surface) = (surface(&flat), surface(&bumpy));
    let expected: Vec<u32> =
        (0..bumpy.triangles.len() as u32).filter(|&t| bumpy.triangles[t as usize].contains(&(peak as u32))).collect();
    assert_eq!(exceeding(&bumpy_surface, &flat, 0.05, 100_000), expected);
    assert_eq!(exceeding(&bumpy_surface, &flat, 0.1001, 100_000), [] as [u32; 0]);
    // Seen from the other side, the large triangles around the middle lie below the bump.
    let below = exceeding(&flat, &bumpy_surface, 0.01, 100_000);
    assert!(!below.is_empty() && below.len() < 8, "{below:?}");
}

#[test]
fn an_empty_side_is_infinitely_far_or_at_distance_zero() {
    let (empty, full) = (surface(&Mesh::default()), surface(&sphere(1)));
    let options = CertifyOptions::default();
    assert_eq!(one_sided(&full, &empty, &options).upper, f64::INFINITY);
    assert_eq!(one_sided(&empty, &full, &options).upper, 0.0);
    assert_eq!(two_sided(&empty, &full, &options).upper, f64::INFINITY);
    assert_eq!(two_sided(&empty, &empty, &options).upper, 0.0);
    assert_eq!(exceeding(&full, &empty, 1.0, 10).len(), full.triangle_count());
}
