//! Writing a file.
//!
//! - [`check`]: the rules that a model keeps,
//! - [`order`]: which roots lie beside each other, and the numbers that follow,
//! - [`piece`]: roots in that order as symbols; a model is one piece, a large one comes in several,
//! - [`numbering`]: from the numbers of pieces to those of the file,
//! - [`assembly`]: the first pass over all pieces: numbers, and tables of all symbols,
//! - [`encoder`]: the second pass: pieces become bytes,
//! - [`output`]: the sections one after the other.

mod assembly;
mod check;
mod encoder;
mod numbering;
mod order;
mod output;
mod piece;

use std::io::{Cursor, Write};

pub use assembly::Assembly;
pub use encoder::{EncodedPiece, Encoder};
pub use output::{Output, WriteReport};
pub use piece::{Piece, PieceIndex, PieceSymbols, Share, Shares};

use crate::{error::Result, model::Model};

/// Writes a model as a file. The same model gives the same bytes on every machine. A model that is larger than memory is written
/// piece by piece: see [`Assembly`].
///
/// # Errors
/// [`Error::Model`] where the model breaks a rule, [`Error::Write`] where `out` fails.
pub fn write_file(model: &Model, out: &mut impl Write) -> Result<WriteReport> {
    let piece = Piece::new(model, &Shares::default(), model.roots.len() as u64)?;
    let mut assembly = Assembly::new(model)?;
    assembly.count(&piece.index)?;
    let encoder = assembly.seal(model.overview.clone());
    let encoded = encoder.encode(0, &piece)?;
    let mut output = Output::new(encoder, || Ok(Cursor::new(Vec::new())))?;
    output.add(encoded)?;
    let report = output.finish(out)?;
    Ok(WriteReport { root_order: piece.index.root_order, ..report })
}
