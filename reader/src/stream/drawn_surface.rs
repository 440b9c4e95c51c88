//! A root at a level, ready to draw: its interior is fixed, and the triangles at its border depend on its neighbours.
//!
//! Niski 2007, section 5.2.2, separates the interior of a node from its borders, so a border's index list is rebuilt only where a
//! neighbour has changed. Here a border is a **strip**, the triangles along one half-arc. Where the root on the other side is finer,
//! its samples of the arc are inserted. They are vertices of the strip, so the vertices of the surface never change.

use std::{collections::BTreeSet, ops::Range};

use crate::{
    codec::{arc::PARAM_END, patch::Patch},
    decode::{BorderEdges, BorderKey, BorderVertex, insert_samples},
    error::{Error, Result},
    format::{index_block::RootEntry, records::HalfArc},
    lattice::Lattice,
};

/// A root at one level.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnSurface {
    /// The root's number.
    pub root: u32,
    /// The level of its block.
    pub level: u8,
    /// World positions: the border, loop after loop, then the inside.
    pub positions: Vec<[f64; 3]>,
    /// The triangles that no neighbour changes, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// The identity of each border vertex within the whole surface.
    pub keys: Vec<BorderKey>,
    /// Bound of the two-sided distance to the input where no neighbour is finer, world units.
    pub error: f64,
    /// Added to the error where any neighbour is finer, world units.
    pub border_deviation: f64,
    sides: Vec<Side>,
    border: Vec<BorderTriangle>,
}

/// One half-arc of a surface.
#[derive(Clone, Debug, PartialEq)]
struct Side {
    half_arc: HalfArc,
    /// Its border vertices: the corner at its beginning and the samples.
    vertices: Range<u32>,
    /// Its strip, in `border`.
    triangles: Range<u32>,
    /// Sides whose samples go into the strip: itself, and others that its triangles lie on too.
    touches: Vec<u32>,
}

/// A triangle with a border edge.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BorderTriangle {
    corners: [u32; 3],
    /// Whether the edge from a corner to the next is a border edge.
    on_border: [bool; 3],
}

/// An edge of a surface that lies on an arc: where a finer neighbour's samples are inserted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BorderEdge {
    /// Number of the half-arc.
    pub side: u32,
    /// Parameters of its ends along the arc: 0 to [`PARAM_END`], falling where the half-arc is reversed.
    pub params: [u32; 2],
}

/// The triangles along one half-arc.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Strip {
    /// Vertices beyond those of the surface: world positions.
    pub positions: Vec<[f64; 3]>,
    /// The identity of each of them within the whole surface.
    pub keys: Vec<BorderKey>,
    /// Vertex indices: first the surface's, then the strip's own.
    pub triangles: Vec<[u32; 3]>,
}

impl DrawnSurface {
    pub(crate) fn new(
        root: u32,
        level: u8,
        entry: &RootEntry,
        border: &[Vec<BorderVertex>],
        patch: Patch,
        lattice: &Lattice,
    ) -> Result<Self> {
        let border_edges = BorderEdges::new(border.iter().map(Vec::len), &patch)?;
        let Some(block) = entry.blocks.get(entry.block_at(level)) else {
            return Err(Error::format("a root has no blocks"));
        };
        let vertices = border.iter().flatten();
        let points = vertices.clone().map(|vertex| vertex.position).chain(patch.interior);
        let mut surface = Self {
            root,
            level,
            positions: points.map(|point| lattice.world(point)).collect(),
            triangles: Vec::new(),
            keys: vertices.map(|vertex| vertex.key).collect(),
            error: block.error.bound(lattice),
            border_deviation: block.border_deviation.bound(lattice),
            sides: Vec::new(),
            border: Vec::new(),
        };
        surface.find_sides(entry)?;
        surface.sort_triangles(&patch.triangles, border_edges)?;
        Ok(surface)
    }

    /// Every side begins with a corner.
    fn find_sides(&mut self, entry: &RootEntry) -> Result<()> {
        let is_corner = |vertex: &u32| matches!(self.keys[*vertex as usize], BorderKey::Corner(_));
        let starts: Vec<u32> = (0..self.keys.len() as u32).filter(is_corner).collect();
        let ends = starts.iter().skip(1).copied().chain([self.keys.len() as u32]);
        let sides = entry.half_arcs().zip(starts.iter().zip(ends));
        let side =
            |(half_arc, (&start, end))| Side { half_arc, vertices: start..end, triangles: 0..0, touches: vec![] };
        self.sides = sides.map(side).collect();
        let count = entry.half_arcs().count();
        if starts.len() == count { Ok(()) } else { Err(Error::format("a patch has another border than its root")) }
    }

    fn sort_triangles(&mut self, triangles: &[[u32; 3]], mut border_edges: BorderEdges) -> Result<()> {
        let border_count = self.keys.len();
        let mut border: Vec<(u32, BorderTriangle)> = Vec::new();
        for &corners in triangles {
            let is_border_edge = |k: usize| {
                let vertex = corners[k] as usize;
                vertex < border_count && border_edges.next(vertex) == corners[(k + 1) % 3]
            };
            let on_border = [0, 1, 2].map(is_border_edge);
            for k in (0..3).filter(|&k| on_border[k]) {
                border_edges.add_triangle(corners[k] as usize)?;
            }
            match (0..3).find(|&k| on_border[k]) {
                Some(k) => border.push((self.side_of(corners[k]), BorderTriangle { corners, on_border })),
                None => self.triangles.push(corners),
            }
        }
        border_edges.finish()?;
        border.sort_by_key(|&(side, _)| side);
        for number in 0..self.sides.len() as u32 {
            let start = border.partition_point(|&(side, _)| side < number);
            let end = border.partition_point(|&(side, _)| side <= number);
            let mut touches = vec![number];
            for (_, triangle) in &border[start..end] {
                let edges = (0..3).filter(|&k| triangle.on_border[k]);
                touches.extend(edges.map(|k| self.side_of(triangle.corners[k])));
            }
            touches.sort_unstable();
            touches.dedup();
            let side = &mut self.sides[number as usize];
            (side.triangles, side.touches) = (start as u32..end as u32, touches);
        }
        self.border = border.into_iter().map(|(_, triangle)| triangle).collect();
        Ok(())
    }

    /// The side whose edge begins at a border vertex.
    fn side_of(&self, vertex: u32) -> u32 {
        self.sides.partition_point(|side| side.vertices.start <= vertex).saturating_sub(1) as u32
    }

    /// Its half-arcs, loop after loop, each with one strip.
    pub fn half_arcs(&self) -> impl ExactSizeIterator<Item = HalfArc> + '_ {
        self.sides.iter().map(|side| side.half_arc)
    }

    /// The triangles at the border as they are without finer neighbours, each with those of its edges that are border edges.
    pub fn border_triangles(&self) -> impl ExactSizeIterator<Item = ([u32; 3], [Option<BorderEdge>; 3])> + '_ {
        let edge = |[from, to]: [u32; 2]| {
            let side = self.side_of(from);
            let ends = self.sides[side as usize].half_arc.directed([0, PARAM_END]);
            let param = |vertex: u32, end: u32| match self.keys[vertex as usize] {
                BorderKey::Sample { param, .. } => param,
                BorderKey::Corner(_) => end,
            };
            BorderEdge { side, params: [param(from, ends[0]), param(to, ends[1])] }
        };
        let corners_of = move |&BorderTriangle { corners, on_border }: &BorderTriangle| {
            let [a, b, c] = corners;
            let edges = [[a, b], [b, c], [c, a]];
            (corners, [0, 1, 2].map(|k| on_border[k].then(|| edge(edges[k]))))
        };
        self.border.iter().map(corners_of)
    }

    /// The sides that a side's strip depends on.
    pub(crate) fn touches(&self, side: usize) -> &[u32] {
        &self.sides[side].touches
    }

    /// Its size in memory.
    pub(crate) fn byte_count(&self) -> u64 {
        let sides: usize = self.sides.iter().map(|side| size_of::<Side>() + 4 * side.touches.len()).sum();
        let bytes = size_of::<Self>() + 24 * self.positions.len() + 12 * self.triangles.len() + sides;
        (bytes + size_of::<BorderKey>() * self.keys.len() + size_of::<BorderTriangle>() * self.border.len()) as u64
    }

    /// Samples along an arc in the direction of a half-arc of it: parameter from where that begins, and index of the vertex.
    fn samples(&self, half_arc: HalfArc) -> Vec<(u32, u32)> {
        let side = self.sides.iter().find(|side| side.half_arc.arc == half_arc.arc);
        let vertices = side.map_or(0..0, |side| side.vertices.clone());
        let sample = |vertex: u32| match self.keys[vertex as usize] {
            BorderKey::Sample { param, .. } => Some((half_arc.along(param), vertex)),
            BorderKey::Corner(_) => None,
        };
        let mut samples: Vec<(u32, u32)> = vertices.filter_map(sample).collect();
        samples.sort_unstable();
        samples
    }

    /// The strip of a side. `finer` returns the surface on the other side of a half-arc, if it is finer.
    pub(crate) fn strip<'s>(&self, side: usize, finer: impl Fn(u32) -> Option<&'s DrawnSurface>) -> Strip {
        let mut strip = Strip::default();
        // Per touched side and edge the strip's own vertices.
        let mut inserted: Vec<(u32, Vec<Vec<u32>>)> = Vec::new();
        let triangles = self.sides[side].triangles.clone();
        let triangles = &self.border[triangles.start as usize..triangles.end as usize];
        let edges = triangles
            .iter()
            .flat_map(|triangle| (0..3).filter(|&k| triangle.on_border[k]).map(|k| triangle.corners[k]));
        let edges: BTreeSet<u32> = edges.collect();
        for &touched in &self.sides[side].touches {
            if let Some(other) = finer(touched) {
                inserted.push((touched, self.insert(touched, other, &edges, &mut strip)));
            }
        }
        for triangle in triangles {
            let extra = [0, 1, 2].map(|k| {
                let from = triangle.corners[k];
                let of_side = |(touched, edges): &'_ (u32, Vec<Vec<u32>>)| {
                    let vertices = &self.sides[*touched as usize].vertices;
                    if !vertices.contains(&from) { None } else { edges.get((from - vertices.start) as usize).cloned() }
                };
                let found = if triangle.on_border[k] { inserted.iter().find_map(of_side) } else { None };
                found.unwrap_or_default()
            });
            insert_samples(triangle.corners, [&extra[0], &extra[1], &extra[2]], &mut strip.triangles);
        }
        strip
    }

    /// Adds to a strip the samples of a side that only the other root has, as far as they lie on `edges`, which are named by their
    /// first vertex. Returns the samples in each edge of the side, in its direction.
    fn insert(&self, side: u32, other: &DrawnSurface, edges: &BTreeSet<u32>, strip: &mut Strip) -> Vec<Vec<u32>> {
        let Side { half_arc, vertices, .. } = &self.sides[side as usize];
        let own: Vec<u32> = self.samples(*half_arc).into_iter().map(|(along, _)| along).collect();
        let mut inserted = vec![Vec::new(); own.len() + 1];
        for (along, vertex) in other.samples(*half_arc) {
            let edge = own.partition_point(|&before| before < along);
            if own.get(edge) == Some(&along) || !edges.contains(&(vertices.start + edge as u32)) {
                continue;
            }
            inserted[edge].push((self.positions.len() + strip.positions.len()) as u32);
            strip.positions.push(other.positions[vertex as usize]);
            strip.keys.push(other.keys[vertex as usize]);
        }
        inserted
    }
}
