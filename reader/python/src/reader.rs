//! An open file, and its answers.

use crate::{
    array::Array,
    error::{exception, raise},
    ground::{NativeFrame, OfFile},
    heights::HeightsReader,
    interrupt::interruptible,
    objects::NativeObjects,
    source::{Bytes, Object, Source},
    textured::Textured,
};
use lodpack::{
    Cut, Error, File, Ground, Limits, Mesh, Opened, Opener, Outside, Query, ReadAt,
    index::Ray,
    objects::ObjectChoice,
    source::{Counting, Within},
};
use pyo3::{
    Bound, Py, PyAny, PyErr, PyResult, Python,
    exceptions::{PyIsADirectoryError, PyOSError},
    pybacked::PyBackedBytes,
    pyclass, pyfunction, pymethods,
    types::{PyAnyMethods, PyDict, PyDictMethods, PyList, PyListMethods},
};
use std::{path::PathBuf, sync::Arc, time::Duration};

/// A mesh of more triangles is extracted so that Ctrl-C is heard: it takes more than some hundredths of a second.
const SLOW_TRIANGLES: u64 = 100_000;

/// A point as a tuple.
pub type Point = (f64, f64, f64);

/// What a ray meets.
type Picked = (Option<u32>, Point, f64, f64, u32);

/// An open file.
#[pyclass(frozen, module = "lodpack._lodpack")]
pub struct Reader {
    file: Arc<File<Counting<Source>>>,
    name: Arc<str>,
    /// Whether every read may take long.
    is_slow: bool,
}

/// An open file of either kind.
#[derive(pyo3::IntoPyObject)]
pub enum AnyReader {
    Mesh(Reader),
    Heights(HeightsReader),
}

/// A cut of an open file.
#[pyclass(frozen, name = "Cut", module = "lodpack._lodpack")]
pub struct NativeCut(Arc<Cut>);

/// Opens a file on disk.
#[pyfunction]
#[pyo3(signature = (path, limits=None))]
pub fn open_path(py: Python<'_>, path: PathBuf, limits: Option<&Bound<'_, PyDict>>) -> PyResult<AnyReader> {
    let name = path.display().to_string();
    let opened = match std::fs::File::open(&path) {
        Ok(file) => Reader::open(py, Box::new(file), name.clone(), false, limits),
        Err(error) => Err(match error.raw_os_error() {
            // Python makes a FileNotFoundError of it, and so on.
            Some(number) => {
                let reason = error.to_string();
                let reason = reason.split(" (os error").next().unwrap_or_default().to_owned();
                PyOSError::new_err((number, reason, path.clone().into_os_string()))
            }
            None => error.into(),
        }),
    };
    // A directory can be opened on some systems, and read on none.
    match opened {
        Err(_) if path.is_dir() => {
            Err(PyIsADirectoryError::new_err(format!("{name} is a directory; name a .lodpack file")))
        }
        opened => opened,
    }
}

/// Opens a file on a web server.
#[pyfunction]
#[pyo3(signature = (url, timeout, limits=None))]
pub fn open_url(
    py: Python<'_>,
    url: &str,
    timeout: Duration,
    limits: Option<&Bound<'_, PyDict>>,
) -> PyResult<AnyReader> {
    let options = lodpack::source::HttpOptions { timeout, ..Default::default() };
    Reader::open(py, Box::new(lodpack::source::Http::new(url, options)), url.to_owned(), true, limits)
}

/// Opens a file in memory.
#[pyfunction]
#[pyo3(signature = (bytes, name, limits=None))]
pub fn open_bytes(
    py: Python<'_>,
    bytes: PyBackedBytes,
    name: String,
    limits: Option<&Bound<'_, PyDict>>,
) -> PyResult<AnyReader> {
    Reader::open(py, Box::new(Bytes(bytes)), name, false, limits)
}

/// Opens a file that a Python object reads.
#[pyfunction]
#[pyo3(signature = (source, name, limits=None))]
pub fn open_object(
    py: Python<'_>,
    source: Py<PyAny>,
    name: String,
    limits: Option<&Bound<'_, PyDict>>,
) -> PyResult<AnyReader> {
    Reader::open(py, Box::new(Object(source)), name, true, limits)
}

impl Reader {
    fn open(
        py: Python<'_>,
        source: Source,
        name: String,
        is_slow: bool,
        limits: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<AnyReader> {
        let limits = limits.map_or(Ok(Limits::default()), read_limits)?;
        let source: Arc<dyn ReadAt + Send + Sync> = Arc::from(source);
        let opened: Source = Box::new(Arc::clone(&source));
        let opened = run(py, is_slow, move || Opened::open(Counting::new(opened), limits))?;
        match opened {
            Ok(Opened::Mesh(file)) => Ok(AnyReader::Mesh(Self { file: Arc::new(file), name: name.into(), is_slow })),
            Ok(Opened::Heights(file)) => {
                Ok(AnyReader::Heights(HeightsReader { file: Arc::new(file), name: name.into() }))
            }
            Err(error @ Error::Format { .. }) => {
                // Most of these were never lodpack files. What can no longer be read has no known beginning.
                let start = run(py, is_slow, move || source.read_start(Opener::MAGIC.len()).unwrap_or_default().0)?;
                match start.is_empty() || start.starts_with(&Opener::MAGIC[..4]) {
                    true => Err(exception(py, &name, error)),
                    false => {
                        Err(raise(py, "FormatError", format!("{name} is not a lodpack file: its first bytes differ")))
                    }
                }
            }
            Err(error) => Err(exception(py, &name, error)),
        }
    }

    /// Asks the file without holding Python up.
    fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        is_slow: bool,
        question: impl FnOnce(&File<Counting<Source>>) -> lodpack::Result<T> + Send + 'static,
    ) -> PyResult<T> {
        let file = Arc::clone(&self.file);
        run(py, is_slow, move || question(&file))?.map_err(|error| exception(py, &self.name, error))
    }
}

/// Does some work while other threads of Python go on; if it may take long, so that signals are heard.
pub fn run<T: Send + 'static>(py: Python<'_>, is_slow: bool, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    if is_slow { interruptible(py, work) } else { Ok(py.detach(work)) }
}

fn read_limits(given: &Bound<'_, PyDict>) -> PyResult<Limits> {
    let mut limits = Limits::default();
    for (name, value) in given {
        let name: String = name.extract()?;
        let field = match name.as_str() {
            "root_count" => &mut limits.root_count,
            "root_vertex_count" => &mut limits.root_vertex_count,
            "cluster_record_count" => &mut limits.cluster_record_count,
            "part_bytes" => &mut limits.part_bytes,
            "texel_count" => &mut limits.texel_count,
            _ => {
                let names = "root_count, root_vertex_count, cluster_record_count, part_bytes, texel_count";
                return Err(raise(
                    given.py(),
                    "QueryError",
                    format!("there is no limit {name:?}; the limits are {names}"),
                ));
            }
        };
        *field = value.extract()?;
    }
    Ok(limits)
}

#[pymethods]
impl Reader {
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn bytes_read(&self) -> u64 {
        self.file.source().byte_count()
    }

    #[getter]
    fn request_count(&self) -> u64 {
        self.file.source().read_count()
    }

    #[getter]
    fn bounds(&self) -> Option<(Point, Point)> {
        self.file.bounds().map(|[low, high]| (low.into(), high.into()))
    }

    /// What is known without reading more, under the names that `lodpack info --json` has for it.
    fn info(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        let (file, index) = (&self.file, self.file.index());
        let info = PyDict::new(py);
        let (major, minor) = index.version();
        info.set_item("version", format!("{major}.{minor}"))?;
        let source = file.source_info().cloned().unwrap_or_default();
        info.set_item("generator", source.generator)?;
        info.set_item("source_triangles", source.triangle_count)?;
        info.set_item("source_vertices", source.vertex_count)?;
        info.set_item("mean_edge_length", source.mean_edge_length)?;
        info.set_item("bounds", self.bounds())?;
        info.set_item("lattice_step", file.lattice().step())?;
        info.set_item("roots", file.root_count())?;
        info.set_item("arcs", index.arc_count())?;
        info.set_item("corners", index.corner_count())?;
        let levels = PyList::empty(py);
        for (number, level) in (0..file.level_count()).filter_map(|number| Some((number, file.level(number)?))) {
            let entry = PyDict::new(py);
            entry.set_item("level", number)?;
            entry.set_item("triangles", level.triangle_count)?;
            entry.set_item("certified_error", level.max_error)?;
            entry.set_item("tolerance", level.tolerance)?;
            entry.set_item("page_bytes", level.page_bytes)?;
            levels.append(entry)?;
        }
        info.set_item("levels", levels)?;
        let overview = index.overview_summary().map(|(error, triangles)| {
            let entry = PyDict::new(py);
            entry.set_item("triangles", triangles)?;
            entry.set_item("certified_error", error)?;
            Ok::<_, PyErr>(entry)
        });
        info.set_item("overview", overview.transpose()?)?;
        let channels = PyList::empty(py);
        for (channel, &bytes) in index.channels().iter().zip(index.texel_bytes().iter().skip(1)) {
            let entry = PyDict::new(py);
            entry.set_item("name", &channel.name)?;
            entry.set_item("kind", channel.kind.name())?;
            entry.set_item("lossless", channel.is_exact)?;
            entry.set_item("components", channel.components)?;
            entry.set_item("low", channel.low)?;
            entry.set_item("step", channel.step)?;
            entry.set_item("bound", channel.bound)?;
            entry.set_item("bytes", bytes)?;
            channels.append(entry)?;
        }
        info.set_item("channels", channels)?;
        let ground = index.ground_range().map(|range| {
            let entry = PyDict::new(py);
            entry.set_item("bytes", range.end - range.start)?;
            Ok::<_, PyErr>(entry)
        });
        info.set_item("ground", ground.transpose()?)?;
        info.set_item("objects", file.objects().map_or(0, |objects| objects.count()))?;
        Ok(info.unbind())
    }

    /// Finds the cut for a query.
    #[pyo3(signature = (*, tolerance=None, bbox=None, context=false, max_triangles=None, max_nodes=None, max_bytes=None, hide=None, only=None))]
    #[expect(clippy::too_many_arguments, reason = "all are named in Python")]
    fn select(
        &self,
        py: Python<'_>,
        tolerance: Option<f64>,
        bbox: Option<[[f64; 3]; 2]>,
        context: bool,
        max_triangles: Option<u64>,
        max_nodes: Option<u64>,
        max_bytes: Option<u64>,
        hide: Option<Vec<u32>>,
        only: Option<Vec<u32>>,
    ) -> PyResult<NativeCut> {
        let mut query = Query {
            volume: bbox.map(Into::into),
            outside: if context { Outside::Coarsest } else { Outside::Drop },
            tolerance,
            max_triangles,
            max_nodes,
            max_bytes,
            ..Query::default()
        };
        let choice = choice(hide, only);
        let select = move |file: &File<Counting<Source>>| {
            query.objects = choice.map(|choice| file.filter_objects(&choice)).transpose()?;
            file.select(&query)
        };
        Ok(NativeCut(Arc::new(self.ask(py, self.is_slow, select)?)))
    }

    /// Positions, triangles, and for each triangle the number of its node.
    fn extract(&self, py: Python<'_>, cut: &NativeCut) -> PyResult<(Array, Array, Array)> {
        let cut = Arc::clone(&cut.0);
        let is_slow = self.is_slow || cut.triangle_count > SLOW_TRIANGLES;
        self.ask(py, is_slow, move |file| file.extract(&cut)).map(arrays)
    }

    /// The mesh of a cut with the images of some channels, by number.
    fn extract_textured(&self, py: Python<'_>, cut: &NativeCut, channels: Vec<u8>) -> PyResult<Textured> {
        let cut = Arc::clone(&cut.0);
        let infos = channels.iter().filter_map(|&channel| self.file.channels().get(usize::from(channel)));
        let infos = infos.cloned().collect();
        // Images take longer than triangles.
        let is_slow = self.is_slow || cut.triangle_count > SLOW_TRIANGLES / 10;
        let mesh = self.ask(py, is_slow, move |file| file.extract_textured(&cut, &channels))?;
        Ok(Textured::new(mesh, infos))
    }

    /// The heights that the mesh stands on, and where they are; None without a ground.
    fn ground(&self, py: Python<'_>) -> PyResult<Option<(HeightsReader, NativeFrame)>> {
        let Some(range) = self.file.index().ground_range() else { return Ok(None) };
        let source: Source = Box::new(Within::new(OfFile(Arc::clone(&self.file)), range));
        let open = move |file: &File<Counting<Source>>| Ground::within(file.index(), Counting::new(source));
        let Ground { heights, frame } = self.ask(py, self.is_slow, open)?;
        let name = format!("the ground of {}", self.name);
        Ok(Some((HeightsReader { file: Arc::new(heights), name: name.into() }, NativeFrame(frame))))
    }

    /// What the input named; None if it named nothing.
    fn objects(&self) -> Option<NativeObjects> {
        self.file.objects()?;
        Some(NativeObjects { file: Arc::clone(&self.file), name: Arc::clone(&self.name), is_slow: self.is_slow })
    }

    /// What a ray meets first: object, point, distance, error and root.
    #[pyo3(signature = (origin, direction, hide=None, only=None))]
    fn pick(
        &self,
        py: Python<'_>,
        origin: [f64; 3],
        direction: [f64; 3],
        hide: Option<Vec<u32>>,
        only: Option<Vec<u32>>,
    ) -> PyResult<Option<Picked>> {
        let choice = choice(hide, only);
        let pick = move |file: &File<Counting<Source>>| {
            let filter = choice.map(|choice| file.filter_objects(&choice)).transpose()?;
            file.pick_shown(Ray { origin, direction }, filter.as_deref())
        };
        let found = self.ask(py, self.is_slow, pick)?;
        Ok(found.map(|pick| (pick.object, pick.point.into(), pick.distance, pick.error, pick.root)))
    }

    /// Reads the complete file, and checks every rule of the format.
    fn verify(&self, py: Python<'_>) -> PyResult<()> {
        self.ask(py, true, |file| file.verify())
    }

    /// The overview, with its error; None for a file that has none.
    fn overview(&self, py: Python<'_>) -> PyResult<Option<(f64, Array, Array, Array)>> {
        let lattice = self.file.lattice();
        let overview = self.ask(py, false, |file| file.overview())?;
        Ok(overview.map(|overview| {
            let (positions, triangles, nodes) = arrays(overview.mesh(&lattice));
            (overview.error, positions, triangles, nodes)
        }))
    }
}

/// What is drawn of objects, if somebody said.
fn choice(hide: Option<Vec<u32>>, only: Option<Vec<u32>>) -> Option<ObjectChoice> {
    let hidden = hide.unwrap_or_default();
    let choice = ObjectChoice { only, hidden, ..ObjectChoice::default() };
    (!choice.is_everything()).then_some(choice)
}

pub fn arrays(mesh: Mesh) -> (Array, Array, Array) {
    (Array::triples(mesh.positions), Array::triples(mesh.triangles), Array::flat(mesh.triangle_nodes))
}

#[pymethods]
impl NativeCut {
    /// Error inside the box, error of everything, and what limits it.
    #[getter]
    fn certificate(&self) -> (f64, f64, &'static str) {
        (self.error(), self.error_everywhere(), self.limited_by())
    }

    #[getter]
    fn error(&self) -> f64 {
        self.0.error
    }

    #[getter]
    fn error_everywhere(&self) -> f64 {
        self.0.error_everywhere()
    }

    #[getter]
    fn triangle_count(&self) -> u64 {
        self.0.triangle_count
    }

    #[getter]
    fn node_count(&self) -> usize {
        self.0.nodes.len()
    }

    #[getter]
    fn limited_by(&self) -> &'static str {
        self.0.limited_by.name()
    }

    /// Roots, levels and errors of the nodes.
    fn nodes(&self) -> (Array, Array, Array) {
        let nodes = &self.0.nodes;
        let roots = nodes.iter().map(|node| node.root).collect();
        let levels = nodes.iter().map(|node| node.level).collect();
        (Array::flat::<u32>(roots), Array::flat::<u8>(levels), Array::flat(self.0.node_errors.clone()))
    }
}
