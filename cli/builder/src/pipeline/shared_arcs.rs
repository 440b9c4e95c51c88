//! The arcs as the file will hold them: sampled and quantised once for the charts on both sides, and refined where a
//! chart asks for it.

use std::collections::HashSet;

use super::ChartedMesh;
use glam::DVec3;
use lodpack::{
    LatticePoint,
    write::{ArcSample, WantedSample, quantise_arc},
};
use lodpack_mesh::{NONE, next_half_edge, ordered};
use lodpack_runtime::trace;
use lodpack_stage::arc_samples::{SampledArc, border_deviation, sample_arcs};
use lodpack_stage::arcs::{ARC_UNITS, HalfArc, cut_chart};
use lodpack_stage::chart::{BorderVertex, ChartMesh, NEVER};
use lodpack_stage::nearest::doubled_area;
use rayon::prelude::*;

/// Tangential step of arc samples over the lattice step, as a power of two. It is coarse because a sample may slide
/// along its arc.
pub(super) const ARC_TANGENT_SHIFT: u8 = 2;

/// All arcs of a region, sampled and quantised. The charts on both sides take their borders from here.
#[derive(Clone)]
pub(super) struct SharedArcs {
    sampled: Vec<SampledArc>,
    /// Lattice position of each corner.
    pub corners: Vec<LatticePoint>,
    /// Decoded samples of each arc, ends excluded, by parameter.
    pub samples: Vec<Vec<ArcSample>>,
}

/// A chart's wish that a vertex of an arc be a sample from a level on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SampleWish {
    pub arc: u32,
    pub path_index: u32,
    pub level: u8,
}

/// A chart cut out of its region for the stages, and where its border vertices lie on the arcs.
pub(super) struct CutChart {
    /// Positions relative to the lattice origin; border samples at their decoded positions.
    pub mesh: ChartMesh,
    /// The input's positions, borders included: certificates compare with these.
    pub original: Vec<DVec3>,
    /// Arc and path index of every border vertex, loop after loop as in `mesh.loops`.
    pub origin: Vec<Vec<(u32, u32)>>,
    /// Lattice position of the border vertices that are samples, in the order of `origin`.
    pub lattice: Vec<Vec<Option<LatticePoint>>>,
}

/// Makes samples of the vertices where lines at which colours jump meet an arc, at the finest level: more levels gained
/// nothing. Seams have all vertices as samples there.
fn raise_ends_of_lines(charted: &ChartedMesh, sampled: &mut [SampledArc]) {
    let Some(areas) = charted.areas.map(|areas| areas.all()) else { return };
    let mesh = charted.mesh;
    let mut is_end = vec![false; mesh.positions.len()];
    for (half_edge, &opposite) in (0..).zip(&charted.adjacency.opposite) {
        if opposite == NONE || opposite < half_edge {
            continue;
        }
        let [one, other] = [half_edge, opposite].map(|h| h as usize / 3);
        if charted.labels[one] == charted.labels[other] && areas.jump(one, other) {
            for h in [half_edge, next_half_edge(half_edge)] {
                is_end[mesh.triangles[h as usize / 3][h as usize % 3] as usize] = true;
            }
        }
    }
    let level = charted.scale.finest();
    for (arc, sampled) in charted.atlas.arcs.iter().zip(sampled).filter(|(arc, _)| arc.seam.is_none()) {
        for index in (1..arc.path.len() - 1).filter(|&index| is_end[arc.path[index] as usize]) {
            sampled.raise(index, level);
        }
    }
}

impl SharedArcs {
    /// Samples and quantises every arc of a region.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] if a position lies beyond the lattice.
    pub fn new(charted: &ChartedMesh) -> lodpack::Result<Self> {
        let of_all = trace::even("samples of arcs");
        let mut sampled = sample_arcs(charted.mesh, charted.atlas, &charted.scale.arc_tolerances());
        drop(of_all);
        raise_ends_of_lines(charted, &mut sampled);
        let step = charted.scale.step();
        let corners = charted
            .atlas
            .corners
            .iter()
            .map(|&v| {
                let local = charted.scale.local(charted.mesh.positions[v as usize]) / step;
                local.to_array().map(|c| (c + 0.5).floor() as i64)
            })
            .collect();
        let mut arcs = Self { sampled, corners, samples: vec![] };
        arcs.spread_corners(charted);
        let _all = trace::even("arcs");
        let numbers = (0..charted.atlas.arcs.len()).into_par_iter();
        arcs.samples = numbers.map(|arc| arcs.quantise(charted, arc)).collect::<lodpack::Result<_>>()?;
        Ok(arcs)
    }

    /// Gives loops of three corners, which nobody else borders on, an area: triangles smaller than a lattice step,
    /// which scans have beside their surface, would be points.
    fn spread_corners(&mut self, charted: &ChartedMesh) {
        let atlas = charted.atlas;
        let is_bare = |half: &HalfArc| {
            let (arc, levels) = (&atlas.arcs[half.arc as usize], &self.sampled[half.arc as usize].levels);
            is_boundary(half, charted) && (1..arc.path.len() - 1).all(|index| levels[index] == NEVER)
        };
        let alone =
            atlas.charts.iter().flat_map(|chart| &chart.loops).filter(|half_arcs| half_arcs.iter().all(is_bare));
        let loops: Vec<[u32; 3]> = alone
            .filter_map(|half_arcs| <&[HalfArc; 3]>::try_from(half_arcs.as_slice()).ok())
            .map(|half_arcs| half_arcs.map(|half| half.ends(atlas)[0]))
            .collect();
        for corners in loops {
            let points = corners.map(|corner| self.corners[corner as usize]);
            let wanted = corners.map(|corner| {
                let position = charted.mesh.positions[atlas.corners[corner as usize] as usize];
                charted.scale.local(position) / charted.scale.step()
            });
            for (corner, point) in corners.into_iter().zip(with_area(points, wanted)) {
                self.corners[corner as usize] = point;
            }
        }
    }

    fn quantise(&self, charted: &ChartedMesh, arc: usize) -> lodpack::Result<Vec<ArcSample>> {
        let (path, sampled) = (&charted.atlas.arcs[arc], &self.sampled[arc]);
        let step = charted.scale.step();
        let wanted: Vec<WantedSample> = (1..path.path.len() - 1)
            .filter(|&i| sampled.levels[i] != NEVER)
            .map(|i| {
                let local = charted.scale.local(charted.mesh.positions[path.path[i] as usize]) / step;
                WantedSample { param: sampled.params[i] as u32, level: sampled.levels[i], position: local.to_array() }
            })
            .collect();
        quantise_arc(path.ends.map(|end| self.corners[end as usize]), &wanted, ARC_TANGENT_SHIFT)
    }

    /// Fulfils wishes, except on seams, whose samples both regions have fixed already. Returns how many samples were
    /// added and which charts have to be built again, ascending.
    pub fn fulfil(&mut self, charted: &ChartedMesh, mut wishes: Vec<SampleWish>) -> lodpack::Result<(u64, Vec<u32>)> {
        wishes.sort_unstable();
        wishes.dedup();
        let (mut added, mut charts, mut arcs) = (0, vec![], vec![]);
        for wish in wishes {
            if charted.atlas.arcs[wish.arc as usize].seam.is_none()
                && self.sampled[wish.arc as usize].raise(wish.path_index as usize, wish.level)
            {
                added += 1;
                arcs.push(wish.arc);
            }
        }
        arcs.dedup();
        for arc in arcs {
            self.samples[arc as usize] = self.quantise(charted, arc as usize)?;
            charts.extend(charted.atlas.arcs[arc as usize].charts.into_iter().filter(|&chart| chart != NONE));
        }
        charts.sort_unstable();
        charts.dedup();
        Ok((added, charts))
    }

    /// For each chart whether one of its arcs has other samples in `other`.
    pub fn differing_charts(&self, other: &Self, charted: &ChartedMesh) -> Vec<bool> {
        let mut differs = vec![false; charted.atlas.charts.len()];
        for ((arc, a), b) in charted.atlas.arcs.iter().zip(&self.samples).zip(&other.samples) {
            if a != b {
                arc.charts.into_iter().filter(|&chart| chart != NONE).for_each(|chart| differs[chart as usize] = true);
            }
        }
        differs
    }

    /// Cuts a chart out of the mesh, with the border that its arcs now give it.
    pub fn cut(&self, charted: &ChartedMesh, chart: u32) -> CutChart {
        let local = cut_chart(charted.mesh, charted.adjacency, charted.atlas, charted.labels, chart);
        let original: Vec<DVec3> =
            local.mesh_vertex.iter().map(|&v| charted.scale.local(charted.mesh.positions[v as usize])).collect();
        let mut positions = original.clone();
        let (mut loops, mut origin, mut lattice) = (vec![], vec![], vec![]);
        for (l, border) in local.loops.iter().enumerate() {
            let half_arcs = &charted.atlas.charts[chart as usize].loops[l];
            let mut vertices = Vec::with_capacity(border.len());
            let mut points = Vec::with_capacity(border.len());
            for vertex in border {
                let half = half_arcs[vertex.side as usize];
                let sampled = &self.sampled[half.arc as usize];
                let index = vertex.path_index as usize;
                let (param, level) = (sampled.params[index], sampled.levels[index]);
                let point = self.lattice_point(charted, half.arc, index);
                if let Some(point) = point {
                    positions[vertex.local_vertex as usize] = charted.scale.local_from_lattice(point);
                }
                let along = if half.reversed { f64::from(ARC_UNITS) - param } else { param };
                vertices.push(BorderVertex {
                    vertex: vertex.local_vertex,
                    side: vertex.side,
                    param: along / f64::from(ARC_UNITS),
                    level,
                });
                points.push(point);
            }
            origin.push(border.iter().map(|v| (half_arcs[v.side as usize].arc, v.path_index)).collect());
            loops.push(vertices);
            lattice.push(points);
        }
        CutChart { mesh: ChartMesh { positions, triangles: local.triangles, loops }, original, origin, lattice }
    }

    fn lattice_point(&self, charted: &ChartedMesh, arc: u32, path_index: usize) -> Option<LatticePoint> {
        let path = &charted.atlas.arcs[arc as usize];
        if path_index == 0 || path_index == path.path.len() - 1 {
            return Some(self.corners[path.ends[usize::from(path_index != 0)] as usize]);
        }
        let sampled = &self.sampled[arc as usize];
        if sampled.levels[path_index] == NEVER {
            return None;
        }
        let samples = &self.samples[arc as usize];
        let found = samples.binary_search_by_key(&(sampled.params[path_index] as u32), |s| s.param).ok()?;
        Some(samples[found].position)
    }

    /// The edges of the arcs at the finest level, as vertices of the mesh, the smaller one first.
    pub fn edges(&self, charted: &ChartedMesh) -> impl Iterator<Item = [u32; 2]> {
        let arcs = charted.atlas.arcs.iter().zip(&self.sampled);
        arcs.flat_map(|(arc, sampled)| {
            let last = arc.path.len() - 1;
            let drawn = (0..=last).filter(move |&i| i == 0 || i == last || sampled.levels[i] != NEVER);
            let mut from = None;
            drawn.filter_map(move |i| {
                let to = arc.path[i];
                from.replace(to).map(|from: u32| ordered([from, to]))
            })
        })
    }

    /// Points from which a chart's border runs on along the boundary of the mesh.
    pub fn along_boundary(&self, charted: &ChartedMesh, chart: u32) -> HashSet<LatticePoint> {
        let atlas = charted.atlas;
        let half_arcs = atlas.charts[chart as usize].loops.iter().flatten();
        let points = half_arcs.filter(|half| is_boundary(half, charted)).flat_map(|half| {
            let samples = self.samples[half.arc as usize].iter().map(|sample| sample.position);
            samples.chain([self.corners[half.ends(atlas)[0] as usize]])
        });
        points.collect()
    }

    /// By how much a root's error can grow at each level when a neighbour is drawn finer.
    pub fn deviations(&self, charted: &ChartedMesh, chart: u32) -> Vec<f64> {
        let mut worst = vec![0.0f64; charted.scale.levels.len()];
        for half in charted.atlas.charts[chart as usize].loops.iter().flatten() {
            let ends = charted.atlas.arcs[half.arc as usize].ends.map(|end| self.corners[end as usize]);
            let local = |p: LatticePoint| charted.scale.local_from_lattice(p);
            let mut points = vec![(0, local(ends[0]))];
            points.extend(self.samples[half.arc as usize].iter().map(|s| (s.level, local(s.position))));
            points.push((0, local(ends[1])));
            if points.len() > 2 {
                for (level, deviation) in worst.iter_mut().enumerate() {
                    *deviation = deviation.max(border_deviation(&points, level as u8));
                }
            }
        }
        worst
    }
}

/// Whether the mesh ends at a half-arc.
fn is_boundary(half: &HalfArc, charted: &ChartedMesh) -> bool {
    half.neighbour(charted.atlas) == NONE && charted.atlas.arcs[half.arc as usize].seam.is_none()
}

/// Three points of the lattice, with the last two moved by a step where they have no area: as near as can be to where
/// they are wanted, and not turned over.
fn with_area(points: [LatticePoint; 3], wanted: [DVec3; 3]) -> [LatticePoint; 3] {
    let normal = doubled_area(wanted);
    let place = |point: LatticePoint| DVec3::from(point.map(|x| x as f64));
    let area = |points: [LatticePoint; 3]| doubled_area(points.map(place));
    if area(points) != DVec3::ZERO {
        return points;
    }
    let steps = |i: i64| [i / 9 % 3, i / 3 % 3, i % 3].map(|k| k - 1);
    let moved = (0..27 * 27).map(|i| {
        let by = [[0; 3], steps(i / 27), steps(i % 27)];
        [0, 1, 2].map(|corner| [0, 1, 2].map(|k| points[corner][k] + by[corner][k]))
    });
    let cost = |points: &[LatticePoint; 3]| {
        let off = |(&point, wanted): (&LatticePoint, DVec3)| place(point).distance_squared(wanted);
        let is_turned = area(*points).dot(normal) < 0.0;
        (is_turned, points.iter().zip(wanted).map(off).sum::<f64>())
    };
    let spread = moved.filter(|&points| area(points) != DVec3::ZERO);
    let costs = spread.map(|points| (cost(&points), points));
    let nearest = costs.reduce(|best, next| if next.0 < best.0 { next } else { best });
    nearest.map_or(points, |(_, points)| points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_below_a_step_get_an_area_and_are_not_turned_over() {
        let up = [DVec3::new(0.1, 0.1, 7.0), DVec3::new(0.3, 0.1, 7.0), DVec3::new(0.1, 0.2, 7.2)];
        for (turned, wanted) in [up, [up[0], up[2], up[1]]].into_iter().enumerate() {
            let [a, b, c] = with_area([[0, 0, 7]; 3], wanted).map(|p| DVec3::from(p.map(|x| x as f64)));
            let normal = (b - a).cross(c - a);
            assert!(normal.dot((wanted[1] - wanted[0]).cross(wanted[2] - wanted[0])) > 0.0, "{turned}: {normal}");
            assert!([a, b, c].into_iter().zip(wanted).all(|(p, wanted)| p.distance(wanted) < 2.0), "{a} {b} {c}");
        }
        let sound = [[0, 0, 0], [5, 0, 0], [0, 5, 0]];
        assert_eq!(with_area(sound, up), sound);
        // On a line.
        let spread = with_area([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [DVec3::ZERO, DVec3::X, DVec3::new(2.0, 0.3, 0.0)]);
        assert_eq!(spread[1][1].max(spread[2][1].abs()), 1, "{spread:?}");
    }
}
