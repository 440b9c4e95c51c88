//! What a tile's surface looks like: grey where a file has no channels, else the images of the tile's own block.

use lodpack::decode::texels::Image;
use lodpack::decode::{Drawing, TexturedMesh};
use lodpack::{LatticePoint, Mesh};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::io;

use super::glb::{Positions, in_order_of_use};
use super::light::BorderNormals;
use crate::mesh::encoded::{Encoded, Formats, encoded};
use crate::mesh::layers::{Layer, Look};
use crate::mesh::material::{draw, material};
use crate::mesh::pages::{Page, PagedMesh};
use crate::mesh::shaded::Shading;

/// The surface of a tile.
#[derive(Default)]
pub struct Surface {
    /// Its points. A point is there once for each place in the image, and each normal.
    pub points: Vec<LatticePoint>,
    /// Its triangles.
    pub triangles: Vec<[u32; 3]>,
    /// What it looks like; none without images.
    pub paint: Option<Paint>,
    /// Its normals, where images have none; none without light.
    pub shading: Option<Shading>,
    /// The object of each point; empty if they are not known.
    pub objects: Vec<u32>,
}

/// What the points of a tile show.
pub struct Paint {
    /// Their places in the image, of its width and height.
    pub places: Vec<[f32; 2]>,
    /// Their tangents and normals; empty without images of normals.
    pub frames: Vec<[[f32; 3]; 2]>,
    /// The images.
    page: Page,
    /// Their formats.
    formats: Formats,
    /// How the triangles are drawn, if the file says it, and how many follow each other that are drawn so.
    pub parts: Vec<(Option<Drawing>, usize)>,
}

impl Surface {
    /// The part of a cut that one of its nodes draws, lit by normals if those of borders are there. `objects` are those
    /// of its triangles; empty if they are not known.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] if it has more than 2^32 corners.
    pub fn of_node(
        textured: &TexturedMesh,
        (triangles, objects): (std::ops::Range<usize>, &[u32]),
        look: &Look,
        light: Option<&BorderNormals>,
        positions: &Positions,
    ) -> io::Result<Self> {
        let mesh = part_of(&textured.mesh, triangles.clone());
        let node = textured.mesh.triangle_nodes.get(triangles.start).map_or(0, |&node| node as usize);
        let paged = if textured.textures.is_empty() {
            match light {
                Some(_) => PagedMesh::bare(&mesh)?,
                None => PagedMesh::without_normals(mesh),
            }
        } else {
            let texture = textured.textures.get(node).cloned().unwrap_or_default();
            let own = TexturedMesh { mesh, places: textured.places[triangles].to_vec(), textures: vec![texture] };
            // One image is one page.
            let paged = PagedMesh::new(&own, look, u32::MAX);
            if light.is_some() { paged.smooth(&own.mesh)? } else { paged }
        };
        let objects = objects_of_points(&paged, objects);
        let points: Vec<LatticePoint> =
            paged.positions.iter().map(|&position| positions.on_lattice(position)).collect();
        let parts = paged.parts();
        let triangles = parts.iter().flat_map(|part| part.triangles.iter().copied()).collect();
        let parts = parts.iter().map(|part| (part.drawing, part.triangles.len())).collect();
        let page = paged.pages.into_iter().next();
        let paint = page.map(|page| Paint {
            places: paged.places,
            frames: paged.frames,
            page,
            formats: Formats::of(look),
            parts,
        });
        let mut this = Self { points, triangles, paint, shading: None, objects };
        if let Some(light) = light.filter(|_| !paged.normals.is_empty()) {
            let mut normals = paged.normals;
            light.settle(&this.points, &mut normals);
            this.join(normals);
        }
        Ok(this)
    }

    /// Takes a normal for each point. Points that are alike now become one, as those whose normals a border has made
    /// the same.
    fn join(&mut self, normals: Vec<[f32; 3]>) {
        let mut first_of = HashMap::new();
        let mut kept = vec![];
        let number_of = |(number, normal): (usize, &[f32; 3])| {
            let place = self.paint.as_ref().and_then(|paint| paint.places.get(number)).copied().unwrap_or_default();
            let object = self.objects.get(number).copied();
            let alike = (self.points[number], place.map(f32::to_bits), normal.map(f32::to_bits), object);
            *first_of.entry(alike).or_insert_with(|| {
                kept.push(number);
                kept.len() as u32 - 1
            })
        };
        let numbers: Vec<u32> = normals.iter().enumerate().map(number_of).collect();
        self.triangles.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
        self.points = kept.iter().map(|&number| self.points[number]).collect();
        if let Some(paint) = self.paint.as_mut().filter(|paint| !paint.places.is_empty()) {
            paint.places = kept.iter().map(|&number| paint.places[number]).collect();
        }
        if !self.objects.is_empty() {
            self.objects = kept.iter().map(|&number| self.objects[number]).collect();
        }
        let normals = kept.iter().map(|&number| normals[number]).collect();
        self.shading = Some(Shading { normals, ..Shading::default() });
    }
}

/// The object of each point of a mesh, from those of its triangles.
fn objects_of_points(paged: &PagedMesh, objects: &[u32]) -> Vec<u32> {
    if objects.is_empty() {
        return vec![];
    }
    if !paged.corners.is_empty() {
        return paged.corners.iter().map(|&(triangle, _)| objects[triangle as usize]).collect();
    }
    // Without images triangles keep their order.
    let mut of_points = vec![0; paged.positions.len()];
    for (corners, &object) in paged.triangles.iter().flatten().zip(objects) {
        corners.iter().for_each(|&point| of_points[point as usize] = object);
    }
    of_points
}

/// Some triangles of a mesh, with the vertices that they have.
fn part_of(mesh: &Mesh, range: std::ops::Range<usize>) -> Mesh {
    let corners = mesh.triangles[range.clone()].as_flattened();
    let (used, indices) = in_order_of_use(mesh.positions.len(), corners);
    Mesh {
        positions: used.iter().map(|&vertex| mesh.positions[vertex as usize]).collect(),
        triangles: indices.as_chunks().0.to_vec(),
        triangle_nodes: vec![0; range.len()],
    }
}

impl Paint {
    /// One image for all of a tile, and the places of its points in it.
    pub fn of_image(image: Image<u8>, places: Vec<[f32; 2]>, triangle_count: usize) -> Self {
        let formats = Formats::of(&Look::default());
        Self {
            places,
            frames: vec![],
            page: vec![(Layer::Colour, image)],
            formats,
            parts: vec![(None, triangle_count)],
        }
    }

    /// Whether there is an image.
    pub fn has_images(&self) -> bool {
        !self.page.is_empty()
    }

    /// The encoded images with their media types, and the materials that show them as textures 0, 1, ...: one for each
    /// part.
    ///
    /// # Errors
    /// If an image is too large for its format.
    pub fn encode(&self) -> io::Result<(Vec<Encoded>, Vec<Value>)> {
        let mut images = vec![];
        let texture = |layer, image: &_| {
            images.push(encoded(layer, image, self.formats)?);
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
