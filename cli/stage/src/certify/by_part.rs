//! Surfaces of several parts, such as a chart of small parts of a scene and its drawn level: part by part.
//!
//! A map from the finer surface onto the coarser exists for all of it or not at all, and where parts touch, a vertex is
//! often nearest to the wrong one. Each part on its own is bounded as a chart of its own would be. The largest of the
//! bounds holds for all together: every point of a part has a point of its partner near it.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::bvh::{Hint, TriangleBvh};
use super::drape::Map;
use super::surface::Surface;
use super::unchanged::{Corresponding, Unchanged};
use super::{BorderPairing, Bound, CertifyOptions, exceeding, two_sided};
use lodpack_mesh::NONE;
use lodpack_mesh::union_find::components;

/// Nodes and leaves of the hierarchy that are looked into for the places where the coarser surface is too far off: this
/// many, plus the number below for each triangle. Usually it is a tenth of that.
const MOST_VISITS: u64 = 1_000_000;
const MOST_VISITS_PER_TRIANGLE: u64 = 80;

/// A component without a border.
struct Part {
    bounds: [DVec3; 2],
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The numbers of its triangles and vertices in the surface.
    numbers: Vec<u32>,
    vertices: Vec<u32>,
}

/// A surface or its part.
enum Side {
    Whole(Arc<TriangleBvh>),
    /// All components with a border, and the numbers of their triangles in the surface.
    Bordered(Arc<TriangleBvh>, Vec<u32>),
    /// Its hierarchy is made when it is first needed.
    Closed(Part, OnceLock<Arc<TriangleBvh>>),
}

/// A surface in parts.
struct Parts {
    closed: Vec<Part>,
    /// All components with a border, in the numbers of the surface.
    bordered: Vec<[u32; 3]>,
    /// Of each of these triangles the number in the surface.
    numbers: Vec<u32>,
}

/// Two surfaces that are compared: as a whole, or part by part where both have several parts that correspond. What has
/// been found of a part is kept from one question to the next. It is meant for surfaces of the same topology whose
/// borders correspond, such as a chart and its drawn level.
pub struct Comparison {
    pairs: Vec<Pair>,
    /// Of each vertex of the coarser surface which one of the finer it was; [`NONE`] if none. Empty if nothing is
    /// known.
    was: Vec<u32>,
    /// A distance that occurs between parts, and where.
    lower: (f64, DVec3),
}

/// Two surfaces, or parts of two.
struct Pair {
    fine: Side,
    coarse: Side,
    pairing: BorderPairing,
    /// Whether one might be laid onto the other, and has not been yet.
    may_drape: bool,
    /// How one is laid onto the other.
    map: Option<Map>,
    known: Option<Bound>,
    /// What stays as it is, if that has been all that was asked so far.
    unchanged: Option<Unchanged>,
}

impl Comparison {
    /// `pairing` says how the borders correspond; `fine` should have the smaller triangles. `was` says of each vertex
    /// of the coarser surface which one of the finer it was, or [`NONE`]; it is empty if unknown.
    pub fn new(fine: &Surface, coarse: &Surface, pairing: &BorderPairing, was: Vec<u32>) -> Self {
        let is_closed = pairing.is_empty();
        let points = || pairing.iter().flatten();
        let of_coarse = Parts::new(coarse, points().filter_map(|vertex| vertex.coarse));
        // Nothing has to be known of one side's parts if the other has one.
        let of_fine = (is_closed || of_coarse.is_some()).then(|| Parts::new(fine, points().map(|vertex| vertex.fine)));
        let of_fine = of_fine.flatten();
        let is_several = of_coarse.is_some() || of_fine.is_some();
        let found = of_fine.zip(of_coarse).and_then(|parts| pairs_of([fine, coarse], parts, pairing));
        let (pairs, lower) = found.unzip();
        let whole = || {
            let [fine, coarse] = [fine, coarse].map(|surface| Side::Whole(Arc::clone(surface.bvh())));
            // Parts that do not correspond are not laid onto each other as a whole either; a border may help.
            vec![Pair { may_drape: !(is_closed && is_several), ..Pair::new(fine, coarse, pairing.clone()) }]
        };
        Self { pairs: pairs.unwrap_or_else(whole), was, lower: lower.unwrap_or_default() }
    }

    /// In how many parts the surfaces are compared.
    pub fn part_count(&self) -> usize {
        self.pairs.len()
    }

    /// Bounds the Hausdorff distance like [`super::two_sided`]: in several parts by the largest distance between two
    /// that correspond, which may be more (also in `lower`).
    pub fn two_sided(&mut self, options: &CertifyOptions) -> Bound {
        let mut options = CertifyOptions { lower: options.lower.max(self.lower.0), ..options.clone() };
        let bounds = self.pairs.iter_mut().map(|pair| {
            let bound = pair.two_sided(&self.was, &options);
            options.lower = options.lower.max(bound.lower);
            bound
        });
        let (lower, worst) = self.lower;
        bounds.fold(Bound { lower, upper: lower, worst, work: 0 }, Bound::or_worse)
    }

    /// Squared distances of every `stride`-th vertex of the finer surface from the coarser one, or from the part that
    /// corresponds.
    pub fn squares(&self, stride: usize) -> Vec<f64> {
        let mut squares = vec![];
        for pair in &self.pairs {
            let is_wanted = |v: u32| (pair.fine.vertex(v) as usize).is_multiple_of(stride);
            if let (Some(unchanged), Some(parts)) = (&pair.unchanged, pair.closed()) {
                unchanged.squares(parts.map(Part::surface), is_wanted, &mut squares);
                continue;
            }
            let [fine, coarse] = pair.surfaces();
            let mut hint = Hint::default();
            for (_, &own) in (0..).zip(&fine.vertex_of).filter(|&(v, &own)| own != NONE && is_wanted(v)) {
                if let Some(map) = &pair.map {
                    hint = Hint::at(map.tile(own));
                }
                let distance = coarse.closest(fine.positions[own as usize], &mut hint).distance;
                squares.push(distance * distance);
            }
        }
        squares
    }

    /// The triangles of the finer surface, ascending, at which one surface is not proven to lie within `target` of the
    /// other; `work_limit` is that of [`super::exceeding`].
    pub fn exceeding(&mut self, target: f64, work_limit: u64) -> Vec<u32> {
        let is_open = |pair: &&mut Pair| pair.known.is_none_or(|bound| bound.upper > target);
        let mut found: Vec<u32> =
            self.pairs.iter_mut().filter(is_open).flat_map(|pair| pair.exceeding(target, work_limit)).collect();
        found.sort_unstable();
        found.dedup();
        found
    }
}

impl Side {
    fn closed(part: Part) -> Self {
        Self::Closed(part, OnceLock::new())
    }

    fn bvh(&self) -> &Arc<TriangleBvh> {
        match self {
            Self::Whole(bvh) | Self::Bordered(bvh, _) => bvh,
            Self::Closed(part, bvh) => bvh.get_or_init(|| Arc::new(TriangleBvh::new(&part.positions, &part.triangles))),
        }
    }

    /// The number of a triangle in the surface.
    fn triangle(&self, number: u32) -> u32 {
        match self {
            Self::Whole(_) => number,
            Self::Bordered(_, numbers) | Self::Closed(Part { numbers, .. }, _) => numbers[number as usize],
        }
    }

    /// The number of a vertex in the surface.
    fn vertex(&self, number: u32) -> u32 {
        match self {
            Self::Whole(_) | Self::Bordered(..) => number,
            Self::Closed(part, _) => part.vertices[number as usize],
        }
    }
}

impl Pair {
    fn new(fine: Side, coarse: Side, pairing: BorderPairing) -> Self {
        Self { fine, coarse, pairing, may_drape: true, map: None, known: None, unchanged: None }
    }

    fn surfaces(&self) -> [&Arc<TriangleBvh>; 2] {
        [&self.fine, &self.coarse].map(Side::bvh)
    }

    /// Two parts without a border.
    fn closed(&self) -> Option<[&Part; 2]> {
        let (Side::Closed(fine, _), Side::Closed(coarse, _)) = (&self.fine, &self.coarse) else { return None };
        Some([fine, coarse])
    }

    /// Two parts without a border, and how their vertices correspond; none if nothing is known of that.
    fn corresponding(&self, was: &[u32]) -> Option<Corresponding<'_>> {
        let [fine, coarse] = self.closed().filter(|_| !was.is_empty())?;
        // Vertices of a part are numbered by their first use, so that their order tells nothing.
        let mut numbers: Vec<(u32, u32)> = fine.vertices.iter().copied().zip(0..).collect();
        numbers.sort_unstable();
        let local = |&vertex: &u32| {
            let found = numbers.binary_search_by_key(&was[vertex as usize], |&(surface, _)| surface);
            found.map_or(NONE, |index| numbers[index].1)
        };
        Some(Corresponding {
            fine: fine.surface(),
            coarse: coarse.surface(),
            was: coarse.vertices.iter().map(local).collect(),
        })
    }

    /// Asks the map between the two, if there is one; none if there is not.
    fn on_map<T>(&mut self, ask: impl FnOnce(&mut Map) -> Option<T>) -> Option<T> {
        if std::mem::take(&mut self.may_drape) {
            let [fine, coarse] = self.surfaces();
            let is_empty = fine.is_empty() || coarse.is_empty();
            self.map = if is_empty { None } else { Map::new(fine, coarse, &self.pairing) };
        }
        let answer = ask(self.map.as_mut()?);
        if answer.is_none() {
            self.map = None;
        }
        answer
    }

    fn two_sided(&mut self, was: &[u32], options: &CertifyOptions) -> Bound {
        let CertifyOptions { relative_gap, floor, lower, target, .. } = *options;
        let enough = floor.max(target.unwrap_or(0.0));
        if let Some(known) = self.known {
            if known.upper <= enough.max((1.0 + relative_gap) * lower.max(known.lower)) {
                return known;
            }
        } else if let Some(parts) = self.corresponding(was)
            && let Some((unchanged, bound)) = Unchanged::new(&parts, options)
            && bound.upper <= enough.max((1.0 + relative_gap) * lower)
        {
            self.unchanged = Some(unchanged);
            self.known = Some(bound);
            return bound;
        }
        self.unchanged = None;
        let draped = self.on_map(|map| map.two_sided(options));
        let mut bound = draped.unwrap_or_else(|| {
            let [fine, coarse] = self.surfaces();
            two_sided(fine, coarse, options)
        });
        if let Some(known) = self.known {
            bound.upper = bound.upper.min(known.upper);
        }
        self.known = Some(bound);
        bound
    }

    fn exceeding(&mut self, target: f64, work_limit: u64) -> Vec<u32> {
        let draped = self.on_map(|map| map.exceeding(target, work_limit));
        let [fine, coarse] = self.surfaces();
        let both = || [exceeding(fine, coarse, target, work_limit), exceeding(coarse, fine, target, work_limit)];
        let [mut found, beyond] = draped.unwrap_or_else(both);
        let mut slot_of = vec![0; if beyond.is_empty() { 0 } else { coarse.triangle_count() }];
        if !beyond.is_empty() {
            (0..).zip(&coarse.original).for_each(|(slot, &t)| slot_of[t as usize] = slot);
        }
        // Where the coarser surface is too far off, the nearest triangles of the finer one are meant.
        let (mut last, mut visited) = (0, 0);
        for t in beyond {
            // Some of these places are enough where the search for each takes long.
            if visited > MOST_VISITS + MOST_VISITS_PER_TRIANGLE * fine.triangle_count() as u64 {
                break;
            }
            let corners = coarse.triangles[slot_of[t as usize] as usize].map(|v| coarse.positions[v as usize]);
            for p in corners.into_iter().chain([(corners[0] + corners[1] + corners[2]) / 3.0]) {
                let ((_, slot), visits) = fine.nearest_counted(p - fine.origin, last, 0.0);
                (last, visited) = (slot, visited + visits);
                found.extend(fine.original.get(slot as usize));
            }
        }
        found.retain(|&t| (t as usize) < fine.triangle_count());
        found.iter_mut().for_each(|t| *t = self.fine.triangle(*t));
        found
    }
}

/// The pairs of parts that correspond, those with a border first, and a distance that occurs between two; none if they
/// do not.
fn pairs_of(
    surfaces: [&Surface; 2],
    (of_fine, of_coarse): (Parts, Parts),
    pairing: &BorderPairing,
) -> Option<(Vec<Pair>, (f64, DVec3))> {
    let has_border = [of_fine.bordered.is_empty(), of_coarse.bordered.is_empty()];
    if has_border[0] != has_border[1] || of_fine.closed.len() != of_coarse.closed.len() {
        return None;
    }
    let partners = partners(&of_fine.closed, &of_coarse.closed)?;
    let mut pairs = vec![];
    if !of_fine.bordered.is_empty() {
        let bvh = |surface: &Surface, parts: &Parts| Arc::new(TriangleBvh::new(surface.positions, &parts.bordered));
        let [fine, coarse] = [bvh(surfaces[0], &of_fine), bvh(surfaces[1], &of_coarse)];
        let [fine, coarse] = [Side::Bordered(fine, of_fine.numbers), Side::Bordered(coarse, of_coarse.numbers)];
        pairs.push(Pair::new(fine, coarse, pairing.clone()));
    }
    let mut lower = (0.0, DVec3::ZERO);
    let mut others: Vec<Option<Part>> = of_coarse.closed.into_iter().map(Some).collect();
    for (fine, partner) in of_fine.closed.into_iter().zip(partners) {
        let coarse = others[partner].take()?;
        let beyond = fine.beyond(&coarse);
        if beyond.0 > lower.0 {
            lower = beyond;
        }
        pairs.push(Pair::new(Side::closed(fine), Side::closed(coarse), vec![]));
    }
    Some((pairs, lower))
}

impl Part {
    fn surface(&self) -> Surface<'_> {
        Surface::new(&self.positions, &self.triangles)
    }

    /// A distance that occurs between two parts, and where: by how much the box of one reaches beyond that of the
    /// other.
    fn beyond(&self, other: &Self) -> (f64, DVec3) {
        let mut most = (0.0, DVec3::ZERO);
        for (one, other) in [(self, other), (other, self)] {
            for axis in 0..3 {
                let [low, high] = one.bounds.map(|p| p[axis]);
                for (end, by) in [(low, other.bounds[0][axis] - low), (high, high - other.bounds[1][axis])] {
                    if by > most.0
                        && let Some(&at) = one.positions.iter().find(|p| p[axis] == end)
                    {
                        most = (by, at);
                    }
                }
            }
        }
        most
    }
}

impl Parts {
    /// The parts of a surface with these vertices on its border; none if it is in one part.
    fn new(surface: &Surface, border: impl Iterator<Item = u32>) -> Option<Self> {
        let component = components(surface.positions.len(), surface.triangles);
        let mut has_border = vec![false; component.len()];
        border.for_each(|v| {
            if let Some(&component) = component.get(v as usize) {
                has_border[component as usize] = true;
            }
        });
        let mut parts = Self { closed: vec![], bordered: vec![], numbers: vec![] };
        // The part of each component, and the number of each vertex there.
        let (mut part_of, mut numbers) = (vec![NONE; component.len()], vec![NONE; component.len()]);
        for (number, corners) in (0..).zip(surface.triangles) {
            let component = component[corners[0] as usize] as usize;
            if has_border[component] {
                parts.bordered.push(*corners);
                parts.numbers.push(number);
                continue;
            }
            if part_of[component] == NONE {
                part_of[component] = parts.closed.len() as u32;
                let bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                let (positions, triangles, numbers, vertices) = Default::default();
                parts.closed.push(Part { bounds, positions, triangles, numbers, vertices });
            }
            let part = &mut parts.closed[part_of[component] as usize];
            let own = corners.map(|v| {
                if numbers[v as usize] == NONE {
                    numbers[v as usize] = part.positions.len() as u32;
                    let position = surface.positions[v as usize];
                    part.bounds = [part.bounds[0].min(position), part.bounds[1].max(position)];
                    part.positions.push(position);
                    part.vertices.push(v);
                }
                numbers[v as usize]
            });
            part.triangles.push(own);
            part.numbers.push(number);
        }
        let count = parts.closed.len() + usize::from(!parts.bordered.is_empty());
        (count > 1).then_some(parts)
    }
}

/// For each of some parts the one among as many others whose box is most like its own; none if two have the same.
fn partners(parts: &[Part], others: &[Part]) -> Option<Vec<usize>> {
    let mut sorted: Vec<usize> = (0..others.len()).collect();
    let place = |part: &Part| part.bounds[0].x;
    sorted.sort_by(|&a, &b| place(&others[a]).total_cmp(&place(&others[b])).then(a.cmp(&b)));
    let difference = |a: &Part, b: &Part| {
        let [low, high] = [0, 1].map(|side| (a.bounds[side] - b.bounds[side]).abs().element_sum());
        low + high
    };
    let mut is_taken = vec![false; others.len()];
    let mut result = Vec::with_capacity(parts.len());
    for part in parts {
        let middle = sorted.partition_point(|&other| place(&others[other]) < place(part));
        let mut best: Option<(f64, usize)> = None;
        let mut look = |other: usize| -> bool {
            let reach = best.map_or(f64::INFINITY, |(least, _)| least);
            let off = difference(part, &others[other]);
            if off < reach {
                best = Some((off, other));
            }
            // Farther along, no box is more alike.
            (place(&others[other]) - place(part)).abs() <= reach
        };
        let _ = sorted[middle..].iter().take_while(|&&other| look(other)).count();
        let _ = sorted[..middle].iter().rev().take_while(|&&other| look(other)).count();
        let (_, partner) = best?;
        if std::mem::replace(&mut is_taken[partner], true) {
            return None;
        }
        result.push(partner);
    }
    Some(result)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Boxes in a row that touch, each moved by what `moved` says.
    fn boxes(count: usize, moved: impl Fn(usize) -> f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let (mut positions, mut triangles) = (vec![], vec![]);
        for i in 0..count {
            let first = positions.len() as u32;
            let corner = |bits: u32| DVec3::new(f64::from(bits & 1), f64::from(bits >> 1 & 1), f64::from(bits >> 2));
            positions.extend((0..8).map(|bits| corner(bits) + DVec3::X * (i as f64 + moved(i))));
            let quads = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
            triangles.extend(quads.map(|corners: [u32; 3]| corners.map(|v| v + first)));
        }
        (positions, triangles)
    }

    fn surface((positions, triangles): &(Vec<DVec3>, Vec<[u32; 3]>)) -> Surface<'_> {
        Surface::new(positions, triangles)
    }

    #[test]
    fn parts_are_compared_with_their_partners_and_never_bounded_too_low() {
        let options = CertifyOptions { relative_gap: 1e-3, ..CertifyOptions::default() };
        let (still, moved) = (boxes(40, |_| 0.0), boxes(40, |i| if i == 17 { 0.125 } else { 0.0 }));
        let [still, moved] = [&still, &moved].map(surface);
        let mut pairs = Comparison::new(&still, &moved, &vec![], vec![]);
        assert_eq!(pairs.part_count(), 40);
        let bound = pairs.two_sided(&options);
        assert!(bound.upper >= 0.125 && bound.upper <= 0.126, "{bound:?}");
        assert!(bound.upper >= two_sided(still.bvh(), moved.bvh(), &options).lower);
        let squares = pairs.squares(1);
        assert!(squares.len() == 320 && squares.iter().filter(|&&square| square > 0.01).count() == 4, "{squares:?}");
        // Others, or one part: a matter of the whole.
        let fewer = boxes(39, |_| 0.0);
        let fewer = surface(&fewer);
        let mut whole = Comparison::new(&still, &fewer, &vec![], vec![]);
        assert_eq!(whole.part_count(), 1);
        let bound = whole.two_sided(&options);
        assert!((1.0..1.01).contains(&bound.upper), "{bound:?}");
        let (one, other) = (boxes(1, |_| 0.0), boxes(1, |_| 0.1));
        assert_eq!(Comparison::new(&surface(&one), &surface(&other), &vec![], vec![]).part_count(), 1);
    }

    #[test]
    fn what_is_known_of_a_part_is_not_asked_again() {
        let (still, moved) = (boxes(40, |_| 0.0), boxes(40, |i| if i == 17 { 0.125 } else { 0.01 }));
        let [still, moved] = [&still, &moved].map(surface);
        let mut pairs = Comparison::new(&still, &moved, &vec![], vec![]);
        let rough = pairs.two_sided(&CertifyOptions { floor: 0.2, ..CertifyOptions::default() });
        assert!((0.125..=0.2).contains(&rough.upper), "{rough:?}");
        let tight = CertifyOptions { target: Some(0.13), relative_gap: 1e-3, ..CertifyOptions::default() };
        let bound = pairs.two_sided(&tight);
        assert!((0.125..=0.13).contains(&bound.upper), "{bound:?}");
        assert_eq!(pairs.two_sided(&tight), bound);
        // Exactly one part is too far off for a finer target, and its triangles are named as the caller knows them.
        let found = pairs.exceeding(0.1, u64::MAX);
        assert!(!found.is_empty() && found.iter().all(|&t| t / 12 == 17), "{found:?}");
        assert_eq!(pairs.exceeding(0.2, u64::MAX), [] as [u32; 0]);
    }
}
