//! The file, the questions and the streams of an instance.

use std::sync::Arc;

use lodpack::{
    Cut, Error, Fetched, Index, Limits, Mesh, Node, Opener, decode,
    heights::HeightsIndex,
    index::{Placement, SourceInfo, UpAxis},
    select,
    stream::{Lit, Options},
};

use crate::{
    answer::{Answer, Put, floats, put_mesh, put_normals, words, wrong},
    query,
    stream::Stream,
};

/// Everything that an instance knows.
#[derive(Default)]
pub struct State {
    /// What JavaScript has written.
    pub input: Vec<u8>,
    /// What JavaScript will read.
    pub output: Vec<u8>,
    opener: Option<Opener>,
    opened: Option<Opened>,
    pub(crate) questions: Table<Fetched>,
    streams: Table<Stream>,
    /// What is drawn of objects.
    #[cfg(feature = "channels")]
    pub(crate) filters: Table<Arc<lodpack::objects::ObjectFilter>>,
}

/// What has this needs the feature `heights`. Without the feature nothing has it, and compilers leave out all code for
/// what nothing has.
#[derive(Clone, Copy, Debug)]
pub(crate) enum HasHeights {
    #[cfg(feature = "heights")]
    Yes,
}

/// What is open.
#[cfg_attr(not(feature = "heights"), expect(dead_code, reason = "a module without heights opens none"))]
enum Opened {
    Mesh(Arc<Index>),
    Heights(Arc<HeightsIndex>, HasHeights),
}

impl Opened {
    #[cfg(feature = "heights")]
    fn new(opener: &Opener) -> Result<Self, Error> {
        Ok(match lodpack::OpenedIndex::new(opener)? {
            lodpack::OpenedIndex::Mesh(index) => Self::Mesh(index),
            lodpack::OpenedIndex::Heights(index) => Self::Heights(index, HasHeights::Yes),
        })
    }

    #[cfg(not(feature = "heights"))]
    fn new(opener: &Opener) -> Result<Self, Error> {
        opener.finish().map(|index| Self::Mesh(Arc::new(index)))
    }
}

/// Things with numbers, from 1.
pub(crate) struct Table<T> {
    next: u32,
    /// There are few at a time.
    entries: Vec<(u32, T)>,
}

impl<T> Default for Table<T> {
    fn default() -> Self {
        Self { next: 1, entries: Vec::new() }
    }
}

impl<T> Table<T> {
    pub fn add(&mut self, entry: T) -> u32 {
        let number = self.next;
        self.next += 1;
        self.entries.push((number, entry));
        number
    }

    pub fn get(&mut self, number: u32) -> Result<&mut T, Error> {
        let entry = self.entries.iter_mut().find(|(of, _)| *of == number);
        entry.map(|(_, entry)| entry).ok_or_else(|| wrong("it has been closed"))
    }

    pub fn close(&mut self, number: u32) {
        self.entries.retain(|(of, _)| *of != number);
    }
}

impl State {
    /// The index of an open mesh.
    pub(crate) fn index(&self) -> Result<&Arc<Index>, Error> {
        match &self.opened {
            Some(Opened::Mesh(index)) => Ok(index),
            Some(Opened::Heights(..)) => {
                Err(wrong("this file holds a grid of heights, which has neither levels nor channels"))
            }
            None => Err(wrong("no file is open")),
        }
    }

    /// The index of an open file of heights.
    pub(crate) fn heights_index(&self) -> Result<&Arc<HeightsIndex>, Error> {
        match &self.opened {
            Some(Opened::Heights(index, _)) => Ok(index),
            _ => Err(wrong("no file of heights is open")),
        }
    }

    fn has_heights(&self) -> bool {
        matches!(self.opened, Some(Opened::Heights(..)))
    }

    /// Begins to open a file of this size with its first bytes, the input.
    pub fn start(&mut self, size: f64, part_bytes: f64) -> Answer {
        let limits = Limits { part_bytes: part_bytes as u64, ..Limits::default() };
        let mut opener = Opener::new(limits);
        opener.start(std::mem::take(&mut self.input), size as u64);
        self.opener = Some(opener);
        Ok(0)
    }

    /// Takes bytes that opening lacks.
    pub fn insert(&mut self, offset: f64) -> Answer {
        let opener = self.opener.as_mut().ok_or_else(|| wrong("the file is open already"))?;
        opener.insert(offset as u64, std::mem::take(&mut self.input));
        Ok(0)
    }

    /// Opens the file.
    pub fn finish(&mut self) -> Answer {
        let opener = self.opener.as_ref().ok_or_else(|| wrong("the file is open already"))?;
        self.opened = Some(Opened::new(opener)?);
        self.opener = None;
        Ok(0)
    }

    /// What the index says at once: `js/core.js` reads it. Returns whether it is of heights.
    pub fn info(&mut self) -> Answer {
        if self.has_heights() {
            return self.info_of_heights();
        }
        let index = self.index()?.clone();
        let (lattice, (major, minor)) = (index.lattice(), index.version());
        let [low, high] = index.bounds().unwrap_or([[f64::NAN; 3]; 2]);
        let (overview_error, overview_triangles) = index.overview_summary().unwrap_or((f64::NAN, 0));
        let source = index.source_info();
        let [first, second] = index.id().numbers();
        let counts =
            [index.root_count(), index.top_count(), index.level_count() as u32, first, second, up(index.placement())]
                .map(f64::from);
        self.output.put_floats([f64::from(major), f64::from(minor)].into_iter().chain(counts));
        self.output.put_floats(low.into_iter().chain(high).chain(lattice.origin).chain([lattice.step()]));
        self.output.put_floats([overview_error, overview_triangles as f64]);
        self.output.put_floats(numbers_of(source));
        for level in (0..index.level_count()).filter_map(|level| index.level(level)) {
            let counts = [level.triangle_count as f64, level.page_bytes as f64];
            self.output.put_floats([level.tolerance, level.max_error].into_iter().chain(counts));
        }
        self.output.extend(source.map_or("", |source| &source.generator).bytes());
        Ok(0)
    }

    /// The same of heights, which have no levels; tiles that are known stand for roots.
    fn info_of_heights(&mut self) -> Answer {
        let index = Arc::clone(self.heights_index()?);
        let ((major, minor), source) = (index.version(), index.source_info());
        let [low, high] = index.bounds().unwrap_or([[f64::NAN; 3]; 2]);
        let [first, second] = index.id().numbers().map(f64::from);
        let counts = [
            index.known_tile_count() as f64,
            index.roots().len() as f64,
            0.0,
            first,
            second,
            up(index.placement()).into(),
        ];
        self.output.put_floats([f64::from(major), f64::from(minor)].into_iter().chain(counts));
        self.output.put_floats(low.into_iter().chain(high).chain([0.0, 0.0, 0.0, 1.0]));
        self.output.put_floats([f64::NAN, 0.0].into_iter().chain(numbers_of(source)));
        self.output.extend(source.map_or("", |source| &source.generator).bytes());
        Ok(1)
    }

    /// The overview's mesh, and the normals of its vertices, if it is to have light. Returns whether there is one.
    pub fn overview(&mut self, has_light: bool) -> Answer {
        if self.has_heights() {
            return Ok(0);
        }
        let index = self.index()?;
        let Some(overview) = decode::overview(index)? else { return Ok(0) };
        let mesh = overview.mesh(&index.lattice());
        let Lit { positions, triangles, normals } = if has_light { Lit::of(&mesh) } else { Lit::default() };
        put_mesh(&mut self.output, &if has_light { Mesh { positions, triangles, ..mesh } } else { mesh });
        put_normals(&mut self.output, &normals);
        Ok(1)
    }

    /// A new question: the bytes that were fetched for it stay until it is closed.
    pub fn ask(&mut self) -> Answer {
        let fetched = if self.has_heights() { Fetched::default() } else { self.index()?.fetched() };
        Ok(self.questions.add(fetched))
    }

    /// Takes bytes that a question lacks.
    pub fn tell(&mut self, question: u32, offset: f64) -> Answer {
        let bytes = std::mem::take(&mut self.input);
        self.questions.get(question)?.insert(offset as u64, bytes);
        Ok(0)
    }

    /// Keeps the index blocks among the bytes of a question.
    pub fn supply(&mut self, question: u32) -> Answer {
        if self.has_heights() {
            // Questions about heights look at them themselves.
            return Ok(0);
        }
        let index = self.index()?.clone();
        index.supply(self.questions.get(question)?);
        Ok(0)
    }

    /// Closes a question.
    pub fn close_question(&mut self, question: u32) -> Answer {
        self.questions.close(question);
        Ok(0)
    }

    /// The cut of the query in the input.
    pub fn select(&mut self, question: u32) -> Answer {
        let query = query::unpack(floats(&self.input))?;
        if self.has_heights() {
            return self.select_heights(question, &query);
        }
        let cut = select::select_cut(self.index()?, &query)?;
        self.put_cut(&cut)
    }

    /// The cut that draws everything at a level.
    pub fn uniform_cut(&mut self, level: u32) -> Answer {
        let level = u8::try_from(level).map_err(|_| wrong("a level does not exist"))?;
        let cut = select::uniform_cut(self.index()?, level)?;
        self.put_cut(&cut)
    }

    fn put_cut(&mut self, cut: &Cut) -> Answer {
        let number = |count: u64| count as f64;
        let summary = [cut.error, cut.pixel_error, number(cut.triangle_count), number(cut.byte_count)];
        self.output.put_floats(summary.into_iter().chain([f64::from(limiter(cut.limited_by))]));
        self.output.put_floats(cut.node_errors.iter().copied());
        self.output.put_words(cut.nodes.iter().flat_map(|node| [node.root, u32::from(node.level)]));
        Ok(cut.nodes.len() as u32)
    }

    /// The cut whose nodes, pairs of root and level, are in the input from a place on.
    pub(crate) fn cut(&self, from: usize) -> Result<Cut, Error> {
        let (pairs, rest) = self.input.get(from..).unwrap_or_default().as_chunks::<8>();
        let node = |pair: &[u8; 8]| {
            let mut numbers = words(pair);
            let (root, level) = (numbers.next().unwrap_or(u32::MAX), numbers.next().unwrap_or(u32::MAX));
            // No file has that many levels, so this one does not exist.
            Node { root, level: u8::try_from(level).unwrap_or(u8::MAX) }
        };
        if rest.is_empty() {
            Ok(Cut { nodes: pairs.iter().map(node).collect(), ..Cut::default() })
        } else {
            Err(wrong("a cut has a root and a level for each node"))
        }
    }

    /// The mesh of the cut in the input.
    pub fn extract(&mut self, question: u32) -> Answer {
        if self.has_heights() {
            return self.extract_heights(question);
        }
        let cut = self.cut(0)?;
        let index = self.index()?.clone();
        let mesh = decode::extract(&index, &cut, self.questions.get(question)?)?;
        put_mesh(&mut self.output, &mesh);
        Ok(0)
    }

    /// How many boundary edges the mesh of the cut in the input has.
    pub fn boundary_edge_count(&mut self) -> Answer {
        let count = select::boundary_edge_count(self.index()?, &self.cut(0)?)?;
        self.output.put_floats([count as f64]);
        Ok(0)
    }

    /// A stream, with the sizes of its caches and the point that its positions are relative to. Needs the whole index.
    pub fn open_stream(&mut self, options: Options, ahead_ms: f64, origin: [f64; 3]) -> Answer {
        let stream = match &self.opened {
            Some(Opened::Heights(index, has)) => Stream::of_heights((index, *has), options, ahead_ms, origin)?,
            _ => Stream::new(self.index()?, options, ahead_ms, origin)?,
        };
        Ok(self.streams.add(stream))
    }

    /// A stream, with input and output.
    pub fn stream(&mut self, stream: u32) -> Result<(&mut Stream, &mut Vec<u8>, &mut Vec<u8>), Error> {
        Ok((self.streams.get(stream)?, &mut self.input, &mut self.output))
    }

    /// Closes a stream.
    pub fn close_stream(&mut self, stream: u32) -> Answer {
        self.streams.close(stream);
        Ok(0)
    }
}

/// What a file says about its source, as far as it says anything.
fn numbers_of(source: Option<&SourceInfo>) -> [f64; 4] {
    source.map_or([f64::NAN; 4], |source| {
        [source.triangle_count as f64, source.vertex_count as f64, source.mean_edge_length, source.area]
    })
}

/// The number of the axis that a file says is up; 0 if it says none.
fn up(placement: Option<&Placement>) -> u32 {
    match placement.map(|placement| placement.up) {
        Some(UpAxis::Y) => 1,
        Some(UpAxis::Z) => 2,
        _ => 0,
    }
}

/// A limiter's number in `js/core.js`; 0 is none.
pub fn limiter(limiter: lodpack::Limiter) -> u32 {
    use lodpack::Limiter::{Bytes, Finest, Nodes, Tolerance, Triangles};
    match limiter {
        Tolerance => 1,
        Finest => 2,
        Triangles => 3,
        Nodes => 4,
        Bytes => 5,
        _ => 0,
    }
}
