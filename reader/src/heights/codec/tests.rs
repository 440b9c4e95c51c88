use super::*;
use crate::codec::entropy::encode;

/// Heights that are rough in the west, flat in the east, and have a cliff.
fn height(column: u64, row: u64) -> i32 {
    let (x, y) = (column as f64, row as f64);
    let noise =
        (column.wrapping_mul(0x9E37_79B9) ^ row.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35) >> 20 & 0xff;
    let rough = if column < 60 { noise as f64 * 0.1 } else { 0.0 };
    let cliff = if row > 70 && column > 100 { 1e9 } else { 0.0 };
    ((x * 0.05).sin() * 300.0 + (y * 0.08).cos() * 200.0 + rough - cliff) as i32
}

fn tile(grid: &Grid, id: TileId, is_there: impl Fn(u64, u64) -> bool) -> TileValues {
    let lines = grid.lines(id);
    let steps = Box::new(std::array::from_fn(|k| height(lines.columns[k % SIDE], lines.rows[k / SIDE])));
    // A cell of any depth covers those below it. Without width it covers nothing.
    let there = |a: [u64; 2], b: [u64; 2]| (a[0]..b[0]).any(|column| (a[1]..b[1]).any(|row| is_there(column, row)));
    let mut cells = Box::new([0; CELLS]);
    for (row, bits) in cells.iter_mut().enumerate() {
        for column in 0..CELLS {
            let [a, b] = [0, 1].map(|step| [lines.columns[column + step], lines.rows[row + step]]);
            *bits |= u64::from(there(a, b)) << column;
        }
    }
    let is_whole = is_there(u64::MAX, 0);
    TileValues { steps, cells: (!is_whole).then_some(cells) }
}

/// All tiles with their parents and symbols.
fn tiles(
    grid: &Grid,
    is_there: impl Fn(u64, u64) -> bool + Copy,
) -> Vec<(TileId, Option<TileValues>, TileValues, SymbolBuffer)> {
    let mut all = Vec::new();
    let mut waiting: Vec<TileId> = grid.root_tiles().collect();
    while let Some(id) = waiting.pop() {
        let values = tile(grid, id, is_there);
        let parent = id.parent().map(|id| tile(grid, id, is_there));
        if values.cells.as_ref().is_some_and(|cells| cells.iter().all(|&row| row == 0)) {
            continue;
        }
        let mut symbols = SymbolBuffer::default();
        tile_symbols(grid, id, parent.as_ref(), &values, &mut symbols).unwrap();
        all.push((id, parent, values, symbols));
        waiting.extend(id.children().into_iter().filter(|&child| grid.has(child)));
    }
    all
}

fn same(grid: &Grid, id: TileId, a: &TileValues, b: &TileValues) {
    assert_eq!(a.drawn_cells(), b.drawn_cells());
    let corners = a.drawn_cells().map(|cells| cells::corners(cells, &grid.lines(id)));
    for k in 0..SIDE * SIDE {
        assert!(corners.as_ref().is_some_and(|corners| !corners[k]) || a.steps[k] == b.steps[k], "{id:?} {k}");
    }
}

#[test]
fn tiles_of_any_grid_come_back() {
    for cells in [[64, 64], [129, 150], [1, 1], [3, 200], [500, 7], [97, 65]] {
        let grid = Grid::new(cells, false, [false; 2]).unwrap();
        let island = |column: u64, row: u64| {
            column < 9999 && (column.abs_diff(40).pow(2) + row.abs_diff(30).pow(2) < 900 || column + row == 77)
        };
        for is_there in [|_: u64, _: u64| true, island] {
            let tiles = tiles(&grid, is_there);
            let tables = Tables::from_buffers(tiles.iter().map(|tile| &tile.3));
            for (id, parent, values, symbols) in &tiles {
                let block = encode(&tables.codes(), [symbols.iter()]).unwrap();
                let is_partial = values.drawn_cells().is_some();
                let found = match block.is_empty() {
                    // Few symbols are certain in their own tables.
                    true => continue,
                    false => decode_tile(&grid, *id, parent.as_ref(), is_partial, (&tables, &block)).unwrap(),
                };
                same(&grid, *id, values, &found);
            }
        }
    }
}

#[test]
fn rows_together_have_the_symbols_of_samples_one_by_one() {
    let grid = Grid::new([256, 256], false, [false; 2]).unwrap();
    for (scale, quarter) in [(0, 0), (1, 1), (9, 2), (300, 3), (4000, 0), (1 << 19, 1), (1 << 22, 2)] {
        let noise = |column: u64, row: u64| {
            let (x, y, rough) = (column as f64, row as f64, ((column * 7919) ^ (row * 104_729)) % 17);
            (((x * 0.3).sin() * 40.0 + (y * 0.21).cos() * 25.0 + rough as f64) / 64.0 * f64::from(scale)) as i32
        };
        let of = |id: TileId| {
            let Lines { columns, rows } = grid.lines(id);
            let step = |k: usize| noise(columns[k % SIDE], rows[k / SIDE]);
            TileValues { steps: Box::new(std::array::from_fn(step)), cells: None }
        };
        let parent = TileId { depth: 1, column: 1, row: 0 };
        let id = parent.children()[quarter];
        let (above, tile) = (of(parent), of(id));
        let [mut together, mut apart] = [SymbolBuffer::default(), SymbolBuffer::default()];
        let start = Start::new(&grid, id, Some(&above));
        uneven_symbols(id, (&grid.lines(id), start), &tile, &mut apart).unwrap();
        let is_small = even::put(&tile.steps, &mut together);
        assert!(is_small == (together == apart) && is_small == (scale < 1 << 19), "{scale}");
        let mut symbols = SymbolBuffer::default();
        tile_symbols(&grid, id, Some(&above), &tile, &mut symbols).unwrap();
        assert!(symbols == apart);
    }
}

#[test]
fn flat_tiles_are_implied() {
    let grid = Grid::new([300, 200], false, [false; 2]).unwrap();
    let flat = TileValues { steps: Box::new([0; SIDE * SIDE]), cells: None };
    let [root, child] = [0, 1].map(|depth| TileId { depth, column: 0, row: 0 });
    let mut symbols = SymbolBuffer::default();
    tile_symbols(&grid, root, None, &flat, &mut symbols).unwrap();
    tile_symbols(&grid, child, Some(&flat), &flat, &mut symbols).unwrap();
    assert!(is_implied(&symbols));
    assert_eq!(implied_tile(&grid, child, &flat).unwrap(), flat);
    let high = TileValues { steps: Box::new([7; SIDE * SIDE]), cells: None };
    let wrong = tile_symbols(&grid, child, Some(&flat), &high, &mut symbols);
    assert!(wrong.unwrap_err().to_string().contains("other samples than its parent"));
}
