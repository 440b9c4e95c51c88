//! Rows of heights become vertices and triangles. Two rows are held at a time.
//!
//! A cell whose four corners have heights becomes two triangles along its shorter diagonal; one with three becomes one
//! triangle. A vertex is made when the first triangle needs it, so samples that no triangle touches cost nothing.

use super::drape::Painter;
use super::mosaic::Mosaic;
use super::options::RasterOptions;
use super::surface::{RowPlace, Surface};
use super::{Parsed, grid_error};
use crate::check_size;
use crate::sink::MeshSink;
use lodpack_mesh::NONE;
use lodpack_runtime::progress::Progress;

/// A row of samples, and the vertices that some of them have become.
struct Row {
    place: RowPlace,
    /// NaN where there is no data.
    heights: Vec<f64>,
    /// [`NONE`] where there is no vertex yet. A pole has one vertex, the first of these.
    vertices: Vec<u32>,
    /// From the north, as the image of a drape counts.
    number: f64,
}

/// The last row, and what is needed to join it with the next one.
struct Triangulation<'a> {
    surface: Surface,
    painter: Painter,
    sink: &'a mut MeshSink,
    is_closed: bool,
    vertex_count: u32,
    north: Row,
    south: Row,
    record: Vec<f32>,
}

/// Makes the triangles of a mosaic.
pub(super) fn triangulate(
    mosaic: Mosaic,
    surface: Surface,
    options: &RasterOptions,
    sink: &mut MeshSink,
    progress: &dyn Progress,
) -> Parsed<()> {
    let columns = mosaic.size[0] as usize;
    let painter = Painter::new(&mosaic, options, sink, progress)?;
    // Two rows here, one of the mosaic and one of a tile.
    sink.hold_beside(64 * columns as u64);
    let [before, behind] = surface.caps();
    let row = || Row {
        place: RowPlace::Pole(0.0),
        heights: vec![f64::NAN; columns],
        vertices: vec![NONE; columns],
        number: 0.0,
    };
    let is_closed = mosaic.is_closed;
    let (north, south) = (row(), row());
    let mut all = Triangulation { surface, painter, sink, is_closed, vertex_count: 0, north, south, record: vec![] };
    let mut is_first = true;
    let absent = mosaic.for_each_row(options, |number, heights| {
        if let Some(cap) = before.filter(|_| is_first) {
            all.advance(cap, -0.5, heights);
        }
        is_first = false;
        let place = all.surface.row(number);
        all.advance(place, number as f64, heights);
        all.join()?;
        check_size(mosaic.path(), all.sink.vertex_count(), all.sink.triangle_count())
    })?;
    if let Some(cap) = behind {
        let last = all.south.heights.clone();
        all.advance(cap, mosaic.size[1] as f64 - 0.5, &last);
        all.join()?;
    }
    let total = mosaic.size[0] * mosaic.size[1];
    let note = |text: String| progress.note(&format!("{}: {text}", mosaic.path().display()));
    if absent.uncovered > 0 {
        note(format!("{} of {total} samples of the grid are in no file: gaps stay open", absent.uncovered));
    }
    if absent.nodata > 0 {
        note(format!("{} of {total} samples have no data, and no triangle touches them", absent.nodata));
    }
    if absent.uncovered + absent.nodata == total {
        return Err(grid_error(mosaic.path(), "has no data in any sample; check --nodata"));
    }
    Ok(())
}

impl Triangulation<'_> {
    /// Takes the next row; the one before becomes the northern one.
    fn advance(&mut self, place: RowPlace, number: f64, heights: &[f64]) {
        std::mem::swap(&mut self.north, &mut self.south);
        let row = &mut self.south;
        (row.place, row.number) = (place, number);
        row.heights.copy_from_slice(heights);
        row.vertices.fill(NONE);
        if let RowPlace::Pole(_) = place {
            // One point has one height: the mean of what the row says of it.
            let known = heights.iter().filter(|height| !height.is_nan());
            let (sum, count) = known.fold((0.0, 0u64), |(sum, count), height| (sum + height, count + 1));
            row.heights.fill(if count > 0 { sum / count as f64 } else { f64::NAN });
        }
    }

    /// Makes the triangles between the last two rows.
    fn join(&mut self) -> Parsed<()> {
        let columns = self.south.heights.len();
        let cells = if self.is_closed { columns } else { columns - 1 };
        for west in 0..cells {
            let east = if west + 1 == columns { 0 } else { west + 1 };
            let corners = [
                self.north.heights[west],
                self.north.heights[east],
                self.south.heights[west],
                self.south.heights[east],
            ];
            match corners.map(f64::is_nan) {
                [false, false, false, false] => {
                    // The diagonals of a cell are equally long as seen from above, also on a globe.
                    if (corners[0] - corners[3]).abs() <= (corners[1] - corners[2]).abs() {
                        self.triangle([0, 2, 3], west, east)?;
                        self.triangle([0, 3, 1], west, east)?;
                    } else {
                        self.triangle([0, 2, 1], west, east)?;
                        self.triangle([1, 2, 3], west, east)?;
                    }
                }
                [false, false, false, true] => self.triangle([0, 2, 1], west, east)?,
                [false, false, true, false] => self.triangle([0, 3, 1], west, east)?,
                [false, true, false, false] => self.triangle([0, 2, 3], west, east)?,
                [true, false, false, false] => self.triangle([1, 2, 3], west, east)?,
                _ => {}
            }
        }
        Ok(())
    }

    /// A triangle of corners of a cell: 0 and 1 in the north, 2 and 3 in the south; counter-clockwise seen from above.
    #[inline]
    fn triangle(&mut self, corners: [u8; 3], west: usize, east: usize) -> Parsed<()> {
        let is_at_pole = |row: &Row| matches!(row.place, RowPlace::Pole(_));
        let flat = match [corners.contains(&0) && corners.contains(&1), corners.contains(&2) && corners.contains(&3)] {
            [true, _] => is_at_pole(&self.north),
            _ => is_at_pole(&self.south),
        };
        if flat {
            // Two of its corners are the pole.
            return Ok(());
        }
        let mut triangle = [NONE; 3];
        for (vertex, corner) in triangle.iter_mut().zip(corners) {
            let column = if corner % 2 == 0 { west } else { east };
            *vertex = self.vertex(corner < 2, column)?;
        }
        if self.painter.has_corners() {
            for corner in corners {
                let (column, row) =
                    (west + usize::from(corner % 2), if corner < 2 { &self.north } else { &self.south });
                self.painter.corner(column as f64, row.number, &mut self.record);
                self.sink.attributes.push_corner(&self.record);
            }
        }
        self.sink.push_triangle(triangle)
    }

    /// The vertex of a sample, which is made if there is none yet.
    #[inline]
    fn vertex(&mut self, is_north: bool, column: usize) -> Parsed<u32> {
        let row = if is_north { &mut self.north } else { &mut self.south };
        let slot = if matches!(row.place, RowPlace::Pole(_)) { 0 } else { column };
        let known = row.vertices[slot];
        if known != NONE {
            return Ok(known);
        }
        let number = self.vertex_count;
        row.vertices[slot] = number;
        let height = row.heights[column];
        let position = self.surface.position(slot, row.place, height);
        self.vertex_count = number.wrapping_add(1);
        if self.painter.has_vertices() {
            self.painter.vertex(height, &mut self.record);
            self.sink.attributes.push_vertex(&self.record);
        }
        self.sink.push_vertex(position)?;
        Ok(number)
    }
}
