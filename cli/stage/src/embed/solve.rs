//! Rounds of solving and reweighting, and the remedies for triangles that rounding flips.

use glam::DVec2;

use super::chords::Refined;
use super::stretch::{Stretch, is_positive};
use super::system::System;
use super::{EmbedError, EmbedOptions};

/// Steps of iterative refinement to try on a map with flips.
const REFINEMENT_STEPS: usize = 2;
/// Shares of the latest map to try if it has flips and an earlier map has none.
const BLENDS: [f64; 4] = [0.75, 0.5, 0.25, 0.125];

/// The chosen map.
pub(super) struct Solution {
    pub uv: Vec<DVec2>,
    pub stretch: Stretch,
    pub flips_repaired: u32,
    pub residual: f64,
    pub conditioning: f64,
}

/// Solves with uniform weights, then with weights divided by stretch, and returns the most even map without flips.
///
/// `start` has the border in place and every other vertex at the centre.
pub(super) fn solve(refined: &Refined, start: Vec<DVec2>, options: &EmbedOptions) -> Result<Solution, EmbedError> {
    let Some(mut system) = System::new(refined)? else {
        let stretch = Stretch::measure(&refined.positions, &start, &refined.triangles);
        return accept(Solution { uv: start, stretch, flips_repaired: 0, residual: 0.0, conditioning: 1.0 });
    };
    let mut weights = first_weights(system.edges.len(), options.weight_decades);
    let mut best: Option<Solution> = None;
    let (mut flips_repaired, mut conditioning) = (0, 1.0f64);
    for round in 0..=options.reweightings {
        match system.factorise(&weights) {
            Err(_) if best.is_some() => break,
            other => other?,
        }
        conditioning = conditioning.max(system.conditioning());
        let mut uv = start.clone();
        system.improve(&weights, &mut uv);
        let mut stretch = Stretch::measure(&refined.positions, &uv, &refined.triangles);
        let flipped_count = stretch.flips.len();
        for _ in 0..REFINEMENT_STEPS {
            if stretch.flips.is_empty() {
                break;
            }
            system.improve(&weights, &mut uv);
            stretch = Stretch::measure(&refined.positions, &uv, &refined.triangles);
        }
        let residual = system.residual(&weights, &uv);
        if let Some(earlier) = &best
            && earlier.stretch.flips.is_empty()
            && !stretch.flips.is_empty()
            && let Some(blended) = blend(refined, &earlier.uv, &uv, &stretch.flips)
        {
            stretch = Stretch::measure(&refined.positions, &blended, &refined.triangles);
            uv = blended;
        }
        flips_repaired += flipped_count.saturating_sub(stretch.flips.len()) as u32;
        if round < options.reweightings {
            stretch.reweight(&refined.triangles, refined.vertex_count(), &system.edges, &mut weights);
        }
        let solution = Solution { uv, stretch, flips_repaired, residual, conditioning };
        match &mut best {
            Some(earlier) if is_worse(&solution, earlier) => {
                (earlier.flips_repaired, earlier.conditioning) = (flips_repaired, conditioning);
                break;
            }
            _ => best = Some(solution),
        }
    }
    best.map_or(Err(EmbedError::Factorisation), accept)
}

/// Uniform weights, or weights that a fixed sequence spreads over decades.
#[expect(clippy::disallowed_methods, reason = "only the self-test spreads weights")]
fn first_weights(count: usize, decades: f64) -> Vec<f64> {
    if decades == 0.0 {
        return vec![1.0; count];
    }
    // Multiples of the golden ratio are spread evenly, and successive ones are far apart.
    (0..count).map(|i| 10f64.powf(-decades * (i as f64 * 0.618_033_988_749_894_8).fract())).collect()
}

fn is_worse(a: &Solution, b: &Solution) -> bool {
    (a.stretch.flips.len(), a.stretch.total()) >= (b.stretch.flips.len(), b.stretch.total())
}

fn accept(solution: Solution) -> Result<Solution, EmbedError> {
    match solution.stretch.flips.len() {
        0 => Ok(solution),
        flipped_count => Err(EmbedError::Flipped { flipped_count }),
    }
}

/// The largest of the steps tried, from a map without flips towards one with flips, after which there are none.
fn blend(refined: &Refined, sound: &[DVec2], flipped: &[DVec2], flips: &[u32]) -> Option<Vec<DVec2>> {
    BLENDS.iter().find_map(|&share| {
        let uv: Vec<DVec2> =
            sound.iter().zip(flipped).map(|(&a, &b)| if a == b { a } else { a.lerp(b, share) }).collect();
        // Test the known flips first: they fail most often.
        let positive = |&t: &u32| is_positive(&uv, refined.triangles[t as usize]);
        let sound = flips.iter().all(positive) && (0..refined.triangles.len() as u32).all(|t| positive(&t));
        sound.then_some(uv)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embed::tests::grid;
    use crate::embed::{border, chords};
    use lodpack_mesh::Adjacency;

    fn refined_grid() -> (Refined, Vec<DVec2>) {
        let chart = grid(8, 8);
        let refined = chords::split_chords(&chart, Adjacency::new(&chart.triangles, chart.positions.len()));
        let start = border::place_border(&chart, 4, &refined);
        (refined, start)
    }

    #[test]
    fn blending_takes_the_largest_step_without_flips() {
        let (refined, start) = refined_grid();
        let sound = solve(&refined, start, &EmbedOptions::default()).unwrap().uv;
        // An inner vertex thrown across the polygon: half of the way still flips, a quarter does not.
        let mut flipped = sound.clone();
        flipped[40] += DVec2::new(0.6, 0.1);
        let flips = Stretch::measure(&refined.positions, &flipped, &refined.triangles).flips;
        assert!(!flips.is_empty());
        let blended = blend(&refined, &sound, &flipped, &flips).unwrap();
        assert!(refined.triangles.iter().all(|&t| is_positive(&blended, t)));
        assert_eq!(blended[40], sound[40].lerp(flipped[40], 0.25));
        let mut farther = sound.clone();
        farther[40] = sound[40].lerp(flipped[40], 0.5);
        assert!(!refined.triangles.iter().all(|&t| is_positive(&farther, t)));

        flipped[40] += DVec2::new(50.0, 0.0);
        assert_eq!(blend(&refined, &sound, &flipped, &flips), None);
    }

    #[test]
    fn refinement_reaches_the_solution_from_anywhere() {
        let (refined, mut uv) = refined_grid();
        let mut system = System::new(&refined).unwrap().unwrap();
        let weights: Vec<f64> = (0..system.edges.len()).map(|i| 1.0 + (i % 7) as f64).collect();
        system.factorise(&weights).unwrap();
        for (v, point) in uv.iter_mut().enumerate().filter(|&(v, _)| !refined.on_border[v]) {
            *point = DVec2::new((v as f64).sin(), (v as f64).cos());
        }
        assert!(system.residual(&weights, &uv) > 0.1);
        system.improve(&weights, &mut uv);
        assert!(system.residual(&weights, &uv) < 1e-14);
    }
}
