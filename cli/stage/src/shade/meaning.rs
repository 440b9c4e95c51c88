//! What the numbers of an image mean, and why there may be no texture of it.

use lodpack_runtime::storage::WorkError;

/// What the numbers of an image are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Colours of screens, with alpha.
    Transparent,
    /// Colours of screens; alpha does not count.
    Opaque,
    /// Shares from 0 to 1.
    Shares,
    /// The same, with alpha, which may be what they are about.
    Opacity,
}

impl Meaning {
    /// How many there are.
    pub(super) const COUNT: usize = 4;

    /// Whether colours are no colours of screens.
    pub(super) fn is_linear(self) -> bool {
        matches!(self, Self::Shares | Self::Opacity)
    }

    /// Whether alpha counts.
    pub(super) fn has_alpha(self) -> bool {
        matches!(self, Self::Transparent | Self::Opacity)
    }

    /// A number for an image that is meant so.
    pub(super) fn key(self, image: u32) -> usize {
        Self::COUNT * image as usize + self as usize
    }

    /// The meaning of such a number.
    pub(super) fn of_key(key: usize) -> Self {
        [Self::Transparent, Self::Opaque, Self::Shares, Self::Opacity][key % Self::COUNT]
    }
}

/// Why there is no texture.
#[derive(Debug, thiserror::Error)]
pub(super) enum TextureError {
    /// The image is damaged, or missing.
    #[error("{0}")]
    Image(String),
    /// A file for its texels cannot be made, written or read.
    #[error(transparent)]
    File(#[from] WorkError),
}

impl From<String> for TextureError {
    fn from(problem: String) -> Self {
        Self::Image(problem)
    }
}
