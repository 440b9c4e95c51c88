//! A root at a level, ready to draw: its interior is fixed, and the triangles at its border depend on its neighbours.
//!
//! Niski 2007, section 5.2.2, separates the interior of a node from its borders, so a border's index list is rebuilt
//! only where a neighbour has changed. Here a border is a **strip**, the triangles along one half-arc. Where the root
//! on the other side is finer, its samples of the arc are inserted. They are vertices of the strip, so the vertices of
//! the surface never change.
//!
//! In a tree a border edge may pass corners that are no vertices at the surface's level, and so lie on several
//! half-arcs. It belongs to the strip of the first one. Where a finer root has such a corner as a vertex, the corner is
//! inserted too.

use std::{ops::Range, sync::Arc};

use super::fans::{End, Fans};
use crate::{
    codec::{arc::PARAM_END, patch::Patch, vector::to_f64},
    decode::{BorderEdges, BorderKey, BorderSide, BorderVertex, insert_samples},
    error::{Error, Result},
    format::{index_block::RootEntry, records::HalfArc},
    index::needs::Wanted,
    islands::islands,
    lattice::{Lattice, LatticePoint},
    objects::{ObjectFilter, ObjectState},
    sorted::in_order,
};

/// A root at one level.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnSurface {
    /// The root's number.
    pub root: u32,
    /// The level of its block.
    pub level: u8,
    /// A box around it, world coordinates.
    pub bounds: [[f64; 3]; 2],
    /// World positions: the border, loop after loop, then the inside.
    pub positions: Vec<[f64; 3]>,
    /// Of a tile of heights the place of each vertex in its images: index column and index row. Empty for other roots.
    pub places: Vec<[f32; 2]>,
    /// The triangles that no neighbour changes, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// The identity of each border vertex within the whole surface.
    pub keys: Vec<BorderKey>,
    /// Bound of the two-sided distance to the input where no neighbour is finer, world units.
    pub error: f64,
    /// Added to the error where any neighbour is finer, world units.
    pub border_deviation: f64,
    /// In a file with channels the triangle of the block's patch that each triangle is: those of `triangles`, then
    /// those at the border, as [`DrawnSurface::border_triangles`] lists them.
    pub origins: Vec<u32>,
    sides: Vec<Side>,
    /// Numbers of the sides, by arc.
    sides_by_arc: Vec<u32>,
    /// Corners that are not vertices at every level, by the side that begins there.
    raised_corners: Vec<RaisedCorner>,
    border: Vec<BorderTriangle>,
    /// In a session with light: what it has of that by itself.
    pub(super) fans: Option<Box<Fans>>,
    /// Of a leaf with several islands in a file with objects: the island of each triangle, in the order of `origins`.
    islands: Vec<u32>,
    /// How each island is drawn, or all triangles; empty where all are drawn as always.
    states: Vec<ObjectState>,
    /// The surface with all objects, where some of them are not drawn, or marked.
    whole: Option<Arc<DrawnSurface>>,
}

/// One half-arc of a surface.
#[derive(Clone, Debug, PartialEq)]
struct Side {
    half_arc: HalfArc,
    /// Its border vertices: the corner at its beginning, if that is one, and the samples.
    vertices: Range<u32>,
    /// Its strip, in `border`.
    triangles: Range<u32>,
    /// Sides whose samples and first corners go into the strip: all that edges of its triangles lie on.
    touches: Vec<u32>,
}

/// A corner of a surface's loops that is not a vertex at every level.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RaisedCorner {
    /// Number of the half-arc that begins there.
    pub side: u32,
    pub corner: u32,
    /// The coarsest level at which it is a vertex.
    pub level: u8,
    /// World position.
    position: [f64; 3],
}

/// How the roots beside a surface change its border.
pub(crate) trait Beside<'s> {
    /// The surface on the other side of a half-arc, if it is finer.
    fn finer(&self, side: u32) -> Option<&'s DrawnSurface>;

    /// Whether the corner where a half-arc begins is drawn. Asked only where it is no vertex of the surface.
    fn draws_corner(&self, side: u32) -> bool;
}

/// A triangle with a border edge.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BorderTriangle {
    corners: [u32; 3],
    /// Whether the edge from a corner to the next is a border edge.
    on_border: [bool; 3],
}

/// The part of a border edge that lies on one half-arc: where a finer neighbour's samples are inserted.
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
    /// In a strip of a tile of heights the place of each of them in the tile's images.
    pub places: Vec<[f32; 2]>,
    /// The identity of each of them within the whole surface.
    pub keys: Vec<BorderKey>,
    /// Vertex indices: first the surface's, then the strip's own.
    pub triangles: Vec<[u32; 3]>,
    /// In a file with channels, for each triangle the one of the block's patch in which it lies.
    pub origins: Vec<u32>,
    /// In a session with light: for each of its own vertices the surface's vertex where the border edge begins that has
    /// it. They ascend.
    pub(super) edges: Vec<u32>,
    /// Where objects of the surface are marked: whether each of its own vertices belongs to one.
    pub marks: Vec<bool>,
}

impl DrawnSurface {
    /// A block with its border: the vertices, loop after loop, and the half-arcs.
    pub(crate) fn new(
        &Wanted { root, level, .. }: &Wanted,
        entry: &RootEntry,
        (loops, sides): (&[Vec<BorderVertex>], Vec<BorderSide>),
        patch: Patch,
        (lattice, has_light): (&Lattice, bool),
    ) -> Result<Self> {
        let border_edges = BorderEdges::new(loops.iter().map(Vec::len), &patch)?;
        let Some(block) = entry.blocks.get(entry.block_at(level)) else {
            return Err(Error::format("a root has no blocks"));
        };
        let vertices = loops.iter().flatten();
        let points: Vec<LatticePoint> = vertices.clone().map(|vertex| vertex.position).chain(patch.interior).collect();
        let mut surface = Self {
            root,
            level,
            bounds: entry.bounds.map(|point| lattice.world(point)),
            positions: points.iter().map(|&point| lattice.world(point)).collect(),
            places: Vec::new(),
            triangles: Vec::new(),
            keys: vertices.map(|vertex| vertex.key).collect(),
            error: block.error.bound(lattice),
            border_deviation: block.border_deviation.bound(lattice),
            origins: Vec::new(),
            sides: Vec::with_capacity(sides.len()),
            sides_by_arc: in_order(sides.iter().map(|side| side.half_arc.arc)),
            raised_corners: Vec::new(),
            border: Vec::new(),
            fans: None,
            islands: Vec::new(),
            states: Vec::new(),
            whole: None,
        };
        for (side, BorderSide { half_arc, vertices, corner, corner_level }) in (0..).zip(sides) {
            if let (BorderKey::Corner(number), 1..) = (corner.key, corner_level) {
                let position = lattice.world(corner.position);
                surface.raised_corners.push(RaisedCorner { side, corner: number, level: corner_level, position });
            }
            surface.sides.push(Side { half_arc, vertices, triangles: 0..0, touches: Vec::new() });
        }
        surface.sort_triangles(&patch.triangles, border_edges)?;
        if has_light {
            let points: Vec<_> = points.into_iter().map(to_f64).collect();
            surface.fans = surface.find_fans(&points).map(Box::new);
        }
        Ok(surface)
    }

    /// A tile of heights: the vertices, first those on its border, which have keys, and the triangles that no neighbour
    /// changes.
    pub(crate) fn of_tile(
        (root, level): (u32, u8),
        (positions, places): (Vec<[f64; 3]>, Vec<[f32; 2]>),
        keys: Vec<BorderKey>,
        triangles: Vec<[u32; 3]>,
        error: f64,
    ) -> Self {
        let (origins, sides, sides_by_arc, raised_corners, border) = Default::default();
        let border_deviation = 0.0;
        let ends = |axis: usize| {
            let along = positions.iter().map(|position| position[axis]);
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
        };
        let ends = [0, 1, 2].map(ends);
        Self {
            root,
            level,
            bounds: [0, 1].map(|end| ends.map(|axis| axis[end])),
            positions,
            places,
            triangles,
            keys,
            error,
            border_deviation,
            origins,
            sides,
            sides_by_arc,
            raised_corners,
            border,
            fans: None,
            islands: Vec::new(),
            states: Vec::new(),
            whole: None,
        }
    }

    /// Its fans, in lattice steps, with the ends of the border's edges.
    fn find_fans(&self, points: &[[f64; 3]]) -> Option<Fans> {
        let at_border = self.border.iter().map(|triangle| triangle.corners);
        let triangles: Vec<[u32; 3]> = self.triangles.iter().copied().chain(at_border).collect();
        let (mut fans, corners) = Fans::new(points, self.keys.len(), &triangles)?;
        fans.ends = vec![[End::default(); 2]; self.keys.len()];
        for (number, triangle) in (self.triangles.len()..).zip(&self.border) {
            for k in (0..3).filter(|&k| triangle.on_border[k]) {
                let sides = self.sides_of_edge(triangle.corners[k]);
                let next = (k + 1) % 3;
                let end =
                    |k: usize, side| End { fan: corners.fans[3 * number + k], side, normal: corners.normal(number) };
                fans.ends[triangle.corners[k] as usize][0] = end(k, sides.start);
                fans.ends[triangle.corners[next] as usize][1] = end(next, sides.end - 1);
            }
        }
        fans.set_border_corners((0..).zip(&self.keys).filter_map(|(vertex, key)| match *key {
            BorderKey::Corner(corner) => Some((corner, vertex)),
            BorderKey::Sample { .. } => None,
        }));
        Some(fans)
    }

    fn sort_triangles(&mut self, triangles: &[[u32; 3]], mut border_edges: BorderEdges) -> Result<()> {
        let border_count = self.keys.len();
        let mut border: Vec<(u32, u32, BorderTriangle)> = Vec::new();
        for (number, &corners) in (0..).zip(triangles) {
            let is_border_edge = |k: usize| {
                let vertex = corners[k] as usize;
                vertex < border_count && border_edges.next(vertex) == corners[(k + 1) % 3]
            };
            let on_border = [0, 1, 2].map(is_border_edge);
            for k in (0..3).filter(|&k| on_border[k]) {
                border_edges.add_triangle(corners[k] as usize)?;
            }
            match (0..3).find(|&k| on_border[k]) {
                Some(k) => border.push((self.side_of(corners[k]), number, BorderTriangle { corners, on_border })),
                None => {
                    self.triangles.push(corners);
                    self.origins.push(number);
                }
            }
        }
        border_edges.finish()?;
        let border: Vec<_> =
            in_order(border.iter().map(|&(side, ..)| side)).into_iter().map(|at| border[at as usize]).collect();
        for number in 0..self.sides.len() as u32 {
            let start = border.partition_point(|&(side, ..)| side < number);
            let end = border.partition_point(|&(side, ..)| side <= number);
            let mut touches = Vec::new();
            for (.., triangle) in &border[start..end] {
                let edges = (0..3).filter(|&k| triangle.on_border[k]);
                touches.extend(edges.flat_map(|k| self.sides_of_edge(triangle.corners[k])));
            }
            touches.sort_unstable();
            touches.dedup();
            let side = &mut self.sides[number as usize];
            (side.triangles, side.touches) = (start as u32..end as u32, touches);
        }
        self.origins.extend(border.iter().map(|&(_, number, _)| number));
        self.border = border.into_iter().map(|(.., triangle)| triangle).collect();
        Ok(())
    }

    /// Forgets which triangles of the patch these are: only maps need to know.
    pub(crate) fn forget_origins(&mut self) {
        self.origins = Vec::new();
    }

    /// Finds its islands, for the objects that own them. Needs its origins.
    pub(crate) fn find_islands(&mut self) {
        let (labels, count) = islands(&self.patch_triangles());
        if count > 1 {
            self.islands = self.origins.iter().map(|&origin| labels[origin as usize]).collect();
        }
    }

    /// The surface with all objects.
    pub(crate) fn whole(self: &Arc<Self>) -> &Arc<Self> {
        self.whole.as_ref().unwrap_or(self)
    }

    /// How its objects are drawn: states of islands.
    pub(crate) fn states(&self) -> &[ObjectState] {
        &self.states
    }

    /// The surface as a filter shows it; `before` is what the last frame drew, which may be that already. A group that
    /// only stands in for what is below it is drawn as it is.
    pub(crate) fn filtered(self: &Arc<Self>, filter: Option<&ObjectFilter>, before: Option<&Arc<Self>>) -> Arc<Self> {
        let Some(filter) = filter else { return Arc::clone(self) };
        let states = match filter.state(self.root) {
            Some(state) => vec![state],
            None => filter.islands(self.root, self.level).unwrap_or_default().to_vec(),
        };
        if states.iter().all(|&state| state == ObjectState::Shown) {
            return Arc::clone(self);
        }
        let is_it = |before: &&Arc<Self>| {
            before.states == states && before.whole.as_ref().is_some_and(|whole| Arc::ptr_eq(whole, self))
        };
        before.filter(is_it).cloned().unwrap_or_else(|| Arc::new(self.with_states(states)))
    }

    /// The state of a triangle: of the inner ones, then of those at the border.
    fn state_of(&self, triangle: usize) -> ObjectState {
        let state = match &self.states[..] {
            [all] => Some(all),
            states => self.islands.get(triangle).and_then(|&island| states.get(island as usize)),
        };
        state.copied().unwrap_or_default()
    }

    /// Takes out the triangles of hidden objects. All vertices stay: neighbours take samples from them.
    fn with_states(self: &Arc<Self>, states: Vec<ObjectState>) -> Self {
        let mut this = Self { states, whole: Some(Arc::clone(self)), ..Self::clone(self) };
        let (inner_count, count) = (this.triangles.len(), this.triangles.len() + this.border.len());
        let stays: Vec<bool> = (0..count).map(|triangle| this.state_of(triangle) != ObjectState::Hidden).collect();
        if stays.iter().all(|&stays| stays) {
            return this;
        }
        /// Keeps the items of what stays.
        fn retain<T>(items: &mut Vec<T>, stays: &[bool]) {
            let mut stays = stays.iter();
            items.retain(|_| stays.next() != Some(&false));
        }
        retain(&mut this.triangles, &stays);
        retain(&mut this.border, &stays[inner_count..]);
        retain(&mut this.origins, &stays);
        retain(&mut this.islands, &stays);
        // How many triangles at the border stay before each.
        let mut next = 0;
        let mut numbers = vec![0];
        for &stays in &stays[inner_count..] {
            next += u32::from(stays);
            numbers.push(next);
        }
        for side in &mut this.sides {
            let Range { start, end } = side.triangles.clone();
            side.triangles = numbers[start as usize]..numbers[end as usize];
            if side.triangles.is_empty() {
                side.touches = Vec::new();
            }
        }
        if let Some(fans) = &mut this.fans {
            fans.retain_triangles(&stays);
        }
        this
    }

    /// Whether any object of it is marked.
    pub fn has_marks(&self) -> bool {
        self.states.contains(&ObjectState::Marked)
    }

    /// Which triangles belong to marked objects ([`crate::objects::ObjectChoice::marked`]): the inner ones, then those
    /// at the border.
    pub fn marks(&self) -> impl ExactSizeIterator<Item = bool> + '_ {
        (0..self.triangles.len() + self.border.len()).map(|triangle| self.state_of(triangle) == ObjectState::Marked)
    }

    /// Which vertices belong to marked objects; none has vertices in common with others.
    pub fn vertex_marks(&self) -> Vec<bool> {
        let mut marks = vec![false; self.positions.len()];
        let corners = self.triangles.iter().chain(self.border.iter().map(|triangle| &triangle.corners));
        for (corners, _) in corners.zip(self.marks()).filter(|(_, is_marked)| *is_marked) {
            corners.iter().for_each(|&vertex| marks[vertex as usize] = true);
        }
        marks
    }

    /// The triangles of the block's patch, in its order, if they are known.
    pub(crate) fn patch_triangles(&self) -> Vec<[u32; 3]> {
        let mut triangles = vec![[0; 3]; self.origins.len()];
        let own = self.triangles.iter().copied().chain(self.border.iter().map(|triangle| triangle.corners));
        for (corners, &origin) in own.zip(&self.origins) {
            triangles[origin as usize] = corners;
        }
        triangles
    }

    /// The side whose edge begins at a border vertex.
    fn side_of(&self, vertex: u32) -> u32 {
        self.sides.partition_point(|side| side.vertices.start <= vertex).saturating_sub(1) as u32
    }

    /// Whether the corner where a side begins is a vertex. Where a loop begins it is.
    fn has_corner(&self, side: u32) -> bool {
        let vertices = &self.sides[side as usize].vertices;
        !vertices.is_empty() && matches!(self.keys[vertices.start as usize], BorderKey::Corner(_))
    }

    /// The sides on which the edge from a border vertex to the next one of its loop lies.
    fn sides_of_edge(&self, from: u32) -> Range<u32> {
        let side = self.side_of(from);
        let mut end = side + 1;
        let goes_on = |end: u32| {
            // The edge passes all sides without vertices, and ends at the first vertex.
            let before = &self.sides[end as usize - 1].vertices;
            (before.is_empty() || end == side + 1 && before.end == from + 1) && !self.has_corner(end)
        };
        while (end as usize) < self.sides.len() && goes_on(end) {
            end += 1;
        }
        side..end
    }

    /// Parameters of the ends of the edge between two border vertices on one of its sides, from where that begins.
    fn ends_along(&self, [from, to]: [u32; 2], sides: &Range<u32>, side: u32) -> [u32; 2] {
        let along = |vertex: u32| match self.keys[vertex as usize] {
            BorderKey::Sample { param, .. } => Some(self.sides[side as usize].half_arc.along(param)),
            BorderKey::Corner(_) => None,
        };
        let begin = if side == sides.start { along(from) } else { None };
        let end = if side + 1 == sides.end { along(to) } else { None };
        [begin.unwrap_or(0), end.unwrap_or(PARAM_END)]
    }

    /// Its half-arcs, loop after loop, each with one strip.
    pub fn half_arcs(&self) -> impl ExactSizeIterator<Item = HalfArc> + '_ {
        self.sides.iter().map(|side| side.half_arc)
    }

    /// The triangles at the border as they are without finer neighbours. Each comes with the half-arcs that its edges
    /// lie on, in the order of the loop: none for an edge inside, mostly one for a border edge, and several for one
    /// that passes corners which are no vertices at this level.
    pub fn border_triangles(&self) -> impl ExactSizeIterator<Item = ([u32; 3], [Vec<BorderEdge>; 3])> + '_ {
        let parts = |ends: [u32; 2]| {
            let sides = self.sides_of_edge(ends[0]);
            let part = |side: u32| {
                let half_arc = self.sides[side as usize].half_arc;
                BorderEdge { side, params: self.ends_along(ends, &sides, side).map(|along| half_arc.along(along)) }
            };
            sides.clone().map(part).collect()
        };
        let corners_of = move |&BorderTriangle { corners, on_border }: &BorderTriangle| {
            let edge = |k: usize| if on_border[k] { parts([corners[k], corners[(k + 1) % 3]]) } else { Vec::new() };
            (corners, [0, 1, 2].map(edge))
        };
        self.border.iter().map(corners_of)
    }

    /// Corners of its loops that are no vertices at this level: for each the half-arc that begins there, and its
    /// number. Strips have those that finer neighbours draw.
    pub fn passed_corners(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let passed = self.raised_corners.iter().filter(|corner| corner.level > self.level);
        passed.map(|corner| (corner.side, corner.corner))
    }

    /// The sides that a side's strip depends on; none where it is empty.
    pub(crate) fn touches(&self, side: usize) -> &[u32] {
        &self.sides[side].touches
    }

    /// The corners of its loops that are not vertices at every level.
    pub(crate) fn raised_corners(&self) -> &[RaisedCorner] {
        &self.raised_corners
    }

    /// Its size in memory.
    pub(crate) fn byte_count(&self) -> u64 {
        let sides: usize = self.sides.iter().map(|side| size_of::<Side>() + 4 * (1 + side.touches.len())).sum();
        let bytes = size_of::<Self>() + 24 * self.positions.len() + 12 * self.triangles.len() + sides;
        let bytes = bytes + 4 * (self.origins.len() + self.islands.len()) + 8 * self.places.len();
        let bytes = bytes + size_of::<RaisedCorner>() * self.raised_corners.len();
        let bytes = bytes + self.fans.as_ref().map_or(0, |fans| fans.byte_count());
        (bytes + size_of::<BorderKey>() * self.keys.len() + size_of::<BorderTriangle>() * self.border.len()) as u64
    }

    /// Visits the vertices of an arc's samples between two parameters, in the direction of a half-arc of it; the
    /// parameters are measured from where that begins.
    fn visit_samples(&self, half_arc: HalfArc, [after, before]: [u32; 2], visit: impl FnMut(usize)) {
        let arc_of = |side: &u32| self.sides[*side as usize].half_arc.arc;
        let at = self.sides_by_arc.partition_point(|side| arc_of(side) < half_arc.arc);
        let Some(&side) = self.sides_by_arc.get(at).filter(|side| arc_of(side) == half_arc.arc) else { return };
        let Side { half_arc: own, ref vertices, .. } = self.sides[side as usize];
        let first = vertices.start as usize + usize::from(self.has_corner(side));
        let samples = &self.keys[first..vertices.end as usize];
        let is_same = own.reversed == half_arc.reversed;
        let [after, before] = if is_same { [after, before] } else { [PARAM_END - before, PARAM_END - after] };
        let along = |key: &BorderKey| match *key {
            BorderKey::Sample { param, .. } => own.along(param),
            BorderKey::Corner(_) => 0,
        };
        let start = first + samples.partition_point(|key| along(key) <= after);
        let end = first + samples.partition_point(|key| along(key) < before);
        if is_same { (start..end).for_each(visit) } else { (start..end).rev().for_each(visit) }
    }

    /// The sides of an arc: two where the surface is on both sides of it.
    pub(super) fn sides_of_arc(&self, arc: u32) -> &[u32] {
        let arc_of = |side: &u32| self.sides[*side as usize].half_arc.arc;
        let first = self.sides_by_arc.partition_point(|side| arc_of(side) < arc);
        let count = self.sides_by_arc[first..].iter().take_while(|side| arc_of(side) == arc).count();
        &self.sides_by_arc[first..first + count]
    }

    /// The half-arc of a side.
    pub(super) fn half_arc(&self, side: u32) -> HalfArc {
        self.sides[side as usize].half_arc
    }

    /// The vertices of a side that are samples of its arc, in the direction of the loop.
    pub(super) fn samples(&self, side: u32) -> Range<u32> {
        let vertices = &self.sides[side as usize].vertices;
        vertices.start + u32::from(self.has_corner(side))..vertices.end
    }

    /// The vertex of a side that is this sample of its arc.
    pub(super) fn vertex_of_sample(&self, side: u32, param: u32) -> Option<u32> {
        let (half_arc, samples) = (self.half_arc(side), self.samples(side));
        let along = |key: &BorderKey| match *key {
            BorderKey::Sample { param, .. } => half_arc.along(param),
            BorderKey::Corner(_) => 0,
        };
        let keys = self.keys.get(samples.start as usize..samples.end as usize)?;
        let at = keys.binary_search_by_key(&half_arc.along(param), along).ok()?;
        Some(samples.start + at as u32)
    }

    /// The arcs on which a border edge lies before and after a corner that it passes.
    pub(super) fn arcs_around_passed(&self, edge_from: u32, corner: u32) -> Option<[u32; 2]> {
        let sides = self.sides_of_edge(edge_from);
        let is_it = |side: &u32| {
            let at = self.raised_corners.binary_search_by_key(side, |corner| corner.side);
            at.is_ok_and(|at| self.raised_corners[at].corner == corner)
        };
        let side = (sides.start + 1..sides.end).find(is_it)?;
        Some([side - 1, side].map(|side| self.half_arc(side).arc))
    }

    /// The triangles at the border that are in the strip of a side: numbers in [`DrawnSurface::border_triangles`].
    pub(super) fn border_range(&self, side: usize) -> Range<u32> {
        self.sides[side].triangles.clone()
    }

    /// A triangle at the border, and for each corner whether the edge to the next one is a border edge.
    pub(super) fn border_triangle(&self, number: u32) -> ([u32; 3], [bool; 3]) {
        let BorderTriangle { corners, on_border } = self.border[number as usize];
        (corners, on_border)
    }

    /// The strip of a side.
    pub(crate) fn strip<'s>(&self, side: usize, beside: &impl Beside<'s>) -> Strip {
        let mut strip = Strip::default();
        let Side { triangles, touches, .. } = &self.sides[side];
        let mut origins = self.origins.iter().skip(self.triangles.len() + triangles.start as usize);
        let triangles = &self.border[triangles.start as usize..triangles.end as usize];
        // By the first vertex of an edge: the strip's own vertices on it.
        let mut inserted: Vec<(u32, Range<usize>)> = Vec::new();
        let has_more =
            |&side: &u32| beside.finer(side).is_some() || !self.has_corner(side) && beside.draws_corner(side);
        if touches.iter().any(has_more) {
            let edges_of = |&BorderTriangle { corners, on_border }: &BorderTriangle| {
                (0..3).filter(move |&k| on_border[k]).map(move |k| [corners[k], corners[(k + 1) % 3]])
            };
            let number = |[from, to]: [u32; 2]| u64::from(from) << 32 | u64::from(to);
            let mut edges: Vec<u64> = triangles.iter().flat_map(edges_of).map(number).collect();
            edges.sort_unstable();
            for edge in edges.into_iter().map(|edge| [(edge >> 32) as u32, edge as u32]) {
                let start = strip.positions.len();
                self.insert(edge, beside, &mut strip);
                if self.fans.is_some() {
                    strip.edges.resize(strip.positions.len(), edge[0]);
                }
                if strip.positions.len() > start {
                    inserted.push((edge[0], start..strip.positions.len()));
                }
            }
        }
        let first = self.positions.len() as u32;
        let vertices: Vec<u32> = (first..first + strip.positions.len() as u32).collect();
        let mut states = (self.triangles.len() + self.sides[side].triangles.start as usize)..;
        if self.has_marks() {
            strip.marks = vec![false; strip.positions.len()];
        }
        for &BorderTriangle { corners, on_border } in triangles {
            let is_marked = states.next().is_some_and(|number| self.state_of(number) == ObjectState::Marked);
            let extra = [0, 1, 2].map(|k| {
                let found = inserted.binary_search_by_key(&corners[k], |&(from, _)| from);
                found.ok().filter(|_| on_border[k]).map_or(&[][..], |found| &vertices[inserted[found].1.clone()])
            });
            for &vertex in extra.into_iter().flatten().filter(|_| is_marked) {
                strip.marks[(vertex - first) as usize] = true;
            }
            insert_samples(corners, extra, &mut strip.triangles);
            if let Some(&origin) = origins.next() {
                strip.origins.resize(strip.triangles.len(), origin);
            }
        }
        strip
    }

    /// Adds to a strip what the roots beside an edge have on it and this one lacks, in the direction of the loop.
    fn insert<'s>(&self, ends: [u32; 2], beside: &impl Beside<'s>, strip: &mut Strip) {
        let sides = self.sides_of_edge(ends[0]);
        for side in sides.clone() {
            if side > sides.start
                && let Ok(at) = self.raised_corners.binary_search_by_key(&side, |corner| corner.side)
                && beside.draws_corner(side)
            {
                strip.positions.push(self.raised_corners[at].position);
                strip.keys.push(BorderKey::Corner(self.raised_corners[at].corner));
            }
            if let Some(other) = beside.finer(side) {
                let half_arc = self.sides[side as usize].half_arc;
                other.visit_samples(half_arc, self.ends_along(ends, &sides, side), |vertex| {
                    strip.positions.push(other.positions[vertex]);
                    strip.keys.push(other.keys[vertex]);
                });
            }
        }
    }
}
