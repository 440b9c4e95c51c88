//! The coarsest levels of a region as one surface, and those of all regions joined: the overview is made from them.

use super::Plan;
use super::manifold::{boundary_loops, manifold, open_edges};
use super::overview::OVERVIEW_TRIANGLES;
use super::product::drawn_at;
use glam::DVec3;
use lodpack::{
    File, Limits,
    index::HalfArc,
    write::{ArcRecord, BlockRecord, Model, RootRecord},
};
use lodpack_mesh::{Mesh, NONE};
use lodpack_stage::arcs::closest_on_segment;
use lodpack_stage::areas::Areas;
use lodpack_stage::certify::{self, CertifyOptions, two_sided};
use lodpack_stage::chart::ChartMesh;
use lodpack_stage::simplify::{SimplifyOptions, simplify_chart};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// How many of the coarsest levels an overview may be made from.
const MAX_LEVELS_TRIED: usize = 2;
/// About how many triangles all regions may keep together: four times the overview's, so that it loses little.
const ALL_TRIANGLES: u64 = 4 * OVERVIEW_TRIANGLES as u64;
/// Triangles that a region may keep where more regions can be added later.
const EXTENSIBLE_TRIANGLES: u64 = 512;
/// See [`SimplifyOptions::stops`].
pub(super) const STOPS: [f64; 3] = [16.0, 8.0, 4.0];
/// The most edges of a hole that may be a crack between two levels.
const MAX_CRACK_EDGES: usize = 64;
/// Triangles that a region may keep, however many regions there are.
const LEAST_TRIANGLES: u64 = 64;

/// A coarse surface, and how far it lies from the input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct CoarseSurface {
    /// Relative to the lattice's origin.
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Bound of the two-sided distance to the input.
    pub error: f64,
}

/// Triangles to which the coarse surfaces of each region are simplified.
pub(super) fn coarse_triangles(regions: u64, extensible: bool) -> u64 {
    if extensible { EXTENSIBLE_TRIANGLES } else { (ALL_TRIANGLES / regions.max(1)).max(LEAST_TRIANGLES) }
}

/// The coarsest levels of a region, the finer one first: it lies nearer to the input, and so does an overview made from it (17 instead
/// of 21 mean edges on 8 M triangles). None if the file needs no overview. Where there are several regions, each is simplified,
/// except at its boundary.
///
/// # Errors
/// As [`lodpack::write::write_file`].
pub(super) fn coarse_surfaces(model: &Model, plan: &Plan) -> lodpack::Result<Vec<CoarseSurface>> {
    // Above regions, the coarsest group serves.
    if !plan.has_overview() || plan.scale.coarsest_of_regions > 0 {
        return Ok(vec![]);
    }
    // The surface is what a reader would draw.
    let mut bytes = vec![];
    lodpack::write::write_file(&coarsest_levels(model), &mut bytes)?;
    let file = File::open(bytes.as_slice(), Limits::default())?;
    let exact = |p: &[f64; 3]| plan.scale.local_from_lattice(model.lattice.units(*p).map(|x| x.round() as i64));
    let mut surfaces = vec![];
    for level in (0..file.level_count().min(MAX_LEVELS_TRIED) as u8).rev() {
        let cut = file.uniform_cut(level)?;
        let mesh = file.extract(&cut)?;
        let positions = mesh.positions.iter().map(exact).collect();
        let surface = CoarseSurface { positions, triangles: mesh.triangles, error: cut.error };
        let is_alone = plan.regions == 1;
        let target = plan.coarse_triangles as usize;
        surfaces.push(if is_alone { surface } else { thinned(&surface, target).unwrap_or(surface) });
    }
    Ok(surfaces)
}

/// The model reduced to what is drawn at its coarsest levels.
fn coarsest_levels(model: &Model) -> Model {
    let mut blocks: BTreeMap<u32, BTreeSet<usize>> = BTreeMap::new();
    for (root, level) in (0..model.levels.len().min(MAX_LEVELS_TRIED)).flat_map(|level| drawn_at(model, level)) {
        blocks.entry(root).or_default().insert(level);
    }
    let roots: Vec<u32> = blocks.keys().copied().collect();
    let used = |root: &u32| model.roots[*root as usize].loops.iter().flatten().map(|half_arc| half_arc.arc);
    let arcs: Vec<u32> = roots.iter().flat_map(used).collect::<BTreeSet<u32>>().into_iter().collect();
    let ends = arcs.iter().flat_map(|&arc| model.arcs[arc as usize].ends);
    let corners: Vec<u32> = ends.collect::<BTreeSet<u32>>().into_iter().collect();
    let place = |all: &[u32], one: u32| all.binary_search(&one).unwrap_or_default() as u32;
    let arc = |&arc: &u32| {
        let ArcRecord { ends, samples } = &model.arcs[arc as usize];
        ArcRecord { ends: ends.map(|end| place(&corners, end)), samples: samples.clone() }
    };
    let half_arc = |half_arc: &HalfArc| HalfArc { arc: place(&arcs, half_arc.arc), ..*half_arc };
    let coarse = |(root, levels): (&u32, &BTreeSet<usize>)| {
        let root = &model.roots[*root as usize];
        let bare = |block: &BlockRecord| BlockRecord { symbols: block.symbols.clone(), texels: vec![], ..*block };
        let keep = |(level, block): (usize, &Option<BlockRecord>)| {
            block.as_ref().filter(|_| levels.contains(&level)).map(bare)
        };
        RootRecord {
            loops: root.loops.iter().map(|half_arcs| half_arcs.iter().map(half_arc).collect()).collect(),
            bounds: root.bounds,
            filling: root.filling,
            parent: root.parent.map(|parent| place(&roots, parent)),
            blocks: root.blocks.iter().enumerate().map(keep).collect(),
        }
    };
    Model {
        levels: model.levels.clone(),
        source: model.source.clone(),
        placement: model.placement.clone(),
        corners: corners.iter().map(|&corner| model.corners[corner as usize]).collect(),
        corner_levels: corners.iter().filter_map(|&c| model.corner_levels.get(c as usize).copied()).collect(),
        arcs: arcs.iter().map(arc).collect(),
        roots: blocks.iter().map(coarse).collect(),
        channels: vec![],
        overview: None,
        ..*model
    }
}

/// The surface with about the given number of triangles inside its boundary, which stays. None if it cannot be simplified.
fn thinned(surface: &CoarseSurface, triangles: usize) -> Option<CoarseSurface> {
    let chart = surface.chart()?;
    let Mesh { positions, triangles } = collapsed(&chart, triangles)?;
    let error = surface.error_of(&chart.positions, &chart.triangles, &positions, &triangles);
    Some(CoarseSurface { positions, triangles, error })
}

/// A surface simplified to the given number of triangles with its topology and the border that it has to keep; more triangles where these need
/// more.
pub(super) fn collapsed(chart: &ChartMesh, triangles: usize) -> Option<Mesh> {
    collapsed_in_areas(chart, None, triangles, &STOPS, None).map(|(mesh, _)| mesh)
}

/// As [`collapsed`], with lines between areas that stay as near as the surface; and the area of each triangle, if some are given. `stops` are
/// as in [`SimplifyOptions::stops`].
pub(super) fn collapsed_in_areas(
    chart: &ChartMesh,
    areas: Option<Areas<'_>>,
    triangles: usize,
    stops: &[f64],
    importance: Option<&[f32]>,
) -> Option<(Mesh, Vec<u32>)> {
    // A collapse takes two triangles.
    let least = triangles.saturating_sub(1).max(1);
    let options = SimplifyOptions {
        thresholds: &[f64::INFINITY],
        min_triangles: least,
        stops,
        areas,
        importance,
        ..SimplifyOptions::default()
    };
    let patch = simplify_chart(chart, &options).levels.pop().flatten()?;
    let border = patch.border.iter().map(|&v| chart.positions[v as usize]);
    let positions = border.chain(patch.interior.iter().copied()).collect();
    Some((Mesh { positions, triangles: patch.triangles }, patch.areas))
}

impl CoarseSurface {
    /// The surface as a manifold with its boundary, which stays whole. None if the boundary touches itself.
    pub fn chart(&self) -> Option<ChartMesh> {
        let (positions, triangles) = manifold(self.positions.clone(), self.triangles.clone())?;
        let loops = boundary_loops(&triangles, positions.len())?;
        Some(ChartMesh { positions, triangles, loops })
    }

    /// Bounds the distance of a simplified surface from the input. `whole` is this surface as a manifold.
    pub fn error_of(
        &self,
        whole: &[DVec3],
        whole_triangles: &[[u32; 3]],
        positions: &[DVec3],
        triangles: &[[u32; 3]],
    ) -> f64 {
        let whole = certify::TriangleBvh::new(whole, whole_triangles);
        let drawn = certify::TriangleBvh::new(positions, triangles);
        self.error_at(two_sided(&whole, &drawn, &CertifyOptions::default()).upper)
    }

    /// Bounds the distance from the input of what is no farther than `distance` from this surface, and it from that.
    pub fn error_at(&self, distance: f64) -> f64 {
        error_sum(self.error, distance)
    }

    /// Joins surfaces that share parts of their boundaries.
    pub fn joined(surfaces: Vec<Self>) -> Self {
        let is_several = surfaces.len() > 1;
        let mut surfaces = surfaces.into_iter();
        let mut all = surfaces.next().unwrap_or_default();
        // Only boundary vertices are joined: inside, two vertices at one position need not be the same.
        let mut shared: BTreeMap<[u64; 3], u32> = BTreeMap::new();
        if is_several {
            shared.extend(all.boundary_vertices().map(|v| (key(all.positions[v as usize]), v)));
        }
        for surface in surfaces {
            let mut numbers = vec![NONE; surface.positions.len()];
            for v in surface.boundary_vertices() {
                let position = surface.positions[v as usize];
                numbers[v as usize] = *shared.entry(key(position)).or_insert_with(|| all.add(position));
            }
            for (number, &position) in numbers.iter_mut().zip(&surface.positions) {
                if *number == NONE {
                    *number = all.add(position);
                }
            }
            all.triangles.extend(surface.triangles.iter().map(|corners| corners.map(|v| numbers[v as usize])));
            all.error = all.error.max(surface.error);
        }
        if is_several {
            all.close_cracks();
        }
        all
    }

    /// Closes holes that are no wider than the error. Seams have such holes where the roots on both sides are drawn at different levels,
    /// because the regions do not know of each other's levels.
    fn close_cracks(&mut self) {
        if open_edges(&self.triangles).is_empty() {
            return;
        }
        // Touching loops can be told apart once every vertex has one fan.
        let Some(manifold) = manifold(self.positions.clone(), self.triangles.clone()) else { return };
        (self.positions, self.triangles) = manifold;
        let Some(loops) = boundary_loops(&self.triangles, self.positions.len()) else { return };
        let mut widest = 0.0f64;
        for border in loops.iter().filter(|border| border.len() <= MAX_CRACK_EDGES) {
            let vertices: Vec<u32> = border.iter().map(|b| b.vertex).collect();
            let (triangles, width) = filled(&vertices, &self.positions);
            if width <= self.error {
                widest = widest.max(width);
                self.triangles.extend(triangles);
            }
        }
        if widest > 0.0 {
            // Rounded up, by more than the error of the addition.
            self.error = (self.error + widest) * (1.0 + 1e-12);
        }
    }

    fn add(&mut self, position: DVec3) -> u32 {
        self.positions.push(position);
        self.positions.len() as u32 - 1
    }

    /// The vertices of open edges.
    fn boundary_vertices(&self) -> impl Iterator<Item = u32> + use<> {
        open_edges(&self.triangles).into_iter().map(|[first, _]| first)
    }
}

/// The sum of two bounds, rounded up, since adding may round down.
pub(super) fn error_sum(error: f64, distance: f64) -> f64 {
    (error + distance) * (1.0 + 2.0 * f64::EPSILON)
}

/// Triangles that close a loop of edges, wound to match its outside, and how far they reach from it. The three consecutive vertices
/// whose triangle stays nearest to one of its edges are cut off first.
pub(super) fn filled(border: &[u32], positions: &[DVec3]) -> (Vec<[u32; 3]>, f64) {
    let distance = |p: u32, a: u32, b: u32| {
        // Differences between points of the lattice are exact.
        let [p, b] = [p, b].map(|v| positions[v as usize] - positions[a as usize]);
        closest_on_segment(p, DVec3::ZERO, b).0.distance(p)
    };
    // Each vertex, and how far the edge to the next one may lie from the loop.
    let mut left: Vec<(u32, f64)> = border.iter().map(|&v| (v, 0.0)).collect();
    let (mut triangles, mut width) = (vec![], 0.0f64);
    while left.len() > 2 {
        let reach = |i: usize| {
            let [(p, before), (q, after), (r, _)] = [i, i + 1, i + 2].map(|k| left[k % left.len()]);
            (before + distance(r, p, q)).min(after + distance(p, q, r))
        };
        let nearest = (0..left.len()).map(|i| (reach(i), i)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((reach, i)) = nearest else { break };
        let [p, q, r] = [i, i + 1, i + 2].map(|k| left[k % left.len()].0);
        triangles.push([p, r, q]);
        left[i].1 = reach;
        left.remove((i + 1) % left.len());
        width = width.max(reach);
    }
    (triangles, width)
}

/// A position as its bits. Equal positions have equal bits, because both sides take them from the lattice.
fn key(position: DVec3) -> [u64; 3] {
    position.to_array().map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of n x n squares, whose first column of vertices lies at x.
    fn sheet(n: u32, x: f64) -> CoarseSurface {
        let place = |i: u32| DVec3::new(x + f64::from(i / (n + 1)), f64::from(i % (n + 1)), 0.0);
        let square = |i: u32| {
            let a = i / n * (n + 1) + i % n;
            [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]]
        };
        let positions = (0..(n + 1) * (n + 1)).map(place).collect();
        CoarseSurface { positions, triangles: (0..n * n).flat_map(square).collect(), error: x }
    }

    #[test]
    fn regions_are_thinned_inside_and_joined_at_their_borders() {
        let [left, right] = [sheet(12, 0.0), sheet(12, 12.0)].map(|sheet| thinned(&sheet, 8).expect("it is a disk"));
        assert!(left.triangles.len() < 100 && left.boundary_vertices().count() == 48);
        let both = CoarseSurface::joined(vec![left.clone(), right.clone()]);
        assert_eq!(both.boundary_vertices().count(), 72, "what both have is inside");
        assert_eq!(both.positions.len(), left.positions.len() + right.positions.len() - 13);
        assert!(both.error >= right.error && right.error >= 12.0);
        assert_eq!(CoarseSurface::joined(vec![left.clone()]), left);
        // One side of the seam has a vertex more, off the edge, than the other.
        let mut bent = right.clone();
        let at = |y: f64| bent.positions.iter().position(|&p| p == DVec3::new(12.0, y, 0.0)).expect("a vertex") as u32;
        let (low, high) = (at(3.0), at(4.0));
        let t = bent.triangles.iter().position(|t| t.contains(&low) && t.contains(&high)).expect("a triangle");
        let middle = bent.add(DVec3::new(12.25, 3.5, 0.0));
        let split = |from: u32| bent.triangles[t].map(|v| if v == from { middle } else { v });
        let halves = [split(low), split(high)];
        bent.triangles[t] = halves[0];
        bent.triangles.push(halves[1]);
        let open = |surface: &CoarseSurface| open_edges(&surface.triangles).len();
        let crack = CoarseSurface::joined(vec![
            CoarseSurface { error: 0.3, ..left.clone() },
            CoarseSurface { error: 0.3, ..bent.clone() },
        ]);
        assert_eq!((open(&crack), crack.error > 0.55 && crack.error < 0.5501), (open(&both), true));
        let wide = CoarseSurface::joined(vec![
            CoarseSurface { error: 0.2, ..left.clone() },
            CoarseSurface { error: 0.2, ..bent },
        ]);
        assert_eq!((open(&wide), wide.error < 0.2001), (open(&both) + 3, true));
        assert_eq!(CoarseSurface::joined(vec![]), CoarseSurface::default());
    }

    #[test]
    fn cracks_are_filled_along_their_edges() {
        // A long edge, and four short ones back.
        let places = [[0., 0.], [4., 0.], [3., 0.1], [2., 0.2], [1., 0.1]];
        let positions: Vec<DVec3> = places.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
        for turn in 0..5 {
            let mut border = [0, 1, 2, 3, 4];
            border.rotate_left(turn);
            let (triangles, width) = filled(&border, &positions);
            assert!(triangles.len() == 3 && (0.2..0.45).contains(&width), "{triangles:?} {width}");
            let mut around: Vec<[u32; 2]> = (0..5).map(|i| [(i + 1) % 5, i]).collect();
            around.sort_unstable();
            assert_eq!(open_edges(&triangles), around);
        }
    }
}
