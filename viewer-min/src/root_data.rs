//! The data of a root on the GPU.

use std::sync::{Arc, Weak};

use lodpack::stream::{DrawnRoot, DrawnSurface, DrawnTexture, Strip, TileImages};
use wgpu::BufferUsages;

use crate::{camera::Vertex, gpu::Gpu, pool::Place, texels::Texels};

/// A root in the shader: number, level, bits of the error, depth in the tree, mean of its image.
pub(crate) type RootInfo = [u32; 5];

/// Indexed triangles on the GPU.
pub(crate) struct Batch {
    pub vertices: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    pub index_count: u32,
}

impl Batch {
    pub fn new(gpu: &Gpu, vertices: &[Vertex], triangles: &[[u32; 3]]) -> Self {
        Self {
            vertices: gpu.buffer(vertices, BufferUsages::VERTEX | BufferUsages::STORAGE),
            indices: gpu.buffer(triangles, BufferUsages::INDEX | BufferUsages::STORAGE),
            index_count: 3 * triangles.len() as u32,
        }
    }
}

/// The data of a root on the GPU.
pub(crate) struct Block {
    /// Of the root as it was last uploaded; 0 where something of it waits.
    pub stamp: u64,
    pub info: RootInfo,
    pub strips: Vec<Arc<Strip>>,
    /// Of its normals, as they were last uploaded.
    pub light: u64,
    /// The surface that its place holds.
    pub surface: Weak<DrawnSurface>,
    /// Where its triangles lie in the pool, and those at the border; nowhere if there are none, or they are in buffers
    /// of their own. The border is with the others where it has no place of its own.
    pub place: Option<Place>,
    pub border: Option<Place>,
    pub own: Option<Box<Own>>,
    /// What it was made with.
    pub texture: Option<Arc<DrawnTexture>>,
    pub images: Option<Arc<TileImages>>,
}

/// What a root does not share with others. Most roots have nothing of it.
#[derive(Default)]
pub(crate) struct Own {
    /// Its triangles. Where the border is pulled, they are the inner ones.
    pub triangles: Option<Batch>,
    /// For pulling: the bound buffers, and the number of vertices of the border.
    pub pulled: Option<(wgpu::BindGroup, u32)>,
    /// Its image.
    pub texels: Option<Texels>,
    /// With an image: the piece of each stitched vertex; of a tile of heights the place.
    pub pieces: Option<wgpu::Buffer>,
}

impl Block {
    /// Triangles in buffers of their own, or nothing.
    pub fn new(info: RootInfo, strips: Vec<Arc<Strip>>, own: Option<Own>) -> Self {
        let (surface, own) = (Weak::new(), own.map(Box::new));
        Self { stamp: 0, info, strips, light: 0, surface, place: None, border: None, own, texture: None, images: None }
    }

    /// Whether the triangles of a root would be uploaded as these.
    pub fn has_triangles_of(&self, drawn: &DrawnRoot) -> bool {
        let mut strips = self.strips.iter().zip(&drawn.strips);
        let has_normals = drawn.light_stamp() == self.light || drawn.images().is_some();
        has_normals && self.info[1] == u32::from(drawn.surface.level) && strips.all(|(a, b)| Arc::ptr_eq(a, b))
    }

    /// All that it has in the pool.
    pub fn places(&self) -> impl Iterator<Item = &Place> {
        self.place.iter().chain(&self.border)
    }

    /// Whether its place holds the surface of a root, or would if there were no border.
    pub fn has_surface(&self, surface: &Arc<DrawnSurface>) -> bool {
        self.surface.as_ptr() == Arc::as_ptr(surface) && self.is_divided()
    }

    /// Whether its place is the same whatever is beside the root.
    pub fn is_divided(&self) -> bool {
        self.place.is_some() && (self.border.is_some() || self.strips.is_empty())
    }

    pub fn has_texels(&self) -> bool {
        self.own.as_ref().is_some_and(|own| own.texels.is_some())
    }

    pub fn is_own(&self) -> bool {
        self.own.as_ref().is_some_and(|own| own.triangles.is_some())
    }

    pub fn has_image_of(&self, drawn: &DrawnRoot) -> bool {
        self.texture.as_ref().map(Arc::as_ptr) == drawn.texture().map(Arc::as_ptr)
            && self.images.as_ref().map(Arc::as_ptr) == drawn.images().map(Arc::as_ptr)
    }
}
