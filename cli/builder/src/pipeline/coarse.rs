//! The coarsest levels of a region as one surface, and those of all regions joined: the overview is made from them.

use super::Plan;
use super::drawn::drawn_at;
use super::overview::OVERVIEW_TRIANGLES;
use crate::reduce::{CoarseSurface, collapsed};
use lodpack::{
    File, Limits,
    index::HalfArc,
    write::{ArcRecord, BlockRecord, Model, RootRecord},
};
use lodpack_mesh::Mesh;
use std::collections::{BTreeMap, BTreeSet};

/// How many of the coarsest levels an overview may be made from.
const MAX_LEVELS_TRIED: usize = 2;
/// About how many triangles all regions may keep together: four times the overview's, so that it loses little.
const ALL_TRIANGLES: u64 = 4 * OVERVIEW_TRIANGLES as u64;
/// Triangles that a region may keep where more regions can be added later.
const EXTENSIBLE_TRIANGLES: u64 = 512;
/// Triangles that a region may keep, however many regions there are.
const LEAST_TRIANGLES: u64 = 64;

/// Triangles to which the coarse surfaces of each region are simplified.
pub(super) fn coarse_triangles(regions: u64, extensible: bool) -> u64 {
    if extensible { EXTENSIBLE_TRIANGLES } else { (ALL_TRIANGLES / regions.max(1)).max(LEAST_TRIANGLES) }
}

/// The coarsest levels of a region, the finer one first: it lies nearer to the input, and so does an overview made from
/// it (17 instead of 21 mean edges on 8 M triangles). None if the file needs no overview. Where there are several
/// regions, each is simplified, except at its boundary.
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
        let bare = |block: &BlockRecord| BlockRecord {
            symbols: block.symbols.clone(),
            texels: vec![],
            owners: vec![],
            ..*block
        };
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
        nodes: vec![],
        ..*model
    }
}

/// The surface with about the given number of triangles inside its boundary, which stays. None if it cannot be
/// simplified.
fn thinned(surface: &CoarseSurface, triangles: usize) -> Option<CoarseSurface> {
    let chart = surface.chart()?;
    let Mesh { positions, triangles } = collapsed(&chart, triangles)?;
    let error = surface.error_of(&chart.positions, &chart.triangles, &positions, &triangles);
    Some(CoarseSurface { positions, triangles, error })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reduce::open_edges;
    use glam::DVec3;

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
}
