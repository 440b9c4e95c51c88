//! An atlas in memory, as [`super::write_atlas`] takes it.

use glam::DVec3;

use super::MAX_RESOLUTION;
use lodpack_mesh::appearance::Appearance;
use lodpack_mesh::attributes::RegionAttributes;
use lodpack_stage::arcs::HalfArc;
use lodpack_stage::chart::ChartMesh;
use lodpack_stage::embed::Embedding;

/// What all roots of an atlas have in common.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtlasHeader {
    /// The point that all positions are relative to, in input units.
    pub origin: DVec3,
    /// Name of the unit of length, empty if unknown.
    pub units: String,
}

/// Charts with their maps, the arcs between them, and the pieces without a map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtlasProduct {
    /// What all roots have in common.
    pub header: AtlasHeader,
    /// The vertices of every arc, from its first end to its last: at least two.
    pub arcs: Vec<Vec<ArcKnot>>,
    /// Charts that become geometry images.
    pub charts: Vec<AtlasChart>,
    /// Pieces that stay triangle meshes.
    pub patches: Vec<AtlasPatch>,
    /// What the surface carries.
    pub looks: Looks,
}

/// What the surface of an atlas carries beside its shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Looks {
    /// Its channels and materials; empty if it carries nothing.
    pub appearance: Appearance,
    /// Those of all triangles of the repaired mesh.
    pub attributes: RegionAttributes,
}

/// A vertex of an arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcKnot {
    /// Parameter along the arc, strictly increasing from 0 to 1.
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
    /// The arc of each side. At most one chart or patch runs along an arc in each direction.
    pub sides: Vec<HalfArc>,
    /// The triangles' numbers in the repaired mesh; nobody needs them where the surface carries nothing.
    pub numbers: Vec<u32>,
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
    /// The triangles' numbers in the repaired mesh, as those of charts.
    pub numbers: Vec<u32>,
}

/// A stretch of a patch's border.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PatchBorder {
    /// The arc. There is a chart on its other side.
    pub arc: u32,
    /// The patch's vertex at each of the arc's knots, in the arc's direction.
    pub vertices: Vec<u32>,
}

impl AtlasProduct {
    /// The number of geometry images: one for each corner of each chart.
    pub fn root_count(&self) -> usize {
        self.charts.iter().map(|chart| chart.embedding.corner_count).sum()
    }

    /// The resolution, 1 to [`MAX_RESOLUTION`], at which the images have about as many samples as the charts have
    /// vertices.
    pub fn default_resolution(&self) -> u32 {
        let vertex_count: usize = self.charts.iter().map(|chart| chart.mesh.positions.len()).sum();
        // The nearest in ratio.
        self.resolution_for(0.5 * vertex_count as f64)
    }

    /// The resolution at which all images together have at least the given number of samples.
    pub(super) fn resolution_for(&self, samples: f64) -> u32 {
        let wanted = samples / self.root_count().max(1) as f64;
        // A root adds 4^r samples, since it shares its border.
        (1..MAX_RESOLUTION).find(|&r| wanted < f64::from(1_u32 << (2 * r))).unwrap_or(MAX_RESOLUTION)
    }
}
