//! Files of heights: what there is, cuts and meshes.

use std::{cell::RefCell, io, ops::Range, sync::Arc};

use lodpack::{
    Error, Fetched, Mesh, Query, ReadAt, Volume,
    heights::{CutTile, Heights, HeightsCut, HeightsIndex, HeightsMesh, HeightsQuery, TileId},
};

use crate::{
    answer::{Answer, Put, put_all, put_mesh, words, wrong},
    state::{State, limiter},
};

/// Words of a tile in a cut: depth, column, row, and the number of its resolution.
const WORDS: usize = 4;

/// The bytes that a question has fetched, as a source. It notes what is missing.
struct Told<'f> {
    fetched: &'f Fetched,
    missing: RefCell<Vec<Range<u64>>>,
}

impl ReadAt for Told<'_> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.read_ranges(&mut [lodpack::source::Request { offset, buf }])
    }

    fn size(&self) -> io::Result<u64> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn read_ranges(&self, requests: &mut [lodpack::source::Request<'_>]) -> io::Result<()> {
        for request in requests {
            let range = request.offset..request.offset.saturating_add(request.buf.len() as u64);
            match self.fetched.get(range.clone()) {
                Some(bytes) => request.buf.copy_from_slice(bytes),
                None => self.missing.borrow_mut().push(range),
            }
        }
        if self.missing.borrow().is_empty() { Ok(()) } else { Err(io::ErrorKind::WouldBlock.into()) }
    }
}

/// Asks a file, as far as its bytes have been fetched.
fn ask<T>(
    index: &Arc<HeightsIndex>,
    fetched: &Fetched,
    question: impl FnOnce(&Heights<&Told<'_>>) -> Result<T, Error>,
) -> Result<T, Error> {
    let told = Told { fetched, missing: RefCell::default() };
    let answer = question(&Heights::of(Arc::clone(index), &told));
    let ranges = told.missing.take();
    match answer {
        Err(Error::Io { .. }) if !ranges.is_empty() => Err(Error::Missing { ranges }),
        answer => answer,
    }
}

/// What a query asks of heights: a box, a tolerance and a budget of triangles.
fn query_of(query: &Query) -> Result<HeightsQuery, Error> {
    let is_more = query.view.is_some() || query.max_nodes.is_some() || query.max_bytes.is_some();
    let bounds = match query.volume {
        _ if is_more => None,
        None => Some(None),
        Some(Volume::Box([low, high])) => Some(Some([[low[0], low[1]], [high[0], high[1]]])),
        Some(_) => None,
    };
    let bounds = bounds.ok_or_else(|| {
        wrong("cuts of heights take box, tolerance and maxTriangles; a stream takes a view, and other volumes and budgets")
    })?;
    Ok(HeightsQuery { bounds, tolerance: query.tolerance, max_triangles: query.max_triangles })
}

impl State {
    /// What is said of the grid (f64): `js/core.js` reads it.
    pub fn heights(&mut self) -> Answer {
        let index = Arc::clone(self.heights_index()?);
        let (grid, surface, info) = (index.grid(), index.surface(), index.info());
        let flag = |flag: bool| f64::from(u8::from(flag));
        let [columns, rows] = grid.samples().map(|count| count as f64);
        self.output.put_floats([
            columns,
            rows,
            flag(grid.wraps()),
            flag(surface.is_globe()),
            f64::from(grid.depth() + 1),
        ]);
        self.output.put_floats(surface.first.into_iter().chain(surface.spacing));
        self.output.put_floats([info.step, info.sample_error, info.unit.unwrap_or(f64::NAN), surface.height_scale]);
        self.output.extend(info.ramp.bytes());
        Ok(0)
    }

    /// The cut for a query, as `js/core.js` reads cuts.
    pub fn select_heights(&mut self, question: u32, query: &Query) -> Answer {
        let query = query_of(query)?;
        let index = Arc::clone(self.heights_index()?);
        let fetched = self.questions.get(question)?;
        let cut = ask(&index, fetched, |heights| heights.cut(&query))?;
        let mut numbers = Vec::with_capacity(WORDS * cut.tiles.len());
        for CutTile { id, resolution } in &cut.tiles {
            // Its pages are known by now.
            let record = ask(&index, fetched, |heights| heights.record(*id))?;
            let number = record.and_then(|record| record.resolutions.iter().position(|other| other == resolution));
            numbers.extend([id.depth, id.column as u32, id.row as u32, number.unwrap_or(0) as u32]);
        }
        self.output.put_floats([cut.error, 0.0, cut.triangle_count as f64, 0.0, f64::from(limiter(cut.limiter))]);
        self.output.put_floats(cut.tiles.iter().map(|tile| tile.resolution.error));
        self.output.put_words(numbers);
        Ok(cut.tiles.len() as u32)
    }

    /// The mesh of the cut in the input.
    pub fn extract_heights(&mut self, question: u32) -> Answer {
        let index = Arc::clone(self.heights_index()?);
        let numbers: Vec<u32> = words(&self.input).collect();
        let (tiles, rest) = numbers.as_chunks::<WORDS>();
        if !rest.is_empty() {
            return Err(wrong("a cut of heights has depth, column, row and resolution of each tile"));
        }
        let fetched = self.questions.get(question)?;
        let (mesh, colours) = ask(&index, fetched, |heights| {
            let mut cut = HeightsCut::default();
            for &[depth, column, row, number] in tiles {
                let id = TileId { depth, column: column.into(), row: row.into() };
                let record = heights.record(id)?;
                let resolution = record.and_then(|record| record.resolutions.get(number as usize).copied());
                let resolution = resolution.ok_or_else(|| wrong("a tile of the cut does not exist"))?;
                cut.tiles.push(CutTile { id, resolution });
            }
            let mesh = heights.mesh(&cut)?;
            let colours = heights.colours(&cut, &mesh)?;
            Ok((mesh, colours))
        })?;
        let HeightsMesh { positions, triangles, triangle_tiles, normals, .. } = mesh;
        put_mesh(&mut self.output, &Mesh { positions, triangles, triangle_nodes: triangle_tiles });
        // Of each vertex: the normal (f32), and the colour, if there is an image or a ramp.
        put_all(&mut self.output, &normals, |bytes: &mut [u8; 12], normal| {
            let numbers = normal.map(|x| (f32::from(x) / 32767.0).to_le_bytes());
            bytes.as_chunks_mut::<4>().0.copy_from_slice(&numbers);
        });
        if let Some(colours) = colours {
            put_all(&mut self.output, &colours, |bytes: &mut [u8; 4], &[r, g, b]| {
                *bytes = [r, g, b, 255];
            });
        }
        Ok(0)
    }
}
