//! The native half of the Python package `lodpack`; the half that people see is `package/lodpack/*.py`.
//!
//! | module | holds |
//! |---|---|
//! | `source` | what a file is read from: a path, an address, bytes, or a Python object |
//! | `reader` | an open file, and its answers |
//! | `heights` | an open file of heights, and its answers |
//! | `ground` | the heights that a mesh stands on |
//! | `objects` | what the input named |
//! | `textured` | meshes with what the surface carries |
//! | `array` | arrays that numpy takes over without copying |
//! | `error` | from the reader's errors to exceptions by culprit |
//! | `build` | builds, with the feature `build` |
//! | `interrupt` | Ctrl-C while something takes long |

mod array;
#[cfg(feature = "build")]
mod build;
mod error;
mod ground;
mod heights;
mod interrupt;
mod objects;
mod reader;
mod source;
mod textured;

/// `lodpack._lodpack`.
#[pyo3::pymodule]
mod _lodpack {
    #[pymodule_export]
    use crate::{
        array::Array,
        ground::NativeFrame,
        heights::HeightsReader,
        objects::NativeObjects,
        reader::{NativeCut, Reader, open_bytes, open_object, open_path, open_url},
        textured::Textured,
    };

    #[cfg(feature = "build")]
    #[pymodule_export]
    use crate::build::{BuildRequest, build};

    /// The version of this package.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
