//! Baking: gives a patch an image of what the input shows where the patch lies.
//!
//! The patch is divided into pieces that can be projected (`pieces`), the pieces are packed into one image
//! ([`lodpack::write::encode_map`]), and the input's triangles are projected along the same axes (`gather`). So neither
//! side needs texture coordinates, and seams of the input's textures are not seen by the result. The texels of coarser
//! patches are means of those of finer ones as they were before they were quantised ([`Surfels`]): each point of the
//! input is looked at once, and nothing is lost twice.
//!
//! [`Baker`] takes these steps in this order:
//!
//! | step | file | what it does |
//! |---|---|---|
//! | map | `sizes`, `long` | say how large the texels of each triangle are, and where they are longer than wide |
//! | | `pieces`, `joined` | divide the patch into pieces that are nearly flat, and make their borders shorter (`triangles` knows what lies beside what) |
//! | | `projection`, `raster` | take points to the map, and draw the patch on it: which texels it covers, and what hides what |
//! | from the input | `gather`, `closest` | give texels what is projected to them, and where the patch is far off what lies closest (`strangers`: not from beyond a line at which colours jump) |
//! | from finer blocks | `coarser` | gives texels the means of finer ones |
//! | | `values`, `fill` | sum up what texels show, and fill those that nothing is known of |
//! | | `surfels` | hands the texels on to coarser patches |
//! | borders | `borders`, `wanted` | list the points along the borders of pieces, and what they should show: what the source does (`located`), or what finer patches do (`rim`) |
//! | | `shown`, `settled` | change texels until both sides of a border show that (`strip` has the texels along borders) |
//! | coded | `sharpen` | turns samples into the texels between which colours are shown best |
//! | | `coded`, `images`, `storage` | quantise and code the image of each channel |
//!
//! Where each triangle shows one thing, nothing is baked: `even` has palettes. `lanes` has what compilers make
//! vectors of.

mod baker;
mod borders;
mod closest;
mod coarser;
mod coded;
mod even;
mod fill;
mod gather;
mod images;
mod joined;
mod lanes;
mod located;
mod long;
mod pieces;
mod projection;
mod raster;
mod rim;
mod settled;
mod sharpen;
mod shown;
mod sizes;
mod storage;
mod strangers;
mod strip;
mod surfels;
mod triangles;
mod values;
mod wanted;

use glam::DVec3;
use lodpack::LatticePoint;

use crate::areas::Areas;
use crate::nearest::doubled_area;
use lodpack_mesh::NONE;

pub use crate::nearest::Points;
pub use baker::{Baker, baking_bytes};
pub use even::Palette;
pub use gather::barycentric;
pub use images::Images;
pub use located::Located;
pub use long::{growth_over, weight_growth};
pub use sizes::{area_of_texel, exponent_of, larger};
pub use storage::{Storage, Stored};
pub use surfels::Surfels;

/// The largest exponent of a texel's size.
pub const MAX_EXPONENT: u32 = 127;
/// The most texels of a patch.
pub const MAX_TEXELS: u64 = 1 << 24;
/// The same of a reduced cut, which is a single patch with a single map: what lies in pieces of few triangles fills a
/// third of it.
pub const MAX_TEXELS_OF_CUT: u64 = 1 << 25;

/// A patch whose image is wanted.
#[derive(Clone, Copy, Debug)]
pub struct BakedPatch<'a> {
    /// Its vertices as they decode.
    pub positions: &'a [LatticePoint],
    /// Its triangles.
    pub triangles: &'a [[u32; 3]],
    /// How far it may be from the input, lattice units.
    pub reach: f64,
    /// The areas of its triangles, if colours jump between some.
    pub areas: Option<Areas<'a>>,
    /// How much finer its texels are than usual, as a power of the root of two. Its steps of quantisation are as much
    /// larger: what its texels show together is as exact.
    pub finer: u32,
    /// Whether its texels are samples, from which those are made that show colours best between them.
    pub is_sharp: bool,
}

impl BakedPatch<'_> {
    /// The origin of points that single precision must hold: its first vertex.
    fn origin(&self) -> DVec3 {
        self.positions.first().map_or(DVec3::ZERO, |&point| to_f64(point))
    }

    /// The area of a triangle, square lattice units.
    fn area(&self, corners: [u32; 3]) -> f64 {
        0.5 * doubled_area(corners.map(|corner| self.position(corner))).length()
    }

    /// The area of all triangles.
    fn whole_area(&self) -> f64 {
        self.triangles.iter().map(|&corners| self.area(corners)).sum()
    }

    /// A vertex relative to the origin.
    fn position(&self, vertex: u32) -> DVec3 {
        to_f64(self.positions[vertex as usize]) - self.origin()
    }
}

fn to_f64(point: LatticePoint) -> DVec3 {
    DVec3::from(point.map(|x| x as f64))
}

/// The surface that images show.
pub trait Source {
    /// The number of its triangles.
    fn triangle_count(&self) -> usize;

    /// The corners of a triangle, lattice units.
    fn corners(&self, triangle: usize) -> [DVec3; 3];

    /// The area of a triangle; [`NONE`] if that is not known.
    fn area(&self, _triangle: usize) -> u32 {
        NONE
    }

    /// Areas that lie beyond the patch alone: a piece shows them only if no colours jump there.
    fn areas_beyond(&self) -> Vec<u32> {
        vec![]
    }

    /// Whether the surface ends along the edge of the patch's border that begins at a point: then nothing lies beyond.
    fn ends_along(&self, _start: LatticePoint) -> bool {
        false
    }

    /// Whether its texels have several sizes.
    fn has_sizes(&self) -> bool {
        false
    }

    /// How much larger the texels of a triangle are than the smallest, as a power of the root of two.
    fn larger(&self, _triangle: usize) -> u8 {
        0
    }

    /// Whether its texels are longer than wide somewhere.
    fn has_long(&self) -> bool {
        false
    }

    /// How fast two coordinates that count texels grow over a triangle, per size of a texel that is not longer than
    /// wide.
    fn growth(&self, _triangle: usize) -> Option<[DVec3; 2]> {
        None
    }

    /// Appends the values at points of a triangle: of each point those of all channels. They are means over `footprint`
    /// lattice units.
    fn shade(&mut self, triangle: usize, points: &[Points], footprint: f32, values: &mut Vec<f32>);
}

/// What a block stores of its images.
#[derive(Clone, Debug, Default)]
pub struct Baked {
    /// The map, then those of the image of each channel ([`Stored::stream_count`]).
    pub streams: Vec<Vec<u8>>,
    /// Its texels as points, before they were quantised: for the images of coarser patches.
    pub surfels: Surfels,
    /// Whether it has fewer texels than were asked for, because a map holds no more.
    pub is_full: bool,
}

/// How large the texels of a coarse patch are.
#[derive(Clone, Copy, Debug)]
pub struct Coarse {
    /// 2^(exponent / 2) lattice units, if all are alike.
    pub exponent: u32,
    /// About how many there are, if not.
    pub texels: f64,
}

#[cfg(test)]
impl Coarse {
    /// All alike.
    fn even(exponent: u32) -> Self {
        Self { exponent, texels: 0.0 }
    }
}

#[cfg(test)]
mod shown_tests;
#[cfg(test)]
mod size_tests;
#[cfg(test)]
mod tests;
