//! From the reader's errors to the exceptions of `package/lodpack/_errors.py`: who has to act is the exception's type.

use lodpack::Error;
use pyo3::{
    Bound, Py, PyErr, PyResult, Python,
    sync::PyOnceLock,
    types::{PyAnyMethods, PyType},
};
use std::io;

/// The exception of an error, with the file's name in front of the message.
pub fn exception(py: Python<'_>, name: &str, error: Error) -> PyErr {
    let class = match error {
        Error::Io { .. } => "SourceError",
        Error::Format { .. } => "FormatError",
        Error::Unsupported { .. } => "UnsupportedError",
        Error::Query { .. } => "QueryError",
        Error::Limit { .. } => "LimitError",
        // The others concern writing, and programs that read bytes themselves.
        _ => "Error",
    };
    match error {
        Error::Io { offset, length, source } => match raised_by(py, source) {
            // A Python object was the source: its own exception is the cause.
            Ok(cause) => {
                let outer = raise(py, class, format!("{name}: cannot read {length} bytes at offset {offset}: {cause}"));
                outer.set_cause(py, Some(cause));
                outer
            }
            Err(source) => raise(py, class, format!("{name}: {}", Error::Io { offset, length, source })),
        },
        // A query is no file's fault.
        Error::Query { .. } => raise(py, class, error.to_string()),
        error => raise(py, class, format!("{name}: {error}")),
    }
}

/// The exception that a Python object has raised while it was read.
fn raised_by(py: Python<'_>, source: io::Error) -> Result<PyErr, io::Error> {
    match source.get_ref().and_then(|inner| inner.downcast_ref::<PyErr>()) {
        Some(raised) => Ok(raised.clone_ref(py)),
        None => Err(source),
    }
}

/// An exception of `package/lodpack/_errors.py`.
pub fn raise(py: Python<'_>, class: &str, message: String) -> PyErr {
    let class = module(py).and_then(|module| Ok(module.getattr(class)?.cast_into::<PyType>()?));
    class.map_or_else(|error| error, |class| PyErr::from_type(class, message))
}

fn module(py: Python<'_>) -> PyResult<Bound<'_, pyo3::PyAny>> {
    static MODULE: PyOnceLock<Py<pyo3::PyAny>> = PyOnceLock::new();
    let module = MODULE.get_or_try_init(py, || Ok::<_, PyErr>(py.import("lodpack._errors")?.into_any().unbind()))?;
    Ok(module.bind(py).clone())
}
