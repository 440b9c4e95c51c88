use super::*;
use glam::DVec3;
use lodpack_mesh::{Adjacency, Mesh, NONE, next_half_edge};
use std::collections::{BTreeMap, BTreeSet};

/// A grid of `nx` x `ny` quads, wrapped around as `wrap` asks, without the quads for which `keep` is false.
pub fn quad_mesh(
    [nx, ny]: [u32; 2],
    wrap: [bool; 2],
    keep: impl Fn(u32, u32) -> bool,
    at: impl Fn(f64, f64) -> DVec3,
) -> Mesh {
    let columns = nx + u32::from(!wrap[0]);
    let rows = ny + u32::from(!wrap[1]);
    let vertex = |x: u32, y: u32| (y % rows) * columns + x % columns;
    let mut mesh = Mesh::default();
    for y in 0..rows {
        for x in 0..columns {
            mesh.positions.push(at(f64::from(x) / f64::from(nx), f64::from(y) / f64::from(ny)));
        }
    }
    for y in 0..ny {
        for x in (0..nx).filter(|&x| keep(x, y)) {
            let [a, b, c, d] = [vertex(x, y), vertex(x + 1, y), vertex(x + 1, y + 1), vertex(x, y + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

pub fn grid(n: u32) -> Mesh {
    quad_mesh([n, n], [false; 2], |_, _| true, |x, y| DVec3::new(x, y, 0.0))
}

pub fn torus(n: [u32; 2]) -> Mesh {
    quad_mesh(
        n,
        [true; 2],
        |_, _| true,
        |u, v| {
            let (a, b) = (std::f64::consts::TAU * u, std::f64::consts::TAU * v);
            let r = 1.0 + 0.4 * b.cos();
            DVec3::new(r * a.cos(), r * a.sin(), 0.4 * b.sin())
        },
    )
}

/// The faces of an octahedron, each divided into `n * n` triangles, projected onto the unit sphere.
pub fn sphere(n: i64) -> Mesh {
    let mut mesh = Mesh::default();
    let mut numbers = BTreeMap::new();
    let mut vertex = |p: [i64; 3]| {
        *numbers.entry(p).or_insert_with(|| {
            mesh.positions.push(DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64).normalize());
            mesh.positions.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for signs in 0..8 {
        let [sx, sy, sz] = [0, 1, 2].map(|bit| if signs >> bit & 1 == 0 { 1 } else { -1 });
        let mut corner = |i: i64, j: i64| vertex([sx * i, sy * j, sz * (n - i - j)]);
        let mut add = |a: u32, b: u32, c: u32| {
            triangles.push(if sx * sy * sz > 0 { [a, b, c] } else { [a, c, b] });
        };
        for i in 0..n {
            for j in 0..n - i {
                add(corner(i, j), corner(i + 1, j), corner(i, j + 1));
                if i + j + 1 < n {
                    add(corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
                }
            }
        }
    }
    mesh.triangles = triangles;
    mesh
}

/// Checks everything that holds for any atlas, whatever the mesh. Returns the Euler characteristic of each chart.
pub fn check_atlas(mesh: &Mesh, labels: &[u32], atlas: &Atlas) -> Vec<i64> {
    let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
    let origin = |h: u32| mesh.triangles[h as usize / 3][h as usize % 3];
    let edge = |h: u32| (origin(h), origin(next_half_edge(h)));
    let mut cut = BTreeMap::new();
    for h in 0..adjacency.opposite.len() as u32 {
        let opposite = adjacency.opposite[h as usize];
        let label = labels[h as usize / 3];
        let other = if opposite == NONE { NONE } else { labels[opposite as usize / 3] };
        if other != label {
            cut.insert((label, edge(h)), other);
        }
    }
    assert!(atlas.corners.is_sorted_by(|a, b| a < b));
    for arc in &atlas.arcs {
        assert_ne!(arc.ends[0], arc.ends[1]);
        assert_eq!(arc.ends.map(|c| atlas.corners[c as usize]), [arc.path[0], arc.path[arc.path.len() - 1]]);
        assert!(arc.path[1..arc.path.len() - 1].iter().all(|v| atlas.corners.binary_search(v).is_err()));
    }
    let mut uses = vec![[0; 2]; atlas.arcs.len()];
    let mut euler = Vec::new();
    for (c, chart) in atlas.charts.iter().enumerate() {
        assert!(chart.triangles.iter().all(|&t| labels[t as usize] == c as u32));
        assert!(chart.triangles.is_sorted_by(|a, b| a < b));
        let mut lengths = Vec::new();
        for sides in &chart.loops {
            let mut edges = Vec::new();
            for (i, half_arc) in sides.iter().enumerate() {
                let arc = &atlas.arcs[half_arc.arc as usize];
                uses[half_arc.arc as usize][usize::from(half_arc.reversed)] += 1;
                assert_eq!(arc.charts[usize::from(half_arc.reversed)], c as u32);
                assert_eq!(half_arc.ends(atlas)[1], sides[(i + 1) % sides.len()].ends(atlas)[0]);
                let path: Vec<u32> = half_arc.path_indices(atlas).map(|i| arc.path[i as usize]).collect();
                edges.extend(path.windows(2).map(|e| (e[0], e[1])));
                for e in path.windows(2) {
                    assert_eq!(cut.remove(&(c as u32, (e[0], e[1]))), Some(half_arc.neighbour(atlas)));
                }
            }
            assert!(sides.len() >= 3.min(edges.len()));
            let length = |e: &(u32, u32)| mesh.positions[e.0 as usize].distance(mesh.positions[e.1 as usize]);
            lengths.push(edges.iter().map(length).sum::<f64>());
        }
        assert!(lengths.is_sorted_by(|a, b| *a >= *b * (1.0 - 1e-12)));
        euler.push(check_chart(mesh, &adjacency, labels, atlas, c as u32));
    }
    assert!(cut.is_empty(), "cut half-edges in no loop");
    for (arc, uses) in atlas.arcs.iter().zip(uses) {
        assert_eq!(uses, [1, i32::from(arc.charts[1] != NONE)]);
    }
    let triangle_count: usize = atlas.charts.iter().map(|chart| chart.triangles.len()).sum();
    assert_eq!(triangle_count, mesh.triangles.len());
    euler
}

fn check_chart(mesh: &Mesh, adjacency: &Adjacency, labels: &[u32], atlas: &Atlas, c: u32) -> i64 {
    let local = cut_chart(mesh, adjacency, atlas, labels, c);
    let chart = &atlas.charts[c as usize];
    assert_eq!(local.triangles.len(), chart.triangles.len());
    for (corners, &t) in local.triangles.iter().zip(&chart.triangles) {
        assert_eq!(corners.map(|v| local.mesh_vertex[v as usize]), mesh.triangles[t as usize]);
    }
    let cut_adjacency = Adjacency::new(&local.triangles, local.mesh_vertex.len());
    let mut border = BTreeSet::new();
    for h in 0..cut_adjacency.opposite.len() {
        if cut_adjacency.opposite[h] == NONE {
            border.insert((local.triangles[h / 3][h % 3], local.triangles[h / 3][(h + 1) % 3]));
        }
    }
    let border_count = border.len();
    let mut on_loops = BTreeSet::new();
    for (vertices, sides) in local.loops.iter().zip(&chart.loops) {
        for (i, v) in vertices.iter().enumerate() {
            assert!(on_loops.insert(v.local_vertex), "each border vertex is on the loops once");
            let following = vertices[(i + 1) % vertices.len()].local_vertex;
            assert!(border.remove(&(v.local_vertex, following)));
            let path = &atlas.arcs[sides[v.side as usize].arc as usize].path;
            assert_eq!(path[v.path_index as usize], local.mesh_vertex[v.local_vertex as usize]);
        }
    }
    assert!(border.is_empty(), "the loops cover the whole border");
    assert_eq!(on_loops.last().map_or(0, |&v| v as usize + 1), border_count, "border vertices come first");
    let used: BTreeSet<u32> = local.triangles.iter().flatten().copied().collect();
    assert_eq!(used.len(), local.mesh_vertex.len());
    let edge_count = (3 * local.triangles.len() + border_count) / 2;
    local.mesh_vertex.len() as i64 - edge_count as i64 + local.triangles.len() as i64
}

fn trace(mesh: &Mesh, labels: &[u32]) -> Atlas {
    trace_arcs(mesh, &Adjacency::new(&mesh.triangles, mesh.positions.len()), labels, &Seams::default())
}

fn loop_sizes(atlas: &Atlas) -> Vec<Vec<usize>> {
    atlas.charts.iter().map(|chart| chart.loops.iter().map(Vec::len).collect()).collect()
}

#[test]
fn a_disk_without_neighbours_gets_three_corners() {
    let mesh = grid(4);
    let atlas = trace(&mesh, &[0; 32]);
    assert_eq!(check_atlas(&mesh, &[0; 32], &atlas), [1]);
    assert_eq!(loop_sizes(&atlas), [[3]]);
    assert_eq!(atlas.corners[0], 0, "loops without corners are split from their smallest vertex on");
}

#[test]
fn a_single_triangle_has_three_arcs_of_one_edge() {
    let mesh = Mesh { positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] };
    let atlas = trace(&mesh, &[0]);
    assert_eq!(check_atlas(&mesh, &[0], &atlas), [1]);
    assert_eq!(atlas.arcs.len(), 3);
}

#[test]
fn closed_components_have_no_loops() {
    let (mesh, labels) = (torus([8, 6]), [0; 96]);
    let atlas = trace(&mesh, &labels);
    assert_eq!(check_atlas(&mesh, &labels, &atlas), [0]);
    assert!(atlas.arcs.is_empty() && atlas.corners.is_empty());
}

#[test]
fn an_island_shares_its_split_loop_with_the_chart_around_it() {
    let mesh = grid(8);
    let labels: Vec<u32> =
        (0..128).map(|t| u32::from((2..5).contains(&(t / 2 % 8)) && (3..6).contains(&(t / 16)))).collect();
    let atlas = trace(&mesh, &labels);
    assert_eq!(check_atlas(&mesh, &labels, &atlas), [0, 1]);
    assert_eq!(loop_sizes(&atlas), [vec![3, 3], vec![3]]);
}

#[test]
fn two_arcs_around_a_chart_become_three() {
    // Each of the two strips shares one arc with the other and has one along the mesh boundary.
    let mesh = grid(6);
    let labels: Vec<u32> = (0..72).map(|t| u32::from(t / 12 >= 2)).collect();
    let atlas = trace(&mesh, &labels);
    assert_eq!(check_atlas(&mesh, &labels, &atlas), [1, 1]);
    assert_eq!(loop_sizes(&atlas), [[3], [3]]);
    assert_eq!(atlas.arcs.len(), 5, "the shared arc, the shorter one, stays whole");
}

#[test]
fn a_vertex_touched_in_two_fans_is_two_local_vertices() {
    // Four quarters, like a chessboard; the last column joins two of them, which touch once more in the middle.
    let mesh = grid(8);
    let board: Vec<u32> = (0..128u32)
        .map(|t| {
            let (x, y) = (t / 2 % 8, t / 16);
            let diagonal = (x < 4) == (y < 4);
            if diagonal || x == 7 {
                0
            } else if x < 4 {
                2
            } else {
                1
            }
        })
        .collect();
    let atlas = trace(&mesh, &board);
    let middle = 4 * 9 + 4;
    assert!(atlas.corners.contains(&middle));
    check_atlas(&mesh, &board, &atlas);
    let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
    let local = cut_chart(&mesh, &adjacency, &atlas, &board, 0);
    assert_eq!(local.mesh_vertex.iter().filter(|&&v| v == middle).count(), 2);
}

#[test]
fn any_labels_make_a_consistent_atlas() {
    let mut random = 7u64;
    for mesh in [grid(12), torus([12, 9]), sphere(6)] {
        for chart_count in [2, 3, 5, 40] {
            let mut labels: Vec<u32> = (0..mesh.triangles.len() as u32)
                .map(|_| {
                    random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (random >> 33) as u32 % chart_count
                })
                .collect();
            for label in 0..chart_count {
                labels[label as usize] = label;
            }
            check_atlas(&mesh, &labels, &trace(&mesh, &labels));
        }
    }
}
