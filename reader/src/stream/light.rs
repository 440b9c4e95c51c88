//! Normals at the borders of drawn roots, which are the same on both sides (SPEC.md, 14.5).
//!
//! A vertex on an arc, or at a corner, has fans in each root that draws it. Two fans are one where they meet at an edge
//! along an arc that is no crease; what is joined so has one normal. It depends on the roots that have the vertex and
//! on nothing else, so that it is found anew only where one of them has come, gone or changed its level.

use std::sync::Arc;

use super::{
    drawn_surface::DrawnSurface,
    fans::{CREASE, End, Fans, first, join},
    octahedral::{NONE, Octahedral, direction, octahedral},
    picture::{DrawnRoot, Picture},
};
use crate::{
    codec::vector::{Vec3, add, dot, scale},
    decode::BorderKey,
};

/// A sum of normals that is shorter than this share of its parts has no direction.
const TINY: f64 = 1e-6;

/// The normals at the border of a drawn root.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct BorderLight {
    /// Of each fan there, in the order of [`Fans::sums`].
    pub border: Vec<Octahedral>,
    /// Of each vertex that strips have beyond those of the surface, strip after strip.
    pub inserted: Vec<Octahedral>,
}

impl BorderLight {
    /// The normals that a surface has alone.
    pub fn of(surface: &DrawnSurface) -> Option<Arc<Self>> {
        let fans = surface.fans.as_ref()?;
        let further = fans.sums.len() - fans.ends.len();
        let further = surface.positions.len()..surface.positions.len() + further;
        let border = [&fans.normals[..fans.ends.len()], &fans.normals[further]].concat();
        Some(Arc::new(Self { border, inserted: Vec::new() }))
    }
}

/// Arcs and corners whose roots have changed.
#[derive(Default)]
pub(super) struct Stale {
    arcs: Vec<u32>,
    corners: Vec<u32>,
}

impl Stale {
    /// Adds those of a surface that is drawn from now on, or no longer; none without light.
    pub fn add(&mut self, surface: &DrawnSurface) {
        if let Some(fans) = &surface.fans {
            self.arcs.extend(surface.half_arcs().map(|half_arc| half_arc.arc));
            self.corners.extend(fans.border_corners());
        }
    }
}

/// A fan at a vertex of several roots.
struct Member {
    root: u32,
    place: usize,
    sum: Vec3,
    own: Octahedral,
}

/// Where a fan ends at an arc: its number among the members, and the normal of its triangle there.
struct Reach {
    /// Twice the arc, and one more where the edge runs along its direction, seen from the vertex.
    edge: u64,
    member: u32,
    normal: Octahedral,
}

/// The roots at one vertex. It is filled again and again, so that nothing is allocated for each.
#[derive(Default)]
struct Meeting {
    members: Vec<Member>,
    reaches: Vec<Reach>,
    /// Places of these by edge.
    order: Vec<u64>,
    sets: Vec<u32>,
    /// Of each set, at its first member: the sum, that of its parts' lengths, and their number.
    sums: Vec<(Vec3, f64, u32)>,
}

impl Meeting {
    fn clear(&mut self) {
        self.members.clear();
        self.reaches.clear();
    }

    /// Adds a root by its vertex. Roots come in order.
    fn add(&mut self, surface: &DrawnSurface, fans: &Fans, vertex: u32) {
        let before = self.members.len() as u32;
        let vertex_count = surface.positions.len();
        let ends = fans.ends[vertex as usize];
        for (number, fan) in (before..).zip(fans.of_vertex(vertex, vertex_count)) {
            let place = fans.border_place(fan, vertex_count);
            let (sum, own) = (fans.sums[place].map(f64::from), fans.normals[fan as usize]);
            self.members.push(Member { root: surface.root, place, sum, own });
            for (end, leaves) in ends.into_iter().zip([true, false]).filter(|(end, _)| end.fan == fan) {
                let half_arc = surface.half_arc(end.side);
                let edge = u64::from(half_arc.arc) << 1 | u64::from(half_arc.reversed != leaves);
                self.reaches.push(Reach { edge, member: number, normal: end.normal });
            }
        }
    }

    /// Joins fans, and passes on the normal of each.
    fn settle(&mut self, mut found: impl FnMut(u32, usize, Octahedral)) {
        self.sets.clear();
        self.sets.extend(0..self.members.len() as u32);
        let mut order = std::mem::take(&mut self.order);
        order.clear();
        order.extend((0..).zip(&self.reaches).map(|(number, reach): (u64, _)| reach.edge << 24 | number));
        order.sort_unstable();
        for edge in order.chunk_by(|a, b| a >> 24 == b >> 24) {
            let &[a, b] = edge else { continue };
            let [a, b] = [a, b].map(|place| &self.reaches[place as usize & 0xff_ffff]);
            if cosine(a.normal, b.normal) > CREASE {
                join(&mut self.sets, a.member, b.member);
            }
        }
        self.order = order;
        self.sums.clear();
        self.sums.resize(self.members.len(), ([0.0; 3], 0.0, 0));
        let mut first_sum = None;
        for number in 0..self.members.len() as u32 {
            let set = first(&mut self.sets, number);
            let part = self.members[number as usize].sum;
            let length = dot(part, part).sqrt();
            let (sum, weight, count) = &mut self.sums[set as usize];
            if length > 0.0 {
                (*sum, *weight, *count) = (add(*sum, part), *weight + length, *count + 1);
                first_sum.get_or_insert(set);
            }
        }
        for number in 0..self.members.len() as u32 {
            let mut set = first(&mut self.sets, number);
            // Triangles without normals are seen only where neighbours insert vertices.
            if self.sums[set as usize].2 == 0 {
                set = first_sum.unwrap_or(set);
            }
            let Member { root, place, .. } = self.members[number as usize];
            let (sum, weight, count) = self.sums[set as usize];
            let length = dot(sum, sum).sqrt();
            let is_sum = count > 1 && length > TINY * weight;
            let normal = if is_sum { octahedral(scale(sum, 1.0 / length)) } else { self.members[set as usize].own };
            found(root, place, normal);
        }
    }
}

/// The cosine of the angle between two directions; below all if one is none.
fn cosine(a: Octahedral, b: Octahedral) -> f64 {
    if a == NONE || b == NONE { f64::NEG_INFINITY } else { dot(direction(a), direction(b)) }
}

/// A normal that was found: root, place, normal.
type Found = (u32, usize, Octahedral);

impl Picture {
    /// Finds normals along arcs and at corners whose roots have changed, and those of all strips of some roots. Returns
    /// the roots that have got others, ascending.
    pub(super) fn relight(&mut self, stale: Stale, strips: impl Iterator<Item = u32>) -> Vec<u32> {
        let Stale { mut arcs, mut corners } = stale;
        let mut relit = Vec::new();
        if arcs.is_empty() {
            return relit;
        }
        for numbers in [&mut arcs, &mut corners] {
            numbers.sort_unstable();
            numbers.dedup();
        }
        let (mut meeting, mut found) = (Meeting::default(), Vec::new());
        let mut samples = Vec::new();
        for arc in arcs {
            found.clear();
            self.light_arc(arc, &mut samples, &mut meeting, &mut found);
            for root in self.users.beside(arc) {
                self.take_normals(root, &found, &mut relit);
            }
        }
        for corner in corners {
            meeting.clear();
            for root in self.users.at_corner(corner) {
                let Some(surface) = self.surface(root) else { continue };
                let Some(fans) = &surface.fans else { continue };
                fans.vertices_of_corner(corner).for_each(|vertex| meeting.add(surface, fans, vertex));
            }
            found.clear();
            meeting.settle(|root, place, normal| found.push((root, place, normal)));
            for of_root in found.chunk_by(|a, b| a.0 == b.0) {
                self.take_normals(of_root[0].0, of_root, &mut relit);
            }
        }
        for root in strips {
            let Some(inserted) = self.roots.get(&root).and_then(|drawn| self.inserted(drawn)) else { continue };
            let light = self.roots.get_mut(&root).and_then(|drawn| drawn.light.as_mut());
            if let Some(light) = light.filter(|light| light.inserted != inserted) {
                Arc::make_mut(light).inserted = inserted;
                relit.push(root);
            }
        }
        relit.sort_unstable();
        relit.dedup();
        relit
    }

    fn surface(&self, root: u32) -> Option<&DrawnSurface> {
        Some(&self.roots.get(&root)?.surface)
    }

    /// The normals at the samples of an arc.
    fn light_arc(&self, arc: u32, samples: &mut Vec<u64>, meeting: &mut Meeting, found: &mut Vec<Found>) {
        let [a, b] = self.users.beside(arc);
        let surfaces = [a.min(b), a.max(b)].map(|root| self.surface(root));
        samples.clear();
        for (surface, which) in surfaces.iter().zip(0_u64..) {
            let Some(surface) = surface else { continue };
            for &side in surface.sides_of_arc(arc) {
                let vertices = surface.samples(side);
                let keys = &surface.keys[vertices.start as usize..vertices.end as usize];
                // By parameter, then by root.
                samples.extend(keys.iter().zip(vertices).filter_map(|(key, vertex)| match *key {
                    BorderKey::Sample { param, .. } => Some(u64::from(param) << 33 | which << 32 | u64::from(vertex)),
                    BorderKey::Corner(_) => None,
                }));
            }
        }
        samples.sort_unstable();
        for same in samples.chunk_by(|a, b| a >> 33 == b >> 33) {
            meeting.clear();
            for &sample in same {
                let Some(surface) = surfaces[usize::from(sample >> 32 & 1 == 1)] else { continue };
                let Some(fans) = &surface.fans else { continue };
                meeting.add(surface, fans, sample as u32);
            }
            meeting.settle(|root, place, normal| found.push((root, place, normal)));
        }
    }

    /// Gives a root what was found for it, and notes it if that is new.
    fn take_normals(&mut self, root: u32, found: &[Found], relit: &mut Vec<u32>) {
        let Some(light) = self.roots.get_mut(&root).and_then(|drawn| drawn.light.as_mut()) else { return };
        let own = || found.iter().filter(|(other, ..)| *other == root);
        if own().all(|&(_, place, normal)| light.border.get(place) == Some(&normal)) {
            return;
        }
        let border = &mut Arc::make_mut(light).border;
        for &(_, place, normal) in own() {
            if let Some(known) = border.get_mut(place) {
                *known = normal;
            }
        }
        relit.push(root);
    }

    /// The normals of the vertices that a root's strips have beyond its own: those of the finer roots that have them,
    /// on the side that is nearest.
    fn inserted(&self, drawn: &DrawnRoot) -> Option<Vec<Octahedral>> {
        let (surface, fans) = (&*drawn.surface, drawn.surface.fans.as_ref()?);
        let strips = drawn.strips.iter().flat_map(|strip| strip.keys.iter().zip(&strip.edges));
        let normal = |(key, &edge): (&BorderKey, &u32)| {
            // That of the triangle which the edge is part of.
            let own = fans.ends[edge as usize][0].normal;
            let mut nearest = (f64::NEG_INFINITY, own);
            let mut look = |drawn: &DrawnRoot, vertex: u32, arcs: [u32; 2]| {
                let (surface, Some(fans), Some(light)) = (&drawn.surface, &drawn.surface.fans, &drawn.light) else {
                    return;
                };
                for End { fan, side, normal } in fans.ends[vertex as usize] {
                    let cosine = if own == NONE { 1.0 } else { cosine(own, normal) };
                    if cosine > nearest.0 && arcs.contains(&surface.half_arc(side).arc) {
                        let place = fans.border_place(fan, surface.positions.len());
                        nearest = (cosine, light.border.get(place).copied().unwrap_or(own));
                    }
                }
            };
            match *key {
                BorderKey::Sample { arc, param } => {
                    let other = self.users.across(surface.root, arc).and_then(|root| self.roots.get(&root));
                    for (other, &side) in other
                        .iter()
                        .flat_map(|other| other.surface.sides_of_arc(arc).iter().map(move |side| (other, side)))
                    {
                        if let Some(vertex) = other.surface.vertex_of_sample(side, param) {
                            look(other, vertex, [arc; 2]);
                        }
                    }
                }
                BorderKey::Corner(corner) => {
                    let arcs = surface.arcs_around_passed(edge, corner);
                    for root in self.users.at_corner(corner) {
                        let (Some(other), Some(arcs)) = (self.roots.get(&root), arcs) else { continue };
                        let fans = other.surface.fans.iter();
                        fans.flat_map(|fans| fans.vertices_of_corner(corner))
                            .for_each(|vertex| look(other, vertex, arcs));
                    }
                }
            }
            if nearest.0 > CREASE { nearest.1 } else { own }
        };
        Some(strips.map(normal).collect())
    }
}
