//! What a tile's surface looks like: grey where a file has no channels, else the images of the tile's own block.

use lodpack::LatticePoint;
use lodpack::decode::{Drawing, Texture, TexturedMesh};
use serde_json::{Value, json};
use std::io;

use super::glb::Positions;
use crate::mesh::encoded::{Encoded, Lossy, encoded};
use crate::mesh::layers::{Layer, Look};
use crate::mesh::material::{draw, material};
use crate::mesh::pages::{Page, PagedMesh};

/// What is JPEG where it is opaque. Directions lose little, too; factors would be blurred into each other.
const LOSSY: Lossy = &[Layer::Colour, Layer::Normal, Layer::Emissive];

/// The surface of a tile.
#[derive(Default)]
pub struct Surface {
    /// Its points. With images, a point is there once for each place in the image.
    pub points: Vec<LatticePoint>,
    /// Its triangles.
    pub triangles: Vec<[u32; 3]>,
    /// What it looks like; none without images.
    pub paint: Option<Paint>,
}

/// What the points of a tile show.
pub struct Paint {
    /// Their places in the image, of its width and height.
    pub places: Vec<[f32; 2]>,
    /// Their tangents and normals; empty without images of normals.
    pub frames: Vec<[[f32; 3]; 2]>,
    /// The images.
    page: Page,
    /// How the triangles are drawn, if the file says it, and how many follow each other that are drawn so.
    pub parts: Vec<(Option<Drawing>, usize)>,
}

impl Surface {
    /// The part of a cut that one of its nodes draws.
    pub fn of_node(
        textured: &TexturedMesh,
        triangles: std::ops::Range<usize>,
        look: &Look,
        positions: &Positions,
    ) -> Self {
        let mesh = &textured.mesh;
        let node = triangles.clone().next().map_or(0, |first| mesh.triangle_nodes[first]);
        let own = TexturedMesh {
            mesh: lodpack::Mesh {
                positions: mesh.positions.clone(),
                triangles: mesh.triangles[triangles.clone()].to_vec(),
                triangle_nodes: vec![0; triangles.len()],
            },
            places: textured.places[triangles].to_vec(),
            textures: textured
                .textures
                .get(node as usize)
                .map_or(vec![Texture::default()], |texture| vec![texture.clone()]),
        };
        // One image is one page.
        let paged = PagedMesh::new(&own, look, u32::MAX);
        let points = paged.positions.iter().map(|&position| positions.on_lattice(position)).collect();
        let parts = paged.parts();
        let triangles = parts.iter().flat_map(|part| part.triangles.iter().copied()).collect();
        let parts = parts.iter().map(|part| (part.drawing, part.triangles.len())).collect();
        let page = paged.pages.into_iter().next();
        let paint = page.map(|page| Paint { places: paged.places, frames: paged.frames, page, parts });
        Self { points, triangles, paint }
    }
}

impl Paint {
    /// Whether there is an image.
    pub fn has_images(&self) -> bool {
        !self.page.is_empty()
    }

    /// The encoded images with their media types, and the materials that show them as textures 0, 1, ...: one for each part.
    ///
    /// # Errors
    /// If an image is too large for its format.
    pub fn encode(&self) -> io::Result<(Vec<Encoded>, Vec<Value>)> {
        let mut images = vec![];
        let texture = |layer, image: &_| {
            images.push(encoded(layer, image, LOSSY)?);
            Ok(images.len() - 1)
        };
        let mut material = if self.has_images() { material(&self.page, texture)? } else { plain() };
        // Surfaces with boundaries are seen from behind, too, unless the file says that they are not.
        material["doubleSided"] = true.into();
        let of_part = |&(drawing, _): &(Option<Drawing>, usize)| {
            let mut own = material.clone();
            drawing.into_iter().for_each(|drawing| draw(&mut own, drawing));
            own
        };
        Ok((images, self.parts.iter().map(of_part).collect()))
    }
}

/// The material of tiles without images: matt and light grey.
pub fn plain() -> Value {
    json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
        "doubleSided": true,
    })
}
