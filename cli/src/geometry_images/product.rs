//! An atlas in memory: what [`super::write_atlas`] writes.

use glam::DVec3;

use super::MAX_RESOLUTION;
use crate::stage::arcs::HalfArc;
use crate::stage::chart::ChartMesh;
use crate::stage::embed::Embedding;

/// What holds for all roots of an atlas.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtlasHeader {
    /// The point that all positions are relative to, in input units.
    pub origin: DVec3,
    /// Name of the unit of length, empty if unknown.
    pub units: String,
}

/// Charts with their maps, the arcs between them, and what no map could be found for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtlasProduct {
    /// What holds for all roots.
    pub header: AtlasHeader,
    /// The vertices of every arc, from its first end to its last: at least two.
    pub arcs: Vec<Vec<ArcKnot>>,
    /// Charts that become geometry images.
    pub charts: Vec<AtlasChart>,
    /// Pieces that stay triangle meshes.
    pub patches: Vec<AtlasPatch>,
}

/// A vertex of an arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcKnot {
    /// Place along the arc, strictly growing from 0 to 1.
    pub param: f64,
    /// Relative to the origin.
    pub position: DVec3,
}

/// A chart and its map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtlasChart {
    /// Positions relative to the origin; a disk.
    pub mesh: ChartMesh,
    /// The chart's map to a regular polygon.
    pub embedding: Embedding,
    /// The arc of each side; at most one chart or patch border has an arc in each direction.
    pub sides: Vec<HalfArc>,
}

/// A piece of the surface without a map, of any topology.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtlasPatch {
    /// Relative to the origin.
    pub positions: Vec<DVec3>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Where the patch borders on charts.
    pub borders: Vec<PatchBorder>,
}

/// A stretch of a patch's border.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PatchBorder {
    /// The arc, on whose other side is a chart.
    pub arc: u32,
    /// The patch's vertex at each of the arc's knots, in the arc's direction.
    pub vertices: Vec<u32>,
}

impl AtlasProduct {
    /// Number of geometry images: one a corner of every chart.
    pub fn root_count(&self) -> usize {
        self.charts.iter().map(|chart| chart.embedding.corner_count).sum()
    }

    /// The resolution, 1 to [`MAX_RESOLUTION`], at which the images have about as many samples as the charts have vertices.
    pub fn default_resolution(&self) -> u32 {
        let vertex_count: usize = self.charts.iter().map(|chart| chart.mesh.positions.len()).sum();
        let wanted = vertex_count as f64 / self.root_count().max(1) as f64;
        // The nearest by ratio; a root adds 4^r samples, as its border is shared.
        (1..MAX_RESOLUTION).find(|&r| wanted < 2.0 * 4f64.powi(r as i32)).unwrap_or(MAX_RESOLUTION)
    }
}
