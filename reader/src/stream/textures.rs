//! Which roots of a picture get which images, and in what order (Niski 2007, section 6.1.1).
//!
//! An image belongs to one block, because its map divides that block's patch. So a root is drawn with the images of the
//! block that is drawn. Until these are there, and where they are not needed, the mean over the nearest coarser block
//! that is there stands for them: an image of one texel.
//!
//! The error of texels is one of their own: **a texel a pixel**. So the images of a root are wanted where the view
//! shows it, and where it is larger than a pixel. Those of the largest roots come first, because there the mean is
//! worst. Without a view all are wanted, in any order.

use std::{sync::Arc, time::Duration};

use super::{
    content::FileContent,
    drawn_surface::DrawnSurface,
    loader::{Loader, UnitState},
    picture::{Changes, Picture},
    queue::Class,
    texel_content::{DrawnTexture, TexelContent, TexelUnit},
};
use crate::select::Projection;
use crate::sorted::{SortedMap, SortedSet};

/// The images of a picture's roots, kept from frame to frame. A frame looks only at roots that are new or still lack
/// theirs.
#[derive(Debug, Default)]
pub(crate) struct Textures {
    /// Roots whose images are not there.
    open: SortedSet<u32>,
    /// What the loader holds for each of the others.
    held: SortedMap<u32, TexelUnit>,
}

impl Textures {
    /// Forgets all images, because other channels are shown from now on.
    pub fn restart(&mut self, picture: &mut Picture) {
        self.held.clear();
        let roots: Vec<u32> = picture.roots().map(|drawn| drawn.surface.root).collect();
        roots.iter().for_each(|&root| picture.set_texture(root, None));
        self.open = roots.into_iter().collect();
    }

    /// Makes the next frame look at roots anew whose images were given up.
    pub fn doubt(&mut self, picture: &Picture) {
        let roots = picture.roots().map(|drawn| drawn.surface.root);
        self.open.extend(roots.filter(|root| !self.held.contains_key(root)));
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
            self.open.remove(root);
            if let Some(unit) = self.held.remove(root) {
                loader.release(unit);
            }
        }
        for &root in &changes.surfaces {
            let Some(surface) = picture.root(root).map(|drawn| Arc::clone(&drawn.surface)) else { continue };
            picture.set_texture(root, stand_in(loader, content, &surface));
            self.open.insert(root);
        }
    }

    /// Wants what is missing, and gives the picture what has come. Returns how many roots lack images that they need.
    pub fn demand(
        &mut self,
        loader: &mut Loader<TexelContent>,
        (picture, changes): (&mut Picture, &mut Changes),
        view: Option<&Projection>,
        now: Duration,
    ) -> u32 {
        loader.begin_frame();
        let content = Arc::clone(loader.content());
        let mut late = 0;
        let mut wanted = SortedSet::new();
        self.open.retain(|&root| {
            let Some(surface) = picture.root(root).map(|drawn| Arc::clone(&drawn.surface)) else { return false };
            let unit = TexelUnit::of(&surface);
            let Some(need) = need(&content, view, root) else { return true };
            if loader.state(unit) == UnitState::Coming {
                content.add_surface(&surface);
                wanted.insert(unit);
            }
            match loader.want(unit, Class::Demand, need, now) {
                UnitState::Coming => {
                    late += 1;
                    return true;
                }
                // It keeps what stands for them.
                UnitState::Failed => return false,
                UnitState::Decoded => {}
            }
            loader.hold(unit);
            picture.set_texture(root, loader.take(unit));
            self.held.insert(root, unit);
            changes.textures.push(root);
            false
        });
        loader.end_wants();
        content.keep_surfaces(|unit| wanted.contains(&unit) || loader.is_loading(unit));
        late
    }
}

/// How much a root needs its images: the binary logarithm of its size in pixels; none if it needs none.
fn need(content: &TexelContent, view: Option<&Projection>, root: u32) -> Option<u8> {
    let Some(view) = view else { return Some(0) };
    // Index blocks of drawn roots are known.
    let [low, high] = content.index().root_bounds(root).ok()?;
    let lengths = [0, 1, 2].map(|k| high[k] - low[k]);
    let squared: f64 = lengths.iter().map(|length| length * length).sum();
    let pixels = view.look([low, high]).factor * squared.sqrt();
    // The conversion saturates.
    (pixels > 1.0).then(|| (pixels as u64).max(1).ilog2() as u8)
}

/// Images whose mean stands for those of a surface: of the nearest coarser block, of the root or above it, else of a
/// finer one.
fn stand_in(loader: &Loader<TexelContent>, content: &FileContent, surface: &DrawnSurface) -> Option<Arc<DrawnTexture>> {
    let root = surface.root;
    let own = content.blocks(root);
    let (coarser, finer) = own.split_at(own.partition_point(|block| block.level <= surface.level));
    let own = coarser.iter().rev().chain(finer).map(|block| TexelUnit { level: block.level, root });
    let of_above =
        |root: u32| content.blocks(root).into_iter().rev().map(move |block| TexelUnit { level: block.level, root });
    own.chain(content.above(root).flat_map(of_above)).find_map(|unit| loader.peek(unit))
}
