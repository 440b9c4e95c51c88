//! Files of heights, made from hills that a few numbers describe.

use std::io::Cursor;

use crate::codec::entropy::SymbolBuffer;
use crate::codec::texels::{Image, ImageStreams, encode_image};
use crate::heights::{
    Base, CELLS, Drape, DrapeWriter, DrawnTile, Grid, HeightsInfo, HeightsWriter, Ramp, Resolution, SIDE, Surface,
    TileEncoder, TileId, TileRecord, TileValues, storable_tolerance, tile_symbols,
};

/// Degrees of columns and rows of a globe of 1 x 2 right angles.
const GLOBE: Base = Base::Ellipsoid { axis: 1000.0, eccentricity: 0.006 };

/// A number that looks random.
pub(crate) fn hash(numbers: impl IntoIterator<Item = u64>) -> u64 {
    numbers.into_iter().fold(0x9E37_79B9_7F4A_7C15, |state, number| {
        let mixed = (state ^ number).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB) ^ mixed >> 31
    })
}

fn share(numbers: impl IntoIterator<Item = u64>) -> f64 {
    (hash(numbers) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Hills.
#[derive(Clone, Debug)]
pub(crate) struct Terrain {
    pub info: HeightsInfo,
    /// Samples of all columns and rows, the last column of a grid that wraps included.
    steps: Vec<i32>,
    /// Which cells of the grid are drawn; none if all are.
    cells: Option<Vec<bool>>,
    ramp: Option<Ramp>,
    drape: Option<Drape>,
}

/// A texel of the image over hills, at a level. A disc of it is transparent, if it has opacity, and a corner has one
/// colour.
pub(crate) fn texel(drape: &Drape, level: u8, [x, y]: [u64; 2]) -> [u8; 4] {
    let [x, y] = [x << (3 * level), y << (3 * level)];
    if drape.components == 4 && x.abs_diff(100).pow(2) + y.abs_diff(40).pow(2) < 1300 {
        return [0; 4];
    }
    if x < 40 && y < 24 {
        return [30, 90, 200, 255];
    }
    let wave = |a: u64, b: u64| ((x * a + y * b) % 256).abs_diff(128) as u8 + hash([x, y]) as u8 % 16;
    [40 + wave(5, 1), wave(1, 4), wave(3, 7), 255]
}

impl Terrain {
    /// Hills on a plane. A sixth of them are flat.
    pub fn plane(cells: [u64; 2]) -> Self {
        let grid = Grid::new(cells, false, [false; 2]).unwrap();
        let surface = Surface { base: Base::Plane, first: [100.0, 50.0], spacing: [2.0, -1.5], height_scale: 1.0 };
        Self::new(grid, surface, 0.5)
    }

    /// Hills around a small planet.
    pub fn globe(cells: [u64; 2]) -> Self {
        let grid = Grid::new(cells, true, [true; 2]).unwrap();
        let spacing = [360.0 / cells[0] as f64, -180.0 / cells[1] as f64];
        Self::new(grid, Surface { base: GLOBE, first: [-180.0, 90.0], spacing, height_scale: 0.5 }, 0.25)
    }

    /// Hills on both sides of the date line, from 171 degrees on, four samples a degree.
    pub fn part_of_globe(cells: [u64; 2]) -> Self {
        let grid = Grid::new(cells, false, [false; 2]).unwrap();
        let surface = Surface { base: GLOBE, first: [171.0, 20.0], spacing: [0.25, -0.25], height_scale: 0.5 };
        Self::new(grid, surface, 0.25)
    }

    fn new(grid: Grid, surface: Surface, step: f64) -> Self {
        let info =
            HeightsInfo { surface, zero: 10.0, step, sample_error: 0.0, unit: Some(1.0), ramp: String::new(), grid };
        let [columns, rows] = info.grid.cells();
        let height = |column: u64, row: u64| {
            let [column, row] = info.grid.vertex(column, row);
            if column <= columns / 2 && row > rows / 3 && !info.grid.wraps() {
                return 7;
            }
            let octave = |octave: u32| {
                let size = 1_u64 << octave;
                let around = columns.div_ceil(size);
                let corner = |x: u64, y: u64| {
                    let x = if info.grid.wraps() { x % around } else { x };
                    share([octave.into(), x, y])
                };
                let [x, y] = [column, row].map(|at| (at % size) as f64 / size as f64);
                let [i, j] = [column / size, row / size];
                let north = corner(i, j) * (1.0 - x) + corner(i + 1, j) * x;
                let south = corner(i, j + 1) * (1.0 - x) + corner(i + 1, j + 1) * x;
                (north * (1.0 - y) + south * y) * size as f64
            };
            (0..6).map(octave).sum::<f64>() as i32
        };
        let steps = (0..=rows).flat_map(|row| (0..=columns).map(move |column| height(column, row))).collect();
        Self { steps, cells: None, info, ramp: None, drape: None }
    }

    /// Without the cells that `is_there` does not name.
    #[must_use]
    pub fn with_cells(mut self, is_there: impl Fn(u64, u64) -> bool) -> Self {
        let [columns, rows] = self.info.grid.cells();
        let is_there = &is_there;
        let cells = (0..rows).flat_map(|row| (0..columns).map(move |column| is_there(column, row)));
        self.cells = Some(cells.collect());
        self
    }

    /// Level, but for the samples that `is_kept` names.
    #[must_use]
    pub fn level_but(mut self, is_kept: impl Fn(u64, u64) -> bool) -> Self {
        let width = self.info.grid.cells()[0] as usize + 1;
        for (at, step) in self.steps.iter_mut().enumerate() {
            if !is_kept((at % width) as u64, (at / width) as u64) {
                *step = 7;
            }
        }
        self
    }

    /// Drawn with these colours.
    #[must_use]
    pub fn with_ramp(mut self, ramp: Ramp) -> Self {
        self.info.ramp = "hills".into();
        self.ramp = Some(ramp);
        self
    }

    /// With an image over them.
    #[must_use]
    pub fn with_drape(mut self, drape: Drape) -> Self {
        self.drape = Some(drape);
        self
    }

    /// The image over them, ready to be written.
    fn drape_writer(&self) -> Option<DrapeWriter<Cursor<Vec<u8>>>> {
        let drape = self.drape?;
        let mut writer = DrapeWriter::new(drape, Cursor::default()).unwrap();
        for level in 0..drape.level_count() {
            let [columns, rows] = writer.groups(level);
            for group in (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row])) {
                let images = writer.tiles(level, group).into_iter().map(|(first, size)| {
                    let places = (0..size[1])
                        .flat_map(|y| (0..size[0]).map(move |x| [first[0] + u64::from(x), first[1] + u64::from(y)]));
                    let texels: Vec<[u8; 4]> = places.map(|place| texel(&drape, level, place)).collect();
                    if texels.iter().all(|texel| texel[3] == 0) && level == 0 {
                        return ImageStreams::default();
                    }
                    let data = texels.iter().flat_map(|texel| &texel[..drape.components.into()]).copied().collect();
                    let image = Image { size, components: drape.components, data };
                    encode_image(&image, &vec![true; texels.len()], 9)
                });
                let images: Vec<ImageStreams> = images.collect();
                writer.put(level, group, &images).unwrap();
            }
        }
        Some(writer)
    }

    /// A sample.
    pub fn step(&self, column: u64, row: u64) -> i32 {
        self.steps[(row * (self.info.grid.cells()[0] + 1) + column) as usize]
    }

    fn is_drawn(&self, columns: [u64; 2], rows: [u64; 2]) -> bool {
        let width = self.info.grid.cells()[0];
        let any =
            |row: u64, cells: &Vec<bool>| (columns[0]..columns[1]).any(|column| cells[(row * width + column) as usize]);
        match &self.cells {
            None => columns[0] < columns[1] && rows[0] < rows[1],
            Some(cells) => (rows[0]..rows[1]).any(|row| any(row, cells)),
        }
    }

    /// Whether a drawn cell touches a sample.
    pub fn is_known(&self, column: u64, row: u64) -> bool {
        let [columns, rows] = self.info.grid.cells();
        let of = |at: u64, last: u64| [at.saturating_sub(1), (at + 1).min(last)];
        let wraps = self.info.grid.wraps() && (column == 0 || column == columns);
        self.is_drawn(of(column, columns), of(row, rows))
            || wraps && [0, columns].iter().any(|&column| self.is_drawn(of(column, columns), of(row, rows)))
    }

    /// A tile; none if it draws nothing.
    pub fn tile(&self, id: TileId) -> Option<TileValues> {
        let lines = self.info.grid.lines(id);
        let mut cells = Box::new([0; CELLS]);
        for (row, bits) in cells.iter_mut().enumerate() {
            for column in 0..CELLS {
                let [columns, rows] = [&lines.columns, &lines.rows].map(|lines| lines);
                let is_drawn = self.is_drawn([columns[column], columns[column + 1]], [rows[row], rows[row + 1]]);
                *bits |= u64::from(is_drawn) << column;
            }
        }
        if self.cells.is_some() && cells.iter().all(|&row| row == 0) {
            return None;
        }
        let steps = std::array::from_fn(|k| self.step(lines.columns[k % SIDE], lines.rows[k / SIDE]));
        Some(TileValues { steps: Box::new(steps), cells: self.cells.is_some().then_some(cells) })
    }

    /// Random resolutions whose errors do not grow.
    fn resolutions(&self, id: TileId, values: &TileValues, coarser: f64, most: f64) -> Vec<Resolution> {
        let name = [id.depth.into(), id.column, id.row];
        let info = &self.info;
        let drawn = DrawnTile::new(&info.grid, &info.surface, [info.zero, info.step], (id, values), f64::INFINITY);
        let count = 1 + hash(name) % 8;
        let (mut error, mut tolerance) = (coarser.min(1000.0), most);
        (0..count)
            .map(|k| {
                error *= share(name.into_iter().chain([k])).max(0.01);
                tolerance = storable_tolerance(tolerance * share(name.into_iter().chain([k, 7]))).unwrap();
                let triangle_count = drawn.triangles(tolerance).len() as u32;
                // Rounded down, so that rounding up in the file does not make it larger than the one before.
                Resolution { tolerance, error: storable_tolerance(error).unwrap(), triangle_count }
            })
            .collect()
    }

    /// A file of it. Resolutions have tolerances up to `most`, and errors that have nothing to do with them, so that
    /// every cut may occur.
    pub fn file(&self, most: f64) -> Vec<u8> {
        let grid = &self.info.grid;
        let mut tiles = Vec::new();
        let mut waiting: Vec<(TileId, Option<TileValues>, f64)> =
            grid.root_tiles().map(|id| (id, None, f64::MAX)).collect();
        while let Some((id, parent, coarser)) = waiting.pop() {
            let Some(values) = self.tile(id) else { continue };
            let mut symbols = SymbolBuffer::default();
            tile_symbols(grid, id, parent.as_ref(), &values, &mut symbols).unwrap();
            let resolutions = self.resolutions(id, &values, coarser, most);
            let finest = resolutions.last().unwrap().error;
            let children = id.children().into_iter().filter(|&child| grid.has(child));
            waiting.extend(children.map(|child| (child, Some(values.clone()), finest)));
            let (lowest, highest) = (*values.steps.iter().min().unwrap(), *values.steps.iter().max().unwrap());
            let is_partial = values.cells.as_ref().is_some_and(|cells| cells.iter().any(|&row| row != u64::MAX));
            let record = TileRecord {
                id,
                children: 0,
                is_partial,
                lowest,
                highest,
                resolutions,
                block_bytes: 0,
                checksum: 0,
                is_level: false,
            };
            tiles.push((record, symbols));
        }
        tiles.sort_by_key(|(record, _)| record.id.order(grid));
        let every_third = tiles.iter().step_by(3).map(|(_, symbols)| symbols);
        let encoder = TileEncoder::new(every_third, false);
        let blocks: Vec<Vec<u8>> = tiles.iter().map(|(_, symbols)| encoder.encode(symbols).unwrap()).collect();
        // A tile is left out if it and all below it follow from what is above.
        let mut stored = std::collections::HashSet::new();
        for ((record, _), block) in tiles.iter().zip(&blocks).rev() {
            let id = record.id;
            if !block.is_empty() || id.depth == 0 || id.children().iter().any(|child| stored.contains(child)) {
                stored.insert(id);
                // Others may draw nothing, so that none of those beside it may be left out.
                stored.extend(id.parent().into_iter().flat_map(TileId::children));
            }
        }
        let there: std::collections::HashSet<TileId> =
            tiles.iter().map(|(record, _)| record.id).filter(|id| stored.contains(id)).collect();
        let mut writer = HeightsWriter::new(self.info.clone()).unwrap();
        writer.ramp.clone_from(&self.ramp);
        let mut pages = Vec::new();
        for ((mut record, _), block) in tiles.into_iter().zip(blocks) {
            if !there.contains(&record.id) {
                continue;
            }
            while writer.expected().is_some_and(|id| id != record.id && id.depth == 0) {
                writer.skip(writer.expected().unwrap()).unwrap();
            }
            let children = record.id.children();
            record.children = (0..4).map(|k| u8::from(there.contains(&children[k])) << k).sum();
            (record.block_bytes, record.checksum) = (block.len() as u64, crc32fast::hash(&block));
            let is_root = record.id.depth == 0;
            writer.add(&record, is_root.then_some(&block)).unwrap();
            if !is_root {
                pages.extend(block);
            }
        }
        while let Some(id) = writer.expected() {
            writer.skip(id).unwrap();
        }
        let mut bytes = Vec::new();
        writer.finish_draped(&encoder, &mut pages.as_slice(), self.drape_writer(), &mut bytes).unwrap();
        bytes
    }
}
