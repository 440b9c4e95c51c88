//! An open file: an index, and a source from which it reads what an answer needs.

mod objects;

use std::{ops::Range, sync::Arc};

pub use objects::FileObjects;

#[cfg(feature = "threads")]
use crate::stream::{Streamer, StreamerOptions, Walk};
use crate::{
    decode::{self, Borders, Mesh, Overview, RootPatch, TexturedMesh},
    error::{Error, Result},
    format::{
        index_block::{ClusterIndex, RootEntry},
        records::SourceInfo,
    },
    index::{
        ChannelInfo, FileSummary, Index, LevelSummary, Opener, Placement, RootContents, Scale, TexelBytes,
        opener::FIRST_READ_BYTES,
    },
    lattice::Lattice,
    limits::Limits,
    select::{self, Cut, Hierarchy, Query, SMALL_INDEX_BYTES},
    source::{Fetched, ReadAt, read_ranges},
    stream::{Options, Session},
};

/// An open lodpack file: its [`Index`], and a source from which it reads what an answer needs.
///
/// Opening reads the resident part of the index. Every later call reads the index blocks and pages that it needs, and
/// keeps the index blocks. A `File` can be shared between threads if its source can.
#[derive(Debug)]
pub struct File<S> {
    source: S,
    index: Arc<Index>,
}

impl<S: ReadAt> File<S> {
    /// Opens a file: one request of 8 KiB for a small one, a second one for the rest of a larger one's resident index.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] if it is damaged or not whole, [`Error::Unsupported`] if it needs a newer
    /// reader, [`Error::Limit`].
    pub fn open(source: S, limits: Limits) -> Result<Self> {
        Self::open_with(source, Opener::new(limits))
    }

    /// Opens the beginning of a file, which may end anywhere after the pages of level 0: a complete coarser model.
    ///
    /// # Errors
    /// As [`File::open`].
    pub fn open_prefix(source: S, limits: Limits) -> Result<Self> {
        Self::open_with(source, Opener::new(limits).accept_prefix())
    }

    fn open_with(source: S, mut opener: Opener) -> Result<Self> {
        let io = |source| Error::Io { offset: 0, length: FIRST_READ_BYTES, source };
        let (head, size) = source.read_start(FIRST_READ_BYTES as usize).map_err(io)?;
        opener.start(head, size);
        loop {
            match opener.finish() {
                Err(Error::Missing { ranges }) => {
                    read_ranges(&source, &ranges)?.into_iter().for_each(|(at, bytes)| opener.insert(at, bytes));
                }
                other => return Ok(Self { source, index: Arc::new(other?) }),
            }
        }
    }

    /// A file whose index is known; `source` has its bytes.
    pub fn of(index: Arc<Index>, source: S) -> Self {
        Self { source, index }
    }

    /// The source that the file is read from.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// The file's index, which answers without reading. It may outlive the file.
    pub fn index(&self) -> &Arc<Index> {
        &self.index
    }

    /// Where the lattice of coordinates lies.
    pub fn lattice(&self) -> Lattice {
        self.index.lattice()
    }

    /// World box around everything; `None` for a file without roots.
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        self.index.bounds()
    }

    /// Number of roots.
    pub fn root_count(&self) -> u32 {
        self.index.root_count()
    }

    /// How many levels can be drawn: all, or those that a prefix holds.
    pub fn level_count(&self) -> usize {
        self.index.level_count()
    }

    /// What the file says about a level; 0 is the coarsest.
    pub fn level(&self, level: usize) -> Option<LevelSummary> {
        self.index.level(level)
    }

    /// What the file was made from, if it says so.
    pub fn source_info(&self) -> Option<&SourceInfo> {
        self.index.source_info()
    }

    /// What the surface carries besides positions: see [`Index::channels`].
    pub fn channels(&self) -> &[ChannelInfo] {
        self.index.channels()
    }

    /// Where the surface is in the world, if the file says so.
    pub fn placement(&self) -> Option<&Placement> {
        self.index.placement()
    }

    /// One small mesh of the whole surface, if the file has one. It came with opening; nothing is read.
    ///
    /// # Errors
    /// [`Error::Format`], [`Error::Limit`].
    pub fn overview(&self) -> Result<Option<Overview>> {
        decode::overview(&self.index)
    }

    /// Finds the cut for a query, from the index alone.
    ///
    /// # Errors
    /// As [`select::select_cut`]; [`Error::Io`].
    pub fn select(&self, query: &Query) -> Result<Cut> {
        self.ask(|index, _| select::select_cut(index, query))
    }

    /// The cut that draws every root at `level`, or at the next coarser one that it has.
    ///
    /// # Errors
    /// As [`select::uniform_cut`]; [`Error::Io`].
    pub fn uniform_cut(&self, level: u8) -> Result<Cut> {
        self.ask(|index, _| select::uniform_cut(index, level))
    }

    /// Everything that there is to choose from, for a [`select::Adapter`]. Reads the whole index.
    ///
    /// # Errors
    /// As [`Hierarchy::from_index`]; [`Error::Io`].
    pub fn hierarchy(&self) -> Result<Hierarchy> {
        self.ask(|index, _| Hierarchy::from_index(index))
    }

    /// The part of the file that a query has to choose from: see [`Hierarchy::for_query`].
    ///
    /// # Errors
    /// As [`select::select_cut`]; [`Error::Io`].
    pub fn hierarchy_for(&self, query: &Query) -> Result<Arc<Hierarchy>> {
        self.ask(|index, _| Hierarchy::for_query(index, query))
    }

    /// Reads, decodes and joins the triangles of a cut. The result is watertight where the whole surface is: every edge
    /// has as many triangles as in the model.
    ///
    /// # Errors
    /// As [`decode::extract`]; [`Error::Io`].
    pub fn extract(&self, cut: &Cut) -> Result<Mesh> {
        self.ask(|index, fetched| decode::extract(index, cut, fetched))
    }

    /// As [`File::extract`], with the images of some channels, by number.
    ///
    /// # Errors
    /// As [`decode::extract_textured`]; [`Error::Io`].
    pub fn extract_textured(&self, cut: &Cut, channels: &[u8]) -> Result<TexturedMesh> {
        self.ask(|index, fetched| decode::extract_textured(index, cut, channels, fetched))
    }

    /// As [`File::extract_textured`], with images of a part of their texels along each side, for whom these are enough.
    /// Of images in scales only that part is read.
    ///
    /// # Errors
    /// As [`File::extract_textured`].
    pub fn extract_textured_scaled(&self, cut: &Cut, channels: &[u8], scale: Scale) -> Result<TexturedMesh> {
        self.ask(|index, fetched| decode::extract_textured_scaled(index, cut, channels, scale, fetched))
    }

    /// [`File::extract_textured`] with borders at a finer level: see [`decode::extract_textured_with_borders`].
    ///
    /// # Errors
    /// As [`File::extract_textured`].
    pub fn extract_textured_with_borders(&self, cut: &Cut, border_level: u8, channels: &[u8]) -> Result<TexturedMesh> {
        self.ask(|index, fetched| decode::extract_textured_with_borders(index, cut, border_level, channels, fetched))
    }

    /// [`File::extract`] with borders at a finer level, for pieces that are drawn apart: see
    /// [`decode::extract_with_borders`].
    ///
    /// # Errors
    /// As [`File::extract`].
    pub fn extract_with_borders(&self, cut: &Cut, border_level: u8) -> Result<Mesh> {
        self.ask(|index, fetched| decode::extract_with_borders(index, cut, border_level, fetched))
    }

    /// Decodes one root at a level, or at the next coarser one that it has.
    ///
    /// # Errors
    /// As [`File::extract`].
    pub fn decode_root(&self, root: u32, level: u8) -> Result<RootPatch> {
        self.ask(|index, fetched| decode::decode_root(index, root, level, fetched))
    }

    /// Reads the texels of some roots, each at a level or at the next coarser one that it has, in this order: the maps,
    /// and the images of some channels at a scale.
    ///
    /// # Errors
    /// As [`Index::texels`]; [`Error::Io`].
    pub fn texels(&self, wanted: &[(u32, u8)], channels: &[u8], scale: Scale) -> Result<Vec<TexelBytes>> {
        self.ask(|index, fetched| index.texels(wanted, channels, scale, fetched))
    }

    /// How many bytes of index blocks and pages a cut needs: see [`decode::own_bytes`].
    ///
    /// # Errors
    /// As [`decode::own_bytes`]; [`Error::Io`].
    pub fn own_bytes(&self, cut: &Cut) -> Result<u64> {
        self.ask(|index, _| decode::own_bytes(index, cut))
    }

    /// How many boundary edges the mesh of a cut has: see [`select::boundary_edge_count`].
    ///
    /// # Errors
    /// As [`File::select`].
    pub fn boundary_edge_count(&self, cut: &Cut) -> Result<u64> {
        self.ask(|index, _| select::boundary_edge_count(index, cut))
    }

    /// World box around everything that a root draws and around the piece of input that it stands for.
    ///
    /// # Errors
    /// [`Error::Query`] if there is no such root; [`Error::Io`], [`Error::Format`].
    pub fn root_bounds(&self, root: u32) -> Result<[[f64; 3]; 2]> {
        self.ask(|index, _| index.root_bounds(root))
    }

    /// What the index says about a root.
    ///
    /// # Errors
    /// [`Error::Query`] if there is no such root; [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn root_contents(&self, root: u32) -> Result<RootContents> {
        self.ask(|index, _| index.root_contents(root))
    }

    /// Number of roots that are nobody's children: see [`Index::top_count`].
    pub fn top_count(&self) -> u32 {
        self.index.top_count()
    }

    /// The children of a root, which follow each other.
    ///
    /// # Errors
    /// [`Error::Query`] if there is no such root; [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn children(&self, root: u32) -> Result<Range<u32>> {
        self.ask(|index, _| index.children(root))
    }

    /// The root that a root is a child of, if there is one.
    ///
    /// # Errors
    /// As [`File::children`].
    pub fn parent(&self, root: u32) -> Result<Option<u32>> {
        self.ask(|index, _| index.parent(root))
    }

    /// Reads all corners and arcs, with the samples of every level that the file holds.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn borders(&self) -> Result<Borders> {
        self.ask(decode::borders)
    }

    /// Reads the whole index, but no page, and adds it up.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn summary(&self) -> Result<FileSummary> {
        self.ask(|index, _| index.summary())
    }

    /// A session that draws this file frame by frame while it is being loaded. Reads the index blocks of the tops, or
    /// all of a small index, and, of a file without an overview, the coarsest level, which is small then: so the first
    /// frame has a surface. The session's jobs read all else, of the index too.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn session(&self, options: Options) -> Result<Session> {
        if self.index.index_bytes() <= SMALL_INDEX_BYTES {
            self.load_indices(0..self.index.cluster_count())?;
        }
        let session = self.ask(|_, _| Session::new(Arc::clone(&self.index), options))?;
        if session.overview().is_none() {
            session.load_coarsest(&self.source);
        }
        Ok(session)
    }

    /// Starts threads that load this file for a moving camera. Reads the index if it is small. Of a larger one it reads
    /// the tops, and a thread reads what queries want further.
    ///
    /// # Errors
    /// As [`File::session`].
    #[cfg(feature = "threads")]
    pub fn streamer(&self, options: StreamerOptions) -> Result<Streamer>
    where
        S: Clone + Send + Sync + 'static,
    {
        let session = self.session(options.session)?;
        let source = Arc::new(self.source.clone());
        if self.index.index_bytes() <= SMALL_INDEX_BYTES {
            return Ok(Streamer::new(session, self.hierarchy()?, source, options));
        }
        // Nothing is finer than its tops.
        let tops = self.hierarchy_for(&Query { tolerance: Some(f64::MAX), ..Query::default() })?;
        let file = File { source: Arc::clone(&source), index: Arc::clone(&self.index) };
        let walk: Box<Walk> = Box::new(move |query| file.hierarchy_for(query));
        Ok(Streamer::new(session, (*tops).clone(), source, options).with_walk(walk, options.coherence))
    }

    /// Asks the index until it has an answer, and reads what it lacks.
    pub(crate) fn ask<T>(&self, mut question: impl FnMut(&Index, &Fetched) -> Result<T>) -> Result<T> {
        let mut fetched = self.index.fetched();
        loop {
            match question(&self.index, &fetched) {
                Err(Error::Missing { ranges }) => {
                    if ranges.iter().all(|range| fetched.get(range.clone()).is_some()) {
                        return Err(Error::format("the file asks for the same bytes again"));
                    }
                    read_ranges(&self.source, &ranges)?.into_iter().for_each(|(at, bytes)| fetched.insert(at, bytes));
                    self.index.supply(&fetched);
                }
                answer => return answer,
            }
        }
    }

    /// Reads all lists of clusters, as far as they are not there yet.
    pub(crate) fn load_lists(&self) -> Result<()> {
        self.ask(|index, _| index.clusters().map(drop))
    }

    /// Reads the index blocks of these clusters, as far as they are not there yet.
    pub(crate) fn load_indices(&self, clusters: impl IntoIterator<Item = u32>) -> Result<()> {
        let clusters: Vec<u32> = clusters.into_iter().collect();
        self.ask(|index, _| index.load_indices(clusters.iter().copied()))
    }

    /// The index block of a cluster.
    pub(crate) fn cluster_index(&self, cluster: u32) -> Result<&ClusterIndex> {
        // This comes first because `ask` copies the bytes that came with opening.
        match self.index.cluster_index(cluster) {
            Err(Error::Missing { .. }) => self.load_indices([cluster])?,
            answer => return answer,
        }
        self.index.cluster_index(cluster)
    }

    /// What the index says about a root; it has to exist.
    pub(crate) fn root_entry(&self, root: u32) -> Result<&RootEntry> {
        match self.index.root_entry(root) {
            Err(Error::Missing { .. }) => self.ask(|index, _| index.root_entry(root).map(drop))?,
            answer => return answer,
        }
        self.index.root_entry(root)
    }

    /// Reads a run of the file's bytes.
    pub(crate) fn read(&self, offset: u64, length: u64) -> Result<Vec<u8>> {
        let range = offset..offset.saturating_add(length);
        self.ask(|_, fetched| match fetched.get(range.clone()) {
            Some(bytes) => Ok(bytes.to_vec()),
            None => Err(Error::Missing { ranges: vec![fetched.rest_of(range.clone())] }),
        })
    }
}
