//! Whether meshes of cuts of heights are closed: each edge has a triangle on either side, but where the surface ends.

use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use lodpack::heights::{CELLS, Grid, Heights, HeightsCut, HeightsMesh, Lines, SIDE, TileValues};
use lodpack::{ReadAt, Result};

/// From one column of samples to another, and from one row to another.
type Strip = [Range<i64>; 2];

/// The cells that the tiles of a cut draw.
struct Drawn<'a> {
    grid: &'a Grid,
    /// Lines of their samples; and what they draw, if that is not all.
    tiles: Vec<(Lines, Option<Arc<TileValues>>)>,
}

impl<'a> Drawn<'a> {
    fn new<S: ReadAt>(file: &'a Heights<S>, cut: &HeightsCut) -> Result<Self> {
        let grid = file.grid();
        let tile = |id| {
            let is_partial = file.record(id)?.is_some_and(|record| record.is_partial);
            Ok((grid.lines(id), if is_partial { file.tile(id)? } else { None }))
        };
        Ok(Self { grid, tiles: cut.tiles.iter().map(|of_cut| tile(of_cut.id)).collect::<Result<_>>()? })
    }

    /// Whether some of what lies between columns of samples and between rows is drawn.
    fn has_some(&self, [columns, rows]: &Strip) -> bool {
        let around = self.grid.cells()[0] as i64;
        let turns: &[i64] = if self.grid.wraps() { &[-1, 0, 1] } else { &[0] };
        self.tiles.iter().any(|(lines, tile)| {
            let drawn = tile.as_ref().and_then(|tile| tile.cells.as_deref());
            turns.iter().any(|turn| {
                let columns = columns.start + turn * around..columns.end + turn * around;
                let (Some(columns), Some(rows)) = (cells_of(&lines.columns, &columns), cells_of(&lines.rows, rows))
                else {
                    return false;
                };
                drawn
                    .is_none_or(|drawn| rows.into_iter().any(|row| columns.clone().any(|at| drawn[row] >> at & 1 == 1)))
            })
        })
    }
}

/// Those of a tile that touch what lies between two lines of samples. None if it has none there.
fn cells_of(lines: &[u64; SIDE], between: &Range<i64>) -> Option<RangeInclusive<usize>> {
    let (from, to) = (between.start.max(lines[0] as i64), between.end.min(lines[CELLS] as i64));
    let cell = |at: i64| lines.partition_point(|&line| line as i64 <= at) - 1;
    (from < to).then(|| cell(from)..=cell(to - 1))
}

/// What is wrong with a mesh, if anything is.
///
/// # Errors
/// If tiles of the cut cannot be read.
pub(super) fn fault<S: ReadAt>(file: &Heights<S>, cut: &HeightsCut, mesh: &HeightsMesh) -> Result<Option<String>> {
    // Both ends, the lower one first, whether it is the one that the edge comes from, and the corner opposite to it.
    let mut edges: Vec<([u32; 2], bool, u32)> = Vec::with_capacity(3 * mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        edges.extend(
            [([a, b], c), ([b, c], a), ([c, a], b)]
                .map(|([from, to], opposite)| ([from.min(to), from.max(to)], from < to, opposite)),
        );
    }
    edges.sort_unstable();
    let mut open = vec![];
    for alike in edges.chunk_by(|one, other| one.0 == other.0) {
        match alike {
            &[([low, high], _, opposite)] if low != high => open.push([low, high, opposite]),
            [(_, one, _), (_, other, _)] if one != other => {}
            _ => return Ok(Some("an edge has two triangles on one side".to_owned())),
        }
    }
    if open.is_empty() {
        return Ok(None);
    }
    let drawn = Drawn::new(file, cut)?;
    let is_crack = |edge: &&[u32; 3]| {
        let beyond = strip_beyond(drawn.grid, edge.map(|at| mesh.samples[at as usize]));
        beyond.is_none_or(|strip| drawn.has_some(&strip))
    };
    Ok(open.iter().find(is_crack).map(|edge| {
        let [p, q, _] = edge.map(|at| mesh.samples[at as usize]);
        format!("a crack between the samples in column {}, row {} and column {}, row {}", p[0], p[1], q[0], q[1])
    }))
}

/// What lies along an edge, on the side where its triangle is not. None if the edge runs through cells, where no
/// surface ends.
fn strip_beyond(grid: &Grid, corners: [[u64; 2]; 3]) -> Option<Strip> {
    let ([columns, last_row], poles) = (grid.cells(), grid.poles());
    let is_pole = |row: u64| row == 0 && poles[0] || row == last_row && poles[1];
    let around = columns as i64;
    // Around the globe the nearest way; a pole lies in every column.
    let [p, q, c] = {
        let from = corners.into_iter().find(|corner| !is_pole(corner[1]))?[0] as i64;
        corners.map(|[column, row]| {
            let away = column as i64 - from;
            let turns = if grid.wraps() && 2 * away.abs() > around { away.signum() * around } else { 0 };
            [if is_pole(row) { None } else { Some(from + away - turns) }, Some(row as i64)]
        })
    };
    let known = |one: [Option<i64>; 2], other: [Option<i64>; 2], axis: usize| one[axis].or(other[axis]);
    let (from, to) = ([known(p, q, 0)?, p[1]?], [known(q, p, 0)?, q[1]?]);
    let axis = (0..2).find(|&axis| from[axis] == to[axis] && from[1 - axis] != to[1 - axis])?;
    let line = from[axis];
    // The column of a corner at a pole is asked for where the others lie in one, and then the triangle has no area on
    // the globe.
    let beyond = if c[axis]? < line { line } else { line - 1 };
    let along = from[1 - axis].min(to[1 - axis])..from[1 - axis].max(to[1 - axis]);
    let beyond = beyond..beyond + 1;
    Some(if axis == 0 { [beyond, along] } else { [along, beyond] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack::Limits;
    use lodpack::heights::HeightsQuery;

    #[test]
    fn a_triangle_that_is_missing_is_found_beside_cells_without_heights_and_around_globes() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors/heights");
        for name in ["cell", "globe", "hills", "islands", "painted", "ridge", "sea"] {
            let bytes = std::fs::read(folder.join(format!("{name}.lodpack"))).expect("the vector is there");
            let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it is sound");
            for tolerance in [0.0, 1.0, 100.0] {
                let query = HeightsQuery { tolerance: Some(tolerance), ..HeightsQuery::default() };
                let cut = file.cut(&query).expect("a cut");
                let mesh = file.mesh(&cut).expect("its mesh");
                assert_eq!(fault(&file, &cut, &mesh).expect("readable"), None, "{name} {tolerance}");
                for missing in (0..mesh.triangles.len()).step_by(mesh.triangles.len().div_ceil(20)) {
                    let mut mesh = mesh.clone();
                    mesh.triangles.remove(missing);
                    let fault = fault(&file, &cut, &mesh).expect("readable");
                    assert!(fault.is_some_and(|fault| fault.starts_with("a crack")), "{name} {tolerance} {missing}");
                }
            }
        }
    }
}
