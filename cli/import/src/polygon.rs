//! Divides polygons into triangles: ear clipping in the plane of the Newell normal with exact orientation tests, and a
//! constrained Delaunay triangulation for very large polygons.

use glam::{DVec2, DVec3};
use robust::{Coord, orient2d};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation as _};

use super::source::Source;

/// Ear clipping takes quadratic time. From this size on, `spade` triangulates.
const MAX_CLIPPED_CORNERS: usize = 1024;

/// What is said of faces that are left out.
pub(super) const THIN: &str = "faces with fewer than three distinct corners were skipped: they have no surface";

/// The places of the corners of a polygon that differ from the one before them. With fewer than three it has no
/// surface; otherwise it has two triangles fewer than these.
pub(super) fn distinct_corners(polygon: &[u32], corners: &mut Vec<u32>) {
    corners.clear();
    corners.extend((0..polygon.len() as u32).filter(|&i| i == 0 || polygon[i as usize] != polygon[i as usize - 1]));
    while corners.len() > 1 && corners.last().map(|&i| polygon[i as usize]) == polygon.first().copied() {
        corners.pop();
    }
}

/// Triangulates polygons, and counts invalid ones.
#[derive(Debug, Default)]
pub(super) struct Triangulator {
    /// Faces with fewer than three distinct corners in a row, which have no surface.
    thin_count: u64,
    /// Polygons that cross themselves when seen along their normal. They are triangulated nevertheless, but their
    /// surface is a guess.
    crossed_count: u64,
    loop_: Vec<u32>,
    points: Vec<DVec2>,
    remaining: Vec<u32>,
}

impl Triangulator {
    /// Adds the triangles of a polygon, wound like the polygon, whose corners they name by their place in it.
    /// `position` gives the position of a vertex.
    pub(super) fn push_polygon(
        &mut self,
        polygon: &[u32],
        position: impl Fn(u32) -> DVec3,
        triangles: &mut Vec<[u32; 3]>,
    ) {
        distinct_corners(polygon, &mut self.loop_);
        let corners = self.loop_.as_slice();
        let n = corners.len() as u32;
        if n < 3 {
            self.thin_count += 1;
            return;
        }
        let triangle = |[a, b, c]: [u32; 3]| [corners[a as usize], corners[b as usize], corners[c as usize]];
        if n == 3 {
            triangles.push(triangle([0, 1, 2]));
            return;
        }
        let points = &mut self.points;
        project(corners, |corner| position(polygon[corner as usize]), points);
        let convex = (0..points.len()).all(|i| {
            let (j, k) = ((i + 1) % points.len(), (i + 2) % points.len());
            orientation(points[i], points[j], points[k]) > 0.0
        });
        // A loop that turns left everywhere may still go around more than once, but four corners cannot.
        if convex && (n == 4 || turns_once(points)) {
            triangles.extend((1..n - 1).map(|i| triangle([0, i, i + 1])));
            return;
        }
        if points.len() > MAX_CLIPPED_CORNERS {
            match triangulate_constrained(points) {
                Some(found) => triangles.extend(found.into_iter().map(triangle)),
                None => {
                    self.crossed_count += 1;
                    triangles.extend((1..n - 1).map(|i| triangle([0, i, i + 1])));
                }
            }
            return;
        }
        self.remaining.clear();
        self.remaining.extend(0..n);
        if !clip_ears(points, &mut self.remaining, |ear| triangles.push(triangle(ear))) {
            self.crossed_count += 1;
        }
    }

    /// Counts faces that a parser has already left out.
    pub(super) fn count_thin(&mut self, count: u64) {
        self.thin_count += count;
    }

    /// Notes for the user what was odd.
    pub(super) fn note(&self, source: &Source) {
        source.note_skipped(self.thin_count, THIN);
        source.note_skipped(self.crossed_count, "polygons cross or fold over themselves; their triangles are a guess");
    }
}

fn orientation(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let coord = |p: DVec2| Coord { x: p.x, y: p.y };
    orient2d(coord(a), coord(b), coord(c))
}

/// Projects along the main axis of the Newell normal such that the polygon runs counter-clockwise. Dropping a
/// coordinate rounds nothing, so collinear points stay collinear.
fn project(corners: &[u32], position: impl Fn(u32) -> DVec3, points: &mut Vec<DVec2>) {
    let at = |i: usize| position(corners[i % corners.len()]);
    let origin = at(0);
    let mut normal = DVec3::ZERO;
    for i in 0..corners.len() {
        normal += (at(i) - origin).cross(at(i + 1) - origin);
    }
    let size = normal.abs();
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    points.clear();
    points.extend((0..corners.len()).map(|i| {
        let p = at(i);
        if normal[axis] >= 0.0 { DVec2::new(p[u], p[v]) } else { DVec2::new(p[v], p[u]) }
    }));
}

/// Whether a loop that turns left at every corner goes around once: its x coordinate then rises in a single run.
fn turns_once(points: &[DVec2]) -> bool {
    let n = points.len();
    // Vertical edges that go up count as rising. With left turns everywhere, there is then one rising run per turn.
    let rising = |i: usize| {
        let (a, b) = (points[i % n], points[(i + 1) % n]);
        b.x > a.x || (b.x == a.x && b.y > a.y)
    };
    (0..n).filter(|&i| rising(i) && !rising(i + 1)).count() == 1
}

/// Cuts ears off the loop `remaining` until nothing is left. If no true ear remains (the loop touches, crosses or folds
/// over itself, or is flat), it cuts the corner that turns left most, so that the triangles always fill the loop
/// topologically and no edge of a neighbour opens. Returns whether all ears were true.
fn clip_ears(points: &[DVec2], remaining: &mut Vec<u32>, mut emit: impl FnMut([u32; 3])) -> bool {
    let mut all_true = true;
    // Starting each search after the last ear spreads the triangles instead of fanning them.
    let mut start = 0;
    while remaining.len() > 3 {
        let n = remaining.len();
        let found = (start..start + n).map(|i| i % n).find(|&i| is_ear(points, remaining, i));
        let ear = match found {
            Some(ear) => ear,
            None => {
                let turn = |i: usize| {
                    let [a, b, c] = neighbours(remaining, i).map(|p| points[p as usize]);
                    orientation(a, b, c)
                };
                // A flat corner is fine if the rest is flat too (zero area); otherwise something crosses.
                all_true &= (0..n).all(|i| turn(i) == 0.0);
                (0..n).max_by(|&i, &j| turn(i).total_cmp(&turn(j)).then(j.cmp(&i))).unwrap_or(0)
            }
        };
        emit(neighbours(remaining, ear));
        remaining.remove(ear);
        start = if ear >= remaining.len() { 0 } else { ear };
    }
    if let &[a, b, c] = &remaining[..] {
        emit([a, b, c]);
        let [a, b, c] = [a, b, c].map(|p| points[p as usize]);
        all_true &= orientation(a, b, c) >= 0.0;
    }
    all_true
}

fn neighbours(remaining: &[u32], i: usize) -> [u32; 3] {
    let n = remaining.len();
    [remaining[(i + n - 1) % n], remaining[i], remaining[(i + 1) % n]]
}

/// Whether a corner turns left with no other corner inside its triangle or on the triangle's border. Corners at exactly
/// the same position as one of the three do not count: bridges to holes visit their ends twice.
fn is_ear(points: &[DVec2], remaining: &[u32], i: usize) -> bool {
    let ear = neighbours(remaining, i);
    let [a, b, c] = ear.map(|p| points[p as usize]);
    if orientation(a, b, c) <= 0.0 {
        return false;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    !remaining.iter().any(|&p| {
        let p = points[p as usize];
        p.cmpge(low).all()
            && p.cmple(high).all()
            && p != a
            && p != b
            && p != c
            && orientation(a, b, p) >= 0.0
            && orientation(b, c, p) >= 0.0
            && orientation(c, a, p) >= 0.0
    })
}

/// The constrained Delaunay triangulation of a simple polygon; `None` if the polygon crosses or touches itself.
fn triangulate_constrained(points: &[DVec2]) -> Option<Vec<[u32; 3]>> {
    let n = points.len();
    let mut triangulation = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let handles: Vec<_> =
        points.iter().map(|p| triangulation.insert(Point2::new(p.x, p.y)).ok()).collect::<Option<_>>()?;
    if triangulation.num_vertices() != n {
        return None;
    }
    for i in 0..n {
        let (from, to) = (handles[i], handles[(i + 1) % n]);
        if !triangulation.can_add_constraint(from, to) {
            return None;
        }
        triangulation.add_constraint(from, to);
    }
    let mut corner_of = vec![u32::MAX; n];
    for (i, handle) in handles.iter().enumerate() {
        *corner_of.get_mut(handle.index())? = i as u32;
    }
    // The inside is left of each border edge, and can be reached from there without crossing the border.
    let mut inside = vec![false; triangulation.num_all_faces()];
    let mut open = Vec::new();
    for i in 0..n {
        // An edge that passes exactly through another corner was split there: the polygon touches itself.
        let edge = triangulation.get_edge_from_neighbors(handles[i], handles[(i + 1) % n])?;
        open.push(edge.face().as_inner()?.fix());
    }
    while let Some(face) = open.pop() {
        if std::mem::replace(&mut inside[face.index()], true) {
            continue;
        }
        for edge in triangulation.face(face).adjacent_edges() {
            if !edge.is_constraint_edge() {
                open.push(edge.rev().face().as_inner()?.fix());
            }
        }
    }
    let triangles: Vec<_> = triangulation
        .inner_faces()
        .filter(|f| inside[f.fix().index()])
        .map(|f| f.vertices().map(|v| corner_of[v.fix().index()]))
        .collect();
    (triangles.len() == n - 2).then_some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangulate(positions: &[DVec3]) -> (Vec<[u32; 3]>, Triangulator) {
        let polygon: Vec<u32> = (0..positions.len() as u32).collect();
        let (mut triangulator, mut triangles) = (Triangulator::default(), Vec::new());
        triangulator.push_polygon(&polygon, |v| positions[v as usize], &mut triangles);
        (triangles, triangulator)
    }

    /// Checks the area vector of each triangle, which must point the same way as the polygon's.
    fn assert_covers_once(positions: &[DVec3], triangles: &[[u32; 3]]) {
        let n = positions.len();
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            (b - a).cross(c - a) / 2.0
        };
        let polygon: DVec3 = (0..n).map(|i| positions[i].cross(positions[(i + 1) % n]) / 2.0).sum();
        let sum: f64 = triangles.iter().map(|t| area(t).dot(polygon.normalize())).sum();
        let absolute: f64 = triangles.iter().map(|t| area(t).length()).sum();
        assert_eq!(triangles.len(), n - 2);
        assert!((sum - polygon.length()).abs() < 1e-9 * absolute && (absolute - sum).abs() < 1e-9 * absolute);
        assert!(triangles.iter().all(|t| area(t).length() > 0.0));
    }

    /// A comb or star, tilted in space: the radius alternates, so every second corner is concave.
    fn star(n: usize) -> Vec<DVec3> {
        let rotation = glam::DQuat::from_scaled_axis(DVec3::new(0.3, -1.1, 2.0));
        (0..n)
            .map(|i| {
                let (angle, radius) = (i as f64 / n as f64 * std::f64::consts::TAU, if i % 2 == 0 { 1.0 } else { 0.4 });
                rotation * DVec3::new(angle.cos() * radius, angle.sin() * radius, 0.0)
            })
            .collect()
    }

    #[test]
    fn concave_polygons_are_covered_exactly_once() {
        for n in [4, 20, 21, 300, 1500] {
            let positions = star(n);
            let (triangles, triangulator) = triangulate(&positions);
            assert_covers_once(&positions, &triangles);
            assert_eq!(triangulator.crossed_count, 0);
        }
        let dart = [[0., 0., 0.], [4., 0., 0.], [1., 1., 0.], [0., 4., 0.]].map(DVec3::from);
        for turn in 0..4 {
            let mut positions = dart;
            positions.rotate_left(turn);
            assert_covers_once(&positions, &triangulate(&positions).0);
        }
    }

    #[test]
    fn convex_polygons_with_flat_corners_get_no_flat_triangles() {
        let square = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
            .map(|[x, y]| DVec3::new(x as f64, 5.0, y as f64));
        assert_covers_once(&square, &triangulate(&square).0);
    }

    #[test]
    fn bridged_holes_stay_open() {
        // A square ring: the outer loop, a bridge, the hole clockwise, the bridge back.
        let ring = [[0, 0], [6, 0], [6, 6], [0, 6], [0, 0], [2, 2], [2, 4], [4, 4], [4, 2], [2, 2]];
        let positions = ring.map(|[x, y]| DVec3::new(x as f64, y as f64, 0.0));
        let (triangles, _) = triangulate(&positions);
        assert_covers_once(&positions, &triangles);
    }

    #[test]
    fn crossed_flat_and_repeating_polygons_fill_their_loop_and_are_noted() {
        let bow = [[0., 0., 0.], [2., 2., 0.], [2., 0., 0.], [0., 3., 0.]].map(DVec3::from);
        let (triangles, triangulator) = triangulate(&bow);
        assert_eq!((triangles.len(), triangulator.crossed_count), (2, 1));
        let flat: Vec<DVec3> = (0..6).map(|i| DVec3::splat(i as f64)).collect();
        assert_eq!(triangulate(&flat).0.len(), 4);
        // Twice around a pentagon: turns left everywhere but is not convex.
        let twice: Vec<DVec3> = (0..10).map(|i| star(10)[i * 4 % 10] + DVec3::X * (i as f64 * 1e-3)).collect();
        assert_eq!(triangulate(&twice).0.len(), 8);
        let huge: Vec<DVec3> = (0..5000).map(|i| DVec3::new((i % 7) as f64, (i % 11) as f64, 0.0)).collect();
        let (triangles, triangulator) = triangulate(&huge);
        assert_eq!((triangles.len(), triangulator.crossed_count), (4998, 1));
    }

    #[test]
    fn faces_without_three_distinct_corners_are_counted() {
        let positions = star(4);
        let (mut triangulator, mut triangles) = (Triangulator::default(), Vec::new());
        for polygon in [&[][..], &[1], &[0, 1], &[2, 2, 2, 2], &[0, 1, 1, 0]] {
            triangulator.push_polygon(polygon, |v| positions[v as usize], &mut triangles);
        }
        assert_eq!((triangles.len(), triangulator.thin_count), (0, 5));
        triangulator.push_polygon(&[0, 1, 1, 2], |v| positions[v as usize], &mut triangles);
        // The vertices 0, 1 and 2.
        assert_eq!(triangles, [[0, 1, 3]]);
    }
}
