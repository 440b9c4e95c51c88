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
    heights::TileImages,
    texel_content::DrawnTexture,
    users::Users,
};
use crate::{
    decode::{BorderKey, Mesh},
    select::Node,
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
    stamp: u64,
}

/// A number that no other state of a root or picture has had, in any picture of this process.
fn new_stamp() -> u64 {
    static COUNT: AtomicU64 = AtomicU64::new(1);
    COUNT.fetch_add(1, Ordering::Relaxed)
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
        let (strips, images) = (vec![Arc::new(strip)], Some(images));
        Self { surface, strips, texture: None, images, sides: Vec::new(), stamp: new_stamp() }
    }

    /// A number that another state of this root does not have: where it is the same as in an earlier frame, nothing of the root has changed.
    pub fn stamp(&self) -> u64 {
        self.stamp
    }

    /// Bound of the two-sided distance between the drawn root and the input, world units: the block's error and, where a neighbour is
    /// finer, its border deviation.
    pub fn error(&self) -> f64 {
        let is_beside_finer = self.strips.iter().any(|strip| !strip.positions.is_empty());
        self.surface.error + if is_beside_finer { self.surface.border_deviation } else { 0.0 }
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

    /// Of a tile of heights the place of each vertex that [`DrawnRoot::joined`] returns in the tile's images: the column and the row of the
    /// sample there, or what lies between two.
    pub fn places(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        self.surface.places.iter().chain(self.strips.iter().flat_map(|strip| &strip.places)).copied()
    }

    /// The mean of its image of a channel or, until that is there, of another block that is near; in the numbers of the image. `channel`
    /// counts those that the session shows.
    pub fn mean(&self, channel: usize) -> Option<[f64; 4]> {
        self.texture.as_ref()?.means.get(channel).copied().flatten()
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.surface.triangles.len() + self.strips.iter().map(|strip| strip.triangles.len()).sum::<usize>()
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
}

/// All roots that are drawn, none of them above another. There are no cracks: every arc is drawn with the samples of its finer side, and
/// every corner that is a vertex of the finest root around it.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    roots: SortedMap<u32, DrawnRoot>,
    users: Users,
    triangle_count: u64,
    stamp: u64,
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

    /// A number that another state of the picture does not have: where it is the same as in an earlier frame, no root has changed, come or
    /// gone.
    pub fn stamp(&self) -> u64 {
        self.stamp
    }

    /// The cut that is drawn.
    pub fn nodes(&self) -> Vec<Node> {
        self.roots.iter().map(|(&root, drawn)| Node { root, level: drawn.surface.level }).collect()
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> u64 {
        self.triangle_count
    }

    /// The number of strips.
    pub(crate) fn strip_count(&self) -> u64 {
        self.roots().map(|drawn| drawn.strips.len() as u64).sum()
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
            drawn.texture = texture;
            (drawn.stamp, self.stamp) = (new_stamp(), new_stamp());
        }
    }

    /// Gives a tile of heights other images.
    pub(crate) fn set_images(&mut self, root: u32, images: Arc<TileImages>) {
        if let Some(drawn) = self.roots.get_mut(&root) {
            drawn.images = Some(images);
            (drawn.stamp, self.stamp) = (new_stamp(), new_stamp());
        }
    }

    /// Draws a root whose neighbours somebody else looks after.
    pub(crate) fn show(&mut self, drawn: DrawnRoot) {
        self.stamp = new_stamp();
        self.triangle_count += drawn.triangle_count() as u64;
        let before = self.roots.insert(drawn.surface.root, drawn);
        self.triangle_count -= before.map_or(0, |before| before.triangle_count() as u64);
    }

    /// Draws such a root no longer.
    pub(crate) fn hide(&mut self, root: u32) {
        self.stamp = new_stamp();
        self.triangle_count -= self.roots.remove(&root).map_or(0, |before| before.triangle_count() as u64);
    }

    /// Gives such a root another border.
    pub(crate) fn set_strip(&mut self, root: u32, strip: Strip) {
        if let Some(drawn) = self.roots.get_mut(&root) {
            self.triangle_count -= drawn.triangle_count() as u64;
            drawn.strips = vec![Arc::new(strip)];
            (drawn.stamp, self.stamp) = (new_stamp(), new_stamp());
            self.triangle_count += drawn.triangle_count() as u64;
        }
    }

    /// Draws these surfaces, sorted by root.
    pub(crate) fn update(&mut self, surfaces: Vec<Arc<DrawnSurface>>) -> Changes {
        let mut changes = Changes::default();
        // Both lists are sorted, so one walk finds removed and new roots.
        let mut new = Vec::new();
        let mut drawn = self.roots.iter_mut().peekable();
        for surface in surfaces {
            while let Some((&root, _)) = drawn.next_if(|(root, _)| **root < surface.root) {
                changes.removed.push(root);
            }
            match drawn.next_if(|(root, _)| **root == surface.root) {
                // It was decoded again, with the same result.
                Some((_, drawn)) if drawn.surface.level == surface.level => drawn.surface = surface,
                _ => new.push(surface),
            }
        }
        changes.removed.extend(drawn.map(|(&root, _)| root));
        let mut affected = SortedSet::new();
        for root in &changes.removed {
            if let Some(drawn) = self.roots.remove(root) {
                self.triangle_count -= drawn.triangle_count() as u64;
                self.users.remove(&drawn.surface);
                self.add_neighbours(&drawn.surface, &mut affected);
            }
        }
        for surface in &new {
            changes.surfaces.push(surface.root);
            let drawn = DrawnRoot {
                surface: surface.clone(),
                strips: Vec::new(),
                sides: Vec::new(),
                texture: None,
                images: None,
                stamp: new_stamp(),
            };
            self.triangle_count += drawn.triangle_count() as u64;
            match self.roots.insert(surface.root, drawn) {
                Some(before) => self.triangle_count -= before.triangle_count() as u64,
                None => self.users.add(surface),
            }
        }
        for surface in &new {
            self.add_neighbours(surface, &mut affected);
        }
        affected.extend(&changes.surfaces);
        for root in affected {
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
                self.triangle_count -= drawn.triangle_count() as u64;
                (drawn.strips, drawn.sides, drawn.stamp) = (strips, sides, new_stamp());
                self.triangle_count += drawn.triangle_count() as u64;
            }
        }
        if changes != Changes::default() {
            self.stamp = new_stamp();
        }
        changes
    }

    /// The roots whose strips may depend on a root: those across its arcs, and those that lack a corner which it may have.
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
