//! Files of meshes that are divided into regions.

use std::collections::BTreeMap;

use glam::DVec3;
use lodpack::{File, Limits, Query};

use crate::job::build::build_imported;
use crate::job::{BuildOptions, build_mesh};
use crate::pipeline::ModelOptions;
use crate::pipeline::summary::{BuildSummary, Stopwatch};
use crate::region::{Division, Region, RegionStore, Regions};
use lodpack_cli::measure::verify::inspect_edges;
use lodpack_import::{Imported, Overflow, Room};
use lodpack_mesh::{Mesh, NONE};
use lodpack_runtime::progress::Silent;

/// A torus of 2 n m triangles, wound outward.
pub(super) fn torus(n: u32, m: u32) -> Mesh {
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
    let model = ModelOptions { region_triangles, chart_triangles: Some(300), ..ModelOptions::default() };
    BuildOptions { model, ..BuildOptions::default() }
}

fn built(mesh: &Mesh, region_triangles: u64) -> (BuildSummary, Vec<u8>) {
    let mut bytes = vec![];
    let summary = build_mesh(mesh.clone(), &options(region_triangles), &mut bytes, &Silent).expect("a sound mesh");
    (summary, bytes)
}

fn regions(mesh: Mesh, limit: u64) -> Regions {
    Regions::in_memory(mesh.into(), Division { triangles: limit, is_fixed: false })
}

fn held(regions: &Regions) -> &[Region] {
    let RegionStore::Memory(held) = &regions.store else { panic!("no disk is used") };
    held
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
                volume: Some([[0.0, -9.0, -9.0], [9.0, 9.0, 9.0]].into()),
                outside: lodpack::Outside::Coarsest,
                ..Query::default()
            };
            let Ok(cut) = file.select(&query) else { continue };
            assert_eq!(open_edges(&welded(&file.extract(&cut).expect("readable"))), 0);
        }
    }
}

#[test]
fn groups_above_regions_end_in_one_root_of_few_triangles() {
    let mesh = torus(192, 80);
    for (limit, least) in [(u64::MAX, 1), (12_000, 2), (3000, 8), (700, 30)] {
        let (summary, bytes) = built(&mesh, limit);
        let count = regions(mesh.clone(), limit).store.count();
        assert!(count >= least, "{count} regions");
        let file = File::open(bytes, Limits::default()).expect("what was written");
        file.verify().expect("sound");
        assert_eq!(file.top_count(), 1, "{limit}");
        let coarsest = &summary.levels[0];
        assert!(coarsest.triangles <= 500, "{limit}: {}", coarsest.triangles);
        let top = file.select(&Query { max_nodes: Some(1), ..Query::default() }).expect("one root");
        assert_eq!(open_edges(&welded(&file.extract(&top).expect("readable"))), 0);
        // The summary says what the file says.
        for (level, own) in (0..).zip(&summary.levels) {
            let cut = file.uniform_cut(level).expect("a level");
            assert_eq!(own.triangles, cut.triangle_count, "{limit} {level}");
            assert!(own.certified_error >= cut.error, "{limit} {level}");
        }
    }
}

#[test]
fn narrow_holes_between_two_roots_close_at_coarse_levels_and_are_counted_so() {
    let mut mesh = torus(96, 40);
    // Holes of four triangles each, many of which lie between two roots: two arcs run from corner to corner.
    mesh.triangles = (0..).zip(mesh.triangles).filter(|(t, _)| t % 61 > 3).map(|(_, t)| t).collect();
    let mut closed = 0;
    for limit in [u64::MAX, 1000, 150] {
        let (_, bytes) = built(&mesh, limit);
        let file = File::open(bytes, Limits::default()).expect("what was written");
        let mut uses = BTreeMap::new();
        for root in 0..file.root_count() {
            let loops = file.root_contents(root).expect("readable").loops;
            loops.iter().flatten().for_each(|half_arc| *uses.entry(half_arc.arc as usize).or_insert(0) += 1);
        }
        let arcs = file.borders().expect("readable").arcs;
        for level in 0..file.level_count() as u8 {
            let cut = file.uniform_cut(level).expect("a level");
            let count = file.boundary_edge_count(&cut).expect("readable");
            let mesh = file.extract(&cut).expect("readable");
            assert_eq!(inspect_edges(&mesh.triangles).boundary.len() as u64, count, "{limit} {level}");
            let is_open = |arc: &usize| uses[arc] == 1;
            let edges = |arc: usize| arcs[arc].samples.iter().filter(|sample| sample.level <= level).count() as u64 + 1;
            closed += (0..arcs.len()).filter(is_open).map(edges).sum::<u64>().saturating_sub(count);
        }
    }
    assert!(closed > 0, "no hole has closed");
}

#[test]
fn regions_may_touch_themselves_and_each_other_anywhere() {
    // Where a region touches itself at a vertex, two of its vertices are one corner of the whole surface.
    for mesh in [torus(40, 20), strip(60, 1), messy()] {
        for limit in (20..400).step_by(31) {
            let (summary, bytes) = built(&mesh, limit);
            assert!(summary.certified_error <= summary.tolerance);
            let file = File::open(bytes, Limits::default()).expect("what was written");
            file.verify().expect("sound");
        }
    }
}

#[test]
fn regions_cost_little_and_promise_the_same() {
    let mesh = torus(128, 64);
    let ((whole, _), (divided, _)) = (built(&mesh, u64::MAX), built(&mesh, 5000));
    assert!(divided.bytes < whole.bytes * 5 / 4, "{} {}", divided.bytes, whole.bytes);
    assert_eq!(divided.tolerance, whole.tolerance);
    assert_eq!(divided.input_vertices, whole.input_vertices, "vertices of seams count once");
    assert!(divided.certified_error <= divided.tolerance);
}

#[test]
fn vertices_of_seams_count_once_wherever_regions_meet_and_turn() {
    let mut turned = torus(40, 20);
    turned.triangles.iter_mut().filter(|t| t[0] % 40 < 20).for_each(|t| t.swap(1, 2));
    // A strip of one half turn is cut open somewhere else in each case.
    for mesh in [torus(40, 20), strip(60, 2), turned] {
        let vertices = |limit| {
            let regions = regions(mesh.clone(), limit);
            regions.stats.iter().map(|stats| stats.extent.vertices).sum::<u64>() - regions.doubled_vertices
        };
        let whole = vertices(u64::MAX);
        assert!((20..400).step_by(31).all(|limit| vertices(limit) == whole));
    }
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
        let regions = regions(mesh.clone(), limit);
        assert_eq!(regions.repairs.components, 1);
        let volume: f64 = held(&regions)
            .iter()
            .flat_map(|r| (0..r.mesh.triangles.len() as u32).map(move |t| r.mesh.corners(t)))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!(volume > 50.0, "{volume}");
    }
    let regions = regions(strip(60, 1), 100);
    assert!(regions.store.count() > 4);
    // Eight edges lie across the strip; it is cut along a line of about eight.
    let cut = regions.repairs.unorientable_edges_cut;
    assert!((8..=24).contains(&cut), "{cut}");
    assert_eq!(regions.repairs.boundary_edges, 120 + 2 * cut);
}

#[test]
fn partners_are_mutual_and_opposite() {
    let regions = regions(torus(48, 24), 300);
    let edge = |(region, index): (u32, u32)| regions.stats[region as usize].boundary.edges[index as usize];
    for (region, partners) in (0..).zip(&regions.matching.partners) {
        for (index, partner) in (0..).zip(partners) {
            let partner = partner.expect("a closed surface has no boundary");
            assert_eq!(regions.matching.partners[partner.0 as usize][partner.1 as usize], Some((region, index)));
            let (a, b) = (edge((region, index)), edge(partner));
            assert_eq!(a.positions, [b.positions[1], b.positions[0]]);
            let opposite = &held(&regions)[region as usize].adjacency.opposite;
            assert_eq!(opposite[a.half_edge as usize], NONE);
        }
    }
}

#[test]
fn the_order_of_triangles_decides_no_region() {
    let mesh = torus(48, 24);
    let mut reversed = mesh.clone();
    reversed.triangles.reverse();
    let sizes = |mesh| -> Vec<usize> { held(&regions(mesh, 300)).iter().map(|r| r.mesh.triangles.len()).collect() };
    assert_eq!(sizes(mesh), sizes(reversed));
}

/// A mesh with all that repair mends, both windings, and vertices that nothing uses.
pub(super) fn messy() -> Mesh {
    let mut mesh = torus(64, 32);
    let count = mesh.triangles.len();
    mesh.triangles[..count / 3].iter_mut().for_each(|t| t.swap(1, 2));
    mesh.triangles.extend([[0, 1, 1], mesh.triangles[7], [5, 6, 900]]);
    mesh.positions.insert(0, DVec3::new(9.0, 0.0, -0.0));
    mesh.triangles.iter_mut().flatten().for_each(|v| *v += 1);
    // A soup: every third triangle has vertices of its own.
    for t in (0..count).step_by(3) {
        for k in 0..3 {
            mesh.positions.push(mesh.positions[mesh.triangles[t][k] as usize]);
            mesh.triangles[t][k] = mesh.positions.len() as u32 - 1;
        }
    }
    mesh
}

#[test]
fn a_build_from_disk_gives_the_bytes_of_one_in_memory() {
    let mesh = messy();
    for limit in [300, 1000, u64::MAX] {
        let parent = tempfile::tempdir().expect("a temporary directory");
        let (in_memory, expected) = built(&mesh, limit);
        // Enough for one region, and for several at once.
        for memory in [lodpack_runtime::storage::memory::least_bytes(0) + 130 * 4500 + 24 * 7000, 1 << 30] {
            let options = BuildOptions { memory, work: parent.path().join("work"), ..options(limit) };
            let mut bytes = vec![];
            let room = Room { memory: 1000, overflow: Overflow::New(options.work.clone()) };
            let spilled = Imported::new(mesh.clone(), &room).expect("there is space");
            let summary =
                build_imported(spilled, &options, &mut bytes, &Silent, Stopwatch::default()).expect("a sound mesh");
            assert!(bytes == expected, "{limit} {memory}");
            assert!(summary.temporary_bytes > 100_000, "{}", summary.temporary_bytes);
            assert_eq!((summary.repairs, in_memory.temporary_bytes), (in_memory.repairs.clone(), 0));
        }
        assert_eq!(std::fs::read_dir(parent.path()).expect("readable").count(), 0, "temporary files are left");
    }
}

#[test]
fn memory_for_less_than_a_region_is_refused_with_what_would_do() {
    let parent = tempfile::tempdir().expect("a temporary directory");
    let build = |memory| {
        let options = BuildOptions { memory, work: parent.path().join("work"), ..options(1000) };
        build_mesh(torus(64, 32), &options, &mut vec![], &Silent).map_err(|error| error.to_string())
    };
    let message = build(100_000).expect_err("far too little");
    let least: u64 = message
        .rsplit_once("--memory ")
        .and_then(|(_, size)| size.strip_suffix("MiB"))
        .and_then(|size| size.parse().ok())
        .expect("a size");
    assert!(build((least - 1) << 20).is_err() && build(least << 20).is_ok(), "{message}");
    assert_eq!(std::fs::read_dir(parent.path()).expect("readable").count(), 0);
    // A directory that is not there is named.
    let options = BuildOptions { memory: 100_000, work: parent.path().join("nowhere/work"), ..options(1000) };
    let error = build_mesh(torus(64, 32), &options, &mut vec![], &Silent).expect_err("no place").to_string();
    assert!(error.contains("nowhere"), "{error}");
}
