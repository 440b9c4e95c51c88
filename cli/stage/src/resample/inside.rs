//! Which points of a lattice lie inside a closed surface: by how often it winds around them.
//!
//! Along each line of lattice points the triangles that it meets are counted, by the side from which it meets them. A
//! line that runs through an edge or a vertex meets exactly one of the triangles there, whatever rounding does: an edge
//! decides on which side a line lies by its own two vertices, in one order for both of its triangles.

use glam::DVec3;

use lodpack_mesh::Mesh;

/// Lattice points beyond the box of the surface, on every side.
const PADDING: usize = 1;
/// How far the lattice lies off a regular place in the box, as shares of a cell: models like to have planes at halves.
const OFFSET: DVec3 = DVec3::new(0.437_016, 0.561_803, 0.492_347);

/// A lattice with one bit per point.
pub(super) struct Inside {
    counts: [usize; 3],
    origin: DVec3,
    cell: f64,
    bits: Vec<bool>,
    inside_out: bool,
}

impl Inside {
    /// None if the surface has no extent or nothing lies inside.
    pub fn new(mesh: &Mesh, cells: usize) -> Option<Self> {
        let [low, high] = mesh.bounds();
        let extent = high - low;
        let cell = extent.max_element() / cells as f64;
        if !(cell > 0.0 && cell.is_finite()) {
            return None;
        }
        let counts = extent.to_array().map(|length| (length / cell).ceil() as usize + 1 + 2 * PADDING);
        let origin = low - (PADDING as f64 - 1.0 + OFFSET) * cell;
        let mut lattice = Self { counts, origin, cell, bits: vec![], inside_out: false };
        let steps = lattice.count_steps(mesh);
        let mut sum = 0_i64;
        lattice.bits = vec![false; steps.len()];
        for (line, bits) in steps.chunks(counts[2]).zip(lattice.bits.chunks_mut(counts[2])) {
            let mut winding = 0_i32;
            for (step, bit) in line.iter().zip(bits) {
                winding += i32::from(*step);
                sum += i64::from(winding);
                *bit = winding != 0;
            }
        }
        lattice.inside_out = sum < 0;
        lattice.bits.contains(&true).then_some(lattice)
    }

    /// By how much the winding changes at each point, coming from the point before on its line.
    fn count_steps(&self, mesh: &Mesh) -> Vec<i16> {
        let [x_count, y_count, z_count] = self.counts;
        let mut steps = vec![0_i16; x_count * y_count * z_count];
        let places: Vec<DVec3> = mesh.positions.iter().map(|&p| (p - self.origin) / self.cell).collect();
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|v| places[v as usize]);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let first = |x: f64| x.ceil().max(0.0) as usize;
            let after = |x: f64, count: usize| (x.floor().max(-1.0) as i64 + 1).min(count as i64) as usize;
            for i in first(low.x)..after(high.x, x_count) {
                for j in first(low.y)..after(high.y, y_count) {
                    let (x, y) = (i as f64, j as f64);
                    let turns = turns_around(*corners, &places, x, y);
                    if turns == 0 {
                        continue;
                    }
                    let height = height_at([a, b, c], x, y).clamp(low.z, high.z);
                    let k = first(height).min(z_count - 1);
                    // Upward through the back of a triangle is into the solid.
                    let step = &mut steps[(i * y_count + j) * z_count + k];
                    *step = step.saturating_sub(turns);
                }
            }
        }
        steps
    }

    /// How many points there are along each axis.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// Length of a cell's edge, input units.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Whether the triangles of the surface face inwards.
    pub fn is_inside_out(&self) -> bool {
        self.inside_out
    }

    /// Number of a point.
    pub fn node(&self, [i, j, k]: [usize; 3]) -> u32 {
        ((i * self.counts[1] + j) * self.counts[2] + k) as u32
    }

    /// Whether a point lies inside.
    pub fn contains(&self, node: u32) -> bool {
        self.bits[node as usize]
    }

    /// Where a point lies, input units.
    pub fn position(&self, node: u32) -> DVec3 {
        let node = node as usize;
        let (line, k) = (node / self.counts[2], node % self.counts[2]);
        let (i, j) = (line / self.counts[1], line % self.counts[1]);
        self.origin + DVec3::new(i as f64, j as f64, k as f64) * self.cell
    }
}

/// How often a triangle, seen along z, turns around a point: 1 counter-clockwise, -1 clockwise, 0 where it does not
/// contain it. The point counts as moved by an infinitely small step up the y axis, so that it lies level with no
/// vertex.
fn turns_around(corners: [u32; 3], places: &[DVec3], x: f64, y: f64) -> i16 {
    let mut turns = 0;
    for k in 0..3 {
        let (from, to) = (corners[k], corners[(k + 1) % 3]);
        let (low, high, sign) = match (places[from as usize].y > y, places[to as usize].y > y) {
            (false, true) => (from, to, 1),
            (true, false) => (to, from, -1),
            _ => continue,
        };
        // Whether the edge passes to the right of the point, of which both of its triangles have the same idea.
        let (p, q) = (places[low as usize], places[high as usize]);
        let at = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
        if at > x {
            turns += sign;
        }
    }
    turns
}

/// Height of a triangle's plane above a point of the x-y plane; anything between its corners where it stands upright.
fn height_at([a, b, c]: [DVec3; 3], x: f64, y: f64) -> f64 {
    let normal = (b - a).cross(c - a);
    let height = a.z - (normal.x * (x - a.x) + normal.y * (y - a.y)) / normal.z;
    if height.is_finite() { height } else { (a.z + b.z + c.z) / 3.0 }
}
