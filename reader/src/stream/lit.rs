//! A root's triangles with normals, for programs that draw it in smooth light.

use super::{fans::Fans, octahedral::Octahedral, picture::DrawnRoot};
use crate::{
    codec::vector::{scale, sub},
    decode::Mesh,
};

/// A root's triangles with a normal at each vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lit {
    /// World positions, as [`DrawnRoot::joined`] has them. Vertices at which a crease ends are there once for each side
    /// of it, at the end.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// The normal of each vertex, in two numbers: [`super::direction`] returns it. Normals point outwards.
    pub normals: Vec<[i16; 2]>,
}

/// The normals of a root whose border somebody else joins to its neighbours: as [`Lit`], without strips.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Light {
    /// Vertices of the surface at which creases end, once for each further side of one. They count as vertices after
    /// those of the surface.
    pub further: Vec<u32>,
    /// The normals of the surface's vertices, then of the further ones.
    pub normals: Vec<[i16; 2]>,
    /// The normals of the vertices that strips have beyond those of the surface, strip after strip.
    pub strip_normals: Vec<[i16; 2]>,
    /// The surface's triangles, then those at the border, as [`super::DrawnSurface::border_triangles`] lists them.
    pub triangles: Vec<[u32; 3]>,
}

impl Lit {
    /// A mesh by itself, by the rule of SPEC.md, 14.4; without normals if it has more than 2^32 corners. For overviews.
    pub fn of(mesh: &Mesh) -> Self {
        let Mesh { mut positions, mut triangles, .. } = mesh.clone();
        // In a unit in which areas are in the range of numbers.
        let origin = positions.first().copied().unwrap_or_default();
        let offsets = positions.iter().map(|&position| sub(position, origin));
        let most = offsets.clone().flatten().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
        let points: Vec<[f64; 3]> = offsets.map(|offset| scale(offset, 1.0 / most)).collect();
        let Some((fans, corners)) = Fans::new(&points, 0, &triangles) else {
            return Self { positions, triangles, ..Self::default() };
        };
        positions.extend(fans.further.iter().map(|&vertex| mesh.positions[vertex as usize]));
        triangles.as_flattened_mut().copy_from_slice(&corners.fans);
        Self { positions, triangles, normals: fans.normals }
    }
}

impl DrawnRoot {
    /// [`DrawnRoot::joined`] with normals for smooth light (SPEC.md, 14.5); None in a session without light. Where
    /// [`DrawnRoot::stamp`] is the same as before, normals are, too.
    pub fn lit(&self) -> Option<Lit> {
        let fans = self.surface.fans.as_ref()?;
        let (mut positions, mut triangles) = self.joined();
        let [first, further] = self.fan_normals(fans)?;
        let further_from = positions.len() as u32;
        self.turn_to_further(fans, further_from, &mut triangles);
        positions.extend(fans.further.iter().map(|&vertex| self.surface.positions[vertex as usize]));
        let inserted = self.light.as_ref().map_or(&[][..], |light| &light.inserted);
        let mut normals = first;
        normals.extend_from_slice(inserted);
        normals.extend(further);
        normals.resize(positions.len(), [0; 2]);
        Some(Lit { positions, triangles, normals })
    }

    /// The normals of a root for programs that join borders themselves; None in a session without light.
    pub fn light(&self) -> Option<Light> {
        let (surface, fans) = (&self.surface, self.surface.fans.as_ref()?);
        let normals = self.fan_normals(fans)?.concat();
        let border = surface.border_triangles().map(|(corners, _)| corners);
        let mut triangles: Vec<[u32; 3]> = surface.triangles.iter().copied().chain(border).collect();
        for (corner, fan) in fans.further_corners(0) {
            triangles[corner as usize / 3][corner as usize % 3] = fan;
        }
        let strip_normals = self.light.as_ref()?.inserted.clone();
        Some(Light { further: fans.further.clone(), normals, strip_normals, triangles })
    }

    /// The normals of the first fans of all vertices, and of the further ones.
    fn fan_normals(&self, fans: &Fans) -> Option<[Vec<Octahedral>; 2]> {
        let (first, further) = fans.normals.split_at(self.surface.positions.len());
        let (at_border, further_at_border) = self.light.as_ref()?.border.split_at(fans.ends.len());
        let further_inside = &further[further_at_border.len()..];
        Some([[at_border, &first[at_border.len()..]].concat(), [further_at_border, further_inside].concat()])
    }

    /// Gives corners of joined triangles that are of further fans their own vertices, which begin at a number.
    fn turn_to_further(&self, fans: &Fans, further_from: u32, triangles: &mut [[u32; 3]]) {
        let surface = &self.surface;
        let inner_count = surface.triangles.len();
        let vertex_of = |fan: u32| further_from + fan - surface.positions.len() as u32;
        for (corner, fan) in fans.further_corners(0).take_while(|(corner, _)| (*corner as usize) < 3 * inner_count) {
            triangles[corner as usize / 3][corner as usize % 3] = vertex_of(fan);
        }
        let mut corners = fans.further_corners(inner_count as u32).peekable();
        let mut begin = inner_count;
        for (side, strip) in self.strips.iter().enumerate() {
            let range = surface.border_range(side);
            let end_of_strip = begin + strip.triangles.len();
            let end = 3 * (inner_count as u32 + range.end);
            if corners.peek().is_some_and(|(corner, _)| *corner < end) {
                for number in range {
                    let (own, on_border) = surface.border_triangle(number);
                    // Each vertex that is inserted adds a triangle.
                    let inserted = |k: usize| {
                        let edges = &strip.edges;
                        edges.partition_point(|&edge| edge <= own[k]) - edges.partition_point(|&edge| edge < own[k])
                    };
                    let count = 1 + (0..3).filter(|&k| on_border[k]).map(inserted).sum::<usize>();
                    let triangle = inner_count as u32 + number;
                    while let Some((corner, fan)) = corners.next_if(|(corner, _)| corner / 3 == triangle) {
                        let vertex = own[corner as usize % 3];
                        let parts = triangles.iter_mut().skip(begin).take(count).flatten();
                        parts.filter(|part| **part == vertex).for_each(|part| *part = vertex_of(fan));
                    }
                    begin += count;
                }
            }
            begin = end_of_strip;
        }
    }
}
