//! From cells to triangles.

use super::{
    Border, GridShape, GridSides, GridState, UNIT,
    edges::{Kind, Vertex},
    state::{QuadNode, side_before},
    triangulate::{Lines, Triangulator},
};
use crate::{
    codec::{
        patch::Patch,
        vector::{Vec3, to_f64},
    },
    error::{Error, Result},
};

/// The polygon that is being collected: patch vertices, and the polygon's sides on which they lie.
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
    /// The triangles of this level. `sides` has the samples of the level, which are the border of the patch, side after
    /// side.
    ///
    /// # Errors
    /// [`crate::Error::Format`] if the sides do not fit the cells.
    pub fn patch(&self, sides: &GridSides) -> Result<Patch> {
        self.patch_by_cell(sides).map(|(patch, _)| patch)
    }

    /// As [`Self::patch`]. Also returns the first triangle of each leaf (or sector, or of the polygon), followed by the
    /// number of triangles.
    ///
    /// # Errors
    /// As [`Self::patch`].
    pub fn patch_by_cell(&self, sides: &GridSides) -> Result<(Patch, Vec<u32>)> {
        let border = Border::new(sides)?;
        if border.side_count() != self.side_count {
            return Err(Error::format("the number of a grid's sides differs between levels"));
        }
        let named = border.named(self.edges.border_places())?;
        // Euler: a disk has one triangle per border vertex, less two, and two more per inner vertex.
        let mut triangles = Vec::with_capacity(border.positions.len() + 2 * self.positions.len());
        let mut starts = Vec::with_capacity(self.nodes.len() + 2);
        starts.push(0);
        let mut points = Vec::new();
        let mut polygon = Polygon::default();
        let mut triangulator = Triangulator::default();
        let mut draw = |polygon: &Polygon| {
            points.clear();
            points.extend(polygon.vertices.iter().map(|&vertex| self.patch_position(&border, vertex)));
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
                if self.positions.is_empty() {
                    return Err(Error::format("a grid's centre is missing"));
                }
                let centre = border.count();
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
                let outline = Outline { state: self, border: &border, named: &named };
                for node in self.nodes.iter().filter(|node| node.children == 0) {
                    polygon.clear();
                    outline.collect(node, &mut polygon);
                    draw(&polygon);
                }
            }
        }
        Ok((Patch { border_count: border.count(), interior: self.positions.clone(), triangles }, starts))
    }

    /// Position of a patch's vertex.
    fn patch_position(&self, border: &Border, vertex: u32) -> Vec3 {
        let inner = vertex.checked_sub(border.count());
        let position = match inner {
            None => border.positions.get(vertex as usize),
            Some(inner) => self.positions.get(inner as usize),
        };
        position.map_or([0.0; 3], |&position| to_f64(position))
    }
}

/// Collects cells' outlines.
struct Outline<'a> {
    state: &'a GridState,
    border: &'a Border<'a>,
    /// The patch vertices of the border samples that have names.
    named: &'a [u32],
}

impl Outline<'_> {
    fn patch_vertex(&self, vertex: Vertex) -> u32 {
        match vertex.kind() {
            Kind::Inner(number) => self.border.count() + number as u32,
            Kind::Border(number) => self.named[number],
        }
    }

    /// All vertices on the edges of a cell, counter-clockwise.
    fn collect(&self, node: &QuadNode, polygon: &mut Polygon) {
        let QuadNode { cell, corners, edges, .. } = *node;
        let (x, y, size) = (u32::from(cell.x), u32::from(cell.y), cell.size());
        for edge in 0..4u16 {
            let k = usize::from(edge);
            polygon.push(self.patch_vertex(corners[k]), [edge, (edge + 3) % 4]);
            if edge == 1 && x + size == UNIT {
                // This edge lies on the side before, and runs in the direction of its parameters.
                let before = side_before(cell.quad, self.state.side_count);
                for (_, vertex) in self.border.between(before, UNIT + y, UNIT + y + size) {
                    polygon.push(vertex, [edge; 2]);
                }
            } else if edge == 2 && y + size == UNIT {
                for (_, vertex) in self.border.between(usize::from(cell.quad), UNIT - x - size, UNIT - x) {
                    polygon.push(vertex, [edge; 2]);
                }
            } else {
                self.between(edges[k], edge, polygon);
            }
        }
    }

    /// The vertices strictly between the ends of an inner edge: those that splits beyond it have made, its middle
    /// first. Every step halves the edge, so the recursion ends within 15 steps.
    fn between(&self, index: u32, edge: u16, polygon: &mut Polygon) {
        let Some((middle, halves)) = self.state.edges.halves(index) else { return };
        // The upper and the left edge run towards smaller coordinates.
        let is_reverse = edge >= 2;
        self.between(halves + u32::from(is_reverse), edge, polygon);
        polygon.push(self.patch_vertex(middle), [edge; 2]);
        self.between(halves + u32::from(!is_reverse), edge, polygon);
    }
}
