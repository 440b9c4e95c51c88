//! How an input is divided into regions: a k-d tree over the centroids of its triangles.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Cells along each axis of the grid in which centroids are counted.
const CELLS: usize = 128;
/// How often the centroids are visited: cells that hold too many triangles are counted again in finer grids.
const MAX_PASSES: u32 = 6;

/// How an input is divided into regions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Division {
    /// The most triangles in a region.
    pub triangles: u64,
    /// Whether boxes are cut in their middle, beginning with a cube about the origin whose size is a power of two. Such
    /// cuts do not depend on the input, so most of them stay when more is added. Otherwise boxes are cut where that
    /// halves their triangles, which makes fewer regions of more equal size.
    pub is_fixed: bool,
}

/// A k-d tree whose leaves are regions. It depends on the set of centroids and on the division, not on the order of the
/// centroids.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decomposition {
    nodes: Vec<Node>,
    region_count: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Node {
    Region(u32),
    /// A leaf without triangles.
    Empty,
    /// Centroids below `at` belong to the first child.
    Split {
        axis: usize,
        at: f64,
        children: [u32; 2],
    },
    /// A leaf that is not divided yet.
    Open,
}

/// A box whose triangles are still to be counted, and the leaf that stands for it.
#[derive(Clone, Debug)]
struct Open {
    node: usize,
    low: DVec3,
    high: DVec3,
}

/// A decomposition that is being made. It alternates between counting the triangles in open boxes, which can be done in
/// shares whose counts are added, and cutting these boxes.
#[derive(Clone, Debug)]
pub struct Cutting {
    tree: Decomposition,
    open: Vec<Open>,
    division: Division,
    pass: u32,
}

/// Triangles by cell of each open box: pairs of a cell and its count, without empty cells.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellCounts(Vec<Vec<(u32, u32)>>);

impl Division {
    /// Begins to divide a box.
    pub fn begin(self, bounds: [DVec3; 2]) -> Cutting {
        let [low, high] = if self.is_fixed { cube_about_origin(bounds) } else { bounds };
        let tree = Decomposition { nodes: vec![Node::Open], region_count: 0 };
        Cutting { tree, open: vec![Open { node: 0, low, high }], division: self, pass: 0 }
    }
}

impl Cutting {
    /// Counts some triangles, by their centroids.
    ///
    /// # Errors
    /// Those of `for_each_centroid`.
    pub fn count<E>(&self, for_each_centroid: &mut ForEachCentroid<'_, E>) -> Result<CellCounts, E> {
        let grids = self.counted(for_each_centroid)?;
        let cells = |grid: Grid| (0..).zip(grid.counts).filter(|&(_, count)| count > 0).collect();
        Ok(CellCounts(grids.into_iter().map(cells).collect()))
    }

    fn counted<E>(&self, for_each_centroid: &mut ForEachCentroid<'_, E>) -> Result<Vec<Grid>, E> {
        let mut grids: Vec<Grid> = self.open.iter().map(|o| Grid::new(o.low, o.high)).collect();
        for_each_centroid(&mut |centroid| {
            // There is almost always only one grid.
            if let Some(index) = self.tree.open_index(&self.open, centroid) {
                grids[index].count(centroid);
            }
        })?;
        Ok(grids)
    }

    /// Cuts the open boxes, given the counts of all triangles in shares. None if these counts are not of these boxes.
    pub fn cut(&mut self, shares: impl Iterator<Item = CellCounts>) -> Option<()> {
        let mut grids: Vec<Grid> = self.open.iter().map(|o| Grid::new(o.low, o.high)).collect();
        for CellCounts(share) in shares {
            if share.len() != grids.len() {
                return None;
            }
            for (grid, cells) in grids.iter_mut().zip(share) {
                for (cell, more) in cells {
                    let count = grid.counts.get_mut(cell as usize)?;
                    *count = count.saturating_add(more);
                }
            }
        }
        self.cut_grids(&grids);
        Some(())
    }

    fn cut_grids(&mut self, grids: &[Grid]) {
        let (division, may_open) = (self.division, self.pass + 1 < MAX_PASSES);
        let boxes = std::mem::take(&mut self.open);
        for (o, grid) in boxes.iter().zip(grids) {
            let whole = grid.within([[0; 3], [CELLS; 3]], division);
            self.tree.divide(o.node, grid, whole, division, may_open, &mut self.open);
        }
        self.pass += 1;
    }

    /// Counts and cuts until no box is open.
    ///
    /// # Errors
    /// Those of `for_each_centroid`, which is called a few times.
    pub fn finish<E>(mut self, for_each_centroid: &mut ForEachCentroid<'_, E>) -> Result<Decomposition, E> {
        while self.pass < MAX_PASSES && !self.open.is_empty() {
            let grids = self.counted(for_each_centroid)?;
            self.cut_grids(&grids);
        }
        self.tree.number();
        Ok(self.tree)
    }
}

/// Visits all centroids, in any order.
pub type ForEachCentroid<'a, E> = dyn FnMut(&mut dyn FnMut(DVec3)) -> Result<(), E> + 'a;

impl Decomposition {
    /// One region for everything.
    pub fn whole() -> Self {
        Self { nodes: vec![Node::Region(0)], region_count: 1 }
    }

    /// Divides the box until no region has too many triangles. Where very many centroids coincide, a region may keep
    /// more. Regions are numbered along the tree, so regions with neighbouring numbers lie near each other.
    ///
    /// # Errors
    /// Those of `for_each_centroid`, which is called a few times.
    pub fn new<E>(
        bounds: [DVec3; 2],
        division: Division,
        for_each_centroid: &mut ForEachCentroid<'_, E>,
    ) -> Result<Self, E> {
        division.begin(bounds).finish(for_each_centroid)
    }

    /// The number of regions.
    pub fn region_count(&self) -> u32 {
        self.region_count
    }

    /// The region of a triangle.
    pub fn region_of(&self, centroid: DVec3) -> u32 {
        match self.nodes[self.leaf(centroid)] {
            Node::Region(region) => region,
            _ => 0,
        }
    }

    fn leaf(&self, centroid: DVec3) -> usize {
        let mut node = 0;
        while let Node::Split { axis, at, children } = self.nodes[node] {
            node = children[usize::from(centroid[axis] >= at)] as usize;
        }
        node
    }

    fn open_index(&self, open: &[Open], centroid: DVec3) -> Option<usize> {
        let leaf = self.leaf(centroid);
        // Boxes are opened in the order of their nodes.
        open.binary_search_by_key(&leaf, |o| o.node).ok()
    }

    fn divide(
        &mut self,
        node: usize,
        grid: &Grid,
        cells: Cells,
        division: Division,
        may_open: bool,
        open: &mut Vec<Open>,
    ) {
        let count = grid.sum(cells);
        if count <= division.triangles {
            self.nodes[node] = if count == 0 && node > 0 { Node::Empty } else { Node::Region(0) };
            return;
        }
        let Some((axis, at)) = grid.plane(cells, division) else {
            let [low, high] = [cells[0], cells[1]].map(|corner| grid.corner(corner));
            // A cell without extent in double precision cannot be divided.
            if may_open && (high - low).min_element() > 0.0 {
                open.push(Open { node, low, high });
                open.sort_by_key(|o| o.node);
            } else {
                self.nodes[node] = Node::Region(0);
            }
            return;
        };
        let children = [self.nodes.len() as u32, self.nodes.len() as u32 + 1];
        self.nodes.extend([Node::Open; 2]);
        let mut corner = cells[0];
        corner[axis] = at;
        self.nodes[node] = Node::Split { axis, at: grid.corner(corner)[axis], children };
        for side in 0..2 {
            let mut half = cells;
            half[1 - side][axis] = at;
            self.divide(children[side] as usize, grid, grid.within(half, division), division, may_open, open);
        }
    }

    fn number(&mut self) {
        let mut pending = vec![0];
        while let Some(node) = pending.pop() {
            match &mut self.nodes[node] {
                Node::Split { children, .. } => pending.extend(children.iter().rev().map(|&child| child as usize)),
                Node::Empty => {}
                leaf => {
                    *leaf = Node::Region(self.region_count);
                    self.region_count += 1;
                }
            }
        }
    }
}

/// The smallest cube about the origin that contains a box and whose size is a power of two.
fn cube_about_origin([low, high]: [DVec3; 2]) -> [DVec3; 2] {
    let reach = low.abs().max(high.abs()).max_element();
    let mut half = f64::MIN_POSITIVE;
    while half < reach {
        half *= 2.0;
    }
    [DVec3::splat(-half), DVec3::splat(half)]
}

/// First cell and the one after the last, by axis.
type Cells = [[usize; 3]; 2];

/// Triangles by cell.
struct Grid {
    low: DVec3,
    size: DVec3,
    counts: Vec<u32>,
}

impl Grid {
    fn new(low: DVec3, high: DVec3) -> Self {
        Self { low, size: (high - low) / CELLS as f64, counts: vec![0; CELLS * CELLS * CELLS] }
    }

    fn count(&mut self, centroid: DVec3) {
        // The conversion saturates; along an axis without extent it turns NaN into cell 0.
        let cell = ((centroid - self.low) / self.size).to_array().map(|c| (c as usize).min(CELLS - 1));
        let count = &mut self.counts[index(cell)];
        *count = count.saturating_add(1);
    }

    fn corner(&self, cell: [usize; 3]) -> DVec3 {
        self.low + self.size * DVec3::from_array(cell.map(|c| c as f64))
    }

    /// Triangles by layer of some cells across an axis.
    fn layers(&self, [first, end]: Cells, axis: usize) -> Vec<u64> {
        let mut layers = vec![0; end[axis] - first[axis]];
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                for x in first[0]..end[0] {
                    layers[[x, y, z][axis] - first[axis]] += u64::from(self.counts[index([x, y, z])]);
                }
            }
        }
        layers
    }

    fn sum(&self, cells: Cells) -> u64 {
        self.layers(cells, 0).iter().sum()
    }

    /// The part of some cells that is worth dividing: the smallest box that holds all their triangles, unless cuts are
    /// fixed.
    fn within(&self, mut cells: Cells, division: Division) -> Cells {
        if division.is_fixed {
            return cells;
        }
        for axis in 0..3 {
            let layers = self.layers(cells, axis);
            let before = layers.iter().take_while(|&&count| count == 0).count();
            let behind = layers[before..].iter().rev().take_while(|&&count| count == 0).count();
            cells[0][axis] += before;
            cells[1][axis] -= behind;
        }
        cells
    }

    /// The plane across the longest side that halves the triangles best, or the middle one where cuts are fixed. None
    /// if there is only one cell.
    fn plane(&self, cells: Cells, division: Division) -> Option<(usize, usize)> {
        let [first, end] = cells;
        let extent = |axis: usize| (end[axis] - first[axis]) as f64 * self.size[axis];
        let axis = (0..3)
            .filter(|&axis| end[axis] - first[axis] > 1)
            .max_by(|&a, &b| extent(a).total_cmp(&extent(b)).then(b.cmp(&a)))?;
        if division.is_fixed {
            // The number of cells is a power of two.
            return Some((axis, first[axis].midpoint(end[axis])));
        }
        let layers = self.layers(cells, axis);
        let total: u64 = layers.iter().sum();
        let mut below = 0;
        let planes = layers[..layers.len() - 1].iter().enumerate().map(|(layer, &count)| {
            below += count;
            (below.abs_diff(total - below), layer + 1)
        });
        let (_, plane) = planes.min()?;
        Some((axis, first[axis] + plane))
    }
}

fn index([x, y, z]: [usize; 3]) -> usize {
    (z * CELLS + y) * CELLS + x
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    fn decompose(points: &[DVec3], triangles: u64) -> Decomposition {
        divide(points, Division { triangles, is_fixed: false })
    }

    fn divide(points: &[DVec3], division: Division) -> Decomposition {
        let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let visit = &mut |f: &mut dyn FnMut(DVec3)| -> Result<(), Infallible> {
            points.iter().for_each(|&p| f(p));
            Ok(())
        };
        match Decomposition::new([low, high], division, visit) {
            Ok(tree) => tree,
            Err(never) => match never {},
        }
    }

    fn sizes(tree: &Decomposition, points: &[DVec3]) -> Vec<u64> {
        let mut sizes = vec![0; tree.region_count() as usize];
        points.iter().for_each(|&p| sizes[tree.region_of(p) as usize] += 1);
        sizes
    }

    fn cloud(n: u32) -> Vec<DVec3> {
        (0..n)
            .map(|i| DVec3::new(f64::from(i * 7919 % n), f64::from(i * 104_729 % n) * 0.5, f64::from(i % 17)))
            .collect()
    }

    #[test]
    fn regions_are_below_the_limit_and_not_much_smaller() {
        let points = cloud(20_000);
        let tree = decompose(&points, 3000);
        let sizes = sizes(&tree, &points);
        assert!(sizes.iter().all(|&size| (1000..=3000).contains(&size)), "{sizes:?}");
    }

    #[test]
    fn the_order_of_the_points_does_not_matter() {
        let mut points = cloud(5000);
        let tree = decompose(&points, 700);
        points.reverse();
        assert_eq!(tree, decompose(&points, 700));
        assert_eq!(decompose(&points, 5000), Decomposition::whole());
    }

    #[test]
    fn counts_in_shares_cut_like_a_count_of_everything() {
        let points = cloud(5000);
        let bounds = [DVec3::splat(-1.0), DVec3::splat(6000.0)];
        let division = Division { triangles: 700, is_fixed: false };
        let of = |points: &[DVec3], f: &mut dyn FnMut(DVec3)| -> Result<(), Infallible> {
            points.iter().for_each(|&p| f(p));
            Ok(())
        };
        let whole = Decomposition::new(bounds, division, &mut |f| of(&points, f)).unwrap();
        let mut cutting = division.begin(bounds);
        let shares: Vec<CellCounts> =
            points.chunks(999).map(|some| cutting.count(&mut |f| of(some, f)).unwrap()).collect();
        cutting.cut(shares.into_iter()).unwrap();
        assert_eq!(cutting.finish(&mut |f| of(&points, f)).unwrap(), whole);
        assert!(division.begin(bounds).cut([CellCounts::default()].into_iter()).is_none(), "counts of no box");
    }

    #[test]
    fn a_crowd_in_one_cell_is_counted_again() {
        let mut points: Vec<DVec3> = cloud(3000).into_iter().map(|p| p * 1e-9).collect();
        points.push(DVec3::splat(1e3));
        let tree = decompose(&points, 500);
        assert!(sizes(&tree, &points).iter().all(|&size| size <= 500));
    }

    #[test]
    fn fixed_places_stay_when_points_are_added() {
        let mut points: Vec<DVec3> = cloud(20_000).into_iter().map(|p| p - DVec3::new(3000.0, -100.0, 8.0)).collect();
        let division = Division { triangles: 1000, is_fixed: true };
        let before = divide(&points, division);
        let sizes_before = sizes(&before, &points);
        assert!(sizes_before.iter().all(|&size| 0 < size && size <= 1000), "{sizes_before:?}");
        // Beside the others, and farther from the origin than any.
        let old = points.len();
        points.extend(cloud(5000).into_iter().map(|p| p + DVec3::new(40_000.0, 0.0, 0.0)));
        let after = divide(&points, division);
        let mut now_in = vec![vec![]; before.region_count() as usize];
        for &p in &points[..old] {
            now_in[before.region_of(p) as usize].push(after.region_of(p));
        }
        assert!(now_in.iter().all(|regions| regions.iter().all(|region| region == &regions[0])));
        assert!(after.region_count() > before.region_count());
        // Where some are added, boxes are halved.
        points.extend(cloud(2000).into_iter().map(|p| p * 0.01));
        assert!(sizes(&divide(&points, division), &points).iter().all(|&size| size <= 1000));
    }

    #[test]
    fn points_in_one_place_are_one_region() {
        let points = vec![DVec3::ONE; 100];
        assert_eq!(decompose(&points, 10).region_count(), 1);
    }
}
