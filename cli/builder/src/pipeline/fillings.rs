//! The fillings that a chart can get, in one table.
//!
//! Every chart is filled irregularly first, which always succeeds. The other fillings of the table then challenge what
//! a chart has, one after the other ([`super::choose`]). A further filling needs a file with a row and a
//! [`ChartFilling`](super::fill::ChartFilling), and a place in the table.

use super::fill::FillingRow;
use super::scale::LevelPlan;
use super::{Scale, grid, irregular};
use lodpack::write::{LevelSteps, Quantisation};

/// All fillings of the format.
pub(super) static FILLINGS: [FillingRow; 2] = [irregular::ROW, grid::ROW];

/// The steps of each filling at a level.
pub(super) fn level_steps(scale: &Scale, level: &LevelPlan) -> LevelSteps {
    LevelSteps::new(|filling| {
        let row = FILLINGS.iter().find(|row| row.filling == filling);
        row.map_or_else(Quantisation::default, |row| (row.steps)(scale, level))
    })
}
