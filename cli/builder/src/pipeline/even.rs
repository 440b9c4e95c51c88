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
        let input = Surface::new(&self.positions, &self.region.charted.mesh.triangles);
        records.par_iter_mut().zip(drawn).for_each(|(record, drawn)| {
            for (block, drawn) in record.blocks.iter_mut().zip(drawn) {
                let (Some(block), Some(drawn)) = (block, drawn) else { continue };
                let palette = Palette::of_looks(&self.of_triangles(drawn, &input), &self.values, self.storage);
                let streams = palette.and_then(|palette| palette.streams(&drawn.baked(0.0, None)));
                block.texels = streams.unwrap_or_default();
            }
        });
    }

    /// The look of each triangle of a patch: that of its area; of a triangle that was put into a hole, that of one
    /// beside it; otherwise that of the nearest triangle of the input.
    fn of_triangles(&self, drawn: &DrawnPatch, input: &Surface<'_>) -> Vec<u32> {
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
        let areas = self.region.charted.areas.map_or(&[][..], |areas| &areas.of_triangles);
        for triangle in unknown {
            let corners = drawn.triangles[triangle]
                .map(|vertex| self.region.charted.scale.local_from_lattice(drawn.positions[vertex as usize]));
            let middle = corners.iter().sum::<DVec3>() / 3.0;
            let nearest = input.bvh().closest(middle, &mut Hint::default()).triangle;
            looks[triangle] = areas.get(nearest as usize).copied().unwrap_or(NONE);
        }
        looks
    }
}
