//! The reader as WebAssembly: one instance reads one file, and JavaScript does all reading for it.
//!
//! JavaScript writes arguments of any length to the buffer that [`exports::input`] returns, and finds results in the
//! one that
//! [`exports::output`] and [`exports::output_length`] describe. Every other call returns a number: zero or more if it
//! succeeded, otherwise a [`Status`](answer::Status). A call that needs bytes which are not there returns `Missing`
//! with their ranges: JavaScript fetches these, hands them over, and repeats the call, as with [`lodpack::Index`].
//!
//! | module | holds |
//! |---|---|
//! | `exports` | the functions that JavaScript calls; nothing else touches the border of the language |
//! | `state` | the file, the questions and the streams of an instance |
//! | `stream` | a session that follows a camera |
//! | `pack` | what a frame changes, packed for the GPU |
//! | `channels` | what the surface carries: what there is, and meshes with it |
//! | `heights` | files of heights: what there is, cuts and meshes |
//! | `ground` | the heights that a mesh stands on: where they are |
//! | `objects` | what the input named: found, picked, hidden and shown alone |
//! | `query` | queries as numbers |
//! | `answer` | results as numbers and bytes |

pub mod answer;
mod channels;
mod dress;
pub mod exports;
mod ground;
mod heights;
#[cfg(feature = "channels")]
mod objects;
mod pack;
mod query;
mod state;
mod stream;
