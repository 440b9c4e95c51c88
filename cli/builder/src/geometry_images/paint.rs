//! Values of what the surface carries at the samples of quads.

use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::product::{AtlasChart, AtlasProduct};
use super::quads::sample_quads;
use super::sides::SideId;
use lodpack_mesh::NONE;
use lodpack_stage::embed::{Location, Locator, quad_point};
use lodpack_stage::shade::{Face, Painter, Shader};

/// Paints the charts of an atlas.
pub(super) struct Painting<'a> {
    product: &'a AtlasProduct,
    shader: &'a Shader<'a>,
    sides_of: &'a [Vec<SideId>],
    /// How each chart is drawn.
    drawings: Vec<u16>,
}

/// The values along the sides of charts, by chart and side: only those of sides that others take theirs from.
pub(super) type Borders<T> = Vec<Vec<Vec<T>>>;

impl<'a> Painting<'a> {
    pub fn new(product: &'a AtlasProduct, shader: &'a Shader<'a>, sides_of: &'a [Vec<SideId>]) -> Self {
        let drawing = |chart: &AtlasChart| chart.numbers.first().map_or(0, |&first| product.looks.drawing(first));
        Self { product, shader, sides_of, drawings: product.charts.iter().map(drawing).collect() }
    }

    pub fn drawing(&self, chart: usize) -> u16 {
        self.drawings[chart]
    }

    /// The side whose values a side takes: the first one along the arc that is drawn alike. Where the two sides of an
    /// arc are not, as glass in a frame, each has its own, so that neither bleeds into the other.
    fn owner(&self, chart: usize, side: usize) -> SideId {
        let half = self.product.charts[chart].sides[side];
        let is_alike = |id: &&SideId| self.drawings[id.chart as usize] == self.drawings[chart];
        let own = SideId { chart: chart as u32, side: side as u32, reversed: half.reversed };
        self.sides_of[half.arc as usize].iter().find(is_alike).copied().unwrap_or(own)
    }

    /// Evaluates the sides of all charts. Ends of sides that are one point and drawn alike have one value.
    pub fn borders<T: Copy + Send>(
        &self,
        resolution: u32,
        value: &(impl Fn(&Face, [f32; 3], f32) -> T + Sync),
    ) -> Borders<T> {
        let charts = &self.product.charts;
        let steps = 2usize << resolution;
        let of_chart = |(number, chart): (usize, &AtlasChart)| {
            let mut surface = ChartSurface::new(self, chart, resolution);
            let is_own = |side: usize| {
                let owner = self.owner(number, side);
                (owner.chart as usize, owner.side as usize) == (number, side)
            };
            let of_side = |side: usize| -> Vec<T> {
                if !is_own(side) {
                    return vec![];
                }
                (0..=steps).map(|k| surface.on_side(side, k as f64 / steps as f64, value)).collect()
            };
            (0..chart.sides.len()).map(of_side).collect()
        };
        let mut borders: Borders<T> = charts.par_iter().enumerate().map(of_chart).collect();
        // Only looked up, because its order is random.
        let mut corners: HashMap<([u64; 3], u16), T> = HashMap::new();
        for (number, (chart, sides)) in charts.iter().zip(&mut borders).enumerate() {
            let count = sides.len();
            for (side, values) in sides.iter_mut().enumerate().filter(|(_, values)| !values.is_empty()) {
                for (corner, place) in [(side, 0), ((side + 1) % count, steps)] {
                    let position = corner_position(chart, corner).to_array().map(f64::to_bits);
                    let known = corners.entry((position, self.drawings[number])).or_insert(values[place]);
                    values[place] = *known;
                }
            }
        }
        borders
    }

    /// The images of a chart's quads, row by row.
    pub fn quads<T: Copy>(
        &self,
        number: usize,
        resolution: u32,
        borders: &Borders<T>,
        value: &impl Fn(&Face, [f32; 3], f32) -> T,
    ) -> Vec<Vec<T>> {
        let chart = &self.product.charts[number];
        let side = |side: usize| {
            let owner = self.owner(number, side);
            let mut values = borders[owner.chart as usize][owner.side as usize].clone();
            if owner.reversed != chart.sides[side].reversed {
                values.reverse();
            }
            values
        };
        let sides: Vec<Vec<T>> = (0..chart.sides.len()).map(side).collect();
        let mut surface = ChartSurface::new(self, chart, resolution);
        sample_quads(resolution, &sides, |quad, s, t| surface.within(quad, s, t, value))
    }
}

/// Where a chart's corner is.
fn corner_position(chart: &AtlasChart, corner: usize) -> DVec3 {
    let first = chart.mesh.loops.first().and_then(|border| border.iter().find(|v| v.side as usize == corner));
    first.map_or(DVec3::NAN, |v| chart.mesh.positions[v.vertex as usize])
}

/// Evaluates the points of a chart. Samples that follow each other mostly lie in one triangle.
struct ChartSurface<'a> {
    chart: &'a AtlasChart,
    painter: Painter<'a>,
    locator: Locator<'a>,
    hint: u32,
    /// For each triangle the distance of samples on the surface.
    footprints: Vec<f32>,
    /// The triangle beside the border's edge that begins with each of its vertices.
    beside: HashMap<u32, u32>,
    latest: Option<(u32, Face<'a>)>,
}

impl<'a> ChartSurface<'a> {
    fn new(painting: &Painting<'a>, chart: &'a AtlasChart, resolution: u32) -> Self {
        let border = chart.mesh.loops.first().map_or(&[][..], Vec::as_slice);
        let next = border.iter().cycle().skip(1);
        let edges: HashMap<u32, u32> = border.iter().zip(next).map(|(from, to)| (from.vertex, to.vertex)).collect();
        let mut beside = HashMap::new();
        for (number, &[a, b, c]) in (0..).zip(&chart.mesh.triangles) {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if edges.get(&from) == Some(&to) {
                    beside.insert(from, number);
                }
            }
        }
        Self {
            painter: painting.shader.painter(&painting.product.looks.attributes),
            locator: chart.embedding.locator(),
            hint: 0,
            footprints: footprints(chart, resolution),
            beside,
            latest: None,
            chart,
        }
    }

    /// The value at a point of a quad.
    fn within<T>(&mut self, quad: usize, s: f64, t: f64, value: &impl Fn(&Face, [f32; 3], f32) -> T) -> T {
        let embedding = &self.chart.embedding;
        let point = quad_point(embedding.corner_count, quad, s, t);
        // The map covers the polygon, but for rounding.
        let fallback = Location { triangle: self.hint, barycentric: [1.0 / 3.0; 3] };
        let location = self.locator.find(point, self.hint).unwrap_or(fallback);
        self.hint = location.triangle;
        let triangle = embedding.chart_triangle(location.triangle);
        let corners = self.chart.mesh.triangles[triangle as usize];
        let mut weights = [0.0; 3];
        let vertices = self.chart.mesh.positions.len();
        for (&vertex, share) in embedding.triangles[location.triangle as usize].iter().zip(location.barycentric) {
            let [a, b] = match (vertex as usize).checked_sub(vertices) {
                None => [vertex; 2],
                Some(chord) => embedding.chords[chord],
            };
            for (weight, corner) in weights.iter_mut().zip(corners) {
                *weight += 0.5 * share * f64::from(u8::from(corner == a) + u8::from(corner == b));
            }
        }
        self.at(triangle, weights, value)
    }

    /// The value at a point of a side.
    fn on_side<T>(&mut self, side: usize, param: f64, value: &impl Fn(&Face, [f32; 3], f32) -> T) -> T {
        let border = self.chart.mesh.loops.first().map_or(&[][..], Vec::as_slice);
        // The vertices of a side follow each other.
        let first = border.partition_point(|v| (v.side as usize) < side);
        let own = border[first..].iter().take_while(|v| v.side as usize == side && v.param <= param).count();
        let start = first + own.max(1) - 1;
        let (from, to) = (&border[start], &border[(start + 1) % border.len()]);
        let end = if to.side == from.side { to.param } else { 1.0 };
        let share = ((param - from.param) / (end - from.param)).clamp(0.0, 1.0);
        let triangle = self.beside.get(&from.vertex).copied().unwrap_or(0);
        let weight = |corner: u32| {
            if corner == from.vertex {
                1.0 - share
            } else if corner == to.vertex {
                share
            } else {
                0.0
            }
        };
        self.at(triangle, self.chart.mesh.triangles[triangle as usize].map(weight), value)
    }

    fn at<T>(&mut self, triangle: u32, weights: [f64; 3], value: &impl Fn(&Face, [f32; 3], f32) -> T) -> T {
        let latest = self.latest.take().filter(|(known, _)| *known == triangle);
        let (_, face) = self.latest.insert(latest.unwrap_or_else(|| {
            let corners = self.chart.mesh.triangles[triangle as usize].map(|v| self.chart.mesh.positions[v as usize]);
            let number = self.chart.numbers.get(triangle as usize).copied().unwrap_or(NONE);
            (triangle, self.painter.face(number as usize, corners))
        }));
        value(face, weights.map(|weight| weight as f32), self.footprints[triangle as usize])
    }
}

/// The distance of samples on each triangle of a chart: the root of the area that a sample stands for.
fn footprints(chart: &AtlasChart, resolution: u32) -> Vec<f32> {
    let embedding = &chart.embedding;
    let n = embedding.corner_count;
    let corner = |k: usize| quad_point(n, k, 1.0, 1.0);
    let polygon_area: f64 = (0..n).map(|k| corner(k).perp_dot(corner((k + 1) % n)) / 2.0).sum();
    let cell = polygon_area / (n as f64 * f64::from(1u32 << (2 * resolution)));
    let mut mapped = vec![0.0; chart.mesh.triangles.len()];
    for (number, part) in (0..).zip(&embedding.triangles) {
        let [u, v, w] = part.map(|v| embedding.uv[v as usize]);
        mapped[embedding.chart_triangle(number) as usize] += (v - u).perp_dot(w - u).abs();
    }
    let footprint = |(corners, mapped): (&[u32; 3], f64)| {
        let [a, b, c] = corners.map(|v| chart.mesh.positions[v as usize]);
        let footprint = ((b - a).cross(c - a).length() / mapped * cell).sqrt() as f32;
        if footprint.is_finite() { footprint } else { 0.0 }
    };
    chart.mesh.triangles.iter().zip(mapped).map(footprint).collect()
}
