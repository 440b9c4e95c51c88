//! Opacity that nobody can have meant: where all that a file shows would be invisible, it is opaque.
//!
//! Programs write an alpha of 0 that means nothing (Rvcg and PCL with colours of vertices), or opacity where the next
//! one reads what is missing of it. The colours are there all the same, and a surface that is brought to be looked at
//! is to be seen.

use lodpack_mesh::appearance::{AlphaMode, Material};
use lodpack_mesh::images::{ImageSource, Opacity, shows_nothing};

/// What the colours of a file's vertices and corners have for alpha.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AlphaOfColours {
    /// Whether one is below 1.
    is_transparent: bool,
    /// Whether one is above 0.
    is_seen: bool,
}

impl AlphaOfColours {
    #[inline]
    pub fn add(&mut self, alpha: f32) {
        self.is_transparent |= alpha < 1.0;
        self.is_seen |= alpha > 0.0;
    }

    /// Whether nothing has a colour that can be seen, although some have one.
    pub fn is_unmeant(&self) -> bool {
        self.is_transparent && !self.is_seen
    }

    /// Whether some of it is transparent, and means it.
    pub fn is_transparent(&self) -> bool {
        self.is_transparent && self.is_seen
    }
}

/// Whether a material may be invisible, as far as can be told without its images.
pub(super) fn may_be_unseen(material: &Material) -> bool {
    let has_image = material.base_texture.is_some() || material.opacity_texture.is_some();
    material.alpha != AlphaMode::Opaque && (has_image || is_unseen(material, &[], 0))
}

/// Whether no point of a material can be seen. What decoding an image takes more than `memory` for counts as seen.
pub(super) fn is_unseen(material: &Material, images: &[ImageSource], memory: u64) -> bool {
    let least = match material.alpha {
        AlphaMode::Opaque => return false,
        AlphaMode::Mask(least) => least,
        AlphaMode::Blend | AlphaMode::Unstated => 0.0,
    };
    let factor = material.base_colour[3];
    if factor <= 0.0 || factor < least {
        return true;
    }
    let (texture, opacity) = match (&material.opacity_texture, &material.base_texture) {
        (Some(texture), _) => (texture, Opacity::Mask),
        (None, Some(texture)) => (texture, Opacity::Alpha(least / factor)),
        (None, None) => return false,
    };
    // What is wrong with an image is said where it is used.
    let look = |image: &ImageSource| shows_nothing(image.open(None).ok()?, opacity, memory).ok();
    images.get(texture.image as usize).and_then(look).unwrap_or(false)
}

/// Makes a material opaque that cannot be seen.
pub(super) fn show(material: &mut Material) {
    (material.alpha, material.base_colour[3], material.opacity_texture) = (AlphaMode::Opaque, 1.0, None);
}
