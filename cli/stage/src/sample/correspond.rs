//! Matches points of the drawn grid with points of the surface.

use glam::{DVec2, DVec3};
use lodpack::write::grid::{GridShape, GridSides, GridState, GridVertexRef, UNIT};

use super::{layout::coordinates_in_quad, tree::SurfacePoint, triangle};
use lodpack_mesh::{Adjacency, NONE, next_half_edge};

/// Steps from a triangle to its neighbours in search of a closer one.
const HOPS: usize = 3;
/// Triangles visited around one vertex at most.
const FAN: usize = 12;
/// A grid is fitted only if the cells that contain surface points have at most this many triangles on average. They
/// have more where a border of very many samples meets few cells; comparing all of those with all points takes
/// quadratic time and gains nothing.
const MEAN_TRIANGLES: usize = 64;
/// Number of points for a grid without cells; each is compared with all triangles.
const POINTS_WITHOUT_CELLS: usize = 300;

/// A surface point, matched with a level's triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Match {
    /// Index of the surface point.
    pub point: u32,
    /// The leaf that contains the point, or the last one that did.
    leaf: u32,
    pub triangle: u32,
    pub barycentric: DVec3,
}

/// The triangles of one level, and the surface points matched with them.
#[derive(Clone, Debug)]
pub(super) struct LevelMatches {
    state: GridState,
    sides: GridSides,
    border_vertices: Vec<GridVertexRef>,
    pub border: Vec<DVec3>,
    pub matches: Vec<Match>,
    /// Each matched point stands for this many points.
    pub stride: usize,
    /// Patch vertices: border samples, then interior vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl LevelMatches {
    /// Matches points by their parameters. Takes only every so-many-th point, so that each triangle gets about
    /// `points_per_triangle`.
    pub fn new(
        state: GridState,
        sides: GridSides,
        (border_vertices, border): (Vec<GridVertexRef>, Vec<DVec3>),
        points: &[SurfacePoint],
        points_per_triangle: usize,
    ) -> lodpack::Result<Self> {
        let (patch, starts) = state.patch_by_cell(&sides)?;
        let wanted = match state.shape() {
            GridShape::Quads => points_per_triangle.saturating_mul(patch.triangles.len()),
            _ => POINTS_WITHOUT_CELLS,
        };
        let stride = (points.len() / wanted.max(1)).max(1);
        let chosen = || (0..points.len()).step_by(stride);
        let mut level =
            Self { state, sides, border_vertices, border, matches: vec![], stride, triangles: patch.triangles };
        level.matches = if level.state.shape() == GridShape::Quads {
            let last = DVec2::splat((UNIT - 1) as f64);
            let sampled = chosen().map(|i| {
                let at = points[i].at.clamp(DVec2::ZERO, last);
                (points[i].quad, [at.x as u32, at.y as u32])
            });
            let leaves = level.state.leaves_at(sampled);
            let triangles_of = |&leaf: &u32| (starts[leaf as usize + 1] - starts[leaf as usize]) as usize;
            if leaves.iter().flatten().map(triangles_of).sum::<usize>() > MEAN_TRIANGLES * leaves.len() {
                return Err(lodpack::Error::Model { what: "a grid's cells have too many border samples".into() });
            }
            let matches = chosen().zip(leaves).filter_map(|(i, leaf)| {
                let leaf = leaf?;
                let range = starts[leaf as usize]..starts[leaf as usize + 1];
                let (triangle, barycentric) = level.by_parameters(range, points[i].quad as usize, points[i].at)?;
                Some(Match { point: i as u32, leaf, triangle, barycentric })
            });
            matches.collect()
        } else {
            chosen().map(|i| Match { point: i as u32, leaf: 0, triangle: 0, barycentric: DVec3::X }).collect()
        };
        Ok(level)
    }

    /// The triangle of a leaf that contains a point of its quad's square, and the weights of the point.
    fn by_parameters(&self, range: std::ops::Range<u32>, quad: usize, at: DVec2) -> Option<(u32, DVec3)> {
        let side_count = self.sides.sides.len();
        let coordinates = |vertex: u32| {
            let inner = (vertex as usize).checked_sub(self.border_vertices.len());
            let at_vertex = inner
                .map_or_else(|| self.border_vertices[vertex as usize], |i| GridVertexRef::Inner(self.state.sites()[i]));
            coordinates_in_quad(at_vertex, quad, side_count)
        };
        let mut best: Option<(f64, u32, DVec3)> = None;
        for index in range {
            let [a, b, c] = self.triangles[index as usize].map(coordinates);
            let (a, b, c) = (a?, b?, c?);
            let area = (b - a).perp_dot(c - a);
            let w = DVec3::new((c - b).perp_dot(at - b), (a - c).perp_dot(at - c), (b - a).perp_dot(at - a)) / area;
            let inside = w.min_element();
            if inside.is_finite() && best.is_none_or(|(least, ..)| inside > least) {
                best = Some((inside, index, w));
            }
        }
        best.map(|(_, index, w)| {
            let w = w.max(DVec3::ZERO);
            (index, w / (w.x + w.y + w.z))
        })
    }

    /// Position of a patch vertex.
    pub fn position(&self, interior: &[DVec3], vertex: u32) -> DVec3 {
        let index = vertex as usize;
        if index < self.border.len() { self.border[index] } else { interior[index - self.border.len()] }
    }

    /// Corner positions of a triangle.
    pub fn corners(&self, interior: &[DVec3], triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.position(interior, v))
    }

    /// Rebuilds the triangles after vertices have moved, and matches each point with the closest triangle near its old
    /// one.
    pub fn reproject(
        &mut self,
        interior: &[DVec3],
        lattice: impl Fn(DVec3) -> lodpack::LatticePoint,
        points: &[SurfacePoint],
    ) -> lodpack::Result<()> {
        let positions: Vec<_> = interior[..self.state.sites().len()].iter().map(|&p| lattice(p)).collect();
        self.state.set_positions(&positions);
        let (patch, starts) = self.state.patch_by_cell(&self.sides)?;
        self.triangles = patch.triangles;
        let adjacency = Adjacency::new(&self.triangles, self.border.len() + positions.len());
        let has_cells = self.state.shape() == GridShape::Quads;
        let mut leaf_of = vec![0; self.triangles.len()];
        for leaf in 0..starts.len() - 1 {
            leaf_of[starts[leaf] as usize..starts[leaf + 1] as usize].fill(leaf as u32);
        }
        let mut matches = std::mem::take(&mut self.matches);
        for found in &mut matches {
            let p = points[found.point as usize].position;
            let mut best = (f64::INFINITY, *found);
            let offer = |triangle: u32, best: &mut (f64, Match)| {
                let corners = self.corners(interior, triangle);
                let barycentric = triangle::closest(p, corners);
                let distance = triangle::at(corners, barycentric).distance_squared(p);
                if distance < best.0 * 0.9999 {
                    let leaf = leaf_of[triangle as usize];
                    *best = (distance, Match { triangle, barycentric, leaf, ..*found });
                    return true;
                }
                false
            };
            let leaf = found.leaf as usize;
            let range = if has_cells { starts[leaf]..starts[leaf + 1] } else { 0..self.triangles.len() as u32 };
            for triangle in range {
                offer(triangle, &mut best);
            }
            for _ in 0..HOPS {
                let centre = best.1;
                // A neighbour can be closer only if the closest point is on the triangle's rim.
                if centre.barycentric.min_element() > 0.0 || !has_cells {
                    break;
                }
                let mut moved = false;
                for corner in 0..3 {
                    if centre.barycentric[corner as usize] == 0.0 {
                        continue;
                    }
                    let mut half_edge = centre.triangle * 3 + corner;
                    for _ in 0..FAN {
                        let opposite = adjacency.opposite[half_edge as usize];
                        if opposite == NONE || opposite / 3 == centre.triangle {
                            break;
                        }
                        moved |= offer(opposite / 3, &mut best);
                        half_edge = next_half_edge(opposite);
                    }
                }
                if !moved {
                    break;
                }
            }
            *found = best.1;
        }
        self.matches = matches;
        Ok(())
    }
}
