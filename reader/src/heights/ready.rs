//! A decoded tile, ready to be drawn at any of its resolutions, and its triangles at one of them.
//!
//! What each sample needs takes long to find and much memory, and only comparisons with the tolerances of the tile's
//! resolutions matter. So a ready tile keeps a bit for each of these, of which there are eight at most.

use std::collections::HashMap;

use super::{
    covering::TileColours,
    drawn::{Outline, Side, TileValues},
    grid::{SIDE, TileId},
    index::HeightsIndex,
    mesh::{LineName, line_name},
    on_lines::OnLines,
    page::{MAX_RESOLUTIONS, Resolution},
    restricted::halve,
};

// One bit each.
const _: () = assert!(MAX_RESOLUTIONS <= u8::BITS as usize);

/// A tile that can be drawn.
#[derive(Clone, Debug)]
pub(crate) struct ReadyTile {
    pub values: TileValues,
    /// Of each sample a bit for each resolution: whether triangles are halved there.
    halved: Box<[u8; SIDE * SIDE]>,
    /// What the image over the heights shows; none without one.
    pub colours: Option<TileColours>,
}

/// A triangle that may get further vertices on its sides, from neighbours.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OpenTriangle {
    pub corners: [u32; 3],
    /// Of each side on the border: the line of samples that it runs along, and from where to where.
    pub sides: [Option<(LineName, [u64; 2])>; 3],
    /// Vertices of the tile itself on other sides.
    pub own: [Vec<u32>; 3],
}

/// The tile's vertices on a line of samples along its border.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BorderLine {
    pub line: LineName,
    /// The first and the last sample of the tile on the line, along it.
    pub range: [u64; 2],
    /// Places along the line, ascending, and vertices.
    pub vertices: Vec<(u64, u32)>,
}

/// The triangles of a tile at a resolution.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct TileFaces {
    /// In space: first those on the border.
    pub positions: Vec<[f64; 3]>,
    /// Index column and index row of each vertex.
    pub places: Vec<[u8; 2]>,
    /// The names of those on the border: see [`super::Grid::vertex`].
    pub border_samples: Vec<[u64; 2]>,
    /// Triangles that nothing changes.
    pub inside: Vec<[u32; 3]>,
    pub open: Vec<OpenTriangle>,
    pub lines: Vec<BorderLine>,
}

impl ReadyTile {
    pub fn new(index: &HeightsIndex, id: TileId, values: TileValues, resolutions: &[Resolution]) -> Self {
        let coarsest = resolutions.iter().fold(0.0, |most: f64, resolution| most.max(resolution.tolerance));
        let drawn = index.draw(id, &values, coarsest);
        let mut halved = Box::new([0; SIDE * SIDE]);
        for (bits, need) in halved.iter_mut().zip(drawn.needs.of_samples()) {
            for (k, resolution) in resolutions.iter().enumerate() {
                *bits |= u8::from(*need > resolution.tolerance) << k;
            }
        }
        Self { values, halved, colours: None }
    }

    /// Its size in memory.
    pub fn byte_count(&self) -> u64 {
        let cells = self.values.cells.as_ref().map_or(0, |cells| size_of_val(&**cells));
        let colours = self.colours.as_ref().map_or(0, |colours| size_of_val(&*colours.texels));
        (size_of::<Self>() + size_of_val(&*self.values.steps) + size_of_val(&*self.halved) + cells + colours) as u64
    }

    /// Its triangles at a resolution, by number.
    pub fn faces(&self, index: &HeightsIndex, id: TileId, resolution: usize) -> TileFaces {
        let grid = index.grid();
        let lines = grid.lines(id);
        let outline = Outline::new(grid, &lines);
        let mut triangles = Vec::new();
        let is_even = (id.column + id.row).is_multiple_of(2);
        halve(
            is_even,
            |at| self.halved[at] >> resolution & 1 != 0,
            self.values.cells.as_deref(),
            |triangle| {
                if outline.face(triangle) == Some(true) {
                    triangles.push(triangle);
                }
            },
        );
        let on_lines = OnLines::new(outline, &triangles);
        let (mut faces, vertices) = self.vertices(index, outline, &on_lines);
        let name = |at: usize| grid.vertex(lines.columns[at % SIDE], lines.rows[at / SIDE]);
        for triangle in triangles {
            let corners = triangle.map(|at| on_lines.first(at));
            let named = corners.map(|at| vertices[at]);
            // A grid may wrap within a tile.
            let names = corners.map(name);
            if names[0] == names[1] || names[1] == names[2] || names[2] == names[0] {
                continue;
            }
            let sides = [[0, 1], [1, 2], [2, 0]].map(|[a, b]| outline.side(corners[a], corners[b]));
            let on_border = sides.map(|side| {
                let Side { axis, across, ends } = side?;
                let line = outline.lines_of(axis)[across];
                let along = outline.lines_of(1 - axis);
                outline.is_border(axis, line).then(|| (line_name(grid, axis, line), ends.map(|end| along[end])))
            });
            let own = [0, 1, 2].map(|k| match (sides[k], on_border[k]) {
                (Some(side), None) => on_lines.between(side).map(|at| vertices[at]).collect(),
                _ => Vec::new(),
            });
            match on_border.iter().all(Option::is_none) && own.iter().all(Vec::is_empty) {
                true => faces.inside.push(named),
                false => faces.open.push(OpenTriangle { corners: named, sides: on_border, own }),
            }
        }
        faces
    }

    /// The drawn vertices, and the number of each sample's. Samples that are one point, as those at a pole, are a
    /// vertex each: images have a place for each.
    fn vertices(&self, index: &HeightsIndex, outline: Outline<'_>, on_lines: &OnLines) -> (TileFaces, Vec<u32>) {
        let (grid, surface, info) = (index.grid(), index.surface(), index.info());
        let Outline { lines, .. } = outline;
        let name = |at: usize| grid.vertex(lines.columns[at % SIDE], lines.rows[at / SIDE]);
        // The last column of a grid that wraps is the first one, whatever rounding does to its longitude.
        let columns = lines.columns.map(|column| surface.line(0, grid.vertex(column, 1)[0]));
        let rows = lines.rows.map(|row| surface.line(1, row));
        // All tiles at a pole take the same column for it.
        let first = surface.line(0, 0);
        let position = |at: usize| {
            let column = if outline.is_at_pole(at as u16) { first } else { columns[at % SIDE] };
            surface.position(column, rows[at / SIDE], info.height(self.values.steps[at]))
        };
        let is_on_border =
            |at: usize| [outline.is_border(0, lines.columns[at % SIDE]), outline.is_border(1, lines.rows[at / SIDE])];
        let place = |at: usize| [(at % SIDE) as u8, (at / SIDE) as u8];
        let mut faces = TileFaces::default();
        let mut vertices = vec![u32::MAX; SIDE * SIDE];
        let mut on_border: HashMap<LineName, Vec<(u64, u32)>> = HashMap::new();
        for at in on_lines.samples() {
            let [on_column, on_row] = is_on_border(at);
            if !on_column && !on_row {
                continue;
            }
            vertices[at] = faces.positions.len() as u32;
            faces.positions.push(position(at));
            faces.places.push(place(at));
            faces.border_samples.push(name(at));
            let [column, row] = [lines.columns[at % SIDE], lines.rows[at / SIDE]];
            if on_column {
                on_border.entry(line_name(grid, 0, column)).or_default().push((row, vertices[at]));
            }
            if on_row {
                on_border.entry(line_name(grid, 1, row)).or_default().push((column, vertices[at]));
            }
        }
        for at in on_lines.samples().filter(|&at| is_on_border(at) == [false; 2]) {
            vertices[at] = faces.positions.len() as u32;
            faces.positions.push(position(at));
            faces.places.push(place(at));
        }
        for (line, mut vertices) in on_border {
            vertices.sort_unstable();
            vertices.dedup_by_key(|&mut (at, _)| at);
            let along = outline.lines_of(1 - line.0);
            faces.lines.push(BorderLine { line, range: [along[0], along[SIDE - 1]], vertices });
        }
        faces.lines.sort_unstable_by_key(|border| border.line);
        (faces, vertices)
    }
}
