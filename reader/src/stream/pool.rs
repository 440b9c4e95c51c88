//! Places for the roots of a picture in a few large buffers of an engine, so that a frame of 10,000 roots takes few
//! calls of the device. Nothing here knows the engine: what to copy comes as bytes, and a call as five numbers.

use std::collections::HashMap;

use range_alloc::RangeAllocator;

use super::{Changes, DrawnRoot, Picture};
use crate::sorted::{SortedMap, SortedSet};

/// Bytes of a vertex: three floats for where it is, relative to an origin, and two signed 16-bit integers for its
/// normal ([`super::direction`] has their meaning; zeros in a session without light). Little-endian.
pub const VERTEX_BYTES: usize = 16;

/// How large the buffers of a [`Pool`] are, unless a single root needs more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoolOptions {
    /// Vertices of a buffer; 2^18 by default, which takes 4 MiB.
    pub vertex_count: u32,
    /// Indices of a buffer, of four bytes each; six times as many by default.
    pub index_count: u32,
}

impl Default for PoolOptions {
    fn default() -> Self {
        Self { vertex_count: 1 << 18, index_count: 6 << 18 }
    }
}

/// Buffers of an engine: one of vertices, and one of indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoolBuffer {
    /// Its number: no other one of the pool has had it.
    pub id: u64,
    /// Vertices that it has room for, of [`VERTEX_BYTES`] each.
    pub vertex_count: u32,
    /// Indices that it has room for, of four bytes each.
    pub index_count: u32,
}

/// Where the triangles of a root lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoolPlace {
    /// The number of the [`PoolBuffer`].
    pub buffer: u64,
    /// Its first vertex, from which indices count.
    pub first_vertex: u32,
    /// How many vertices it has.
    pub vertex_count: u32,
    /// Its first index.
    pub first_index: u32,
    /// How many indices it has, three a triangle.
    pub index_count: u32,
}

impl PoolPlace {
    /// What an indexed indirect call of Vulkan, Metal, Direct3D 12 and WebGPU takes: the numbers of indices and of
    /// instances, the first index, what is added to each index, and the first instance.
    pub fn indirect(&self, instance: u32) -> [u32; 5] {
        [self.index_count, 1, self.first_index, self.first_vertex, instance]
    }
}

/// What to copy into the buffers for a root.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PoolUpload {
    /// The root's number.
    pub root: u32,
    /// Where it goes.
    pub place: PoolPlace,
    /// Its vertices.
    pub vertices: Vec<u8>,
    /// Its indices, four bytes each.
    pub indices: Vec<u8>,
}

struct Buffer {
    about: PoolBuffer,
    free_vertices: RangeAllocator<u32>,
    free_indices: RangeAllocator<u32>,
}

impl Buffer {
    fn new(id: u64, vertex_count: u32, index_count: u32) -> Self {
        Self {
            about: PoolBuffer { id, vertex_count, index_count },
            free_vertices: RangeAllocator::new(0..vertex_count),
            free_indices: RangeAllocator::new(0..index_count),
        }
    }

    fn take(&mut self, vertex_count: u32, index_count: u32) -> Option<PoolPlace> {
        let vertices = self.free_vertices.allocate_range(vertex_count).ok()?;
        let Ok(indices) = self.free_indices.allocate_range(index_count) else {
            self.free_vertices.free_range(vertices);
            return None;
        };
        let (first_vertex, first_index) = (vertices.start, indices.start);
        Some(PoolPlace { buffer: self.about.id, first_vertex, vertex_count, first_index, index_count })
    }

    fn give(&mut self, place: &PoolPlace) {
        self.free_vertices.free_range(place.first_vertex..place.first_vertex + place.vertex_count);
        self.free_indices.free_range(place.first_index..place.first_index + place.index_count);
    }
}

/// Places of the roots of a picture in buffers of an engine.
///
/// After each frame call [`Pool::update`]; drop the buffers that [`Pool::buffers`] has no longer, make those that are
/// new, copy what the uploads have, and draw [`Pool::places`]. Where the device still draws the frame before, copies
/// have to wait for it, as those of a queue do.
pub struct Pool {
    options: PoolOptions,
    origin: [f64; 3],
    buffers: Vec<Buffer>,
    next_id: u64,
    places: SortedMap<u32, PoolPlace>,
}

impl Pool {
    /// An empty pool. Vertices are relative to an origin near what is seen, so that single precision is enough.
    pub fn new(origin: [f64; 3], options: PoolOptions) -> Self {
        Self { options, origin, buffers: Vec::new(), next_id: 0, places: SortedMap::new() }
    }

    /// What vertices are relative to.
    pub fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// Follows a picture by what has changed in it since the last call; returns what to copy. A picture that the pool
    /// has not followed before, as for a device that was lost, needs a new pool and [`Pool::fill`].
    pub fn update(&mut self, picture: &Picture, changes: &Changes) -> Vec<PoolUpload> {
        let strips = changes.strips.iter().map(|(root, _)| root);
        let changed: SortedSet<u32> = changes.surfaces.iter().chain(strips).chain(&changes.lights).copied().collect();
        // All old ones go first, so that new ones find their room.
        changes.removed.iter().chain(changed.iter()).for_each(|&root| self.release(root));
        let uploads = changed.iter().filter_map(|&root| self.add(picture.root(root)?)).collect();
        // A buffer in which nothing is left stays only if it is the last one.
        let mut used: HashMap<u64, u32> = HashMap::new();
        self.places.values().for_each(|place| *used.entry(place.buffer).or_default() += 1);
        let count = self.buffers.len();
        self.buffers.retain(|buffer| count == 1 || used.contains_key(&buffer.about.id));
        uploads
    }

    /// Everything that a picture draws, as if nothing were there.
    pub fn fill(&mut self, picture: &Picture) -> Vec<PoolUpload> {
        (self.buffers, self.places) = (Vec::new(), SortedMap::new());
        picture.roots().filter_map(|drawn| self.add(drawn)).collect()
    }

    fn release(&mut self, root: u32) {
        let Some(place) = self.places.remove(&root) else { return };
        if let Some(buffer) = self.buffers.iter_mut().find(|buffer| buffer.about.id == place.buffer) {
            buffer.give(&place);
        }
    }

    fn add(&mut self, drawn: &DrawnRoot) -> Option<PoolUpload> {
        let (positions, triangles, normals) = match drawn.lit() {
            Some(lit) => (lit.positions, lit.triangles, lit.normals),
            None => {
                let (positions, triangles) = drawn.joined();
                (positions, triangles, Vec::new())
            }
        };
        if triangles.is_empty() {
            return None;
        }
        let (vertex_count, index_count) = (positions.len() as u32, 3 * triangles.len() as u32);
        let place = self.buffers.iter_mut().find_map(|buffer| buffer.take(vertex_count, index_count));
        let place = place.or_else(|| {
            let PoolOptions { vertex_count: vertices, index_count: indices } = self.options;
            let buffer = Buffer::new(self.next_id, vertices.max(vertex_count), indices.max(index_count));
            self.next_id += 1;
            self.buffers.push(buffer);
            self.buffers.last_mut()?.take(vertex_count, index_count)
        })?;
        let mut vertices = Vec::with_capacity(positions.len() * VERTEX_BYTES);
        for (number, position) in positions.iter().enumerate() {
            let near = [0, 1, 2].map(|k| (position[k] - self.origin[k]) as f32);
            let normal = normals.get(number).copied().unwrap_or_default();
            vertices.extend(near.iter().flat_map(|x| x.to_le_bytes()));
            vertices.extend(normal.iter().flat_map(|x| x.to_le_bytes()));
        }
        let indices = triangles.as_flattened().iter().flat_map(|index| index.to_le_bytes()).collect();
        let root = drawn.surface.root;
        self.places.insert(root, place);
        Some(PoolUpload { root, place, vertices, indices })
    }

    /// The buffers that there have to be.
    pub fn buffers(&self) -> impl ExactSizeIterator<Item = PoolBuffer> + '_ {
        self.buffers.iter().map(|buffer| buffer.about)
    }

    /// Where each root lies, by number.
    pub fn places(&self) -> impl Iterator<Item = (u32, PoolPlace)> + '_ {
        self.places.iter().map(|(&root, &place)| (root, place))
    }
}
