//! Which channels of a file make up the look of a mesh, and the images of a node as other programs want them.

use lodpack::decode::texels::{Image, Map, Piece};
use lodpack::decode::{ChannelImage, Drawing, Texture, TexturedMesh};
use lodpack::index::{ChannelInfo, ChannelKind};

use super::appearance::{EMISSIVE, METALLIC, NORMAL, OCCLUSION, ROUGHNESS};

/// What an image of a page shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Colours, with alpha in the fourth component.
    Colour,
    /// Normals relative to the frames of vertices, as glTF 2.0 has them (section 3.9.3).
    Normal,
    /// Emitted light.
    Emissive,
    /// Occlusion, roughness and metallic.
    Factors,
}

impl Layer {
    /// How many there are.
    pub const COUNT: usize = 4;
    /// All of them, by number.
    pub const ALL: [Self; Self::COUNT] = [Self::Colour, Self::Normal, Self::Emissive, Self::Factors];
}

/// The channels that make up the look of a mesh: places among those that were asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Look {
    /// What pages show.
    pub layers: Vec<Layer>,
    colour: Option<usize>,
    normal: Option<usize>,
    emissive: Option<usize>,
    /// Occlusion, roughness and metallic.
    factors: [Option<usize>; 3],
    drawing: Option<usize>,
    /// Layers of which the file has lost nothing, by number.
    exact: [bool; Layer::COUNT],
}

impl Look {
    /// The look that a file has, and the numbers of the channels to ask for. `with_all` says whether more than colours
    /// can be written.
    pub fn of(channels: &[ChannelInfo], with_all: bool) -> (Self, Vec<u8>) {
        let mut wanted = vec![];
        let mut find = |is_it: &dyn Fn(&ChannelInfo) -> bool| {
            let number = channels.iter().position(is_it)? as u8;
            wanted.push(number);
            Some(wanted.len() - 1)
        };
        let named = |name: &'static str, kind: ChannelKind| {
            move |channel: &ChannelInfo| with_all && channel.name == name && channel.kind == kind
        };
        let mut look = Self {
            colour: find(&|channel| channel.kind == ChannelKind::Colour && channel.name != EMISSIVE),
            normal: find(&named(NORMAL, ChannelKind::Normal)),
            emissive: find(&named(EMISSIVE, ChannelKind::Colour)),
            factors: [OCCLUSION, ROUGHNESS, METALLIC].map(|name| find(&named(name, ChannelKind::Factor))),
            drawing: find(&|channel| with_all && channel.kind == ChannelKind::Drawing),
            layers: vec![],
            exact: [false; Layer::COUNT],
        };
        let layers = [
            (look.colour.is_some(), Layer::Colour),
            (look.normal.is_some(), Layer::Normal),
            (look.emissive.is_some(), Layer::Emissive),
            (look.factors.iter().any(Option::is_some), Layer::Factors),
        ];
        look.layers = layers.into_iter().filter(|(is_there, _)| *is_there).map(|(_, layer)| layer).collect();
        let is_exact = |place: Option<usize>| {
            place.and_then(|place| channels.get(usize::from(*wanted.get(place)?))).is_some_and(|known| known.is_exact)
        };
        look.exact = Layer::ALL.map(|layer| match layer {
            Layer::Colour => is_exact(look.colour),
            Layer::Normal => is_exact(look.normal),
            Layer::Emissive => is_exact(look.emissive),
            Layer::Factors => look.factors.into_iter().any(is_exact),
        });
        (look, wanted)
    }

    /// Whether the file has lost nothing of a layer.
    pub fn is_exact(&self, layer: Layer) -> bool {
        self.exact[layer as usize]
    }

    /// The place of the colours.
    pub fn colour(&self) -> Option<usize> {
        self.colour
    }

    /// How each triangle is drawn; nothing if the file does not say.
    pub(super) fn drawings(&self, textured: &TexturedMesh) -> Vec<Drawing> {
        self.drawing.map_or(vec![], |channel| textured.drawings(channel))
    }

    /// An image of a node; none if the node has no such texels.
    pub(super) fn image(&self, texture: &Texture, layer: Layer) -> Option<Image<u8>> {
        let of = |place: Option<usize>| texture.images.get(place?)?.as_ref();
        match layer {
            Layer::Colour | Layer::Emissive => {
                match of(if layer == Layer::Colour { self.colour } else { self.emissive })? {
                    ChannelImage::Colours(image) => Some(image.clone()),
                    _ => None,
                }
            }
            Layer::Normal => match of(self.normal)? {
                ChannelImage::Normals(image) => Some(in_frames(image, texture.map.as_ref()?)),
                _ => None,
            },
            Layer::Factors => {
                let images = self.factors.map(|place| match of(place) {
                    Some(ChannelImage::Factors(image)) => Some(image),
                    _ => None,
                });
                let size = images.iter().flatten().next()?.size;
                let mut packed = Image::filled(size, &layer.blank());
                for (component, image) in images.iter().enumerate() {
                    let Some(image) = image else { continue };
                    let texels = packed.data.chunks_exact_mut(3).zip(&image.data);
                    texels.for_each(|(texel, &value)| texel[component] = value);
                }
                Some(packed)
            }
        }
    }
}

impl Layer {
    /// A texel that nothing shows: three components.
    pub(super) fn blank(self) -> [u8; 3] {
        match self {
            Self::Colour | Self::Emissive => [0; 3],
            Self::Normal => [128, 128, 255],
            // Not occluded, matt, and no metal.
            Self::Factors => [255, 255, 0],
        }
    }
}

/// The tangent and the normal of all points of a piece: the direction of a row of texels, and the axis.
pub(super) fn frame(piece: &Piece) -> [[f64; 3]; 2] {
    let [along, _, axis] = piece.frame();
    [along, axis]
}

/// Normals relative to the frames of their pieces.
fn in_frames(image: &Image<u8>, map: &Map) -> Image<u8> {
    let mut result = Image::filled(image.size, &Layer::Normal.blank());
    let width = image.size[0] as usize;
    for piece in &map.pieces {
        let [tangent, axis] = frame(piece);
        // Towards the first row of the image, as programs that make tangents from coordinates have it.
        let up = [0, 1, 2].map(|k| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            tangent[i] * axis[j] - tangent[j] * axis[i]
        });
        let [low, high] = piece.range().map(|corner| corner.map(|x| x as usize));
        for texel in (low[1]..=high[1]).flat_map(|y| (low[0]..=high[0]).map(move |x| y * width + x)) {
            let direction = [0, 1, 2].map(|k| (f64::from(image.data[3 * texel + k]) - 128.0) / 127.0);
            for (to, of) in result.data[3 * texel..].iter_mut().zip([tangent, up, axis]) {
                let product: f64 = (0..3).map(|k| direction[k] * of[k]).sum();
                // The conversion saturates.
                *to = (127.5 + 127.5 * product + 0.5) as u8;
            }
        }
    }
    result
}
