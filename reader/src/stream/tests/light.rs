//! Normals for smooth light are those of SPEC.md, 14.5, on both sides of every border, whatever was drawn before.

use std::collections::HashMap;

use super::{trees::random_antichain, *};
use crate::{
    codec::vector::{Vec3, add, cross, dot, scale, sub},
    decode::BorderKey,
    stream::{DrawnRoot, Mode, Picture, Simulation, direction, octahedral::octahedral},
};

const LIT: Options = Options { mode: Mode::Synchronous, light: true, ..APART };
/// How deep in the tree cuts are: see [`random_antichain`].
const DEPTH: u64 = 3;
const CREASE: f64 = 0.866_025_403_784_438_6;

fn tree(seed: u64) -> Arc<File<Vec<u8>>> {
    let bytes = file_of(&cube(4), ModelOptions { levels: 3, seed, grids_of_four: 1, heights: 3 });
    Arc::new(File::open(bytes, Limits::default()).unwrap())
}

/// The normal of a triangle as sessions store it.
fn face(points: [Vec3; 3]) -> Option<(Vec3, f64)> {
    let normal = cross(sub(points[1], points[0]), sub(points[2], points[0]));
    let length = dot(normal, normal).sqrt();
    (length > 0.0).then(|| (scale(normal, 1.0 / length), length / 2.0))
}

fn rounded(normal: Vec3) -> Vec3 {
    direction(octahedral(normal))
}

/// The corners of all triangles that are drawn, without what neighbours insert.
#[derive(Default)]
struct Reference {
    /// Where the corners of a root's triangles begin.
    first: HashMap<u32, usize>,
    faces: Vec<Option<(Vec3, f64)>>,
    set: Vec<usize>,
}

impl Reference {
    fn root_of(&self, mut corner: usize) -> usize {
        while self.set[corner] != corner {
            corner = self.set[corner];
        }
        corner
    }

    fn join(&mut self, a: usize, b: usize) {
        let [a, b] = [a, b].map(|corner| self.root_of(corner));
        self.set[a.max(b)] = a.min(b);
    }

    /// As the specification says it, for all roots at once.
    fn new(picture: &Picture) -> Self {
        let mut all = Self::default();
        let mut ends: HashMap<(BorderKey, u32, bool), Vec<usize>> = HashMap::new();
        for drawn in picture.roots() {
            let surface = &drawn.surface;
            let half_arcs: Vec<_> = surface.half_arcs().collect();
            let border: Vec<_> = surface.border_triangles().collect();
            let triangles = surface.triangles.iter().copied().chain(border.iter().map(|(corners, _)| *corners));
            let triangles: Vec<[u32; 3]> = triangles.collect();
            let begin = all.set.len();
            all.first.insert(surface.root, begin);
            all.set.extend(begin..begin + 3 * triangles.len());
            all.faces.extend(triangles.iter().map(|corners| face(corners.map(|v| surface.positions[v as usize]))));
            let mut edges: HashMap<[u32; 2], Vec<(usize, usize)>> = HashMap::new();
            for (number, triangle) in triangles.iter().enumerate() {
                for k in (0..3).filter(|_| all.faces[begin / 3 + number].is_some()) {
                    let [a, b] = [triangle[k], triangle[(k + 1) % 3]];
                    let corners = [begin + 3 * number + k, begin + 3 * number + (k + 1) % 3];
                    let (edge, corners) = if a < b { ([a, b], corners) } else { ([b, a], [corners[1], corners[0]]) };
                    edges.entry(edge).or_default().push((corners[0], corners[1]));
                }
            }
            for pair in edges.into_values() {
                let &[(a, b), (c, d)] = &pair[..] else { continue };
                let runs_back = (a + 1 - a % 3 + (a + 1) % 3 - 1) == b;
                let other_runs_back = (c + 1 - c % 3 + (c + 1) % 3 - 1) == d;
                let [one, other] = [a, c].map(|corner| all.faces[corner / 3].unwrap().0);
                if dot(one, other) > CREASE && runs_back != other_runs_back {
                    all.join(a, c);
                    all.join(b, d);
                }
            }
            for (number, (corners, edges)) in (surface.triangles.len()..).zip(&border) {
                for (k, edge) in edges.iter().enumerate().filter(|(_, edge)| !edge.is_empty()) {
                    let (first, last) = (edge[0], edge[edge.len() - 1]);
                    let key = |k: usize| surface.keys[corners[k % 3] as usize];
                    let arc = |side: u32| half_arcs[side as usize].arc;
                    let begin = begin + 3 * number;
                    let from = (key(k), arc(first.side), first.params[1] > first.params[0]);
                    ends.entry(from).or_default().push(begin + k);
                    let to = (key(k + 1), arc(last.side), last.params[0] > last.params[1]);
                    ends.entry(to).or_default().push(begin + (k + 1) % 3);
                }
            }
        }
        for pair in ends.into_values() {
            let &[a, b] = &pair[..] else { continue };
            let [Some((one, _)), Some((other, _))] = [a, b].map(|corner| all.faces[corner / 3]) else { continue };
            if dot(rounded(one), rounded(other)) > CREASE {
                all.join(a, b);
            }
        }
        all
    }

    /// The normals of all corners, by the number of the first one of each fan.
    fn normals(&self) -> HashMap<usize, Vec3> {
        let mut sums: HashMap<usize, (Vec3, f64)> = HashMap::new();
        for corner in 0..self.set.len() {
            if let Some((normal, area)) = self.faces[corner / 3] {
                let (sum, weight) = sums.entry(self.root_of(corner)).or_default();
                (*sum, *weight) = (add(*sum, scale(normal, area)), *weight + area);
            }
        }
        let normal = |(sum, weight): (Vec3, f64)| {
            let length = dot(sum, sum).sqrt();
            (length > 1e-3 * weight).then(|| scale(sum, 1.0 / length))
        };
        sums.into_iter().filter_map(|(set, sum)| Some((set, normal(sum)?))).collect()
    }
}

fn is_near(a: Vec3, b: Vec3) -> bool {
    dot(sub(a, b), sub(a, b)) < 1e-6
}

/// Checks the normals of all roots against the reference. Returns how many corners at borders have normals, and how
/// many of inserted vertices have those of a finer root and of their triangle.
fn check(picture: &Picture) -> [usize; 3] {
    let reference = Reference::new(picture);
    let normals = reference.normals();
    let mut at_key: HashMap<BorderKey, Vec<Vec3>> = HashMap::new();
    let mut counts = [0; 3];
    for drawn in picture.roots() {
        let light = drawn.light().unwrap();
        let first = reference.first[&drawn.surface.root];
        for (number, triangle) in light.triangles.iter().enumerate() {
            for (k, &fan) in triangle.iter().enumerate() {
                let found = direction(light.normals[fan as usize]);
                let count = drawn.surface.positions.len();
                let vertex = (fan as usize).checked_sub(count).map_or(fan, |further| light.further[further]);
                if let Some(&key) = drawn.surface.keys.get(vertex as usize) {
                    at_key.entry(key).or_default().push(found);
                    counts[0] += 1;
                }
                let corner = reference.root_of(first + 3 * number + k);
                let is_as_expected = normals.get(&corner).is_none_or(|&expected| is_near(found, expected));
                assert!(is_as_expected, "root {}, triangle {number}, corner {k}", drawn.surface.root);
            }
        }
    }
    for drawn in picture.roots() {
        let light = drawn.light().unwrap();
        let keys: Vec<BorderKey> = drawn.strips.iter().flat_map(|strip| strip.keys.clone()).collect();
        assert_eq!(keys.len(), light.strip_normals.len());
        let border = drawn.surface.border_triangles();
        let faces = border.filter_map(|(corners, _)| face(corners.map(|v| drawn.surface.positions[v as usize])));
        let faces: Vec<Vec3> = faces.map(|(normal, _)| normal).collect();
        for (key, &normal) in keys.iter().zip(&light.strip_normals) {
            let normal = direction(normal);
            if at_key[key].iter().any(|&other| is_near(other, normal)) {
                counts[1] += 1;
            } else {
                assert!(faces.iter().any(|&face| is_near(face, normal)));
                counts[2] += 1;
            }
        }
        check_lit(drawn);
    }
    counts
}

/// What is joined has the normals of what is not.
fn check_lit(drawn: &DrawnRoot) {
    let (lit, light, surface) = (drawn.lit().unwrap(), drawn.light().unwrap(), &drawn.surface);
    let (positions, triangles) = drawn.joined();
    assert_eq!(lit.positions[..positions.len()], positions);
    assert_eq!((lit.positions.len(), lit.triangles.len()), (lit.normals.len(), triangles.len()));
    let at = |points: &[[f64; 3]], triangle: [u32; 3]| triangle.map(|vertex| points[vertex as usize].map(f64::to_bits));
    for (joined, lit_triangle) in triangles.iter().zip(&lit.triangles) {
        assert_eq!(at(&positions, *joined), at(&lit.positions, *lit_triangle));
    }
    let normals = |normals: &[[i16; 2]], triangle: [u32; 3]| triangle.map(|vertex| normals[vertex as usize]);
    for (own, lit_triangle) in light.triangles.iter().zip(&lit.triangles).take(surface.triangles.len()) {
        assert_eq!(normals(&light.normals, *own), normals(&lit.normals, *lit_triangle));
    }
    // Triangles at the border are parts of one, and have its normals where they have its corners.
    let mut parts = lit.triangles[surface.triangles.len()..].iter();
    for (side, strip) in drawn.strips.iter().enumerate() {
        for number in surface.border_range(side) {
            let (corners, on_border) = surface.border_triangle(number);
            let own = light.triangles[surface.triangles.len() + number as usize];
            let own = own.map(|fan| light.normals[fan as usize]);
            let inserted =
                (0..3).filter(|&k| on_border[k]).map(|k| strip.edges.iter().filter(|&&e| e == corners[k]).count());
            for part in parts.by_ref().take(1 + inserted.sum::<usize>()) {
                for &vertex in part {
                    let place = lit.positions[vertex as usize];
                    if let Some(k) = (0..3).find(|&k| surface.positions[corners[k] as usize] == place) {
                        assert_eq!(lit.normals[vertex as usize], own[k]);
                    }
                }
            }
        }
    }
    assert_eq!(parts.count(), 0);
}

fn fresh(picture: &Picture) -> Picture {
    let mut fresh = Picture::default();
    let surfaces = picture.roots().map(|root| root.surface.clone()).collect();
    fresh.update(Difference { surfaces, ..Difference::default() });
    fresh
}

#[test]
fn normals_are_those_of_the_specification_at_any_levels() {
    let mut sums = [0; 3];
    for seed in 0..4 {
        for (file, is_tree) in [(model(3), false), (tree(seed), true)] {
            let mut session = session(&file, LIT);
            let mut simulation = Simulation::new(file.source(), Duration::ZERO);
            let mut random = Random::new(seed);
            for _ in 0..3 {
                let wanted =
                    if is_tree { random_antichain(&file, DEPTH, &mut random) } else { random_cut(&file, &mut random) };
                simulation.frame(&mut session, &wanted, &[]).unwrap();
                let counts = check(session.picture());
                (0..3).for_each(|k| sums[k] += counts[k]);
            }
        }
    }
    assert!(sums.iter().all(|&sum| sum > 500), "{sums:?}");
}

#[test]
fn normals_do_not_depend_on_what_was_drawn_before_and_change_only_beside_changes() {
    for (file, is_tree) in [(model(3), false), (tree(7), true)] {
        let mut session = session(&file, LIT);
        let mut simulation = Simulation::new(file.source(), Duration::ZERO);
        let mut random = Random::new(31);
        let mut wanted =
            if is_tree { random_antichain(&file, DEPTH, &mut random) } else { random_cut(&file, &mut random) };
        let mut relit = 0;
        for _ in 0..40 {
            let before = session.picture().clone();
            match is_tree {
                true => wanted = random_antichain(&file, DEPTH, &mut random),
                false => wanted[random.below(54) as usize].level = random.below(4) as u8,
            }
            let changes = simulation.frame(&mut session, &wanted, &[]).unwrap().changes;
            let after = session.picture();
            for (kept, made) in after.roots().zip(fresh(after).roots()) {
                assert_eq!((&kept.light, kept.lit()), (&made.light, made.lit()));
            }
            let is_new = |root: u32| changes.surfaces.binary_search(&root).is_ok();
            let has_news = |root: u32| is_new(root) || changes.strips.iter().any(|(other, _)| *other == root);
            for drawn in after.roots() {
                let root = drawn.surface.root;
                let is_listed = changes.lights.binary_search(&root).is_ok();
                let old = before.root(root).filter(|_| !is_new(root));
                assert_eq!(is_listed, old.is_some_and(|old| old.light != drawn.light), "root {root}");
                assert!(has_news(root) || is_listed || old.is_some_and(|old| old.lit() == drawn.lit()));
                assert!(!is_listed || old.is_some_and(|old| old.stamp() != drawn.stamp()));
                relit += usize::from(is_listed && !has_news(root));
            }
            let keys = |root: u32, picture: &Picture| {
                picture.root(root).map(|drawn| drawn.surface.keys.clone()).unwrap_or_default()
            };
            let changed = changes.surfaces.iter().chain(&changes.removed);
            let near: BTreeSet<BorderKey> =
                changed.flat_map(|&root| [keys(root, &before), keys(root, after)].concat()).collect();
            let is_near = |root: &u32| {
                let strips = after.root(*root).unwrap().strips.iter().flat_map(|strip| strip.keys.clone());
                keys(*root, after).into_iter().chain(strips).any(|key| near.contains(&key))
            };
            assert!(changes.lights.iter().all(is_near));
        }
        assert!(relit > 0);
    }
}

#[test]
fn without_light_there_is_nothing_of_it() {
    let file = model(2);
    let drawn = |options: Options| {
        let mut session = session(&file, options);
        let mut simulation = Simulation::new(file.source(), Duration::ZERO);
        let frame = simulation.frame(&mut session, &uniform(&file, 3), &[]).unwrap();
        assert!(frame.changes.lights.is_empty());
        (session.picture().clone(), session.cached_bytes()[1])
    };
    let [(dark, bytes), (lit, more)] = [Options { light: false, ..LIT }, LIT].map(drawn);
    assert!(bytes < more);
    for (dark, lit) in dark.roots().zip(lit.roots()) {
        assert!(dark.surface.fans.is_none() && dark.lit().is_none() && dark.light().is_none());
        assert!(dark.strips.iter().all(|strip| strip.edges.is_empty()));
        assert_eq!(dark.joined(), lit.joined());
    }
}
