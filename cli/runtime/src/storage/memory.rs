//! How much memory a build takes, and who may take some now.

use std::sync::{Condvar, Mutex, PoisonError};

/// The most triangles in a region by default. Files depend on it, so it must never depend on the memory of a machine.
pub const REGION_TRIANGLES: u64 = 1 << 21;

/// The most texels of images in a region, about; the same goes for them.
pub const REGION_TEXELS: u64 = 1 << 26;

/// Bytes of a mesh in memory: positions for each vertex; corners, neighbours and a chart label for each triangle.
const VERTEX_BYTES: u64 = 24;
const TRIANGLE_BYTES: u64 = 28;
/// Further bytes for each triangle of a region while it is repaired, which is the peak: 96 to 122 bytes in all were
/// measured.
const REPAIR_BYTES: u64 = 82;
/// Bytes of the attributes of a triangle in a region: the records of its corners, its material, and which triangle it
/// was before repair.
const CORNER_BYTES: u64 = 22;
/// Bytes for each value of a vertex or corner: it is there as it was read and, in the worst case, once more in the
/// records of regions.
const VALUE_BYTES: u64 = 8;
/// Bytes for everything else: the program, buffers, and pages of mapped files.
const BASE_BYTES: u64 = 24 << 20;

/// Memory for building a mesh entirely in memory, where every thread repairs a region at the same time.
pub fn mesh_bytes(vertex_count: u64, triangle_count: u64) -> u64 {
    let repaired = triangle_count.min(REGION_TRIANGLES.saturating_mul(rayon::current_num_threads() as u64));
    BASE_BYTES + VERTEX_BYTES * vertex_count + TRIANGLE_BYTES * triangle_count + REPAIR_BYTES * repaired
}

/// Memory for working on one region that is on disk.
pub fn region_bytes(vertex_count: u64, triangle_count: u64) -> u64 {
    VERTEX_BYTES * vertex_count + (TRIANGLE_BYTES + REPAIR_BYTES) * triangle_count
}

/// Memory for the attributes of a mesh in memory, beside the mesh. Nothing where it has none.
pub fn attribute_bytes(values: u64, triangle_count: u64) -> u64 {
    let corners = if values > 0 { CORNER_BYTES * triangle_count } else { 0 };
    VALUE_BYTES.saturating_mul(values).saturating_add(corners)
}

/// Bytes of each texel of images until a file that was built in memory is written: what the file will have of it,
/// twice.
const KEPT_BYTES: f64 = 1.5;
/// Bytes of each while maps are baked, at most.
const BAKED_BYTES: u64 = 100;
/// The most memory for decoded images.
const IMAGE_BYTES: u64 = 1 << 30;

/// How much of the memory of a build in memory goes to images, given their texels. Nothing where it has none.
pub fn texel_bytes(texels: u64, memory: u64) -> u64 {
    let [images, maps] = texel_memory(memory);
    (texels as f64 * KEPT_BYTES) as u64 + BAKED_BYTES.saturating_mul(texels).min(images + 2 * maps)
}

/// How much of the memory of a build decoded images may take, and how much the maps that are baked at a time.
pub fn texel_memory(memory: u64) -> [u64; 2] {
    [IMAGE_BYTES.min(memory / 4), memory / 4]
}

/// The most texels of a map of a chart, about.
const MAP_TEXELS: u64 = 1 << 21;

/// The memory with which a build keeps to it that bakes maps of images with some texels, about: a map is baked at once.
pub fn least_for_maps(texels: u64) -> u64 {
    if texels == 0 { 0 } else { BASE_BYTES + BAKED_BYTES.saturating_mul(texels.min(MAP_TEXELS)) }
}

/// The least memory for a build that decodes an image as a whole, given what that takes: half of it is for textures.
pub fn least_for_decoding(bytes: u64) -> u64 {
    bytes.saturating_mul(2)
}

/// The least memory for building regions that are on disk, given what the largest of them takes.
pub fn least_bytes(largest_region_bytes: u64) -> u64 {
    BASE_BYTES + largest_region_bytes
}

/// Memory that threads share: who needs some waits until there is enough, and whoever has it gives it back.
#[derive(Debug)]
pub struct Pool {
    limit: u64,
    held: Mutex<u64>,
    freed: Condvar,
}

impl Pool {
    /// With the given number of bytes.
    pub fn new(limit: u64) -> Self {
        Self { limit, held: Mutex::default(), freed: Condvar::new() }
    }

    /// Waits until the given number of bytes is free, or nobody else holds any: what needs more than there is has to be
    /// done, too. Whoever holds some must not wait for others who may be waiting here.
    pub fn hold(&self, bytes: u64) -> Held<'_> {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        while *held > 0 && held.saturating_add(bytes) > self.limit {
            held = self.freed.wait(held).unwrap_or_else(PoisonError::into_inner);
        }
        *held = held.saturating_add(bytes);
        Held { pool: self, bytes }
    }
}

/// Memory that is held until this is dropped.
#[derive(Debug)]
pub struct Held<'a> {
    pool: &'a Pool,
    bytes: u64,
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        let mut held = self.pool.held.lock().unwrap_or_else(PoisonError::into_inner);
        *held = held.saturating_sub(self.bytes);
        self.pool.freed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn no_more_is_held_than_there_is() {
        let (pool, sum, most) = (Pool::new(100), AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let (pool, sum, most) = (&pool, &sum, &most);
                scope.spawn(move || {
                    for bytes in [20, 35, 50 + thread] {
                        let held = pool.hold(bytes);
                        most.fetch_max(sum.fetch_add(bytes, Ordering::SeqCst) + bytes, Ordering::SeqCst);
                        std::thread::yield_now();
                        sum.fetch_sub(bytes, Ordering::SeqCst);
                        drop(held);
                    }
                });
            }
        });
        assert!((50..=100).contains(&most.into_inner()));
        // What is larger than all there is gets it alone.
        drop(pool.hold(1000));
        drop(pool.hold(100));
    }
}
