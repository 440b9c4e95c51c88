//! Whether a stitched mesh is closed, and where it is not.

/// What the edges of a mesh say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EdgeReport {
    /// Directed edges without a partner in the other direction, as vertex pairs, ascending.
    pub boundary: Vec<[u32; 2]>,
    /// Undirected edges with more than two triangles. Thin or touching surfaces may have some.
    pub crowded: u64,
    /// Triangles whose three vertices another triangle has too, in the same winding.
    pub repeated: u64,
    /// Triangles with a vertex twice.
    pub degenerate: u64,
}

/// Counts edges and triangles by sorting; vertices are compared by index.
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
        // The same cyclic order starts at the smallest vertex.
        let smallest = a.min(b).min(c);
        faces.push(if smallest == a {
            [a, b, c]
        } else if smallest == b {
            [b, c, a]
        } else {
            [c, a, b]
        });
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tetrahedron_is_closed_until_a_face_is_missing() {
        let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        assert_eq!(inspect_edges(&faces), EdgeReport::default());
        assert_eq!(inspect_edges(&faces[1..]).boundary.len(), 3);
        assert_eq!(inspect_edges(&[[0, 1, 2], [1, 2, 0]]).repeated, 1);
        assert_eq!(inspect_edges(&[[0, 1, 1]]).degenerate, 1);
    }
}
