//! Tests of bounds by draping, against branch and bound and against samples.

use super::super::bound::MOST_WORK;
use super::super::tests::{Random, height_field, sampled, sphere, surface, wavy};
use super::super::{
    BorderPairing, Bound, CertifyOptions, Comparison, Hint, PairedVertex, Surface, TriangleBvh, two_sided,
};
use super::Map;
use crate::repair::repair;
use glam::DVec3;
use lodpack_mesh::Mesh;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

/// The paired border of a height field of `n` squares a side; every `step`-th vertex is one of the coarser field's.
fn square_pairing(n: u32, step: u32) -> BorderPairing {
    let ring = |n: u32| -> Vec<u32> {
        let side = |from: u32, by: i64| (0..n).map(move |k| (i64::from(from) + by * i64::from(k)) as u32);
        let w = i64::from(n) + 1;
        side(0, 1).chain(side(n, w)).chain(side(n * (n + 2), -1)).chain(side(n * (n + 1), -w)).collect()
    };
    let coarse = ring(n / step);
    let vertices = (0u32..).zip(ring(n));
    let partner = |k: u32| k.is_multiple_of(step).then(|| coarse[(k / step) as usize]);
    vec![vertices.map(|(k, fine)| PairedVertex { fine, coarse: partner(k) }).collect()]
}

/// Checks everything that holds if the finer surface can be laid onto the coarser.
fn check_along(fine: &Mesh, coarse: &Mesh, pairing: &BorderPairing, relative_gap: f64) -> Bound {
    let (f, c) = (surface(fine), surface(coarse));
    let options = CertifyOptions { relative_gap, ..Default::default() };
    let bound = along(fine, coarse, pairing, &options);
    let exact = two_sided(&f, &c, &CertifyOptions { relative_gap: 1e-3, ..Default::default() });
    assert!(bound.lower <= exact.upper && bound.upper >= exact.lower, "{bound:?} {exact:?}");
    assert!(bound.upper <= bound.lower * (1.0 + relative_gap) + 1e-11, "{bound:?} {exact:?}");
    assert!(bound.upper >= sampled(coarse, &f, 12).max(sampled(fine, &c, 4)) - 1e-12);
    bound
}

/// The bound of two surfaces that are laid onto each other where that is possible.
fn along(fine: &Mesh, coarse: &Mesh, pairing: &BorderPairing, options: &CertifyOptions) -> Bound {
    let [fine, coarse] = [fine, coarse].map(|mesh| Surface::new(&mesh.positions, &mesh.triangles));
    Comparison::new(&fine, &coarse, pairing, vec![]).two_sided(options)
}

/// The bound of two surfaces of which one is laid onto the other.
fn laid(fine: TriangleBvh, coarse: TriangleBvh, pairing: &BorderPairing, options: &CertifyOptions) -> Option<Bound> {
    Map::new(&Arc::new(fine), &Arc::new(coarse), pairing)?.two_sided(options)
}

#[test]
fn laying_a_surface_onto_another_bounds_both_directions() {
    let mut random = Random(8);
    for (step, amplitude) in [(1, 0.01), (2, 0.02), (4, 0.02), (4, 0.3), (8, 0.1)] {
        let mut fine = height_field(24, wavy);
        let mut coarse = height_field(24 / step, wavy);
        for mesh in [&mut fine, &mut coarse] {
            mesh.positions.iter_mut().for_each(|p| *p += random.point() * amplitude * DVec3::new(0.3, 0.3, 1.0));
        }
        for gap in [0.01, 0.25] {
            check_along(&fine, &coarse, &square_pairing(24, step), gap);
            if amplitude < 0.1 {
                let laid = laid(surface(&fine), surface(&coarse), &square_pairing(24, step), &Default::default());
                assert!(laid.is_some(), "{step} {amplitude}");
            }
            // The finer surface may also have the larger triangles, although that is slower.
            check_along(&coarse, &coarse, &square_pairing(24 / step, 1), gap);
        }
    }
}

#[test]
fn laying_settles_nearly_everything_at_once() {
    let (fine, coarse) = (height_field(64, wavy), height_field(16, wavy));
    let (f, c) = (surface(&fine), surface(&coarse));
    let options = CertifyOptions { relative_gap: 0.25, ..Default::default() };
    let (plain, along) = (two_sided(&f, &c, &options), along(&fine, &coarse, &square_pairing(64, 4), &options));
    assert!(5 * along.work < plain.work, "{along:?} {plain:?}");
}

#[test]
fn a_bump_that_the_finer_surface_lacks_is_found() {
    // Every vertex of the finer surface is on the coarser one, whose roof is seen only from its own side.
    let fine = height_field(24, |_, _| 0.0);
    let mut coarse = height_field(6, |_, _| 0.0);
    let peak = 3 * 7 + 3;
    coarse.positions[peak].z = 0.4;
    let bound = check_along(&fine, &coarse, &square_pairing(24, 4), 0.02);
    assert!(bound.lower > 0.39 && bound.upper < 0.41, "{bound:?}");
}

#[test]
fn surfaces_pushed_aside_and_folded_are_bounded() {
    // All inner vertices of the finer surface crowd together, or are mirrored: triangles overlap and reach far.
    let coarse = height_field(6, wavy);
    for push in [|p: DVec3| p * 0.3, |p: DVec3| DVec3::new(1.0 - p.x, p.y, p.z)] {
        let mut fine = height_field(24, wavy);
        for p in &mut fine.positions {
            if p.x.min(p.y) > 0.0 && p.x.max(p.y) < 1.0 {
                *p = push(*p);
            }
        }
        let (f, c) = (surface(&fine), surface(&coarse));
        let bound = along(&fine, &coarse, &square_pairing(24, 4), &CertifyOptions::default());
        let exact = two_sided(&f, &c, &CertifyOptions { relative_gap: 1e-3, ..Default::default() });
        assert!(bound.upper >= exact.lower && bound.upper <= exact.upper * 1.051, "{bound:?} {exact:?}");
    }
}

#[test]
fn surfaces_with_other_borders_are_not_laid() {
    let (fine, coarse) = (height_field(24, wavy), height_field(6, wavy));
    let pairing = square_pairing(24, 4);
    let options = CertifyOptions::default();
    let lies = |fine: &Mesh, coarse: &Mesh, pairing: &BorderPairing| {
        laid(surface(fine), surface(coarse), pairing, &options).is_some()
    };
    assert!(lies(&fine, &coarse, &pairing));
    for torn in [&[12usize, 700][..], &[0]] {
        let mut holed = fine.clone();
        for &t in torn {
            holed.triangles.remove(t);
        }
        assert!(!lies(&holed, &coarse, &pairing));
        // The bound still sees the hole.
        let bound = along(&holed, &coarse, &pairing, &options);
        assert!(bound.upper >= sampled(&coarse, &surface(&holed), 12));
    }
    let mut holed = coarse.clone();
    holed.triangles.remove(30);
    assert!(!lies(&fine, &holed, &pairing));
    let mut other = coarse.clone();
    other.triangles[3].swap(0, 1);
    assert!(!lies(&fine, &other, &pairing));
    assert!(!lies(&fine, &coarse, &vec![]) && !lies(&sphere(4), &sphere(2), &vec![]));
}

/// A mesh, with the ring of each of its borders.
#[derive(Clone)]
struct Sheet {
    mesh: Mesh,
    rings: Vec<Vec<u32>>,
}

/// Follows the edges with one triangle. A ring may pass a vertex twice.
fn rings(triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let edges = || triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let all: HashSet<(u32, u32)> = edges().collect();
    let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (a, b) in edges().filter(|&(a, b)| !all.contains(&(b, a))) {
        next.entry(a).or_default().push(b);
    }
    let mut rings = vec![];
    for start in next.keys().copied().collect::<Vec<u32>>() {
        let (mut ring, mut at) = (vec![], start);
        while let Some(to) = next.get_mut(&at).and_then(Vec::pop) {
            ring.push(at);
            at = to;
            if at == start {
                rings.push(std::mem::take(&mut ring));
            }
        }
    }
    rings
}

impl Sheet {
    fn new(mesh: Mesh) -> Self {
        Self { rings: rings(&mesh.triangles), mesh }
    }
}

/// A sphere without a border.
fn closed_ball(n: u32) -> Mesh {
    repair(sphere(n)).0
}

/// A sphere with `holes` holes of at least one triangle.
fn ball(n: u32, holes: usize, random: &mut Random) -> Mesh {
    let mut mesh = sphere(n);
    for _ in 0..holes {
        let hole = below(mesh.triangles.len(), random);
        let corner = mesh.triangles[hole][0];
        let whole = random.unit() < 0.5;
        mesh.triangles.swap_remove(hole);
        mesh.triangles.retain(|corners| !whole || !corners.contains(&corner));
    }
    mesh
}

/// Adds another mesh beside a mesh.
fn add(mesh: &mut Mesh, other: &Mesh, shift: DVec3) {
    let base = mesh.positions.len() as u32;
    mesh.positions.extend(other.positions.iter().map(|&p| p + shift));
    mesh.triangles.extend(other.triangles.iter().map(|corners| corners.map(|v| v + base)));
}

fn below(count: usize, random: &mut Random) -> usize {
    ((random.unit() * count as f64) as usize).min(count - 1)
}

/// A bumpy square of `n` squares a side with `holes` holes, which a tube joins if `handle` is set.
fn sheet(n: u32, holes: usize, handle: bool, random: &mut Random) -> Mesh {
    let (a, b, c) = (9.0 * random.unit(), 9.0 * random.unit(), 0.3 * random.unit());
    let mut mesh = height_field(n, |x, y| c * (a * x + b * y).sin() * (a * y - b * x * x).cos());
    let corners = [(1, 1), (n - 2, n - 2)];
    let squares: Vec<u32> = corners[..holes].iter().map(|&(i, j)| 2 * (j * n + i)).collect();
    let mut index = 0..;
    mesh.triangles.retain(|_| index.next().is_some_and(|t: u32| !squares.contains(&(t & !1))));
    if handle {
        let ring = |(i, j): (u32, u32)| {
            [j * (n + 1) + i, j * (n + 1) + i + 1, (j + 1) * (n + 1) + i + 1, (j + 1) * (n + 1) + i]
        };
        let (first, mut second) = (ring(corners[0]), ring(corners[1]));
        second.reverse();
        for k in 0..4 {
            let [p, q] = [first[k], first[(k + 1) % 4]];
            let [r, s] = [second[k], second[(k + 1) % 4]];
            mesh.triangles.extend([[p, q, s], [p, s, r]]);
        }
    }
    mesh
}

/// Surfaces of many kinds: with and without border, in one component or several.
fn base(kind: u32, n: u32, random: &mut Random) -> Sheet {
    let mut mesh = match kind {
        0..=2 => sheet(n, kind as usize, false, random),
        3 => sheet(n, 2, true, random),
        4 => ball(n / 2, 1 + below(4, random), random),
        7 | 8 => closed_ball(n / 2 + 1),
        _ => sheet(n / 2, 0, false, random),
    };
    // Two components, of which the second, or both, have no border.
    match kind {
        5 => add(&mut mesh, &sheet(n / 2, 0, false, random), DVec3::X * random.unit()),
        6 | 8 => add(&mut mesh, &closed_ball(2), random.point() * 2.0),
        _ => {}
    }
    Sheet::new(mesh)
}

impl Sheet {
    /// Divides every triangle into four. New vertices are up to `noise` off, border vertices included.
    fn divide(&self, noise: f64, random: &mut Random) -> Self {
        let mut mesh = Mesh { positions: self.mesh.positions.clone(), triangles: vec![] };
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let [p, q] = [a, b].map(|v| mesh.positions[v as usize]);
                mesh.positions.push((p + q) * 0.5 + random.point() * noise);
                mesh.positions.len() as u32 - 1
            })
        };
        for &[a, b, c] in &self.mesh.triangles {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            mesh.triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        let divided = |ring: &Vec<u32>| {
            let edges = ring.iter().zip(ring.iter().cycle().skip(1));
            edges.flat_map(|(&a, &b)| [a, middles[&(a.min(b), a.max(b))]]).collect()
        };
        Self { rings: self.rings.iter().map(divided).collect(), mesh }
    }

    /// Fewer triangles between the same border vertices.
    fn simplify(&self, share: f64) -> Self {
        let bytes: Vec<u8> =
            self.mesh.positions.iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_ne_bytes).collect();
        let vertices = meshopt::VertexDataAdapter::new(&bytes, 12, 0).unwrap();
        let indices = self.mesh.triangles.as_flattened();
        let target = (indices.len() as f64 * share) as usize / 3 * 3;
        let options = meshopt::SimplifyOptions::LockBorder;
        let found = meshopt::simplify(indices, &vertices, target, 1e3, options, None);
        let triangles = found.as_chunks::<3>().0.to_vec();
        Self { mesh: Mesh { positions: self.mesh.positions.clone(), triangles }, rings: self.rings.clone() }
    }

    /// Replaces a triangle by three around a vertex `away` from its middle, and those by three again, and so on: a
    /// spike, or a bubble with nothing of the other surface near it.
    fn grow(&mut self, triangle: usize, away: DVec3, rounds: usize) {
        for round in 0..rounds {
            let [a, b, c] = self.mesh.triangles[triangle];
            let middle = self.mesh.corners(triangle as u32).iter().sum::<DVec3>() / 3.0;
            let v = self.mesh.positions.len() as u32;
            self.mesh.positions.push(middle + away * if round == 0 { 1.0 } else { 0.3 });
            self.mesh.triangles[triangle] = [a, b, v];
            self.mesh.triangles.extend([[b, c, v], [c, a, v]]);
        }
    }
}

/// Damages a coarse surface, or makes it odd.
fn spoil(sheet: &mut Sheet, kind: u32, random: &mut Random) {
    let count = sheet.mesh.triangles.len();
    let triangle = below(count, random);
    let size = 0.05 + random.unit();
    match kind {
        // One vertex far off; two vertices exchanged; degenerate tiles.
        1 => sheet.mesh.positions[sheet.mesh.triangles[triangle][0] as usize] += random.point() * size,
        2 => {
            let [a, _, b] = sheet.mesh.triangles[triangle];
            sheet.mesh.positions.swap(a as usize, b as usize);
        }
        3 => {
            let [a, b, _] = sheet.mesh.triangles[triangle];
            sheet.mesh.positions[a as usize] = sheet.mesh.positions[b as usize];
        }
        // Spikes and bubbles.
        4 => sheet.grow(triangle, random.point() * size, 1),
        5 => sheet.grow(triangle, random.point() * size, 5),
        6 => {
            sheet.grow(triangle, DVec3::ZERO, 1);
            sheet.grow(triangle, random.point() * size, 3);
        }
        // A missing triangle, and a triangle that occurs twice.
        7 => drop(sheet.mesh.triangles.swap_remove(triangle)),
        8 => {
            let base = sheet.mesh.positions.len() as u32;
            let corners = sheet.mesh.corners(triangle as u32).map(|p| p + DVec3::Z * size);
            sheet.mesh.positions.extend(corners);
            sheet.mesh.triangles.push([base, base + 1, base + 2]);
        }
        _ => {}
    }
}

/// Makes a fine surface odd: triangles that crowd together, fold over or are mirrored.
fn distort(sheet: &mut Sheet, kind: u32, random: &mut Random) {
    let (axis, bend) = (random.point(), 1.0 + 2.0 * random.unit());
    let at_border: Vec<u32> = sheet.rings.iter().flatten().copied().collect();
    for (v, p) in sheet.mesh.positions.iter_mut().enumerate() {
        if at_border.contains(&(v as u32)) {
            continue;
        }
        match kind {
            1 => *p += axis * (bend * p.dot(axis) * 3.0).sin() * 0.2,
            2 => *p *= 0.4,
            3 => p.x = 1.0 - p.x,
            4 => *p += random.point() * 0.15,
            _ => {}
        }
    }
}

/// Damages a fine surface.
fn tear(sheet: &mut Sheet, kind: u32, random: &mut Random) {
    let triangle = below(sheet.mesh.triangles.len(), random);
    let [a, b, c] = sheet.mesh.triangles[triangle];
    match kind {
        // Missing, double, triple, degenerate.
        1 => drop(sheet.mesh.triangles.swap_remove(triangle)),
        2 => sheet.mesh.triangles.push([a, b, c]),
        3 => sheet.mesh.triangles.extend([[a, b, c], [a, c, b]]),
        4 => sheet.mesh.triangles.push([a, a, b]),
        5 => sheet.mesh.triangles.extend([[a, a, b], [a, a, c]]),
        6 => sheet.mesh.positions[a as usize] = sheet.mesh.positions[b as usize],
        // A hole with its border, filled elsewhere.
        7 => {
            sheet.mesh.triangles.retain(|corners| !corners.contains(&a));
            sheet.rings = rings(&sheet.mesh.triangles);
        }
        _ => {}
    }
}

/// Damages a pairing: wrong or missing partners, missing or reversed rings.
fn confuse(pairing: &mut BorderPairing, kind: u32, random: &mut Random) {
    if pairing.is_empty() {
        return;
    }
    let which = below(pairing.len(), random);
    let ring = &mut pairing[which];
    let at: Vec<usize> = (0..ring.len()).filter(|&k| ring[k].coarse.is_some()).collect();
    let partners: Vec<Option<u32>> = at.iter().map(|&k| ring[k].coarse).collect();
    let by = below(ring.len(), random);
    match kind {
        1 if !at.is_empty() => ring[at[by % at.len()]].coarse = None,
        2 if !at.is_empty() => (0..at.len()).for_each(|k| ring[at[k]].coarse = partners[(k + by) % at.len()]),
        3 if !at.is_empty() => (0..at.len()).for_each(|k| ring[at[k]].coarse = partners[at.len() - 1 - k]),
        4 if at.len() > 2 => {
            let (k, l) = (by % at.len(), (by + 1) % at.len());
            (ring[at[k]].coarse, ring[at[l]].coarse) = (partners[l], partners[k]);
        }
        5 => drop(pairing.remove(which)),
        6 => ring.reverse(),
        7 => ring.rotate_left(by),
        8 => drop(ring.remove(by)),
        _ => {}
    }
}

/// How many random cases were laid, and how many of those with nothing wrong were.
#[derive(Default, Debug)]
struct Tally {
    laid: usize,
    sane: usize,
    sane_laid: usize,
    closed_laid: usize,
    exceeding: usize,
}

/// Runs random cases; each depends on its number alone.
fn try_at_random(numbers: std::ops::RangeInclusive<u64>) -> Tally {
    let mut tally = Tally::default();
    for seed in numbers {
        let random = &mut Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        let mut pick = |count: u32| (random.unit() * f64::from(count)) as u32;
        let (n, kind, spoilt, distorted, torn, confused) =
            (4 + pick(5), pick(9), pick(13), pick(9), pick(14), pick(16));
        let divided = pick(2) == 1;
        let base = base(kind, n, random);
        let noise = [0.0, 0.01, 0.05][below(3, random)];
        let mut coarse = base.simplify(0.15 + 0.85 * random.unit());
        coarse.mesh.positions.iter_mut().for_each(|p| *p += random.point() * noise * 0.3);
        if kind > 6 && random.unit() < 0.3 {
            // On a coarse lattice, triangles become lines, and some lie on others.
            coarse.mesh.positions.iter_mut().for_each(|p| *p = (*p * 2.0).round() / 2.0);
        }
        spoil(&mut coarse, spoilt, random);
        // The finer surface is the same, or has four times the triangles.
        let mut fine = if divided { base.divide(noise, random) } else { base.clone() };
        distort(&mut fine, distorted, random);
        tear(&mut fine, torn, random);
        let is_partner = |v: u32| (v as usize) < base.mesh.positions.len();
        let vertex = |&v: &u32| PairedVertex { fine: v, coarse: is_partner(v).then_some(v) };
        let mut pairing: BorderPairing = fine.rings.iter().map(|ring| ring.iter().map(vertex).collect()).collect();
        confuse(&mut pairing, confused, random);
        if fine.mesh.triangles.is_empty() || coarse.mesh.triangles.is_empty() {
            continue;
        }
        let (f, c) = (Arc::new(surface(&fine.mesh)), Arc::new(surface(&coarse.mesh)));
        // It takes very long to tell equal surfaces with different triangles apart exactly.
        let floor = 1e-4;
        let exact = two_sided(&f, &c, &CertifyOptions { relative_gap: 1e-2, floor, ..Default::default() });
        let sampled = sampled(&coarse.mesh, &f, 8).max(sampled(&fine.mesh, &c, 3));
        let relative_gap = [0.01, 0.25, 1.0][below(3, random)];
        let target = (random.unit() < 0.3).then_some(exact.upper * 2.0 * random.unit());
        let options = CertifyOptions { relative_gap, target, floor, ..Default::default() };
        let what = format!("seed {seed}: {kind} {spoilt} {distorted} {torn} {confused}");
        let mut map = Map::new(&f, &c, &pairing);
        let is_laid = map.as_mut().is_some_and(|map| map.two_sided(&options).is_some());
        // The same map, asked for what is too far off, leaves out no triangle with a corner that is.
        let beyond = exact.upper * 0.6;
        if let Some(found) = map.filter(|_| is_laid).and_then(|mut map| map.exceeding(beyond, u64::MAX)) {
            for (mesh, from, side) in [(&fine.mesh, &c, 0), (&coarse.mesh, &f, 1)] {
                let is_beyond = |v: &u32| {
                    from.closest(mesh.positions[*v as usize], &mut Hint::default()).distance
                        > beyond * (1.0 + 1e-9) + 1e-11
                };
                let missing =
                    (0..).zip(&mesh.triangles).find(|(t, v)| v.iter().any(is_beyond) && !found[side].contains(t));
                assert!(missing.is_none(), "{what} {missing:?} {found:?}");
                tally.exceeding += found[side].len();
            }
        }
        tally.laid += usize::from(is_laid);
        tally.closed_laid += usize::from(is_laid && fine.rings.is_empty());
        if kind < 6 && ![1, 2, 7, 8].contains(&spoilt) && !(1..=4).contains(&distorted) && torn > 7 && confused > 8 {
            tally.sane += 1;
            tally.sane_laid += usize::from(is_laid);
        }
        let bound = along(&fine.mesh, &coarse.mesh, &pairing, &options);
        assert!(
            bound.upper >= exact.lower - 1e-11 && bound.upper >= sampled - 1e-11,
            "{what} {bound:?} {exact:?} {sampled}"
        );
        // Between parts that correspond there may be more than to whatever is nearest.
        let is_by_part = {
            let [fine, coarse] = [&fine.mesh, &coarse.mesh].map(|mesh| Surface::new(&mesh.positions, &mesh.triangles));
            Comparison::new(&fine, &coarse, &pairing, vec![]).part_count() > 1
        };
        assert!(is_by_part || bound.lower <= exact.upper + 1e-11, "{what} {bound:?} {exact:?}");
        let tight = (bound.lower * (1.0 + relative_gap)).max(target.unwrap_or(0.0)).max(floor);
        // If the work ended first, the bound is valid but not as tight.
        assert!(bound.work > MOST_WORK || bound.upper <= tight + 1e-11, "{what} {bound:?} {exact:?}");
    }
    tally
}

#[test]
fn no_bound_is_below_what_samples_show() {
    let tally = try_at_random(1..=500);
    assert!(
        tally.exceeding > 500 && tally.laid > 100 && tally.closed_laid > 10 && 4 * tally.sane_laid > 3 * tally.sane,
        "{tally:?}"
    );
}

#[test]
#[ignore = "takes two minutes"]
fn no_bound_is_below_what_samples_show_in_many_cases() {
    println!("{:?}", try_at_random(501..=30_000));
}
