//! Whether a stitched mesh is closed, and where it is not.

/// The edges of a mesh, inspected.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EdgeReport {
    /// Directed edges without a partner in the opposite direction, as vertex pairs, ascending.
    pub boundary: Vec<[u32; 2]>,
    /// Undirected edges with more than two triangles. Thin or touching surfaces may have some.
    pub crowded: u64,
    /// Triangles with the same three vertices, in the same winding, as another triangle.
    pub repeated: u64,
    /// Triangles that repeat a vertex.
    pub degenerate: u64,
}

/// Counts edges and triangles by sorting. Vertices are compared by index.
pub fn inspect_edges(triangles: &[[u32; 3]]) -> EdgeReport {
    let mut report = EdgeReport::default();
    let mut edges: Vec<(u32, u32, bool)> = Vec::with_capacity(triangles.len() * 3);
    let mut faces: Vec<[u32; 3]> = Vec::with_capacity(triangles.len());
    for &[a, b, c] in triangles {
        if a == b || b == c || c == a {
            report.degenerate += 1;
        }
        for (u, v) in [(a, b), (b, c), (c, a)] {
            edges.push((u.min(v), u.max(v), u > v));
        }
        faces.push(from_smallest([a, b, c]));
    }
    edges.sort_unstable();
    for run in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        let backward = run.iter().filter(|e| e.2).count();
        let forward = run.len() - backward;
        let (u, v, _) = run[0];
        for _ in backward..forward {
            report.boundary.push([u, v]);
        }
        for _ in forward..backward {
            report.boundary.push([v, u]);
        }
        if run.len() > 2 {
            report.crowded += 1;
        }
    }
    faces.sort_unstable();
    report.repeated = faces.windows(2).filter(|w| w[0] == w[1]).count() as u64;
    report
}

/// The same cyclic order, starting with the smallest vertex.
fn from_smallest([a, b, c]: [u32; 3]) -> [u32; 3] {
    let smallest = a.min(b).min(c);
    if smallest == a {
        [a, b, c]
    } else if smallest == b {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// Triangles that one node draws twice in the same winding. Two nodes that meet at three vertices may draw the same
/// triangle, where the surface touches itself.
pub(super) fn repeated_in_one_node(triangles: &[[u32; 3]], nodes: &[u32]) -> u64 {
    let mut faces: Vec<(u32, [u32; 3])> =
        nodes.iter().copied().zip(triangles.iter().copied().map(from_smallest)).collect();
    faces.sort_unstable();
    faces.windows(2).filter(|w| w[0] == w[1]).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tetrahedron_is_closed_until_a_face_is_missing() {
        let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        assert_eq!(inspect_edges(&faces), EdgeReport::default());
        assert_eq!(inspect_edges(&faces[1..]).boundary.len(), 3);
        assert_eq!(inspect_edges(&[[0, 1, 2], [1, 2, 0]]).repeated, 1);
        assert_eq!(repeated_in_one_node(&[[0, 1, 2], [1, 2, 0]], &[3, 3]), 1);
        assert_eq!(repeated_in_one_node(&[[0, 1, 2], [1, 2, 0]], &[3, 4]), 0);
        assert_eq!(inspect_edges(&[[0, 1, 1]]).degenerate, 1);
    }
}
