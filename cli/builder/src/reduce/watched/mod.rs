//! What a patch would show of a surface while its vertices are moved, one at a time.
//!
//! It is what [`Sampled::seen`] says, but of each point of the surface it is known which triangle is closest and how
//! far off that is. So where a vertex moves, only those points are looked at which a triangle around it has, or gets.
//! Points come in groups of those that lie together.

mod moves;
mod parts;

use glam::DVec3;

use super::cells::MOST_CELLS;
use super::grouped::{Bounds, Grouped};
use lodpack_mesh::sides;
use lodpack_stage::certify::{Feet, Single, TOGETHER};
use lodpack_stage::nearest::doubled_area;
use parts::{Cell, Found, Reach, Totals, Triangle};

/// About this many points of a patch tell how far it is from the surface.
const OWN_POINTS: f64 = 4096.0;
/// A patch with this many times the cells of the surface, or more, is not watched. A triangle has those of the
/// rectangle around it, so usual patches have twice as many.
const MUCH_LARGER: f64 = 8.0;

/// A patch whose vertices are moved.
pub struct Watched<'a> {
    points: &'a Grouped<'a>,
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The triangles at each vertex.
    around: Vec<Vec<u32>>,
    /// Of each group.
    found: Vec<Found>,
    reach: Vec<Reach>,
    states: Vec<Triangle>,
    totals: Totals,
    /// The distance between own points.
    spacing: f64,
}

impl<'a> Watched<'a> {
    /// A patch, and what it shows. None if that is nothing, or if there are too many cells.
    pub fn new(points: &'a Grouped<'a>, positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Option<Self> {
        let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize]);
        let doubled: f64 = triangles.iter().map(|t| doubled_area(corners(t)).length()).sum();
        if points.groups.is_empty() || doubled.is_nan() || doubled <= 0.0 {
            return None;
        }
        // Lines have hardly any area, but would have rows of any number of points.
        let spacing = (0.5 * doubled / OWN_POINTS).sqrt().max(points.surface.size());
        let mut around = vec![vec![]; positions.len()];
        for (number, corners) in (0..).zip(&triangles) {
            corners.iter().for_each(|&v| around[v as usize].push(number));
        }
        let totals = Totals::default();
        let (found, reach, states) = (vec![], vec![], vec![]);
        let mut this = Self { points, positions, triangles, around, found, reach, states, totals, spacing };
        this.states =
            (0..this.triangles.len() as u32).map(|t| this.state(t, &this.positions)).collect::<Option<_>>()?;
        if this.states.iter().map(|state| state.cells.len() as u64).sum::<u64>() > this.most_cells() {
            return None;
        }
        let size = points.surface.size() as f32;
        for group in &points.groups {
            let mut feet = Feet::nowhere();
            for (number, state) in (0..).zip(&this.states) {
                feet.add(number, &state.single, &group.places);
            }
            let found = Found::new(|k| {
                let (cell, is_opposite) =
                    this.states[feet.which[k] as usize].seen(size, feet.at.map(|at| at[k]), group.normals[k]);
                (feet.which[k], feet.squares[k], cell, is_opposite)
            });
            for k in 0..TOGETHER {
                let state = &mut this.states[found.triangles[k] as usize];
                state.cells[found.cells[k] as usize].add(group.colours[k], group.weights[k], found.is_opposite[k]);
                this.totals.distances += group.weights[k] * f64::from(found.squares[k]);
            }
            this.reach.push(found.reach(group.bounds));
            this.found.push(found);
        }
        for state in &mut this.states {
            state.error = state.error();
            this.totals.add(state, 1.0);
        }
        Some(this)
    }

    /// The same patch with an edge in two, and of each triangle the number of the one that it is, or is a part of.
    pub fn split(&self, edge: [u32; 2]) -> Option<(Self, Vec<u32>)> {
        let (mut positions, mut triangles) = (self.positions.clone(), self.triangles.clone());
        let middle = positions.len() as u32;
        let [one, other] = edge.map(|v| positions[v as usize]);
        positions.push(one.midpoint(other));
        let mut parts_of: Vec<u32> = (0..triangles.len() as u32).collect();
        for t in self.triangles_at(edge) {
            let corners = self.triangles[t as usize];
            let [part, rest] = edge.map(|from| corners.map(|v| if v == from { middle } else { v }));
            triangles[t as usize] = part;
            triangles.push(rest);
            parts_of.push(t);
        }
        Some((Self::new(self.points, positions, triangles)?, parts_of))
    }

    /// The triangles at an edge.
    pub fn triangles_at(&self, [a, b]: [u32; 2]) -> Vec<u32> {
        self.around[a as usize].iter().copied().filter(|&t| self.triangles[t as usize].contains(&b)).collect()
    }

    /// The edges of the triangles that show most wrongly, each one once.
    pub fn worst_edges(&self, triangles: usize) -> Vec<[u32; 2]> {
        let mut order: Vec<usize> = (0..self.triangles.len()).collect();
        order.sort_by(|&one, &other| self.states[other].error.total_cmp(&self.states[one].error));
        let mut edges: Vec<[u32; 2]> = order.iter().take(triangles).flat_map(|&t| sides(self.triangles[t])).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Where vertices are.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// As [`Seen::value`].
    pub fn value(&self) -> f64 {
        self.totals.value(self.points.area)
    }

    /// The shortest edge at a vertex; infinite if it has none.
    pub fn shortest_edge(&self, vertex: usize) -> f64 {
        let corners = self.around[vertex].iter().flat_map(|&t| self.triangles[t as usize]);
        let others = corners.filter(|&other| other as usize != vertex);
        let lengths = others.map(|other| self.positions[other as usize].distance(self.positions[vertex]));
        lengths.fold(f64::INFINITY, f64::min)
    }

    /// How many cells a patch may have that is much larger than the surface, as where parts that lie far apart have
    /// merged: most show nothing, and each move makes those of some triangles anew.
    fn most_cells(&self) -> u64 {
        let Grouped { surface, area, .. } = self.points;
        // The conversion saturates.
        MOST_CELLS.min((MUCH_LARGER * area / (surface.size() * surface.size())) as u64 + self.triangles.len() as u64)
    }

    /// A triangle of which nothing is seen yet. None if it has too many cells.
    fn state(&self, triangle: u32, positions: &[DVec3]) -> Option<Triangle> {
        let corners = self.triangles[triangle as usize].map(|v| positions[v as usize]);
        let relative = corners.map(|corner| corner - self.points.middle);
        let single = Single::new(relative);
        // The conversions saturate.
        let [columns, rows] =
            single.extent().map(|length| (f64::from(length) / self.points.surface.size()).ceil().max(1.0) as u32);
        let count = u64::from(columns) * u64::from(rows);
        (count <= self.most_cells()).then(|| Triangle {
            single,
            normal: doubled_area(corners),
            bounds: relative.into_iter().fold(Bounds::NOTHING, |bounds, corner| bounds.with(corner.as_vec3())),
            columns,
            cells: vec![Cell::default(); count as usize],
            error: 0.0,
            own: self.points.surface.squares_of(corners, self.spacing),
        })
    }
}

#[cfg(test)]
mod tests;
