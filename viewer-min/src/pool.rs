//! Large buffers for the triangles of many roots: a call of the device draws all roots of a buffer, so a frame of
//! 10,000 roots takes few.

use std::{ops::Range, sync::Arc};

use range_alloc::RangeAllocator;
use wgpu::BufferUsages;

use crate::{camera::Vertex, gpu::Gpu};

/// Vertices of a buffer, unless a root has more: 7 MiB.
const VERTICES: u32 = 1 << 18;
/// Indices of a buffer: twice as many triangles as vertices.
const INDICES: u32 = 6 * VERTICES;

/// What the device reads of a draw: number of indices and of instances, first index, vertex and instance.
type Call = [u32; 5];

/// Where the triangles of a root lie in a [`Pool`].
#[derive(Debug)]
pub(crate) struct Place {
    buffer: usize,
    vertices: Range<u32>,
    indices: Range<u32>,
    /// What is added to indices: where these vertices begin, or nothing where they count from the buffer's start.
    base: u32,
}

impl Place {
    fn call(&self, slot: u32) -> Call {
        [self.indices.len() as u32, 1, self.indices.start, self.base, slot]
    }

    /// Its size on the device.
    pub fn bytes(&self) -> u64 {
        self.vertices.len() as u64 * size_of::<Vertex>() as u64 + 4 * self.indices.len() as u64
    }
}

/// Vertices and indices of some roots.
struct Shared {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    free_vertices: RangeAllocator<u32>,
    free_indices: RangeAllocator<u32>,
}

impl Shared {
    fn new(gpu: &Gpu, [vertex_count, index_count]: [u32; 2]) -> Self {
        let [vertex_count, index_count] = [vertex_count.max(VERTICES), index_count.max(INDICES)];
        let vertex_bytes = u64::from(vertex_count) * size_of::<Vertex>() as u64;
        Self {
            vertices: gpu.empty_buffer(vertex_bytes, BufferUsages::VERTEX | BufferUsages::COPY_DST),
            indices: gpu.empty_buffer(4 * u64::from(index_count), BufferUsages::INDEX | BufferUsages::COPY_DST),
            free_vertices: RangeAllocator::new(0..vertex_count),
            free_indices: RangeAllocator::new(0..index_count),
        }
    }

    fn take(&mut self, [vertex_count, index_count]: [u32; 2]) -> Option<[Range<u32>; 2]> {
        if vertex_count == 0 {
            return Some([0..0, self.free_indices.allocate_range(index_count).ok()?]);
        }
        let vertices = self.free_vertices.allocate_range(vertex_count).ok()?;
        let Ok(indices) = self.free_indices.allocate_range(index_count) else {
            self.free_vertices.free_range(vertices);
            return None;
        };
        Some([vertices, indices])
    }
}

/// The triangles of all roots that are drawn without images of their own.
pub(crate) struct Pool {
    gpu: Arc<Gpu>,
    /// None where one has become empty.
    buffers: Vec<Option<Shared>>,
}

impl Pool {
    pub fn new(gpu: &Arc<Gpu>) -> Self {
        Self { gpu: Arc::clone(gpu), buffers: Vec::new() }
    }

    /// Uploads triangles; none if there are none.
    pub fn place(&mut self, positions: &[Vertex], triangles: &[[u32; 3]]) -> Option<Place> {
        if triangles.is_empty() {
            return None;
        }
        let counts = [positions.len() as u32, 3 * triangles.len() as u32];
        let with_room =
            (0..).zip(&mut self.buffers).find_map(|(number, shared)| Some((number, shared.as_mut()?.take(counts)?)));
        let (buffer, [vertices, indices]) = with_room.or_else(|| {
            let mut shared = Shared::new(&self.gpu, counts);
            let taken = shared.take(counts)?;
            let number = self.buffers.iter().position(Option::is_none).unwrap_or_else(|| {
                self.buffers.push(None);
                self.buffers.len() - 1
            });
            self.buffers[number] = Some(shared);
            Some((number, taken))
        })?;
        let place = Place { buffer, base: vertices.start, vertices, indices };
        self.write(&place, 0, positions);
        self.write_triangles(&place, triangles);
        Some(place)
    }

    /// Uploads triangles that have vertices of a place, and then vertices of their own. None if its buffer has no room.
    pub fn place_beside(&mut self, place: &Place, positions: &[Vertex], triangles: &[[u32; 3]]) -> Option<Place> {
        let counts = [positions.len() as u32, 3 * triangles.len() as u32];
        let [vertices, indices] = self.buffers[place.buffer].as_mut()?.take(counts)?;
        let shared_count = place.vertices.len() as u32;
        let in_buffer = |index: u32| match index.checked_sub(shared_count) {
            Some(own) => vertices.start + own,
            None => place.vertices.start + index,
        };
        let triangles: Vec<[u32; 3]> = triangles.iter().map(|triangle| triangle.map(in_buffer)).collect();
        let beside = Place { buffer: place.buffer, vertices, indices, base: 0 };
        self.write(&beside, 0, positions);
        self.write_triangles(&beside, &triangles);
        Some(beside)
    }

    /// Uploads vertices of a place again, from one of them on.
    pub fn write(&self, place: &Place, first: u32, positions: &[Vertex]) {
        if let Some(shared) = self.buffers[place.buffer].as_ref().filter(|_| !positions.is_empty()) {
            let at = u64::from(place.vertices.start + first) * size_of::<Vertex>() as u64;
            self.gpu.write(&shared.vertices, at, bytemuck::cast_slice(positions));
        }
    }

    fn write_triangles(&self, place: &Place, triangles: &[[u32; 3]]) {
        if let Some(shared) = &self.buffers[place.buffer] {
            self.gpu.write(&shared.indices, 4 * u64::from(place.indices.start), bytemuck::cast_slice(triangles));
        }
    }

    /// Gives room back, if there is any.
    pub fn give_back(&mut self, place: Option<Place>) {
        if let Some(place) = place {
            self.free(place);
        }
    }

    /// Gives room back. A buffer in which nothing is left is dropped.
    pub fn free(&mut self, place: Place) {
        let slot = &mut self.buffers[place.buffer];
        let Some(shared) = slot else { return };
        if !place.vertices.is_empty() {
            shared.free_vertices.free_range(place.vertices);
        }
        shared.free_indices.free_range(place.indices);
        if shared.free_indices.is_empty() {
            *slot = None;
        }
    }

    /// What draws these roots, for each the number of its instance and its place, until places are taken or given back.
    pub fn list<'p>(&self, roots: impl Iterator<Item = (u32, &'p Place)>) -> List {
        let mut calls: Vec<Vec<Call>> = vec![Vec::new(); self.buffers.len()];
        for (slot, place) in roots {
            calls[place.buffer].push(place.call(slot));
        }
        let indirect = self.gpu.draws_lists.then(|| self.gpu.buffer(&calls.concat(), BufferUsages::INDIRECT));
        List { calls, indirect }
    }

    /// Draws the roots of a list.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, list: &List) {
        let mut at = 0;
        for (shared, calls) in self.buffers.iter().zip(&list.calls) {
            let Some(shared) = shared.as_ref().filter(|_| !calls.is_empty()) else { continue };
            pass.set_vertex_buffer(0, shared.vertices.slice(..));
            pass.set_index_buffer(shared.indices.slice(..), wgpu::IndexFormat::Uint32);
            match &list.indirect {
                Some(indirect) => pass.multi_draw_indexed_indirect(indirect, at, calls.len() as u32),
                None => {
                    for &[index_count, _, first_index, first_vertex, slot] in calls {
                        let indices = first_index..first_index + index_count;
                        pass.draw_indexed(indices, first_vertex as i32, slot..slot + 1);
                    }
                }
            }
            at += (calls.len() * size_of::<Call>()) as u64;
        }
    }
}

/// Calls of the device, which draw roots of a [`Pool`].
pub(crate) struct List {
    /// For each buffer.
    calls: Vec<Vec<Call>>,
    /// All of them on the device, where it reads them itself.
    indirect: Option<wgpu::Buffer>,
}

#[cfg(test)]
mod tests {
    use lodpack::{View, stream::Mode};

    use super::*;
    use crate::{
        args::Way,
        camera::whole,
        draw::Renderer,
        gpu::Targets,
        scene::{Scene, open_source},
    };

    #[test]
    fn a_list_draws_what_single_calls_draw_while_roots_come_and_go() {
        let Ok(listing) = Gpu::headless() else {
            assert!(std::env::var_os("LODPACK_REQUIRE_GPU").is_none_or(|value| value != "1"), "no graphics adapter");
            return;
        };
        let mut single = Gpu::headless().unwrap();
        single.draws_lists = false;
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../format-spec/vectors/tree.lodpack");
        let mut scene = Scene::open(open_source(path).unwrap(), Mode::Synchronous).unwrap();
        let mut renderers = [listing, single].map(|gpu| {
            let gpu = Arc::new(gpu);
            (Targets::new(&gpu, [64; 2]), Renderer::new(&gpu, Way::Stitched))
        });
        let mut counts = vec![];
        for pixel_tolerance in [1e4, 1e-3, 1e4, 1.0, 1e-3] {
            let view = View { pixel_tolerance, viewport: [64; 2], ..whole(scene.bounds, [0.0, 1.0, 0.0], 1.0) };
            counts.push(scene.follow_to_the_end(&view).unwrap().nodes);
            let pictures = renderers.each_mut().map(|(targets, renderer)| {
                renderer.update(scene.first.picture());
                renderer.picture(targets, &view).unwrap()
            });
            assert!(pictures[0].roots.iter().any(Option::is_some));
            assert_eq!(pictures[0].roots, pictures[1].roots);
            assert_eq!(pictures[0].depths, pictures[1].depths);
            assert_eq!(pictures[0].colours, pictures[1].colours);
        }
        assert!(counts[0] < counts[1], "{counts:?}");
    }
}
