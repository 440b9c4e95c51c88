//! What a file is read from.

use lodpack::{ReadAt, source::Request};
use pyo3::{Py, PyAny, PyErr, Python, pybacked::PyBackedBytes, types::PyAnyMethods};
use std::io;

/// A source of any kind.
pub type Source = Box<dyn ReadAt + Send + Sync>;

/// A Python `bytes`.
pub struct Bytes(pub PyBackedBytes);

impl ReadAt for Bytes {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.0.as_ref().read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.0.len() as u64)
    }
}

/// A Python object with `size()` and `read_ranges([(offset, length), ...])`: see `package/lodpack/_source.py`.
pub struct Object(pub Py<PyAny>);

impl ReadAt for Object {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.read_ranges(&mut [Request { offset, buf }])
    }

    fn size(&self) -> io::Result<u64> {
        Python::attach(|py| self.0.bind(py).call_method0("size")?.extract()).map_err(raised)
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        let ranges: Vec<(u64, usize)> = requests.iter().map(|request| (request.offset, request.buf.len())).collect();
        let read = |py: Python<'_>| -> Result<Vec<PyBackedBytes>, PyErr> {
            self.0.bind(py).call_method1("read_ranges", (ranges,))?.extract()
        };
        let answers = Python::attach(read).map_err(raised)?;
        if answers.len() != requests.len() {
            return Err(io::Error::other("the source returned another number of ranges than was asked for"));
        }
        for (request, answer) in requests.iter_mut().zip(&answers) {
            // A source that ends early says so by a shorter answer.
            if answer.len() != request.buf.len() {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            request.buf.copy_from_slice(answer);
        }
        Ok(())
    }
}

/// Carries an exception through the reader.
fn raised(error: PyErr) -> io::Error {
    io::Error::other(error)
}
