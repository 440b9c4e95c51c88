//! What collapses are measured by: for each vertex the planes of its triangles, and planes through lines that are to
//! stay where they are.

use super::collapse::Collapser;
use super::quadric::Quadric;
use lodpack_mesh::{NONE, previous_half_edge};

/// Weight of the squared distance from the line of a border edge, compared with that from a triangle of the same size.
const OUTLINE: f64 = 1.0;
/// The same of an edge at which colours jump: lines lie three times as near as the surface. Texels are smaller than
/// what the surface may be off.
const LINE: f64 = 10.0;

impl Collapser<'_> {
    /// Measures from the surface as it is now: its planes take the place of all those that have been merged.
    ///
    /// Planes of the input go on beyond their triangles, and on a curved or noisy surface far triangles' planes cross
    /// the surface: the more are merged, the more they say of nothing. Forgetting them is Lindstrom and Turk's
    /// "memoryless simplification" ("Evaluation of Memoryless Simplification", 1999), done now and then in place of at
    /// every collapse.
    ///
    /// Lines are not forgotten: they are thin, so nothing else would bring them back.
    pub fn renew_planes(&mut self) {
        self.quadrics.clone_from(&self.lines);
        self.quadrics.resize(self.positions.len(), Quadric::default());
        for corners in self.mesh.triangles() {
            let [a, b, c] = corners.map(|v| self.positions[v as usize]);
            let area_vector = 0.5 * (b - a).cross(c - a);
            let area = area_vector.length();
            if area > 0.0 {
                let plane = Quadric::plane(area_vector / area, (a + b + c) / 3.0, area / 3.0);
                for &v in &corners {
                    let factor = self.importance[v as usize];
                    self.quadrics[v as usize] += if factor > 1.0 { plane.amplified(f64::from(factor)) } else { plane };
                }
            }
        }
    }

    /// Finds the lines that are to stay where they are. None are there in most charts.
    pub fn find_lines(&mut self) {
        self.add_outline();
        self.add_lines();
    }

    /// Where border vertices may go or stay, the plane through each border edge across its triangle: it keeps the
    /// outline (Garland and Heckbert 1997, section 6). It counts in the order of collapses, not in the mean of
    /// distances.
    fn add_outline(&mut self) {
        for v in 0..self.positions.len() as u32 {
            // The first half-edge of a border vertex lies on the border; a vertex that is gone has none.
            let first = self.mesh.is_border(v).then(|| self.mesh.fan(v).next()).flatten();
            let Some(half_edge) = first else { continue };
            if self.is_free(v) || self.is_free(self.mesh.target(half_edge)) {
                self.add_across(half_edge, OUTLINE);
            }
        }
    }

    /// Planes through the edges at which colours jump, across the triangles on both sides: vertices slide along these
    /// lines. As
    /// [`add_outline`](Self::add_outline).
    fn add_lines(&mut self) {
        let Some(areas) = self.areas else { return };
        let half_edges = |slot: usize| (0..3).map(move |side| (3 * slot + side) as u32);
        for half_edge in self.mesh.remaining().flat_map(half_edges).collect::<Vec<_>>() {
            let twin = self.mesh.twin(half_edge);
            if twin != NONE && areas.jump(half_edge as usize / 3, twin as usize / 3) {
                // One of two.
                self.add_across(half_edge, 0.5 * LINE);
            }
        }
    }

    /// Adds the plane through an edge across its triangle to both ends.
    fn add_across(&mut self, half_edge: u32, weight: f64) {
        let apex = self.mesh.origin(previous_half_edge(half_edge));
        let ends = [self.mesh.origin(half_edge), self.mesh.target(half_edge)];
        let [a, b, c] = [ends[0], ends[1], apex].map(|v| self.positions[v as usize]);
        let across = (b - a).cross((b - a).cross(c - a)).normalize_or_zero();
        let line = Quadric { weight: 0.0, ..Quadric::plane(across, a, weight * a.distance_squared(b)) };
        self.lines.resize(self.positions.len(), Quadric::default());
        for v in ends {
            self.lines[v as usize] += line;
        }
    }
}
