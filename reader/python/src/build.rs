//! Builds, by the library of the program `lodpack`.

use crate::error::raise;
use lodpack_cli::{
    job::{self, BuildOptions},
    mesh::{Mesh, tolerance::Tolerance},
    pipeline::{ModelOptions, summary::BuildSummary},
    progress::Progress,
    storage::default_memory,
};
use pyo3::{
    Py, PyAny, PyErr, PyRef, PyResult, Python, exceptions::PyRuntimeError, pybacked::PyBackedBytes, pyclass, pyfunction,
};
use std::{
    fs::File,
    io::{BufWriter, Write},
    path::PathBuf,
    str::FromStr,
    sync::atomic::{AtomicBool, Ordering},
    sync::{Arc, Mutex, PoisonError},
    thread::JoinHandle,
    time::Duration,
};

/// How long a signal or a report of progress may wait.
const PATIENCE: Duration = Duration::from_millis(100);

/// What a build is asked for: see `lodpack.build`.
#[pyclass(get_all, set_all, module = "lodpack._lodpack")]
#[derive(Clone, Default)]
pub struct BuildRequest {
    inputs: Vec<PathBuf>,
    /// Where the file is written.
    output: PathBuf,
    /// A directory that does not exist, for what does not fit in memory.
    work: PathBuf,
    tolerance: String,
    unit: Option<String>,
    effort: String,
    levels: String,
    threads: usize,
    memory: Option<u64>,
}

#[pyo3::pymethods]
impl BuildRequest {
    #[new]
    fn new() -> Self {
        Self::default()
    }
}

/// Builds a file from meshes on disk or, with `mesh`, from positions (float64) and triangles (uint32). Returns the
/// summary as JSON, and notes. Calls `progress` with a stage, and how much of it is done, of what.
#[pyfunction]
#[pyo3(signature = (request, mesh=None, progress=None))]
pub fn build(
    py: Python<'_>,
    request: PyRef<'_, BuildRequest>,
    mesh: Option<(PyBackedBytes, PyBackedBytes)>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    let request = request.clone();
    let options = options(&request).map_err(|what| raise(py, "QueryError", what))?;
    let mesh = mesh.map(|(positions, triangles)| mesh_of(&positions, &triangles)).transpose();
    let mesh = mesh.map_err(|what| raise(py, "BuildError", what))?;
    let watch = Arc::new(Watch::default());
    let worker = {
        let watch = Arc::clone(&watch);
        std::thread::Builder::new()
            .name("lodpack-build".into())
            .spawn(move || write_file(&request, &options, mesh, &watch))?
    };
    let waited = wait(py, &worker, &watch, progress.as_ref());
    watch.stopped.store(waited.is_err(), Ordering::Relaxed);
    let done = py.detach(move || worker.join());
    waited?;
    match done {
        Ok(Ok(summary)) => {
            let text = serde_json::to_string(&summary).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
            Ok((text, std::mem::take(&mut *watch.notes.lock().unwrap_or_else(PoisonError::into_inner))))
        }
        Ok(Err(what)) => Err(raise(py, "BuildError", what)),
        Err(_) => Err(PyRuntimeError::new_err("the build ended early; this is a defect of lodpack")),
    }
}

fn options(request: &BuildRequest) -> Result<BuildOptions, String> {
    let unit = request.unit.as_deref().map(FromStr::from_str).transpose()?;
    let tolerance: Tolerance = request.tolerance.parse()?;
    let (effort, levels) = (request.effort.parse()?, request.levels.parse()?);
    Ok(BuildOptions {
        inputs: request.inputs.clone(),
        model: ModelOptions { tolerance, unit, effort, levels, ..ModelOptions::default() },
        memory: request.memory.unwrap_or_else(default_memory),
        work: request.work.clone(),
        ..BuildOptions::default()
    })
}

/// A mesh from the bytes of two arrays, checked.
fn mesh_of(positions: &[u8], triangles: &[u8]) -> Result<Mesh, String> {
    let number = |bytes: &[u8; 8]| f64::from_ne_bytes(*bytes);
    let positions: Vec<[f64; 3]> =
        positions.as_chunks().0.as_chunks().0.iter().map(|row| row.each_ref().map(number)).collect();
    let index = |bytes: &[u8; 4]| u32::from_ne_bytes(*bytes);
    let triangles: Vec<[u32; 3]> =
        triangles.as_chunks().0.as_chunks().0.iter().map(|row| row.each_ref().map(index)).collect();
    if let Some(number) = positions.iter().position(|point| point.iter().any(|value| !value.is_finite())) {
        return Err(format!("position {number} is not finite: {:?}", positions[number]));
    }
    let count = positions.len();
    if let Some(number) = triangles.iter().position(|corners| corners.iter().any(|&corner| corner as usize >= count)) {
        return Err(format!(
            "triangle {number} names a vertex that does not exist: {:?} of {count}",
            triangles[number]
        ));
    }
    Ok(Mesh { positions: positions.into_iter().map(Into::into).collect(), triangles })
}

/// The work of a build's thread.
fn write_file(
    request: &BuildRequest,
    options: &BuildOptions,
    mesh: Option<Mesh>,
    progress: &Watch,
) -> Result<BuildSummary, String> {
    let cannot_write = |error: std::io::Error| format!("cannot write {}: {error}", request.output.display());
    let mut out = BufWriter::new(File::create(&request.output).map_err(cannot_write)?);
    // The threads end with the build.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(request.threads).build();
    let pool = pool.map_err(|error| format!("cannot start {} threads: {error}", request.threads))?;
    let built = pool.install(|| match mesh {
        Some(mesh) => job::build_mesh(mesh, options, &mut out, progress),
        None => job::build(options, &mut out, progress),
    });
    let summary = built.map_err(|error| match error.into_output_error() {
        Ok(error) => cannot_write(error),
        Err(error) => error.to_string(),
    })?;
    out.flush().map_err(cannot_write)?;
    Ok(summary)
}

/// Waits for a build, for signals, and tells its progress.
fn wait<T>(py: Python<'_>, worker: &JoinHandle<T>, watch: &Watch, progress: Option<&Py<PyAny>>) -> Result<(), PyErr>
where
    T: Send,
{
    let mut told = Stage::default();
    while !worker.is_finished() {
        py.detach(|| std::thread::sleep(PATIENCE));
        py.check_signals()?;
        let stage = *watch.stage.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(progress) = progress.filter(|_| stage != told) {
            progress.call1(py, (stage.name, stage.done, stage.total))?;
            told = stage;
        }
    }
    Ok(())
}

/// Where a build is.
#[derive(Clone, Copy, Default, PartialEq)]
struct Stage {
    name: &'static str,
    done: u64,
    total: u64,
}

/// Carries progress and notes out of a build, and the wish to stop into it.
#[derive(Default)]
struct Watch {
    stage: Mutex<Stage>,
    notes: Mutex<Vec<String>>,
    stopped: AtomicBool,
}

/// What a stopped build unwinds with. It counts as a kill, after which a build leaves nothing that is not its own.
struct Stopped;

impl Watch {
    fn change(&self, change: impl FnOnce(&mut Stage)) {
        change(&mut self.stage.lock().unwrap_or_else(PoisonError::into_inner));
        if self.stopped.load(Ordering::Relaxed) {
            std::panic::resume_unwind(Box::new(Stopped));
        }
    }
}

impl Progress for Watch {
    fn begin(&self, stage: &'static str, total: u64) {
        self.change(|state| *state = Stage { name: stage, done: 0, total });
    }

    fn advance(&self, amount: u64) {
        self.change(|state| state.done += amount);
    }

    fn note(&self, message: &str) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(message.into());
    }
}
