//! Hierarchies without geometry: a square of quadtrees over a plane.

use std::sync::Arc;

use crate::{
    select::{Hierarchy, HierarchyNode, Resolution},
    tests::synthetic::Random,
};

/// A square of `size` by `size` quadtrees of side 1 in the plane z = 0, each with `depth` levels of children.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    pub size: u32,
    pub depth: u32,
    /// Resolutions of a root; a child's are denser by one level and as many.
    pub resolutions: u8,
    pub seed: u64,
    /// Deviations where neighbours are finer are up to this times the error.
    pub deviation: f64,
}

impl Default for Plane {
    fn default() -> Self {
        Self { size: 4, depth: 0, resolutions: 4, seed: 1, deviation: 0.5 }
    }
}

impl Plane {
    /// Cells along a side at the finest depth.
    pub(crate) fn cells(&self) -> u32 {
        self.size << self.depth
    }

    pub(crate) fn hierarchy(&self) -> Arc<Hierarchy> {
        let mut random = Random::new(self.seed);
        let cells = self.cells();
        let level_count = self.resolutions + self.depth as u8;
        // Error of each finest cell at level 0; a quarter per level.
        let roughness: Vec<f64> = (0..cells * cells).map(|_| 0.05 + random.unit() * random.unit()).collect();
        // Borders: edges of the finest cells, first along x, then along y.
        let edge = |x: u32, y: u32, along_y: bool| {
            let along_x_count = cells * (cells + 1);
            if along_y { along_x_count + x * cells + y } else { y * cells + x }
        };
        let border_count = 2 * cells * (cells + 1);
        let mut sample_counts = Vec::new();
        for _ in 0..border_count {
            let mut count = 0;
            for level in 0..level_count {
                count += random.below(1 + ((1 << level) >> self.depth)) as u32;
                sample_counts.push(count);
            }
        }
        let mut nodes = Vec::new();
        let mut places = Vec::new();
        // In blocks of four by four, as the roots of a file that follow each other are near each other.
        let mut roots: Vec<[u32; 2]> = (0..self.size * self.size).map(|k| [k % self.size, k / self.size]).collect();
        roots.sort_by_key(|&[x, y]| (y / 4, x / 4));
        for root in roots {
            self.add(None, 0, root, &mut nodes, &mut places);
        }
        for (node, &(depth, [x, y])) in nodes.iter_mut().zip(&places) {
            let side = 1 << (self.depth - depth);
            let (x, y) = (x * side, y * side);
            for k in 0..side {
                node.borders.extend([edge(x + k, y, false), edge(x + k, y + side, false)]);
                node.borders.extend([edge(x, y + k, true), edge(x + side, y + k, true)]);
            }
            let of_cells = (0..side * side).map(|k| roughness[((y + k / side) * cells + x + k % side) as usize]);
            let worst = of_cells.fold(0.0, f64::max);
            for resolution in 0..self.resolutions {
                let level = resolution + depth as u8;
                let error = worst * 0.25_f64.powi(i32::from(level));
                let border_deviation = if random.below(3) > 0 { error * self.deviation * random.unit() } else { 0.0 };
                node.resolutions.push(Resolution {
                    level,
                    error,
                    border_deviation,
                    // As dense as the level, on a part of the root.
                    triangle_count: 2 << (2 * resolution),
                    pages: vec![],
                });
            }
        }
        let mut page_bytes = Vec::new();
        for node in &mut nodes {
            for resolution in &mut node.resolutions {
                resolution.pages = vec![page_bytes.len() as u32];
                page_bytes.push(resolution.triangle_count * 2);
            }
        }
        Arc::new(Hierarchy::new(&nodes, sample_counts, level_count, page_bytes).unwrap())
    }

    fn add(
        &self,
        parent: Option<u32>,
        depth: u32,
        [x, y]: [u32; 2],
        nodes: &mut Vec<HierarchyNode>,
        places: &mut Vec<(u32, [u32; 2])>,
    ) {
        let side = 1.0 / f64::from(1_u32 << depth);
        let low = [f64::from(x) * side, f64::from(y) * side, -0.01];
        let bounds = [low, [low[0] + side, low[1] + side, 0.01]];
        let number = nodes.len() as u32;
        nodes.push(HierarchyNode { bounds, parent, ..HierarchyNode::default() });
        places.push((depth, [x, y]));
        if depth < self.depth {
            for k in 0..4 {
                self.add(Some(number), depth + 1, [2 * x + k % 2, 2 * y + k / 2], nodes, places);
            }
        }
    }
}
