//! Arrays that numpy takes over without copying.
//!
//! An [`Array`] owns a vector and tells numpy where it lies, by numpy's array interface (version 3). `numpy.asarray`
//! then makes an array of that memory and keeps the [`Array`] alive. No code of numpy is called, so one wheel serves
//! every version of it, and none at all.

use pyo3::{
    Py, PyResult, Python, intern, pyclass, pymethods,
    types::{PyDict, PyDictMethods, PyTuple},
};

/// The owner of an array's memory.
#[pyclass(frozen, module = "lodpack._lodpack")]
pub struct Array {
    /// Keeps the memory. Rust reads nothing of it any more: it belongs to numpy's arrays.
    _owner: Box<dyn Send + Sync>,
    address: usize,
    shape: Vec<usize>,
    /// numpy's name of the type.
    element: &'static str,
}

/// The name of a type with the order of this machine's bytes before it.
macro_rules! native {
    ($name:literal) => {
        if cfg!(target_endian = "big") { concat!(">", $name) } else { concat!("<", $name) }
    };
}

/// Types of numbers that numpy knows.
pub trait Element: Send + Sync + 'static {
    /// Order, kind and number of bytes, in numpy's words.
    const NAME: &'static str;
}

impl Element for f64 {
    const NAME: &'static str = native!("f8");
}

impl Element for u32 {
    const NAME: &'static str = native!("u4");
}

impl Element for f32 {
    const NAME: &'static str = native!("f4");
}

impl Element for u16 {
    const NAME: &'static str = native!("u2");
}

impl Element for u8 {
    const NAME: &'static str = native!("u1");
}

impl Array {
    /// An array of one dimension.
    pub fn flat<T: Element>(mut numbers: Vec<T>) -> Self {
        let address = numbers.as_mut_ptr().expose_provenance();
        Self::new::<T>(address, vec![numbers.len()], Box::new(numbers))
    }

    /// An array with three columns.
    pub fn triples<T: Element>(mut rows: Vec<[T; 3]>) -> Self {
        let address = rows.as_mut_ptr().expose_provenance();
        Self::new::<T>(address, vec![rows.len(), 3], Box::new(rows))
    }

    /// An array of a shape that has as many places as there are numbers.
    pub fn shaped<T: Element>(mut numbers: Vec<T>, shape: &[usize]) -> Self {
        debug_assert_eq!(shape.iter().product::<usize>(), numbers.len());
        let address = numbers.as_mut_ptr().expose_provenance();
        Self::new::<T>(address, shape.to_vec(), Box::new(numbers))
    }

    fn new<T: Element>(address: usize, shape: Vec<usize>, owner: Box<dyn Send + Sync>) -> Self {
        Self { _owner: owner, address, shape, element: T::NAME }
    }
}

#[pymethods]
impl Array {
    #[getter]
    fn __array_interface__(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        let interface = PyDict::new(py);
        interface.set_item(intern!(py, "version"), 3)?;
        interface.set_item(intern!(py, "shape"), PyTuple::new(py, &self.shape)?)?;
        interface.set_item(intern!(py, "typestr"), self.element)?;
        interface.set_item(intern!(py, "data"), (self.address, false))?;
        Ok(interface.unbind())
    }
}
