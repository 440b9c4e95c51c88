//! One row of the table.

use crate::stage::embed::EmbedReport;
use serde::{Deserialize, Serialize};

/// How a row ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// A file was written.
    File,
    /// An error said why no file could be written.
    Refused,
    /// The process ended in another way: a panic or an abort.
    #[default]
    Crashed,
    /// It was ended because it took too long.
    Hung,
    /// It was ended because it used too much memory.
    Memory,
}

impl Outcome {
    /// The name used in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::File => "file",
            Self::Refused => "refused",
            Self::Crashed => "crashed",
            Self::Hung => "hung",
            Self::Memory => "memory",
        }
    }
}

/// A file's certificates, against what [`crate::measure::verify`] measures with code that it does not share with the
/// builder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Certified error of the finest level, in input units.
    pub certified: f64,
    /// Largest distance measured at that level, in both directions. Distances below a hundredth of the certified error
    /// are not resolved.
    pub measured: f64,
    /// Certified over measured error: the smallest over all levels at which something was measured. Below 1, a
    /// certificate is wrong.
    pub least_ratio: Option<f64>,
    /// Levels.
    pub levels: u32,
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Roots with an irregular filling.
    pub irregular_roots: u64,
    /// Roots with a grid.
    pub grid_roots: u64,
    /// Random cuts that were stitched and found closed.
    pub cuts: u32,
    /// Edges of these cuts with more than two triangles, where surfaces touch themselves.
    pub crowded_edges: u64,
    /// Nodes, over all levels, whose error was neither refuted nor proven by the measurement.
    pub unproven_nodes: u64,
    /// Charts that were simplified again because a bound exceeded the tolerance.
    pub retried_charts: u64,
    /// Charts that keep the triangles of the input.
    pub unsimplified_charts: u64,
    /// Arc samples added because a border could not be thinned as planned.
    pub raised_samples: u64,
    /// Charts tried as grids that could not be embedded.
    pub embedding_failures: u64,
}

/// One position of a case's dial, and its result.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The case.
    pub case: String,
    /// The position of its dial.
    pub dial: f64,
    /// Triangles of the mesh.
    pub triangles: u64,
    /// How it ended.
    pub outcome: Outcome,
    /// The message: why it was refused, how it crashed, or a note.
    pub message: String,
    /// All problems; empty for a good row.
    pub problems: Vec<String>,
    /// The file, if there is one.
    pub file: Option<Measured>,
    /// The same mesh, built with grids wherever one meets the tolerance.
    pub grids: Option<Measured>,
    /// The embedding of its charts, tried as by `lodpack atlas`, but however uneven the maps are.
    pub embedding: Option<EmbedReport>,
    /// Charts that the embedding divided further because they had no map.
    pub splits: u64,
    /// Vertices welded, faces dropped, edges and vertices cut, faces flipped.
    pub repairs: [u64; 5],
    /// Processor time of the build.
    pub build_seconds: f64,
    /// Processor time of everything: generation, builds, embedding, verification.
    pub cpu_seconds: f64,
    /// Peak memory of everything.
    pub peak_memory_bytes: u64,
}

impl Row {
    /// Whether the row has no problems.
    pub fn is_good(&self) -> bool {
        self.problems.is_empty()
    }
}
