//! The file of heights, made of the blocks that wait in a temporary file.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, Write};
use std::sync::PoisonError;

use lodpack::Lattice;
use lodpack::heights::{CELLS, DrapeWriter, Grid, HeightsWriter, TileEncoder, TileId};
use lodpack::index::SourceInfo;
use lodpack::write::stored_error;

use super::HeightsError;
use super::basis::Basis;
use super::spill::{Inner, Spill};

/// What was written.
#[derive(Debug, Default)]
pub struct Written {
    pub tiles: u64,
    /// Triangles of the finest resolutions of tiles without tiles below.
    pub triangles: u64,
    /// The largest of their errors.
    pub error: f64,
    pub bytes: u64,
    /// Those of the image over the heights.
    pub drape_bytes: u64,
}

impl Spill {
    /// Writes the file.
    pub fn write(
        self,
        basis: &Basis,
        encoder: &TileEncoder,
        drape: Option<DrapeWriter<File>>,
        out: &mut impl Write,
    ) -> Result<Written, HeightsError> {
        let Self { folder, inner } = self;
        let inner = inner.into_inner().unwrap_or_else(PoisonError::into_inner);
        let Inner { mut file, tiles: mut all, mut roots, .. } = inner;
        let (grid, level) = (basis.grid(), basis.setting().level);
        let mut writer = HeightsWriter::new(basis.info.clone())?;
        let [columns, rows] = grid.samples();
        let [width, height] = grid.cells();
        writer.source = SourceInfo {
            triangle_count: 2 * width * height,
            vertex_count: columns * rows,
            generator: concat!("lodpack ", env!("CARGO_PKG_VERSION")).into(),
            ..SourceInfo::default()
        };
        writer.placement = Some(basis.placement.clone());
        writer.ramp = basis.ramp.clone();
        all.sort_unstable_by_key(|tile| tile.id.order(grid));
        let mut written = Written::default();
        let mut blocks = vec![];
        for tile in &all {
            // Roots without a drawn cell are in no list.
            while let Some(root) = writer.expected().filter(|root| tile.id.depth == 0 && *root != tile.id) {
                writer.skip(root)?;
            }
            // Tiles below one that says everything were worked on before that was known.
            if writer.expected() != Some(tile.id) {
                continue;
            }
            let record = tile.record(writer.error_above());
            writer.add(&record, roots.remove(&tile.id).as_deref())?;
            if tile.id.depth > 0 && tile.length > 0 {
                blocks.push((tile.offset, tile.length));
            }
            written.tiles += 1;
            if record.children == 0
                && let Some(finest) = record.resolutions.last()
            {
                let (triangles, error) = match level.filter(|level| level.follow_from(&record)) {
                    // What is below follows, down to the greatest depth.
                    Some(level) => (triangles_of(grid, record.id), level.least()),
                    None => (finest.triangle_count.into(), finest.error),
                };
                written.triangles += triangles;
                written.error = written.error.max(error);
            }
        }
        while let Some(root) = writer.expected().filter(|root| root.depth == 0) {
            writer.skip(root)?;
        }
        let wrong = |source| HeightsError::Work { folder, source };
        file.rewind().map_err(wrong)?;
        let mut blocks =
            Blocks { file: BufReader::with_capacity(1 << 18, file), at: 0, next: blocks.into_iter(), left: 0 };
        let report = writer.finish_draped(encoder, &mut blocks, drape, out)?;
        let in_drape = report.sections.iter().find(|(name, _)| *name == "drape");
        written.drape_bytes = in_drape.map_or(0, |&(_, bytes)| bytes);
        written.bytes = report.total_bytes;
        // As the file says it, which rounds up.
        written.error = stored_error(written.error, 0.0, &Lattice::default())?;
        Ok(written)
    }
}

/// The triangles of all samples of a grid in a tile.
fn triangles_of(grid: &Grid, id: TileId) -> u64 {
    let [columns, rows] = [(0, id.column), (1, id.row)]
        .map(|(axis, tile)| [0, 1].map(|k| grid.line(axis, id.depth, (tile + k) * CELLS as u64)));
    grid.face_count([columns, rows].map(|[first, last]| last - first), rows)
}

/// Blocks one after another, wherever they lie in the temporary file.
struct Blocks {
    file: BufReader<File>,
    at: u64,
    next: std::vec::IntoIter<(u64, u32)>,
    left: u32,
}

impl Read for Blocks {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.left == 0 {
            let Some((offset, length)) = self.next.next() else { return Ok(0) };
            self.file.seek_relative(offset.cast_signed() - self.at.cast_signed())?;
            (self.at, self.left) = (offset, length);
        }
        let most = out.len().min(self.left as usize);
        let count = self.file.read(&mut out[..most])?;
        self.at += count as u64;
        self.left -= count as u32;
        Ok(count)
    }
}
