//! How much memory the machine has, and how much a build takes.

/// The most triangles in a region by default. Files depend on it, so it must never depend on the memory of a machine.
pub const REGION_TRIANGLES: u64 = 1 << 21;

/// Bytes of a mesh in memory: positions for each vertex; corners, neighbours and a chart label for each triangle.
const VERTEX_BYTES: u64 = 24;
const TRIANGLE_BYTES: u64 = 28;
/// Further bytes for each triangle of a region while it is repaired, which is the peak: 96 to 122 bytes in all were measured.
const REPAIR_BYTES: u64 = 82;
/// Bytes of the attributes of a triangle in a region: the records of its corners, its material, and which triangle it was before repair.
const CORNER_BYTES: u64 = 22;
/// Bytes for each value of a vertex or corner: it is there as it was read and, in the worst case, once more in the records of regions.
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

/// The least memory for building regions that are on disk, given what the largest of them takes.
pub fn least_bytes(largest_region_bytes: u64) -> u64 {
    BASE_BYTES + largest_region_bytes
}

/// The memory of this machine, or the limit of this process if that is less; [`u64::MAX`] where the system reports neither.
#[expect(unsafe_code, reason = "the standard library does not report memory")]
pub fn machine_bytes() -> u64 {
    // SAFETY: sysconf has no conditions; it returns -1 for what it does not know.
    let (pages, page_bytes) = unsafe { (libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE)) };
    let physical = if pages > 0 && page_bytes > 0 { pages as u64 * page_bytes as u64 } else { u64::MAX };
    // The limit of a container.
    let limit = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|text| text.trim().parse().ok());
    limit.map_or(physical, |limit: u64| limit.min(physical))
}
