//! The cells and vertices of a grid, up to some level.

use super::{
    GridShape, MAX_DEPTH, UNIT,
    edges::{Edges, Vertex},
};
use crate::{
    codec::patch::LatticePoint,
    error::{Error, Result},
};

/// A cell of a quad's tree. Its size is `UNIT >> depth`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GridCell {
    /// Which quad.
    pub quad: u16,
    /// 0 for a whole quad.
    pub depth: u8,
    /// Smallest x, a multiple of the size.
    pub x: u16,
    /// Smallest y, a multiple of the size.
    pub y: u16,
}

impl GridCell {
    /// Extent in x and y.
    pub fn size(self) -> u32 {
        UNIT >> self.depth
    }

    /// The four cells of the next depth, counter-clockwise from the smallest coordinates.
    pub fn children(self) -> [Self; 4] {
        let half = (self.size() / 2) as u16;
        [(0, 0), (half, 0), (half, half), (0, half)].map(|(dx, dy)| Self {
            depth: self.depth + 1,
            x: self.x + dx,
            y: self.y + dy,
            ..self
        })
    }

    /// The site of its middle, which is never on a side or a spoke.
    pub(super) fn middle_site(self) -> GridSite {
        let half = (self.size() / 2) as u16;
        GridSite { quad: self.quad, x: self.x + half, y: self.y + half }
    }

    /// Coordinates of the corners, counter-clockwise from the smallest.
    pub fn corners(self) -> [[u32; 2]; 4] {
        let (x, y, size) = (self.x as u32, self.y as u32, self.size());
        [[x, y], [x + size, y], [x + size, y + size], [x, y + size]]
    }
}

/// A point inside the disk where a vertex can be. Each has exactly one name, also on the spokes and at the centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GridSite {
    /// Which quad.
    pub quad: u16,
    /// Coordinate below [`UNIT`]: points on a side are border samples, not sites.
    pub x: u16,
    /// Coordinate below [`UNIT`]. It is 0 only at the centre, because the lower edge of quad i is the left edge of quad
    /// i - 1.
    pub y: u16,
}

/// The name of the vertex at some coordinates of a quad.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridVertexRef {
    /// On a side, at a parameter of 0 to 65535.
    Border {
        /// The side.
        side: usize,
        /// In 1/65536 of the side.
        param: u32,
    },
    /// Inside.
    Inner(GridSite),
}

impl GridVertexRef {
    /// Names the vertex at coordinates (x, y) of a quad, which are at most [`UNIT`].
    pub fn new(side_count: usize, quad: u16, [x, y]: [u32; 2]) -> Self {
        let before = side_before(quad, side_count);
        if y >= UNIT {
            Self::Border { side: quad as usize, param: UNIT - x.min(UNIT) }
        } else if x >= UNIT {
            Self::Border { side: before, param: UNIT + y }
        } else if x == 0 && y == 0 {
            Self::Inner(GridSite { quad: 0, x: 0, y: 0 })
        } else if y == 0 {
            Self::Inner(GridSite { quad: before as u16, x: 0, y: x as u16 })
        } else {
            Self::Inner(GridSite { quad, x: x as u16, y: y as u16 })
        }
    }
}

/// The side before side `quad`; it need not exist.
pub(super) fn side_before(quad: u16, side_count: usize) -> usize {
    let quad = usize::from(quad);
    // A division would take as long as all the rest of naming a vertex.
    if (1..=side_count).contains(&quad) { quad - 1 } else { (quad + side_count - 1) % side_count }
}

/// A cell of a quadtree with its surroundings, so that no search by coordinates is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct QuadNode {
    pub(super) cell: GridCell,
    /// Index of the first of four children; 0 for a leaf.
    pub(super) children: u32,
    /// The vertices at the corners, in the order of [`GridCell::corners`].
    pub(super) corners: [Vertex; 4],
    /// The edges from each corner to the next one.
    pub(super) edges: [u32; 4],
    /// The mean size of the residuals of the split that made this cell, and once it is split, of its own split.
    pub(super) magnitude: u64,
}

/// The cells and vertices of a grid up to one level: what the next finer level is coded against.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GridState {
    pub(super) side_count: usize,
    pub(super) shape: GridShape,
    pub(super) nodes: Vec<QuadNode>,
    /// In order of appearance, so a coarser level's vertices are a prefix of a finer level's.
    pub(super) positions: Vec<LatticePoint>,
    pub(super) sites: Vec<GridSite>,
    pub(super) edges: Edges,
    pub(super) centre_magnitude: u64,
}

impl GridState {
    /// How the inside is drawn.
    pub fn shape(&self) -> GridShape {
        self.shape
    }

    /// Positions of the interior vertices, coarser levels first.
    pub fn positions(&self) -> &[LatticePoint] {
        &self.positions
    }

    /// The sites of the interior vertices, in the order of [`Self::positions`].
    pub fn sites(&self) -> &[GridSite] {
        &self.sites
    }

    /// The cells that are split, coarser levels first.
    pub fn split_cells(&self) -> impl Iterator<Item = GridCell> + '_ {
        self.nodes.iter().filter(|node| node.children != 0).map(|node| node.cell)
    }

    /// The cells that are drawn.
    pub fn leaves(&self) -> impl Iterator<Item = GridCell> + '_ {
        self.nodes.iter().filter(|node| node.children == 0).map(|node| node.cell)
    }

    /// The state after further `splits`, without coding: for planning. A cell must come after the cell that it is part
    /// of. New vertices lie at the origin until [`Self::set_positions`] moves them.
    ///
    /// # Errors
    /// [`Error::Query`] if a split cell is not a leaf or too deep, the shape is coarser than before, or there are fewer
    /// than 3 sides.
    pub fn refined(mut self, side_count: usize, shape: GridShape, splits: &[GridCell]) -> Result<Self> {
        let refuse = |what: &str| Err(Error::Query { what: what.into() });
        if self.side_count == 0 {
            self.side_count = side_count;
        }
        if !(3..=super::MAX_SIDE_COUNT).contains(&side_count) || side_count != self.side_count || shape < self.shape {
            return refuse("a grid keeps its 3 to 4096 sides, and does not return to a coarser shape");
        }
        self.shape = shape;
        if shape >= GridShape::Fan && self.positions.is_empty() {
            self.insert(GridSite { quad: 0, x: 0, y: 0 }, [0; 3]);
        }
        if shape == GridShape::Quads && self.nodes.is_empty() {
            self.add_roots();
        }
        for &cell in splits {
            let Some(index) = self.leaf_node(cell.quad, [cell.x as u32, cell.y as u32]) else {
                return refuse("a split cell is in no quad of the grid");
            };
            if self.nodes[index].cell != cell || cell.depth >= MAX_DEPTH {
                return refuse("a split cell is not a leaf of the grid");
            }
            let mut middles = [Vertex::NONE; 4];
            for edge in 0..4 {
                middles[edge] = match self.edge_middle(index, edge) {
                    (GridVertexRef::Border { side, param }, _) => self.edges.border_vertex(side, param),
                    (GridVertexRef::Inner(site), None) => self.insert(site, [0; 3]),
                    (GridVertexRef::Inner(_), Some(middle)) => middle,
                };
            }
            let middle = self.insert(cell.middle_site(), [0; 3]);
            self.divide(index, middles, middle, 0);
        }
        Ok(self)
    }

    /// Moves the interior vertices. Positions beyond the last vertex are ignored; vertices without a position stay.
    pub fn set_positions(&mut self, positions: &[LatticePoint]) {
        for (position, &new) in self.positions.iter_mut().zip(positions) {
            *position = new;
        }
    }

    /// The number of each leaf, in the order of [`Self::leaves`]; for other nodes, the number of leaves before them.
    pub(super) fn leaf_numbers(&self) -> Vec<u32> {
        let mut count = 0;
        let number = |node: &QuadNode| {
            let number = count;
            count += (node.children == 0) as u32;
            number
        };
        self.nodes.iter().map(number).collect()
    }

    /// For each point (quad, and coordinates below [`UNIT`]), the number of the leaf that contains it, in the order of
    /// [`Self::leaves`]; none if the quad does not exist.
    pub fn leaves_at(&self, places: impl Iterator<Item = (u16, [u32; 2])>) -> Vec<Option<u32>> {
        let numbers = self.leaf_numbers();
        places.map(|(quad, at)| self.leaf_node(quad, at).map(|node| numbers[node])).collect()
    }

    /// The leaf of a quad's tree that contains a coordinate pair.
    fn leaf_node(&self, quad: u16, at: [u32; 2]) -> Option<usize> {
        let mut index = quad as usize;
        let mut node = self.nodes.get(index).filter(|_| index < self.side_count)?;
        while node.children != 0 {
            let half = node.cell.size() / 2;
            let right = at[0] >= node.cell.x as u32 + half;
            let upper = at[1] >= node.cell.y as u32 + half;
            let child = if upper { 3 - right as usize } else { right as usize };
            index = node.children as usize + child;
            node = self.nodes.get(index)?;
        }
        Some(index)
    }

    /// The quads, undivided. The centre is the first vertex.
    pub(super) fn add_roots(&mut self) {
        let (magnitude, count) = (self.centre_magnitude, self.side_count);
        let spokes = self.edges.add(count);
        for quad in 0..count {
            let before = side_before(quad as u16, count);
            let outer = self.edges.add(2);
            let node = QuadNode {
                cell: GridCell { quad: quad as u16, depth: 0, x: 0, y: 0 },
                children: 0,
                corners: [
                    Vertex::inner(0),
                    self.edges.border_vertex(before, UNIT),
                    self.edges.border_vertex(quad, 0),
                    self.edges.border_vertex(quad, UNIT),
                ],
                edges: [spokes + before as u32, outer, outer + 1, spokes + quad as u32],
                magnitude,
            };
            self.nodes.push(node);
        }
    }

    /// The name of the vertex at the middle of a leaf's edge and, for sites, the vertex itself if it exists.
    pub(super) fn edge_middle(&self, index: usize, edge: usize) -> (GridVertexRef, Option<Vertex>) {
        let node = &self.nodes[index];
        let corners = node.cell.corners();
        let (a, b) = (corners[edge], corners[(edge + 1) % 4]);
        let place = GridVertexRef::new(self.side_count, node.cell.quad, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
        (place, self.edges.halves(node.edges[edge]).map(|(middle, _)| middle))
    }

    /// Splits a leaf, given the vertices at the middles of its edges and at its own. `magnitude` is the mean size of
    /// their residuals. Returns the index of the first of four children.
    pub(super) fn divide(&mut self, index: usize, middles: [Vertex; 4], middle: Vertex, magnitude: u64) -> u32 {
        let children = self.nodes.len() as u32;
        let QuadNode { cell, corners: [a, b, c, d], edges, .. } = self.nodes[index];
        (self.nodes[index].children, self.nodes[index].magnitude) = (children, magnitude);
        let [p, q, r, s] = middles;
        // Halves are ordered by coordinate, whatever the direction of the edge around the cell.
        let [bottom, right, top, left] = [0, 1, 2, 3].map(|edge| self.edges.divide(edges[edge], middles[edge]));
        let spokes = self.edges.add(4);
        let [down, east, up, west] = [spokes, spokes + 1, spokes + 2, spokes + 3];
        let around = [
            ([a, p, middle, s], [bottom, down, west, left]),
            ([p, b, q, middle], [bottom + 1, right, east, down]),
            ([middle, q, c, r], [east, right + 1, top + 1, up]),
            ([s, middle, r, d], [west, up, top, left + 1]),
        ];
        let node = |(cell, (corners, edges))| QuadNode { cell, children: 0, corners, edges, magnitude };
        self.nodes.extend(cell.children().into_iter().zip(around).map(node));
        children
    }

    /// Adds a vertex at a site without one.
    pub(super) fn insert(&mut self, site: GridSite, position: LatticePoint) -> Vertex {
        let vertex = Vertex::inner(self.positions.len() as u32);
        self.sites.push(site);
        self.positions.push(position);
        vertex
    }

    /// The vertex at coordinates of a quad that do not lie on a side, if there is one.
    pub(super) fn inner_vertex(&self, quad: u16, at: [u32; 2]) -> Option<Vertex> {
        let node = &self.nodes[self.leaf_node(quad, at)?];
        let (cell, size) = (node.cell, node.cell.size());
        // A leaf contains its smallest coordinates but not its largest ones; those belong to other leaves with the same
        // edges.
        match [at[0] - u32::from(cell.x), at[1] - u32::from(cell.y)] {
            [0, 0] => Some(node.corners[0]),
            [along, 0] => self.edges.vertex_at(node.edges[0], size, along),
            [0, along] => self.edges.vertex_at(node.edges[3], size, along),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_quads_name_their_common_spoke_alike() {
        for quad in 0..5u16 {
            let after = (quad + 1) % 5;
            for t in [0, 1, 77, UNIT - 1, UNIT] {
                assert_eq!(GridVertexRef::new(5, quad, [0, t]), GridVertexRef::new(5, after, [t, 0]));
            }
        }
    }

    #[test]
    fn children_tile_their_cell() {
        let cell = GridCell { quad: 1, depth: 3, x: 4096, y: 8192 };
        let children = cell.children();
        assert_eq!(children[2].corners()[2], cell.corners()[2]);
        assert_eq!(children[0].corners()[2], children[2].corners()[0]);
        assert_eq!(children.map(GridCell::size), [cell.size() / 2; 4]);
    }
}
