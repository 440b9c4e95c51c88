//! Images that have one colour everywhere, or wherever the surface shows them: they are factors of their materials.
//!
//! Programs write such images where a user has chosen a colour, and as images become maps of texels, each would cost
//! some kilobytes of a file that a factor does not cost.

use std::collections::HashMap;
use std::ops::Range;

use super::used_part::UvBounds;
use lodpack_mesh::appearance::{AlphaMode, Material, TextureUse};
use lodpack_mesh::images::{ImageSource, image_size, only_colour};
use lodpack_mesh::srgb::{brightness, linear_from_srgb};

/// What is known of the materials of a file: their numbers, and the range of each set of texture coordinates.
pub(super) type UsedParts = (Range<usize>, Vec<UvBounds>);

/// Multiplies the factors of materials by images that have one colour wherever they are shown, and takes these away.
/// Images of normals and of occlusion have no factor and stay. `has_vertex_colours` says that some vertices have
/// colours, which a material may hide by its image alone. What takes more than `memory` is not looked at.
pub(super) fn fold_images(
    materials: &mut [Material],
    images: &[ImageSource],
    parts: &[UsedParts],
    has_vertex_colours: bool,
    memory: u64,
) {
    let mut found = Found { images, memory, sizes: HashMap::new(), colours: HashMap::new() };
    for (numbers, bounds) in parts {
        for material in materials.get_mut(numbers.clone()).unwrap_or_default() {
            fold(material, has_vertex_colours, &mut |texture, shown| {
                let bounds: &[UvBounds] = if shown == Shown::Part { bounds } else { &[] };
                found.colour_of(texture.as_ref()?, bounds)
            });
        }
    }
}

/// Red, green, blue and alpha, as shares, if there is one colour.
type OnlyColour = Option<[f32; 4]>;

/// Columns and rows of texels.
type Part = [Range<u32>; 2];

/// The most parts of an image that are looked at: each may take as long as decoding all of it.
const MOST_PARTS: usize = 64;

/// What is known of images.
struct Found<'a> {
    images: &'a [ImageSource],
    memory: u64,
    /// None of damaged ones: what is wrong with those is said later.
    sizes: HashMap<u32, Option<[u32; 2]>>,
    /// By image, for each part that was looked at.
    colours: HashMap<u32, Vec<(Part, OnlyColour)>>,
}

impl Found<'_> {
    /// The colour that an image has wherever it is shown, as shares.
    fn colour_of(&mut self, texture: &TextureUse, bounds: &[UvBounds]) -> OnlyColour {
        let image = self.images.get(texture.image as usize)?;
        let open = || image.open(None).ok();
        let size = *self.sizes.entry(texture.image).or_insert_with(|| image_size(open()?).ok());
        let [width, height] = size?;
        let bounds = bounds.get(usize::from(texture.uv_set));
        let part = bounds.and_then(|bounds| bounds.texels(texture, [width, height]));
        let part = part.unwrap_or([0..width, 0..height]);
        let known = self.colours.entry(texture.image).or_default();
        if let Some((_, colour)) = known.iter().find(|(known, _)| *known == part) {
            return *colour;
        }
        if known.len() >= MOST_PARTS {
            return None;
        }
        let shares = |colour: [u16; 4]| colour.map(|value| f32::from(value) / 65535.0);
        let colour = only_colour(open()?, part.clone(), self.memory).ok().flatten().map(shares);
        known.push((part, colour));
        colour
    }
}

/// What of an image has to have one colour.
#[derive(PartialEq)]
enum Shown {
    /// What the surface shows.
    Part,
    /// All of it.
    All,
}

fn fold(
    material: &mut Material,
    has_vertex_colours: bool,
    of: &mut dyn FnMut(&Option<TextureUse>, Shown) -> OnlyColour,
) {
    if let Some(colour) = of(&material.emissive_texture, Shown::Part) {
        let light = in_linear_light(colour);
        (0..3).for_each(|k| material.emissive[k] *= light[k]);
        material.emissive_texture = None;
    }
    if let Some([_, green, blue, _]) = of(&material.metallic_roughness_texture, Shown::Part) {
        (material.roughness, material.metallic) = (material.roughness * green, material.metallic * blue);
        material.metallic_roughness_texture = None;
    }
    if let Some([red, ..]) = of(&material.metallic_texture, Shown::Part) {
        (material.metallic, material.metallic_texture) = (material.metallic * red, None);
    }
    if let Some([red, ..]) = of(&material.roughness_texture, Shown::Part) {
        (material.roughness, material.roughness_texture) = (material.roughness * red, None);
    }
    let hides = material.hides_vertex_colour && has_vertex_colours;
    if let Some(colour) = of(&material.base_texture, Shown::Part).filter(|_| !hides) {
        let light = in_linear_light(colour);
        (0..3).for_each(|k| material.base_colour[k] *= light[k]);
        if material.opacity_texture.is_none() && material.alpha != AlphaMode::Opaque {
            material.base_colour[3] *= colour[3];
        }
        material.base_texture = None;
    }
    // Without it, the alpha of an image of colours counts, so this comes last. Whether its own alpha does depends on
    // all of it.
    if let Some([red, green, blue, alpha]) =
        of(&material.opacity_texture, Shown::All).filter(|_| material.base_texture.is_none())
    {
        material.base_colour[3] *= if alpha < 1.0 { alpha } else { brightness([red, green, blue]) };
        material.opacity_texture = None;
    }
}

fn in_linear_light([red, green, blue, _]: [f32; 4]) -> [f32; 3] {
    [red, green, blue].map(linear_from_srgb)
}
