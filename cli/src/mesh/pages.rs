//! A mesh with the pages of its look.

use lodpack::decode::texels::{Image, Map, Piece};
use lodpack::decode::{self, TexturedMesh};

use super::layers::{Layer, Look, frame};

/// A mesh of which each vertex has one place in one page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PagedMesh {
    /// World positions. Where triangles do not agree about the place of a vertex, it is there several times.
    pub positions: Vec<[f64; 3]>,
    /// The place of each vertex, of the page's width and height; the first row of texels is at 0.
    pub places: Vec<[f32; 2]>,
    /// Triangles by page; after those of all pages those without texels.
    pub triangles: Vec<Vec<[u32; 3]>>,
    /// For each vertex a triangle of the textured mesh and one of its corners, 0 to 2, that lie at its place.
    pub corners: Vec<(u32, u8)>,
    /// Tangent and normal of each vertex, in which the layer of normals is; empty without it.
    pub frames: Vec<[[f32; 3]; 2]>,
    /// The images of each page, all of one size: one for each layer of the look.
    pub pages: Vec<Page>,
}

/// The images of a page.
pub type Page = Vec<(Layer, Image<u8>)>;

impl PagedMesh {
    /// Packs the images of the nodes into pages of at most `side` texels along each side, unless one image is larger.
    pub fn new(textured: &TexturedMesh, look: &Look, side: u32) -> Self {
        let paged = decode::PagedMesh::new(textured, side);
        let mut pages: Vec<Page> = vec![vec![]; paged.page_sizes.len()];
        for &layer in &look.layers {
            let images: Vec<Option<Image<u8>>> =
                textured.textures.iter().map(|texture| look.image(texture, layer)).collect();
            let images: Vec<Option<&Image<u8>>> = images.iter().map(Option::as_ref).collect();
            let [red, green, blue] = layer.blank();
            for (page, image) in pages.iter_mut().zip(paged.filled(&images, 3, &[red, green, blue, 255])) {
                page.push((layer, image));
            }
        }
        let frame_of = |&(triangle, corner): &(u32, u8)| {
            let node = textured.mesh.triangle_nodes[triangle as usize];
            let map = textured.textures.get(node as usize).and_then(|texture| texture.map.as_ref());
            let place = textured.places[triangle as usize][usize::from(corner)];
            let own = map.and_then(|map| piece_at(map, place)).map_or([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], frame);
            own.map(|direction| direction.map(|x| x as f32))
        };
        let has_frames = look.layers.contains(&Layer::Normal);
        let frames = if has_frames { paged.corners.iter().map(frame_of).collect() } else { vec![] };
        let decode::PagedMesh { positions, places, triangles, corners, .. } = paged;
        Self { positions, places, triangles, corners, frames, pages }
    }

    /// The image of a layer on a page.
    pub fn image(&self, page: usize, layer: Layer) -> Option<&Image<u8>> {
        self.pages.get(page)?.iter().find(|(known, _)| *known == layer).map(|(_, image)| image)
    }
}

/// The piece that has a place in an image.
fn piece_at(map: &Map, place: [f32; 2]) -> Option<&Piece> {
    map.pieces.iter().find(|piece| {
        let [low, high] = piece.range();
        (0..2).all(|k| low[k] - 0.5 <= f64::from(place[k]) && f64::from(place[k]) < high[k] + 0.5)
    })
}
