//! Which images of an atlas show what its surface carries.

use serde::{Deserialize, Serialize};

use super::product::{AtlasProduct, Looks};
use lodpack_mesh::appearance::{Appearance, COLOUR, EMISSIVE, METALLIC, NORMAL, OCCLUSION, ROUGHNESS};
use lodpack_mesh::srgb::{share_byte, srgb_byte};
use lodpack_stage::shade::{Face, Shader};

/// What the images of a channel hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ImageKind {
    /// PNG: red, green, blue of sRGB; straight alpha where some of the surface is not opaque.
    Colour,
    /// PNG: the direction of the normal in the coordinates of the surface, -1 as 0 and 1 as 255.
    Normal,
    /// PNG: emitted light, red, green and blue of sRGB.
    Emissive,
    /// PNG: occlusion, roughness and metallic, as glTF has them in one image.
    Factors,
    /// EXR with the channel Y: a measured number. NaN where there is none.
    Scalar,
    /// EXR with the channel Y: the number of a class.
    Label,
}

impl ImageKind {
    /// Whether its images are PNG, with a resolution of their own.
    pub fn has_texels(self) -> bool {
        !matches!(self, Self::Scalar | Self::Label)
    }
}

/// A channel of which every root has an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ImageChannel {
    pub name: String,
    pub kind: ImageKind,
    /// The resolution of its images, of numbers that of the roots.
    pub resolution: u32,
    /// Whether an image of colours has alpha.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub alpha: bool,
    /// Which of its factors the surface has, by name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub factors: Vec<String>,
}

impl ImageChannel {
    /// The end of its files' names, the number of the channel being known.
    pub fn suffix(&self, number: usize) -> String {
        match self.kind {
            ImageKind::Colour => "colour.png".into(),
            ImageKind::Normal => "normal.png".into(),
            ImageKind::Emissive => "emissive.png".into(),
            ImageKind::Factors => "factors.png".into(),
            // Names of numbers may be anything.
            ImageKind::Scalar | ImageKind::Label => format!("number{number}.exr"),
        }
    }
}

impl Looks {
    /// The number of how a triangle is drawn.
    pub(super) fn drawing(&self, triangle: u32) -> u16 {
        let material = self.appearance.materials.get(usize::from(self.attributes.material(triangle as usize)));
        material.filter(|_| self.appearance.has_drawings).map_or(0, |material| material.drawing().number())
    }

    /// The names of the channels that there are images of.
    pub fn channel_names(&self) -> Vec<String> {
        let own = |channel: ImageChannel| if channel.factors.is_empty() { vec![channel.name] } else { channel.factors };
        self.channels(0, 0).into_iter().flat_map(own).collect()
    }

    /// The channels that its images show, at these resolutions of texels and of numbers.
    pub(super) fn channels(&self, texels: u32, numbers: u32) -> Vec<ImageChannel> {
        let Appearance { maps, has_colour, has_alpha, scalars, .. } = &self.appearance;
        let factors = [(maps.occlusion, OCCLUSION), (maps.roughness, ROUGHNESS), (maps.metallic, METALLIC)];
        let factors = factors.into_iter().filter(|(is_there, _)| *is_there).map(|(_, name)| name.to_owned());
        let factors: Vec<String> = factors.collect();
        let channel = |name: &str, kind, resolution| ImageChannel {
            name: name.to_owned(),
            kind,
            resolution,
            alpha: false,
            factors: vec![],
        };
        let mut channels = vec![];
        if *has_colour {
            channels.push(ImageChannel { alpha: *has_alpha, ..channel(COLOUR, ImageKind::Colour, texels) });
        }
        if maps.normal {
            channels.push(channel(NORMAL, ImageKind::Normal, texels));
        }
        if maps.emissive {
            channels.push(channel(EMISSIVE, ImageKind::Emissive, texels));
        }
        if !factors.is_empty() {
            channels.push(ImageChannel { factors, ..channel("factors", ImageKind::Factors, texels) });
        }
        channels.extend(scalars.iter().map(|range| {
            let kind = if range.is_label() { ImageKind::Label } else { ImageKind::Scalar };
            channel(&range.name, kind, numbers)
        }));
        channels
    }
}

impl AtlasProduct {
    /// The resolution at which images have about a texel for each texel of the input, or for each of its vertices; 0
    /// where there are no images.
    pub(super) fn texel_resolution(&self, shader: &Shader) -> u32 {
        if self.looks.appearance.is_empty() {
            return 0;
        }
        let mut painter = shader.painter(&self.looks.attributes);
        let mut texels = 0.0;
        for chart in &self.charts {
            for (&number, corners) in chart.numbers.iter().zip(&chart.mesh.triangles) {
                let [a, b, c] = corners.map(|v| chart.mesh.positions[v as usize]);
                let density = f64::from(painter.face(number as usize, [a, b, c]).material_density());
                texels += density * density * (b - a).cross(c - a).length() / 2.0;
            }
        }
        self.resolution_for(texels)
    }
}

/// What images with texels show at a sample: colour, normal, emitted light and factors, four bytes and three of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Texel([u8; 13]);

impl Texel {
    /// That of a point of a triangle, averaged over a length.
    pub fn of(looks: &Looks, face: &Face, weights: [f32; 3], footprint: f32) -> Self {
        let maps = looks.appearance.maps;
        let mut texel = [0; 13];
        if looks.appearance.has_colour {
            let [red, green, blue, alpha] = face.base_colour(weights, footprint);
            let [red, green, blue] = [red, green, blue].map(srgb_byte);
            texel[..4].copy_from_slice(&[red, green, blue, share_byte(alpha)]);
        }
        if maps.normal {
            texel[4..7].copy_from_slice(&face.normal(weights, footprint).map(|x| share_byte(0.5 * (x + 1.0))));
        }
        if maps.emissive {
            texel[7..10].copy_from_slice(&face.emissive(weights, footprint).map(srgb_byte));
        }
        if maps.occlusion || maps.roughness || maps.metallic {
            let [metallic, roughness] = face.metallic_roughness(weights, footprint);
            let factors = [face.occlusion(weights, footprint), roughness, metallic];
            texel[10..].copy_from_slice(&factors.map(share_byte));
        }
        Self(texel)
    }

    /// The bytes of a channel.
    pub fn bytes(&self, kind: ImageKind, has_alpha: bool) -> &[u8] {
        match kind {
            ImageKind::Colour if has_alpha => &self.0[..4],
            ImageKind::Colour => &self.0[..3],
            ImageKind::Normal => &self.0[4..7],
            ImageKind::Emissive => &self.0[7..10],
            ImageKind::Factors => &self.0[10..],
            ImageKind::Scalar | ImageKind::Label => &[],
        }
    }
}

/// The value of a scalar or label.
pub(super) fn number(looks: &Looks, which: usize) -> impl Fn(&Face, [f32; 3], f32) -> f32 + Sync {
    let is_label = looks.appearance.scalars.get(which).is_some_and(|range| range.is_label());
    move |face, weights, _| if is_label { face.label(which, weights) } else { face.scalar(which, weights) }
}
