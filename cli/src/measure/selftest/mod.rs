//! The stability suite: generated meshes with a dial from easy to impossible, and the result of building each position.
//!
//! Every position must end in a file whose certificates hold, or in an error that says why it cannot be built. A
//! [`Case`] is a family of meshes with a dial; a row is one position of it. [`run_row`] builds and verifies one row in
//! this process. [`run_rows`] gives each a process of its own, so a crash, a hang or excessive memory is a result
//! like any other.

mod form;
mod measure;
mod row;
mod scale;
pub mod shapes;
mod stiff;
mod table;
mod topology;
mod watch;

pub use measure::run_row;
pub use row::{Measured, Outcome, Row};
pub use table::{Totals, write_csv};
pub use watch::{Limits, SelftestError, run_rows, stop_rows};

use crate::mesh::Mesh;
use crate::mesh::tolerance::Tolerance;
use std::fmt;
use std::str::FromStr;

/// The input of a build at one position of a dial.
#[derive(Clone, Debug)]
pub struct Input {
    /// The mesh as it would come from a file: not repaired.
    pub mesh: Mesh,
    /// The tolerance to build with.
    pub tolerance: Tolerance,
    /// See [`crate::stage::embed::EmbedOptions::weight_decades`].
    pub weight_decades: f64,
    /// Whether to measure distances only at some points, because measuring all of them would take minutes: for very
    /// many needles at one tip, whose boxes all overlap, and for very many roots.
    pub sampled: bool,
}

impl Input {
    fn new(mesh: Mesh) -> Self {
        Self { mesh, tolerance: Tolerance::Auto, weight_decades: 0.0, sampled: false }
    }
}

/// A family of meshes with a dial.
#[derive(Debug)]
pub struct Case {
    /// Its name, in lower case with hyphens.
    pub name: &'static str,
    /// The meaning of the dial.
    pub meaning: &'static str,
    /// Positions of the dial, from easy to hard.
    pub dials: &'static [f64],
    /// Positions that must be refused. All others must be built.
    pub refused: &'static [f64],
    /// Positions that are fast and belong to the quick suite.
    pub quick: &'static [f64],
    make: fn(f64) -> Input,
}

impl Case {
    /// The mesh at a position of the dial.
    pub fn input(&self, dial: f64) -> Input {
        (self.make)(dial)
    }

    /// All rows of the case, or the quick ones.
    pub fn rows(&'static self, quick: bool) -> impl Iterator<Item = RowId> {
        let dials = if quick { self.quick } else { self.dials };
        dials.iter().map(move |&dial| RowId { case: self, dial })
    }
}

/// The families of cases, by name.
pub const FAMILIES: [(&str, &[Case]); 4] =
    [("stiff", stiff::CASES), ("scale", scale::CASES), ("form", form::CASES), ("topology", topology::CASES)];

/// All cases.
pub fn cases() -> impl Iterator<Item = &'static Case> {
    FAMILIES.iter().flat_map(|(_, cases)| cases.iter())
}

/// A position of a case's dial; as text, `case:dial`.
#[derive(Clone, Copy, Debug)]
pub struct RowId {
    /// The case.
    pub case: &'static Case,
    /// One of its positions.
    pub dial: f64,
}

impl fmt::Display for RowId {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}:{:?}", self.case.name, self.dial)
    }
}

impl FromStr for RowId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, dial) = text.split_once(':').ok_or("a row is CASE:DIAL, such as finger:100")?;
        let case = cases()
            .find(|case| case.name == name)
            .ok_or_else(|| format!("there is no case '{name}'; --list names all cases"))?;
        let value: f64 = dial.parse().map_err(|_| format!("'{dial}' is not a number"))?;
        let known = case.dials.contains(&value);
        known
            .then_some(Self { case, dial: value })
            .ok_or_else(|| format!("the dial of {name} has no position {dial}; it has {:?}", case.dials))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_row_has_a_name_of_its_own_that_reads_back() {
        let mut names = BTreeSet::new();
        for row in cases().flat_map(|case| case.rows(false)) {
            let again: RowId = row.to_string().parse().unwrap();
            assert_eq!((again.case.name, again.dial), (row.case.name, row.dial));
            assert!(names.insert(row.to_string()), "{row} occurs twice");
        }
        assert!(names.len() >= 150, "{} rows", names.len());
        for bad in ["", "finger", "finger:7", "nothing:1", "finger:x"] {
            assert!(bad.parse::<RowId>().is_err());
        }
    }

    #[test]
    fn refused_and_quick_positions_are_on_the_dial() {
        for case in cases() {
            let known = |dials: &[f64]| dials.iter().all(|dial| case.dials.contains(dial));
            assert!(known(case.refused) && known(case.quick), "{}", case.name);
        }
    }

    #[test]
    fn generators_make_indices_in_range_and_finite_positions() {
        for row in cases().flat_map(|case| case.rows(true)) {
            let Mesh { positions, triangles } = row.case.input(row.dial).mesh;
            assert!(triangles.iter().flatten().all(|&v| (v as usize) < positions.len()), "{row}");
            assert!(positions.iter().all(|p| p.is_finite()), "{row}");
        }
    }
}
