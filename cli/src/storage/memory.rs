//! How much memory there is, and what a build takes.

use crate::region::REGION_TRIANGLES;

/// What is held of a mesh, by its triangles and vertices: positions; corners, neighbours and chart labels.
const VERTEX_BYTES: u64 = 24;
const TRIANGLE_BYTES: u64 = 28;
/// What it takes more to repair a triangle's region, which is the peak; measured are 96 to 122 bytes altogether.
const REPAIR_BYTES: u64 = 82;
/// What a build takes besides: the program, buffers, and pages of mapped files.
const BASE_BYTES: u64 = 24 << 20;

/// Memory for a build of a mesh that is in memory as a whole. All threads repair a region each at the same time.
pub fn mesh_bytes(vertex_count: u64, triangle_count: u64) -> u64 {
    let repaired = triangle_count.min(REGION_TRIANGLES.saturating_mul(rayon::current_num_threads() as u64));
    BASE_BYTES + VERTEX_BYTES * vertex_count + TRIANGLE_BYTES * triangle_count + REPAIR_BYTES * repaired
}

/// Memory for one of the regions that are on disk.
pub fn region_bytes(vertex_count: u64, triangle_count: u64) -> u64 {
    VERTEX_BYTES * vertex_count + (TRIANGLE_BYTES + REPAIR_BYTES) * triangle_count
}

/// The least memory with which regions on disk can be built, the largest of which takes so much.
pub fn least_bytes(largest_region_bytes: u64) -> u64 {
    BASE_BYTES + largest_region_bytes
}

/// What this machine has, or what this process may take of it if that is less. [`u64::MAX`] where the system does not tell.
#[expect(unsafe_code, reason = "the standard library does not tell")]
pub fn machine_bytes() -> u64 {
    // SAFETY: sysconf has no conditions; it returns -1 for what it does not know.
    let (pages, page_bytes) = unsafe { (libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE)) };
    let physical = if pages > 0 && page_bytes > 0 { pages as u64 * page_bytes as u64 } else { u64::MAX };
    // Containers.
    let limit = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|text| text.trim().parse().ok());
    limit.map_or(physical, |limit: u64| limit.min(physical))
}
