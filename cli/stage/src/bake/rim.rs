//! What patches show along their outer borders, for the patches above them: those have no input at hand, and know
//! nothing of what lies beyond.
//!
//! A chart's border shows what the input does. The chart hands that up, and each group hands up what it takes for its
//! own border from its members: the means over one of its texels. Both sides of an arc then want the same, and so do
//! finer and coarser ones.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use lodpack::LatticePoint;

use crate::certify::{Hint, TriangleBvh};
use lodpack_mesh::NONE;

/// What stands for a colour that is not known, in place of its first component.
pub(super) const UNKNOWN: u16 = u16::MAX;
/// The largest component.
const WHOLE: f32 = 65534.0;
/// Places along a texel whose mean is shown.
const PLACES: usize = 4;
/// The most edges over which a texel reaches in each direction.
const MOST_EDGES: usize = 64;

/// A place that is nearer to the end of an edge than this share of the edge is meant to be the end.
const NEARLY: f64 = 1e-6;

/// The outer border of a patch, but for the boundary of the mesh.
#[derive(Clone, Debug, Default)]
pub(super) struct Rim {
    pub edges: Vec<RimEdge>,
    /// Of each point the colours of all channels without opacity.
    pub colours: Vec<[u16; 3]>,
    /// How many channels these are.
    pub channels: usize,
}

/// An edge with the patch on its left.
#[derive(Clone, Debug)]
pub(super) struct RimEdge {
    /// Lattice units.
    pub ends: [DVec3; 2],
    /// The first of its points, and how many steps lead from it to the last one.
    pub first: u32,
    pub steps: u32,
}

/// A component as it is handed up.
pub(super) fn packed(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * WHOLE + 0.5) as u16
}

/// The border around several patches.
pub(super) struct Outline<'a> {
    edges: Vec<(&'a Rim, &'a RimEdge)>,
    /// The edges before and after each of them, [`NONE`] for none.
    beside: Vec<[u32; 2]>,
    bvh: TriangleBvh,
}

/// A place on an outline.
#[derive(Clone, Copy)]
pub(super) struct OnOutline {
    edge: usize,
    /// From where the edge begins, lattice units.
    along: f64,
    pub point: DVec3,
    /// Whether the outline ends there.
    pub is_end: bool,
}

impl RimEdge {
    fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }
}

/// A point of the lattice as whole numbers.
pub(super) fn lattice_point(point: DVec3) -> LatticePoint {
    point.to_array().map(|x| x as i64)
}

impl<'a> Outline<'a> {
    /// Without the edges that two of the patches have in common.
    pub fn new(rims: impl Iterator<Item = &'a Rim>) -> Self {
        let mut edges: Vec<(&Rim, &RimEdge)> =
            rims.flat_map(|rim| rim.edges.iter().map(move |edge| (rim, edge))).collect();
        let sides: HashSet<[LatticePoint; 2]> = edges.iter().map(|(_, edge)| edge.ends.map(lattice_point)).collect();
        edges.retain(|(_, edge)| {
            let [start, end] = edge.ends.map(lattice_point);
            !sides.contains(&[end, start])
        });
        let mut beside = vec![[NONE; 2]; edges.len()];
        let mut starts: HashMap<LatticePoint, u32> = HashMap::new();
        for (number, (_, edge)) in (0..).zip(&edges) {
            starts.entry(lattice_point(edge.ends[0])).or_insert(number);
        }
        for (number, (_, edge)) in edges.iter().enumerate() {
            if let Some(&after) = starts.get(&lattice_point(edge.ends[1])) {
                beside[number][1] = after;
                if beside[after as usize][0] == NONE {
                    beside[after as usize][0] = number as u32;
                }
            }
        }
        let positions: Vec<DVec3> = edges.iter().flat_map(|(_, edge)| edge.ends).collect();
        let triangles: Vec<[u32; 3]> = (0..edges.len() as u32).map(|k| [2 * k, 2 * k + 1, 2 * k + 1]).collect();
        Self { bvh: TriangleBvh::new(&positions, &triangles), edges, beside }
    }

    pub fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// The closest place to a point of an edge that has this direction; none if it runs the other way.
    pub fn closest(&self, point: DVec3, direction: DVec3, hint: &mut Hint) -> Option<OnOutline> {
        let closest = self.bvh.closest(point, hint);
        let edge = closest.triangle as usize;
        let [start, end] = self.edges[edge].1.ends;
        let (along, length, [before, after]) = (start.distance(closest.point), start.distance(end), self.beside[edge]);
        let is_end = along <= NEARLY * length && before == NONE || along >= (1.0 - NEARLY) * length && after == NONE;
        ((end - start).dot(direction) > 0.0).then_some(OnOutline { edge, along, point: closest.point, is_end })
    }

    /// Appends the colours of a texel's length around a place. Says whether they are known.
    pub fn means(&self, place: OnOutline, size: f64, colours: &mut Vec<[f32; 3]>) -> bool {
        let (first, mut count) = (colours.len(), 0.0_f32);
        for k in 0..PLACES {
            let offset = ((k as f64 + 0.5) / PLACES as f64 - 0.5) * size;
            let Some((edge, along)) = self.moved(place, offset) else { continue };
            let (rim, &RimEdge { first: first_point, steps, .. }) = self.edges[edge];
            let at = along.clamp(0.0, 1.0) * f64::from(steps);
            // The conversion saturates.
            let before = (at as u32).min(steps - 1);
            let part = (at - f64::from(before)) as f32;
            let of_point = |point: u32| &rim.colours[point as usize * rim.channels..][..rim.channels];
            let [one, other] = [before, before + 1].map(|step| of_point(first_point + step));
            if one[0][0] == UNKNOWN || other[0][0] == UNKNOWN {
                continue;
            }
            if count == 0.0 {
                colours.resize(first + rim.channels, [0.0; 3]);
            }
            count += 1.0;
            for (sum, (one, other)) in colours[first..].iter_mut().zip(one.iter().zip(other)) {
                for k in 0..3 {
                    let [one, other] = [one[k], other[k]].map(|value| f32::from(value) / WHOLE);
                    sum[k] += one + part * (other - one);
                }
            }
        }
        colours[first..].iter_mut().flatten().for_each(|sum| *sum /= count);
        count > 0.0
    }

    /// The edge at a distance along the outline from a place, and the share of the way along it.
    fn moved(&self, place: OnOutline, offset: f64) -> Option<(usize, f64)> {
        let (mut edge, mut along) = (place.edge, place.along + offset);
        for _ in 0..MOST_EDGES {
            let length = self.edges[edge].1.length();
            let next = self.beside[edge][usize::from(along > length)];
            if (0.0..=length).contains(&along) || next == NONE {
                return Some((edge, if length > 0.0 { along / length } else { 0.0 }));
            }
            if along < 0.0 {
                along += self.edges[next as usize].1.length();
            } else {
                along -= length;
            }
            edge = next as usize;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use lodpack::decode::texels::{Image, Map};

    use super::super::wanted::Wanted;
    use super::super::{BakedPatch, Baker, Coarse, Located, MAX_TEXELS, Points, Source, Storage, Stored};
    use super::*;
    use lodpack_mesh::srgb::srgb_byte;

    /// A rim whose points are brighter by 1/64 with each lattice unit along x.
    fn rim(corners: &[[f64; 2]]) -> Rim {
        let points = corners.iter().map(|&[x, y]| DVec3::new(x, y, 0.0)).collect::<Vec<_>>();
        let mut wanted = Wanted::default();
        for (k, &start) in points.iter().enumerate() {
            let end = points[(k + 1) % points.len()];
            wanted.outer_edges.push(([start, end], 5));
            for step in 0..5 {
                wanted.outer_points.push(wanted.colours.len() as u32);
                wanted.colours.push([start.lerp(end, f64::from(step) / 4.0).x as f32 / 64.0; 3]);
            }
        }
        Rim::new(&wanted, DVec3::ZERO, 1)
    }

    #[test]
    fn an_outline_has_no_edges_between_patches_and_means_run_on_over_its_corners() {
        let rims = [[0.0, 32.0], [32.0, 64.0]].map(|[x, z]| rim(&[[x, 0.0], [z, 0.0], [z, 32.0], [x, 32.0]]));
        let outline = Outline::new(rims.iter());
        assert_eq!(outline.edges.len(), 6);
        let mut hint = Hint::default();
        // What the two have in common is not found, nor is what runs the other way.
        assert!(outline.closest(DVec3::new(31.0, 20.0, 0.0), DVec3::X, &mut hint).is_none());
        for x in [10.0, 32.0, 33.0, 62.0] {
            let on = outline.closest(DVec3::new(x, -3.0, 1.0), DVec3::X, &mut hint).unwrap();
            assert!(on.point.distance(DVec3::new(x, 0.0, 0.0)) < 1e-9 && !on.is_end);
            let mut means = vec![];
            assert!(outline.means(on, 8.0, &mut means));
            // Past its last corner the outline gets no brighter.
            let wanted = if x < 60.0 { x } else { 0.25 * (59.0 + 61.0 + 63.0 + 64.0) };
            assert!((f64::from(means[0][0]) - wanted / 64.0).abs() < 1e-4, "{x}: {}", 64.0 * means[0][0]);
        }
    }

    #[test]
    fn points_of_which_nothing_is_known_do_not_count() {
        let mut wanted = Wanted { colours: vec![[0.5; 3]; 2], ..Wanted::default() };
        wanted.outer_edges.push(([DVec3::ZERO, DVec3::X * 8.0], 3));
        wanted.outer_points = vec![0, 1, NONE];
        let rims = [Rim::new(&wanted, DVec3::ZERO, 1)];
        let outline = Outline::new(rims.iter());
        let means = |x: f64, size: f64| {
            let on = outline.closest(DVec3::X * x, DVec3::X, &mut Hint::default()).unwrap();
            let mut means = vec![];
            outline.means(on, size, &mut means).then(|| means[0][0])
        };
        let ends = [0.0, 3.0, 9.0].map(|x| outline.closest(DVec3::X * x, DVec3::X, &mut Hint::default()));
        assert_eq!(ends.map(|on| on.map(|on| on.is_end)), [Some(true), Some(false), Some(true)]);
        assert!((means(3.9, 4.0).expect("half of it is known") - 0.5).abs() < 1e-4);
        assert_eq!(means(7.0, 1.0), None);
    }

    /// Squares that get brighter along x.
    struct Slope(Vec<[DVec3; 3]>);

    impl Source for Slope {
        fn triangle_count(&self) -> usize {
            self.0.len()
        }

        fn corners(&self, triangle: usize) -> [DVec3; 3] {
            self.0[triangle]
        }

        fn ends_along(&self, start: LatticePoint) -> bool {
            start == [0, 0, 0]
        }

        fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
            for weights in points.iter().flat_map(|points| points.weights()) {
                let x: f64 = (0..3).map(|k| self.0[triangle][k].x * f64::from(weights[k])).sum();
                values.extend([bright(x); 3]);
            }
        }
    }

    fn bright(x: f64) -> f32 {
        (x / 128.0) as f32
    }

    fn patch<'a>(positions: &'a [LatticePoint], triangles: &'a [[u32; 3]]) -> BakedPatch<'a> {
        BakedPatch { positions, triangles, reach: 8.0, areas: None, finer: 0, is_sharp: false }
    }

    #[test]
    fn both_sides_of_a_border_show_the_same_without_a_source_and_beside_finer_ones() {
        let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
        let mut baker = Baker::new(&storage);
        // Two finer patches, whose common border is bent, and two coarser ones, of which it is straight.
        let (left, right) = ([[0, 0, 0], [64, 0, 0], [71, 32, 0], [64, 64, 0], [0, 64, 0]], [0, 1, 2, 3, 4]);
        let across = left.map(|[x, y, z]| if x == 0 { [128, y, z] } else { [x, y, z] });
        let fan = |order: [u32; 5], is_left: bool| {
            let [a, b, c, d, e] = order;
            let triangles = [[a, b, c], [a, c, e], [e, c, d]];
            if is_left { triangles } else { triangles.map(|[a, b, c]| [a, c, b]) }
        };
        let straight = |order: [u32; 5], is_left: bool| {
            let [a, b, _, d, e] = order;
            let triangles = [[a, b, d], [a, d, e]];
            if is_left { triangles } else { triangles.map(|[a, b, c]| [a, c, b]) }
        };
        let mut shown = |is_handed_up: bool| {
            let sides = [(left, true), (across, false)].map(|(positions, is_left)| {
                let triangles = fan(right, is_left);
                let corner = |v: u32| DVec3::from(positions[v as usize].map(f64::from));
                let source = Slope(triangles.iter().map(|corners| corners.map(corner)).collect());
                let positions = positions.map(|point| point.map(i64::from));
                let finer = patch(&positions, &triangles);
                let mut surfels = baker.bake(&finer, &mut Located::new(source), 4).expect("it has an image").surfels;
                assert_eq!(surfels.rim.edges.len(), if is_left { 4 } else { 5 });
                if !is_handed_up {
                    surfels.rim = Rim::default();
                }
                let triangles = straight(right, is_left);
                let coarser = patch(&positions, &triangles);
                let no_source: Option<&mut Located<Slope>> = None;
                let baked = baker.bake_coarser(&coarser, std::iter::once(&surfels), no_source, Coarse::even(6));
                let streams = baked.expect("it has an image").streams;
                let map = Map::decode(&streams[0], &positions, &triangles, MAX_TEXELS).expect("sound");
                let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
                let at = |point: [f64; 3]| image.interpolated(map.piece(0).unbounded(point))[0];
                [at([64.0, 32.0, 0.0]), at([70.5, 32.0, 0.0])]
            });
            // How much both sides differ, and how far the left one is from what the finer border shows.
            let [one, other] = sides;
            [(one[0] - other[0]).abs(), (one[1] - f64::from(srgb_byte(bright(71.0)))).abs()]
        };
        let (with, without) = (shown(true), shown(false));
        assert!(with[0] < 2.0 && without[0] > 3.0 && with[1] < 3.0, "{with:?} {without:?}");
    }
}
