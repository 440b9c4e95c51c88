//! Small parts inside groups: every part keeps its topology under collapses, so a group of many has too many triangles.
//! First errors cease to matter, then parts do: of several parts nearby the largest stays, or vertices are clustered,
//! whichever is nearer.

use super::surface::Joined;
use crate::reduce::clustered;
use crate::reduce::{boundary_loops, manifold};
use glam::DVec3;
use lodpack_mesh::union_find::components;
use lodpack_mesh::{Mesh, NONE};
use lodpack_stage::certify::{CertifyOptions, TriangleBvh, two_sided};
use lodpack_stage::group::{Charts, divide};
use lodpack_stage::repair::sew;
use lodpack_stage::simplify::{LevelPatch, Quadric, SimplifyOptions, simplify_chart};

/// A group may have this many times the triangles that it should have.
const CROWDED: f64 = 1.5;
/// A part without a border is small if it has at most this many triangles.
const SMALL: usize = 256;
/// The fewest triangles that small parts may keep together.
const LEAST: usize = 32;
/// How tightly two ways to have fewer parts are compared.
const COMPARED: f64 = 0.25;

/// The surface of a group's members in its small parts and the rest.
pub(super) struct InParts<'a> {
    joined: &'a Joined,
    rest: Joined,
    small: Mesh,
}

impl<'a> InParts<'a> {
    /// None if there are no small parts.
    pub fn new(joined: &'a Joined) -> Option<Self> {
        let border = joined.border.iter().flatten().map(|&(_, vertex)| vertex);
        let is_small = small_parts(joined.positions.len(), &joined.triangles, border);
        let (small, triangles): (Vec<[u32; 3]>, Vec<[u32; 3]>) =
            joined.triangles.iter().partition(|corners| is_small[corners[0] as usize]);
        if small.is_empty() {
            return None;
        }
        let rest = Joined { triangles, areas: vec![], ..joined.clone() };
        Some(Self { joined, rest, small: Mesh { positions: joined.positions.clone(), triangles: small } })
    }

    /// A patch with about `wanted` triangles for a level; `patch` is the one that the level has so far, if it has all
    /// parts. Small parts keep at least `share` of their triangles: where the rest has too many, they do not pay for
    /// it. None if the patch has hardly more, or there is no other.
    pub fn with_fewer(
        &self,
        patch: Option<&LevelPatch>,
        level: usize,
        wanted: usize,
        share: f64,
    ) -> Option<LevelPatch> {
        let least = LEAST.max((self.small.triangles.len() as f64 * share) as usize);
        if patch.is_some_and(|patch| !is_crowded(patch, wanted)) {
            return None;
        }
        let rough = collapsed(self.joined, level, wanted);
        if rough.as_ref().is_some_and(|rough| !is_crowded(rough, wanted)) {
            return rough;
        }
        let thinned = rough.as_ref().or(patch).map(|patch| thinned(patch, wanted, least));
        let rest = match self.rest.triangles.is_empty() {
            true => Some(LevelPatch::default()),
            false => collapsed(&self.rest, level, wanted),
        };
        let clustered = rest.and_then(|rest| with_clusters(rest, &self.small, wanted, least));
        let original = TriangleBvh::new(&self.joined.positions, &self.joined.triangles);
        let options = CertifyOptions { relative_gap: COMPARED, ..CertifyOptions::default() };
        let distance = |patch: &LevelPatch| {
            let border = patch.border.iter().map(|&v| self.joined.positions[v as usize]);
            let positions: Vec<DVec3> = border.chain(patch.interior.iter().copied()).collect();
            two_sided(&original, &TriangleBvh::new(&positions, &patch.triangles), &options).upper
        };
        let candidates = thinned.into_iter().chain(clustered).filter(|patch| !patch.triangles.is_empty());
        let measured = candidates.map(|patch| (distance(&patch), patch));
        measured.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, patch)| patch).or(rough)
    }
}

/// Whether most of a surface consists of small parts.
pub(super) fn is_of_small_parts(surface: &Joined) -> bool {
    let border = surface.border.iter().flatten().map(|&(_, vertex)| vertex);
    let is_small = small_parts(surface.positions.len(), &surface.triangles, border);
    let count = surface.triangles.iter().filter(|corners| is_small[corners[0] as usize]).count();
    2 * count > surface.triangles.len()
}

fn is_crowded(patch: &LevelPatch, wanted: usize) -> bool {
    patch.triangles.len() as f64 > CROWDED * wanted as f64
}

/// For each vertex whether it belongs to a small part.
fn small_parts(vertex_count: usize, triangles: &[[u32; 3]], border: impl Iterator<Item = u32>) -> Vec<bool> {
    let component = components(vertex_count, triangles);
    let mut counts = vec![0_usize; vertex_count];
    triangles.iter().for_each(|corners| counts[component[corners[0] as usize] as usize] += 1);
    border.for_each(|v| counts[component[v as usize] as usize] = usize::MAX);
    component.iter().map(|&component| counts[component as usize] <= SMALL).collect()
}

/// A level of a surface with the given number of triangles, however far it is off then; more where topology needs more.
pub(super) fn collapsed(surface: &Joined, level: usize, wanted: usize) -> Option<LevelPatch> {
    let thresholds = vec![f64::INFINITY; level + 1];
    let options = SimplifyOptions {
        thresholds: &thresholds,
        coarsest: level,
        min_triangles: wanted,
        ..SimplifyOptions::default()
    };
    simplify_chart(&surface.chart(), &options).levels.pop().flatten()
}

/// Keeps only the largest small part of each of several sets nearby, so that they have at least about `least`
/// triangles.
fn thinned(patch: &LevelPatch, wanted: usize, least: usize) -> LevelPatch {
    let border_count = patch.border.len() as u32;
    let vertex_count = patch.border.len() + patch.interior.len();
    let component = components(vertex_count, &patch.triangles);
    let is_small = small_parts(vertex_count, &patch.triangles, 0..border_count);
    // By component: its number among small parts.
    let mut numbers = vec![NONE; vertex_count];
    let (mut weights, mut centres, mut areas) = (vec![], vec![], vec![]);
    for corners in patch.triangles.iter().filter(|corners| is_small[corners[0] as usize]) {
        let number = &mut numbers[component[corners[0] as usize] as usize];
        if *number == NONE {
            *number = weights.len() as u32;
            weights.push(0_u64);
            centres.push(DVec3::ZERO);
            areas.push(0.0_f64);
        }
        // Small parts have no vertex of the border.
        let [a, b, c] = corners.map(|v| patch.interior[(v - border_count) as usize]);
        let number = *number as usize;
        weights[number] += 1;
        centres[number] += (a + b + c) / 3.0;
        areas[number] += (b - a).cross(c - a).length();
    }
    centres.iter_mut().zip(&weights).for_each(|(centre, &weight)| *centre /= weight as f64);
    let small = weights.iter().sum::<u64>() as usize;
    let most = wanted.saturating_sub(patch.triangles.len() - small).max(least);
    let sets = most * weights.len() / small.max(1);
    let mut stays = vec![false; weights.len()];
    for set in divide(&Charts { weights: &weights, centres: &centres, pairs: &[] }, sets.max(1)) {
        let largest = set.into_iter().max_by(|&a, &b| areas[a as usize].total_cmp(&areas[b as usize]).then(b.cmp(&a)));
        largest.into_iter().for_each(|part| stays[part as usize] = true);
    }

    let mut result =
        LevelPatch { border: patch.border.clone(), border_loops: patch.border_loops.clone(), ..LevelPatch::default() };
    let mut own = vec![NONE; patch.interior.len()];
    for corners in &patch.triangles {
        let number = numbers[component[corners[0] as usize] as usize];
        if number != NONE && !stays[number as usize] {
            continue;
        }
        result.triangles.push(corners.map(|v| {
            let Some(inside) = v.checked_sub(border_count) else { return v };
            let own = &mut own[inside as usize];
            if *own == NONE {
                *own = border_count + result.interior.len() as u32;
                result.interior.push(patch.interior[inside as usize]);
                result.interior_quadrics.push(patch.interior_quadrics[inside as usize]);
            }
            *own
        }));
    }
    result
}

/// Clusters small parts, so that they and the rest have about `wanted` triangles. None if nothing would be left.
fn with_clusters(mut rest: LevelPatch, small: &Mesh, wanted: usize, least: usize) -> Option<LevelPatch> {
    let most = wanted.saturating_sub(rest.triangles.len()).max(least);
    let clusters = clustered(small, most, closed)?;
    rest.interior_was.clear();
    let mut numbers = vec![NONE; clusters.positions.len()];
    for corners in clusters.triangles {
        rest.triangles.push(corners.map(|v| {
            if numbers[v as usize] == NONE {
                numbers[v as usize] = (rest.border.len() + rest.interior.len()) as u32;
                rest.interior.push(clusters.positions[v as usize]);
                rest.interior_quadrics.push(Quadric::default());
            }
            numbers[v as usize]
        }));
    }
    Some(rest)
}

/// A surface whose sides balance at every edge as a manifold without a border; none if it cannot be one.
pub(super) fn closed(mesh: Mesh) -> Option<Mesh> {
    let (positions, triangles) = manifold(mesh.positions, mesh.triangles)?;
    // Surfaces that only touch in a vertex get one each.
    let (mesh, _) = sew(Mesh { positions, triangles });
    boundary_loops(&mesh.triangles, mesh.positions.len())?.is_empty().then_some(mesh)
}
