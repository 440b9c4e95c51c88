//! Screen tiles in an alternating k-d order (Niski 2007, section 7.2), whose borders follow the load (section 7.3).

use crate::{
    error::{Error, Result},
    select::Query,
};

/// A rectangle that is halved `depth` times, by turns from left to right and from bottom to top.
#[derive(Clone, Debug, PartialEq)]
pub struct TileTree {
    depth: u32,
    /// Of each inner node of the tree, the root first, then its halves, and so on: where its border lies, 0 to 1.
    splits: Vec<f64>,
}

/// No tile gets narrower than this fraction of the rectangle that it halves.
const MARGIN: f64 = 0.05;
/// Tiles beyond the number of processors only cost unification.
const MAX_DEPTH: u32 = 10;

impl TileTree {
    /// 2^depth equal tiles; depth at most 10.
    ///
    /// # Errors
    /// [`Error::Query`] if it is more.
    pub fn new(depth: u32) -> Result<Self> {
        if depth > MAX_DEPTH {
            return Err(Error::Query { what: format!("2^{depth} tiles are too many; ask for at most 2^{MAX_DEPTH}") });
        }
        Ok(Self { depth, splits: vec![0.5; (1 << depth) - 1] })
    }

    /// The number of tiles.
    pub fn tile_count(&self) -> usize {
        1 << self.depth
    }

    /// Left and lower, right and upper border of each tile, 0 to 1.
    pub fn tiles(&self) -> Vec<[[f64; 2]; 2]> {
        let mut tiles = vec![[[0.0, 0.0], [1.0, 1.0]]];
        for depth in 0..self.depth {
            let axis = depth as usize % 2;
            let first = (1_usize << depth) - 1;
            let halves = tiles.iter().zip(&self.splits[first..]).flat_map(|(&tile, split)| {
                let border = tile[0][axis] + (tile[1][axis] - tile[0][axis]) * split;
                let (mut left, mut right) = (tile, tile);
                (left[1][axis], right[0][axis]) = (border, border);
                [left, right]
            });
            tiles = halves.collect();
        }
        tiles
    }

    /// A query for each tile: its part of the view's window, and its share of the budgets.
    ///
    /// # Errors
    /// [`Error::Query`] if the query has no view.
    pub fn queries(&self, query: &Query) -> Result<Vec<Query>> {
        let Some(view) = query.view else {
            return Err(Error::Query { what: "only a query with a view can be divided into tiles".into() });
        };
        let [low, high] = view.window;
        let share = |budget: Option<u64>| budget.map(|budget| budget / self.tile_count() as u64);
        let of_tile = |tile: [[f64; 2]; 2]| {
            let window =
                tile.map(|at| [0, 1].map(|k| if at[k] == 1.0 { high[k] } else { low[k] + (high[k] - low[k]) * at[k] }));
            Query {
                view: Some(crate::select::View { window, ..view }),
                max_triangles: share(query.max_triangles),
                max_nodes: share(query.max_nodes),
                max_bytes: share(query.max_bytes),
                ..query.clone()
            }
        };
        Ok(self.tiles().into_iter().map(of_tile).collect())
    }

    /// Moves every border to where both sides would have taken equally long:
    ///
    /// > x_new = x_old time_right / (time_right x_old + time_left (1 - x_old)).
    ///
    /// `times` are those of the tiles, of any unit, in the order of [`TileTree::tiles`]; others than one for each, or
    /// than finite ones of zero or more, change nothing.
    pub fn rebalance(&mut self, times: &[f64]) {
        if times.len() != self.tile_count() || !times.iter().all(|time| *time >= 0.0 && time.is_finite()) {
            return;
        }
        let mut sums = times.to_vec();
        for depth in (0..self.depth).rev() {
            let first = (1_usize << depth) - 1;
            for (node, pair) in sums.chunks(2).enumerate() {
                let (old, left, right) = (self.splits[first + node], pair[0], pair[1]);
                if left > 0.0 || right > 0.0 {
                    let new = old * right / (right * old + left * (1.0 - old));
                    self.splits[first + node] = new.clamp(MARGIN, 1.0 - MARGIN);
                }
            }
            sums = sums.chunks(2).map(|pair| pair[0] + pair[1]).collect();
        }
    }
}
