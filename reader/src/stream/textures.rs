//! Which roots of a picture get which images, of which size, and in what order (Niski 2007, sections 3.3.3 and 6.1.1).
//!
//! An image belongs to one block, because its map divides that block's patch. So a root is drawn with the images of the
//! block that is drawn. Until these are there, and where they are not needed, the mean over the nearest coarser block
//! that is there stands for them: an image of one texel.
//!
//! The error of texels is one of their own: **a texel a pixel**. So the images of a root are wanted where the view
//! shows it, and where it is larger than a pixel: first an eighth of their size, or less where images of the same level
//! have shown that it is enough, then the size at which a texel is nearest to a pixel. Those of the largest roots come
//! first, because there the mean is worst. Without a view all are wanted whole, in any order.
//!
//! All images of a picture together keep to a budget. Whoever has more than is seen keeps it while there is room.
//! Where there is none, images become coarser: first those that are finer than they look, then all.

use std::{sync::Arc, time::Duration};

use super::{
    content::FileContent,
    drawn_surface::DrawnSurface,
    loader::{Loader, UnitState},
    picture::{Changes, Picture},
    queue::Class,
    texel_content::{DrawnTexture, EIGHTH, Extent, FULL, TexelContent, TexelUnit},
};
use crate::select::Projection;
use crate::sorted::{SortedMap, SortedSet};

/// Added to the priority of a root that has no images yet, and of one that frees memory.
const NOTHING_YET: u8 = 64;
const FREES: u8 = 128;

/// The largest texel, in pixels: half of it is as much smaller than a pixel.
const LARGEST_TEXEL: f64 = std::f64::consts::SQRT_2;

/// What is shown, and how well.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wishes<'v> {
    /// Without one everything is shown from as near as may be.
    pub view: Option<&'v Projection>,
    /// Along each side of a pixel, as near as halving allows.
    pub texels_per_pixel: f64,
    /// The most bytes of all images.
    pub budget: u64,
}

/// The images that a root is drawn with.
#[derive(Clone, Copy, Debug)]
struct Held {
    unit: TexelUnit,
    extent: Extent,
}

/// A root of the picture.
#[derive(Clone, Copy, Debug, Default)]
struct Root {
    held: Option<Held>,
    /// Whether images were given up.
    is_lost: bool,
    /// Pixels in a unit of length, and the binary logarithm of its own size in pixels; none where it needs no images.
    need: Option<(f64, u8)>,
    /// The size that it is to have.
    goal: u8,
}

impl Root {
    fn bytes(&self, size: u8) -> u64 {
        self.held.map_or(0, |held| held.extent.bytes(size))
    }

    /// The size of the images that it has.
    fn size(&self) -> u8 {
        self.held.map_or(0, |held| held.unit.size)
    }

    /// The size at which a texel is nearest to a pixel, or to some part of one. `step` is the lattice's.
    fn wanted(&self, wishes: &Wishes<'_>, step: f64) -> u8 {
        let (Some(held), Some((factor, _))) = (self.held, self.need) else { return EIGHTH.min(self.size()) };
        if self.is_lost {
            return self.size();
        }
        wishes.size(held.extent.texel * step * factor)
    }
}

impl Wishes<'_> {
    /// The size at which images are wanted whose texels have so many pixels along each side at [`FULL`].
    fn size(&self, texel: f64) -> u8 {
        if self.view.is_none() {
            return FULL;
        }
        let (mut texel, mut size) = (texel * self.texels_per_pixel.max(0.0), FULL);
        while size > 0 && 2.0 * texel <= LARGEST_TEXEL {
            (texel, size) = (2.0 * texel, size - 1);
        }
        size
    }
}

/// The images of a picture's roots, kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Textures {
    roots: SortedMap<u32, Root>,
    /// The side of a texel in images that came last, by level, in lattice units: those of a level are much alike.
    texels: SortedMap<u8, f64>,
    /// What the frame before was shown from, if nothing is to do until something changes.
    settled: Option<Option<Projection>>,
}

impl Textures {
    /// Forgets all images, because other channels are shown from now on.
    pub fn restart(&mut self, picture: &mut Picture) {
        let roots: Vec<u32> = picture.roots().map(|drawn| drawn.surface.root).collect();
        roots.iter().for_each(|&root| picture.set_texture(root, None));
        self.roots = roots.into_iter().map(|root| (root, Root::default())).collect();
        self.settled = None;
    }

    /// Makes the next frame look at roots anew whose images were given up.
    pub fn doubt(&mut self) {
        self.roots.values_mut().for_each(|root| root.is_lost = false);
        self.settled = None;
    }

    /// Takes the roots that are new in a picture, and lets go of the images of those that are gone.
    pub fn follow(
        &mut self,
        loader: &mut Loader<TexelContent>,
        content: &FileContent,
        picture: &mut Picture,
        changes: &Changes,
    ) {
        for root in changes.removed.iter().chain(&changes.surfaces) {
            if let Some(held) = self.roots.remove(root).and_then(|root| root.held) {
                loader.release(held.unit);
            }
            self.settled = None;
        }
        for &root in &changes.surfaces {
            let Some(surface) = picture.root(root).map(|drawn| Arc::clone(&drawn.surface)) else { continue };
            picture.set_texture(root, stand_in(loader, content, &surface));
            self.roots.insert(root, Root::default());
        }
    }

    /// Wants what is missing, and gives the picture what has come. Returns how many roots lack images that they need.
    pub fn demand(
        &mut self,
        loader: &mut Loader<TexelContent>,
        (picture, changes): (&mut Picture, &mut Changes),
        wishes: &Wishes<'_>,
        now: Duration,
    ) -> u32 {
        loader.begin_frame();
        if self.settled == Some(wishes.view.copied()) {
            loader.end_wants();
            return 0;
        }
        let content = Arc::clone(loader.content());
        let mut frame = Demand { loader, content: &content, picture, now, wanted: SortedSet::new(), late: 0 };
        let mut changed = SortedSet::new();
        let step = content.index().lattice().step();
        let mut total: u64 = self.roots.values().map(|root| root.bytes(root.size())).sum();
        for (&number, root) in self.roots.iter_mut() {
            root.need = need(&content, wishes.view, number);
            let Some((factor, pixels)) = root.need.filter(|_| root.held.is_none() && !root.is_lost) else { continue };
            let level = frame.picture.root(number).map_or(0, |drawn| drawn.surface.level);
            let size = match self.texels.get(&level) {
                _ if wishes.view.is_none() && total < wishes.budget => FULL,
                Some(texel) => wishes.size(texel * step * factor).min(EIGHTH),
                None => EIGHTH,
            };
            if frame.has(number, root, size, NOTHING_YET + pixels) {
                frame.give(number, root, size);
                changed.insert(number);
                total += root.bytes(size);
                if let Some(held) = root.held.filter(|held| held.extent.texel > 0.0) {
                    self.texels.insert(level, held.extent.texel);
                }
            }
        }
        set_goals(&mut self.roots, wishes, step);
        let mut is_open = frame.late > 0;
        // What frees memory comes first.
        for frees in [true, false] {
            for (&number, root) in self.roots.iter_mut() {
                let (size, goal) = (root.size(), root.goal);
                if root.held.is_none() || root.is_lost || goal == size || (goal < size) != frees {
                    continue;
                }
                let pixels = root.need.map_or(0, |(_, pixels)| pixels);
                let has = frame.has(number, root, goal, if frees { FREES + pixels } else { pixels });
                let after = total - root.bytes(size) + root.bytes(goal);
                if has && (frees || after <= wishes.budget) {
                    frame.give(number, root, goal);
                    changed.insert(number);
                    total = after;
                } else if !root.is_lost {
                    is_open = true;
                    // It waits for room.
                    frame.late += u32::from(has);
                }
            }
        }
        let Demand { wanted, late, .. } = frame;
        changes.textures.extend(changed.iter());
        loader.end_wants();
        content.keep_surfaces(|unit| wanted.contains(&unit) || loader.is_loading(unit));
        self.settled = (!is_open).then(|| wishes.view.copied());
        late
    }
}

/// A frame that gives roots their images.
struct Demand<'f> {
    loader: &'f mut Loader<TexelContent>,
    content: &'f TexelContent,
    picture: &'f mut Picture,
    now: Duration,
    wanted: SortedSet<TexelUnit>,
    /// Roots that lack images.
    late: u32,
}

impl Demand<'_> {
    fn unit(&self, root: u32, size: u8) -> Option<(TexelUnit, Arc<DrawnSurface>)> {
        let surface = Arc::clone(&self.picture.root(root)?.surface);
        Some((TexelUnit { level: surface.level, root, size }, surface))
    }

    /// Whether images of a size are there. If not they are wanted.
    fn has(&mut self, number: u32, root: &mut Root, size: u8, priority: u8) -> bool {
        let Some((unit, surface)) = self.unit(number, size) else { return false };
        if self.loader.state(unit) == UnitState::Coming {
            self.content.add_surface(unit, &surface);
            self.wanted.insert(unit);
        }
        match self.loader.want(unit, Class::Demand, priority, self.now) {
            UnitState::Decoded => return true,
            UnitState::Coming => self.late += u32::from(root.held.is_none_or(|held| held.unit.size < size)),
            // It keeps what it has, or what stands for it.
            UnitState::Failed => root.is_lost = true,
        }
        false
    }

    /// Draws a root with images that are there.
    fn give(&mut self, number: u32, root: &mut Root, size: u8) {
        let Some((unit, _)) = self.unit(number, size) else { return };
        let Some(texture) = self.loader.take(unit) else { return };
        self.loader.hold(unit);
        if let Some(before) = root.held.replace(Held { unit, extent: texture.extent }) {
            self.loader.release(before.unit);
        }
        self.picture.set_texture(number, Some(texture));
    }
}

/// Decides about sizes: what is wanted, and what is there already where the budget has room for it.
fn set_goals(roots: &mut SortedMap<u32, Root>, wishes: &Wishes<'_>, step: f64) {
    let mut total = 0;
    for root in roots.values_mut().filter(|root| root.held.is_some()) {
        root.goal = root.wanted(wishes, step).max(root.size());
        total += root.bytes(root.goal);
    }
    let mut coarser = 0;
    while total > wishes.budget && coarser <= FULL {
        total = 0;
        for root in roots.values_mut().filter(|root| root.held.is_some()) {
            let wanted = root.wanted(wishes, step);
            root.goal = if root.is_lost { wanted } else { wanted.saturating_sub(coarser) };
            total += root.bytes(root.goal);
        }
        coarser += 1;
    }
}

/// How much a root needs its images: pixels in a unit of length, and the binary logarithm of its size in pixels; none
/// if it needs none.
fn need(content: &TexelContent, view: Option<&Projection>, root: u32) -> Option<(f64, u8)> {
    let Some(view) = view else { return Some((f64::INFINITY, 0)) };
    // Index blocks of drawn roots are known.
    let [low, high] = content.index().root_bounds(root).ok()?;
    let lengths = [0, 1, 2].map(|k| high[k] - low[k]);
    let squared: f64 = lengths.iter().map(|length| length * length).sum();
    let factor = view.look([low, high]).factor;
    let pixels = factor * squared.sqrt();
    // The conversion saturates.
    (pixels > 1.0).then(|| (factor, (pixels as u64).max(1).ilog2() as u8))
}

/// Images whose mean stands for those of a surface: of the nearest coarser block, of the root or above it, else of a
/// finer one.
fn stand_in(loader: &Loader<TexelContent>, content: &FileContent, surface: &DrawnSurface) -> Option<Arc<DrawnTexture>> {
    let root = surface.root;
    let own = content.blocks(root);
    let (coarser, finer) = own.split_at(own.partition_point(|block| block.level <= surface.level));
    let own = coarser.iter().rev().chain(finer).map(|block| (block.level, root));
    let of_above = |root: u32| content.blocks(root).into_iter().rev().map(move |block| (block.level, root));
    let of_size = |(level, root)| (0..=FULL).rev().map(move |size| TexelUnit { level, root, size });
    own.chain(content.above(root).flat_map(of_above)).flat_map(of_size).find_map(|unit| loader.peek(unit))
}
