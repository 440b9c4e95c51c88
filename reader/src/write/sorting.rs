//! From the order of pieces to the order of the file: symbols wait outside memory, those of a cluster in few chunks.
//!
//! A cluster may have roots of several pieces, and pieces come one after the other. The part of a cluster in a piece is
//! one *chunk*: the blocks of its roots, then the samples of its arcs level by level, in the order of the file. Each
//! run of symbols is its size in tokens and in extra bits (varints), then these. The texel streams of a block follow
//! its symbols, each with its size (varint).

use std::{
    io::{Read, Seek, SeekFrom, Write},
    ops::Range,
};

use super::{
    arrangement::Arrangement,
    catalogue::first_blocks,
    piece::{Piece, Runs},
    texels::TexelRuns,
};
use crate::{
    codec::{
        bytes::{Cursor, put_varint},
        entropy::Symbols,
    },
    error::{Error, Result},
    format::clusters::Cluster,
};

/// Symbols that wait.
#[derive(Debug)]
pub(super) struct Sorting<S> {
    bytes: S,
    length: u64,
    /// Of each cluster: piece, and place in `bytes`.
    chunks: Vec<Vec<(usize, Range<u64>)>>,
    /// Texel streams of a block.
    stream_count: usize,
}

/// The symbols of a cluster, and its texels.
#[derive(Clone, Debug, Default)]
pub struct ClusterSymbols {
    pub(super) cluster: usize,
    bytes: Vec<u8>,
    /// Tokens and extra bits of each block, root after root.
    blocks: Vec<[Range<usize>; 2]>,
    /// Those of each arc and level.
    arcs: Vec<[Range<usize>; 2]>,
    /// The texel streams of each block, root after root.
    texels: Vec<Range<usize>>,
    /// The owners of each block's islands, likewise.
    owners: Vec<Range<usize>>,
}

impl<S: Read + Write + Seek> Sorting<S> {
    /// Nothing waits in `bytes` yet.
    pub fn new(bytes: S, cluster_count: usize, stream_count: usize) -> Self {
        Self { bytes, length: 0, chunks: vec![Vec::new(); cluster_count], stream_count }
    }

    /// Takes the symbols of a piece.
    ///
    /// # Errors
    /// [`Error::Model`] if these are not what its index said; [`Error::Write`].
    pub fn take(&mut self, arrangement: &Arrangement, number: usize, piece: &Piece) -> Result<()> {
        let other = || Error::model("a piece is not the one that was counted");
        let level_count = arrangement.level_count;
        let [roots, arcs] = arrangement.catalogue.of_piece(number).ok_or_else(other)?;
        let entries = &arrangement.catalogue.roots[roots.start as usize..roots.end as usize];
        let block_count: usize = entries.iter().map(|root| root.blocks.len()).sum();
        let Piece { index, symbols } = piece;
        let found = [index.roots.len(), symbols.blocks.count(), index.arc_ends.len(), symbols.arcs.count()];
        let expected = [roots.len(), block_count, arcs.len(), arcs.len() * level_count];
        let is_sound = symbols.texels.is_sound(block_count * self.stream_count) && symbols.owners.is_sound(block_count);
        if found != expected || !is_sound {
            return Err(other());
        }
        let first_blocks = first_blocks(entries);
        let roots = placed(&arrangement.roots.numbers, roots);
        let arcs = placed(&arrangement.arcs.numbers, arcs);
        let (mut roots, mut arcs) = (roots.into_iter().peekable(), arcs.into_iter().peekable());
        self.bytes.seek(SeekFrom::Start(self.length)).map_err(|source| Error::Write { source })?;
        let mut chunk = Vec::new();
        loop {
            let of_root = roots.peek().map(|&(root, _)| arrangement.cluster_of_root(root));
            let of_arc = arcs.peek().map(|&(arc, _)| arrangement.cluster_of_arc(arc));
            let Some(cluster) = of_root.into_iter().chain(of_arc).min() else { return Ok(()) };
            let Cluster { first_root, root_count, first_arc, arc_count, .. } = arrangement.clusters[cluster];
            chunk.clear();
            while let Some((_, own)) = roots.next_if(|&(root, _)| root - first_root < root_count) {
                let first = first_blocks[own];
                for block in first..first + entries[own].blocks.len() {
                    append(&mut chunk, &symbols.blocks, block..block + 1);
                    append_texels(&mut chunk, &symbols.texels, block, self.stream_count);
                    append_texels(&mut chunk, &symbols.owners, block, 1);
                }
            }
            while let Some((_, own)) = arcs.next_if(|&(arc, _)| arc - first_arc < arc_count) {
                append(&mut chunk, &symbols.arcs, own * level_count..(own + 1) * level_count);
            }
            let start = self.length;
            self.length += chunk.len() as u64;
            self.bytes.write_all(&chunk).map_err(|source| Error::Write { source })?;
            self.chunks[cluster].push((number, start..self.length));
        }
    }

    /// The symbols of a cluster, once all pieces have been taken.
    ///
    /// # Errors
    /// [`Error::Model`] if a piece is missing; [`Error::Write`].
    pub fn symbols(&mut self, arrangement: &Arrangement, number: usize) -> Result<ClusterSymbols> {
        let mut symbols = ClusterSymbols { cluster: number, ..ClusterSymbols::default() };
        let (Some(cluster), Some(chunks)) = (arrangement.clusters.get(number), self.chunks.get_mut(number)) else {
            return Err(Error::model("there is no such cluster"));
        };
        let mut left = Vec::with_capacity(chunks.len());
        for (piece, Range { start, end }) in std::mem::take(chunks) {
            let before = symbols.bytes.len();
            let read = self.bytes.seek(SeekFrom::Start(start));
            let read = read.and_then(|_| (&mut self.bytes).take(end - start).read_to_end(&mut symbols.bytes));
            read.map_err(|source| Error::Write { source })?;
            left.push((piece, before..symbols.bytes.len()));
        }
        let bytes = &symbols.bytes[..];
        let Arrangement { catalogue, .. } = arrangement;
        for &root in arrangement.roots_of(cluster) {
            let piece = catalogue.piece_of_root(root);
            for _ in &catalogue.roots[root as usize].blocks {
                let chunk = chunk_of(&mut left, piece)?;
                symbols.blocks.push(next(bytes, chunk)?);
                for _ in 0..self.stream_count {
                    let [stream] = next(bytes, chunk)?;
                    symbols.texels.push(stream);
                }
                let [owners] = next(bytes, chunk)?;
                symbols.owners.push(owners);
            }
        }
        for &arc in arrangement.arcs_of(cluster) {
            let piece = catalogue.piece_of_arc(arc);
            for _ in 0..arrangement.level_count {
                symbols.arcs.push(next(bytes, chunk_of(&mut left, piece)?)?);
            }
        }
        Ok(symbols)
    }
}

impl ClusterSymbols {
    /// How many bytes they are.
    pub fn bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Makes room for the given numbers of blocks, runs of arcs and texel streams, all empty yet.
    #[cfg(feature = "serde")]
    pub(super) fn make_room(&mut self, blocks: usize, arcs: usize, texels: usize) {
        self.blocks.resize(blocks, [const { 0..0 }; 2]);
        self.arcs.resize(arcs, [const { 0..0 }; 2]);
        self.texels.resize(texels, 0..0);
        self.owners.resize(blocks, 0..0);
    }

    /// Puts the symbols and texels of a piece's block in the place of a block here.
    #[cfg(feature = "serde")]
    pub(super) fn put_block(&mut self, place: usize, piece: &Piece, block: usize, stream_count: usize) {
        self.blocks[place] = self.put(piece.symbols.blocks.get(block));
        for stream in 0..stream_count {
            let start = self.bytes.len();
            self.bytes.extend(piece.symbols.texels.get(block * stream_count + stream));
            self.texels[place * stream_count + stream] = start..self.bytes.len();
        }
        let start = self.bytes.len();
        self.bytes.extend(piece.symbols.owners.get(block));
        self.owners[place] = start..self.bytes.len();
    }

    /// Puts a run of a piece's arcs in the place of one here.
    #[cfg(feature = "serde")]
    pub(super) fn put_arc(&mut self, place: usize, piece: &Piece, run: usize) {
        self.arcs[place] = self.put(piece.symbols.arcs.get(run));
    }

    #[cfg(feature = "serde")]
    fn put(&mut self, symbols: Symbols<'_>) -> [Range<usize>; 2] {
        symbols.bytes().map(|part| {
            let start = self.bytes.len();
            self.bytes.extend(part);
            start..self.bytes.len()
        })
    }

    /// The symbols of a block, counted over the blocks of all roots.
    pub(super) fn block(&self, block: usize) -> Symbols<'_> {
        self.run(self.blocks.get(block))
    }

    /// A texel stream, counted over the blocks of all roots.
    pub(super) fn texels(&self, stream: usize) -> &[u8] {
        self.texels.get(stream).and_then(|range| self.bytes.get(range.clone())).unwrap_or_default()
    }

    /// The owners of a block's islands, likewise.
    pub(super) fn owners(&self, block: usize) -> &[u8] {
        self.owners.get(block).and_then(|range| self.bytes.get(range.clone())).unwrap_or_default()
    }

    /// The symbols of some arcs at a level.
    pub(super) fn arcs(
        &self,
        arcs: Range<u32>,
        level: usize,
        level_count: usize,
    ) -> impl DoubleEndedIterator<Item = Symbols<'_>> {
        arcs.map(move |arc| self.run(self.arcs.get(arc as usize * level_count + level)))
    }

    fn run(&self, run: Option<&[Range<usize>; 2]>) -> Symbols<'_> {
        Symbols::of(run.map_or([&[]; 2], |parts| parts.clone().map(|part| self.bytes.get(part).unwrap_or_default())))
    }
}

/// The numbers in the file of what a piece has, ascending, with those within the piece.
fn placed(numbers: &[u32], of_piece: Range<u32>) -> Vec<(u32, usize)> {
    let own = of_piece.zip(0..).map(|(thing, own)| (numbers[thing as usize], own));
    let mut placed: Vec<_> = own.collect();
    placed.sort_unstable();
    placed
}

fn append(chunk: &mut Vec<u8>, symbols: &Runs, runs: Range<usize>) {
    for run in runs {
        let parts = symbols.get(run).bytes();
        parts.iter().for_each(|part| put_varint(chunk, part.len() as u64));
        parts.iter().for_each(|part| chunk.extend(*part));
    }
}

fn append_texels(chunk: &mut Vec<u8>, texels: &TexelRuns, block: usize, stream_count: usize) {
    for stream in block * stream_count..(block + 1) * stream_count {
        let bytes = texels.get(stream);
        put_varint(chunk, bytes.len() as u64);
        chunk.extend(bytes);
    }
}

/// The chunk of a piece.
fn chunk_of(chunks: &mut [(usize, Range<usize>)], piece: usize) -> Result<&mut Range<usize>> {
    let chunk = chunks.iter_mut().find(|(of_piece, _)| *of_piece == piece);
    chunk.map(|(_, chunk)| chunk).ok_or_else(|| Error::model("a piece is missing"))
}

/// Where the next runs of a chunk are: `N` sizes, then the runs themselves. The chunk then begins after them.
fn next<const N: usize>(bytes: &[u8], chunk: &mut Range<usize>) -> Result<[Range<usize>; N]> {
    let mut cursor = Cursor::new(&bytes[chunk.clone()]);
    let mut sizes = [0; N];
    for size in &mut sizes {
        *size = cursor.varint()? as usize;
    }
    chunk.start = chunk.end - cursor.left();
    let mut runs = [const { 0..0 }; N];
    for (run, size) in runs.iter_mut().zip(sizes) {
        cursor.bytes(size)?;
        *run = chunk.start..chunk.start + size;
        chunk.start = run.end;
    }
    Ok(runs)
}
