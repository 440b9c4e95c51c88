//! How a surface looks, apart from its shape: which channels an input has, and the materials and images that its
//! colours come from.
//!
//! An [`Appearance`] is small and goes into the plan of a build. The values themselves are [`super::attributes`].

use lodpack::decode::{self, Drawing};
use serde::{Deserialize, Serialize};

use super::images::ImageSource;
use super::layout::AttributeLayout;
use super::srgb::{LINEAR_OF_BYTE, share_byte, srgb_byte};

/// The name of the colour channel.
pub const COLOUR: &str = "colour";
/// The name of the channel of normals.
pub const NORMAL: &str = "normal";
/// The names of what else materials have.
pub const EMISSIVE: &str = "emissive";
/// How much of the light from all around reaches the surface.
pub const OCCLUSION: &str = "occlusion";
/// 0 for dielectrics, 1 for metals.
pub const METALLIC: &str = "metallic";
/// 0 for mirrors, 1 for matt surfaces.
pub const ROUGHNESS: &str = "roughness";

/// How the surface is drawn: alpha modes, double-sided and unlit surfaces.
pub const DRAWING: &str = "drawing";

/// Which channels of the input a build keeps.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Channels {
    /// Colours, maps of materials, and every number per vertex that the input has.
    #[default]
    Auto,
    /// These, and normals: those of the input, or those of its triangles where it has none.
    All,
    /// The shape alone.
    None,
    /// These, by name.
    Named(Vec<String>),
}

impl Channels {
    /// Whether normals are kept even where no material has a map of them.
    pub fn wants_all_normals(&self) -> bool {
        match self {
            Self::Auto | Self::None => false,
            Self::All => true,
            Self::Named(names) => names.iter().any(|name| name == NORMAL),
        }
    }

    /// Whether something of materials is kept.
    pub fn wants_materials(&self) -> bool {
        [COLOUR, NORMAL, EMISSIVE, OCCLUSION, METALLIC, ROUGHNESS, DRAWING].iter().any(|name| self.wants(name))
    }

    /// Whether a channel is kept if the input has it.
    pub fn wants(&self, name: &str) -> bool {
        match self {
            Self::Auto | Self::All => true,
            Self::None => false,
            Self::Named(names) => names.iter().any(|wanted| wanted == name),
        }
    }
}

impl std::str::FromStr for Channels {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => return Ok(Self::Auto),
            "all" => return Ok(Self::All),
            "none" => return Ok(Self::None),
            _ => {}
        }
        let mut names: Vec<String> = vec![];
        for name in text.split(',').map(str::trim) {
            // Both spellings of English name the same channel.
            let name = if name == "color" { COLOUR } else { name };
            if name.is_empty() || ["auto", "all", "none"].contains(&name) {
                return Err(format!(
                    "'{text}' is neither auto nor all nor none nor a list of names like colour,quality"
                ));
            }
            if !names.iter().any(|known| known == name) {
                names.push(name.to_owned());
            }
        }
        Ok(Self::Named(names))
    }
}

impl std::fmt::Display for Channels {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::All => f.write_str("all"),
            Self::None => f.write_str("none"),
            Self::Named(names) => f.write_str(&names.join(",")),
        }
    }
}

/// How the surface of an input looks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Appearance {
    /// The records of vertices or corners.
    pub layout: AttributeLayout,
    /// Whether the surface has a colour of its own: vertex colours, or materials that are not plain white.
    pub has_colour: bool,
    /// Whether some of it is not opaque.
    pub has_alpha: bool,
    /// Which channels besides there are, of those that every material has.
    pub maps: MaterialMaps,
    /// Whether some of it is drawn in another way than files are drawn that do not say how.
    pub has_drawings: bool,
    /// The values of each scalar of the layout.
    pub scalars: Vec<ScalarRange>,
    /// The materials that triangles name. The first is that of triangles without one.
    pub materials: Vec<Material>,
    /// The images that materials name.
    pub images: Vec<ImageSource>,
    /// Columns and rows of each image; none where it is not used.
    pub image_sizes: Vec<[u32; 2]>,
    /// Texels of all images.
    pub texels: u64,
    /// The smallest step by which images were quantised before, of 255; none unless all were.
    pub coded_step: Option<f64>,
    /// The most memory that decoding one of them takes, of those that are decoded as a whole.
    pub decoding_bytes: u64,
}

impl Appearance {
    /// Whether there is nothing to keep beside the shape.
    pub fn is_empty(&self) -> bool {
        !self.has_colour && !self.has_materials() && self.scalars.is_empty()
    }

    /// Whether there is something that only materials have: maps, or drawings.
    pub fn has_materials(&self) -> bool {
        self.maps != MaterialMaps::default() || self.has_drawings
    }

    /// Whether it only changes from one material to another: none has an image, and vertices have no colours or
    /// normals.
    pub fn is_even(&self) -> bool {
        let varies = self.layout.colour.is_some() || self.maps.normal;
        let has_images = self.materials.iter().any(|material| material.images().next().is_some());
        (self.has_colour || self.has_materials()) && !varies && !has_images
    }

    /// Places of labels in records.
    pub fn label_places(&self) -> Vec<usize> {
        let is_label = |name: &String| self.scalars.iter().any(|range| range.name == *name && range.is_label());
        self.layout.scalars.iter().filter(|(name, _)| is_label(name)).map(|(_, place)| *place).collect()
    }

    /// Texels of images for each of `triangles` triangles: a power of two, or 0, so that it changes rarely when more is
    /// added.
    pub fn texels_each(&self, triangles: u64) -> u64 {
        let texels = self.texels / triangles.max(1);
        if texels > 0 { 1 << texels.ilog2() } else { 0 }
    }

    /// Whether records, materials and images that are numbered by `earlier` have the same numbers here.
    pub fn continues(&self, earlier: &Self) -> bool {
        let flags = |of: &Self| (of.has_colour, of.has_alpha, of.maps, of.has_drawings);
        self.layout == earlier.layout
            && flags(self) == flags(earlier)
            && self.scalars == earlier.scalars
            && self.materials.starts_with(&earlier.materials)
            && self.images.starts_with(&earlier.images)
    }
}

/// What a surface has beside a base colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MaterialMaps {
    /// Normals: those of the triangles where nothing else is known.
    pub normal: bool,
    /// Light that it emits.
    pub emissive: bool,
    /// How much of the light from all around reaches it.
    pub occlusion: bool,
    /// Whether it is of metal.
    pub metallic: bool,
    /// How matt it is.
    pub roughness: bool,
}

/// Names of numbers per vertex that are those of classes, where all of them are whole; `_id` may follow.
const LABELS: [&str; 13] = [
    "label",
    "labels",
    "class",
    "classification",
    "category",
    "segment",
    "instance",
    "object",
    "part",
    "region",
    "cluster",
    "material",
    "material_index",
];

/// Whether classes have such a name.
pub fn is_name_of_labels(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    // As CloudCompare writes names.
    let name = name.strip_prefix("scalar_").unwrap_or(&name);
    LABELS.contains(&name.strip_suffix("_id").unwrap_or(name))
}

/// The finite values of a scalar in the whole input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScalarRange {
    /// The name of the channel.
    pub name: String,
    /// The smallest value; greater than `high` where there is none.
    pub low: f32,
    /// The largest value.
    pub high: f32,
    /// Whether all values are whole numbers.
    pub is_whole: bool,
    /// How many are no finite numbers.
    pub missing: u64,
}

/// Whole numbers above this are not all kept.
const LARGEST_EXACT: f32 = (1 << f32::MANTISSA_DIGITS) as f32;

impl ScalarRange {
    /// Of no values.
    pub fn new(name: &str) -> Self {
        Self { name: name.to_owned(), low: f32::INFINITY, high: f32::NEG_INFINITY, is_whole: true, missing: 0 }
    }

    /// Adds a value.
    #[inline]
    pub fn add(&mut self, value: f32) {
        if value.is_finite() {
            self.low = self.low.min(value);
            self.high = self.high.max(value);
            self.is_whole &= value.trunc() == value;
        } else {
            self.missing += 1;
        }
    }

    /// By how much values may be off since they are kept in single precision: half of the distance between such numbers
    /// where they are largest.
    pub fn rounding(&self) -> f64 {
        let largest = self.low.abs().max(self.high.abs());
        if largest.is_finite() { 0.5 * (f64::from(largest) - f64::from(largest.next_down())) } else { 0.0 }
    }

    /// Whether the values are numbers of classes, between which there is nothing: whole numbers under a name that
    /// classes have.
    pub fn is_label(&self) -> bool {
        let are_exact = self.is_whole && self.low.abs().max(self.high.abs()) <= LARGEST_EXACT;
        are_exact && f64::from(self.high) - f64::from(self.low) <= f64::from(u16::MAX) && is_name_of_labels(&self.name)
    }

    /// Adds the values of another range.
    pub fn join(&mut self, other: &Self) {
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
        self.is_whole &= other.is_whole;
        self.missing += other.missing;
    }
}

/// What a triangle is made of, as far as inputs say it. Factors and images are multiplied, as glTF 2.0 has it (section
/// 3.9).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Its name in the input; may be empty.
    pub name: String,
    /// Red, green, blue and alpha in linear light; textures and vertex colours are multiplied by it.
    pub base_colour: [f32; 4],
    /// The image over it.
    pub base_texture: Option<TextureUse>,
    /// An image of opacity alone, which alpha is multiplied by: its alpha, or its brightness where all of it is opaque.
    /// The alpha of the image of colours does not count then.
    pub opacity_texture: Option<TextureUse>,
    /// An image of normals relative to the surface: right, up and outwards; and what the first two are multiplied with.
    pub normal_texture: Option<(TextureUse, f32)>,
    /// Whether the image of normals is not relative to the surface, but has directions in the coordinates of positions.
    pub has_object_normals: bool,
    /// Light that it emits, linear.
    pub emissive: [f32; 3],
    /// The image over it.
    pub emissive_texture: Option<TextureUse>,
    /// An image whose red says how much of the light from all around comes there; and how much of that counts.
    pub occlusion_texture: Option<(TextureUse, f32)>,
    /// An image whose blue and green are factors of the next two.
    pub metallic_roughness_texture: Option<TextureUse>,
    /// Images whose red is a factor of one of them alone, as OBJ files have them.
    pub metallic_texture: Option<TextureUse>,
    /// The other one.
    pub roughness_texture: Option<TextureUse>,
    /// 0 for dielectrics, 1 for metals.
    pub metallic: f32,
    /// 0 for mirrors, 1 for matt surfaces.
    pub roughness: f32,
    /// Whether its back is seen.
    pub double_sided: bool,
    /// What alpha means.
    pub alpha: AlphaMode,
    /// Whether its colour is shown without lighting.
    pub unlit: bool,
    /// Whether the colours of vertices do not count where it is: PLY and OBJ files have textures in their place, glTF
    /// files beneath them.
    pub hides_vertex_colour: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_colour: [1.0; 4],
            base_texture: None,
            opacity_texture: None,
            normal_texture: None,
            has_object_normals: false,
            emissive: [0.0; 3],
            emissive_texture: None,
            occlusion_texture: None,
            metallic_roughness_texture: None,
            metallic_texture: None,
            roughness_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            double_sided: false,
            // Vertex colours without a material may have alpha.
            alpha: AlphaMode::Unstated,
            unlit: false,
            hides_vertex_colour: false,
        }
    }
}

/// What the alpha of a material means.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum AlphaMode {
    /// Nothing: the surface is opaque.
    Opaque,
    /// The surface is there where alpha is at least this.
    Mask(f32),
    /// The share of light that the surface stops.
    Blend,
    /// The same, but nobody said so: it alone is no reason to keep how the surface is drawn.
    Unstated,
}

impl Material {
    /// How it is drawn.
    pub fn drawing(&self) -> Drawing {
        Drawing {
            alpha: match self.alpha {
                AlphaMode::Opaque => decode::AlphaMode::Opaque,
                AlphaMode::Mask(least) => decode::AlphaMode::Mask(f64::from(least)),
                AlphaMode::Blend | AlphaMode::Unstated => decode::AlphaMode::Blend,
            },
            is_double_sided: self.double_sided,
            is_unlit: self.unlit,
        }
    }

    /// Has it drawn in some way.
    pub fn draw(&mut self, drawing: Drawing) {
        (self.double_sided, self.unlit) = (drawing.is_double_sided, drawing.is_unlit);
        self.alpha = match drawing.alpha {
            decode::AlphaMode::Opaque => AlphaMode::Opaque,
            decode::AlphaMode::Mask(cutoff) => AlphaMode::Mask(cutoff as f32),
            decode::AlphaMode::Blend => AlphaMode::Blend,
        };
    }

    /// What it uses images for.
    pub fn textures(&self) -> impl Iterator<Item = &TextureUse> {
        let [normal, occlusion] =
            [&self.normal_texture, &self.occlusion_texture].map(|of| of.as_ref().map(|(of, _)| of));
        let others = [
            &self.base_texture,
            &self.opacity_texture,
            &self.emissive_texture,
            &self.metallic_roughness_texture,
            &self.metallic_texture,
            &self.roughness_texture,
        ];
        others.map(Option::as_ref).into_iter().chain([normal, occlusion]).flatten()
    }

    /// The images that it names, some of them perhaps twice.
    pub fn images(&self) -> impl Iterator<Item = u32> {
        self.textures().map(|texture| texture.image)
    }

    /// Makes its numbers those that are stored. A mean of many that lie between two stored ones is sometimes one and
    /// sometimes the other.
    pub fn round(&mut self) {
        let Self { base_colour: [red, green, blue, alpha], emissive, metallic, roughness, .. } = self;
        for light in [red, green, blue].into_iter().chain(emissive) {
            *light = LINEAR_OF_BYTE[usize::from(srgb_byte(*light))];
        }
        for share in [alpha, metallic, roughness] {
            *share = f32::from(share_byte(*share)) / 255.0;
        }
    }

    /// Whether it says that it is drawn in another way than files are drawn that do not say how.
    pub fn states_drawing(&self) -> bool {
        self.double_sided || self.unlit || matches!(self.alpha, AlphaMode::Mask(_) | AlphaMode::Blend)
    }
}

/// An image on a surface. Its first row of texels is at v = 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureUse {
    /// The number of the image in [`Appearance::images`].
    pub image: u32,
    /// Which coordinates of the layout it uses.
    pub uv_set: u8,
    /// What it shows beyond its left and right, and its upper and lower border.
    pub wrap: [Wrap; 2],
    /// Rows of an affine map from the coordinates of the surface to those of the image.
    pub transform: Option<[f32; 6]>,
}

impl TextureUse {
    /// Where the image has the corners of a triangle with these records; none if one has no coordinates.
    #[inline]
    pub fn corners(&self, layout: &AttributeLayout, records: [&[f32]; 3]) -> Option<[[f64; 2]; 3]> {
        let place = *layout.uv.get(usize::from(self.uv_set))?;
        let corners = records.map(|record| self.placed(record.get(place..place + 2).unwrap_or(&[f32::NAN; 2])));
        corners.iter().flatten().all(|value| value.is_finite()).then_some(corners)
    }

    /// Coordinates of the surface where the image has them. They count in images, from its first row and column.
    fn placed(&self, uv: &[f32]) -> [f64; 2] {
        let [u, v] = [f64::from(uv[0]), f64::from(uv[1])];
        match self.transform.map(|rows| rows.map(f64::from)) {
            Some([a, b, c, d, e, f]) => [a * u + b * v + c, d * u + e * v + f],
            None => [u, v],
        }
    }
}

/// How many images a triangle shows whose corners they have there.
#[inline]
pub fn images_on([a, b, c]: [[f64; 2]; 3]) -> f64 {
    let ([x, y], [z, w]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    (x * w - y * z).abs() / 2.0
}

/// What an image shows beyond its border.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Wrap {
    /// Itself again.
    #[default]
    Repeat,
    /// Itself mirrored.
    Mirror,
    /// Its last texels.
    Clamp,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_labels_by_name() {
        let range = |name: &str, values: &[f32]| {
            let mut range = ScalarRange::new(name);
            values.iter().for_each(|&value| range.add(value));
            range
        };
        assert!(
            ["label", "Class_ID", "scalar_Classification"].iter().all(|name| range(name, &[3.0, 65538.0]).is_label())
        );
        assert!(!range("quality", &[3.0]).is_label());
        // Parts of classes, and more of them than an image tells apart.
        assert!(!range("label", &[3.0, 3.5]).is_label() && !range("label", &[0.0, 65536.0]).is_label());
        // Not all of such numbers can be told apart.
        assert!(!range("label", &[2e7, 2e7 + 2.0]).is_label());
    }

    #[test]
    fn ranges_know_what_is_missing_and_rounded() {
        let mut range = ScalarRange::new("time");
        assert_eq!((range.missing, range.rounding()), (0, 0.0));
        [1.5e9, f32::NAN, 1.6e9, f32::INFINITY].into_iter().for_each(|value| range.add(value));
        assert_eq!((range.low, range.high, range.missing, range.rounding()), (1.5e9, 1.6e9, 2, 64.0));
    }

    #[test]
    fn channels_are_chosen_by_name_in_either_spelling() {
        let parse = |text: &str| text.parse::<Channels>();
        assert_eq!(parse("auto"), Ok(Channels::Auto));
        assert_eq!(parse("none"), Ok(Channels::None));
        let named = parse("color, quality,colour").unwrap();
        assert_eq!(named, Channels::Named(vec!["colour".into(), "quality".into()]));
        assert_eq!(named.to_string(), "colour,quality");
        assert!(named.wants("quality") && !named.wants("intensity"));
        assert!(!Channels::Auto.wants_all_normals() && Channels::All.wants_all_normals());
        assert_eq!(parse("all").unwrap().to_string(), "all");
        for bad in ["", "a,,b", "colour,none", "auto,x", "all,x"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
