//! Corners and arcs of a file as plain records: for tools that compare, show or convert files.

use crate::{
    codec::arc::Knot,
    decode::Decoded,
    error::{Error, Result},
    index::Index,
    lattice::LatticePoint,
    source::Fetched,
};

/// All corners and arcs of a file: the lines along which its roots meet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Borders {
    /// Positions of the corners.
    pub corners: Vec<LatticePoint>,
    /// The coarsest level at which each of them is a vertex.
    pub corner_levels: Vec<u8>,
    /// The arcs between them.
    pub arcs: Vec<ArcContents>,
}

/// An arc with its samples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ArcContents {
    /// Corners at both ends.
    pub ends: [u32; 2],
    /// Samples by ascending parameter.
    pub samples: Vec<ArcPoint>,
}

/// A sample of an arc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArcPoint {
    /// Its parameter along the arc, 1 to 65535.
    pub param: u32,
    /// The coarsest level at which it is part of the arc.
    pub level: u8,
    /// Its position.
    pub position: LatticePoint,
}

/// Decodes all corners and arcs, with the samples of every level that the file holds.
///
/// # Errors
/// [`Error::Missing`], [`Error::Format`], [`Error::Limit`].
pub fn borders(index: &Index, fetched: &Fetched) -> Result<Borders> {
    index.load_indices(0..index.cluster_count())?;
    // Every arc has a root. In a prefix, some roots have no block.
    let finest = index.level_count().saturating_sub(1) as u8;
    let roots: Vec<(u32, u8)> = (0..index.root_count()).map(|root| (root, finest)).collect();
    let decoded = Decoded::arcs_of(index, fetched, &roots)?;
    let mut borders = Borders::default();
    let mut corners: Vec<Option<(LatticePoint, u8)>> = Vec::new();
    for arc in 0..index.arc_count() {
        let (path, ends) = decoded.arc(arc)?;
        for (end, corner) in ends.into_iter().zip(path.end_positions().into_iter().zip(path.end_levels())) {
            // Below the corner count, since the arc could be decoded.
            let end = end as usize;
            corners.resize(corners.len().max(end + 1), None);
            corners[end] = Some(corner);
        }
        let point = |knot: &Knot| {
            let Knot { param, level, position, .. } = *knot;
            ArcPoint { param, level, position }
        };
        borders.arcs.push(ArcContents { ends, samples: path.samples().iter().map(point).collect() });
    }
    for corner in corners {
        let (position, level) = corner.ok_or_else(|| Error::format("a corner ends no arc"))?;
        borders.corners.push(position);
        borders.corner_levels.push(level);
    }
    Ok(borders)
}
