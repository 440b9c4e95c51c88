//! The mesh of a ground, in the coordinates of the surface that stands on it.

use super::super::extract::Drawn;
use super::super::info::PlacementInfo;
use super::super::open::{Source, in_file, tolerance_in_heights};
use super::extract::{Nodes, mesh_of, tin_of};
use crate::args::{BoundingBox, ExtractArgs};
use crate::output::{bound, bytes, count, length, say};
use anyhow::{Result, bail};
use lodpack::ReadAt;
use lodpack::heights::{Heights, HeightsQuery};
use lodpack::select::share;
use lodpack::{File, GroundFrame, Outside, Query};
use serde::Serialize;

/// A ground, as [`super::super::open::open_ground`] opens it.
pub type Ground = (Heights<Source>, GroundFrame);

/// What a file says of the ground of its mesh.
#[derive(Serialize)]
pub struct GroundInfo {
    pub bytes: u64,
    samples: u64,
    /// Columns and rows of cells.
    cells: [u64; 2],
    /// In the space of the mesh.
    bounds: Option<[[f64; 3]; 2]>,
    /// In units of heights, as the numbers after it.
    lowest: f64,
    highest: f64,
    step: f64,
    sample_error: f64,
    /// Units of the mesh in a unit of the ground.
    scale: f64,
    placement: Option<PlacementInfo>,
    /// How much was read of it.
    #[serde(skip)]
    pub bytes_read: u64,
    #[serde(skip)]
    pub requests: u64,
}

impl GroundInfo {
    /// Reads what is said of a ground.
    pub fn new((heights, frame): &Ground) -> lodpack::Result<Self> {
        let mut range = [i32::MAX, i32::MIN];
        for &root in heights.roots() {
            if let Some(record) = heights.record(root)? {
                range = [range[0].min(record.lowest), range[1].max(record.highest)];
            }
        }
        let about = heights.info();
        let [columns, rows] = heights.grid().samples();
        let bytes = heights.source().size().map_err(|source| lodpack::Error::Io { offset: 0, length: 0, source })?;
        Ok(Self {
            bytes,
            samples: columns * rows,
            cells: heights.grid().cells(),
            bounds: heights.index().bounds().map(|bounds| frame.bounds(bounds)),
            lowest: about.height(range[0]),
            highest: about.height(range[1]),
            step: about.step,
            sample_error: about.sample_error,
            scale: frame.scale(),
            placement: heights.placement().map(PlacementInfo::new),
            bytes_read: heights.source().byte_count(),
            requests: heights.source().read_count(),
        })
    }

    /// Prints it as lines of `info`.
    pub fn print(&self) -> Result<()> {
        let [columns, rows] = self.cells;
        say!(
            "  ground     {} samples, {} x {} cells, {}; heights {} to {} in steps of {}, samples within {}",
            count(self.samples),
            count(columns),
            count(rows),
            bytes(self.bytes),
            length(self.lowest),
            length(self.highest),
            length(self.step),
            bound(self.sample_error)
        );
        if let Some([low, high]) = self.bounds {
            say!("             {low:?} to {high:?} in the space of the mesh");
        }
        if let Some(placement) = &self.placement {
            say!("             {}", placement.text());
        }
        Ok(())
    }
}

/// The mesh of the ground that was asked for, and how many tiles it has. The tolerance and the error are in units of
/// the surface.
pub fn drawn_of((heights, frame): &Ground, tolerance: Option<f64>, args: &ExtractArgs) -> Result<(Drawn, Nodes)> {
    let bbox = args.bbox.map(|bbox| BoundingBox(frame.bounds_of_ground(bbox.0)));
    let args = &ExtractArgs { bbox, ..args.clone() };
    let tolerance = tolerance.map(|tolerance| tolerance / frame.scale());
    let (mut drawn, nodes) = match tolerance.filter(|_| args.tin) {
        Some(tolerance) => tin_of(heights, tolerance, args)?,
        None => mesh_of(heights, tolerance, args)?,
    };
    drawn.positions.iter_mut().for_each(|point| *point = frame.point(*point));
    if let Some(shading) = &mut drawn.shading {
        shading.normals.iter_mut().for_each(|normal| *normal = frame.direction(*normal));
    }
    if let Some(draped) = &mut drawn.draped {
        draped.positions.iter_mut().for_each(|point| *point = frame.point(*point));
        draped.normals.iter_mut().for_each(|normal| *normal = frame.direction(*normal));
    }
    drawn.error *= frame.scale();
    drawn.error_everywhere *= frame.scale();
    Ok((drawn, nodes))
}

/// The tolerance of a ground alone, in units of the surface.
pub fn tolerance_alone((heights, frame): &Ground, args: &ExtractArgs) -> Result<Option<f64>> {
    let tolerance = args.tolerance.map(|tolerance| tolerance_in_heights(heights, tolerance)).transpose()?;
    Ok(tolerance.map(|tolerance| tolerance * frame.scale()))
}

/// What a mesh and its ground are asked for together: each gets its share of a budget of triangles, and none is asked
/// for that has nothing in the box.
pub fn shares(
    surface: &File<Source>,
    (heights, frame): &Ground,
    tolerance: Option<f64>,
    args: &ExtractArgs,
) -> Result<[Option<ExtractArgs>; 2]> {
    if args.nodes.is_some() || args.context {
        bail!(
            "{}: --nodes and --context are for the mesh, and this one stands on a ground; add --ground none",
            args.file.display()
        );
    }
    let volume = args.bbox.map(|bbox| bbox.0.into());
    let bounds = args.bbox.map(|bbox| frame.bounds_of_ground(bbox.0).map(|[x, y, _]| [x, y]));
    // Nodes and triangles of both at a tolerance.
    let counts_at = |tolerance: Option<f64>| {
        let query = Query { volume, tolerance, outside: Outside::Drop, ..Query::default() };
        let cut = in_file(&args.file, surface.select(&query))?;
        let tolerance = tolerance.map(|tolerance| tolerance / frame.scale());
        let tiles = in_file(&args.file, heights.cut(&HeightsQuery { bounds, tolerance, max_triangles: None }))?;
        anyhow::Ok([(cut.nodes.len(), cut.triangle_count), (tiles.tiles.len(), tiles.triangle_count)])
    };
    let largest = size_of(surface, frame, heights);
    let shared = args.triangles.map(|most| {
        let triangles_at = |tolerance| anyhow::Ok(counts_at(Some(tolerance))?.map(|(_, triangles)| triangles).to_vec());
        share(most, [tolerance.unwrap_or(0.0), largest], triangles_at)
    });
    let shared = shared.transpose()?;
    let counts = counts_at(shared.as_ref().map(|shared| shared.tolerance).or(tolerance))?;
    // What is left over goes to the ground, whose stitches come on top.
    let of_surface = shared.and_then(|shared| shared.budgets.first().copied());
    let of_ground = args.triangles.zip(of_surface).map(|(most, of_surface)| most.saturating_sub(of_surface));
    let [surface, ground] = [of_surface, of_ground].map(|triangles| ExtractArgs { triangles, ..args.clone() });
    match counts.map(|(nodes, _)| nodes > 0) {
        // The mesh says what is wrong with the box.
        [false, false] => Ok([Some(surface), None]),
        [has_surface, has_ground] => Ok([has_surface.then_some(surface), has_ground.then_some(ground)]),
    }
}

/// The diagonal of both, in the space of the surface.
fn size_of(surface: &File<Source>, frame: &GroundFrame, heights: &Heights<Source>) -> f64 {
    let boxes = [surface.bounds(), heights.index().bounds().map(|bounds| frame.bounds(bounds))];
    let corners: Vec<[f64; 3]> = boxes.into_iter().flatten().flatten().collect();
    let extent = |k: usize| {
        let along = || corners.iter().map(|corner| corner[k]);
        along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
    };
    let squares = [0, 1, 2].map(|k| extent(k) * extent(k));
    squares.iter().sum::<f64>().sqrt()
}
