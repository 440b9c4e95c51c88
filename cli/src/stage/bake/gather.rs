//! Collects for each texel what the input shows there.

use glam::{DVec3, Vec3};
use lodpack::decode::texels::{Map, Piece};

use super::raster::{Drawn, for_each_sample, texel_at};
use super::{BakedPatch, Source, ValueKinds};
use crate::stage::certify::{Hint, TriangleBvh};

/// Triangles shorter than this many texels are sampled at four points of each texel.
const SHORT: f64 = 4.0;
/// The input is looked for within this multiple of the patch's reach along the axis of a piece, which is inclined to the surface.
const REACH: f64 = 3.0;
/// Cosine of the angle to an axis beyond which points of finer patches are not shown by a piece.
const STEEP: f64 = 0.1;
/// Covered texels for each that may be missing.
const FEW: usize = 50;
/// And within this many texels more.
const REACH_TEXELS: f64 = 1.5;

/// Weighted sums of values by texel. Colours are weighted with their opacity, and missing scalars do not count.
struct Sums {
    kinds: ValueKinds,
    /// The values of each texel.
    sums: Vec<f32>,
    /// The weights: of all samples, and of those that have the scalar.
    weights: Vec<f32>,
}

impl Sums {
    fn new(texels: usize, kinds: ValueKinds) -> Self {
        let weights = texels * (1 + kinds.scalars);
        Self { kinds, sums: vec![0.0; texels * kinds.count()], weights: vec![0.0; weights] }
    }

    fn add(&mut self, texel: usize, values: &[f32], weight: f32) {
        let count = self.kinds.count();
        let sums = &mut self.sums[texel * count..][..count];
        let weights = &mut self.weights[texel * (1 + self.kinds.scalars)..][..1 + self.kinds.scalars];
        weights[0] += weight;
        let (mut sums, mut values) = (sums, values);
        if self.kinds.has_colour {
            let share = weight * values[3];
            (0..3).for_each(|k| sums[k] += values[k] * share);
            sums[3] += share;
            (sums, values) = (&mut sums[4..], &values[4..]);
        }
        for ((sum, &value), of_scalar) in sums.iter_mut().zip(values).zip(&mut weights[1..]) {
            if !value.is_nan() {
                (*sum, *of_scalar) = (*sum + value * weight, *of_scalar + weight);
            }
        }
    }

    fn has(&self, texel: usize) -> bool {
        self.weights[texel * (1 + self.kinds.scalars)] > 0.0
    }

    /// The means, and those of their neighbours where nothing was found.
    fn finish(mut self, map: &Map, drawn: &Drawn) -> Vec<f32> {
        self.divide();
        spread(map.size[0] as usize, &mut self, &drawn.is_used);
        self.sums
    }

    /// Replaces the sums by means.
    fn divide(&mut self) {
        let count = self.kinds.count();
        let texels = self.sums.chunks_exact_mut(count).zip(self.weights.chunks_exact(1 + self.kinds.scalars));
        for (mut sums, weights) in texels {
            if self.kinds.has_colour {
                let inverse = if sums[3] > 0.0 { 1.0 / sums[3] } else { 0.0 };
                sums[..3].iter_mut().for_each(|sum| *sum *= inverse);
                sums[3] = if weights[0] > 0.0 { sums[3] / weights[0] } else { 1.0 };
                sums = &mut sums[4..];
            }
            sums.iter_mut().zip(&weights[1..]).for_each(|(sum, &weight)| *sum /= weight);
        }
    }
}

/// The values of all texels that are used, from the triangles of a source.
pub(super) fn gather(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    source: &mut impl Source,
    kinds: ValueKinds,
) -> Vec<f32> {
    let mut sums = Sums::new(drawn.depth.len(), kinds);
    let pieces = projections(patch, map);
    let mut samples = Samples::default();
    for triangle in 0..source.triangle_count() {
        let corners = source.corners(triangle);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let low = corners[0].min(corners[1]).min(corners[2]);
        let high = corners[0].max(corners[1]).max(corners[2]);
        for projection in &pieces {
            if projection.touches([low, high]) && normal.dot(projection.normal) > 0.0 {
                projection.find(corners, patch, map, drawn, &mut samples);
                samples.add_to(&mut sums, triangle, source);
            }
        }
    }
    add_closest(map, drawn, &pieces, source, &mut sums);
    sums.finish(map, drawn)
}

/// The values of all texels that are used, from the texels of finer patches.
pub(super) fn gather_surfels(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    surfels: &[Surfels],
    kinds: ValueKinds,
) -> Vec<f32> {
    let mut sums = Sums::new(drawn.depth.len(), kinds);
    for projection in projections(patch, map) {
        let reach = projection.reach(patch);
        for run in surfels.iter().filter(|run| run.normal.dot(projection.normal) > STEEP) {
            if !projection.touches(run.bounds) {
                continue;
            }
            for (point, values) in run.points.iter().zip(run.values.chunks_exact(kinds.count())) {
                let point = run.origin + Vec3::from(*point).as_dvec3();
                let place = projection.piece.unbounded(point.to_array());
                let [low, high] = projection.piece.range();
                if (0..2).any(|k| place[k] < low[k] - 0.5 || place[k] >= high[k] + 0.5) {
                    continue;
                }
                let texel = texel_at(place, map.size);
                let depth = (point.dot(projection.normal) / projection.size) as f32;
                // Comparisons with NaN are false.
                if (drawn.depth[texel] - depth).abs() <= reach {
                    sums.add(texel, values, run.area);
                }
            }
        }
    }
    sums.finish(map, drawn)
}

/// Texels of a piece as points of the surface, for the images of coarser patches.
#[derive(Clone, Debug, Default)]
pub struct Surfels {
    /// To which points are relative.
    origin: DVec3,
    /// Smallest and largest point.
    bounds: [DVec3; 2],
    /// The axis of the piece.
    normal: DVec3,
    /// The area of a texel.
    area: f32,
    points: Vec<[f32; 3]>,
    /// Of each point all values.
    values: Vec<f32>,
}

/// The covered texels of a patch.
pub(super) fn surfels(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    values: &[f32],
    kinds: ValueKinds,
) -> Vec<Surfels> {
    let (width, count) = (map.size[0] as usize, kinds.count());
    let mut all = vec![];
    for projection in projections(patch, map) {
        let [low, high] = projection.piece.range();
        let area = (projection.size * projection.size) as f32;
        let mut run = Surfels { normal: projection.normal, area, ..Surfels::default() };
        run.bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for y in low[1] as usize..=high[1] as usize {
            for x in low[0] as usize..=high[0] as usize {
                let texel = y * width + x;
                if !drawn.is_covered[texel] {
                    continue;
                }
                let point = projection.point([x as f64 + 0.5, y as f64 + 0.5], f64::from(drawn.depth[texel]));
                if run.points.is_empty() {
                    run.origin = point;
                }
                run.bounds = [run.bounds[0].min(point), run.bounds[1].max(point)];
                run.points.push((point - run.origin).as_vec3().to_array());
                run.values.extend(&values[texel * count..][..count]);
            }
        }
        if !run.points.is_empty() {
            all.push(run);
        }
    }
    all
}

/// All pieces of a map.
fn projections<'a>(patch: &BakedPatch<'_>, map: &'a Map) -> Vec<Projection<'a>> {
    let mut pieces: Vec<Projection> = map.pieces.iter().map(Projection::new).collect();
    for (corners, &label) in patch.triangles.iter().zip(&map.labels) {
        let [low, high] = &mut pieces[usize::from(label)].bounds;
        for &corner in corners {
            let point = DVec3::from(patch.positions[corner as usize].map(|x| x as f64));
            (*low, *high) = (low.min(point), high.max(point));
        }
    }
    for projection in &mut pieces {
        let margin = DVec3::splat(f64::from(projection.reach(patch)) * projection.size);
        projection.bounds = [projection.bounds[0] - margin, projection.bounds[1] + margin];
    }
    pieces
}

/// Points of a triangle, each on a texel.
#[derive(Default)]
struct Samples {
    texels: Vec<usize>,
    points: Vec<[f32; 3]>,
    /// The weight of each of them.
    weight: f32,
    /// What they stand for, lattice units.
    footprint: f64,
    values: Vec<f32>,
}

impl Samples {
    /// Adds their values, and forgets them.
    fn add_to(&mut self, sums: &mut Sums, triangle: usize, source: &mut impl Source) {
        if !self.points.is_empty() {
            source.shade(triangle, &self.points, self.footprint as f32, &mut self.values);
            for (&texel, values) in self.texels.iter().zip(self.values.chunks_exact(sums.kinds.count())) {
                sums.add(texel, values, self.weight);
            }
        }
        self.texels.clear();
        self.points.clear();
        self.values.clear();
    }
}

/// A piece, and what its projection needs.
struct Projection<'a> {
    piece: &'a Piece,
    normal: DVec3,
    /// Size of a texel, lattice units.
    size: f64,
    /// Around what may be shown.
    bounds: [DVec3; 2],
}

impl<'a> Projection<'a> {
    fn new(piece: &'a Piece) -> Self {
        let (normal, size) = piece.frame();
        let bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        Self { piece, normal: DVec3::from(normal), size, bounds }
    }

    /// How far the input is looked for along the axis, in texels.
    fn reach(&self, patch: &BakedPatch<'_>) -> f32 {
        (patch.reach * REACH / self.size + REACH_TEXELS) as f32
    }

    fn touches(&self, [low, high]: [DVec3; 2]) -> bool {
        low.cmple(self.bounds[1]).all() && high.cmpge(self.bounds[0]).all()
    }

    /// Finds the texels that a triangle of the source covers.
    fn find(&self, corners: [DVec3; 3], patch: &BakedPatch<'_>, map: &Map, drawn: &Drawn, samples: &mut Samples) {
        let places = corners.map(|corner| self.piece.unbounded(corner.to_array()));
        let [low, high] = self.piece.range();
        let least = [0, 1].map(|k| places[0][k].min(places[1][k]).min(places[2][k]));
        let most = [0, 1].map(|k| places[0][k].max(places[1][k]).max(places[2][k]));
        if (0..2).any(|k| most[k] < low[k] - 0.5 || least[k] > high[k] + 0.5) {
            return;
        }
        let depths = corners.map(|corner| corner.dot(self.normal) / self.size);
        let reach = self.reach(patch);
        let width = map.size[0] as usize;
        let mut visit = |texel: usize, weights: [f64; 3]| {
            let depth = weights[0] * depths[0] + weights[1] * depths[1] + weights[2] * depths[2];
            let [x, y] = [texel % width, texel / width].map(|x| x as f64 + 0.5);
            let is_within = low[0] <= x && x <= high[0] && low[1] <= y && y <= high[1];
            // Comparisons with NaN are false.
            if is_within && (drawn.depth[texel] - depth as f32).abs() <= reach {
                samples.texels.push(texel);
                samples.points.push(weights.map(|weight| weight as f32));
            }
        };
        let length = (most[0] - least[0]).max(most[1] - least[1]);
        if length < 1.0 {
            let middle = [0, 1].map(|k| (places[0][k] + places[1][k] + places[2][k]) / 3.0);
            let [a, b, c] = places;
            let area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
            if (0..2).all(|k| low[k] - 0.5 <= middle[k] && middle[k] < high[k] + 0.5) && area > 0.0 {
                visit(texel_at(middle, map.size), [1.0 / 3.0; 3]);
            }
            (samples.weight, samples.footprint) = (area as f32, length * self.size);
        } else if length < SHORT {
            for_each_sample(places, map.size, 2, visit);
            (samples.weight, samples.footprint) = (0.25, 0.5 * self.size);
        } else {
            for_each_sample(places, map.size, 1, visit);
            (samples.weight, samples.footprint) = (1.0, self.size);
        }
    }

    /// The point of the patch at a texel.
    fn point(&self, place: [f64; 2], depth: f64) -> DVec3 {
        let origin = self.piece.unbounded([0.0; 3]);
        let axes = DVec3::AXES.map(|axis| {
            let image = self.piece.unbounded(axis.to_array());
            [image[0] - origin[0], image[1] - origin[1]]
        });
        let across = [0, 1].map(|k| DVec3::new(axes[0][k], axes[1][k], axes[2][k]) * (self.size * self.size));
        across[0] * (place[0] - origin[0]) + across[1] * (place[1] - origin[1]) + self.normal * (depth * self.size)
    }
}

/// Gives covered texels to which nothing was projected the values of the input's closest point, unless they are few.
fn add_closest(map: &Map, drawn: &Drawn, pieces: &[Projection<'_>], source: &mut impl Source, sums: &mut Sums) {
    let width = map.size[0] as usize;
    let bare: Vec<usize> =
        (0..drawn.depth.len()).filter(|&texel| drawn.is_covered[texel] && !sums.has(texel)).collect();
    // Neighbours serve where few are missing.
    let covered = drawn.is_covered.iter().filter(|&&covered| covered).count();
    if bare.len() <= covered / FEW || source.triangle_count() == 0 {
        return;
    }
    let positions: Vec<DVec3> = (0..source.triangle_count()).flat_map(|triangle| source.corners(triangle)).collect();
    let triangles: Vec<[u32; 3]> = (0..source.triangle_count() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let bvh = TriangleBvh::new(&positions, &triangles);
    let (mut hint, mut values) = (Hint::default(), vec![]);
    for texel in bare {
        let place = [texel % width, texel / width].map(|x| x as f64 + 0.5);
        let holds = |projection: &&Projection<'_>| {
            let [low, high] = projection.piece.range();
            (0..2).all(|k| low[k] <= place[k] && place[k] <= high[k])
        };
        let Some(projection) = pieces.iter().find(holds) else { continue };
        let point = projection.point(place, f64::from(drawn.depth[texel]));
        let closest = bvh.closest(point, &mut hint);
        let weights = barycentric(source.corners(closest.triangle as usize), closest.point);
        values.clear();
        source.shade(closest.triangle as usize, &[weights], projection.size as f32, &mut values);
        sums.add(texel, &values, 1.0);
    }
}

/// The weights of the corners of a triangle at a point of it.
fn barycentric([a, b, c]: [DVec3; 3], point: DVec3) -> [f32; 3] {
    let normal = (b - a).cross(c - a);
    let squared = normal.length_squared();
    if squared <= 0.0 || squared.is_nan() {
        return [1.0, 0.0, 0.0];
    }
    let of_b = (point - a).cross(c - a).dot(normal) / squared;
    let of_c = (b - a).cross(point - a).dot(normal) / squared;
    let [of_b, of_c] = [of_b.clamp(0.0, 1.0), of_c.clamp(0.0, 1.0)];
    [(1.0 - of_b - of_c).max(0.0) as f32, of_b as f32, of_c as f32]
}

/// Gives the texels that are left the mean of their neighbours, ring by ring. Sums are means by now.
fn spread(width: usize, sums: &mut Sums, is_used: &[bool]) {
    let mut known: Vec<bool> = (0..is_used.len()).map(|texel| sums.has(texel)).collect();
    let mut left: Vec<usize> = (0..is_used.len()).filter(|&texel| is_used[texel] && !known[texel]).collect();
    let (count, height) = (sums.kinds.count(), is_used.len() / width.max(1));
    while !left.is_empty() {
        let mut found = vec![];
        for &texel in &left {
            let (x, y) = (texel % width, texel / width);
            let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
            let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
            let (mut mean, mut neighbours) = (vec![0.0; count], 0.0);
            let around = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
            for neighbour in around.filter(|&neighbour| known[neighbour]) {
                let values = &sums.sums[neighbour * count..][..count];
                mean.iter_mut().zip(values).for_each(|(sum, &value)| *sum += value);
                neighbours += 1.0;
            }
            if neighbours > 0.0 {
                mean.iter_mut().for_each(|sum| *sum /= neighbours);
                found.push((texel, mean));
            }
        }
        if found.is_empty() {
            break;
        }
        for (texel, mean) in found {
            sums.sums[texel * count..][..count].copy_from_slice(&mean);
            known[texel] = true;
        }
        left.retain(|&texel| !known[texel]);
    }
}
