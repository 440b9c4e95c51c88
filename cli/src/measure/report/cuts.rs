//! The cost and the result of queries at run time.

use super::analysis::median;
use super::measure::{Distances, Reference};
use super::{Report, ReportError};
use crate::machine::thread_cpu_time;
use crate::progress::Progress;
use lodpack::decode::{decode_root, extract};
use lodpack::select::select_cut;
use lodpack::source::Counting;
use lodpack::{Cut, Error, Fetched, File, Index, Outside, Query, ReadAt};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Any source of bytes, with its requests counted.
pub type Source = Counting<Box<dyn ReadAt + Send + Sync>>;
/// The file that a report is about.
pub type Reader = File<Source>;
/// Opens the file anew, so that nothing has been read yet.
pub type Open<'a> = &'a dyn Fn() -> Result<Reader, Box<dyn std::error::Error + Send + Sync>>;

/// A query is repeated after each read; two or three rounds answer it.
const MAX_ROUNDS: usize = 64;
/// Budgets of triangles and bytes are the finest level's, divided by powers of this.
const BUDGET_STEP: u64 = 4;
const BUDGETS: u32 = 5;
/// Tolerances from one level to the next.
const STEPS_PER_FACTOR: f64 = 2.0;
const MAX_TOLERANCES: usize = 16;

/// A query, its cost and its result.
#[derive(Clone, Debug, Serialize)]
pub struct CutRow {
    /// What the query limits: `tolerance`, `triangles`, `bytes` or `region`.
    pub asked: &'static str,
    /// The limit: input units, triangles, bytes, or the share of the box's length along each axis.
    pub value: f64,
    /// Triangles of the result.
    pub triangles: u64,
    /// Vertices of the result.
    pub samples: u64,
    /// Nodes of the result.
    pub nodes: u64,
    /// Bytes read, opening included.
    pub bytes_read: u64,
    /// Requests, opening included.
    pub requests: u64,
    /// The fewest bytes that the result needs, without those read on opening.
    pub own_bytes: u64,
    /// Processor time to find the cut. Like all times, the median of the runs.
    pub select_seconds: f64,
    /// Elapsed time of reading, opening included.
    pub fetch_seconds: f64,
    /// Processor time to decode the nodes one by one, each with its whole border, as a viewer does that stitches on the
    /// GPU.
    pub decode_seconds: f64,
    /// Processor time to decode and stitch all nodes in one pass, with shared borders decoded once.
    pub extract_seconds: f64,
    /// Certified error of the result, in input units.
    pub certified: f64,
    /// Measured errors, if there is a mesh to measure against and the result shows all of it.
    pub measured: Option<Distances>,
}

/// The cost of showing anything at all.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FirstPicture {
    /// Size of the file.
    pub file_bytes: u64,
    /// Requests and bytes for opening.
    pub open: [u64; 2],
    /// The overview that comes with opening: triangles and certified error.
    pub overview: Option<(u64, f64)>,
    /// All roots at level 0: requests, bytes, triangles.
    pub coarsest: [u64; 3],
    /// Certified error of level 0.
    pub coarsest_error: f64,
}

/// Measures a file's first picture.
///
/// # Errors
/// [`ReportError::Open`], [`ReportError::Read`].
pub fn first_picture(open: Open) -> Result<FirstPicture, ReportError> {
    let file = open().map_err(ReportError::Open)?;
    let size =
        |source: &Source| source.size().map_err(|source| ReportError::Read(Error::Io { offset: 0, length: 0, source }));
    let mut picture = FirstPicture {
        file_bytes: size(file.source())?,
        open: [file.source().read_count(), file.source().byte_count()],
        overview: file.index().overview_summary().map(|(error, triangles)| (triangles, error)),
        ..FirstPicture::default()
    };
    let cut = file.uniform_cut(0)?;
    let drawn = file.extract(&cut)?;
    picture.coarsest = [file.source().read_count(), file.source().byte_count(), drawn.triangles.len() as u64];
    picture.coarsest_error = cut.error;
    Ok(picture)
}

/// Asks at tolerances from the coarsest level's error to the finest's, and with budgets, each `runs` times.
///
/// # Errors
///
/// [`ReportError::Open`], [`ReportError::Read`].
pub fn measure_cuts(
    open: Open,
    reference: Option<&Reference>,
    runs: u32,
    quick: bool,
    progress: &dyn Progress,
) -> Result<Vec<CutRow>, ReportError> {
    let queries = queries(&open().map_err(ReportError::Open)?, quick)?;
    progress.begin("queries", queries.len() as u64);
    let mut rows: Vec<CutRow> = vec![];
    for (asked, value, query) in queries {
        let mut timings = vec![];
        let mut answer = None;
        for _ in 0..runs.max(1) {
            let file = open().map_err(ReportError::Open)?;
            // A budget below the coarsest cut is refused, which is not the file's fault.
            match ask(&file, &query) {
                Ok((times, cut, mesh)) => {
                    timings.push(times);
                    answer = Some((file, cut, mesh));
                }
                Err(Error::Query { .. }) => break,
                Err(error) => return Err(error.into()),
            }
        }
        progress.advance(1);
        let Some((file, cut, mesh)) = answer else { continue };
        let triangles = mesh.triangles.len() as u64;
        // Measuring costs far more than the query.
        let nodes = cut.nodes.len() as u64;
        let is_same = |row: &&CutRow| (row.triangles, row.nodes, row.certified) == (triangles, nodes, cut.error);
        let same = rows.iter().find(is_same);
        let measured = match (same.and_then(|row| row.measured), reference) {
            (Some(measured), _) => Some(measured),
            (None, Some(reference)) if query.volume.is_none() => Some(reference.distances(&mesh)),
            _ => None,
        };
        let middle = |pick: fn(&Times) -> Duration| median(timings.iter().map(|times| pick(times).as_secs_f64()));
        let row = CutRow {
            asked,
            value,
            triangles,
            samples: mesh.positions.len() as u64,
            nodes,
            bytes_read: file.source().byte_count(),
            requests: file.source().read_count(),
            own_bytes: file.own_bytes(&cut)?,
            select_seconds: middle(|times| times.select),
            fetch_seconds: middle(|times| times.fetch),
            decode_seconds: middle(|times| times.decode),
            extract_seconds: middle(|times| times.extract),
            certified: cut.error,
            measured,
        };
        rows.push(row);
    }
    Ok(rows)
}

fn queries(file: &Reader, quick: bool) -> Result<Vec<(&'static str, f64, Query)>, ReportError> {
    let finest = file.select(&Query::default())?;
    let (coarsest_error, triangles) = (file.uniform_cut(0)?.error, finest.triangle_count);
    let bytes = file.own_bytes(&finest)?;
    let mut all = vec![];
    let mut tolerance = finest.error;
    while tolerance < coarsest_error * STEPS_PER_FACTOR && tolerance > 0.0 && all.len() < MAX_TOLERANCES {
        all.push(("tolerance", tolerance, Query { tolerance: Some(tolerance), ..Query::default() }));
        tolerance *= if quick { 4.0 * STEPS_PER_FACTOR } else { STEPS_PER_FACTOR };
    }
    for k in if quick { 1..2 } else { 0..BUDGETS } {
        let part = BUDGET_STEP.pow(k);
        let (most_triangles, most_bytes) = (triangles / part, bytes / part);
        all.push((
            "triangles",
            most_triangles as f64,
            Query { max_triangles: Some(most_triangles), ..Query::default() },
        ));
        all.push(("bytes", most_bytes as f64, Query { max_bytes: Some(most_bytes), ..Query::default() }));
    }
    if let Some([low, high]) = file.bounds() {
        // The middle of the box, with half and a quarter of its length along each axis.
        for share in [0.5, 0.25] {
            let middle = [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0);
            let reach = [0, 1, 2].map(|k| (high[k] - low[k]) / 2.0 * share);
            let region = [[0, 1, 2].map(|k| middle[k] - reach[k]), [0, 1, 2].map(|k| middle[k] + reach[k])];
            let query = Query { volume: Some(region.into()), outside: Outside::Drop, ..Query::default() };
            all.push(("region", share, query));
        }
    }
    Ok(all)
}

/// Times of the steps of a query.
#[derive(Default)]
struct Times {
    select: Duration,
    fetch: Duration,
    decode: Duration,
    extract: Duration,
}

fn ask(file: &Reader, query: &Query) -> lodpack::Result<(Times, Cut, lodpack::Mesh)> {
    let mut times = Times::default();
    let mut fetched = file.index().fetched();
    let cut = step(file, &mut fetched, [&mut times.select, &mut times.fetch], |index, _| select_cut(index, query))?;
    // Extraction asks for exactly the bytes that a cut reads.
    let mesh = step(file, &mut fetched, [&mut times.extract, &mut times.fetch], |index, fetched| {
        extract(index, &cut, fetched)
    })?;
    for node in &cut.nodes {
        let patch = |index: &Index, fetched: &Fetched| {
            decode_root(index, node.root, node.level, fetched).map(std::hint::black_box)
        };
        step(file, &mut fetched, [&mut times.decode, &mut times.fetch], patch)?;
    }
    Ok((times, cut, mesh))
}

/// Repeats a query until nothing is missing. Adds the processor time of the final answer (without the rounds before it)
/// to the first time, and the elapsed time of reading to the second.
fn step<T>(
    file: &Reader,
    fetched: &mut Fetched,
    [work, fetch]: [&mut Duration; 2],
    question: impl Fn(&Index, &Fetched) -> lodpack::Result<T>,
) -> lodpack::Result<T> {
    for _ in 0..MAX_ROUNDS {
        let start = thread_cpu_time();
        match question(file.index(), fetched) {
            Err(Error::Missing { ranges }) => {
                let start = Instant::now();
                for range in ranges {
                    let length = range.end - range.start;
                    // The lengths come from checked records.
                    let mut bytes = vec![0; length as usize];
                    let read = file.source().read_at(range.start, &mut bytes);
                    read.map_err(|source| Error::Io { offset: range.start, length, source })?;
                    fetched.insert(range.start, bytes);
                }
                file.index().supply(fetched);
                *fetch += start.elapsed();
            }
            answer => {
                *work += thread_cpu_time() - start;
                return answer;
            }
        }
    }
    Err(Error::Query { what: "the bytes read do not help to answer the query".into() })
}

impl Report {
    /// Queries of everything at a tolerance, finest first.
    pub(crate) fn tolerance_cuts(&self) -> impl Iterator<Item = &CutRow> {
        self.cuts.iter().filter(|row| row.asked == "tolerance")
    }
}
