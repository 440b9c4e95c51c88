//! Bounds by laying the finer surface onto the coarser: a continuous map that moves no point far.
//!
//! Every vertex of the finer surface gets a *foot* on the coarser one, whose triangles are called *tiles* here
//! (`feet`). The foot of a border vertex is on the border edge that corresponds to its stretch of the border. An edge
//! of the finer surface follows a *way* from tile to tile, on which both its triangles agree (`tiles`). Each triangle
//! is divided into parts that lie in one tile each and are mapped linearly (`parts`). The length by which points move
//! is convex on each part, so it is largest at the corners of the parts, and few points need to be examined.
//!
//! # Why the bound holds
//!
//! A point that moves by at most t lies within t of the coarser surface. *The image also covers the coarser surface*,
//! whatever folds or overlaps. In the argument, vertices count by index, never by position, and triangles count modulo
//! two:
//!
//! 1. The boundary of all triangles of the finer surface together is the paired border. (This is the one thing that is
//!    compared by a 64-bit sum of hashes instead of edge by edge, in `feet`.)
//! 2. The map takes each stretch of that border to its border edge, from end to end. The edges that have one tile are
//!    exactly these border edges, each once; every other edge has two tiles (`feet`, `tiles`).
//! 3. So the image of all triangles is a chain of tiles whose boundary is the border. It continues across every edge
//!    with two tiles, and contains the tile at each border edge once. So it contains all tiles that are reached from
//!    border edges (`tiles`). Of a component without a border it contains all tiles or none, and one point that it
//!    covers an odd number of times proves that it is all (`coverage`).
//!
//! Hence every point of the coarser surface is the image of some point, which lies within the length of its move.
//! Components and handles do not matter. If any step fails, there is no map, and branch and bound gives the answer.
//!
//! Where both surfaces have nearly the same vertices, feet are moved to vertices of tiles. Such a foot lies in all
//! tiles around its vertex. If both feet of an edge lie in one tile, its image is straight there: as a way it goes
//! around those vertices, and crosses between tiles at them. If all feet of a triangle lie in one tile, it is mapped
//! linearly, and its edges are the same straight ones.
//!
//! A triangle that moves by more than asked for is left to branch and bound, together with its image. A triangle that
//! is not mapped is left to it together with tiles in which it could have an image (`unmapped`); that is enough,
//! because the argument needs a map to exist, not to be known. Positions on tiles are rounded; the final inflation
//! covers that, and nothing above depends on it, except where a point is counted, which is far from all edges.

mod coverage;
mod feet;
mod hold;
mod parts;
#[cfg(test)]
mod tests;
mod tiles;
mod unmapped;

use std::sync::Arc;

use glam::DVec3;

use super::bound::{Patch, Search};
use super::bvh::TriangleBvh;
use super::{Bound, CertifyOptions};
use feet::Foot;
use parts::Parts;
use tiles::Tiles;

/// A border vertex of the finer surface and its partner. Vertices are numbered as the caller numbers them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PairedVertex {
    /// Vertex of the finer surface.
    pub fine: u32,
    /// The corresponding border vertex of the coarser surface, if there is one.
    pub coarse: Option<u32>,
}

/// All border loops of the finer surface, paired with those of the coarser one. Two vertices that have partners and
/// follow each other (with none that has a partner in between) correspond to one border edge of the coarser surface.
pub type BorderPairing = Vec<Vec<PairedVertex>>;

/// Closed surfaces of fewer tiles are bounded faster without a map.
const FEW_TILES: usize = 16;
/// Of surfaces with fewer than this many triangles to one of the other, most vertices may be laid onto vertices.
const ALIKE: usize = 3;
/// If a larger share of the triangles is not mapped, branch and bound alone is as good.
const MAX_UNMAPPED: usize = 4;
/// If more triangles than this move too far, some queries from the other side first are worth their cost.
const SEEDED: usize = 64;

/// The finer surface, laid onto the coarser.
struct Drape {
    fine: Arc<TriangleBvh>,
    coarse: Arc<TriangleBvh>,
    tiles: Tiles,
    /// Ends of the border edges of the coarser surface.
    border: Vec<[u32; 2]>,
    /// For each component of the coarser surface without a border, a tile that is covered by triangles that are mapped.
    anchors: Vec<u32>,
    /// The foot of every vertex of the finer surface.
    feet: Vec<Foot>,
    /// Vertices of the finer and of the coarser surface, relative to the origin of the coarser.
    points: Vec<DVec3>,
    corners: Vec<DVec3>,
}

/// A triangle of the finer surface, by slot, and the square of the most that its points move: infinity if it is not
/// mapped.
type Move = (f64, u32);

/// A map from the finer surface onto the coarser, kept from one question about the two to the next.
pub(super) struct Map {
    drape: Drape,
    /// For each triangle of the finer surface, by slot, the square of the most that its points move; empty before the
    /// first question.
    moves: Vec<f64>,
}

impl Map {
    /// Lays the finer surface onto the coarser; none if it cannot be. Neither may be empty.
    pub(super) fn new(fine: &Arc<TriangleBvh>, coarse: &Arc<TriangleBvh>, pairing: &BorderPairing) -> Option<Self> {
        if pairing.is_empty() && coarse.triangle_count() < FEW_TILES {
            return None;
        }
        let mut drape = Drape::new(fine, coarse, pairing)?;
        drape.find_feet();
        Some(Self { drape, moves: vec![] })
    }

    /// A triangle of the coarser surface, by slot, near a vertex of the finer one.
    pub(super) fn tile(&self, vertex: u32) -> u32 {
        self.drape.feet[vertex as usize].tile
    }

    /// Bounds the Hausdorff distance like [`super::two_sided`]; none if there is no map.
    pub(super) fn two_sided(&mut self, options: &CertifyOptions) -> Option<Bound> {
        let [fine, coarse] = [&self.drape.fine, &self.drape.coarse].map(Arc::clone);
        let mut forward = Search::new(&fine, &coarse, options);
        self.improve(&mut forward)?;
        let mut moved = 0.0f64;
        let mut far: Vec<Move> = self.moves.iter().copied().zip(0..).collect();
        let mut settle = |far: &mut Vec<Move>, threshold: f64| {
            far.retain(|&(square, _)| {
                let open = square > threshold;
                if !open {
                    moved = moved.max(square);
                }
                open
            });
        };
        settle(&mut far, forward.threshold());
        let mut backward = Search::new(&coarse, &fine, options);
        if far.len() > SEEDED {
            // Both searches learn all distances that occur, so fewer triangles are too far.
            backward.seed();
            forward.know(backward.lower());
            settle(&mut far, forward.threshold());
        }
        let forward = forward.run_on(far.iter().map(|&(_, slot)| slot), &[]);
        backward.know(forward.lower * forward.lower);
        settle(&mut far, backward.threshold());
        let (tiles, patches) = self.drape.images(&far);
        let backward = backward.run_on(tiles.into_iter(), &patches);
        let bound = forward.or_worse(backward);
        Some(Bound { upper: bound.upper.max(Search::inflate(moved, &fine, &coarse)), ..bound })
    }

    /// The triangles of the finer and of the coarser surface at which one is not proven to lie within `target` of the
    /// other, like
    /// [`super::exceeding`] both ways; none if there is no map.
    pub(super) fn exceeding(&mut self, target: f64, work_limit: u64) -> Option<[Vec<u32>; 2]> {
        let [fine, coarse] = [&self.drape.fine, &self.drape.coarse].map(Arc::clone);
        let mut forward = Search::with_threshold(&fine, &coarse, target);
        self.improve(&mut forward)?;
        let threshold = forward.threshold();
        let moves = self.moves.iter().copied().zip(0..);
        let far: Vec<Move> = moves.filter(|&(square, _)| square > threshold).collect();
        let (mut tiles, patches) = self.drape.images(&far);
        tiles.extend(patches.iter().map(|patch| patch.within));
        tiles.sort_unstable();
        tiles.dedup();
        let backward = Search::with_threshold(&coarse, &fine, target);
        Some([
            forward.exceeding_among(far.iter().map(|&(_, slot)| slot), work_limit),
            backward.exceeding_among(tiles.into_iter(), work_limit),
        ])
    }

    /// Moves feet for the sake of triangles that move by more than the threshold of a search. None if there is no map
    /// then, or hardly any.
    fn improve(&mut self, forward: &mut Search) -> Option<()> {
        let mut changed = vec![self.moves.is_empty(); self.drape.feet.len()];
        if self.moves.is_empty() && self.drape.are_alike() {
            self.drape.snap_feet(forward.threshold());
        }
        self.moves.resize(self.drape.fine.triangle_count(), f64::INFINITY);
        self.drape.improve_feet(forward, &mut changed);
        self.drape.lay_all(forward.threshold(), &mut self.moves, changed);
        let unmapped = self.moves.iter().filter(|square| square.is_infinite()).count();
        if unmapped > self.moves.len() / MAX_UNMAPPED {
            return None;
        }
        self.drape.find_anchors(&self.moves)
    }
}

impl Drape {
    /// Whether both surfaces have about as many vertices.
    fn are_alike(&self) -> bool {
        self.fine.triangle_count() <= ALIKE * self.coarse.triangle_count()
    }

    /// Where the images of some triangles are: all of some tiles, ascending, and parts of others.
    fn images(&self, far: &[Move]) -> (Vec<u32>, Vec<Patch>) {
        let mut parts = Parts::default();
        let (mut patches, mut lost) = (vec![], vec![]);
        let shift = self.coarse.origin - self.fine.origin;
        for &(_, slot) in far {
            let before = patches.len();
            let mut add = |tile, patch: [DVec3; 3]| {
                patches.push(Patch { within: tile, corners: patch.map(|p| p + shift), hint: slot });
            };
            if self.lay(slot, &mut parts, Some(&mut add)).is_none() {
                patches.truncate(before);
                lost.push(slot);
            }
        }
        (self.tiles_around(&lost), patches)
    }
}

fn nearest_on_segment(point: DVec3, start: DVec3, end: DVec3) -> DVec3 {
    let along = end - start;
    let share = (point - start).dot(along) / along.length_squared();
    // Not a number if the segment is a point.
    if share > 0.0 { start + along * share.min(1.0) } else { start }
}
