//! Union-find over numbers: each names one with the same set, the smallest number of a set itself.

/// The smallest number of a set. Halves the path to it.
#[inline]
pub fn find(parent: &mut [u32], mut number: u32) -> u32 {
    while parent[number as usize] != number {
        parent[number as usize] = parent[parent[number as usize] as usize];
        number = parent[number as usize];
    }
    number
}

/// Makes one set of two.
#[inline]
pub fn unite(parent: &mut [u32], a: u32, b: u32) {
    // Neighbours of neighbours mostly are in one set already, and have one parent.
    if parent[a as usize] == parent[b as usize] {
        return;
    }
    let (a, b) = (find(parent, a), find(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

/// For each vertex the smallest one that edges of triangles connect it with.
pub fn components(vertex_count: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..vertex_count as u32).collect();
    for &[a, b, c] in triangles {
        unite(&mut parent, a, b);
        unite(&mut parent, a, c);
    }
    // Parents are smaller than their children.
    for v in 0..parent.len() {
        parent[v] = parent[parent[v] as usize];
    }
    parent
}

/// The number of components of a mesh. Where every vertex has one fan, they are connected through edges. A vertex that
/// no triangle uses counts as one.
pub fn count_components(vertex_count: usize, triangles: &[[u32; 3]]) -> usize {
    let components = components(vertex_count, triangles);
    (0..).zip(components).filter(|&(vertex, component): &(u32, u32)| vertex == component).count()
}
