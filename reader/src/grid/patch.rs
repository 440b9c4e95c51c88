//! From cells to triangles.

use super::{
    Border, GridShape, GridSides, GridState, UNIT,
    state::GridCell,
    triangulate::{Lines, Triangulator},
};
use crate::{
    error::{Error, Result},
    patch::Patch,
};

/// A polygon being collected: patch vertices and the sides they lie on.
#[derive(Default)]
struct Polygon {
    vertices: Vec<u32>,
    lines: Vec<Lines>,
}

impl Polygon {
    fn push(&mut self, vertex: u32, lines: Lines) {
        self.vertices.push(vertex);
        self.lines.push(lines);
    }

    fn clear(&mut self) {
        self.vertices.clear();
        self.lines.clear();
    }
}

impl GridState {
    /// The triangles of this level. `sides` are the samples at this level; the patch's border is exactly these, side
    /// after side.
    ///
    /// # Errors
    /// [`crate::Error::Format`] where the sides do not fit the cells.
    pub fn patch(&self, sides: &GridSides) -> Result<Patch> {
        self.patch_by_cell(sides).map(|(patch, _)| patch)
    }

    /// As [`Self::patch`], with the first triangle of each leaf (or sector, or the polygon) and, last, the triangle count.
    ///
    /// # Errors
    /// As [`Self::patch`].
    pub fn patch_by_cell(&self, sides: &GridSides) -> Result<(Patch, Vec<u32>)> {
        let border = Border::new(sides)?;
        if border.side_count() != self.side_count {
            return Err(Error::format("a grid's side count differs between levels"));
        }
        let mut triangles = Vec::new();
        let mut starts = vec![0];
        let mut polygon = Polygon::default();
        let mut triangulator = Triangulator::default();
        let mut draw = |polygon: &Polygon| {
            let points: Vec<_> = polygon.vertices.iter().map(|&v| self.position(&border, v)).collect();
            let first = triangles.len();
            triangulator.triangulate(&points, &polygon.lines, &mut triangles);
            for triangle in &mut triangles[first..] {
                *triangle = triangle.map(|i| polygon.vertices[i as usize]);
            }
            starts.push(triangles.len() as u32);
        };
        match self.shape {
            GridShape::Polygon => {
                for side in 0..self.side_count {
                    let before = (side + self.side_count - 1) % self.side_count;
                    polygon.push(border.first[side], [side as u16, before as u16]);
                    for (_, vertex) in border.between(side, 0, 2 * UNIT) {
                        polygon.push(vertex, [side as u16; 2]);
                    }
                }
                draw(&polygon);
            }
            GridShape::Fan => {
                let centre = self.vertex(&border, 0, [0, 0]).ok_or(Error::format("a grid's centre is missing"))?;
                for side in 0..self.side_count {
                    polygon.clear();
                    polygon.push(centre, [2, 0]);
                    polygon.push(border.first[side], [0, 1]);
                    for (_, vertex) in border.between(side, 0, 2 * UNIT) {
                        polygon.push(vertex, [1, 1]);
                    }
                    polygon.push(border.first[(side + 1) % self.side_count], [1, 2]);
                    draw(&polygon);
                }
            }
            GridShape::Quads => {
                for cell in self.leaves() {
                    polygon.clear();
                    self.outline(&border, cell, &mut polygon)?;
                    draw(&polygon);
                }
            }
        }
        Ok((Patch { border_count: border.count(), interior: self.positions.clone(), triangles }, starts))
    }

    /// All vertices on the edges of a cell, counter-clockwise.
    fn outline(&self, border: &Border, cell: GridCell, polygon: &mut Polygon) -> Result<()> {
        let corners = cell.corners();
        for edge in 0..4u16 {
            let (a, b) = (corners[edge as usize], corners[(edge as usize + 1) % 4]);
            let vertex = self.vertex(border, cell.quad, a).ok_or(Error::format("a grid cell's corner is missing"))?;
            polygon.push(vertex, [edge, (edge + 3) % 4]);
            let before = (cell.quad as usize + self.side_count - 1) % self.side_count;
            if edge == 1 && a[0] == UNIT {
                // Runs along the side before, with its parameters.
                for (_, vertex) in border.between(before, UNIT + a[1], UNIT + b[1]) {
                    polygon.push(vertex, [edge; 2]);
                }
            } else if edge == 2 && a[1] == UNIT {
                for (_, vertex) in border.between(cell.quad as usize, UNIT - a[0], UNIT - b[0]) {
                    polygon.push(vertex, [edge; 2]);
                }
            } else {
                self.edge_vertices(border, cell.quad, a, b, edge, polygon);
            }
        }
        Ok(())
    }

    /// Vertices strictly between the ends of an inner edge: those of the splits beyond it, which start with its middle.
    /// The edge halves with every step, so the recursion ends within 15.
    fn edge_vertices(&self, border: &Border, quad: u16, a: [u32; 2], b: [u32; 2], edge: u16, polygon: &mut Polygon) {
        if a[0].abs_diff(b[0]) + a[1].abs_diff(b[1]) < 2 {
            return;
        }
        let middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
        if let Some(vertex) = self.vertex(border, quad, middle) {
            self.edge_vertices(border, quad, a, middle, edge, polygon);
            polygon.push(vertex, [edge; 2]);
            self.edge_vertices(border, quad, middle, b, edge, polygon);
        }
    }
}
