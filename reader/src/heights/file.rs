//! An open file of heights.

use std::{
    ops::Range,
    sync::{Arc, Mutex},
};

use super::{
    drape::{Drape, DrapeImage, DrapeWindow},
    drawn::{DrawnTile, TileValues},
    grid::{Grid, SIDE, TileId},
    index::HeightsIndex,
    normals::{Across, Normal, SIDES, across, normals},
    page::TileRecord,
    ramp::Ramp,
    section::HeightsInfo,
    surface::Surface,
    tiles::KeptTiles,
    tree::Place,
};
use crate::{
    error::{Error, Result},
    format::{placement::Placement, records::SourceInfo},
    index::Opener,
    limits::Limits,
    source::{Fetched, ReadAt, read_ranges, requests::plan},
};

/// The size of the first read: it covers a first picture.
const FIRST_READ_BYTES: usize = 16 << 10;

/// An open file of heights: its [`HeightsIndex`], and a source from which it reads what an answer needs. It keeps index
/// pages, and the tiles used last.
#[derive(Debug)]
pub struct Heights<S> {
    source: S,
    index: Arc<HeightsIndex>,
    pub(super) tiles: Mutex<KeptTiles>,
}

impl<S: ReadAt> Heights<S> {
    /// Opens a file: one request of 16 KiB for most.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] if it is damaged or not whole, [`Error::Unsupported`] if it needs a newer
    /// reader, [`Error::Limit`];
    /// [`Error::Query`] if it holds a mesh.
    pub fn open(source: S, limits: Limits) -> Result<Self> {
        let io = |source| Error::Io { offset: 0, length: FIRST_READ_BYTES as u64, source };
        let (bytes, size) = source.read_start(FIRST_READ_BYTES).map_err(io)?;
        let mut opener = Opener::new(limits);
        opener.start(bytes, size);
        loop {
            match HeightsIndex::new(&opener) {
                Err(Error::Missing { ranges }) => {
                    read_ranges(&source, &ranges)?.into_iter().for_each(|(at, bytes)| opener.insert(at, bytes));
                }
                index => return Ok(Self::of(Arc::new(index?), source)),
            }
        }
    }

    /// A file whose index is known; `source` has its bytes.
    pub fn of(index: Arc<HeightsIndex>, source: S) -> Self {
        Self { source, index, tiles: Mutex::default() }
    }

    /// The file's index, which answers without reading. It may outlive the file.
    pub fn index(&self) -> &Arc<HeightsIndex> {
        &self.index
    }

    /// The source that the file is read from.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// What the file says about all of it.
    pub fn info(&self) -> &HeightsInfo {
        self.index.info()
    }

    /// The samples.
    pub fn grid(&self) -> &Grid {
        self.index.grid()
    }

    /// Where they are.
    pub fn surface(&self) -> &Surface {
        self.index.surface()
    }

    /// What the file was made from, if it says so.
    pub fn source_info(&self) -> Option<&SourceInfo> {
        self.index.source_info()
    }

    /// Where the heights are in the world, if the file says so.
    pub fn placement(&self) -> Option<&Placement> {
        self.index.placement()
    }

    /// The colours to draw it with, if the file has some.
    pub fn ramp(&self) -> Option<&Ramp> {
        self.index.ramp()
    }

    /// The image over it, if the file has one.
    pub fn drape(&self) -> Option<&Drape> {
        self.index.drape()
    }

    /// The texels of a window of the image over it.
    ///
    /// # Errors
    /// [`Error::Query`] if there is no image, or the window has more texels than [`Limits::texel_count`];
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn drape_image(&self, window: &DrapeWindow) -> Result<DrapeImage> {
        let mut fetched = Fetched::default();
        loop {
            match self.index.drape_image(window, &fetched) {
                Err(Error::Missing { ranges }) => {
                    read_ranges(&self.source, &ranges)?.into_iter().for_each(|(at, bytes)| fetched.insert(at, bytes));
                }
                image => return image,
            }
        }
    }

    /// The image over a tile, with at most `most` texels, and two more, along each side; none where there is none.
    ///
    /// # Errors
    /// As [`Self::drape_image`].
    pub fn tile_image(&self, id: TileId, most: u32) -> Result<Option<DrapeImage>> {
        let [columns, rows] = self.grid().ends(id);
        let window = self.drape().and_then(|drape| drape.window_of_size(columns, rows, most));
        window.map(|window| self.drape_image(&window)).transpose()
    }

    /// The tiles at depth 0. One that draws nothing is not there.
    pub fn roots(&self) -> &[TileId] {
        self.index.roots()
    }

    /// What the file says about a tile; none if it does not have it.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn record(&self, id: TileId) -> Result<Option<TileRecord>> {
        match self.place(id)? {
            Place::Here(entry) => Ok(Some(entry.record)),
            _ => Ok(None),
        }
    }

    /// A tile laid out in space. `coarsest` is the largest tolerance that it will be drawn at.
    pub fn draw(&self, id: TileId, tile: &TileValues, coarsest: f64) -> DrawnTile {
        self.index.draw(id, tile, coarsest)
    }

    /// The normals of a tile's samples: [`super::normals`] with the tiles of the same depth across its sides, which are
    /// read.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn normals(&self, id: TileId, tile: &TileValues) -> Result<Box<[Normal; SIDE * SIDE]>> {
        let mut beside = [const { None }; SIDES];
        for (side, beside) in beside.iter_mut().enumerate() {
            let Some(other) = across(self.grid(), id, side) else { continue };
            *beside = self.tile(other)?.map(|values| (other, values));
        }
        let beside = beside.each_ref().map(|tile| {
            let (id, values) = tile.as_ref()?;
            Some(Across { id: *id, values })
        });
        Ok(normals(self.info(), (id, tile), beside))
    }

    /// Where the pages of the index begin.
    #[cfg(test)]
    pub(crate) fn index_offset(&self) -> u64 {
        self.index.index.offset
    }

    /// Reads ranges, as far as they did not come with opening.
    pub(crate) fn fetch(&self, ranges: &[Range<u64>]) -> Result<Fetched> {
        let mut fetched = Fetched::default();
        let new = plan(ranges.iter().filter(|&range| self.index.head.get(range.clone()).is_none()).cloned());
        read_ranges(&self.source, &new)?.into_iter().for_each(|(at, bytes)| fetched.insert(at, bytes));
        Ok(fetched)
    }

    /// Bytes of a range that was fetched.
    pub(super) fn get<'a>(&'a self, fetched: &'a Fetched, range: Range<u64>) -> Result<&'a [u8]> {
        let found = self.index.head.get(range.clone()).or_else(|| fetched.get(range));
        found.ok_or_else(|| Error::format("the file is truncated"))
    }
}
