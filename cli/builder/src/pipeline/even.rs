//! Regions of nothing but even looks, as those of most designed parts: each triangle of a block has the look of the
//! area that it belongs to, so nothing is baked.

use std::collections::BTreeMap;
use std::time::Duration;

use glam::DVec3;
use lodpack::write::RootRecord;
use rayon::prelude::*;

use super::ChartedMesh;
use super::drawn::{DrawnBlocks, DrawnPatch};
use super::paint::PaintedRegion;
use super::region_progress::RegionProgress;
use super::texels::{InputSource, storage};
use lodpack_mesh::NONE;
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_stage::bake::{Palette, Points, Source, Storage};
use lodpack_stage::certify::{Hint, Surface};

/// As [`PaintedRegion::paint`], but a region of even looks gets palettes.
pub(super) fn paint(
    region: &PaintedRegion<'_>,
    records: &mut [RootRecord],
    drawn: &[DrawnBlocks],
    colour_step: u8,
    progress: &RegionProgress<'_>,
) -> (Duration, u64) {
    let start = thread_cpu_time();
    let storage = storage(region.appearance, colour_step);
    let Some(looks) = Looks::of(region, &storage) else {
        return region.paint(records, drawn, colour_step, progress);
    };
    looks.paint(records, drawn);
    (thread_cpu_time() - start, 0)
}

/// Whether the blocks of a region get palettes.
pub(super) fn are_palettes(charted: &ChartedMesh<'_>, storage: &Storage) -> bool {
    charted.areas.is_some_and(|areas| !areas.looks.is_empty() && Palette::fits(areas.looks.len(), storage))
}

/// The looks of a region.
struct Looks<'a> {
    region: &'a PaintedRegion<'a>,
    storage: &'a Storage,
    /// The values of each.
    values: BTreeMap<u32, Vec<f32>>,
    /// The input, for triangles of which nothing is known.
    positions: Vec<DVec3>,
}

impl<'a> Looks<'a> {
    /// None if something else than looks is seen, or if palettes of several colours cannot be stored.
    fn of(region: &'a PaintedRegion<'a>, storage: &'a Storage) -> Option<Self> {
        let (charted, looks) = (region.charted, &region.charted.areas?.looks);
        if !are_palettes(region.charted, storage) {
            return None;
        }
        let mut source = InputSource { own: looks.values().copied().collect(), ..region.input(vec![]) };
        let middle = Points::one([1.0 / 3.0; 3]);
        let of_look = |(number, &look): (usize, &u32)| {
            let mut values = vec![];
            source.shade(number, &[middle], 0.0, &mut values);
            (look, values)
        };
        let values = looks.keys().enumerate().map(of_look).collect();
        let positions = charted.mesh.positions.iter().map(|&position| charted.scale.local(position)).collect();
        Some(Self { region, storage, values, positions })
    }

    /// Gives the blocks of all records palettes. `drawn` is what they decode to.
    fn paint(&self, records: &mut [RootRecord], drawn: &[DrawnBlocks]) {
        let begun: Vec<Vec<Option<Begun>>> = drawn
            .par_iter()
            .map(|drawn| drawn.iter().map(|drawn| drawn.as_ref().map(|drawn| self.of_triangles(drawn))).collect())
            .collect();
        let middles: Vec<DVec3> = begun
            .iter()
            .flatten()
            .flatten()
            .flat_map(|block| block.unknown.iter().map(|&(_, middle)| middle))
            .collect();
        let mut found = self.nearest_looks(&middles).into_iter();
        let mut complete = |Begun { mut looks, unknown }: Begun| {
            unknown.iter().zip(&mut found).for_each(|(&(triangle, _), look)| looks[triangle] = look);
            looks
        };
        let mut looks: Vec<Vec<Option<Vec<u32>>>> = vec![];
        for blocks in begun {
            looks.push(blocks.into_iter().map(|block| block.map(&mut complete)).collect());
        }
        records.par_iter_mut().zip(drawn).zip(looks).for_each(|((record, drawn), looks)| {
            for ((block, drawn), looks) in record.blocks.iter_mut().zip(drawn).zip(looks) {
                let (Some(block), Some(drawn), Some(looks)) = (block, drawn, looks) else { continue };
                let palette = Palette::of_looks(&looks, &self.values, self.storage);
                let streams = palette.and_then(|palette| palette.streams(&drawn.baked(0.0, None)));
                block.texels = streams.unwrap_or_default();
            }
        });
    }

    /// The look of each triangle of a patch: that of its area; of a triangle that was put into a hole, that of one
    /// beside it. Of others nothing is known.
    fn of_triangles(&self, drawn: &DrawnPatch) -> Begun {
        let mut looks = drawn.areas.clone();
        looks.resize(drawn.triangles.len(), NONE);
        let mut of_vertices = vec![NONE; drawn.positions.len()];
        let mut unknown: Vec<usize> = vec![];
        for (triangle, (corners, &look)) in drawn.triangles.iter().zip(&looks).enumerate() {
            if self.values.contains_key(&look) {
                corners.iter().for_each(|&vertex| of_vertices[vertex as usize] = look);
            } else {
                unknown.push(triangle);
            }
        }
        loop {
            let before = unknown.len();
            unknown.retain(|&triangle| {
                let corners = drawn.triangles[triangle];
                let beside = corners.iter().map(|&vertex| of_vertices[vertex as usize]).find(|&look| look != NONE);
                if let Some(look) = beside {
                    looks[triangle] = look;
                    corners.iter().for_each(|&vertex| of_vertices[vertex as usize] = look);
                }
                beside.is_none()
            });
            if unknown.len() == before {
                break;
            }
        }
        let middle = |triangle: usize| {
            let corners = drawn.triangles[triangle]
                .map(|vertex| self.region.charted.scale.local_from_lattice(drawn.positions[vertex as usize]));
            (triangle, corners.iter().sum::<DVec3>() / 3.0)
        };
        Begun { looks, unknown: unknown.into_iter().map(middle).collect() }
    }

    /// The looks of the triangles of the input that are nearest to some points. They are looked for in one part of the
    /// input after the other: a hierarchy of a whole region takes more memory than all else.
    fn nearest_looks(&self, points: &[DVec3]) -> Vec<u32> {
        if points.is_empty() {
            return vec![];
        }
        let nearest = nearest(points, &self.positions, &self.region.charted.mesh.triangles, AT_ONCE);
        let areas = self.region.charted.areas.map_or(&[][..], |areas| &areas.of_triangles);
        nearest.into_iter().map(|triangle| areas.get(triangle as usize).copied().unwrap_or(NONE)).collect()
    }
}

/// The looks of a patch, as far as they are known.
struct Begun {
    /// Of each triangle.
    looks: Vec<u32>,
    /// The others, and their middles.
    unknown: Vec<(usize, DVec3)>,
}

/// Triangles of the input in a hierarchy, of some 200 bytes each.
const AT_ONCE: usize = 1 << 17;

/// The triangle that is nearest to each point.
fn nearest(points: &[DVec3], positions: &[DVec3], triangles: &[[u32; 3]], at_once: usize) -> Vec<u32> {
    let bounds_of = |part: &[[u32; 3]]| {
        let corners = part.iter().flatten().map(|&vertex| positions[vertex as usize]);
        corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
    };
    let parts: Vec<[DVec3; 2]> = triangles.par_chunks(at_once).map(bounds_of).collect();
    // No farther than the nearest of a few triangles of all parts: most points are looked for in one part alone.
    let step = parts.len().max(1);
    let some: Vec<[u32; 3]> = triangles.iter().step_by(step).copied().collect();
    let of_all = Surface::new(positions, &some);
    let first = |&point: &DVec3| {
        let closest = of_all.bvh().closest(point, &mut Hint::default());
        (closest.distance, closest.triangle.saturating_mul(step as u32))
    };
    let mut best: Vec<(f64, u32)> = points.par_iter().map(first).collect();
    drop(of_all);
    if step == 1 {
        return best.into_iter().map(|(_, triangle)| triangle).collect();
    }
    for (number, (part, &[low, high])) in triangles.chunks(at_once).zip(&parts).enumerate() {
        let first = (number * at_once) as u32;
        let surface = Surface::new(positions, part);
        best.par_iter_mut().zip(points).for_each(|((distance, triangle), &point)| {
            let outside = (low - point).max(point - high).max(DVec3::ZERO).length();
            if outside > *distance {
                return;
            }
            let closest = surface.bvh().closest(point, &mut Hint::default());
            if closest.distance < *distance {
                (*distance, *triangle) = (closest.distance, first + closest.triangle);
            }
        });
    }
    best.into_iter().map(|(_, triangle)| triangle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_triangle_is_the_same_in_parts() {
        let mut state = 5_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1 << 31)
        };
        let mut point = || DVec3::new(random(), random(), random());
        let mut positions = vec![];
        for _ in 0..300 {
            let (at, [a, b, c]) = (point() * 20.0, [point(), point(), point()]);
            positions.extend([at + a, at + b, at + c]);
        }
        let triangles: Vec<[u32; 3]> = (0..300).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let points: Vec<DVec3> = (0..500).map(|_| point() * 30.0 - 5.0).collect();
        let whole = nearest(&points, &positions, &triangles, 1000);
        assert!(whole.iter().all(|&triangle| triangle < 300));
        for at_once in [1, 7, 64, 299] {
            assert_eq!(nearest(&points, &positions, &triangles, at_once), whole, "{at_once}");
        }
    }
}
