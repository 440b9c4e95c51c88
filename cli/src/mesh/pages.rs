//! A mesh with the pages of one channel of colours.

use lodpack::decode::{self, TexturedMesh, texels::Image};

/// A mesh of which each vertex has one place in one page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PagedMesh {
    /// World positions. Where triangles do not agree about the place of a vertex, it is there several times.
    pub positions: Vec<[f64; 3]>,
    /// The place of each vertex, of the page's width and height; the first row of texels is at 0.
    pub places: Vec<[f32; 2]>,
    /// Triangles by page; after those of all pages those without texels.
    pub triangles: Vec<Vec<[u32; 3]>>,
    /// Colours of three or four components.
    pub pages: Vec<Image<u8>>,
}

impl PagedMesh {
    /// Packs the images of a channel of colours, which was asked for as number `channel` and alone.
    pub fn new(textured: &TexturedMesh, channel: usize) -> Self {
        let paged = decode::PagedMesh::new(textured, decode::PagedMesh::SIDE);
        let pages = paged.colours(textured, channel);
        let decode::PagedMesh { positions, places, triangles, .. } = paged;
        Self { positions, places, triangles, pages }
    }
}
