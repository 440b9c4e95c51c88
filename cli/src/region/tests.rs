use std::collections::BTreeMap;

use glam::DVec3;
use lodpack::{File, Limits, Query};

use crate::build::{BuildOptions, Effort, build_mesh};
use crate::mesh::{Mesh, NONE};
use crate::progress::Silent;
use crate::region::Regions;
use crate::summary::BuildSummary;

/// A torus of 2 n m triangles, wound outward.
fn torus(n: u32, m: u32) -> Mesh {
    let angle = |i: u32, of: u32| f64::from(i) / f64::from(of) * std::f64::consts::TAU;
    let mut mesh = Mesh::default();
    for (i, j) in (0..n).flat_map(|i| (0..m).map(move |j| (i, j))) {
        let (u, v) = (angle(i, n), angle(j, m));
        let r = 3.0 + v.cos() + 0.05 * (7.0 * u).sin();
        mesh.positions.push(DVec3::new(r * u.cos(), r * u.sin(), v.sin()));
        let at = |i: u32, j: u32| i % n * m + j % m;
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

/// A strip with k half turns.
fn strip(n: u32, half_turns: u32) -> Mesh {
    let mut mesh = Mesh::default();
    const ACROSS: u32 = 8;
    for i in 0..n {
        let u = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
        let tilt = 0.5 * u * f64::from(half_turns);
        for j in 0..=ACROSS {
            let across = f64::from(j) / f64::from(ACROSS) * 2.0 - 1.0;
            let r = 4.0 + across * tilt.cos();
            mesh.positions.push(DVec3::new(r * u.cos(), r * u.sin(), across * tilt.sin()));
        }
    }
    let at = |i: u32, j: u32| {
        let turned = i == n && half_turns % 2 == 1;
        i % n * (ACROSS + 1) + if turned { ACROSS - j } else { j }
    };
    for (i, j) in (0..n).flat_map(|i| (0..ACROSS).map(move |j| (i, j))) {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

fn edges(triangles: &[[u32; 3]]) -> BTreeMap<[u32; 2], i32> {
    let mut edges = BTreeMap::new();
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    edges
}

/// Joins vertices at equal places.
fn welded(mesh: &lodpack::Mesh) -> Vec<[u32; 3]> {
    let mut ids = BTreeMap::new();
    let key = |v: u32| mesh.positions[v as usize].map(f64::to_bits);
    mesh.triangles
        .iter()
        .map(|t| {
            t.map(|v| {
                let next = ids.len() as u32;
                *ids.entry(key(v)).or_insert(next)
            })
        })
        .collect()
}

fn options(region_triangles: u64) -> BuildOptions {
    BuildOptions { region_triangles, chart_triangles: 300, effort: Effort::Fast, ..BuildOptions::default() }
}

fn built(mesh: &Mesh, region_triangles: u64) -> (BuildSummary, Vec<u8>) {
    let mut bytes = vec![];
    let summary = build_mesh(mesh.clone(), &options(region_triangles), &mut bytes, &Silent).expect("a sound mesh");
    (summary, bytes)
}

fn open_edges(triangles: &[[u32; 3]]) -> usize {
    edges(triangles).values().filter(|&&count| count == 1).count()
}

#[test]
fn a_closed_surface_stays_closed_at_every_mixture_of_levels() {
    let mesh = torus(96, 40);
    for limit in [100, 700, 3000] {
        let (summary, bytes) = built(&mesh, limit);
        assert_eq!((summary.repairs.boundary_edges, summary.repairs.components), (0, 1));
        assert!(summary.certified_error <= summary.tolerance);
        let file = File::open(bytes, Limits::default()).expect("what was written");
        for level in 0..file.level_count() as u8 {
            let cut = file.uniform_cut(level).expect("a level");
            assert_eq!(open_edges(&welded(&file.extract(&cut).expect("readable"))), 0, "{limit} {level}");
        }
        for triangles in [400, 900, 2000] {
            let query = Query {
                max_triangles: Some(triangles),
                region: Some([[0.0, -9.0, -9.0], [9.0, 9.0, 9.0]].into()),
                outside: lodpack::Outside::Coarsest,
                ..Query::default()
            };
            let Ok(cut) = file.select(&query) else { continue };
            assert_eq!(open_edges(&welded(&file.extract(&cut).expect("readable"))), 0);
        }
    }
}

#[test]
fn regions_cost_little_and_promise_the_same() {
    let mesh = torus(128, 64);
    let ((whole, _), (divided, _)) = (built(&mesh, u64::MAX), built(&mesh, 5000));
    assert!(divided.bytes < whole.bytes * 5 / 4, "{} {}", divided.bytes, whole.bytes);
    assert_eq!(divided.tolerance, whole.tolerance);
    assert!(divided.certified_error <= divided.tolerance);
}

#[test]
fn boundaries_of_the_input_are_the_only_ones() {
    let mesh = strip(120, 2);
    for limit in [60, 400] {
        let (summary, bytes) = built(&mesh, limit);
        assert_eq!(summary.repairs.boundary_edges, 240);
        assert_eq!(summary.repairs.unorientable_edges_cut, 0);
        let file = File::open(bytes, Limits::default()).expect("what was written");
        let finest = file.uniform_cut(file.level_count() as u8 - 1).expect("a level");
        let drawn = welded(&file.extract(&finest).expect("readable"));
        // Two loops: no boundary edge has its end inside.
        let open: Vec<[u32; 2]> = edges(&drawn).into_iter().filter(|&(_, count)| count == 1).map(|(e, _)| e).collect();
        let mut uses: BTreeMap<u32, u32> = BTreeMap::new();
        open.iter().flatten().for_each(|&v| *uses.entry(v).or_default() += 1);
        assert!(uses.values().all(|&count| count == 2));
    }
}

#[test]
fn windings_agree_across_regions_or_are_cut_once() {
    let mut mesh = torus(48, 24);
    let count = mesh.triangles.len();
    // The larger part wins.
    for t in &mut mesh.triangles[..count / 3] {
        t.swap(1, 2);
    }
    for limit in [u64::MAX, 500] {
        let regions = Regions::new(mesh.clone(), limit);
        assert_eq!(regions.repairs.components, 1);
        let volume: f64 = regions
            .regions
            .iter()
            .flat_map(|r| (0..r.mesh.triangles.len() as u32).map(move |t| r.mesh.corners(t)))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!(volume > 50.0, "{volume}");
    }
    let regions = Regions::new(strip(60, 1), 100);
    assert!(regions.regions.len() > 4);
    // Eight edges lie across the strip; it is cut along a line of about so many.
    let cut = regions.repairs.unorientable_edges_cut;
    assert!((8..=24).contains(&cut), "{cut}");
    assert_eq!(regions.repairs.boundary_edges, 120 + 2 * cut);
}

#[test]
fn partners_are_mutual_and_opposite() {
    let regions = Regions::new(torus(48, 24), 300);
    let edge = |(region, index): (u32, u32)| regions.regions[region as usize].border.edges[index as usize];
    for (region, partners) in (0..).zip(&regions.matching.partners) {
        for (index, partner) in (0..).zip(partners) {
            let partner = partner.expect("a closed surface has no boundary");
            assert_eq!(regions.matching.partners[partner.0 as usize][partner.1 as usize], Some((region, index)));
            let (a, b) = (edge((region, index)), edge(partner));
            assert_eq!(a.positions, [b.positions[1], b.positions[0]]);
            let opposite = &regions.regions[region as usize].adjacency.opposite;
            assert_eq!(opposite[a.half_edge as usize], NONE);
        }
    }
}

#[test]
fn the_order_of_triangles_decides_no_region() {
    let mesh = torus(48, 24);
    let mut reversed = mesh.clone();
    reversed.triangles.reverse();
    let sizes =
        |mesh| -> Vec<usize> { Regions::new(mesh, 300).regions.iter().map(|r| r.mesh.triangles.len()).collect() };
    assert_eq!(sizes(mesh), sizes(reversed));
}
