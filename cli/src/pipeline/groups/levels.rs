//! The levels of a group: simplified, coded and compared with the surface that they are made from, and again where a place is too far off.

use glam::DVec3;
use lodpack::{LatticePoint, decode::Patch, write::SymbolBuffer};

use super::super::Scale;
use super::super::irregular::{IMPORTANCE_STEP, code, refinement_of_lines, with_rings};
use super::super::summary::Times;
use super::{FEWEST, Joined};
use crate::machine::thread_cpu_time;
use crate::stage::areas::{Areas, Jumps};
use crate::stage::certify::{CertifyOptions, Comparison, Surface};
use crate::stage::simplify::{Early, LevelPatch, SimplifiedChart, SimplifyOptions, simplify_again};

/// Share by which a bound may exceed the distance of a group from its members.
const GAP: f64 = 0.1;
/// Distances below this share of a level's threshold need not be resolved.
const FLOOR: f64 = 0.1;
/// A group is simplified again if its finest level is farther off than this many times that level's tolerance: a group that is off in one
/// place is drawn only where all of it might be.
const TOO_FAR: f64 = 1.5;

/// What the levels of a group are made with.
pub(super) struct Making<'a> {
    pub scale: &'a Scale,
    /// Where colours jump, if that is known.
    pub jumps: Option<&'a Jumps>,
    /// Coarse to fine.
    pub levels: [u8; 2],
    /// The surface that they are made from.
    pub below: &'a Joined,
}

/// A level as it decodes.
pub(super) struct MadeLevel {
    pub patch: Patch,
    pub symbols: SymbolBuffer,
    /// The area of each triangle; empty if nothing is known of them.
    pub areas: Vec<u32>,
    /// The border, loop after loop, then the inside.
    pub points: Vec<LatticePoint>,
    /// The same, relative to the lattice's origin.
    pub positions: Vec<DVec3>,
    /// Bound of its distance from the surface below.
    pub distance: f64,
    compared: Comparison,
}

impl Making<'_> {
    /// Simplifies a surface that is that below, at most with more vertices. `importance` and `early` are as for charts.
    pub fn simplify(
        &self,
        joined: &Joined,
        importance: Option<&[f32]>,
        early: Option<&mut Option<Early>>,
    ) -> SimplifiedChart {
        let [coarsest, finest] = self.levels;
        let thresholds: Vec<f64> =
            self.scale.levels[..=usize::from(finest)].iter().map(|level| level.threshold).collect();
        let options = SimplifyOptions {
            thresholds: &thresholds,
            coarsest: usize::from(coarsest),
            importance,
            min_triangles: FEWEST,
            areas: Areas::of(&joined.areas, self.jumps),
            ..SimplifyOptions::default()
        };
        simplify_again(&joined.chart(), &options, early)
    }

    /// Codes a level and bounds its distance; none if it cannot be coded, or if it has nothing that could be near.
    pub fn make(&self, joined: &Joined, level: u8, level_patch: &LevelPatch, times: &mut Times) -> Option<MadeLevel> {
        let start = thread_cpu_time();
        let border = joined.border_loops(level);
        let refinement = refinement_of_lines(level_patch, self.jumps);
        let (patch, symbols, areas) = code(self.scale, level, &border, level_patch, refinement).ok()?;
        times.encode += thread_cpu_time() - start;
        let start = thread_cpu_time();
        let points: Vec<LatticePoint> = border.iter().flatten().chain(&patch.interior).copied().collect();
        let positions: Vec<DVec3> = points.iter().map(|&point| self.scale.local_from_lattice(point)).collect();
        let original = Surface::new(&self.below.positions, &self.below.triangles);
        let drawn = Surface::new(&positions, &patch.triangles);
        let options = CertifyOptions {
            relative_gap: GAP,
            floor: self.scale.levels[usize::from(level)].threshold * FLOOR,
            ..CertifyOptions::default()
        };
        let mut compared = Comparison::new(&original, &drawn, &self.below.pairing(level));
        let distance = compared.two_sided(&options).upper;
        times.certify += thread_cpu_time() - start;
        distance.is_finite().then_some(MadeLevel { patch, symbols, areas, points, positions, distance, compared })
    }

    /// Makes the finest level. Where it is too far off, simplifies again with more weight there, and takes what is nearer.
    pub fn make_finest(
        &self,
        joined: &Joined,
        simplified: &mut SimplifiedChart,
        early: &mut Option<Early>,
        times: &mut Times,
    ) -> Option<MadeLevel> {
        let [_, finest] = self.levels;
        let tolerance = self.scale.levels[usize::from(finest)].tolerance;
        let mut made = self.make(joined, finest, simplified.levels[usize::from(finest)].as_ref()?, times)?;
        if made.distance <= TOO_FAR * tolerance {
            return Some(made);
        }
        let start = thread_cpu_time();
        let far = made.compared.exceeding(tolerance, u64::MAX);
        times.certify += thread_cpu_time() - start;
        let start = thread_cpu_time();
        let mut importance = vec![1.0; joined.positions.len()];
        for v in with_rings(&self.below.triangles, far, 1) {
            importance[v as usize] = IMPORTANCE_STEP;
        }
        let again = self.simplify(joined, Some(&importance), Some(early));
        times.simplify += thread_cpu_time() - start;
        // With other weights a border may get stuck.
        if let Some(patch) = again.levels[usize::from(finest)].as_ref().filter(|_| again.stuck.is_empty())
            && let Some(next) = self.make(joined, finest, patch, times)
            && next.distance < made.distance
        {
            (made, *simplified) = (next, again);
        }
        Some(made)
    }
}
