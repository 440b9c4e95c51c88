//! Light for tiles of files that store no normals: those of SPEC.md, 14.4, since renderers show a mesh without them
//! flat, or without light.
//!
//! The fans of a vertex inside a tile are the tile's own. Those of a vertex on a border have triangles in several
//! tiles, of levels that nobody knows in advance, but every tile draws its borders with the same points. So there the
//! normals are those of the finest cut, whatever is drawn beside it, and light does not change along a border either,
//! but where a crease ends of which a coarse tile lacks a side.

use std::collections::{HashMap, HashSet};
use std::io;

use lodpack::{File, LatticePoint, ReadAt};
use rayon::prelude::*;

use super::glb::Positions;
use super::tree::Tree;
use super::{TilesetError, batches_of};
use crate::mesh::smooth::{Creases, Fans};
use crate::progress::Progress;

/// A fan of a tile takes the closest normal of the finest cut only if these are at most 60 degrees apart: the cosine.
const CLOSE: f32 = 0.5;
/// Batches whose rims wait to be joined.
const BATCHES_AT_ONCE: usize = 64;

/// The normals that the finest cut has at the points of borders.
#[derive(Clone, Debug, Default)]
pub struct BorderNormals {
    /// Those of each point follow each other: the first one, and how many there are.
    of_point: HashMap<LatticePoint, (u32, u32)>,
    normals: Vec<[f32; 3]>,
}

/// The rims of all finest tiles, joined where they meet.
#[derive(Default)]
struct Rims {
    numbers: HashMap<LatticePoint, u32>,
    points: Vec<LatticePoint>,
    on_border: Vec<bool>,
    triangles: Vec<[u32; 3]>,
}

impl Rims {
    fn add(&mut self, rim: &Rim) {
        let Self { numbers, points, on_border, triangles } = self;
        triangles.extend(rim.triangles.iter().map(|corners| {
            corners.map(|point| {
                let number = *numbers.entry(point).or_insert_with(|| {
                    points.push(point);
                    on_border.push(false);
                    points.len() as u32 - 1
                });
                on_border[number as usize] |= rim.points.contains(&point);
                number
            })
        }));
    }

    fn normals(self, origin: LatticePoint) -> io::Result<BorderNormals> {
        let Self { numbers, points, on_border, triangles } = self;
        drop(numbers);
        // Steps of the lattice are as long along every axis.
        let places: Vec<[f64; 3]> = points.iter().map(|p| [0, 1, 2].map(|k| (p[k] - origin[k]) as f64)).collect();
        let fans = Fans::new(&places, &triangles, Creases::Kept)?;
        let mut result = BorderNormals::default();
        let kept = fans.vertices.iter().zip(&fans.normals).filter(|(vertex, _)| on_border[**vertex as usize]);
        for (&vertex, &normal) in kept {
            let next = result.normals.len() as u32;
            result.of_point.entry(points[vertex as usize]).or_insert((next, 0)).1 += 1;
            result.normals.push(normal);
        }
        Ok(result)
    }
}

/// What a finest tile has beside its borders.
struct Rim {
    /// Points of its border.
    points: HashSet<LatticePoint>,
    /// All triangles that have one.
    triangles: Vec<[LatticePoint; 3]>,
}

impl BorderNormals {
    /// Decodes all tiles that nothing replaces, and keeps the normals along their borders.
    ///
    /// # Errors
    /// Those of reading the file; [`TilesetError::Write`] if borders have more than 2^32 corners of triangles.
    pub fn of<S: ReadAt + Sync>(
        file: &File<S>,
        tree: &Tree,
        positions: &Positions,
        progress: &dyn Progress,
    ) -> Result<Self, TilesetError> {
        let finest = |number: &usize| tree.tiles[*number].children.is_empty();
        let numbers: Vec<usize> = (0..tree.tiles.len()).filter(finest).collect();
        progress.begin("borders", numbers.len() as u64);
        let batches = batches_of(tree, numbers);
        let of_batch = |batch: &Vec<usize>| {
            let mesh = file.extract_with_borders(&tree.cut(batch), tree.border_level)?;
            progress.advance(batch.len() as u64);
            let tiles = mesh.triangle_nodes.chunk_by(|a, b| a == b);
            let mut rest = mesh.triangles.as_slice();
            let rims = tiles.map(|tile| {
                let own = rest.split_off(..tile.len()).unwrap_or_default();
                Rim::of(own, |vertex| positions.on_lattice(mesh.positions[vertex as usize]))
            });
            Ok(rims.collect::<Vec<_>>())
        };
        let mut rims = Rims::default();
        for wave in batches.chunks(BATCHES_AT_ONCE) {
            let of_wave: Vec<Vec<Rim>> = wave.par_iter().map(of_batch).collect::<Result<_, lodpack::Error>>()?;
            of_wave.iter().flatten().for_each(|rim| rims.add(rim));
        }
        let found = rims.normals(tree.origin);
        found.map_err(|source| TilesetError::Write { path: super::ENTRY.into(), source })
    }

    /// Gives the vertices of a tile that lie on borders the normals that all tiles have there. A border at the finest
    /// samples makes folds in a coarse tile. They are seen from behind, where renderers turn normals round, so theirs
    /// point inwards.
    pub fn settle(&self, points: &[LatticePoint], normals: &mut [[f32; 3]]) {
        for (point, normal) in points.iter().zip(normals) {
            let Some(&(first, count)) = self.of_point.get(point) else { continue };
            let range = first as usize..(first + count) as usize;
            let along = |other: &[f32; 3]| (0..3).map(|k| other[k] * normal[k]).sum::<f32>();
            let all = self.normals[range].iter().map(|other| (along(other), other));
            // Without a crease there is one alone, which counts however far off a coarse tile is.
            let close = all.filter(|(cosine, _)| count == 1 || cosine.abs() > CLOSE);
            if let Some((cosine, &other)) = close.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())) {
                *normal = if cosine < 0.0 { other.map(|x| -x) } else { other };
            }
        }
    }
}

impl Rim {
    fn of(triangles: &[[u32; 3]], point: impl Fn(u32) -> LatticePoint) -> Self {
        let sides = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let mut edges: Vec<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        let alone = edges.chunk_by(|a, b| a == b).filter(|edge| edge.len() == 1);
        let border: HashSet<u32> = alone.flat_map(|edge| edge[0]).collect();
        let touching = triangles.iter().filter(|corners| corners.iter().any(|vertex| border.contains(vertex)));
        Self {
            triangles: touching.map(|corners| corners.map(&point)).collect(),
            points: border.into_iter().map(&point).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tiles of a roof whose ridge, at x = 0, is their border. Both sides fall by `slope`.
    fn roof(slope: i64) -> BorderNormals {
        let at = |x: i64, y: i64| [x, y, -slope * x.abs()];
        let tile = |x: i64| {
            let points = [at(0, 0), at(x, 0), at(x, 10), at(0, 10)];
            let triangles = if x > 0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
            Rim::of(&triangles, |vertex| points[vertex as usize])
        };
        let mut rims = Rims::default();
        [tile(10), tile(-10)].iter().for_each(|rim| rims.add(rim));
        rims.normals([0; 3]).unwrap()
    }

    #[test]
    fn a_border_has_one_normal_where_it_is_smooth_and_two_on_a_crease() {
        let off = |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
        let settled = |roof: &BorderNormals, normal: [f32; 3]| {
            let mut normals = [normal];
            roof.settle(&[[0, 0, 0]], &mut normals);
            normals[0]
        };
        // Flat: every tile has what the other one has, however coarse.
        let flat = roof(0);
        assert_eq!(settled(&flat, [0.6, 0.0, 0.8]), [0.0, 0.0, 1.0]);
        assert_eq!(settled(&flat, [0.8, 0.0, 0.6]), [0.0, 0.0, 1.0]);
        // A fold.
        assert_eq!(settled(&flat, [0.6, 0.0, -0.8]), [-0.0, -0.0, -1.0]);
        let steep = roof(1);
        let side = 0.5_f32.sqrt();
        assert!(off(settled(&steep, [0.9, 0.0, 0.435_89]), [side, 0.0, side]) < 1e-6);
        assert!(off(settled(&steep, [-0.9, 0.0, 0.435_89]), [-side, 0.0, side]) < 1e-6);
        // Neither side has anything like it.
        assert_eq!(settled(&steep, [0.0, 1.0, 0.0]), [0.0, 1.0, 0.0]);
        // Other points are not on borders.
        let mut own = [[0.6, 0.0, 0.8]];
        steep.settle(&[[5, 5, -5]], &mut own);
        assert_eq!(own, [[0.6, 0.0, 0.8]]);
    }
}
