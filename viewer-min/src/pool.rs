//! The triangles of many roots in a few large buffers: one call draws all of a buffer, however many roots it has.
//!
//! Each vertex has the number of its root's entry in the shader. Where a root has gone, triangles without extent lie until another one takes its place.

use std::ops::Range;

use wgpu::BufferUsages;

use crate::{camera::pair, gpu::Gpu};

/// The vertices of a buffer, and its triangles, unless a root has more.
const LEAST: u32 = 1 << 18;

/// A vertex: the bits of its position as a pair, and the number of its root's entry.
type Vertex = [u32; 7];

/// Where the triangles of a root lie.
#[derive(Debug)]
pub(crate) struct Lot {
    chunk: usize,
    vertices: Range<u32>,
    triangles: Range<u32>,
}

/// A vertex buffer and an index buffer.
struct Chunk {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    free_vertices: Free,
    free_triangles: Free,
}

/// The buffers.
#[derive(Default)]
pub(crate) struct Pool {
    chunks: Vec<Chunk>,
}

impl Pool {
    /// Uploads the triangles of a root, whose entry in the shader has a number.
    pub fn put(&mut self, gpu: &Gpu, slot: u32, positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Lot {
        let counts = [positions.len() as u32, triangles.len() as u32];
        let found = self.chunks.iter_mut().enumerate().find_map(|(number, chunk)| Some((number, chunk.take(counts)?)));
        let (chunk, [vertices, triangle_range]) = found.unwrap_or_else(|| {
            let mut chunk = Chunk::new(gpu, counts.map(|count| count.max(LEAST)));
            let taken = chunk.take(counts).unwrap_or_default();
            self.chunks.push(chunk);
            (self.chunks.len() - 1, taken)
        });
        let first = vertices.start;
        let vertex = |&position: &[f64; 3]| -> Vertex {
            let [a, b, c, d, e, f] = pair(position).map(f32::to_bits);
            [a, b, c, d, e, f, slot]
        };
        let data: Vec<Vertex> = positions.iter().map(vertex).collect();
        let moved: Vec<[u32; 3]> = triangles.iter().map(|triangle| triangle.map(|vertex| first + vertex)).collect();
        let into = &self.chunks[chunk];
        write(gpu, &into.vertices, first, &data);
        write(gpu, &into.indices, triangle_range.start, &moved);
        Lot { chunk, vertices, triangles: triangle_range }
    }

    /// Takes triangles away.
    pub fn remove(&mut self, gpu: &Gpu, Lot { chunk, vertices, triangles }: Lot) {
        let chunk = &mut self.chunks[chunk];
        write(gpu, &chunk.indices, triangles.start, &vec![[0_u32; 3]; triangles.len()]);
        chunk.free_vertices.give(vertices);
        chunk.free_triangles.give(triangles);
    }

    /// What to draw: vertices, indices, and the number of these.
    pub fn draws(&self) -> impl Iterator<Item = (&wgpu::Buffer, &wgpu::Buffer, u32)> {
        let draws = self.chunks.iter().map(|chunk| (&chunk.vertices, &chunk.indices, 3 * chunk.free_triangles.end()));
        draws.filter(|(.., count)| *count > 0)
    }
}

fn write<T: bytemuck::Pod>(gpu: &Gpu, buffer: &wgpu::Buffer, first: u32, items: &[T]) {
    gpu.queue.write_buffer(buffer, u64::from(first) * size_of::<T>() as u64, bytemuck::cast_slice(items));
}

impl Chunk {
    fn new(gpu: &Gpu, [vertex_count, triangle_count]: [u32; 2]) -> Self {
        let size = |count: u32, bytes: usize| u64::from(count) * bytes as u64;
        Self {
            vertices: gpu.room(size(vertex_count, size_of::<Vertex>()), BufferUsages::VERTEX),
            indices: gpu.room(size(triangle_count, size_of::<[u32; 3]>()), BufferUsages::INDEX),
            free_vertices: Free::new(vertex_count),
            free_triangles: Free::new(triangle_count),
        }
    }

    /// Room for vertices and triangles, if there is enough of both.
    fn take(&mut self, [vertex_count, triangle_count]: [u32; 2]) -> Option<[Range<u32>; 2]> {
        let vertices = self.free_vertices.take(vertex_count)?;
        match self.free_triangles.take(triangle_count) {
            Some(triangles) => Some([vertices, triangles]),
            None => {
                self.free_vertices.give(vertices);
                None
            }
        }
    }
}

/// What is free of a buffer.
struct Free {
    /// Ascending, and none begins where another ends.
    gaps: Vec<Range<u32>>,
    size: u32,
}

impl Free {
    fn new(size: u32) -> Self {
        Self { gaps: vec![0..size], size }
    }

    /// The first gap that is large enough.
    fn take(&mut self, count: u32) -> Option<Range<u32>> {
        let at = self.gaps.iter().position(|gap| gap.end - gap.start >= count)?;
        let gap = &mut self.gaps[at];
        let taken = gap.start..gap.start + count;
        gap.start = taken.end;
        if gap.is_empty() {
            self.gaps.remove(at);
        }
        Some(taken)
    }

    fn give(&mut self, mut range: Range<u32>) {
        if range.is_empty() {
            return;
        }
        let mut at = self.gaps.partition_point(|gap| gap.start < range.start);
        if let Some(next) = self.gaps.get(at).filter(|next| next.start == range.end) {
            range.end = next.end;
            self.gaps.remove(at);
        }
        if let Some(before) = at.checked_sub(1).filter(|&before| self.gaps[before].end == range.start) {
            range.start = self.gaps[before].start;
            self.gaps.remove(before);
            at = before;
        }
        self.gaps.insert(at, range);
    }

    /// Nothing is used from here on.
    fn end(&self) -> u32 {
        self.gaps.last().filter(|gap| gap.end == self.size).map_or(self.size, |gap| gap.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_back_joins_its_neighbours_and_is_taken_again() {
        let mut free = Free::new(100);
        let lots: Vec<Range<u32>> = [10, 20, 30, 40].map(|count| free.take(count).unwrap()).into();
        assert_eq!((free.take(1), free.end()), (None, 100));
        free.give(lots[1].clone());
        free.give(lots[3].clone());
        assert_eq!((free.gaps.clone(), free.end()), (vec![10..30, 60..100], 60));
        free.give(lots[2].clone());
        assert_eq!((free.gaps.clone(), free.end()), (vec![10..100], 10));
        assert_eq!(free.take(90), Some(10..100));
        free.give(10..100);
        free.give(lots[0].clone());
        assert_eq!((free.gaps.clone(), free.end()), (vec![0..100], 0));
        assert_eq!((free.take(0), free.take(101)), (Some(0..0), None));
    }
}
