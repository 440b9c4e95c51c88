//! How thick the parts of a model are, from which the automatic tolerance learns what must not vanish.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use lodpack_mesh::{Adjacency, Mesh, NONE};

/// A component thinner than this share of the square root of its area bounds no volume worth keeping: its sides lie on
/// each other.
const FLAT: f64 = 1e-4;
/// Bits of a thickness that are kept, beside its exponent: bins are at most a quarter wide.
const BIN_BITS: u32 = 2;

/// Area by the thickness of the closed component that it belongs to.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Thickness {
    /// By the leading bits of the thickness, which ascend with it.
    areas: BTreeMap<u64, f64>,
}

impl Thickness {
    /// Measures all closed components of a mesh. Its thickness is twice its volume over its area: that of a plate, or
    /// the radius of a long pipe.
    pub fn of(mesh: &Mesh, adjacency: &Adjacency, component_count: u64) -> Self {
        let mut this = Self::default();
        let opposite = adjacency.opposite.as_chunks::<3>().0;
        if component_count == 1 {
            let mut all = Component::new(mesh, 0);
            (0..).zip(opposite).for_each(|(t, opposite)| all.add(t, opposite));
            this.add(&all);
            return this;
        }
        let mut reached = vec![false; opposite.len()];
        let mut stack: Vec<u32> = vec![];
        for first in 0..opposite.len() as u32 {
            if std::mem::replace(&mut reached[first as usize], true) {
                continue;
            }
            let mut component = Component::new(mesh, first);
            stack.push(first);
            while let Some(t) = stack.pop() {
                let opposite = &opposite[t as usize];
                component.add(t, opposite);
                let others = opposite.iter().filter(|&&other| other != NONE).map(|other| other / 3);
                stack.extend(others.filter(|&other| !std::mem::replace(&mut reached[other as usize], true)));
            }
            this.add(&component);
        }
        this
    }

    /// Adds a component, if it is closed and has a volume.
    fn add(&mut self, &Component { volume, area, is_closed, .. }: &Component) {
        let thickness = 2.0 * volume.abs() / area;
        if is_closed && thickness > FLAT * area.sqrt() && thickness.is_finite() {
            *self.areas.entry(bin(thickness)).or_default() += area;
        }
    }

    /// Both together.
    pub fn plus(mut self, other: Self) -> Self {
        for (bin, area) in other.areas {
            *self.areas.entry(bin).or_default() += area;
        }
        self
    }

    /// The thickness below which this share of `area` lies, rounded down to the beginning of its bin; infinity if less
    /// than that is closed.
    pub fn quantile(&self, share: f64, area: f64) -> f64 {
        let mut below = 0.0;
        for (&bin, &of_bin) in &self.areas {
            below += of_bin;
            if below > share * area {
                return f64::from_bits(bin << (f64::MANTISSA_DIGITS - 1 - BIN_BITS));
            }
        }
        f64::INFINITY
    }
}

/// The triangles of one component so far.
struct Component<'a> {
    mesh: &'a Mesh,
    /// A point of it. Volumes are those of pyramids over the triangles, and a near apex keeps them exact.
    apex: DVec3,
    volume: f64,
    area: f64,
    is_closed: bool,
}

impl<'a> Component<'a> {
    fn new(mesh: &'a Mesh, first: u32) -> Self {
        let apex = mesh.triangles.get(first as usize).map_or(DVec3::ZERO, |_| mesh.corners(first)[0]);
        Self { mesh, apex, volume: 0.0, area: 0.0, is_closed: true }
    }

    fn add(&mut self, t: u32, opposite: &[u32; 3]) {
        let doubled = self.mesh.doubled_area(t);
        self.area += doubled.length() / 2.0;
        self.volume += doubled.dot(self.mesh.corners(t)[0] - self.apex) / 6.0;
        self.is_closed &= !opposite.contains(&NONE);
    }
}

/// The leading bits of a positive number.
fn bin(x: f64) -> u64 {
    x.to_bits() >> (f64::MANTISSA_DIGITS - 1 - BIN_BITS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_stage::repair::repair;

    /// Boxes of the given heights, one by one, and an open square.
    fn plates(heights: &[f64]) -> Thickness {
        let mut mesh = Mesh::default();
        for (i, &height) in (0..).zip(heights) {
            let first = mesh.positions.len() as u32;
            let corner = |bits: u32| {
                DVec3::new(f64::from(3 * i + (bits & 1)), f64::from(bits >> 1 & 1), f64::from(bits >> 2) * height)
            };
            mesh.positions.extend((0..8).map(corner));
            let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
            let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
            mesh.triangles.extend(triangles.map(|corners: [u32; 3]| corners.map(|v| v + first)));
        }
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([[0., 9., 0.], [1., 9., 0.], [0., 10., 0.]].map(DVec3::from_array));
        mesh.triangles.push([first, first + 1, first + 2]);
        let (mesh, adjacency, report) = repair(mesh);
        Thickness::of(&mesh, &adjacency, report.components)
    }

    #[test]
    fn plates_are_as_thick_as_they_are_and_open_surfaces_do_not_count() {
        let thin = plates(&[0.01; 10]);
        let found = thin.quantile(0.5, 20.0);
        assert!(found > 0.0075 && found <= 0.01, "{found}");
        // One thin plate among thick ones is a small share of the area.
        let mixed = plates(&[0.01, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]);
        assert!(mixed.quantile(0.02, 40.0) < 0.011 && mixed.quantile(0.2, 40.0) > 0.2);
        assert_eq!(plates(&[]).quantile(0.0, 1.0), f64::INFINITY);
        // Two sides that lie on each other, up to rounding.
        assert_eq!(plates(&[1e-9]).quantile(0.0, 1.0), f64::INFINITY);
        assert_eq!(thin.clone().plus(plates(&[])), thin);
    }
}
