//! What comes of moving a vertex of a watched patch.

use glam::DVec3;

use super::Watched;
use super::parts::{Cell, Found, Totals, Triangle, bit};
use crate::reduce::grouped::Bounds;
use lodpack_stage::certify::{Feet, TOGETHER};
use lodpack_stage::nearest::doubled_area;

/// The cosine of the largest angle by which a triangle may turn.
const TURNS: f64 = 0.5;

/// A point that a triangle gets, or with a weight below zero loses, while it does not move itself.
struct Beside {
    t: u32,
    cell: u32,
    colour: [f32; 3],
    weight: f64,
    is_opposite: bool,
}

/// What comes of a move.
pub struct Moved {
    vertex: usize,
    to: DVec3,
    found: Vec<(usize, Found)>,
    /// Of the triangles at the vertex.
    states: Vec<(u32, Triangle)>,
    /// What becomes of all other triangles that change.
    cells: Vec<(u32, u32, Cell)>,
    totals: Totals,
    /// As [`Seen::value`].
    pub value: f64,
}

impl Watched<'_> {
    /// What comes of moving a vertex. None if a triangle turns too far.
    pub fn moved(&self, vertex: usize, to: DVec3) -> Option<Moved> {
        let mut positions = self.positions.clone();
        positions[vertex] = to;
        let moving = &self.around[vertex];
        let mut states: Vec<(u32, Triangle)> = vec![];
        // Which of these states a triangle has.
        let mut state_of = vec![None; self.triangles.len()];
        for &t in moving {
            let corners = self.triangles[t as usize].map(|v| positions[v as usize]);
            let [before, after] = [self.states[t as usize].normal, doubled_area(corners)].map(DVec3::normalize_or_zero);
            if before.dot(after) < TURNS {
                return None;
            }
            state_of[t as usize] = Some(states.len());
            states.push((t, self.state(t, &positions)?));
        }
        let bits = moving.iter().fold(0, |bits, &t| bits | bit(t));
        let bounds = states.iter().fold(Bounds::NOTHING, |all, (_, state)| all.union(state.bounds));
        let is_at_vertex: Vec<bool> = state_of.iter().map(Option::is_some).collect();
        let is_moving = |t: u32| is_at_vertex[t as usize];
        let mut changed: Vec<(usize, Feet)> = vec![];
        for (number, reach) in self.reach.iter().enumerate() {
            let may_lose = reach.bits & bits != 0;
            if !may_lose && reach.bounds.square_distance(bounds) >= reach.most {
                continue;
            }
            let (group, found) = (&self.points.groups[number], &self.found[number]);
            let mut feet = Feet::nowhere();
            for (t, state) in &states {
                if may_lose || group.bounds.square_distance(state.bounds) < reach.most {
                    feet.add(*t, &state.single, &group.places);
                }
            }
            let lost = (0..TOGETHER).filter(|&k| is_moving(found.triangles[k]));
            let farthest = lost.map(|k| feet.squares[k]).fold(0.0, f32::max);
            if farthest > 0.0 {
                for (t, state) in (0..).zip(&self.states) {
                    if !is_moving(t) && group.bounds.square_distance(state.bounds) < farthest {
                        feet.add(t, &state.single, &group.places);
                    }
                }
            }
            changed.push((number, feet));
        }
        let size = self.points.surface.size() as f32;
        let mut totals = self.totals;
        let (mut all_found, mut beside) = (vec![], vec![]);
        for (number, feet) in changed {
            let (group, before) = (&self.points.groups[number], &self.found[number]);
            let changes: [bool; TOGETHER] =
                std::array::from_fn(|k| is_moving(before.triangles[k]) || feet.squares[k] < before.squares[k]);
            if changes == [false; TOGETHER] {
                continue;
            }
            let state = |t: u32| state_of[t as usize].map_or(&self.states[t as usize], |at| &states[at].1);
            let found = Found::new(|k| {
                if !changes[k] {
                    return (before.triangles[k], before.squares[k], before.cells[k], before.is_opposite[k]);
                }
                let (cell, is_opposite) = state(feet.which[k]).seen(size, feet.at.map(|at| at[k]), group.normals[k]);
                (feet.which[k], feet.squares[k], cell, is_opposite)
            });
            for k in (0..TOGETHER).filter(|&k| changes[k]) {
                let (colour, weight) = (group.colours[k], group.weights[k]);
                totals.distances += weight * (f64::from(found.squares[k]) - f64::from(before.squares[k]));
                for (found, weight) in [(before, -weight), (&found, weight)] {
                    let (t, cell, is_opposite) = (found.triangles[k], found.cells[k], found.is_opposite[k]);
                    match state_of[t as usize] {
                        // Triangles that move begin with nothing.
                        Some(at) if weight > 0.0 => states[at].1.cells[cell as usize].add(colour, weight, is_opposite),
                        Some(_) => {}
                        None => beside.push(Beside { t, cell, colour, weight, is_opposite }),
                    }
                }
            }
            all_found.push((number, found));
        }
        for (t, state) in &mut states {
            state.error = state.error();
            totals.add(&self.states[*t as usize], -1.0);
            totals.add(state, 1.0);
        }
        let cells = self.cells_beside(beside);
        totals.error += cells.iter().map(|(t, cell, after)| after.error() - self.cell(*t, *cell).error()).sum::<f64>();
        let value = totals.value(self.points.area);
        Some(Moved { vertex, to, found: all_found, states, cells, totals, value })
    }

    fn cell(&self, t: u32, cell: u32) -> &Cell {
        &self.states[t as usize].cells[cell as usize]
    }

    /// Cells of triangles that do not move, as they become.
    fn cells_beside(&self, mut beside: Vec<Beside>) -> Vec<(u32, u32, Cell)> {
        beside.sort_by_key(|&Beside { t, cell, .. }| (t, cell));
        let of_cell = |points: &[Beside]| {
            let Beside { t, cell, .. } = points[0];
            let mut after = *self.cell(t, cell);
            points.iter().for_each(|point| after.add(point.colour, point.weight, point.is_opposite));
            (t, cell, after)
        };
        beside.chunk_by(|one, other| (one.t, one.cell) == (other.t, other.cell)).map(of_cell).collect()
    }

    /// Moves a vertex.
    pub fn take(&mut self, Moved { vertex, to, found, states, cells, totals, .. }: Moved) {
        self.positions[vertex] = to;
        for (number, found) in found {
            self.reach[number] = found.reach(self.reach[number].bounds);
            self.found[number] = found;
        }
        states.into_iter().for_each(|(t, state)| self.states[t as usize] = state);
        for (t, cell, after) in cells {
            let state = &mut self.states[t as usize];
            let before = std::mem::replace(&mut state.cells[cell as usize], after);
            state.error += state.cells[cell as usize].error() - before.error();
        }
        self.totals = totals;
    }
}
