//! Round trips over all kinds of topology, and hostile streams.

use super::*;
use crate::{
    codec::{
        entropy::{Replay, SymbolBuffer, SymbolSource, context::Context},
        filling::{Quantisation, Slide},
        patch::{LatticePoint, Patch},
        vector::{Vec3, cross, dot, sub},
    },
    error::Violation,
};

const QUANTISATION: Quantisation = Quantisation { normal_shift: 1, tangent_shift: 3 };
const LIMITS: PatchLimits = PatchLimits { vertices: 10_000, triangles: 20_000 };

/// Euclidean length.
fn length(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// xorshift64*.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 16
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// A mesh to be coded, owned.
#[derive(Clone, Default)]
struct Model {
    loops: Vec<Vec<LatticePoint>>,
    interior: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Model {
    /// Finds the border of a manifold and renumbers it as in a patch.
    fn new(points: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let mut next = vec![None; points.len()];
        for t in triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                if !triangles.iter().any(|s| (0..3).any(|j| (s[j], s[(j + 1) % 3]) == (b, a))) {
                    next[a as usize] = Some(b);
                }
            }
        }
        let mut model = Self::default();
        let mut number = vec![None; points.len()];
        let mut count = 0;
        for start in 0..points.len() {
            let mut border = Vec::new();
            let mut v = start;
            while let (Some(after), None) = (next[v], number[v]) {
                number[v] = Some(count);
                count += 1;
                border.push(points[v].map(|x| x.round() as i64));
                v = after as usize;
            }
            if !border.is_empty() {
                model.loops.push(border);
            }
        }
        for (v, number) in number.iter_mut().enumerate().filter(|(_, n)| n.is_none()) {
            *number = Some(count);
            count += 1;
            model.interior.push(points[v]);
        }
        model.triangles = triangles.iter().map(|t| t.map(|v| number[v as usize].unwrap())).collect();
        model
    }

    /// `columns` x `rows` cells of a bumpy sheet without the cells that `hole` names; either direction may wrap.
    fn sheet(columns: u32, rows: u32, wrap: [bool; 2], hole: impl Fn(u32, u32) -> bool) -> Self {
        let (width, height) = (columns + u32::from(!wrap[0]), rows + u32::from(!wrap[1]));
        let mut triangles = Vec::new();
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            if !hole(x, y) {
                let v = |i: u32, j: u32| (x + i) % width + (y + j) % height * width;
                triangles.extend([[v(0, 0), v(1, 0), v(1, 1)], [v(0, 0), v(1, 1), v(0, 1)]]);
            }
        }
        let points: Vec<Vec3> = (0..width * height)
            .map(|v| {
                let (u, w) = (f64::from(v % width), f64::from(v / width));
                let (a, b) =
                    (u / f64::from(columns) * std::f64::consts::TAU, w / f64::from(rows) * std::f64::consts::TAU);
                match wrap {
                    [true, true] => {
                        let r = 500.0 + 200.0 * b.cos();
                        [r * a.cos(), r * a.sin(), 200.0 * b.sin()]
                    }
                    [true, false] => [300.0 * a.cos(), 300.0 * a.sin(), 40.0 * w],
                    _ => [40.3 * u, 38.7 * w, 30.0 * (0.4 * u).sin() * (0.3 * w).cos()],
                }
            })
            .collect();
        Self::compact(&points, &triangles)
    }

    /// Drops points without triangles first.
    fn compact(points: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        let kept: Vec<Vec3> = used.iter().map(|&v| points[v as usize]).collect();
        let triangles: Vec<[u32; 3]> =
            triangles.iter().map(|t| t.map(|v| used.binary_search(&v).unwrap() as u32)).collect();
        Self::new(&kept, &triangles)
    }

    /// An octahedron, each triangle split at its middle `rounds` times.
    fn sphere(rounds: u32) -> Self {
        let mut points: Vec<Vec3> = vec![
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
        ];
        let mut triangles: Vec<[u32; 3]> = (0..4).flat_map(|k| [[k, (k + 1) % 4, 4], [(k + 1) % 4, k, 5]]).collect();
        for _ in 0..rounds {
            triangles = triangles
                .iter()
                .flat_map(|&[a, b, c]| {
                    let m = points.len() as u32;
                    let sum = [0, 1, 2].map(|k| points[a as usize][k] + points[b as usize][k] + points[c as usize][k]);
                    points.push(sum.map(|x| x / length(sum)));
                    [[a, b, m], [b, c, m], [c, a, m]]
                })
                .collect();
        }
        let points: Vec<Vec3> = points.iter().map(|p| p.map(|x| x * 700.0 + 5000.0)).collect();
        Self::new(&points, &triangles)
    }

    /// Two models side by side, as two components of one patch.
    fn and(&self, other: &Self) -> Self {
        let count = |m: &Self| m.loops.iter().map(Vec::len).sum::<usize>() as u32;
        let (mine, theirs, inner) = (count(self), count(other), self.interior.len() as u32);
        let mut both = self.clone();
        both.loops.extend(other.loops.iter().cloned());
        both.interior.extend(&other.interior);
        for v in both.triangles.iter_mut().flatten().filter(|v| **v >= mine) {
            *v += theirs;
        }
        let moved = |v: u32| if v < theirs { mine + v } else { v + mine + inner };
        both.triangles.extend(other.triangles.iter().map(|t| t.map(moved)));
        both
    }

    /// A sheet with its inner edges flipped at random, where the result stays a simplicial disk.
    fn flipped(seed: u64) -> Self {
        let mut model = Self::sheet(9, 8, [false, false], |_, _| false);
        let mut random = Random(seed);
        for _ in 0..2000 {
            let t = random.below(model.triangles.len());
            let k = random.below(3);
            let [a, b, c] = [0, 1, 2].map(|j| model.triangles[t][(k + j) % 3]);
            let has = |s: &[u32; 3], p: u32, q: u32| (0..3).any(|j| (s[j], s[(j + 1) % 3]) == (p, q));
            let Some(s) = model.triangles.iter().position(|s| has(s, b, a)) else { continue };
            let d = *model.triangles[s].iter().find(|&&v| v != a && v != b).unwrap();
            if model.triangles.iter().any(|s| has(s, c, d) || has(s, d, c)) {
                continue;
            }
            model.triangles[t] = [a, d, c];
            model.triangles[s] = [d, b, c];
        }
        model
    }

    fn encode(&self) -> (SymbolBuffer, Patch, Vec<u32>) {
        let mut symbols = SymbolBuffer::default();
        let target = PatchTarget { loops: &self.loops, interior: &self.interior, triangles: &self.triangles };
        let (patch, order) = encode_patch(&target, QUANTISATION, &Stay(&self.interior), &mut symbols).unwrap();
        (symbols, patch, order)
    }

    fn round_trip(&self) {
        let (patch, order) = self.survives();
        // Half a step in each direction of the frame, and half a lattice step for the final rounding.
        let (normal, tangent) = QUANTISATION.steps();
        let tolerance = (0.25 * normal * normal + 0.5 * tangent * tangent).sqrt() + 0.75f64.sqrt() + 1e-6;
        for (point, &v) in patch.interior.iter().zip(&order) {
            assert!(length(sub(point.map(|x| x as f64), self.interior[v as usize])) <= tolerance);
        }
    }

    /// The patch has the same triangles, wherever its vertices are, and is decoded as it was encoded.
    fn survives(&self) -> (Patch, Vec<u32>) {
        let (symbols, patch, order) = self.encode();
        let mut replay = Replay::new(&symbols);
        assert_eq!(decode_patch(&mut replay, &self.loops, QUANTISATION, LIMITS).unwrap(), patch);
        assert!(replay.get(0).is_err(), "symbols are left over");
        // The same triangles, vertices matched by `order`.
        let border = patch.border_count;
        assert_eq!(border as usize, self.loops.iter().map(Vec::len).sum::<usize>());
        let named = |v: u32| if v < border { v } else { border + order[(v - border) as usize] };
        assert_eq!(canonical(patch.triangles.iter().map(|t| t.map(named))), canonical(self.triangles.iter().copied()));
        assert_eq!(order.len(), self.interior.len());
        (patch, order)
    }

    /// The triangles of a patch of the model that have a vertex inside and lie on one line.
    fn flat(&self, patch: &Patch) -> usize {
        let points: Vec<LatticePoint> = self.loops.iter().flatten().chain(&patch.interior).copied().collect();
        let is_flat = |corners: &&[u32; 3]| {
            let [a, b, c] = corners.map(|v| points[v as usize].map(|x| x as f64));
            corners.iter().any(|&v| v >= patch.border_count) && cross(sub(b, a), sub(c, a)) == [0.0; 3]
        };
        patch.triangles.iter().filter(is_flat).count()
    }
}

fn canonical(triangles: impl Iterator<Item = [u32; 3]>) -> Vec<[u32; 3]> {
    let mut sorted: Vec<[u32; 3]> = triangles
        .map(|mut t| {
            let k = (0..3).min_by_key(|&k| t[k]).unwrap();
            t.rotate_left(k);
            t
        })
        .collect();
    sorted.sort_unstable();
    sorted
}

/// Slides each vertex to the height of its wanted position.
struct Stay<'a>(&'a [Vec3]);

impl Slide for Stay<'_> {
    fn offset(&self, vertex: u32, point: Vec3, normal: Vec3) -> f64 {
        dot(sub(self.0[vertex as usize], point), normal)
    }
}

/// The smallest patch with a border.
fn triangle() -> Model {
    Model::new(&[[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [0.0, 60.0, 9.0]], &[[0, 1, 2]])
}

/// A disk, an annulus, a sheet with many holes, a cylinder, a torus with a hole, closed surfaces, several components.
fn models() -> Vec<Model> {
    let disk = Model::sheet(12, 7, [false, false], |_, _| false);
    let annulus = Model::sheet(7, 7, [false, false], |x, y| (2..5).contains(&x) && (2..5).contains(&y));
    let sieve = Model::sheet(13, 11, [false, false], |x, y| x % 3 == 1 && y % 3 == 1);
    let tube = Model::sheet(12, 5, [true, false], |_, _| false);
    let handle = Model::sheet(14, 9, [true, true], |x, y| x < 2 && y < 2);
    let torus = Model::sheet(12, 8, [true, true], |_, _| false);
    let sphere = Model::sphere(3);
    // One triangle with a vertex inside, and the same on a sphere.
    let cone = Model::new(
        &[[0.0, 0.0, 0.0], [90.0, 0.0, 0.0], [0.0, 90.0, 0.0], [30.0, 30.0, 20.0]],
        &[[0, 1, 3], [1, 2, 3], [2, 0, 3]],
    );
    assert_eq!((sieve.loops.len(), tube.loops.len(), handle.loops.len()), (13, 2, 1));
    assert!(torus.loops.is_empty() && sphere.loops.is_empty());
    let mix = handle.and(&sphere).and(&annulus).and(&torus);
    vec![triangle(), cone, disk, annulus, sieve, tube, handle, torus, Model::sphere(0), sphere, mix]
}

#[test]
fn every_topology_survives_the_round_trip() {
    for model in models() {
        model.round_trip();
    }
}

#[test]
fn random_triangulations_survive_the_round_trip() {
    for seed in 1..40 {
        Model::flipped(seed).round_trip();
    }
}

#[test]
fn vertices_that_coincide_do_not_disturb() {
    let mut model = Model::flipped(99);
    let point = model.interior[0];
    for p in &mut model.interior {
        *p = point;
    }
    for border in &mut model.loops {
        border.fill(point.map(|x| x as i64));
    }
    model.survives();
}

#[test]
fn no_triangle_loses_its_area_to_the_lattice() {
    // Pairs of neighbours that are nearer to each other than a step, alone or with a border vertex.
    for seed in 1..40 {
        let mut model = Model::flipped(seed);
        let border = model.loops.iter().flatten().count();
        let at = |model: &Model, v: usize| match v.checked_sub(border) {
            Some(inside) => model.interior[inside],
            None => model.loops.concat()[v].map(|x| x as f64),
        };
        for t in (0..model.triangles.len()).step_by(9) {
            let [a, b, _] = model.triangles[t].map(|v| v as usize);
            if let Some(inside) = a.checked_sub(border) {
                model.interior[inside] = at(&model, b).map(|x| x + 0.2);
            }
        }
        let (patch, _) = model.survives();
        assert_eq!(model.flat(&patch), 0, "{seed}");
    }
    // Closed surfaces that are smaller than a step.
    for rounds in 0..3 {
        let mut model = Model::sphere(rounds);
        for p in &mut model.interior {
            *p = p.map(|x| 5000.0 + (x - 5000.0) / 3000.0);
        }
        let (patch, _) = model.survives();
        assert_eq!(model.flat(&patch), 0, "{rounds}");
    }
}

#[test]
fn the_slide_decides_the_height() {
    struct Lift;
    impl Slide for Lift {
        fn offset(&self, _: u32, point: Vec3, normal: Vec3) -> f64 {
            (777.0 - point[2]) / normal[2]
        }
    }
    let points = [[0.0; 3], [300.0, 0.0, 0.0], [300.0, 300.0, 0.0], [0.0, 300.0, 0.0], [150.0, 150.0, 0.0]];
    let model = Model::new(&points, &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
    let target = PatchTarget { loops: &model.loops, interior: &model.interior, triangles: &model.triangles };
    let quantisation = Quantisation { normal_shift: 0, tangent_shift: 4 };
    let (patch, _) = encode_patch(&target, quantisation, &Lift, &mut SymbolBuffer::default()).unwrap();
    assert_eq!(patch.interior[0][2], 777);
    let (patch, order) =
        encode_patch(&target, quantisation, &Stay(&model.interior), &mut SymbolBuffer::default()).unwrap();
    assert_eq!((patch.interior[0][2], order), (0, vec![0]));
}

#[test]
fn truncated_streams_are_errors() {
    for model in [triangle(), Model::sheet(4, 4, [true, true], |x, y| x + y == 0), Model::sphere(1)] {
        let (symbols, ..) = model.encode();
        for length in 0..symbols.len() {
            let cut: SymbolBuffer = symbols.iter().take(length).collect();
            let result = decode_patch(&mut Replay::new(&cut), &model.loops, QUANTISATION, LIMITS);
            assert!(result.is_err());
        }
    }
}

/// Gives random values, small ones mostly, for a while.
struct Noise {
    random: Random,
    left: u32,
    /// Operations below this only.
    operations: usize,
}

impl SymbolSource for Noise {
    fn get(&mut self, context: Context) -> Result<u64, Violation> {
        self.left = self.left.checked_sub(1).ok_or(Violation(&"the end"))?;
        Ok(if (5..37).contains(&context) {
            self.random.below(self.operations) as u64
        } else if self.random.below(40) == 0 {
            self.random.next() << self.random.below(48)
        } else {
            self.random.below(6) as u64
        })
    }
}

#[test]
fn noise_gives_an_error_or_a_valid_patch() {
    let mut valid = 0;
    for model in models() {
        for seed in 1..200 {
            let operations = 2 + seed as usize % 5;
            let mut noise = Noise { random: Random(seed), left: 5000, operations };
            let limits = PatchLimits { vertices: 700, triangles: 1000 };
            if let Ok(patch) = decode_patch(&mut noise, &model.loops, QUANTISATION, limits) {
                let count = patch.border_count + patch.interior.len() as u32;
                assert!(u64::from(count) <= limits.vertices && patch.triangles.len() as u64 <= limits.triangles);
                assert!(patch.triangles.iter().flatten().all(|&v| v < count));
                valid += 1;
            }
        }
    }
    assert!(valid > 0);
}

#[test]
fn changed_symbols_never_panic() {
    let model = Model::sheet(8, 8, [false, false], |x, y| x == y && x % 2 == 1);
    let (symbols, ..) = model.encode();
    for k in 0..symbols.len() {
        for value in [0, 1, 3, 4, u64::MAX, u64::MAX - 1] {
            let change = |(i, (context, old))| (context, if i == k { value } else { old });
            let changed: SymbolBuffer = symbols.iter().enumerate().map(change).collect();
            let _ = decode_patch(&mut Replay::new(&changed), &model.loops, QUANTISATION, LIMITS);
        }
    }
}

#[test]
fn limits_hold() {
    let model = Model::sheet(6, 6, [false, false], |_, _| false);
    let (symbols, patch, _) = model.encode();
    let exact = PatchLimits { vertices: 49, triangles: 72 };
    let decode = |limits| decode_patch(&mut Replay::new(&symbols), &model.loops, QUANTISATION, limits);
    assert_eq!(decode(exact).unwrap(), patch);
    assert!(decode(PatchLimits { vertices: 48, ..exact }).is_err());
    assert!(decode(PatchLimits { triangles: 71, ..exact }).is_err());
    assert!(decode(PatchLimits { vertices: 20, ..exact }).is_err());
}

#[test]
fn the_encoder_refuses_what_is_no_manifold_and_writes_nothing() {
    let good = Model::sheet(4, 4, [false, false], |_, _| false);
    let mut broken = Vec::new();
    for change in 0..7 {
        let mut model = good.clone();
        match change {
            0 => model.triangles.push(model.triangles[3]),
            1 => model.triangles[5].swap(0, 1),
            2 => drop(model.triangles.remove(7)),
            3 => model.triangles[0][0] = 1000,
            4 => model.triangles[2] = [3, 3, 4],
            5 => model.interior.push([1.0; 3]),
            // Two tetrahedra that share a vertex.
            _ => {
                model = Model::default();
                model.interior = vec![[1.0; 3]; 7];
                let tetrahedron = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
                model.triangles.extend(tetrahedron);
                model.triangles.extend(tetrahedron.map(|t| t.map(|v| if v == 0 { 0 } else { v + 3 })));
            }
        }
        broken.push(model);
    }
    let mut far = good;
    far.interior[0][1] = 1e30;
    broken.push(far.clone());
    far.interior[0][1] = f64::NAN;
    broken.push(far);
    for (k, model) in broken.iter().enumerate() {
        let mut symbols = SymbolBuffer::default();
        symbols.put(3, 14);
        let target = PatchTarget { loops: &model.loops, interior: &model.interior, triangles: &model.triangles };
        let result = encode_patch(&target, QUANTISATION, &Stay(&model.interior), &mut symbols);
        assert!(result.is_err(), "model {k}");
        assert!(symbols.iter().eq([(3, 14)]));
    }
}
