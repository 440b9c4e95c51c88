//! Reads `.lodpack` files from C: `include/lodpack.h`, which these sources make, says how.
//!
//! | module | holds |
//! |---|---|
//! | `file` | opening, closing, and what a file says of itself |
//! | `channels` | what the surface carries besides positions |
//! | `query` | queries and cuts |
//! | `heights` | the same of files of heights, and their samples |
//! | `objects` | what the input named: found, picked, hidden and shown alone |
//! | `ground` | the heights that a mesh stands on |
//! | `mesh` | decoding, and copies into the caller's memory |
//! | `pages` | meshes of which each vertex has a place in an image |
//! | `stream` | frames of a moving camera |
//! | `shared_budget` | one budget of triangles for several streams |
//! | `source` | files that the caller reads |
//! | `status` | statuses, messages, and panics, none of which gets out |
//! | `pointer` | the only place that follows a caller's pointers |

mod channels;
mod file;
mod ground;
mod heights;
mod mesh;
mod objects;
mod pages;
mod pointer;
mod query;
mod shared_budget;
mod source;
mod status;
mod stream;
