//! A Delaunay triangulation of a rectangle to which points are added one by one.
//!
//! Triangles are three half edges each: edge `e` begins at `corners[e]` and belongs to triangle `e / 3`. Coordinates
//! are integers, so every decision is exact.

/// No triangle is on the other side.
const NONE: u32 = u32::MAX;
/// Products of four coordinates shall fit into 64 bits; those of larger ones are computed with 128.
pub const MAX_SIDE: i64 = 1 << 14;
/// The largest side at all.
const MAX_WIDE_SIDE: i64 = 1 << 20;

/// A triangulation. Points are columns to the east and rows to the south.
#[derive(Debug)]
pub struct Delaunay {
    points: Vec<[i32; 2]>,
    corners: Vec<u32>,
    twins: Vec<u32>,
    /// Triangles that are new or have changed, none of them twice.
    changed: Vec<u32>,
    is_changed: Vec<bool>,
    /// Edges that may have to be flipped.
    waiting: Vec<u32>,
}

fn next(edge: u32) -> u32 {
    if edge % 3 == 2 { edge - 2 } else { edge + 1 }
}

fn previous(edge: u32) -> u32 {
    if edge.is_multiple_of(3) { edge + 2 } else { edge - 1 }
}

/// Twice the area of a triangle: positive where it turns counter-clockwise seen from above, with rows to the south.
fn doubled_area(a: [i32; 2], b: [i32; 2], c: [i32; 2]) -> i64 {
    let to = |p: [i32; 2]| [0, 1].map(|axis| i64::from(p[axis]) - i64::from(a[axis]));
    let ([bx, by], [cx, cy]) = (to(b), to(c));
    by * cx - bx * cy
}

/// Whether a point lies within the circle around a counter-clockwise triangle.
fn is_in_circle([a, b, c]: [[i32; 2]; 3], p: [i32; 2]) -> bool {
    let of = |q: [i32; 2]| {
        let [x, y] = [0, 1].map(|axis| i64::from(q[axis]) - i64::from(p[axis]));
        [x, y, x * x + y * y]
    };
    let ([ax, ay, aq], [bx, by, bq], [cx, cy, cq]) = (of(a), of(b), of(c));
    if aq.max(bq).max(cq) > 2 * MAX_SIDE * MAX_SIDE {
        let part = |q: i64, of: i64| i128::from(q) * i128::from(of);
        return part(aq, bx * cy - by * cx) + part(bq, cx * ay - cy * ax) + part(cq, ax * by - ay * bx) < 0;
    }
    aq * (bx * cy - by * cx) + bq * (cx * ay - cy * ax) + cq * (ax * by - ay * bx) < 0
}

impl Delaunay {
    /// Two triangles, from the first to the last column and row.
    pub fn new([columns, rows]: [i32; 2]) -> Self {
        debug_assert!(i64::from(columns.max(rows)) <= MAX_WIDE_SIDE);
        Self {
            points: vec![[0, 0], [columns, 0], [0, rows], [columns, rows]],
            corners: vec![0, 2, 3, 3, 1, 0],
            twins: vec![NONE, NONE, 5, NONE, NONE, 2],
            changed: vec![0, 1],
            is_changed: vec![true; 2],
            waiting: vec![],
        }
    }

    /// The vertices, in the order in which they were added behind the corners.
    pub fn points(&self) -> &[[i32; 2]] {
        &self.points
    }

    /// How many triangles there are.
    pub fn count(&self) -> usize {
        self.corners.len() / 3
    }

    /// The vertices of a triangle, counter-clockwise seen from above.
    pub fn triangle(&self, number: u32) -> [u32; 3] {
        [0, 1, 2].map(|k| self.corners[3 * number as usize + k])
    }

    /// Where the corners of a triangle are.
    pub fn places(&self, number: u32) -> [[i32; 2]; 3] {
        self.triangle(number).map(|corner| self.points[corner as usize])
    }

    /// A triangle that has changed since it was handed out last.
    pub fn next_changed(&mut self) -> Option<u32> {
        let number = self.changed.pop()?;
        self.is_changed[number as usize] = false;
        Some(number)
    }

    /// The triangle with a point, looked for from another one on.
    pub fn locate(&self, point: [i32; 2], mut from: u32) -> u32 {
        loop {
            let corners = self.places(from);
            let across = (0..3).find_map(|k| {
                let is_beyond = doubled_area(corners[k], corners[(k + 1) % 3], point) < 0;
                let twin = self.twins[3 * from as usize + k];
                (is_beyond && twin != NONE).then_some(twin)
            });
            match across {
                Some(twin) => from = twin / 3,
                None => return from,
            }
        }
    }

    /// Adds a point that lies in a triangle or on one of its sides; nothing changes if it is there already.
    pub fn insert(&mut self, point: [i32; 2], number: u32) {
        let corners = self.places(number);
        let is_on = [0, 1, 2].map(|k| doubled_area(corners[k], corners[(k + 1) % 3], point) == 0);
        let vertex = self.points.len() as u32;
        match is_on.iter().filter(|&&is_on| is_on).count() {
            0 => {
                self.points.push(point);
                self.divide(number, vertex);
            }
            1 => {
                self.points.push(point);
                let side = is_on.iter().position(|&is_on| is_on).unwrap_or(0);
                self.divide_side(3 * number + side as u32, vertex);
            }
            _ => return,
        }
        while let Some(edge) = self.waiting.pop() {
            self.flip(edge);
        }
    }

    fn note(&mut self, triangle: u32) {
        if !std::mem::replace(&mut self.is_changed[triangle as usize], true) {
            self.changed.push(triangle);
        }
    }

    /// Appends a triangle, and returns its first edge.
    fn push(&mut self, corners: [u32; 3]) -> u32 {
        let first = self.corners.len() as u32;
        self.corners.extend(corners);
        self.twins.extend([NONE; 3]);
        self.is_changed.push(true);
        self.changed.push(first / 3);
        first
    }

    fn link(&mut self, edge: u32, other: u32) {
        self.twins[edge as usize] = other;
        if other != NONE {
            self.twins[other as usize] = edge;
        }
    }

    fn corner(&self, edge: u32) -> u32 {
        self.corners[edge as usize]
    }

    fn twin(&self, edge: u32) -> u32 {
        self.twins[edge as usize]
    }

    /// Divides a triangle into three around a vertex.
    fn divide(&mut self, number: u32, vertex: u32) {
        let first = 3 * number;
        let [a, b, c] = self.triangle(number);
        let [_, beyond_second, beyond_third] = [0, 1, 2].map(|k| self.twin(first + k));
        self.corners[first as usize + 2] = vertex;
        self.note(number);
        let (second, third) = (self.push([b, c, vertex]), self.push([c, a, vertex]));
        self.link(second, beyond_second);
        self.link(third, beyond_third);
        self.link(first + 1, second + 2);
        self.link(second + 1, third + 2);
        self.link(third + 1, first + 2);
        self.waiting.extend([first, second, third]);
    }

    /// Divides the triangles at a side, by a vertex on it.
    fn divide_side(&mut self, edge: u32, vertex: u32) {
        let (after, before, other) = (next(edge), previous(edge), self.twin(edge));
        let (end, apex) = (self.corner(after), self.corner(before));
        let beyond = self.twin(after);
        self.corners[after as usize] = vertex;
        self.note(edge / 3);
        let half = self.push([vertex, end, apex]);
        self.link(half + 1, beyond);
        self.link(half + 2, after);
        self.waiting.extend([before, half + 1]);
        if other == NONE {
            return;
        }
        let (other_after, other_before) = (next(other), previous(other));
        let (other_apex, beyond) = (self.corner(other_before), self.twin(other_before));
        self.corners[other as usize] = vertex;
        self.note(other / 3);
        let other_half = self.push([end, vertex, other_apex]);
        self.link(other_half + 2, beyond);
        self.link(other_half + 1, other_before);
        self.link(other_half, half);
        self.waiting.extend([other_after, other_half + 2]);
    }

    /// Flips an edge if the vertex behind it lies in the circle of its triangle. The vertex added last is opposite to
    /// it.
    fn flip(&mut self, edge: u32) {
        let other = self.twin(edge);
        if other == NONE {
            return;
        }
        let (after, before) = (next(edge), previous(edge));
        let (other_after, other_before) = (next(other), previous(other));
        let (apex, behind) = (self.corner(before), self.corner(other_before));
        let corners = [edge, after, before].map(|edge| self.points[self.corner(edge) as usize]);
        if !is_in_circle(corners, self.points[behind as usize]) {
            return;
        }
        let (beyond, other_beyond) = (self.twin(other_after), self.twin(after));
        self.corners[after as usize] = behind;
        self.corners[other_after as usize] = apex;
        self.link(edge, beyond);
        self.link(other, other_beyond);
        self.link(after, other_after);
        self.note(edge / 3);
        self.note(other / 3);
        self.waiting.extend([edge, other_before]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_grid_make_a_delaunay_triangulation() {
        let mut all = Delaunay::new([40, 30]);
        let mut state = 1u32;
        let mut last = 0;
        for _ in 0..600 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let point = [(state >> 8) % 41, (state >> 16) % 31].map(|x| x as i32);
            last = all.locate(point, last);
            all.insert(point, last);
        }
        let mut area = 0;
        for number in 0..all.count() as u32 {
            let corners = all.places(number);
            let doubled = doubled_area(corners[0], corners[1], corners[2]);
            assert!(doubled > 0);
            area += doubled;
            assert!(all.points().iter().all(|&point| !is_in_circle(corners, point)));
            for k in 0..3 {
                let (edge, twin) = (3 * number + k, all.twin(3 * number + k));
                assert!(twin == NONE || all.twin(twin) == edge && all.corner(twin) == all.corner(next(edge)));
            }
        }
        assert_eq!(area, 2 * 40 * 30);
        let unique: std::collections::HashSet<_> = all.points().iter().collect();
        assert_eq!(unique.len(), all.points().len());
    }
}
