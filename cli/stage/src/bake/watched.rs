//! What a patch would show of a surface while its vertices are moved, one at a time.
//!
//! It is what [`Sampled::seen`] says, but of each point of the surface it is known which triangle is closest and how far off that is. So where a
//! vertex moves, only those points are looked at which a triangle around it has, or gets. Points come in groups of those that lie together.

use glam::{DVec3, Vec3};

use super::cells::{MOST_CELLS, Seen};
use super::closest::{SHARE_OF_OPPOSITE, doubled_area};
use super::grouped::{Bounds, Grouped};
use crate::certify::{Feet, Numbers, Single, TOGETHER};
use lodpack_mesh::sides;

/// About this many points of a patch tell how far it is from the surface.
const OWN_POINTS: f64 = 4096.0;
/// A patch with this many times the cells of the surface, or more, is not watched. A triangle has those of the rectangle around it, so usual patches have twice
/// as many.
const MUCH_LARGER: f64 = 8.0;
/// The cosine of the largest angle by which a triangle may turn.
const TURNS: f64 = 0.5;

/// Where each point of a group is seen.
#[derive(Clone)]
struct Found {
    triangles: [u32; TOGETHER],
    /// Squared distances.
    squares: Numbers,
    /// Cells of the triangles.
    cells: [u32; TOGETHER],
    is_opposite: [bool; TOGETHER],
}

/// Decides whether moving a vertex can change where a group is seen. All groups are asked at each move.
#[derive(Clone, Copy)]
struct Reach {
    bounds: Bounds,
    /// The largest squared distance of its points.
    most: f32,
    /// A bit for each of the triangles that its points are seen on, which several may share.
    bits: u64,
}

/// What a cell of a triangle has.
#[derive(Clone, Copy, Default)]
struct Cell {
    /// Weight, colours and squares of colours of all its points.
    all: [f64; 5],
    /// Weight and colours as they count for what is shown.
    shown: [f64; 4],
}

/// A triangle of the patch, and what is seen on it.
#[derive(Clone)]
struct Triangle {
    single: Single,
    normal: DVec3,
    bounds: Bounds,
    /// How many cells there are along the longest side.
    columns: u32,
    cells: Vec<Cell>,
    /// The sum of squares that its cells are off.
    error: f64,
    /// Squared distances of its own points from the surface, by area, and the area.
    own: [f64; 2],
}

/// Sums over all points.
#[derive(Clone, Copy, Default)]
struct Totals {
    error: f64,
    distances: f64,
    own: [f64; 2],
}

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

impl Cell {
    fn add(&mut self, colour: [f32; 3], weight: f64, is_opposite: bool) {
        let [red, green, blue] = colour.map(f64::from);
        let values = [1.0, red, green, blue, red * red + green * green + blue * blue];
        let share = if is_opposite { f64::from(SHARE_OF_OPPOSITE) } else { 1.0 };
        (0..5).for_each(|k| self.all[k] += weight * values[k]);
        (0..4).for_each(|k| self.shown[k] += weight * share * values[k]);
    }

    /// The sum of squares by which its points are off what it shows.
    fn error(&self) -> f64 {
        let [weight, shown @ ..] = self.shown;
        if weight <= 0.0 {
            return 0.0;
        }
        let [mut product, mut square] = [0.0; 2];
        for (shown, all) in shown.into_iter().zip(&self.all[1..4]) {
            let mean = shown / weight;
            (product, square) = (product + mean * all, square + mean * mean);
        }
        (self.all[4] - 2.0 * product + square * self.all[0]) / 3.0
    }
}

impl Found {
    fn new(of_point: impl Fn(usize) -> (u32, f32, u32, bool)) -> Self {
        let known: [_; TOGETHER] = std::array::from_fn(of_point);
        Self {
            triangles: known.map(|(triangle, ..)| triangle),
            squares: known.map(|(_, square, ..)| square),
            cells: known.map(|(_, _, cell, _)| cell),
            is_opposite: known.map(|(.., is_opposite)| is_opposite),
        }
    }

    fn reach(&self, bounds: Bounds) -> Reach {
        let most = self.squares.iter().copied().fold(0.0, f32::max);
        Reach { bounds, most, bits: self.triangles.iter().fold(0, |bits, &triangle| bits | bit(triangle)) }
    }
}

fn bit(triangle: u32) -> u64 {
    1 << (triangle % u64::BITS)
}

impl Triangle {
    /// What is seen at a point of a group, whose foot on this triangle is known.
    fn seen(&self, size: f32, at: [f32; 2], normal: Vec3) -> (u32, bool) {
        // The conversions saturate.
        let [column, row] = at.map(|at| (at / size) as u32);
        let rows = self.cells.len() as u32 / self.columns;
        let cell = row.min(rows - 1) * self.columns + column.min(self.columns - 1);
        (cell, self.normal.dot(normal.as_dvec3()) <= 0.0)
    }

    fn error(&self) -> f64 {
        self.cells.iter().map(Cell::error).sum()
    }
}

impl Totals {
    fn value(&self, area: f64) -> f64 {
        let [squares, of_patch] = self.own;
        let &Self { error: sum, distances, .. } = self;
        Seen { sum, area, distances, of_patch: squares / of_patch, far: vec![] }.value()
    }

    /// Counts what is seen on a triangle, once more or once less.
    fn add(&mut self, triangle: &Triangle, sign: f64) {
        self.error += sign * triangle.error;
        (0..2).for_each(|k| self.own[k] += sign * triangle.own[k]);
    }
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

    /// How many cells a patch may have that is much larger than the surface, as where parts that lie far apart have merged: most show nothing, and each
    /// move makes those of some triangles anew.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::Sampled;

    /// A roof with its ridge at `x`, of two slopes eight wide.
    fn roof(x: f64, height: f64) -> (Vec<DVec3>, [[u32; 3]; 4]) {
        let along = |x: f64, z: f64| [0.0, 8.0].map(|y| DVec3::new(x, y, z));
        ([along(0.0, 0.0), along(x, height), along(8.0, 0.0)].concat(), [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]])
    }

    /// One whose colours change from place to place.
    fn sampled() -> Sampled {
        let (positions, triangles) = roof(3.0, 2.0);
        let colour = |triangle: usize, [a, b, _]: [f64; 3]| {
            let bright = 50.0 * triangle as f64;
            Some([bright + 90.0 * (40.0 * a).sin().abs(), 100.0 * b, 7.0])
        };
        Sampled::new(triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect(), 900.0, 0.0, colour)
    }

    #[test]
    fn what_comes_of_moves_is_what_is_found_afresh() {
        let sampled = sampled();
        let points = Grouped::new(&sampled);
        let (positions, triangles) = roof(4.0, 1.0);
        let mut watched = Watched::new(&points, positions, triangles.to_vec()).expect("it shows something");
        let seen = |watched: &Watched<'_>| {
            let seen = sampled.seen(watched.positions().to_vec(), &triangles);
            seen.mean().expect("something is seen") * seen.distance()
        };
        let first = watched.value();
        for (vertex, offset) in
            [(2, [-0.5, 0.0, 0.5]), (3, [-0.25, -1.0, 0.25]), (0, [0.0, 0.5, 0.0]), (3, [0.0, 0.5, 0.5])]
        {
            let moved =
                watched.moved(vertex, watched.positions()[vertex] + DVec3::from(offset)).expect("no triangle turns");
            let value = moved.value;
            watched.take(moved);
            let afresh =
                Watched::new(&points, watched.positions().to_vec(), triangles.to_vec()).expect("as before").value();
            assert!((value / afresh - 1.0).abs() < 1e-3 && value == watched.value(), "{value} {afresh}");
            // Points on an edge belong to one of two triangles; and here cells are others, and its own points more.
            assert!((value / seen(&watched) - 1.0).abs() < 0.1, "{value} {}", seen(&watched));
        }
        assert!(watched.value() < first);
    }

    #[test]
    fn triangles_do_not_turn_over() {
        let sampled = sampled();
        let points = Grouped::new(&sampled);
        let (positions, triangles) = roof(4.0, 1.0);
        let watched = Watched::new(&points, positions, triangles.to_vec()).expect("it shows something");
        assert!(watched.moved(2, DVec3::new(20.0, 0.0, 1.0)).is_none());
        assert!(watched.moved(2, DVec3::new(4.0, 0.0, 1.5)).is_some());
        assert_eq!(watched.shortest_edge(0), 17_f64.sqrt());
    }

    #[test]
    fn what_shows_nothing_is_not_watched() {
        let (positions, triangles) = roof(4.0, 1.0);
        let corners = triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
        let (nothing, sampled) = (Sampled::new(corners, 900.0, 0.0, |_, _| None), sampled());
        let is_watched = |of: &Sampled, positions: Vec<DVec3>| {
            Watched::new(&Grouped::new(of), positions, triangles.to_vec()).is_some()
        };
        assert!(is_watched(&sampled, positions.clone()));
        assert!(!is_watched(&nothing, positions.clone()));
        assert!(!is_watched(&sampled, vec![DVec3::ONE; positions.len()]));
        // Larger than what it shows, by little and by far.
        for (size, wanted) in [(1.4, true), (4.0, false), (1e6, false)] {
            assert_eq!(is_watched(&sampled, positions.iter().map(|point| point * size).collect()), wanted, "{size}");
        }
    }

    #[test]
    fn edges_are_split_where_most_is_wrong() {
        let sampled = sampled();
        let points = Grouped::new(&sampled);
        let (positions, triangles) = roof(4.0, 1.0);
        let watched = Watched::new(&points, positions, triangles.to_vec()).expect("it shows something");
        assert_eq!(watched.worst_edges(4).len(), 9);
        let worst = watched.worst_edges(1);
        assert!(worst.len() == 3 && worst.iter().all(|&edge| (1..=2).contains(&watched.triangles_at(edge).len())));
        let (split, parts_of) = watched.split([2, 3]).expect("the ridge");
        assert_eq!((split.positions()[6], &parts_of[..]), (DVec3::new(4.0, 4.0, 1.0), &[0, 1, 2, 3, 1, 2][..]));
        let area = |watched: &Watched<'_>| {
            let corners = |t: &[u32; 3]| t.map(|v| watched.positions()[v as usize]);
            watched.triangles().iter().map(|t| doubled_area(corners(t)).z).sum::<f64>()
        };
        assert!((area(&split) - area(&watched)).abs() < 1e-9 && area(&watched) > 100.0);
        // It is the same surface, and only cells are others.
        assert!((split.value() / watched.value() - 1.0).abs() < 0.2, "{} {}", split.value(), watched.value());
    }
}
