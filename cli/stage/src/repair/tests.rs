use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use super::*;

/// Checks what [`repair`] promises with nothing but maps; shares no code with it.
fn assert_is_manifold(mesh: &Mesh, adjacency: &Adjacency, report: &RepairReport) {
    let mut directed: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut around: BTreeMap<u32, Vec<(u32, u32)>> = BTreeMap::new();
    let mut triples = BTreeSet::new();
    for (t, &[a, b, c]) in mesh.triangles.iter().enumerate() {
        assert!(a != b && b != c && c != a, "a triangle repeats a vertex");
        for (k, (from, to, third)) in [(a, b, c), (b, c, a), (c, a, b)].into_iter().enumerate() {
            assert!(
                directed.insert((from, to), (3 * t + k) as u32).is_none(),
                "edge {from} {to} runs twice in one direction"
            );
            around.entry(from).or_default().push((to, third));
        }
        let mut triple = [a, b, c].map(|v| mesh.positions[v as usize].to_array().map(|x| (x + 0.0).to_bits()));
        triple.sort_unstable();
        assert!(triples.insert(triple), "a triangle occurs twice");
    }
    let mut boundary = 0;
    for (&(from, to), &h) in &directed {
        let other = directed.get(&(to, from)).copied();
        assert_eq!(adjacency.opposite[h as usize], other.unwrap_or(NONE), "edge {from} {to} is paired wrongly");
        boundary += u64::from(other.is_none());
    }
    assert_eq!(*adjacency, Adjacency::new(&mesh.triangles, mesh.positions.len()));
    assert_eq!(around.len(), mesh.positions.len(), "a vertex is unused");
    for (v, links) in around {
        // The links of one fan form one path or one cycle: join them and count the paths.
        let mut paths: Vec<BTreeSet<u32>> = Vec::new();
        for (a, b) in links {
            let (mut joined, others): (Vec<_>, Vec<_>) =
                paths.into_iter().partition(|p| p.contains(&a) || p.contains(&b));
            joined.push(BTreeSet::from([a, b]));
            paths = others;
            paths.push(joined.into_iter().flatten().collect());
        }
        assert_eq!(paths.len(), 1, "vertex {v} has several fans");
    }
    let mut label: Vec<usize> = (0..mesh.triangles.len()).collect();
    loop {
        let before = label.clone();
        for (&(from, to), &h) in &directed {
            if let Some(&other) = directed.get(&(to, from)) {
                let least = label[h as usize / 3].min(label[other as usize / 3]);
                (label[h as usize / 3], label[other as usize / 3]) = (least, least);
            }
        }
        if label == before {
            break;
        }
    }
    assert_eq!(report.components, label.iter().collect::<BTreeSet<_>>().len() as u64);
    assert_eq!(report.boundary_edges, boundary);
    assert_eq!(report.nothing_left, mesh.triangles.is_empty());
}

/// The triangles as positions, with sorted corners, so that winding does not matter when they are compared.
fn surface(mesh: &Mesh) -> Vec<[[u64; 3]; 3]> {
    let corners =
        mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize].to_array().map(|x| (x + 0.0).to_bits())));
    corners
        .map(|mut t| {
            t.sort_unstable();
            t
        })
        .collect()
}

fn repaired(positions: &[DVec3], triangles: &[[u32; 3]]) -> (Mesh, RepairReport) {
    let input = Mesh { positions: positions.to_vec(), triangles: triangles.to_vec() };
    let (mesh, adjacency, report) = repair(input.clone());
    assert_is_manifold(&mesh, &adjacency, &report);
    // Only degenerate and duplicate triangles disappear, and the others keep their order.
    let all = surface(&input);
    let mut seen = BTreeSet::new();
    let expected: Vec<_> = all.iter().filter(|t| !is_flat(t) && seen.insert(**t)).copied().collect();
    assert_eq!(surface(&mesh), expected);
    assert_eq!((all.len() - expected.len()) as u64, report.degenerate_faces + report.duplicate_faces);
    // Repairing again changes nothing.
    let (again, _, second) = repair(Mesh { positions: unwelded(&mesh), triangles: mesh.triangles.clone() });
    assert_eq!(again.triangles, mesh.triangles);
    let quiet =
        RepairReport { components: report.components, boundary_edges: report.boundary_edges, ..Default::default() };
    assert_eq!(second, RepairReport { nothing_left: report.nothing_left, ..quiet });
    (mesh, report)
}

/// Positions that welding keeps apart, to test connectivity alone: no three are near a line.
fn unwelded(mesh: &Mesh) -> Vec<DVec3> {
    let mut random = Random(77);
    mesh.positions.iter().map(|_| DVec3::from_array([0; 3].map(|_| random.below(1 << 40) as f64))).collect()
}

/// Whether corners on a small integer lattice span no area.
fn is_flat(triple: &[[u64; 3]; 3]) -> bool {
    let [a, b, c] = triple.map(|p| DVec3::from_array(p.map(f64::from_bits)));
    (b - a).cross(c - a) == DVec3::ZERO
}

struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % limit
    }
}

fn lattice(size: u64) -> Vec<DVec3> {
    (0..size * size * size)
        .map(|i| DVec3::new((i % size) as f64, (i / size % size) as f64, (i / size / size) as f64))
        .collect()
}

/// The corners of a unit cube at `offset`, wound outward.
fn cube(offset: DVec3) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let positions = lattice(2).into_iter().map(|p| p + offset).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (positions, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// A grid of n x n squares in the plane, each cut along one diagonal.
fn sheet(n: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let positions = (0..=n).flat_map(|y| (0..=n).map(move |x| DVec3::new(x.into(), y.into(), 0.0))).collect();
    let square = |i: u32| {
        let a = i / n * (n + 1) + i % n;
        [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
    };
    (positions, (0..n * n).flat_map(square).collect())
}

#[test]
fn a_clean_mesh_passes_unchanged() {
    for (positions, triangles) in [cube(DVec3::ZERO), sheet(5)] {
        let (mesh, report) = repaired(&positions, &triangles);
        assert_eq!(mesh, Mesh { positions, triangles });
        let boundary_edges = report.boundary_edges;
        assert_eq!(report, RepairReport { components: 1, boundary_edges, ..Default::default() });
    }
}

#[test]
fn separate_corners_are_welded_and_unused_vertices_dropped() {
    let (positions, triangles) = cube(DVec3::ZERO);
    let mut soup: Vec<DVec3> = triangles.iter().flatten().map(|&v| positions[v as usize]).collect();
    soup.iter_mut().filter(|p| p.x == 0.0).for_each(|p| p.x = -0.0);
    soup.push(DVec3::splat(9.0));
    let separate: Vec<[u32; 3]> = (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let (mesh, report) = repaired(&soup, &separate);
    assert_eq!((mesh.positions.len(), report.welded_vertices, report.unreferenced_vertices), (8, 28, 1));
    assert_eq!((report.components, report.boundary_edges), (1, 0));
}

#[test]
fn degenerate_and_duplicate_triangles_are_dropped_and_slivers_stay() {
    let (mut positions, mut triangles) = sheet(2);
    positions.extend([DVec3::new(0.0, 1e-300, 1e-300), DVec3::new(5.0, 5.0, 0.0), DVec3::new(5.0, 5.0, 0.0)]);
    triangles.extend([[1, 4, 0], [0, 1, 4], [2, 2, 5], [0, 1, 2], [10, 11, 3], [0, 1, 9]]);
    let (mesh, report) = repaired(&positions, &triangles);
    assert_eq!((report.degenerate_faces, report.duplicate_faces, report.welded_vertices), (3, 2, 1));
    assert_eq!(mesh.triangles.len(), 9);
}

#[test]
fn two_solids_that_touch_along_an_edge_or_at_a_vertex_stay_closed() {
    let (mut positions, mut triangles) = cube(DVec3::ZERO);
    for (offset, edges, vertices) in [(DVec3::new(1.0, 1.0, 0.0), 1, 2), (DVec3::ONE, 0, 1)] {
        let first = cube(DVec3::ZERO);
        let second = cube(offset);
        positions.clone_from(&first.0);
        positions.extend(second.0);
        triangles.clone_from(&first.1);
        triangles.extend(second.1.iter().map(|t| t.map(|v| v + 8)));
        let (_, report) = repaired(&positions, &triangles);
        assert_eq!((report.components, report.boundary_edges), (2, 0));
        assert_eq!((report.nonmanifold_edges_cut, report.nonmanifold_vertices_split), (edges, vertices));
    }
}

#[test]
fn a_fin_is_cut_off_and_the_smooth_surface_stays() {
    let (mut positions, mut triangles) = sheet(4);
    positions.push(DVec3::new(2.5, 2.0, 1.0));
    triangles.insert(0, [12, 13, 25]);
    let (_, report) = repaired(&positions, &triangles);
    assert_eq!((report.nonmanifold_edges_cut, report.components, report.boundary_edges), (1, 2, 16 + 3));
}

#[test]
fn mixed_winding_follows_the_larger_area() {
    let (positions, triangles) = sheet(8);
    for modulus in [2, 3, 5, 7] {
        let mut mixed = triangles.clone();
        let reversed = mixed.iter_mut().step_by(modulus).map(|t| t.reverse()).count();
        let (mesh, report) = repaired(&positions, &mixed);
        assert_eq!(report.flipped_faces as usize, reversed.min(triangles.len() - reversed));
        let normal = |t: u32| {
            let [a, b, c] = mesh.corners(t);
            (b - a).cross(c - a).z
        };
        assert!(modulus == 2 || (0..mesh.triangles.len() as u32).all(|t| normal(t) > 0.0));
    }
    // One large triangle outweighs many small ones.
    let mut grown = positions.clone();
    grown.push(DVec3::new(-1e3, -1e3, 0.0));
    let mut mixed = triangles.clone();
    mixed.push([0, 1, 81]);
    assert_eq!(repaired(&grown, &mixed).1.flipped_faces, 128);
}

#[test]
fn a_moebius_strip_is_cut_across() {
    for n in [3u32, 5, 20] {
        let positions: Vec<DVec3> = (0..n)
            .flat_map(|i| {
                let angle = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
                let direction = DVec3::new(angle.cos(), angle.sin(), 0.0);
                let tilt = direction * (angle / 2.0).cos() + DVec3::Z * (angle / 2.0).sin();
                [3.0 * direction - tilt, 3.0 * direction + tilt]
            })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..n)
            .flat_map(|i| {
                let [a, b] = [2 * i, 2 * i + 1];
                let [c, d] = if i + 1 < n { [a + 2, b + 2] } else { [1, 0] };
                [[a, b, c], [c, b, d]]
            })
            .collect();
        let input = Mesh { positions, triangles };
        let (mesh, adjacency, report) = repair(input);
        assert_is_manifold(&mesh, &adjacency, &report);
        assert_eq!((report.unorientable_edges_cut, report.components), (1, 1));
        assert_eq!(mesh.positions.len() as u32, 2 * n + 2);
    }
}

#[test]
fn sheets_that_share_both_ends_of_a_cut_edge_are_set_apart() {
    // A disc with a fin on an inner edge, and a second disc glued to the first along one inner edge only: every fan
    // comes back to its edge.
    let (mut positions, mut triangles) = sheet(4);
    positions.extend([DVec3::new(2.5, 2.0, 1.0), DVec3::new(2.5, 2.0, -1.0), DVec3::new(2.0, 2.5, 1.0)]);
    triangles.extend([[12, 13, 25], [13, 12, 26], [25, 13, 27], [25, 27, 12], [26, 12, 27], [26, 27, 13]]);
    repaired(&positions, &triangles);
    // A Klein bottle and a projective plane on few vertices, whose cuts end inside the surface.
    let plane =
        [[0, 1, 4], [0, 4, 2], [0, 2, 3], [0, 3, 5], [0, 5, 1], [1, 2, 5], [1, 3, 2], [1, 4, 3], [2, 4, 5], [3, 4, 5]];
    let positions: Vec<DVec3> = (0..6).map(|i| DVec3::new((i * i) as f64, (i * i * i) as f64, i as f64)).collect();
    let (_, report) = repaired(&positions, &plane);
    assert!(report.unorientable_edges_cut > 0);
    let mut klein = Vec::new();
    let n = 4;
    let vertex = |x: u32, y: u32| if x == n { (n - y % n) % n } else { x * n + y % n };
    for (x, y) in (0..n).flat_map(|x| (0..n).map(move |y| (x, y))) {
        klein.push([vertex(x, y), vertex(x + 1, y), vertex(x + 1, y + 1)]);
        klein.push([vertex(x, y), vertex(x + 1, y + 1), vertex(x, y + 1)]);
    }
    let mut random = Random(5);
    let positions: Vec<DVec3> = (0..16).map(|_| DVec3::from_array([0; 3].map(|_| random.below(1000) as f64))).collect();
    assert!(repaired(&positions, &klein).1.unorientable_edges_cut > 0);
}

#[test]
fn random_soups_become_manifold() {
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let mut acts = RepairReport::default();
    for round in 0..1500 {
        let size = 2 + round % 3;
        let positions = lattice(size);
        let count = 1 + random.below(if round % 10 == 0 { 150 } else { 30 });
        let mut vertex = || random.below(positions.len() as u64) as u32;
        let triangles: Vec<[u32; 3]> = (0..count).map(|_| [vertex(), vertex(), vertex()]).collect();
        let (_, report) = repaired(&positions, &triangles);
        acts.nonmanifold_edges_cut += report.nonmanifold_edges_cut;
        acts.unorientable_edges_cut += report.unorientable_edges_cut;
        acts.further_edges_cut += report.further_edges_cut;
        acts.flipped_faces += report.flipped_faces;
    }
    // Every branch was taken.
    let counts = [acts.nonmanifold_edges_cut, acts.unorientable_edges_cut, acts.further_edges_cut, acts.flipped_faces];
    assert!(counts.iter().all(|&c| c > 50), "{counts:?}");
}

#[test]
fn sheets_with_random_damage_become_manifold() {
    let mut random = Random(99);
    for _ in 0..60 {
        let (positions, mut triangles) = sheet(8);
        for _ in 0..random.below(12) {
            let (t, k) = (random.below(triangles.len() as u64) as usize, random.below(3) as usize);
            match random.below(3) {
                0 => triangles[t].reverse(),
                1 => triangles[t][k] = random.below(positions.len() as u64) as u32,
                _ => {
                    let apex = random.below(positions.len() as u64) as u32;
                    triangles.push([triangles[t][k], triangles[t][(k + 1) % 3], apex]);
                }
            }
        }
        repaired(&positions, &triangles);
    }
}

#[test]
fn many_triangles_at_one_edge_do_not_take_quadratic_time() {
    let count = 200_000u32;
    let mut positions = vec![DVec3::ZERO, DVec3::Z];
    positions.extend((0..count).map(|i| DVec3::new(f64::from(i) + 1.0, f64::from(i % 1009), 0.0)));
    let triangles: Vec<[u32; 3]> = (0..count).map(|i| [0, 1, i + 2]).collect();
    let (mesh, _, report) = repair(Mesh { positions, triangles });
    assert_eq!((report.nonmanifold_edges_cut, mesh.triangles.len()), (1, count as usize));
    assert_eq!(report.components, u64::from(count) - 16);
}

#[test]
fn a_mesh_of_degenerate_triangles_leaves_nothing() {
    assert!(repaired(&[], &[]).1.nothing_left);
    let (mesh, report) = repaired(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0], &[[0, 1, 2], [0, 0, 1]]);
    assert_eq!(mesh, Mesh::default());
    assert_eq!((report.degenerate_faces, report.unreferenced_vertices, report.components), (2, 3, 0));
}

#[test]
fn origins_say_which_triangle_each_one_was_and_how_its_corners_went() {
    // A fan of four in mixed windings, with a duplicate, a triangle without area and a vertex that repeats another.
    let positions = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [2, 0]].map(|[x, y]| DVec3::new(x.into(), y.into(), 0.0));
    let triangles = [[0, 1, 5], [0, 1, 2], [2, 1, 0], [4, 2, 3], [3, 2, 0], [1, 2, 5], [5, 5, 0]];
    let input = Mesh { positions: positions.to_vec(), triangles: triangles.to_vec() };
    let (mesh, _, report, origins) = repair_with_origins(input.clone(), &[]);
    assert_eq!((mesh.clone(), report.clone()), {
        let (mesh, _, report) = repair(input.clone());
        (mesh, report)
    });
    assert_eq!((report.duplicate_faces, report.degenerate_faces), (2, 2));
    assert!(origins.iter().any(|origin| origin.1) || report.flipped_faces == 0);
    assert_eq!(origins.iter().map(|origin| origin.0).collect::<Vec<_>>(), [1, 3, 5]);
    // One that is wound against the rest.
    let turned = Mesh { triangles: vec![[0, 1, 2], [0, 3, 2], [1, 5, 2]], ..input };
    let (mesh, _, report, origins) = repair_with_origins(turned.clone(), &[]);
    assert_eq!(report.flipped_faces, 1);
    for ((number, is_reversed), t) in origins.into_iter().zip(0..) {
        let mut corners = turned.corners(number);
        if is_reversed {
            corners.swap(1, 2);
        }
        assert_eq!(mesh.corners(t), corners);
    }
}

#[test]
fn objects_that_touch_keep_all_their_faces_and_share_no_vertex() {
    // Two boxes on one another: equal faces lie back to back. Each box shares its vertices with the other.
    let corner = |x: i32, y: i32, z: i32| DVec3::new(x.into(), y.into(), z.into());
    let positions: Vec<DVec3> = (0..12).map(|i| corner(i & 1, i >> 1 & 1, i >> 2)).collect();
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];
    let of_box = |first: u32| {
        sides.into_iter().flat_map(move |side| {
            let [a, b, c, d] = side.map(|v| v + first);
            [[a, b, c], [a, c, d]]
        })
    };
    let mesh = Mesh { positions, triangles: of_box(0).chain(of_box(4)).collect() };
    let objects: Vec<u32> = (0..24).map(|t| t / 12).collect();
    let (apart, adjacency, report, origins) = repair_with_origins(mesh.clone(), &objects);
    assert_eq!((apart.positions.len(), apart.triangles.len(), report.components), (16, 24, 2));
    assert_eq!((report.duplicate_faces, report.boundary_edges, report.flipped_faces), (0, 0, 0));
    assert_eq!(origins, (0..24).map(|t| (t, false)).collect::<Vec<_>>());
    assert_eq!(adjacency, Adjacency::new(&apart.triangles, 16));
    let (_, _, report, _) = repair_with_origins(mesh.clone(), &[]);
    assert_eq!(report.duplicate_faces, 2, "as one surface they lose faces");
    let (one, _, report, _) = repair_with_origins(mesh.clone(), &[5; 24]);
    assert_eq!((one, report), (repair(mesh.clone()).0, repair(mesh).2), "one object is as none");
}
