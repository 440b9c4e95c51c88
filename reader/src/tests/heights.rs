//! Files of heights: written, read back, cut and stitched.

use std::{
    collections::{HashMap, HashSet},
    io,
};

use super::{
    synthetic::{Options, cube, file_of},
    terrain::{Terrain, hash},
};
use crate::{
    File, Opened,
    codec::bytes::ANY_CHECKSUM,
    error::Error,
    heights::{
        CELLS, Grid, Heights, HeightsInfo, HeightsMesh, HeightsQuery, HeightsWriter, MOST_LEVEL, Resolution, SIDE,
        Surface, TileEncoder, TileId, TileRecord, TileValues,
    },
    limits::Limits,
    select::Limiter,
    source::{Counting, Recording},
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
        (
            "sea around a globe",
            Terrain::globe([300, 150]).level_but(|x, y| (200..230).contains(&x) && (40..60).contains(&y)),
        ),
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
                let coarsest = HeightsQuery { tolerance: Some(f64::MAX), ..HeightsQuery::default() };
                let least = heights.cut(&coarsest).unwrap().triangle_count;
                let max_triangles = (seed % 4 == 3).then_some((hash([seed, 1]) % 5000).max(least));
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

/// Reads everything.
fn read_all(bytes: &[u8]) -> Result<(), Error> {
    let heights = Heights::open(bytes, Limits::default())?;
    let mut waiting = heights.roots().to_vec();
    while let Some(id) = waiting.pop() {
        heights.tile(id)?;
        waiting.extend(heights.record(id)?.unwrap().child_tiles());
    }
    Ok(())
}

#[test]
fn what_follows_from_a_level_tile_takes_no_time_for_ever() {
    let grid = Grid::new([1 << 30, 1 << 29], true, [true; 2]).unwrap();
    let hills = Terrain::globe([90, 45]).info;
    let spacing = [360.0 / f64::from(1 << 30), -180.0 / f64::from(1 << 29)];
    let info = HeightsInfo { surface: Surface { spacing, ..hills.surface }, grid: grid.clone(), ..hills };
    let encoder = TileEncoder::new(&[], false);
    let mut writer = HeightsWriter::new(info).unwrap();
    for id in grid.root_tiles() {
        let resolutions = vec![Resolution { tolerance: 0.0, error: 64.0, triangle_count: 8064 }];
        let (lowest, highest) = (0, 0);
        let (children, block_bytes, checksum, is_partial, is_level) = (0, 0, 0, false, false);
        let record =
            TileRecord { id, children, is_partial, lowest, highest, resolutions, block_bytes, checksum, is_level };
        writer.add(&record, Some(&[])).unwrap();
    }
    let mut bytes = Vec::new();
    writer.finish(&encoder, &mut io::empty(), &mut bytes).unwrap();
    let heights = open(&bytes);
    heights.verify().unwrap();
    let cut = heights.cut(&HeightsQuery::default()).unwrap();
    assert!(cut.limiter == Limiter::Finest && cut.tiles.len() as u64 == 1 + 3 * MOST_LEVEL + 1);
    let cut = heights.cut(&HeightsQuery { tolerance: Some(1.0), ..HeightsQuery::default() }).unwrap();
    assert!(cut.limiter == Limiter::Tolerance && cut.error <= 1.0 && cut.tiles.len() > 16);
}

#[test]
fn truncation_and_every_flipped_bit_are_found() {
    for cells in [[1, 1], [130, 2]] {
        let good = Terrain::plane(cells).file(5.0);
        read_all(&good).unwrap();
        assert!((0..good.len()).all(|end| Heights::open(&good[..end], Limits::default()).is_err()));
        assert!(read_all(&[&good[..], &[0]].concat()).is_err());
        let mut changed = good.clone();
        for bit in 0..8 * good.len() {
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(read_all(&changed).is_err(), "bit {bit}");
            changed[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

#[test]
fn files_of_the_other_kind_are_named() {
    let heights = Terrain::plane([1, 1]).file(5.0);
    let error = File::open(heights.as_slice(), Limits::default()).unwrap_err();
    assert!(matches!(error, Error::Query { .. }) && error.to_string().contains("heights::Heights"), "{error}");
    let mesh = file_of(&cube(1), Options { levels: 2, seed: 1, grids_of_four: 0, heights: 0 });
    let error = Heights::open(mesh.as_slice(), Limits::default()).unwrap_err();
    assert!(matches!(error, Error::Query { .. }) && error.to_string().contains("lodpack::File"), "{error}");
}

#[test]
fn either_kind_opens_with_one_first_read() {
    let heights = Terrain::plane([700, 500]).file(5.0);
    let mesh = file_of(&cube(1), Options { levels: 2, seed: 1, grids_of_four: 0, heights: 0 });
    for (bytes, most_reads) in [(&heights, 2), (&mesh, 2)] {
        let recording = Recording::new(bytes.as_slice());
        let opened = Opened::open(&recording, Limits::default()).unwrap();
        assert_eq!(matches!(opened, Opened::Heights(_)), std::ptr::eq(bytes, &heights));
        let reads = recording.take();
        assert!(reads.len() <= most_reads && reads[0].start == 0 && reads[0].end <= 12 << 10, "{reads:?}");
        let overlap = reads.windows(2).any(|pair| pair[1].start < pair[0].end);
        assert!(!overlap, "{reads:?}");
        assert!((0..bytes.len()).all(|end| Opened::open(&bytes[..end], Limits::default()).is_err()));
    }
}

#[test]
fn a_page_that_names_itself_is_refused() {
    let good = Terrain::plane([1100, 2]).file(5.0);
    let heights = open(&good);
    let deepest = |heights: &Heights<&[u8]>| {
        let depth = heights.grid().depth();
        heights.record(TileId { depth, column: 0, row: 0 }).map(|record| record.is_some())
    };
    assert!(deepest(&heights).unwrap() && heights.grid().depth() == 4);
    // The second number of a page says where the pages below it begin.
    let at = heights.index_offset() as usize + 8;
    let mut bad = good.clone();
    bad[at..at + 8].fill(0);
    ANY_CHECKSUM.set(true);
    let error = deepest(&open(&bad)).unwrap_err();
    ANY_CHECKSUM.set(false);
    assert!(error.to_string().contains("index page of tile 4/0/0"), "{error}");
}

#[test]
fn one_request_opens_a_small_file_and_few_draw_a_part() {
    let bytes = Terrain::plane([700, 500]).file(5.0);
    let source = Counting::new(bytes.as_slice());
    let heights = Heights::open(source, Limits::default()).unwrap();
    assert_eq!(heights.source().read_count(), 1);
    let bounds = Some([[120.0, -60.0], [220.0, 20.0]]);
    let cut = heights.cut(&HeightsQuery { bounds, ..HeightsQuery::default() }).unwrap();
    let mesh = heights.mesh(&cut).unwrap();
    assert!(!mesh.triangles.is_empty() && (cut.tiles.len() as u64) < 30);
    assert!(heights.source().read_count() <= 6, "{}", heights.source().read_count());
}

#[test]
fn longitudes_a_turn_apart_are_one_place() {
    let bytes = Terrain::part_of_globe([130, 100]).file(30.0);
    let heights = open(&bytes);
    let tiles = |west: f64, east: f64| {
        let bounds = Some([[west, 0.0], [east, 10.0]]);
        heights.cut(&HeightsQuery { bounds, ..HeightsQuery::default() }).unwrap().tiles
    };
    assert!(!tiles(185.0, 188.0).is_empty());
    assert_eq!(tiles(185.0, 188.0), tiles(-175.0, -172.0));
    assert_eq!(tiles(175.0, 188.0), tiles(175.0, -172.0));
    assert!(tiles(0.0, 90.0).is_empty());
}

#[test]
fn bounds_choose_tiles() {
    let bytes = Terrain::globe([300, 150]).file(30.0);
    let heights = open(&bytes);
    let cut = |bounds: [[f64; 2]; 2]| heights.cut(&HeightsQuery { bounds: Some(bounds), ..HeightsQuery::default() });
    let whole = heights.cut(&HeightsQuery::default()).unwrap().tiles.len();
    assert_eq!(cut([[-180.0, -90.0], [180.0, 90.0]]).unwrap().tiles.len(), whole);
    let crossing = cut([[170.0, -5.0], [-170.0, 5.0]]).unwrap();
    assert_eq!(crossing, cut([[170.0, -5.0], [190.0, 5.0]]).unwrap());
    assert!(crossing.tiles.len() < whole / 2);
    let lines: Vec<_> = crossing.tiles.iter().map(|tile| heights.grid().lines(tile.id).columns).collect();
    assert!(lines.iter().any(|columns| columns[0] == 0) && lines.iter().any(|columns| columns[CELLS] == 300));
    assert_eq!(cut([[10.0, 10.0], [10.0, 10.0]]).unwrap().tiles.len(), 1);
    assert!(cut([[10.0, 10.0], [20.0, 5.0]]).is_err() && cut([[f64::NAN; 2]; 2]).is_err());
    let query = HeightsQuery { tolerance: Some(-1.0), ..HeightsQuery::default() };
    assert!(matches!(heights.cut(&query), Err(Error::Query { .. })));
    let few = heights.cut(&HeightsQuery { max_triangles: Some(3000), ..HeightsQuery::default() }).unwrap();
    assert!(few.triangle_count <= 3000 && few.limiter == Limiter::Triangles);
    assert!(few.error >= heights.cut(&HeightsQuery::default()).unwrap().error);
}
