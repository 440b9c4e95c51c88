//! Reads `.lodpack` files from C: `include/lodpack.h`, which these sources make, says how.
//!
//! | module | holds |
//! |---|---|
//! | `file` | opening, closing, and what a file says of itself |
//! | `query` | queries and cuts |
//! | `mesh` | decoding, and copies into the caller's memory |
//! | `source` | files that the caller reads |
//! | `status` | statuses, messages, and panics, none of which gets out |
//! | `pointer` | the only place that follows a caller's pointers |

mod file;
mod mesh;
mod pointer;
mod query;
mod source;
mod status;
