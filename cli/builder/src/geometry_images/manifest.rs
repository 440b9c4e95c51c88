//! `atlas.json`: its fields, and the checks that need no image.

use std::fmt;
use std::path::{Component, Path};

use lodpack::decode::Drawing;
use serde::{Deserialize, Serialize};

use super::MAX_RESOLUTION;
use super::looks::{ImageChannel, ImageKind};
use super::product::AtlasHeader;
use lodpack_mesh::appearance::{METALLIC, OCCLUSION, ROUGHNESS, is_name_of_labels};

/// The value of `format` in every `atlas.json`.
const FORMAT: &str = "lodpack-atlas";
/// The value of `version`: the only one that is written or read.
const VERSION: u32 = 1;
/// Bytes of the longest name of a channel, as files have it.
const MAX_NAME: usize = 255;

/// One edge of a geometry image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImageEdge {
    /// The first column (s = 0), running down.
    Left,
    /// The first row (t = 0), running right.
    Top,
    /// The last column (s = 1), running down.
    Right,
    /// The last row (t = 1), running right.
    Bottom,
}

impl ImageEdge {
    pub(super) const ALL: [Self; 4] = [Self::Left, Self::Top, Self::Right, Self::Bottom];

    /// Column and row of sample `k` of the edge in an image with `last` + 1 pixels a side.
    pub(super) fn pixel(self, k: usize, last: usize) -> (usize, usize) {
        match self {
            Self::Left => (0, k),
            Self::Top => (k, 0),
            Self::Right => (last, k),
            Self::Bottom => (k, last),
        }
    }
}

impl fmt::Display for ImageEdge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Left => "left edge",
            Self::Top => "top edge",
            Self::Right => "right edge",
            Self::Bottom => "bottom edge",
        })
    }
}

/// The edge of another root that is the same line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Neighbour {
    /// Index into the manifest's roots.
    pub root: u32,
    pub edge: ImageEdge,
    /// Whether the neighbour's edge runs the other way.
    pub reversed: bool,
}

/// The neighbours of a root; none where the surface ends or a patch follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Neighbours {
    #[serde(default)]
    pub left: Option<Neighbour>,
    #[serde(default)]
    pub top: Option<Neighbour>,
    #[serde(default)]
    pub right: Option<Neighbour>,
    #[serde(default)]
    pub bottom: Option<Neighbour>,
}

impl Neighbours {
    pub fn across(&self, edge: ImageEdge) -> Option<Neighbour> {
        match edge {
            ImageEdge::Left => self.left,
            ImageEdge::Top => self.top,
            ImageEdge::Right => self.right,
            ImageEdge::Bottom => self.bottom,
        }
    }
}

/// A geometry image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Root {
    /// File name within the folder.
    pub file: String,
    pub resolution: u32,
    /// The chart of which the root is a quad: those with the same number are one. A root without is a chart of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chart: Option<u32>,
    /// The quad's corner. For information only.
    #[serde(default)]
    pub corner: u32,
    #[serde(default)]
    pub neighbours: Neighbours,
    /// File names of its images of the atlas's channels, in their order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<String>,
    /// How it is drawn: a number as files have it (SPEC.md 21.6).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub drawing: u16,
}

fn is_zero(number: &u16) -> bool {
    *number == 0
}

/// A piece of the surface that is a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Patch {
    /// File name within the folder.
    pub file: String,
    #[serde(default)]
    pub borders: Vec<Border>,
    /// File names of its images of the channels that have texels, in their order; its mesh has places in them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<String>,
    /// How it is drawn.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub drawing: u16,
}

/// A stretch of a patch's border that is an edge of an image.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Border {
    /// Index into the manifest's roots.
    pub root: u32,
    pub edge: ImageEdge,
    /// The patch's vertices along the edge, from its first sample to its last.
    pub vertices: Vec<u32>,
}

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    pub format: String,
    pub version: u32,
    #[serde(default)]
    pub units: String,
    pub origin: [f64; 3],
    /// What the roots have images of, beside their shape.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<ImageChannel>,
    pub roots: Vec<Root>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub patches: Vec<Patch>,
}

impl Manifest {
    pub fn new(header: &AtlasHeader, channels: Vec<ImageChannel>, roots: Vec<Root>, patches: Vec<Patch>) -> Self {
        let (origin, units) = (header.origin.to_array(), header.units.clone());
        Self { format: FORMAT.into(), version: VERSION, units, origin, channels, roots, patches }
    }

    /// Checks everything that needs no image. The message names the root.
    pub fn check(&self) -> Result<(), String> {
        if self.format != FORMAT || self.version != VERSION {
            return Err(format!(
                "format is {:?} version {}, expected {FORMAT:?} version {VERSION}",
                self.format, self.version
            ));
        }
        if !self.origin.iter().all(|x| x.is_finite()) {
            return Err("the origin is not finite".into());
        }
        if self.roots.is_empty() && self.patches.is_empty() {
            return Err("there are neither roots nor patches".into());
        }
        self.check_channels()?;
        self.check_drawings()?;
        let mut sample_count = 0u64;
        for (index, root) in self.roots.iter().enumerate() {
            let name = &root.file;
            if !is_plain_file_name(name) {
                return Err(format!("root {index}: {name:?} is not a plain file name"));
            }
            if root.resolution > MAX_RESOLUTION {
                return Err(format!("root {name}: resolution {} is above {MAX_RESOLUTION}", root.resolution));
            }
            let side = (1u64 << root.resolution) + 1;
            sample_count += side * side;
            for edge in ImageEdge::ALL {
                let Some(neighbour) = root.neighbours.across(edge) else { continue };
                // An edge that is folded in its middle is its own neighbour, and runs the other way.
                if (neighbour.root as usize, neighbour.edge) == (index, edge) && !neighbour.reversed {
                    return Err(format!("root {name}: its {edge} is its own neighbour"));
                }
                let Some(other) = self.roots.get(neighbour.root as usize) else {
                    return Err(format!("root {name}, {edge}: there is no root {}", neighbour.root));
                };
                let back = Neighbour { root: index as u32, edge, reversed: neighbour.reversed };
                if other.neighbours.across(neighbour.edge) != Some(back) {
                    return Err(format!(
                        "root {name} names root {} ({}) as the neighbour of its {edge}, but that root does not name it back",
                        other.file, neighbour.edge
                    ));
                }
            }
        }
        // Two triangles a sample, three half-edges a triangle, numbered with 32 bits.
        if sample_count * 6 >= u64::from(u32::MAX) {
            return Err(format!("{sample_count} samples are more than a mesh can hold; lower the resolutions"));
        }
        self.check_patches()
    }

    /// The number of roots and patches, each of which has a material where there are images with texels, or something
    /// that says how it is drawn; otherwise 0.
    pub fn material_count(&self) -> usize {
        let mut drawings = self.roots.iter().map(|root| root.drawing).chain(self.patches.iter().map(|of| of.drawing));
        let are_needed =
            self.channels.iter().any(|channel| channel.kind.has_texels()) || drawings.any(|drawing| drawing != 0);
        if are_needed { self.roots.len() + self.patches.len() } else { 0 }
    }

    fn check_drawings(&self) -> Result<(), String> {
        let drawings = self.roots.iter().map(|root| (&root.file, root.drawing));
        let drawings = drawings.chain(self.patches.iter().map(|patch| (&patch.file, patch.drawing)));
        for (name, drawing) in drawings {
            if Drawing::of_number(drawing).number() != drawing {
                return Err(format!("{name}: nothing is drawn as {drawing} says"));
            }
        }
        Ok(())
    }

    fn check_channels(&self) -> Result<(), String> {
        for (number, channel) in self.channels.iter().enumerate() {
            let ImageChannel { name, resolution, .. } = channel;
            if *resolution > MAX_RESOLUTION {
                return Err(format!("channel {name:?}: resolution {resolution} is above {MAX_RESOLUTION}"));
            }
            let is_known = self.channels[..number].iter().any(|known| known.name == *name);
            if is_known || name.is_empty() || name.len() > MAX_NAME || name.chars().any(char::is_control) {
                return Err(format!(
                    "channel {name:?}: names must be different, have 1 to {MAX_NAME} bytes and no control characters"
                ));
            }
            let is_twice = self.channels[..number].iter().any(|known| known.kind == channel.kind);
            if channel.kind.has_texels() && is_twice {
                return Err(format!("channel {name:?}: there is another one of its kind"));
            }
            if channel.kind == ImageKind::Label && !is_name_of_labels(name) {
                return Err(format!("channel {name:?}: classes have a name like label, class or segment; rename it"));
            }
            let is_factor = |factor: &&String| [OCCLUSION, ROUGHNESS, METALLIC].contains(&factor.as_str());
            if let Some(factor) = channel.factors.iter().find(|factor| !is_factor(factor)) {
                return Err(format!(
                    "channel {name:?}: there is no factor {factor:?}, but {OCCLUSION}, {ROUGHNESS} and {METALLIC}"
                ));
            }
        }
        let count = self.channels.len();
        for root in &self.roots {
            let name = &root.file;
            if root.images.len() != count {
                return Err(format!("root {name}: there are {} images for {count} channels", root.images.len()));
            }
            if let Some(image) = root.images.iter().find(|image| !is_plain_file_name(image)) {
                return Err(format!("root {name}: {image:?} is not a plain file name"));
            }
        }
        let count = self.channels.iter().filter(|channel| channel.kind.has_texels()).count();
        for patch in &self.patches {
            let name = &patch.file;
            if ![0, count].contains(&patch.images.len()) {
                let images = patch.images.len();
                return Err(format!("patch {name}: there are {images} images for {count} channels with texels"));
            }
            if let Some(image) = patch.images.iter().find(|image| !is_plain_file_name(image)) {
                return Err(format!("patch {name}: {image:?} is not a plain file name"));
            }
        }
        Ok(())
    }

    fn check_patches(&self) -> Result<(), String> {
        let mut taken = Vec::new();
        for (index, patch) in self.patches.iter().enumerate() {
            let name = &patch.file;
            if !is_plain_file_name(name) || !name.to_ascii_lowercase().ends_with(".ply") {
                return Err(format!("patch {index}: {name:?} is not a plain file name of a PLY file"));
            }
            for border in &patch.borders {
                let Some(root) = self.roots.get(border.root as usize) else {
                    return Err(format!("patch {name}: there is no root {}", border.root));
                };
                if root.neighbours.across(border.edge).is_some() {
                    return Err(format!(
                        "patch {name} names the {} of root {}, which has another neighbour there",
                        border.edge, root.file
                    ));
                }
                taken.push((border.root, border.edge));
            }
        }
        taken.sort_unstable();
        match taken.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => {
                let (root, edge) = pair[0];
                Err(format!("the {edge} of root {} is the border of patches twice", self.roots[root as usize].file))
            }
            None => Ok(()),
        }
    }
}

/// Whether a name is that of a file in the folder itself.
fn is_plain_file_name(name: &str) -> bool {
    let mut components = Path::new(name).components();
    !name.chars().any(char::is_control)
        && matches!((components.next(), components.next()), (Some(Component::Normal(_)), None))
}
