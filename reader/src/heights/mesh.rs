//! The mesh of a cut, without cracks (SPEC.md, "Stitched tiles").
//!
//! A side of a triangle that runs along a column or a row gets all samples that are drawn between its ends, by
//! whichever tile. Only where tiles meet, and where several index lines lie on one line of samples, there are any:
//! elsewhere both triangles at a side agree. Such a triangle becomes a fan from the corner opposite the side. Where it
//! has several such sides, the fan over the first of them is made; the others now belong to the first and the last
//! triangle of that fan, which become fans in turn.

use std::{collections::HashMap, sync::Arc};

use super::{
    cut::HeightsCut,
    drawn::{DrawnTile, Side, TileValues},
    file::Heights,
    grid::{Grid, SIDE, TileId},
    normals::{Cross, Field, Normal},
    on_lines::OnLines,
    section::HeightsInfo,
};
use crate::{
    error::{Error, Result},
    source::ReadAt,
};

/// No vertex.
const NONE: u32 = u32::MAX;

/// Triangles of a cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeightsMesh {
    /// In space. Vertices that several tiles share occur once.
    pub positions: Vec<[f64; 3]>,
    /// Column and row of each vertex; the first column where several are one point.
    pub samples: Vec<[u64; 2]>,
    /// The height of each vertex, in units of heights.
    pub heights: Vec<f64>,
    /// The normal of each vertex, from the slopes of the heights around it: those of the tiles of the cut, of which the
    /// finest count.
    pub normals: Vec<Normal>,
    /// Vertex indices, counter-clockwise seen from above.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle the index of its tile in the cut.
    pub triangle_tiles: Vec<u32>,
    /// The largest error of the cut's tiles.
    pub error: f64,
}

impl<S: ReadAt> Heights<S> {
    /// The mesh of a cut: without cracks, whatever the depths and the resolutions of its tiles.
    ///
    /// # Errors
    /// [`Error::Query`] if the cut is one of another file, or the mesh has more than 2^32 vertices; [`Error::Io`],
    /// [`Error::Format`], [`Error::Limit`].
    pub fn mesh(&self, cut: &HeightsCut) -> Result<HeightsMesh> {
        self.index().id().check_cut(cut.file)?;
        let numbers: HashMap<TileId, usize> =
            cut.tiles.iter().zip(0..).map(|(tile, number)| (tile.id, number)).collect();
        let ids: Vec<TileId> = cut.tiles.iter().map(|tile| tile.id).collect();
        let mut stitcher = Stitcher {
            grid: self.grid(),
            info: self.info(),
            crosses: HashMap::new(),
            mesh: HeightsMesh::default(),
            shared: HashMap::new(),
            lines: HashMap::new(),
            open: vec![],
        };
        self.for_each_tile(&ids, |id, values: &Arc<TileValues>| {
            let Some(&number) = numbers.get(&id) else { return Ok(()) };
            let tolerance = cut.tiles[number].resolution.tolerance;
            stitcher.add((number as u32, id), values, &self.draw(id, values, tolerance), tolerance)
        })?;
        Ok(HeightsMesh { error: cut.error, ..stitcher.finish() })
    }
}

/// A line of samples: along which axis, and which one.
pub(crate) type LineName = (usize, u64);

/// The name of a column or a row: the last column of a grid that wraps is its first one.
pub(crate) fn line_name(grid: &Grid, axis: usize, at: u64) -> LineName {
    let is_first = axis == 0 && grid.wraps() && at == grid.cells()[0];
    (axis, if is_first { 0 } else { at })
}

/// A triangle at the border of a tile.
struct Open {
    tile: u32,
    vertices: [u32; 3],
    /// Of each side: the line that it runs along, and from where to where.
    sides: [Option<(LineName, [u64; 2])>; 3],
    /// Vertices that its own tile puts on its sides.
    own: [Vec<u32>; 3],
}

struct Stitcher<'a> {
    grid: &'a Grid,
    info: &'a HeightsInfo,
    mesh: HeightsMesh,
    /// What tiles know around the vertices on their borders.
    crosses: HashMap<u32, Cross>,
    /// Vertices on borders of tiles.
    shared: HashMap<[u64; 2], u32>,
    /// Columns or rows of the vertices on lines at borders of tiles.
    lines: HashMap<LineName, Vec<u64>>,
    open: Vec<Open>,
}

impl Stitcher<'_> {
    fn vertex(&mut self, sample: [u64; 2], position: [f64; 3], cross: &Cross) -> Result<u32> {
        let number = u32::try_from(self.mesh.positions.len()).ok().filter(|&number| number != NONE);
        let too_many = || Error::Query { what: "the mesh has more than 2^32 vertices; ask for less".into() };
        self.mesh.positions.push(position);
        self.mesh.samples.push(sample);
        self.mesh.heights.push(self.info.height(cross.steps));
        self.mesh.normals.push([0; 3]);
        number.ok_or_else(too_many)
    }

    /// Adds a tile, which is number `tile` of the cut.
    fn add(&mut self, (tile, id): (u32, TileId), values: &TileValues, drawn: &DrawnTile, tolerance: f64) -> Result<()> {
        let triangles = drawn.triangles(tolerance);
        let outline = drawn.outline();
        let on_lines = OnLines::new(outline, &triangles);
        let vertices = self.vertices(drawn, &Field::new(self.grid, id, values), &on_lines)?;
        for triangle in triangles {
            let corners = triangle.map(|at| on_lines.first(at));
            let named = corners.map(|at| vertices[at]);
            if named[0] == named[1] || named[1] == named[2] || named[2] == named[0] {
                continue;
            }
            let pairs = [[0, 1], [1, 2], [2, 0]].map(|[a, b]| [corners[a], corners[b]]);
            let sides = pairs.map(|[a, b]| outline.side(a, b));
            let own =
                sides.map(|side| side.map_or(vec![], |side| on_lines.between(side).map(|at| vertices[at]).collect()));
            let sides = sides.map(|side| {
                let Side { axis, across, ends } = side?;
                let line = outline.lines_of(axis)[across];
                let along = outline.lines_of(1 - axis);
                outline.is_border(axis, line).then(|| (line_name(self.grid, axis, line), ends.map(|end| along[end])))
            });
            if sides.iter().all(Option::is_none) {
                self.push(tile, named, &own);
            } else {
                self.open.push(Open { tile, vertices: named, sides, own });
            }
        }
        Ok(())
    }

    /// The vertices of a tile's drawn samples.
    fn vertices(&mut self, drawn: &DrawnTile, field: &Field<'_>, on_lines: &OnLines) -> Result<Vec<u32>> {
        let mut vertices = vec![NONE; SIDE * SIDE];
        for at in on_lines.samples() {
            let [column, row] = [drawn.lines.columns[at % SIDE], drawn.lines.rows[at / SIDE]];
            let sample = self.grid.vertex(column, row);
            let outline = drawn.outline();
            let [is_on_column, is_on_row] = [outline.is_border(0, column), outline.is_border(1, row)];
            let is_shared = is_on_column || is_on_row;
            let cross = field.cross(at);
            vertices[at] = match self.shared.get(&sample) {
                Some(&vertex) if is_shared => vertex,
                _ => self.vertex(sample, drawn.position(at), &cross)?,
            };
            if !is_shared {
                self.mesh.normals[vertices[at] as usize] = cross.normal(self.info, sample);
            } else {
                self.shared.insert(sample, vertices[at]);
                self.crosses.entry(vertices[at]).and_modify(|known| known.join(&cross)).or_insert(cross);
            }
            if is_on_column {
                self.lines.entry(line_name(self.grid, 0, column)).or_default().push(row);
            }
            if is_on_row {
                self.lines.entry(line_name(self.grid, 1, row)).or_default().push(column);
            }
        }
        Ok(vertices)
    }

    fn finish(mut self) -> HeightsMesh {
        for line in self.lines.values_mut() {
            line.sort_unstable();
            line.dedup();
        }
        for Open { tile, vertices, sides, mut own } in std::mem::take(&mut self.open) {
            for (side, own) in sides.into_iter().zip(&mut own) {
                let Some(((axis, line), [from, to])) = side else { continue };
                let Some(on_line) = self.lines.get(&(axis, line)) else { continue };
                let (start, end) = (from.min(to), from.max(to));
                let between = on_line.partition_point(|&at| at <= start)..on_line.partition_point(|&at| at < end);
                let named = on_line[between].iter().filter_map(|&at| {
                    let [column, row] = if axis == 0 { [line, at] } else { [at, line] };
                    self.shared.get(&self.grid.vertex(column, row)).copied()
                });
                *own = named.collect();
                if from > to {
                    own.reverse();
                }
            }
            self.push(tile, vertices, &own);
        }
        for (vertex, cross) in self.crosses {
            let vertex = vertex as usize;
            self.mesh.normals[vertex] = cross.normal(self.info, self.mesh.samples[vertex]);
        }
        self.mesh
    }

    /// Adds a triangle with further vertices on its sides.
    fn push(&mut self, tile: u32, triangle: [u32; 3], on_sides: &[Vec<u32>; 3]) {
        let [a, b, c] = on_sides;
        fan(triangle, [a, b, c], &mut self.mesh.triangles);
        self.mesh.triangle_tiles.resize(self.mesh.triangles.len(), tile);
    }
}

/// Divides a triangle with further vertices on its sides, the first of which runs from the first to the second corner.
pub(crate) fn fan(triangle: [u32; 3], on_sides: [&[u32]; 3], out: &mut Vec<[u32; 3]>) {
    let Some(side) = on_sides.iter().position(|side| !side.is_empty()) else {
        out.push(triangle);
        return;
    };
    let [a, b, apex] = [0, 1, 2].map(|k| triangle[(side + k) % 3]);
    let [on_first, on_second, on_third] = [0, 1, 2].map(|k| on_sides[(side + k) % 3]);
    let mut from = a;
    for (number, &to) in on_first.iter().chain([&b]).enumerate() {
        // Only the first and the last triangle have another side of the whole one.
        let third = if number == 0 { on_third } else { &[] };
        let second = if number == on_first.len() { on_second } else { &[] };
        fan([from, to, apex], [&[], second, third], out);
        from = to;
    }
}
