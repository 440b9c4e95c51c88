//! Files of heights: written, read back, cut and stitched.

use std::collections::{HashMap, HashSet};

use super::terrain::{Terrain, hash};
use crate::{
    error::Error,
    heights::{CELLS, Grid, Heights, HeightsMesh, HeightsQuery, SIDE, TileId, TileValues},
    limits::Limits,
};

fn open(bytes: &[u8]) -> Heights<&[u8]> {
    Heights::open(bytes, Limits::default()).unwrap()
}

/// Terrains of all kinds, with their names.
fn terrains() -> Vec<(&'static str, Terrain)> {
    let island = |column: u64, row: u64| {
        let away = column.abs_diff(120).pow(2) + row.abs_diff(80).pow(2);
        away < 60_u64.pow(2) && away > 15_u64.pow(2) || column + row == 77 || column > 200 && row % 37 == 5
    };
    vec![
        ("odd sizes", Terrain::plane([300, 173])),
        ("a power of two", Terrain::plane([256, 128])),
        ("long", Terrain::plane([700, 3])),
        ("one cell", Terrain::plane([1, 1])),
        ("globe", Terrain::globe([300, 150])),
        ("islands", Terrain::plane([300, 173]).with_cells(island)),
        ("globe with islands", Terrain::globe([300, 150]).with_cells(island)),
    ]
}

fn all_tiles(grid: &Grid) -> Vec<TileId> {
    let mut all: Vec<TileId> = grid.root_tiles().collect();
    let mut next = 0;
    while let Some(&id) = all.get(next) {
        all.extend(id.children().into_iter().filter(|&child| grid.has(child)));
        next += 1;
    }
    all
}

/// Whether a drawn cell touches a sample of a tile.
fn touches(tile: &TileValues, at: usize) -> bool {
    let Some(cells) = &tile.cells else { return true };
    let is_drawn = |column: usize, row: usize| column < CELLS && row < CELLS && (cells[row] >> column) & 1 != 0;
    let (columns, rows) = ([at % SIDE, (at % SIDE).wrapping_sub(1)], [at / SIDE, (at / SIDE).wrapping_sub(1)]);
    columns.iter().any(|&column| rows.iter().any(|&row| is_drawn(column, row)))
}

#[test]
fn every_tile_comes_back() {
    for (name, terrain) in terrains() {
        let bytes = terrain.file(5.0);
        let heights = open(&bytes);
        assert_eq!(heights.info(), &terrain.info);
        let mut ids = all_tiles(heights.grid());
        ids.sort_by_key(|id| hash([id.depth.into(), id.column, id.row]));
        let (mut stored, mut implied) = (0, 0);
        for id in ids {
            let (found, expected) = (heights.tile(id).unwrap(), terrain.tile(id));
            assert_eq!(found.is_some(), expected.is_some(), "{name} {id:?}");
            let (Some(found), Some(expected)) = (found, expected) else { continue };
            let [a, b] =
                [found.as_ref(), &expected].map(|tile| tile.cells.as_deref().copied().unwrap_or([u64::MAX; CELLS]));
            // Empty cells may be drawn or not: they draw nothing.
            let lines = terrain.info.grid.lines(id);
            for at in 0..CELLS * CELLS {
                let (column, row) = (at % CELLS, at / CELLS);
                let has_size =
                    lines.columns[column] < lines.columns[column + 1] && lines.rows[row] < lines.rows[row + 1];
                assert!(!has_size || (a[row] ^ b[row]) >> column & 1 == 0, "{name} {id:?}");
            }
            for at in (0..SIDE * SIDE).filter(|&at| touches(&expected, at)) {
                assert_eq!(found.steps[at], expected.steps[at], "{name} {id:?} {at}");
            }
            match heights.record(id).unwrap() {
                Some(record) => {
                    assert!(record.lowest <= found.steps[SIDE * SIDE / 2] || expected.cells.is_some());
                    stored += 1;
                }
                None => implied += 1,
            }
        }
        assert!(stored > 0);
        assert!(implied > 0 || !name.contains("odd"), "{name}");
    }
}

#[test]
fn windows_are_the_samples() {
    for (name, terrain) in terrains() {
        let bytes = terrain.file(5.0);
        let heights = open(&bytes);
        let [columns, rows] = heights.grid().samples();
        for seed in 0..12 {
            let pick = |what: u64, count: u64| hash([seed, what]) % count;
            let (column, row) = (pick(0, columns), pick(1, rows));
            let last = if heights.grid().wraps() { column + columns } else { columns };
            let (columns_end, rows_end) = match seed {
                0 => (last, rows),
                _ => (column + pick(2, last - column + 1), row + pick(3, rows - row + 1)),
            };
            let window = heights.window(column..columns_end, row..rows_end).unwrap();
            assert_eq!(window.len() as u64, (columns_end - column) * (rows_end - row));
            let mut found = window.into_iter();
            for row in row..rows_end {
                for column in (column..columns_end).map(|column| column % columns) {
                    let height = found.next().unwrap();
                    if terrain.is_known(column, row) {
                        assert_eq!(height, terrain.info.height(terrain.step(column, row)), "{name} {column} {row}");
                    } else {
                        assert!(height.is_nan(), "{name} {column} {row}");
                    }
                }
            }
        }
        for (columns, rows) in [(0..columns + 1 + columns, 0..1), (columns..columns + 1, 0..1), (0..1, 0..rows + 1)] {
            assert!(matches!(heights.window(columns, rows), Err(Error::Query { .. })));
        }
    }
}

/// Edges that only one triangle has. All others have one in each direction.
fn boundary(mesh: &HeightsMesh, name: &str) -> HashSet<[u32; 2]> {
    let mut edges = HashSet::new();
    for t in &mesh.triangles {
        for edge in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            assert!(edge[0] != edge[1] && edges.insert(edge), "{name}: an edge occurs twice");
        }
    }
    edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).copied().collect()
}

/// Looks for gaps along which the mesh lies on both sides.
fn find_cracks(mesh: &HeightsMesh, grid: &Grid, name: &str) {
    let mut lines = HashMap::<(usize, u64), Vec<[u64; 2]>>::new();
    for [a, b] in boundary(mesh, name) {
        let [mut from, mut to] = [a, b].map(|vertex| mesh.samples[vertex as usize]);
        let is_pole = |[_, row]: [u64; 2]| row == 0 && grid.poles()[0] || row == grid.cells()[1] && grid.poles()[1];
        if is_pole(from) {
            from[0] = to[0];
        }
        if is_pole(to) {
            to[0] = from[0];
        }
        let axis = usize::from(from[0] != to[0]);
        assert_eq!(from[axis], to[axis], "{name}: a boundary runs across cells");
        if axis == 1 && grid.wraps() {
            // The last column has the name of the first one.
            let around = grid.cells()[0];
            if from[0] == 0 && to[0] > around / 2 {
                from[0] = around
            }
            if to[0] == 0 && from[0] > around / 2 {
                to[0] = around
            }
        }
        lines.entry((axis, from[axis])).or_default().push([from[1 - axis], to[1 - axis]]);
    }
    for (line, sides) in lines {
        for a in sides.iter().filter(|side| side[0] < side[1]) {
            for b in sides.iter().filter(|side| side[0] > side[1]) {
                assert!(a[1] <= b[1] || b[0] <= a[0], "{name}: a crack in {line:?} {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn random_cuts_are_closed() {
    for (name, terrain) in terrains() {
        for most in [1e-9, 3.0, 12.0] {
            let bytes = terrain.file(most);
            let heights = open(&bytes);
            let grid = heights.grid();
            let mut sizes = HashSet::new();
            for seed in 0..8 {
                let tolerance = Some(10_f64.powf((hash([seed]) % 700) as f64 / 100.0 - 4.0)).filter(|_| seed > 0);
                let max_triangles = (seed % 4 == 3).then_some(hash([seed, 1]) % 5000);
                let cut = heights.cut(&HeightsQuery { tolerance, max_triangles, ..HeightsQuery::default() }).unwrap();
                let mesh = heights.mesh(&cut).unwrap();
                let is_coarse_globe = grid.wraps() && cut.tiles.iter().any(|tile| tile.id.depth == 0);
                find_cracks(&mesh, grid, name);
                sizes.insert(mesh.triangles.len());
                assert!(mesh.triangles.len() as u64 >= cut.triangle_count || is_coarse_globe);
                if name.contains("islands") {
                    continue;
                }
                for edge in boundary(&mesh, name) {
                    let [a, b] = edge.map(|vertex| mesh.samples[vertex as usize]);
                    let is_outer = |axis: usize| a[axis] == b[axis] && (a[axis] == 0 || a[axis] == grid.cells()[axis]);
                    assert!(!grid.wraps() && (is_outer(0) || is_outer(1)), "{name} {a:?} {b:?}");
                }
                if !grid.wraps() {
                    let doubled = |t: &[u32; 3]| {
                        let [a, b, c] = t.map(|vertex| mesh.samples[vertex as usize].map(|x| x as i64));
                        let area = (b[0] - a[0]) * (a[1] - c[1]) - (a[1] - b[1]) * (c[0] - a[0]);
                        assert!(area > 0, "{name} {a:?} {b:?} {c:?}");
                        area
                    };
                    let [columns, rows] = grid.cells();
                    let area: i64 = mesh.triangles.iter().map(doubled).sum();
                    assert_eq!(area as u64, 2 * columns * rows, "{name}");
                }
            }
            assert!(sizes.len() > 2 || name == "one cell" || name == "long" || most < 1.0, "{name}: {sizes:?}");
        }
    }
}
