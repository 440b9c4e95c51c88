//! Blocks of tiles in a temporary file, until all of them are known.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use lodpack::heights::{MAX_RESOLUTIONS, Resolution, TileId, TileRecord};

use super::unit::Finished;
use super::{HeightsError, nameless};

/// A tile whose block lies in the temporary file, unless it is a root's.
pub(super) struct Kept {
    pub id: TileId,
    children: u8,
    is_partial: bool,
    range: [i32; 2],
    /// Coarse to fine.
    resolutions: [Resolution; MAX_RESOLUTIONS],
    count: u8,
    pub offset: u64,
    pub length: u32,
    checksum: u32,
}

impl Kept {
    /// Its record, below a tile with an error. Coarse resolutions that are worse than that are dominated by it.
    pub fn record(&self, above: f64) -> TileRecord {
        let all = &self.resolutions[..self.count.into()];
        let dominated = all.iter().filter(|resolution| resolution.error > above).count();
        TileRecord {
            id: self.id,
            children: self.children,
            is_partial: self.is_partial,
            lowest: self.range[0],
            highest: self.range[1],
            resolutions: all[dominated.min(all.len() - 1)..].to_vec(),
            block_bytes: self.length.into(),
            checksum: self.checksum,
            is_level: false,
        }
    }
}

/// Blocks that wait until all of them are known.
pub struct Spill {
    pub(super) folder: PathBuf,
    pub(super) inner: Mutex<Inner>,
}

pub(super) struct Inner {
    pub file: File,
    bytes: u64,
    pub tiles: Vec<Kept>,
    pub roots: HashMap<TileId, Vec<u8>>,
}

impl Spill {
    /// Blocks go to a file of this folder that has no name once it is open.
    pub fn new(folder: &Path) -> Result<Self, HeightsError> {
        let file = nameless(folder)?;
        let inner = Inner { file, bytes: 0, tiles: vec![], roots: HashMap::new() };
        Ok(Self { folder: folder.to_owned(), inner: Mutex::new(inner) })
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn failed(&self) -> impl Fn(io::Error) -> HeightsError + '_ {
        |source| HeightsError::Work { folder: self.folder.clone(), source }
    }

    /// Takes tiles.
    pub fn put(&self, finished: Vec<Finished>) -> Result<(), HeightsError> {
        let blocks: Vec<u8> =
            finished.iter().filter(|tile| tile.id.depth > 0).flat_map(|tile| &tile.block).copied().collect();
        let inner = &mut *self.lock();
        inner.file.write_all(&blocks).map_err(self.failed())?;
        for tile in finished {
            let mut resolutions = [Resolution::default(); MAX_RESOLUTIONS];
            let coarse_to_fine = tile.resolutions.iter().rev().take(MAX_RESOLUTIONS);
            resolutions.iter_mut().zip(coarse_to_fine).for_each(|(to, from)| *to = *from);
            let length = tile.block.len() as u32;
            inner.tiles.push(Kept {
                id: tile.id,
                children: tile.children,
                is_partial: tile.is_partial,
                range: tile.range,
                resolutions,
                count: tile.resolutions.len().min(MAX_RESOLUTIONS) as u8,
                offset: inner.bytes,
                length,
                checksum: crc32fast::hash(&tile.block),
            });
            if tile.id.depth == 0 {
                inner.roots.insert(tile.id, tile.block);
            } else {
                inner.bytes += u64::from(length);
            }
        }
        Ok(())
    }
}
