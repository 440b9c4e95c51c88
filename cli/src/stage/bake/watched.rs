//! What a patch would show of a surface while its vertices are moved, one at a time.
//!
//! It is what [`Sampled::seen`] says, but of each point of the surface it is known which triangle is closest and how far off that is. So where a
//! vertex moves, only those points are looked at which a triangle around it has, or gets. Points come in groups of those that lie together.

use glam::{DVec3, Vec3};

use super::cells::{MOST_CELLS, Sampled, Seen};
use super::closest::{SHARE_OF_OPPOSITE, doubled_area};
use crate::stage::certify::{Feet, Numbers, Single, TOGETHER};

/// About so many points of a patch tell how far it is from the surface.
const OWN_POINTS: f64 = 4096.0;
/// A triangle may turn until the cosine of the angle is this.
const TURNS: f64 = 0.5;

/// Points of the surface that lie near one another.
struct Group {
    places: [Numbers; 3],
    bounds: Bounds,
    colours: [[f32; 3]; TOGETHER],
    /// Normals of their triangles.
    normals: [Vec3; TOGETHER],
    /// Areas that they stand for.
    weights: [f64; TOGETHER],
}

/// The least and the greatest coordinates.
#[derive(Clone, Copy)]
struct Bounds([Vec3; 2]);

/// Where each point of a group is seen.
#[derive(Clone)]
struct Found {
    triangles: [u32; TOGETHER],
    /// Squared distances.
    squares: Numbers,
    /// Cells of the triangles.
    cells: [u32; TOGETHER],
    is_opposite: [bool; TOGETHER],
    /// The largest square.
    most: f32,
    /// A bit for each of the triangles, which several may share.
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
    surface: &'a Sampled,
    positions: Vec<DVec3>,
    triangles: &'a [[u32; 3]],
    /// The triangles at each vertex.
    around: Vec<Vec<u32>>,
    groups: Vec<Group>,
    found: Vec<Found>,
    states: Vec<Triangle>,
    totals: Totals,
    /// The area of the surface.
    area: f64,
    /// The distance between own points.
    spacing: f64,
    middle: DVec3,
}

/// What comes of a move.
pub struct Moved {
    vertex: usize,
    to: DVec3,
    found: Vec<(usize, Found)>,
    states: Vec<(u32, Triangle)>,
    totals: Totals,
    /// As [`Seen::value`].
    pub value: f64,
}

impl Bounds {
    const NOTHING: Self = Self([Vec3::INFINITY, Vec3::NEG_INFINITY]);

    fn with(self, point: Vec3) -> Self {
        let Self([low, high]) = self;
        Self([low.min(point), high.max(point)])
    }

    fn union(self, other: Self) -> Self {
        self.with(other.0[0]).with(other.0[1])
    }

    fn square_distance(self, other: Self) -> f32 {
        let (Self([low, high]), Self([least, greatest])) = (self, other);
        (least - high).max(low - greatest).max(Vec3::ZERO).length_squared()
    }
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
        let mut this = Self {
            triangles: known.map(|(triangle, ..)| triangle),
            squares: known.map(|(_, square, ..)| square),
            cells: known.map(|(_, _, cell, _)| cell),
            is_opposite: known.map(|(.., is_opposite)| is_opposite),
            most: 0.0,
            bits: 0,
        };
        this.most = this.squares.iter().copied().fold(0.0, f32::max);
        this.bits = this.triangles.iter().fold(0, |bits, &triangle| bits | bit(triangle));
        this
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
    pub fn new(surface: &'a Sampled, positions: Vec<DVec3>, triangles: &'a [[u32; 3]]) -> Option<Self> {
        let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize]);
        let doubled: f64 = triangles.iter().map(|t| doubled_area(corners(t)).length()).sum();
        if surface.is_empty() || doubled.is_nan() || doubled <= 0.0 {
            return None;
        }
        // Lines have hardly any area, but would have rows of any number of points.
        let spacing = (0.5 * doubled / OWN_POINTS).sqrt().max(surface.size());
        let mut around = vec![vec![]; positions.len()];
        for (number, corners) in (0..).zip(triangles) {
            corners.iter().for_each(|&v| around[v as usize].push(number));
        }
        let (groups, area, middle) = groups(surface);
        let mut this = Self {
            surface,
            positions,
            triangles,
            around,
            groups,
            found: vec![],
            states: vec![],
            totals: Totals::default(),
            area,
            spacing,
            middle,
        };
        this.states = (0..triangles.len() as u32).map(|t| this.state(t, &this.positions)).collect::<Option<_>>()?;
        if this.states.iter().map(|state| state.cells.len() as u64).sum::<u64>() > MOST_CELLS {
            return None;
        }
        let size = surface.size() as f32;
        for group in &this.groups {
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
            this.found.push(found);
        }
        for state in &mut this.states {
            state.error = state.error();
            this.totals.add(state, 1.0);
        }
        Some(this)
    }

    /// Where vertices are.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// As [`Seen::value`].
    pub fn value(&self) -> f64 {
        self.totals.value(self.area)
    }

    /// The shortest edge at a vertex; infinite if it has none.
    pub fn shortest_edge(&self, vertex: usize) -> f64 {
        let corners = self.around[vertex].iter().flat_map(|&t| self.triangles[t as usize]);
        let others = corners.filter(|&other| other as usize != vertex);
        let lengths = others.map(|other| self.positions[other as usize].distance(self.positions[vertex]));
        lengths.fold(f64::INFINITY, f64::min)
    }

    /// A triangle of which nothing is seen yet. None if it has too many cells.
    fn state(&self, triangle: u32, positions: &[DVec3]) -> Option<Triangle> {
        let corners = self.triangles[triangle as usize].map(|v| positions[v as usize]);
        let relative = corners.map(|corner| corner - self.middle);
        let single = Single::new(relative);
        // The conversions saturate.
        let [columns, rows] =
            single.extent().map(|length| (f64::from(length) / self.surface.size()).ceil().max(1.0) as u32);
        let count = u64::from(columns) * u64::from(rows);
        (count <= MOST_CELLS).then(|| Triangle {
            single,
            normal: doubled_area(corners),
            bounds: relative.into_iter().fold(Bounds::NOTHING, |bounds, corner| bounds.with(corner.as_vec3())),
            columns,
            cells: vec![Cell::default(); count as usize],
            error: 0.0,
            own: self.surface.squares_of(corners, self.spacing),
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
        for (number, (group, found)) in self.groups.iter().zip(&self.found).enumerate() {
            let may_lose = found.bits & bits != 0;
            if !may_lose && group.bounds.square_distance(bounds) >= found.most {
                continue;
            }
            let mut feet = Feet::nowhere();
            for (t, state) in &states {
                if may_lose || group.bounds.square_distance(state.bounds) < found.most {
                    feet.add(*t, &state.single, &group.places);
                }
            }
            let lost = (0..TOGETHER).filter(|&k| is_moving(found.triangles[k]));
            let reach = lost.map(|k| feet.squares[k]).fold(0.0, f32::max);
            if reach > 0.0 {
                for (t, state) in (0..).zip(&self.states) {
                    if !is_moving(t) && group.bounds.square_distance(state.bounds) < reach {
                        feet.add(t, &state.single, &group.places);
                    }
                }
            }
            changed.push((number, feet));
        }
        let size = self.surface.size() as f32;
        let mut totals = self.totals;
        let mut all_found = vec![];
        for (number, feet) in changed {
            let (group, before) = (&self.groups[number], &self.found[number]);
            let changes: [bool; TOGETHER] =
                std::array::from_fn(|k| is_moving(before.triangles[k]) || feet.squares[k] < before.squares[k]);
            if changes == [false; TOGETHER] {
                continue;
            }
            for k in (0..TOGETHER).filter(|&k| changes[k]) {
                for t in [before.triangles[k], feet.which[k]] {
                    if state_of[t as usize].is_none() {
                        state_of[t as usize] = Some(states.len());
                        states.push((t, self.states[t as usize].clone()));
                    }
                }
            }
            let state_at = |t: u32| state_of[t as usize].unwrap_or(0);
            let found = Found::new(|k| {
                if !changes[k] {
                    return (before.triangles[k], before.squares[k], before.cells[k], before.is_opposite[k]);
                }
                let state = &states[state_at(feet.which[k])].1;
                let (cell, is_opposite) = state.seen(size, feet.at.map(|at| at[k]), group.normals[k]);
                (feet.which[k], feet.squares[k], cell, is_opposite)
            });
            for k in (0..TOGETHER).filter(|&k| changes[k]) {
                let (colour, weight) = (group.colours[k], group.weights[k]);
                totals.distances += weight * (f64::from(found.squares[k]) - f64::from(before.squares[k]));
                // Triangles that move begin with nothing.
                if state_at(before.triangles[k]) >= moving.len() {
                    let state = &mut states[state_at(before.triangles[k])].1;
                    state.cells[before.cells[k] as usize].add(colour, -weight, before.is_opposite[k]);
                }
                let state = &mut states[state_at(found.triangles[k])].1;
                state.cells[found.cells[k] as usize].add(colour, weight, found.is_opposite[k]);
            }
            all_found.push((number, found));
        }
        for (t, state) in &mut states {
            state.error = state.error();
            totals.add(&self.states[*t as usize], -1.0);
            totals.add(state, 1.0);
        }
        let value = totals.value(self.area);
        Some(Moved { vertex, to, found: all_found, states, totals, value })
    }

    /// Moves a vertex.
    pub fn take(&mut self, Moved { vertex, to, found, states, totals, .. }: Moved) {
        self.positions[vertex] = to;
        found.into_iter().for_each(|(number, found)| self.found[number] = found);
        states.into_iter().for_each(|(t, state)| self.states[t as usize] = state);
        self.totals = totals;
    }
}

/// The points of a surface in groups, their area, and the middle to which places are relative.
fn groups(surface: &Sampled) -> (Vec<Group>, f64, DVec3) {
    let (mut places, mut of_points) = (vec![], vec![]);
    for (corners, rows, colours) in surface.of_triangles() {
        let (normal, weight) = (doubled_area(corners).as_vec3(), rows.area / rows.count().max(1) as f64);
        places.extend(rows.points_of_all().map(|(_, place)| place));
        of_points.extend(colours.iter().map(|&colour| (normal, weight, colour)));
    }
    let area = of_points.iter().map(|(_, weight, _)| weight).sum();
    let [low, high] = places
        .iter()
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &place| [low.min(place), high.max(place)]);
    let middle = low.midpoint(high);
    // Along a curve on which neighbours lie near one another (Morton 1966).
    let scale = 1023.0 / (high - low).max_element().max(f64::MIN_POSITIVE);
    let spread = |x: f64| (0..10).fold(0_u32, |key, bit| key | (x as u32 >> bit & 1) << (3 * bit));
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_by_cached_key(|&k| {
        let [x, y, z] = ((places[k as usize] - low) * scale).to_array().map(spread);
        x | y << 1 | z << 2
    });
    let group = |numbers: &[u32]| {
        // The last group may have fewer points: what is there twice weighs nothing.
        let number = |k: usize| numbers[k.min(numbers.len() - 1)] as usize;
        let place: [Vec3; TOGETHER] = std::array::from_fn(|k| (places[number(k)] - middle).as_vec3());
        let of_point = std::array::from_fn::<_, TOGETHER, _>(|k| of_points[number(k)]);
        Group {
            places: [0, 1, 2].map(|axis| place.map(|place| place[axis])),
            bounds: place.into_iter().fold(Bounds::NOTHING, Bounds::with),
            colours: of_point.map(|(.., colour)| colour),
            normals: of_point.map(|(normal, ..)| normal),
            weights: std::array::from_fn(|k| if k < numbers.len() { of_point[k].1 } else { 0.0 }),
        }
    };
    (order.chunks(TOGETHER).map(group).collect(), area, middle)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let (positions, triangles) = roof(4.0, 1.0);
        let mut watched = Watched::new(&sampled, positions, &triangles).expect("it shows something");
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
            let afresh = Watched::new(&sampled, watched.positions().to_vec(), &triangles).expect("as before").value();
            assert!((value / afresh - 1.0).abs() < 1e-3 && value == watched.value(), "{value} {afresh}");
            // Points on an edge belong to one of two triangles; and here cells are others, and its own points more.
            assert!((value / seen(&watched) - 1.0).abs() < 0.1, "{value} {}", seen(&watched));
        }
        assert!(watched.value() < first);
    }

    #[test]
    fn triangles_do_not_turn_over() {
        let sampled = sampled();
        let (positions, triangles) = roof(4.0, 1.0);
        let watched = Watched::new(&sampled, positions, &triangles).expect("it shows something");
        assert!(watched.moved(2, DVec3::new(20.0, 0.0, 1.0)).is_none());
        assert!(watched.moved(2, DVec3::new(4.0, 0.0, 1.5)).is_some());
        assert_eq!(watched.shortest_edge(0), 17_f64.sqrt());
    }

    #[test]
    fn what_shows_nothing_is_not_watched() {
        let (positions, triangles) = roof(4.0, 1.0);
        let corners = triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
        let nothing = Sampled::new(corners, 900.0, 0.0, |_, _| None);
        assert!(Watched::new(&nothing, positions.clone(), &triangles).is_none());
        let point = vec![DVec3::ONE; positions.len()];
        assert!(Watched::new(&sampled(), point, &triangles).is_none());
        // Far larger than what it shows.
        let large = positions.iter().map(|point| point * 1e6).collect();
        assert!(Watched::new(&sampled(), large, &triangles).is_none());
    }
}
