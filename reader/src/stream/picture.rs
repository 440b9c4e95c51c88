//! The picture: a surface for each root of the cut, and its strips, which are rebuilt only where something changed.

use std::{
    collections::HashMap,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use super::{
    drawn_surface::{Beside, DrawnSurface, Strip},
    frame::Difference,
    heights::TileImages,
    history::History,
    light::{BorderLight, Stale},
    texel_content::DrawnTexture,
    users::Users,
};
use crate::{
    decode::{BorderKey, Mesh},
    error::Result,
    select::{Node, Projection, View},
    sorted::{SortedMap, SortedSet},
};

/// A root as it is drawn: its surface, and one strip of border triangles for each half-arc.
#[derive(Clone, Debug)]
pub struct DrawnRoot {
    /// Vertices, and the triangles inside.
    pub surface: Arc<DrawnSurface>,
    /// The triangles at the border.
    pub strips: Vec<Arc<Strip>>,
    /// The images of its block; until these are there perhaps those of another block, for their means.
    texture: Option<Arc<DrawnTexture>>,
    /// The images of a tile of heights.
    images: Option<Arc<TileImages>>,
    /// For each half-arc how it is drawn.
    sides: Vec<DrawnSide>,
    /// In a session with light the normals at the border.
    pub(super) light: Option<Arc<BorderLight>>,
    pub(super) light_stamp: u64,
    error: f64,
    stamp: u64,
}

/// A number that no other state of a root or picture has had, in any picture of this process. They ascend.
pub(super) fn new_stamp() -> u64 {
    static COUNT: AtomicU64 = AtomicU64::new(1);
    COUNT.fetch_add(1, Ordering::Relaxed)
}

/// The error of a root that is drawn with these strips.
fn error_of(surface: &DrawnSurface, strips: &[Arc<Strip>]) -> f64 {
    let is_beside_finer = strips.iter().any(|strip| !strip.positions.is_empty());
    surface.error + if is_beside_finer { surface.border_deviation } else { 0.0 }
}

/// How a half-arc is drawn. With its levels, what a strip takes from the roots beside it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DrawnSide {
    /// The level of the arc.
    level: u8,
    /// Whether the corner where it begins is drawn.
    has_corner: bool,
}

/// The roots beside one that is drawn.
struct Around<'s> {
    /// For each half-arc the surface on its other side, if it is finer.
    finer: Vec<Option<&'s DrawnSurface>>,
    sides: Vec<DrawnSide>,
}

impl<'s> Beside<'s> for Around<'s> {
    fn finer(&self, side: u32) -> Option<&'s DrawnSurface> {
        self.finer.get(side as usize).copied().flatten()
    }

    fn draws_corner(&self, side: u32) -> bool {
        self.sides.get(side as usize).is_some_and(|side| side.has_corner)
    }
}

impl DrawnRoot {
    /// A tile of heights, whose border is one strip.
    pub(crate) fn of_tile(surface: Arc<DrawnSurface>, strip: Strip, images: Arc<TileImages>) -> Self {
        Self { images: Some(images), ..Self::of(surface, vec![Arc::new(strip)]) }
    }

    fn of(surface: Arc<DrawnSurface>, strips: Vec<Arc<Strip>>) -> Self {
        let (error, light) = (error_of(&surface, &strips), BorderLight::of(&surface));
        let stamp = new_stamp();
        let (sides, light_stamp) = (Vec::new(), stamp);
        Self { surface, strips, texture: None, images: None, sides, light, light_stamp, error, stamp }
    }

    /// Gives it another border.
    fn set_strips(&mut self, strips: Vec<Arc<Strip>>, sides: Vec<DrawnSide>, counts: &mut Counts) {
        let before = self.counts();
        self.error = error_of(&self.surface, &strips);
        (self.strips, self.sides, self.stamp) = (strips, sides, new_stamp());
        counts.replace(Some(before), Some(self.counts()));
    }

    fn counts(&self) -> Counts {
        Counts { triangles: self.triangle_count() as u64, strips: self.strips.len() as u64 }
    }

    /// A number that another state of this root does not have: where it is the same as in an earlier frame, nothing of
    /// the root has changed.
    pub fn stamp(&self) -> u64 {
        self.stamp
    }

    /// The same for its normals: where the number is that of an earlier frame, neither its surface nor its normals have
    /// changed, though its strips and its images may have.
    pub fn light_stamp(&self) -> u64 {
        self.light_stamp
    }

    /// Bound of the two-sided distance between the drawn root and the input, world units: the block's error and, where
    /// a neighbour is finer, its border deviation.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// Its images, once they are there: of the channels that the session shows.
    pub fn texture(&self) -> Option<&Arc<DrawnTexture>> {
        let is_own = |texture: &&Arc<DrawnTexture>| {
            texture.root == self.surface.root && texture.texture.level == self.surface.level
        };
        self.texture.as_ref().filter(is_own)
    }

    /// The images of a tile of heights; none for other roots. [`DrawnRoot::places`] says where vertices lie in them.
    pub fn images(&self) -> Option<&Arc<TileImages>> {
        self.images.as_ref()
    }

    /// Of a tile of heights the place of each vertex that [`DrawnRoot::joined`] returns in the tile's images: the
    /// column and the row of the sample there, or what lies between two.
    pub fn places(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        self.surface.places.iter().chain(self.strips.iter().flat_map(|strip| &strip.places)).copied()
    }

    /// The mean of its image of a channel or, until that is there, of another block that is near; in the numbers of the
    /// image. `channel` counts those that the session shows.
    pub fn mean(&self, channel: usize) -> Option<[f64; 4]> {
        self.texture.as_ref()?.means.get(channel).copied().flatten()
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.surface.triangles.len() + self.strips.iter().map(|strip| strip.triangles.len()).sum::<usize>()
    }

    /// Which vertices of [`DrawnRoot::joined`] belong to marked objects; empty where none does.
    pub fn marks(&self) -> Vec<bool> {
        if !self.surface.has_marks() {
            return Vec::new();
        }
        let mut marks = self.surface.vertex_marks();
        self.strips.iter().for_each(|strip| marks.extend(&strip.marks));
        marks
    }

    /// One list of vertices and one of triangles, to draw at once: those of the surface, then those of each strip.
    pub fn joined(&self) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let (mut positions, mut triangles) = (self.surface.positions.clone(), self.surface.triangles.clone());
        let first = positions.len() as u32;
        for strip in &self.strips {
            let before = positions.len() as u32 - first;
            positions.extend(&strip.positions);
            let moved = |vertex: u32| if vertex < first { vertex } else { vertex + before };
            triangles.extend(strip.triangles.iter().map(|triangle| triangle.map(moved)));
        }
        (positions, triangles)
    }
}

/// What a viewer has to update since the last frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Roots whose surface is new, and with it all of their strips.
    pub surfaces: Vec<u32>,
    /// New strips of surfaces that are not new: root, and number of the half-arc.
    pub strips: Vec<(u32, u32)>,
    /// Roots that are no longer drawn.
    pub removed: Vec<u32>,
    /// Roots that have got their images.
    pub textures: Vec<u32>,
    /// In a session with light ([`super::Options::light`]): roots whose surface is not new, and whose normals at the
    /// border have changed.
    pub lights: Vec<u32>,
}

/// All roots that are drawn, none of them above another. There are no cracks: every arc is drawn with the samples of
/// its finer side, and every corner that is a vertex of the finest root around it.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    pub(super) roots: SortedMap<u32, DrawnRoot>,
    pub(super) users: Users,
    counts: Counts,
    history: History,
}

/// Of a picture or a root.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    triangles: u64,
    strips: u64,
}

impl Counts {
    /// Counts a root as it is now instead of as it was before.
    fn replace(&mut self, before: Option<Self>, after: Option<Self>) {
        let [before, after] = [before, after].map(Option::unwrap_or_default);
        self.triangles = self.triangles + after.triangles - before.triangles;
        self.strips = self.strips + after.strips - before.strips;
    }
}

impl Picture {
    /// The roots that are drawn, by number.
    pub fn roots(&self) -> impl ExactSizeIterator<Item = &DrawnRoot> {
        self.roots.values()
    }

    /// A root, if it is drawn.
    pub fn root(&self, root: u32) -> Option<&DrawnRoot> {
        self.roots.get(&root)
    }

    /// A number that another state of the picture does not have: where it is the same as in an earlier frame, no root
    /// has changed, come or gone.
    pub fn stamp(&self) -> u64 {
        self.history.stamp()
    }

    /// The roots that have changed, come or gone since the picture had a stamp, some of them more than once. None where
    /// that is not known, because the picture never had that stamp, or thousands of changes ago.
    pub fn changed_since(&self, stamp: u64) -> Option<impl Iterator<Item = u32> + '_> {
        self.history.since(stamp)
    }

    /// The largest error on the screen in a view, pixels.
    ///
    /// # Errors
    /// [`crate::Error::Query`] if something in the view is not finite or makes no sense.
    pub fn error_px(&self, view: &View) -> Result<f64> {
        let projection = Projection::new(view)?;
        let error = |drawn: &DrawnRoot| projection.look(drawn.surface.bounds).factor * drawn.error;
        Ok(self.roots().map(error).fold(0.0, f64::max))
    }

    /// The cut that is drawn.
    pub fn nodes(&self) -> Vec<Node> {
        self.roots.iter().map(|(&root, drawn)| Node { root, level: drawn.surface.level }).collect()
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> u64 {
        self.counts.triangles
    }

    /// The number of strips.
    pub(crate) fn strip_count(&self) -> u64 {
        self.counts.strips
    }

    /// All triangles as one mesh, with shared vertices once: for saving a picture, and for checks.
    pub fn mesh(&self) -> Mesh {
        let mut mesh = Mesh::default();
        let mut shared: HashMap<BorderKey, u32> = HashMap::new();
        for (node, drawn) in (0..).zip(self.roots()) {
            let mut vertex = |positions: &mut Vec<[f64; 3]>, key: Option<&BorderKey>, position: [f64; 3]| {
                let next = positions.len() as u32;
                let vertex = key.map_or(next, |&key| *shared.entry(key).or_insert(next));
                if vertex == next {
                    positions.push(position);
                }
                vertex
            };
            let surface = &drawn.surface;
            let keys = surface.keys.iter().map(Some).chain(std::iter::repeat(None));
            let vertices: Vec<u32> =
                keys.zip(&surface.positions).map(|(k, &p)| vertex(&mut mesh.positions, k, p)).collect();
            mesh.triangles.extend(surface.triangles.iter().map(|triangle| triangle.map(|k| vertices[k as usize])));
            for strip in &drawn.strips {
                let keyed = strip.keys.iter().zip(&strip.positions);
                let own: Vec<u32> = keyed.map(|(key, &p)| vertex(&mut mesh.positions, Some(key), p)).collect();
                let at = |k: u32| vertices.get(k as usize).or_else(|| own.get(k as usize - vertices.len())).copied();
                let triangles = strip.triangles.iter().map(|triangle| triangle.map(|k| at(k).unwrap_or_default()));
                mesh.triangles.extend(triangles);
            }
            mesh.triangle_nodes.resize(mesh.triangles.len(), node);
        }
        mesh
    }

    /// Gives a root images, or those of another block that stand for them.
    pub(crate) fn set_texture(&mut self, root: u32, texture: Option<Arc<DrawnTexture>>) {
        if let Some(drawn) = self.roots.get_mut(&root) {
            (drawn.texture, drawn.stamp) = (texture, new_stamp());
            self.history.note([root]);
        }
    }

    /// Gives a tile of heights other images.
    pub(crate) fn set_images(&mut self, root: u32, images: Arc<TileImages>) {
        if let Some(drawn) = self.roots.get_mut(&root) {
            (drawn.images, drawn.stamp) = (Some(images), new_stamp());
            self.history.note([root]);
        }
    }

    /// Draws a root whose neighbours somebody else looks after.
    pub(crate) fn show(&mut self, drawn: DrawnRoot) {
        self.history.note([drawn.surface.root]);
        self.put(drawn);
    }

    fn put(&mut self, drawn: DrawnRoot) {
        let after = drawn.counts();
        let before = self.roots.insert(drawn.surface.root, drawn).map(|before| before.counts());
        self.counts.replace(before, Some(after));
    }

    fn take(&mut self, root: u32) -> Option<DrawnRoot> {
        let drawn = self.roots.remove(&root)?;
        self.counts.replace(Some(drawn.counts()), None);
        Some(drawn)
    }

    /// Draws such a root no longer.
    pub(crate) fn hide(&mut self, root: u32) {
        self.history.note([root]);
        self.take(root);
    }

    /// Gives such a root another border.
    pub(crate) fn set_strip(&mut self, root: u32, strip: Strip) {
        if let Some(drawn) = self.roots.get_mut(&root) {
            self.history.note([root]);
            drawn.set_strips(vec![Arc::new(strip)], Vec::new(), &mut self.counts);
        }
    }

    /// Draws what is drawn otherwise. What stays as it is takes no time.
    pub(crate) fn update(&mut self, Difference { removed, surfaces }: Difference) -> Changes {
        let mut changes = Changes { removed, ..Changes::default() };
        let mut new = Vec::new();
        for surface in surfaces {
            match self.roots.get_mut(&surface.root) {
                // It was decoded again, with the same result.
                Some(drawn) if drawn.surface.level == surface.level && drawn.surface.states() == surface.states() => {
                    drawn.surface = surface;
                }
                _ => new.push(surface),
            }
        }
        let (mut affected, mut stale) = (SortedSet::new(), Stale::default());
        for root in &changes.removed {
            if let Some(drawn) = self.take(*root) {
                self.users.remove(&drawn.surface);
                stale.add(&drawn.surface);
                self.add_neighbours(&drawn.surface, &mut affected);
            }
        }
        for surface in &new {
            changes.surfaces.push(surface.root);
            if let Some(before) = self.roots.get(&surface.root) {
                self.users.replace(&before.surface, surface);
                stale.add(&before.surface);
            } else {
                self.users.add(surface);
            }
            stale.add(surface);
            self.put(DrawnRoot::of(surface.clone(), Vec::new()));
        }
        for surface in &new {
            self.add_neighbours(surface, &mut affected);
        }
        affected.extend(&changes.surfaces);
        for &root in affected.iter() {
            let Some(drawn) = self.roots.get(&root) else { continue };
            let (surface, around) = (&drawn.surface, self.around(&drawn.surface));
            let is_new = drawn.strips.is_empty();
            let mut strips = drawn.strips.clone();
            // Sides without triangles share one strip.
            strips.resize(around.sides.len(), Arc::default());
            for (side, strip) in strips.iter_mut().enumerate() {
                let is_stale = |&touched: &u32| drawn.sides.get(touched as usize) != around.sides.get(touched as usize);
                if surface.touches(side).iter().any(is_stale) {
                    *strip = Arc::new(surface.strip(side, &around));
                    if !is_new {
                        changes.strips.push((root, side as u32));
                    }
                }
            }
            let sides = around.sides;
            if let Some(drawn) = self.roots.get_mut(&root) {
                drawn.set_strips(strips, sides, &mut self.counts);
            }
        }
        changes.lights = self.relight(stale, affected.iter().copied());
        changes.lights.retain(|root| changes.surfaces.binary_search(root).is_err());
        for root in &changes.lights {
            if let Some(drawn) = self.roots.get_mut(root) {
                drawn.stamp = new_stamp();
                drawn.light_stamp = drawn.stamp;
            }
        }
        let changed = changes.removed.iter().chain(affected.iter()).chain(&changes.lights).copied();
        self.history.note(changed);
        changes
    }

    /// The roots whose strips may depend on a root: those across its arcs, and those that lack a corner which it may
    /// have.
    fn add_neighbours(&self, surface: &DrawnSurface, roots: &mut SortedSet<u32>) {
        roots.extend(surface.half_arcs().filter_map(|half_arc| self.users.across(surface.root, half_arc.arc)));
        for corner in surface.raised_corners() {
            let lacks = |root: &u32| self.level(*root).is_some_and(|level| level < corner.level);
            roots.extend(self.users.around(corner.corner).filter(lacks));
        }
    }

    fn level(&self, root: u32) -> Option<u8> {
        self.roots.get(&root).map(|drawn| drawn.surface.level)
    }

    /// What is drawn beside a surface.
    fn around(&self, surface: &DrawnSurface) -> Around<'_> {
        let (root, own) = (surface.root, surface.level);
        let across = |arc: u32| self.roots.get(&self.users.across(root, arc)?).map(|other| &*other.surface);
        let finer = surface.half_arcs().map(|half_arc| across(half_arc.arc).filter(|other| other.level > own));
        let finer: Vec<Option<&DrawnSurface>> = finer.collect();
        let side = |other: &Option<&DrawnSurface>| DrawnSide {
            level: other.map_or(own, |other| other.level),
            has_corner: true,
        };
        let mut sides: Vec<DrawnSide> = finer.iter().map(side).collect();
        for corner in surface.raised_corners().iter().filter(|corner| corner.level > own) {
            let is_vertex = |root: u32| self.level(root).is_some_and(|level| level >= corner.level);
            if let Some(side) = sides.get_mut(corner.side as usize) {
                side.has_corner = self.users.around(corner.corner).any(is_vertex);
            }
        }
        Around { finer, sides }
    }
}
