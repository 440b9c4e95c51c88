//! Properties of the grid filling over all its modules.

use std::collections::BTreeMap;

use super::*;
use crate::{
    codec::{
        entropy::{Replay, SymbolBuffer, SymbolSource, context::Context},
        filling::Slide,
    },
    error::Violation,
};

/// A bumpy disk over the regular n-gon, split deeper towards a corner, with border samples finer than the cells.
struct Bump {
    sides: usize,
    shape: GridShape,
    depth: u8,
}

impl Bump {
    fn corner(&self, i: usize) -> [f64; 2] {
        let angle = std::f64::consts::TAU * i as f64 / self.sides as f64;
        [1e5 * angle.cos(), 1e5 * angle.sin()]
    }

    fn lift([x, y]: [f64; 2]) -> [f64; 3] {
        [x, y, 2e4 * (x * 2e-5).sin() * (y * 3e-5).cos()]
    }

    fn side_point(&self, side: usize, param: u32) -> [f64; 2] {
        let (a, b, t) = (self.corner(side), self.corner(side + 1), param as f64 / 65536.0);
        [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
    }

    /// Samples down to an interval of 65536 >> depth, and some finer ones on the first side.
    fn border(&self) -> GridSides {
        let sample = |side, param| (param, Self::lift(self.side_point(side, param)).map(|c| c.round() as i64));
        let sides = (0..self.sides)
            .map(|side| {
                let step = 65536u32 >> self.depth;
                let mut params: Vec<u32> = (0..65536).step_by(step as usize).collect();
                if side == 0 {
                    params.extend([step / 4, step / 2, step + step / 2].into_iter().filter(|&p| p < 65536));
                    params.sort_unstable();
                    params.dedup();
                }
                params.into_iter().map(|param| sample(side, param)).collect()
            })
            .collect();
        GridSides { sides }
    }
}

impl GridTarget for Bump {
    fn shape(&self) -> GridShape {
        self.shape
    }

    fn is_split(&self, cell: GridCell) -> bool {
        cell.depth + 1 < self.depth && (cell.quad == 1 || cell.depth < 2 && cell.x < 20000)
    }

    fn position(&self, site: GridSite) -> [f64; 3] {
        let quad = site.quad as usize;
        let (s, t) = (site.x as f64 / UNIT as f64, site.y as f64 / UNIT as f64);
        let (a, c) = (self.side_point((quad + self.sides - 1) % self.sides, UNIT), self.side_point(quad, UNIT));
        let b = self.corner(quad);
        Self::lift([0, 1].map(|k| s * (1.0 - t) * a[k] + s * t * b[k] + (1.0 - s) * t * c[k]))
    }
}

impl Slide<GridSite> for Bump {
    fn offset(&self, site: GridSite, point: [f64; 3], normal: [f64; 3]) -> f64 {
        let target = self.position(site);
        (0..3).map(|k| (target[k] - point[k]) * normal[k]).sum()
    }
}

fn levels(sides: usize) -> Vec<Bump> {
    let level = |shape, depth| Bump { sides, shape, depth };
    vec![
        level(GridShape::Polygon, 0),
        level(GridShape::Fan, 1),
        level(GridShape::Quads, 1),
        level(GridShape::Quads, 3),
        level(GridShape::Quads, 5),
    ]
}

const QUANTISATION: Quantisation = Quantisation { normal_shift: 2, tangent_shift: 3 };

fn encode(sides: usize) -> (SymbolBuffer, Vec<GridState>) {
    let mut symbols = SymbolBuffer::default();
    let mut states: Vec<GridState> = vec![];
    for level in levels(sides) {
        let previous = states.last().cloned();
        states.push(encode_level(&level, previous, &level.border(), QUANTISATION, &mut symbols).unwrap());
    }
    (symbols, states)
}

#[test]
fn every_level_decodes_to_the_encoders_state() {
    for sides in [3, 4, 7] {
        let (symbols, states) = encode(sides);
        let mut replay = Replay::new(&symbols);
        let mut previous = None;
        for (level, expected) in levels(sides).iter().zip(&states) {
            let limits = GridLimits::default();
            let state = decode_level(&mut replay, previous, &level.border(), QUANTISATION, limits).unwrap();
            assert_eq!(&state, expected);
            previous = Some(state);
        }
        assert!(replay.get(0).is_err());
    }
}

#[test]
fn vertices_land_within_the_quantisation_steps() {
    let (_, states) = encode(5);
    let state = states.last().unwrap();
    for (site, position) in state.sites().iter().zip(state.positions()) {
        let target = Bump { sides: 5, shape: GridShape::Quads, depth: 5 }.position(*site);
        let d = [0, 1, 2].map(|k| target[k] - position[k] as f64);
        assert!(d.iter().map(|c| c * c).sum::<f64>().sqrt() < 0.5 * (4.0 + 32.0 + 32.0));
    }
}

#[test]
fn levels_are_nested() {
    for states in [encode(3).1, encode(6).1] {
        for pair in states.windows(2) {
            assert!(pair[1].positions().starts_with(pair[0].positions()));
            let finer: Vec<GridCell> = pair[1].split_cells().collect();
            assert!(pair[0].split_cells().all(|cell| finer.contains(&cell)));
        }
        assert!(states[4].positions().len() > 100);
    }
}

#[test]
fn patches_are_watertight_and_bounded_by_exactly_the_samples() {
    for sides in [3, 4, 7] {
        for (level, state) in levels(sides).iter().zip(encode(sides).1) {
            let border = level.border();
            let patch = state.patch(&border).unwrap();
            let sample_count: usize = border.sides.iter().map(Vec::len).sum();
            assert_eq!(patch.border_count as usize, sample_count);
            let mut edges: BTreeMap<(u32, u32), usize> = BTreeMap::new();
            for t in &patch.triangles {
                for k in 0..3 {
                    *edges.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
                }
            }
            assert!(edges.values().all(|&count| count == 1));
            let open: Vec<(u32, u32)> = edges.keys().filter(|e| !edges.contains_key(&(e.1, e.0))).copied().collect();
            let expected: Vec<(u32, u32)> =
                (0..patch.border_count).map(|i| (i, (i + 1) % patch.border_count)).collect();
            assert_eq!(open, expected);
            // A disk: every vertex is used, Euler's formula gives the triangle count.
            let vertex_count = patch.border_count as usize + patch.interior.len();
            assert_eq!(patch.triangles.len(), 2 * vertex_count - 2 - sample_count);
        }
    }
}

#[test]
fn a_state_refined_without_coding_has_the_same_cells_and_triangles() {
    for (level, expected) in levels(5).iter().zip(encode(5).1) {
        let splits: Vec<GridCell> = expected.split_cells().collect();
        let mut state = GridState::default().refined(5, expected.shape(), &splits).unwrap();
        let index = |site: &GridSite| expected.sites().iter().position(|s| s == site).unwrap();
        let positions: Vec<_> = state.sites().iter().map(|site| expected.positions()[index(site)]).collect();
        state.set_positions(&positions);
        let count = |state: &GridState| state.patch(&level.border()).unwrap().triangles.len();
        assert_eq!(count(&state), count(&expected));
        let (patch, starts) = expected.patch_by_cell(&level.border()).unwrap();
        assert_eq!(*starts.last().unwrap() as usize, patch.triangles.len());
        let inside = expected.leaves().map(|cell| (cell.quad, [cell.x as u32 + 1, cell.y as u32 + 1]));
        let found = expected.leaves_at(inside);
        assert!(found.iter().enumerate().all(|(i, leaf)| *leaf == Some(i as u32)));
        assert!(expected.leaves_at([(5, [0, 0])].into_iter()) == [None]);
    }
}

#[test]
fn sides_that_do_not_fit_are_refused() {
    let bump = Bump { sides: 4, shape: GridShape::Quads, depth: 0 };
    let mut symbols = SymbolBuffer::default();
    assert!(encode_level(&bump, None, &bump.border(), QUANTISATION, &mut symbols).is_err());
    let states = encode(4).1;
    assert!(states[4].patch(&bump.border()).is_err());
    assert!(states[4].patch(&GridSides::default()).is_err());
    let five = Bump { sides: 5, shape: GridShape::Quads, depth: 5 };
    assert!(states[4].patch(&five.border()).is_err());
    assert!(GridState::default().patch(&five.border()).is_err());
    let mut unsorted = five.border();
    unsorted.sides[2].reverse();
    assert!(encode_level(&five, None, &unsorted, QUANTISATION, &mut symbols).is_err());
}

/// Random symbols: mostly small, sometimes anything.
struct Garbage(u64);

impl SymbolSource for Garbage {
    fn get(&mut self, _context: Context) -> Result<u64, Violation> {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let value = self.0 >> 20;
        Ok(match value % 97 {
            0..=1 => value,
            2 => u64::MAX,
            3..=60 => value % 2,
            _ => 1,
        })
    }
}

#[test]
fn random_symbols_never_panic() {
    for seed in 0..300 {
        let mut source = Garbage(seed);
        let mut previous = None;
        for level in levels(3 + seed as usize % 4) {
            let limits = GridLimits { vertex_count: 2000 };
            let border = level.border();
            match decode_level(&mut source, previous, &border, QUANTISATION, limits) {
                Ok(state) => {
                    state.patch(&border).unwrap();
                    previous = Some(state);
                }
                Err(_) => break,
            }
        }
    }
}
