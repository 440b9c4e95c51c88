use super::*;
use lodpack_mesh::Adjacency;
use lodpack_mesh::NONE;

/// A torus of unit radius around z, with a tube of the given radius.
fn torus(tube: f64, n: u32) -> Mesh {
    let positions = (0..n * n).map(|i| {
        let [u, v] = [i / n, i % n].map(|k| f64::from(k) * std::f64::consts::TAU / f64::from(n));
        let ring = 1.0 + tube * v.cos();
        DVec3::new(ring * u.cos(), ring * u.sin(), tube * v.sin())
    });
    let at = |i: u32, j: u32| (i % n) * n + j % n;
    let quads = (0..n * n).map(|i| (i / n, i % n));
    let triangles = quads.flat_map(|(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    Mesh { positions: positions.collect(), triangles: triangles.collect() }
}

fn volume(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len() as u32).map(|t| mesh.corners(t)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

fn is_closed(mesh: &Mesh) -> bool {
    Adjacency::new(&mesh.triangles, mesh.positions.len()).opposite.iter().all(|&other| other != NONE)
}

#[test]
fn a_torus_keeps_its_handle_on_fine_cells_and_loses_it_on_coarse_ones() {
    let thick = torus(0.8, 60);
    let shape = |cells| Solid::new(&thick, cells).map(|solid| solid.shape()).map(|s| (s.components, s.handles));
    assert_eq!(shape(60), Some((1, 1)));
    // Where no line of the lattice runs through the hole.
    assert!((2..8).any(|cells| shape(cells) == Some((1, 0))));
}

#[test]
fn the_new_surface_is_closed_lies_on_the_old_one_and_faces_the_same_way() {
    let torus = torus(0.5, 80);
    let mut turned = torus.clone();
    turned.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    for mesh in [&torus, &turned] {
        let drawn = Solid::new(mesh, 40).unwrap().surface();
        assert!(is_closed(&drawn));
        assert!((volume(&drawn) / volume(mesh) - 1.0).abs() < 0.02, "{} {}", volume(&drawn), volume(mesh));
        let old = TriangleBvh::new(&mesh.positions, &mesh.triangles);
        let farthest =
            drawn.positions.iter().map(|&p| old.closest(p, &mut Hint::default()).distance).fold(0.0, f64::max);
        assert!(farthest < 1e-9, "{farthest}");
    }
}

#[test]
fn lattice_lines_through_edges_and_corners_meet_the_surface_once() {
    // Every lattice line runs through corners and edges of such a box.
    for cells in [2, 3, 4, 5, 8] {
        let n = cells as f64;
        let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * n;
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let cube = Mesh { positions: (0..8).map(corner).collect(), triangles };
        let solid = Solid::new(&cube, cells).unwrap();
        assert_eq!((solid.shape().components, solid.shape().handles), (1, 0));
        let surface = solid.surface();
        assert!(is_closed(&surface) && volume(&surface) > 0.0);
    }
}

#[test]
fn nothing_lies_inside_a_surface_without_extent_or_volume() {
    let point = Mesh { positions: vec![DVec3::ONE; 3], triangles: vec![[0, 1, 2]] };
    assert!(Solid::new(&point, 10).is_none());
    let sheet = Mesh { positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2], [0, 2, 1]] };
    assert!(Solid::new(&sheet, 10).is_none());
}
