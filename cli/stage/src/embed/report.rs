//! Statistics over the maps of many charts.

use super::{EmbedError, EmbedOptions, Embedding};
use serde::{Deserialize, Serialize};

/// Counts over the maps of some charts, and the worst figures of their linear systems.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EmbedReport {
    /// Charts that have a map.
    pub embedded: u64,
    /// Charts that are not disks, or have too few or too many corners.
    pub not_disks: u64,
    /// Disks whose map is more uneven than the default limits allow for a grid, whether or not it was accepted.
    pub uneven: u64,
    /// Disks without a map for other reasons: flips that remain, or systems that cannot be solved.
    pub unsolved: u64,
    /// Triangles that rounding flipped in some solve.
    pub flips_before: u64,
    /// Of these, the triangles that neither refinement nor blending with an earlier map turned back. Their charts have
    /// no map.
    pub flips_after: u64,
    /// Largest distance of an inner vertex from the weighted mean of its neighbours, in radii of the polygon.
    pub residual: f64,
    /// Largest of the systems' condition numbers; see [`super::EmbedQuality::conditioning`].
    pub conditioning: f64,
}

impl EmbedReport {
    /// Adds up the results of some charts.
    pub fn of<'a>(maps: impl IntoIterator<Item = &'a Result<Embedding, EmbedError>>) -> Self {
        let limits = EmbedOptions::default();
        let mut report = Self::default();
        for map in maps {
            match map {
                Ok(Embedding { quality, .. }) => {
                    report.embedded += 1;
                    let is_even = quality.stretch_total <= limits.stretch_limit
                        && quality.undersampled_area <= limits.undersampled_limit;
                    report.uneven += u64::from(!is_even);
                    report.flips_before += u64::from(quality.flips_repaired);
                    report.residual = report.residual.max(quality.residual);
                    report.conditioning = report.conditioning.max(quality.conditioning);
                }
                Err(EmbedError::TooUneven { .. }) => report.uneven += 1,
                Err(EmbedError::Flipped { flipped_count }) => {
                    report.unsolved += 1;
                    report.flips_before += *flipped_count as u64;
                    report.flips_after += *flipped_count as u64;
                }
                Err(EmbedError::NotADisk { .. } | EmbedError::CornerCount { .. }) => report.not_disks += 1,
                Err(_) => report.unsolved += 1,
            }
        }
        report
    }
}
