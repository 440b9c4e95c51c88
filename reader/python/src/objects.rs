//! What the input named: objects and assemblies of an open file.

use crate::{
    error::exception,
    reader::{Point, run},
    source::Source,
};
use lodpack::{Error, File, FileObjects, source::Counting};
use pyo3::{PyResult, Python, pyclass, pymethods};
use std::sync::Arc;

/// The objects of an open file.
#[pyclass(frozen, name = "Objects", module = "lodpack._lodpack")]
pub struct NativeObjects {
    pub file: Arc<File<Counting<Source>>>,
    pub name: Arc<str>,
    pub is_slow: bool,
}

/// Name, id and parent.
type Node = (Option<String>, Option<String>, Option<u32>);

impl NativeObjects {
    /// Asks them without holding Python up.
    fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        question: impl FnOnce(&FileObjects<'_, Counting<Source>>) -> lodpack::Result<T> + Send + 'static,
    ) -> PyResult<T> {
        let file = Arc::clone(&self.file);
        let asked = move || match file.objects() {
            Some(objects) => question(&objects),
            None => Err(Error::Query { what: "the file has no objects".into() }),
        };
        run(py, self.is_slow, asked)?.map_err(|error| exception(py, &self.name, error))
    }
}

#[pymethods]
impl NativeObjects {
    /// How many objects there are, and how many objects and assemblies.
    #[getter]
    fn counts(&self) -> (u32, u32) {
        self.file.objects().map_or((0, 0), |objects| (objects.count(), objects.node_count()))
    }

    fn node(&self, py: Python<'_>, number: u32) -> PyResult<Node> {
        let node = self.ask(py, move |objects| objects.node(number))?;
        Ok((node.name, node.id, node.parent))
    }

    fn find_name(&self, py: Python<'_>, name: String) -> PyResult<Vec<u32>> {
        self.ask(py, move |objects| objects.find_name(&name))
    }

    fn find_id(&self, py: Python<'_>, id: String) -> PyResult<Vec<u32>> {
        self.ask(py, move |objects| objects.find_id(&id))
    }

    #[pyo3(signature = (parent=None))]
    fn children(&self, py: Python<'_>, parent: Option<u32>) -> PyResult<Vec<u32>> {
        self.ask(py, move |objects| objects.children(parent))
    }

    fn above(&self, py: Python<'_>, number: u32) -> PyResult<Vec<u32>> {
        self.ask(py, move |objects| objects.above(number))
    }

    fn bounds(&self, py: Python<'_>, numbers: Vec<u32>) -> PyResult<Option<(Point, Point)>> {
        let bounds = self.ask(py, move |objects| objects.bounds(&numbers))?;
        Ok(bounds.map(|[low, high]| (low.into(), high.into())))
    }

    fn leaves(&self, py: Python<'_>, number: u32) -> PyResult<Vec<u32>> {
        self.ask(py, move |objects| objects.leaves(number))
    }
}
