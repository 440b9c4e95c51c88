//! Prints what the samples of a grid of heights cost in blocks, and how fast one thread codes them:
//! heights_bench GRID...
//!
//! A grid is a file of two little-endian 32-bit numbers, its rows and columns of samples, and then as many 32-bit
//! steps, row by row. A file `NAME.lerc` beside it, if there is one, says how many bytes LERC takes for the same
//! samples at the same largest error.
//!
//! Sizes are those of the blocks of all tiles, at all depths, and of the tables. Times are processor time where the
//! system reports it (Linux); encoding includes finding the residuals, and decoding the tiles above.

mod timing;

use lodpack::heights::{
    Base, CELLS, Grid, Heights, HeightsInfo, HeightsWriter, Resolution, SIDE, Surface, TileEncoder, TileId, TileRecord,
    TileValues, tile_symbols,
};
use lodpack::write::SymbolBuffer;
use lodpack::{Limits, Result};

/// Measurements repeat until this much time has been spent.
const LEAST_SECONDS: f64 = 1.0;

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    println!("   samples   bits a sample      LERC   ratio   encode    decode (ns a sample)  grid");
    for path in std::env::args().skip(1) {
        let field = Field::read(&std::fs::read(&path)?)?;
        let lerc: Option<f64> =
            std::fs::read_to_string(format!("{path}.lerc")).ok().and_then(|text| text.trim().parse().ok());
        let count = field.steps.len() as f64;
        let bytes = field.file()?;
        let encode = timing::seconds(LEAST_SECONDS, || field.file().map(|bytes| bytes.len()))?;
        let decode = timing::seconds(LEAST_SECONDS, || decode(&bytes))?;
        let bits = 8.0 * bytes.len() as f64 / count;
        let (lerc, ratio) = match lerc.map(|bytes| 8.0 * bytes / count) {
            Some(lerc) => (format!("{lerc:.3}"), format!("{:.2}", bits / lerc)),
            None => ("-".into(), "-".into()),
        };
        let [encode, decode] = [encode, decode].map(|seconds| 1e9 * seconds / count);
        println!("{count:10} {bits:15.3} {lerc:>9} {ratio:>7} {encode:8.1} {decode:9.1}                        {path}");
    }
    Ok(())
}

/// All samples of a grid.
struct Field {
    grid: Grid,
    steps: Vec<i32>,
}

impl Field {
    fn read(bytes: &[u8]) -> std::result::Result<Self, Box<dyn std::error::Error>> {
        let (numbers, _) = bytes.as_chunks::<4>();
        let mut numbers = numbers.iter().map(|&bytes| i32::from_le_bytes(bytes));
        let [rows, columns] = [numbers.next(), numbers.next()].map(|count| count.unwrap_or(0).max(2) as u64);
        let steps: Vec<i32> = numbers.collect();
        if steps.len() as u64 != rows * columns {
            return Err("the grid does not have as many samples as it says".into());
        }
        Ok(Self { grid: Grid::new([columns - 1, rows - 1], false, [false; 2])?, steps })
    }

    fn tile(&self, id: TileId) -> TileValues {
        let (lines, width) = (self.grid.lines(id), self.grid.samples()[0]);
        let step = |k: usize| self.steps[(lines.rows[k / SIDE] * width + lines.columns[k % SIDE]) as usize];
        TileValues { steps: Box::new(std::array::from_fn(step)), cells: None }
    }

    fn file(&self) -> Result<Vec<u8>> {
        let grid = &self.grid;
        let mut ids: Vec<TileId> = grid.root_tiles().collect();
        let mut next = 0;
        while let Some(id) = ids.get(next).copied() {
            ids.extend(id.children().into_iter().filter(|&child| grid.has(child)));
            next += 1;
        }
        ids.sort_unstable_by_key(|id| id.order(grid));
        let symbols = ids.iter().map(|&id| {
            let parent = id.parent().map(|parent| self.tile(parent));
            let mut symbols = SymbolBuffer::default();
            tile_symbols(grid, id, parent.as_ref(), &self.tile(id), &mut symbols)?;
            Ok(symbols)
        });
        let symbols: Vec<SymbolBuffer> = symbols.collect::<Result<_>>()?;
        let encoder = TileEncoder::new(&symbols, true);
        let surface = Surface { base: Base::Plane, first: [0.0; 2], spacing: [1.0, -1.0], height_scale: 1.0 };
        let info = HeightsInfo {
            grid: grid.clone(),
            surface,
            zero: 0.0,
            step: 1.0,
            sample_error: 0.5,
            unit: None,
            ramp: String::new(),
        };
        let (mut writer, mut blocks) = (HeightsWriter::new(info)?, Vec::new());
        for (&id, symbols) in ids.iter().zip(&symbols) {
            let block = encoder.encode(symbols)?;
            let children = (0..4).zip(id.children()).map(|(k, child)| u8::from(grid.has(child)) << k).sum();
            let (block_bytes, checksum) = (block.len() as u64, crc32fast::hash(&block));
            let resolutions = vec![Resolution::default()];
            let record = TileRecord {
                id,
                children,
                is_partial: false,
                lowest: 0,
                highest: 0,
                resolutions,
                block_bytes,
                checksum,
                is_level: false,
            };
            writer.add(&record, (id.depth == 0).then_some(&block))?;
            if id.depth > 0 {
                blocks.extend(block);
            }
        }
        let mut bytes = Vec::new();
        writer.finish(&encoder, &mut blocks.as_slice(), &mut bytes)?;
        Ok(bytes)
    }
}

fn decode(bytes: &[u8]) -> Result<usize> {
    let heights = Heights::open(bytes, Limits::default())?;
    let [columns, rows] = heights.grid().samples();
    let band = 4 * CELLS as u64;
    let mut count = 0;
    for row in (0..rows).step_by(band as usize) {
        count += heights.window(0..columns, row..(row + band).min(rows))?.len();
    }
    Ok(count)
}
