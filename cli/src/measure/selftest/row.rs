//! What a row of the table says.

use crate::stage::embed::EmbedReport;
use serde::{Deserialize, Serialize};

/// How a row ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// A file was written.
    File,
    /// An error said why not.
    Refused,
    /// The process ended in another way: a panic, an abort.
    #[default]
    Crashed,
    /// It was ended because it took too long.
    Hung,
    /// It was ended because it took too much memory.
    Memory,
}

impl Outcome {
    /// The name in tables.
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

/// A file's certificates against what [`crate::measure::verify`] measures of it, which shares no code with the builder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Certified error of the finest level, in input units.
    pub certified: f64,
    /// Largest distance found there, both ways. Below a hundredth of the certified error it is not resolved.
    pub measured: f64,
    /// Certified over measured error: the least of all levels at which something was measured. Below 1 it would be wrong.
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
    /// Edges of these cuts with more than two triangles: surfaces that touch themselves.
    pub crowded_edges: u64,
    /// Nodes whose error was neither refuted nor proven by the measurement, over all levels.
    pub unproven_nodes: u64,
    /// Charts simplified again because a bound was above the tolerance.
    pub retried_charts: u64,
    /// Charts that keep the triangles of the input.
    pub unsimplified_charts: u64,
    /// Arc samples added because a border could not be thinned out as planned.
    pub raised_samples: u64,
    /// Charts that were tried as grids and could not be embedded.
    pub embedding_failures: u64,
}

/// One position of a case's dial, and what became of it.
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
    /// What was said: why it was refused, how it crashed, or a note.
    pub message: String,
    /// Everything that is wrong; nothing for a good row.
    pub problems: Vec<String>,
    /// The file, where there is one.
    pub file: Option<Measured>,
    /// The same mesh built with grids wherever one meets the tolerance.
    pub grids: Option<Measured>,
    /// The embedding of its charts as `lodpack atlas` tries it, but however uneven the maps are.
    pub embedding: Option<EmbedReport>,
    /// Charts that were cut further there because they had no map.
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
    /// Whether the row is as it should be.
    pub fn is_good(&self) -> bool {
        self.problems.is_empty()
    }
}
