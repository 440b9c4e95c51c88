//! Writing a file.
//!
//! [`write_file`] writes a [`Model`] and returns a [`WriteReport`]. A model has [`LevelInfo`]s, [`ArcRecord`]s and
//! [`RootRecord`]s with a [`BlockRecord`] a level, and perhaps an [`OverviewRecord`]; its channels are
//! [`crate::index::ChannelInfo`]s. Arcs come first: [`quantise_arcs`], or [`quantise_arc`] for one, turns the
//! [`WantedSample`]s of [`ArcTarget`]s into [`ArcSample`]s at the places where a decoder will find them (parameters up
//! to
//! [`PARAM_END`], steps up to [`MAX_TANGENT_SHIFT`]). Then a filling's encoder writes the symbols of each block to a
//! [`SymbolBuffer`]:
//! [`encode_patch`] or [`encode_refined_patch`] an irregular [`PatchTarget`], and [`grid`] a grid, with the
//! [`Quantisation`] of the level's [`LevelSteps`]; a [`Slide`] moves vertices to their best places, and an
//! [`EncodeError`] says why a patch cannot be coded. [`SymbolStatistics`] tell what symbols will cost. Errors are
//! rounded up to what a file can store: [`stored_error`], [`storable_error`]. A file has up to [`MAX_LEVELS`].
//!
//! A model that is larger than memory comes in [`Piece`]s, each a [`PieceIndex`] and [`PieceSymbols`], whose [`Shares`]
//! name what other pieces have too ([`Share`]). An [`Assembly`] counts and orders them ([`Arranged`]), an [`Output`]
//! sorts their symbols by cluster ([`ClusterSymbols`]), and an [`Encoder`] makes each an [`EncodedCluster`]. With the
//! feature `serde`, other processes can do that: each has an `EncoderShare`, and an `EncoderHead` puts the file
//! together. Groups of roots of several pieces stand [`Above`] them.
//! [`ListSizes`] say how clusters are listed.
//!
//! Its files, in the order of use:
//!
//! - `check`: the rules that a model has to keep,
//! - `piece`: a model as symbols; a large one comes in several pieces,
//! - `relevel`: a piece for a file with more levels above it,
//! - `catalogue`: the content of all pieces,
//! - `above`: groups of roots of several pieces,
//! - `order`: the order of roots, and `arrangement`: the clusters and numbers that follow from it,
//! - `assembly`: the first pass over all pieces, which ends with the order, and with tables of all symbols,
//! - `sorting`: the second pass, in which symbols wait until those of a cluster are complete,
//! - `encoder`: clusters as bytes,
//! - `elsewhere`: clusters that other processes encode,
//! - `texels`: the values of channels, which are bytes to all of these,
//! - `owners`: the objects that islands belong to,
//! - `lists`: the lists of clusters,
//! - `output`: the sections of the file.

mod above;
mod arrangement;
mod assembly;
mod catalogue;
mod check;
#[cfg(feature = "serde")]
mod elsewhere;
mod encoder;
mod lists;
mod model;
mod order;
mod output;
mod owners;
mod piece;
mod relevel;
mod sorting;
mod texels;

use std::io::{Cursor, Write};

pub use crate::codec::{
    arc::{ArcSample, ArcTarget, MAX_TANGENT_SHIFT, PARAM_END, WantedSample, quantise_arc, quantise_arcs},
    entropy::{SymbolBuffer, SymbolStatistics},
    filling::{
        LevelSteps, Quantisation, Slide, grid,
        irregular::{EncodeError, PatchTarget, encode_patch, encode_refined_patch},
    },
    texels::{
        ImageStreams, LongTexels, PieceShape, Seen, SeenPoint, encode_exact_image, encode_exact_normals, encode_image,
        encode_map, encode_normals, encode_seen_image, encode_values, lost_squares, texel_size,
    },
};
pub use crate::format::{
    error_code::{storable_error, stored_error},
    records::MAX_LEVELS,
};
pub use crate::objects::ObjectNode;
pub use above::Above;
pub use assembly::{Arranged, Assembly};
#[cfg(feature = "serde")]
pub use elsewhere::{EncoderHead, EncoderShare};
pub use encoder::{EncodedCluster, Encoder};
pub use lists::ListSizes;
pub use model::{ArcRecord, BlockRecord, LevelInfo, Model, OverviewRecord, RootRecord};
pub use output::{Output, WriteReport};
pub use piece::{Piece, PieceIndex, PieceSymbols, Share, Shares};
pub use sorting::ClusterSymbols;

use crate::error::Result;

/// Writes a model as a file. The same model gives the same bytes on every machine. Larger models are written piece by
/// piece: see
/// [`Assembly`].
///
/// # Errors
/// [`crate::Error::Model`] if the model breaks a rule, [`crate::Error::Write`] if `out` fails.
pub fn write_file(model: &Model, out: &mut impl Write) -> Result<WriteReport> {
    write_listed(model, ListSizes::default(), out)
}

/// [`write_file`] with lists of other sizes: for tests, and for readers with other habits.
///
/// # Errors
/// As [`write_file`].
pub fn write_listed(model: &Model, list_sizes: ListSizes, out: &mut impl Write) -> Result<WriteReport> {
    let piece = Piece::new(model, &Shares::default())?;
    let mut assembly = Assembly::new(model)?;
    assembly.count(&piece.index)?;
    let encoder = assembly.arrange()?.seal(model.overview.clone());
    let root_order = encoder.root_order().to_vec();
    let output = Output::new(encoder, || Ok(Cursor::new(Vec::new())))?.with_list_sizes(list_sizes);
    let mut output = output.with_nodes(model.nodes.clone())?;
    output.take(0, &piece)?;
    drop(piece);
    for cluster in 0..output.encoder().cluster_count() {
        let symbols = output.symbols(cluster)?;
        let encoded = output.encoder().encode(&symbols)?;
        output.add(encoded)?;
    }
    Ok(WriteReport { root_order, ..output.finish(out)? })
}
