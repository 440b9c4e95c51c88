//! A tile as it is drawn: its samples in space, and the triangles that a tolerance makes of them.

use super::grid::{CELLS, Grid, Lines, SIDE, TileId};
use super::restricted::{Field, Needs, TileTriangle};
use super::surface::Surface;

/// The samples of a tile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TileValues {
    /// Heights in steps, row by row from the north-west. Those that no drawn cell touches have no meaning.
    pub steps: Box<[i32; SIDE * SIDE]>,
    /// Bits of the cells that are drawn, row by row, the westernmost one the lowest; none if all are.
    pub cells: Option<Box<[u64; CELLS]>>,
}

/// A tile's samples in space, and what each of them needs to be drawn.
#[derive(Clone, Debug)]
pub struct DrawnTile {
    /// Columns and rows of its samples.
    pub lines: Lines,
    /// In units of heights, without the height of step 0.
    pub heights: Box<[f64; SIDE * SIDE]>,
    /// In space, on a globe; on a plane they follow from the lines.
    on_globe: Vec<[f64; 3]>,
    on_plane: [[f64; SIDE]; 2],
    /// Height of step 0, and coordinates in a unit of heights.
    height_scale: [f64; 2],
    /// What its samples need to be drawn.
    pub needs: Needs,
    cells: Option<Box<[u64; CELLS]>>,
    /// Whether the first and the last row of samples are one point.
    poles: [bool; 2],
}

/// A side of a triangle that runs along a line of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Side {
    /// 0 for a column, 1 for a row.
    pub axis: usize,
    /// The index coordinate of this column or row.
    pub across: usize,
    /// The index coordinates of the side's ends along it.
    pub ends: [usize; 2],
}

/// For a side along a pole: the samples below its ends, in the row of the corner opposite to it.
fn wedge(poles: [bool; 2], a: usize, b: usize) -> Option<[usize; 2]> {
    let rows = [a / SIDE, b / SIDE];
    let half = (a % SIDE).abs_diff(b % SIDE) / 2;
    let row = match rows {
        [0, 0] if poles[0] => half,
        [CELLS, CELLS] if poles[1] => CELLS - half,
        _ => return None,
    };
    Some([a, b].map(|at| row * SIDE + at % SIDE))
}

/// The lines of a tile, and whether its first and its last row are poles: what decides how its triangles meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outline<'a> {
    pub lines: &'a Lines,
    pub poles: [bool; 2],
}

impl<'a> Outline<'a> {
    pub fn new(grid: &Grid, lines: &'a Lines) -> Self {
        let [first, last] = grid.poles();
        Self { lines, poles: [first && lines.rows[0] == 0, last && lines.rows[CELLS] == grid.cells()[1]] }
    }

    /// Whether a triangle is drawn: two corners at a pole make it a line, which is a side of its neighbours. None for
    /// one of empty cells.
    pub fn face(self, triangle: TileTriangle) -> Option<bool> {
        let line = |k: u16| (self.lines.columns[usize::from(k) % SIDE], self.lines.rows[usize::from(k) / SIDE]);
        let at = triangle.map(line);
        let has_width = !(at[0].0 == at[1].0 && at[1].0 == at[2].0);
        let has_height = !(at[0].1 == at[1].1 && at[1].1 == at[2].1);
        let are_apart = at[0] != at[1] && at[1] != at[2] && at[2] != at[0];
        let is_face = has_width && has_height && are_apart;
        is_face.then(|| triangle.iter().filter(|&&at| self.is_at_pole(at)).count() < 2)
    }

    /// Whether a sample is at a pole.
    pub fn is_at_pole(self, at: u16) -> bool {
        let row = self.lines.rows[usize::from(at) / SIDE];
        self.poles[0] && row == self.lines.rows[0] || self.poles[1] && row == self.lines.rows[CELLS]
    }

    /// A side along a column or a row.
    pub fn side(self, a: usize, b: usize) -> Option<Side> {
        let ([column, row], [other_column, other_row]) = ([a % SIDE, a / SIDE], [b % SIDE, b / SIDE]);
        let (columns, rows) = (&self.lines.columns, &self.lines.rows);
        match (self.is_at_pole(a as u16), self.is_at_pole(b as u16)) {
            (true, true) => None,
            (true, false) => Some(Side { axis: 0, across: other_column, ends: [row, other_row] }),
            (false, true) => Some(Side { axis: 0, across: column, ends: [row, other_row] }),
            _ if columns[column] == columns[other_column] => {
                Some(Side { axis: 0, across: column, ends: [row, other_row] })
            }
            _ if rows[row] == rows[other_row] => Some(Side { axis: 1, across: row, ends: [column, other_column] }),
            _ => None,
        }
    }

    /// Its columns (axis 0) or rows (axis 1).
    pub fn lines_of(self, axis: usize) -> &'a [u64; SIDE] {
        if axis == 0 { &self.lines.columns } else { &self.lines.rows }
    }

    /// Whether a line is the first or the last one of the tile.
    pub fn is_border(self, axis: usize, line: u64) -> bool {
        let lines = self.lines_of(axis);
        line == lines[0] || line == lines[CELLS]
    }
}

impl DrawnTile {
    /// Lays out a tile. A step of its values stands for `step` units of height, and step 0 for the height `zero`.
    /// `coarsest` is the largest tolerance that it will be drawn at.
    pub fn new(
        grid: &Grid,
        surface: &Surface,
        [zero, step]: [f64; 2],
        (id, values): (TileId, &TileValues),
        coarsest: f64,
    ) -> Self {
        let lines = grid.lines(id);
        let heights: Box<[f64; SIDE * SIDE]> = Box::new(std::array::from_fn(|k| f64::from(values.steps[k]) * step));
        // The last column of a grid that wraps is the first one, whatever rounding does to its longitude.
        let columns = lines.columns.map(|column| surface.line(0, grid.vertex(column, 1)[0]));
        let rows = lines.rows.map(|row| surface.line(1, row));
        let position = |k: usize| surface.position(columns[k % SIDE], rows[k / SIDE], zero + heights[k]);
        let positions: Vec<[f64; 3]> = match surface.is_globe() {
            true => (0..SIDE * SIDE).map(position).collect(),
            false => vec![],
        };
        let poles = Outline::new(grid, &lines).poles;
        let bend = |a: usize, b: usize| match surface.is_globe() {
            false => 0.0,
            true => {
                let chord = |a: usize, b: usize| {
                    let chord = [0, 1, 2].map(|k| positions[a][k] - positions[b][k]);
                    chord[0] * chord[0] + chord[1] * chord[1] + chord[2] * chord[2]
                };
                match wedge(poles, a, b) {
                    // The triangle behind a side at a pole is a line in the middle of what it stands for.
                    Some([a, b]) => 0.5 * chord(a, b).sqrt(),
                    None => surface.bend(chord(a, b)),
                }
            }
        };
        let of_axis = |lines: &[u64; SIDE]| std::array::from_fn(|k| (lines[k] - lines[0]) as f64);
        let (along, down) = (of_axis(&lines.columns), of_axis(&lines.rows));
        let rises: Box<[f64; SIDE * SIDE]> = Box::new(heights.map(|height| height * surface.height_scale));
        let field = Field { columns: &along, rows: &down, heights: &rises, bend };
        let needs = Needs::new((id.column + id.row).is_multiple_of(2), values.cells.as_deref(), &field, coarsest);
        let on_plane = [
            columns.map(|column| surface.position(column, rows[0], 0.0)[0]),
            rows.map(|row| surface.position(columns[0], row, 0.0)[1]),
        ];
        let height_scale = [zero, surface.height_scale];
        Self { lines, heights, on_globe: positions, on_plane, height_scale, needs, cells: values.cells.clone(), poles }
    }

    /// Where a sample is.
    pub fn position(&self, at: usize) -> [f64; 3] {
        let [zero, scale] = self.height_scale;
        match self.on_globe.get(at) {
            Some(&position) => position,
            None => [self.on_plane[0][at % SIDE], self.on_plane[1][at / SIDE], (zero + self.heights[at]) * scale],
        }
    }

    /// Hands out the triangles at a tolerance, without those of empty cells and those that two corners at a pole make a
    /// line.
    pub fn for_each_triangle(&self, tolerance: f64, mut with: impl FnMut(TileTriangle)) {
        self.for_each_face(tolerance, |triangle, is_drawn| {
            if is_drawn {
                with(triangle);
            }
        });
    }

    /// Hands out the triangles at a tolerance, and whether they are drawn: two corners at a pole make a triangle a
    /// line, which is a side of its neighbours. Those of empty cells are left out.
    pub fn for_each_face(&self, tolerance: f64, mut with: impl FnMut(TileTriangle, bool)) {
        let outline = self.outline();
        self.needs.for_each_triangle(tolerance, self.cells.as_deref(), |triangle| {
            if let Some(is_drawn) = outline.face(triangle) {
                with(triangle, is_drawn);
            }
        });
    }

    /// Whether a sample is at a pole.
    pub fn is_at_pole(&self, at: u16) -> bool {
        self.outline().is_at_pole(at)
    }

    /// Whether a side of a triangle can get further samples where tiles are stitched: it runs along the border of the
    /// tile, or along several index lines that lie on one line of samples. A side that ends at a pole runs along the
    /// column of its other end.
    pub fn is_open_side(&self, a: u16, b: u16) -> bool {
        let outline = self.outline();
        let Some(Side { axis, across, .. }) = outline.side(a.into(), b.into()) else { return false };
        let lines = outline.lines_of(axis);
        let is_same = |other: Option<usize>| other.and_then(|other| lines.get(other)) == Some(&lines[across]);
        outline.is_border(axis, lines[across]) || is_same(across.checked_sub(1)) || is_same(Some(across + 1))
    }

    /// Its lines and poles.
    pub(super) fn outline(&self) -> Outline<'_> {
        Outline { lines: &self.lines, poles: self.poles }
    }

    /// The triangles at a tolerance.
    pub fn triangles(&self, tolerance: f64) -> Vec<TileTriangle> {
        let mut all = vec![];
        self.for_each_triangle(tolerance, |triangle| all.push(triangle));
        all
    }
}
