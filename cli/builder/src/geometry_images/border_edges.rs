//! Inserting vertices into the border edges of a mesh.

use std::collections::HashMap;

/// Finds the triangle beside a border edge, also after triangles were split. Triangles have points, several of which
/// may be one vertex.
pub(super) struct BorderEdges<F> {
    /// The triangle of each directed edge between vertices. It is never iterated, because its order is random.
    triangle_of: HashMap<(u32, u32), u32>,
    /// The vertex of a point.
    vertex_of: F,
}

impl<F: Fn(u32) -> u32> BorderEdges<F> {
    /// Takes all edges with both ends on the border.
    pub fn new(triangles: &[[u32; 3]], is_border: &[bool], vertex_of: F) -> Self {
        let mut triangle_of = HashMap::new();
        for (index, triangle) in triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(&vertex_of);
            for (u, v) in [(a, b), (b, c), (c, a)] {
                if is_border[u as usize] && is_border[v as usize] {
                    triangle_of.insert((u, v), index as u32);
                }
            }
        }
        Self { triangle_of, vertex_of }
    }

    /// Inserts points into the border edge between two points, in whichever direction its triangle runs along it. The
    /// triangle becomes a fan, whose other triangles are added at the end. Returns which triangle that was, if there is
    /// such an edge.
    pub fn insert(&mut self, triangles: &mut Vec<[u32; 3]>, from: u32, to: u32, between: &[u32]) -> Option<u32> {
        let [from, to] = [from, to].map(&self.vertex_of);
        if self.triangle_of.contains_key(&(from, to)) {
            self.fan(triangles, from, to, between.iter().copied())
        } else {
            self.fan(triangles, to, from, between.iter().rev().copied())
        }
    }

    /// As [`Self::insert`], between two vertices.
    fn fan(
        &mut self,
        triangles: &mut Vec<[u32; 3]>,
        from: u32,
        to: u32,
        between: impl Iterator<Item = u32>,
    ) -> Option<u32> {
        let split = self.triangle_of.remove(&(from, to))?;
        let mut current = split;
        let [a, b, c] = triangles[current as usize];
        let [mut start, to, apex] = if (self.vertex_of)(a) == from {
            [a, b, c]
        } else if (self.vertex_of)(b) == from {
            [b, c, a]
        } else {
            [c, a, b]
        };
        for vertex in between {
            triangles[current as usize] = [start, vertex, apex];
            current = triangles.len() as u32;
            triangles.push([vertex, to, apex]);
            start = vertex;
        }
        // The last triangle of the fan now has the edge after the split one.
        if let Some(triangle) = self.triangle_of.get_mut(&((self.vertex_of)(to), (self.vertex_of)(apex))) {
            *triangle = current;
        }
        Some(split)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_edges_of_one_triangle_take_vertices() {
        let mut triangles = vec![[0, 1, 2]];
        let mut edges = BorderEdges::new(&triangles, &[true; 7], |v| v);
        assert_eq!(edges.insert(&mut triangles, 0, 1, &[3]), Some(0));
        assert!(edges.insert(&mut triangles, 2, 1, &[4, 5]).is_some());
        assert!(edges.insert(&mut triangles, 2, 0, &[6]).is_some());
        assert_eq!(edges.insert(&mut triangles, 2, 0, &[6]), None);
        // The border is 0 3 1 5 4 2 6, and every inner edge has two triangles.
        let directed: Vec<(u32, u32)> = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        let mut open: Vec<(u32, u32)> =
            directed.iter().copied().filter(|&(a, b)| !directed.contains(&(b, a))).collect();
        open.sort_unstable();
        assert_eq!(open, [(0, 3), (1, 5), (2, 6), (3, 1), (4, 2), (5, 4), (6, 0)]);
    }
}
