//! The levels of a group: simplified, coded and compared with the surface that they are made from, and again where a
//! place is too far off.

use glam::DVec3;
use lodpack::{LatticePoint, decode::Patch, write::SymbolBuffer};

use super::super::Scale;
use super::super::irregular::{Coded, code, refinement_of_lines, with_rings};
use super::super::summary::Times;
use super::{FEWEST, Joined};
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_stage::areas::{Areas, Jumps};
use lodpack_stage::certify::{CertifyOptions, Comparison, Surface, two_sided};
use lodpack_stage::simplify::{Early, LevelPatch, SimplifiedChart, SimplifyOptions, simplify_again};

/// Share by which a bound may exceed the distance of a group from its members.
const GAP: f64 = 0.1;
/// Distances below this share of a level's threshold need not be resolved.
const FLOOR: f64 = 0.1;
/// A group is simplified again if its finest level is farther off than this many times that level's tolerance: a group
/// that is off in one place is drawn only where all of it might be.
const TOO_FAR: f64 = 1.5;
/// How often at most.
const ATTEMPTS: u32 = 3;
/// Factor on a vertex's quadric, with every attempt, where the surface is too far off.
const IMPORTANCE_STEP: f32 = 8.0;

/// What the levels of a group are made with.
pub(super) struct Making<'a> {
    pub scale: &'a Scale,
    /// Where colours jump, if that is known.
    pub jumps: Option<&'a Jumps>,
    /// Coarse to fine.
    pub levels: [u8; 2],
    /// The surface that they are made from.
    pub below: &'a Joined,
    /// Whether that consists of many parts, most of which will be gone: then all is far off, whatever one does.
    pub is_of_small_parts: bool,
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
        let Coded { patch, symbols, areas, .. } = code(self.scale, level, &border, level_patch, refinement).ok()?;
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
        let mut compared = Comparison::new(&original, &drawn, &self.below.pairing(level), vec![]);
        let mut distance = compared.two_sided(&options).upper;
        if distance > self.too_far(level) && !self.is_of_small_parts {
            // A map may stretch over a fold that closest points do not see.
            distance = distance.min(two_sided(original.bvh(), drawn.bvh(), &options).upper);
        }
        times.certify += thread_cpu_time() - start;
        distance.is_finite().then_some(MadeLevel { patch, symbols, areas, points, positions, distance, compared })
    }

    /// The distance from which on a level is too far off.
    fn too_far(&self, level: u8) -> f64 {
        TOO_FAR * self.scale.levels[usize::from(level)].tolerance
    }

    /// Makes the finest level. Where it is too far off, simplifies again with more weight there, and takes what is
    /// nearest.
    pub fn make_finest(
        &self,
        joined: &Joined,
        simplified: &mut SimplifiedChart,
        early: &mut Option<Early>,
        times: &mut Times,
    ) -> Option<MadeLevel> {
        let [_, finest] = self.levels;
        let mut made = self.make(joined, finest, simplified.levels[usize::from(finest)].as_ref()?, times)?;
        // The last attempt, if it is not nearer: what is wrong with that has to weigh more, too.
        let mut worse: Option<MadeLevel> = None;
        let mut importance = vec![1.0; joined.positions.len()];
        for _ in 0..ATTEMPTS {
            if made.distance <= self.too_far(finest) {
                break;
            }
            let start = thread_cpu_time();
            let last = worse.as_mut().unwrap_or(&mut made);
            let far = last.compared.exceeding(self.scale.levels[usize::from(finest)].tolerance, u64::MAX);
            times.certify += thread_cpu_time() - start;
            let start = thread_cpu_time();
            for v in with_rings(&self.below.triangles, far, 1) {
                importance[v as usize] *= IMPORTANCE_STEP;
            }
            let again = self.simplify(joined, Some(&importance), Some(early));
            times.simplify += thread_cpu_time() - start;
            // With other weights a border may get stuck.
            let patch = again.levels[usize::from(finest)].as_ref().filter(|_| again.stuck.is_empty());
            let Some(next) = patch.and_then(|patch| self.make(joined, finest, patch, times)) else { break };
            if next.distance < made.distance {
                (made, *simplified, worse) = (next, again, None);
            } else {
                worse = Some(next);
            }
        }
        Some(made)
    }
}
