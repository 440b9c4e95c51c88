//! Texels of a patch from those of finer patches, as points of the surface ([`Surfels`]).
//!
//! A point belongs where the patch is closest to it: there a viewer of the patch looks for it, and parts of a surface
//! that lie one above the other do not get each other's colours.

use std::ops::Range;

use glam::DVec3;
use lodpack::decode::texels::Map;

use super::BakedPatch;
use super::closest::OnMap;
use super::fill::finished;
use super::lanes::{LANES, whole};
use super::raster::Drawn;
use super::strangers::Strangers;
use super::surfels::{Run, Surfels};
use super::values::{Kept, Sums, Weight};
use crate::certify::{AROUND, Hint, Numbers, TOGETHER};
use crate::nearest::{Below, Blocks, Finder, Places};
use lodpack_mesh::NONE;

/// Points stand for squares. Those that are larger than this share of a texel are taken for four, so that no texel
/// between them is left out.
const LARGE: f64 = 0.71;

/// The values of all texels that are used, from the texels of finer patches.
pub(super) fn gather_surfels<'a>(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    surfels: impl Iterator<Item = &'a Surfels>,
    sums: Sums<'_>,
) -> Kept {
    let finder = Finder::on_map(patch, map, drawn);
    let mut gathering = Gathering {
        strangers: Strangers::new(patch, map, &[]),
        of_opposite: Weight::of_opposite(sums.storage),
        finder: &finder,
        bytes: sums.storage.packed_bytes(),
        sums,
        hint: Hint::default(),
        values: vec![],
    };
    let mut hint = Hint::default();
    let least = finder.places.least_size();
    for surfels in surfels {
        for run in &surfels.runs {
            // Long texels lie along long ones, so areas say which are larger.
            let fineness = if f64::from(run.size).sqrt() > LARGE * least { 2 } else { 1 };
            let points = Lattice::new(surfels, run, patch.origin(), fineness);
            finder.divide(&points, &mut hint, |block, below| gathering.add(&points, block, &below));
        }
    }
    finished(gathering.sums, patch, map, drawn)
}

/// What texels are made of.
struct Gathering<'a> {
    finder: &'a Finder<'a, OnMap<'a>>,
    strangers: Strangers,
    /// The weight of points whose closest triangle faces the other way.
    of_opposite: Weight,
    sums: Sums<'a>,
    /// Bytes of the values of a point.
    bytes: usize,
    hint: Hint,
    /// Memory for the values of a point.
    values: Vec<f32>,
}

/// Where the points that are closest to a triangle are shown.
#[derive(Clone, Copy, Default)]
struct Target {
    /// Its place in the map, then what each of two or three numbers adds to that.
    place: [[f32; 2]; 4],
    /// The least and the greatest place of its piece.
    range: [[f32; 2]; 2],
    piece: usize,
    /// What a point counts.
    weight: Weight,
}

impl Target {
    /// The place of a point, given its numbers.
    #[inline(always)]
    fn place<const N: usize>(&self, numbers: [f32; N]) -> [f32; 2] {
        let mut place = self.place[0];
        for (number, growth) in numbers.iter().zip(&self.place[1..]) {
            (0..2).for_each(|k| place[k] += number * growth[k]);
        }
        place
    }

    /// The texel of a place: what lies beyond the piece is taken to its edge, since other pieces lie there.
    #[inline(always)]
    fn texel(&self, place: [f32; 2], width: u32) -> u32 {
        let [low, high] = self.range;
        let along = |k: usize| {
            let place = if place[k] > low[k] { place[k] } else { low[k] };
            whole(if place < high[k] { place } else { high[k] })
        };
        along(1) * width + along(0)
    }
}

impl Gathering<'_> {
    /// Adds points to the texels that are closest to them.
    fn add(&mut self, points: &Lattice<'_>, block: &Square, below: &Below) {
        let (finder, width) = (self.finder, self.finder.places.map.size[0]);
        match below {
            Below::One(triangle) => {
                // Over one triangle places grow by the same from point to point.
                let target = self.target(points, *triangle, points.frame().map(|point| finder.foot(*triangle, point)));
                if target.weight.all > 0.0 {
                    points.for_each(block, |some| {
                        let mut texels = [0; TOGETHER];
                        for (k, texel) in texels.iter_mut().enumerate() {
                            *texel = target.texel(target.place([some.at[0][k], some.at[1][k], some.at[2][k]]), width);
                        }
                        for (&number, texel) in some.numbers[..some.count].iter().zip(texels) {
                            self.add_point(points, number, &target, texel);
                        }
                    });
                }
            }
            Below::Any(Some(around)) => {
                let few = finder.bvh.few(around, points.origin);
                let mut targets = [Target::default(); AROUND];
                let of_triangles = finder.bvh.numbers(around).zip(finder.bvh.frames(around));
                for (target, (triangle, [start, along, across])) in targets.iter_mut().zip(of_triangles) {
                    let frame = [start, start + along, start + across, start];
                    *target = self.target(points, triangle, frame.map(|point| finder.places.place(triangle, point)));
                }
                let steps = points.run.steps.map(|step| step.to_array());
                points.for_each(block, |some| {
                    let mut places = [[0.0; TOGETHER]; 3];
                    for (axis, places) in places.iter_mut().enumerate() {
                        for (k, place) in places.iter_mut().enumerate() {
                            *place = (0..3).map(|step| steps[step][axis] * some.at[step][k]).sum();
                        }
                    }
                    let feet = few.closest(&places);
                    for (k, &number) in some.numbers[..some.count].iter().enumerate() {
                        let target = &targets[feet.which[k] as usize];
                        let texel = target.texel(target.place([feet.at[0][k], feet.at[1][k]]), width);
                        self.add_point(points, number, target, texel);
                    }
                });
            }
            Below::Any(None) => points.for_each(block, |some| {
                for (k, &number) in some.numbers[..some.count].iter().enumerate() {
                    let at = some.at.map(|at| f64::from(at[k]));
                    let closest = finder.bvh.closest(points.place(at), &mut self.hint);
                    if closest.triangle != NONE {
                        let place = finder.places.place(closest.triangle, closest.point);
                        let target = self.target(points, closest.triangle, [place; 4]);
                        self.add_point(points, number, &target, target.texel(target.place([]), width));
                    }
                }
            }),
        }
    }

    /// Where those points of a run are shown that are closest to a triangle. Given are the places of the first of some
    /// points and of the ones of which one number is larger by 1.
    fn target(&self, points: &Lattice<'_>, triangle: u32, [first, others @ ..]: [[f64; 2]; 4]) -> Target {
        let [x, y, z] = others.map(|place| [0, 1].map(|k| (place[k] - first[k]) as f32));
        let share = if self.finder.faces(triangle, points.run.normal) { Weight::even(1.0) } else { self.of_opposite };
        Target {
            place: [first.map(|x| x as f32), x, y, z],
            range: self.finder.places.range(triangle).map(|corner| corner.map(|x| x as f32)),
            piece: usize::from(self.finder.places.map.labels[triangle as usize]),
            weight: share.times(points.weight),
        }
    }

    /// Adds a point to a texel.
    #[inline]
    fn add_point(&mut self, points: &Lattice<'_>, number: u32, target: &Target, texel: u32) {
        let (number, texel) = (number as usize, texel as usize);
        let is_wanted = target.weight.all > 0.0 && self.finder.places.drawn.is_used[texel];
        if is_wanted && !self.is_strange(points, number, target.piece) {
            self.sums.add_packed(texel, points.surfels.packed(number, self.bytes), target.weight, &mut self.values);
        }
    }

    /// Whether a piece must not show a point.
    #[inline]
    fn is_strange(&self, points: &Lattice<'_>, number: usize, piece: usize) -> bool {
        !self.strangers.of(piece).is_empty()
            && points.surfels.area(points.run, number).is_some_and(|area| self.strangers.has(piece, area))
    }
}

/// Some points of a run.
struct SomePoints {
    /// The texel of each.
    numbers: [u32; TOGETHER],
    /// Column, row and depth of each.
    at: [Numbers; 3],
    count: usize,
}

/// The points of a run: its texels, or four of each.
struct Lattice<'a> {
    surfels: &'a Surfels,
    run: &'a Run,
    /// The number of the first texel of each row.
    starts: [usize; LANES],
    /// Points for each texel along both directions.
    fineness: usize,
    /// The middle of the first texel, relative to the patch's first vertex.
    origin: DVec3,
    /// From a texel to the one beside it, to the one below it, and along the axis by one step of depth.
    steps: [DVec3; 3],
    /// What a point counts.
    weight: f32,
}

/// Some points of a run.
struct Square {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl<'a> Lattice<'a> {
    fn new(surfels: &'a Surfels, run: &'a Run, origin: DVec3, fineness: usize) -> Self {
        let (mut starts, mut next) = ([0; LANES], run.first);
        for (start, bits) in starts.iter_mut().zip(run.rows) {
            *start = next;
            next += bits.count_ones() as usize;
        }
        Self {
            surfels,
            run,
            starts,
            fineness,
            origin: run.origin - origin,
            steps: run.steps.map(|step| step.as_dvec3()),
            weight: run.size / (fineness * fineness) as f32,
        }
    }

    /// The column or row of a point, in steps of the run.
    fn at(&self, number: usize) -> f64 {
        (number as f64 + 0.5) / self.fineness as f64 - 0.5
    }

    fn place(&self, at: [f64; 3]) -> DVec3 {
        self.origin + (0..3).map(|k| self.steps[k] * at[k]).sum::<DVec3>()
    }

    /// The first point, and those of which the column, the row or the depth is larger by 1.
    fn frame(&self) -> [DVec3; 4] {
        let [beside, below, deeper] = self.steps;
        [self.origin, self.origin + beside, self.origin + below, self.origin + deeper]
    }

    /// The texels of a row of the run that have points in some columns.
    fn texels(&self, row: usize, columns: &Range<usize>) -> Range<usize> {
        let below = |column: usize| (1_u32 << column) - 1;
        let bits = u32::from(self.run.rows[row]);
        let [before, until] = [columns.start / self.fineness, columns.end.div_ceil(self.fineness)]
            .map(|column| (bits & below(column)).count_ones() as usize);
        self.starts[row] + before..self.starts[row] + until
    }

    /// The rows of the run that have points in a block.
    fn rows(&self, block: &Square) -> Range<usize> {
        block.rows.start / self.fineness..block.rows.end.div_ceil(self.fineness)
    }

    /// Calls a function with the points of a block.
    #[inline]
    fn for_each(&self, block: &Square, mut visit: impl FnMut(&SomePoints)) {
        let mut some = SomePoints { numbers: [0; TOGETHER], at: [[0.0; TOGETHER]; 3], count: 0 };
        let fineness = self.fineness;
        for y in block.rows.clone() {
            let (row, down) = (y / fineness, self.at(y) as f32);
            let mut bits = self.run.rows[row] >> (block.columns.start / fineness);
            let mut column = block.columns.start / fineness;
            for number in self.texels(row, &block.columns) {
                let gap = bits.trailing_zeros();
                (bits, column) = (bits >> gap, column + gap as usize);
                let depth = f32::from(self.surfels.depths[number]);
                let own =
                    (column * fineness).max(block.columns.start)..((column + 1) * fineness).min(block.columns.end);
                for x in own {
                    some.numbers[some.count] = number as u32;
                    [some.at[0][some.count], some.at[1][some.count], some.at[2][some.count]] =
                        [self.at(x) as f32, down, depth];
                    some.count += 1;
                    if some.count == TOGETHER {
                        visit(&some);
                        some.count = 0;
                    }
                }
                (bits, column) = (bits >> 1, column + 1);
            }
        }
        if some.count > 0 {
            visit(&some);
        }
    }
}

impl Blocks for Lattice<'_> {
    type Block = Square;
    type Corners = [DVec3; 8];

    fn whole(&self) -> Square {
        let all = 0..LANES * self.fineness;
        Square { columns: all.clone(), rows: all }
    }

    fn bounds(&self, block: &Square) -> (usize, [DVec3; 8]) {
        let (mut count, mut low, mut high) = (0, u16::MAX, 0);
        for row in self.rows(block) {
            let texels = self.texels(row, &block.columns);
            count += texels.len();
            for &depth in &self.surfels.depths[texels] {
                (low, high) = (low.min(depth), high.max(depth));
            }
        }
        let ends = |range: &Range<usize>| [range.start, range.end - 1].map(|number| self.at(number));
        let of = [ends(&block.columns), ends(&block.rows), [low, high].map(f64::from)];
        let [along, down, up] = [0, 1, 2].map(|k| of[k].map(|at| self.steps[k] * at));
        let corner = |corner: usize| self.origin + along[corner & 1] + down[corner >> 1 & 1] + up[corner >> 2];
        // Those at an edge may have half of their points in another block.
        (count * self.fineness * self.fineness, std::array::from_fn(corner))
    }

    fn halves(&self, block: Square) -> [Square; 2] {
        let Square { columns, rows } = block;
        if columns.len() >= rows.len() {
            let middle = columns.start.midpoint(columns.end);
            [columns.start..middle, middle..columns.end].map(|columns| Square { columns, rows: rows.clone() })
        } else {
            let middle = rows.start.midpoint(rows.end);
            [rows.start..middle, middle..rows.end].map(|rows| Square { columns: columns.clone(), rows })
        }
    }
}

#[cfg(test)]
mod tests;
