//! The tiles of a file: its roots at each of their levels, as a tree.

use lodpack::{Cut, File, LatticePoint, Node, ReadAt, Result};

/// A root at one of its levels.
#[derive(Clone, Debug)]
pub struct Tile {
    pub root: u32,
    pub level: u8,
    /// Certified, of the tile as it is drawn; no smaller than that of its children.
    pub error: f64,
    /// Triangles: of the block until the tile is drawn, then with its border.
    pub triangles: u32,
    /// Bytes of its content; 0 without triangles.
    pub bytes: u64,
    /// Box around what it and its children draw; none if that is nothing.
    pub bounds: Option<[LatticePoint; 2]>,
    /// What replaces it.
    pub children: Vec<usize>,
    /// Tiles below it, and itself.
    pub count: u64,
}

/// Tiles in a folder each, so that no folder gets too many files.
const TILES_IN_FOLDER: u32 = 1000;

impl Tile {
    /// The name of one of its files.
    pub fn uri(&self, ending: &str) -> String {
        format!("{}/{}-{}.{ending}", self.root / TILES_IN_FOLDER, self.root, self.level)
    }
}

/// All tiles.
#[derive(Clone, Debug)]
pub struct Tree {
    /// Each behind what it replaces.
    pub tiles: Vec<Tile>,
    /// Tiles that replace nothing.
    pub tops: Vec<usize>,
    /// The finest level of any tile, at which all borders are drawn.
    pub border_level: u8,
    /// To which all coordinates are relative: the middle of the file.
    pub origin: LatticePoint,
}

impl Tree {
    /// The tiles that reach a tolerance, or all.
    ///
    /// # Errors
    /// Those of reading the index.
    pub fn new<S: ReadAt>(file: &File<S>, tolerance: Option<f64>) -> Result<Self> {
        // Reads the whole index in few requests.
        file.summary()?;
        let tolerance = tolerance.unwrap_or(0.0);
        let mut tree = Self { tiles: vec![], tops: vec![], border_level: 0, origin: middle(file) };
        // The last tile of each root whose children are wanted; children have larger numbers than their parents.
        let mut open: std::collections::HashMap<u32, usize> = std::collections::HashMap::new();
        let mut deviations = vec![];
        for root in 0..file.root_count() {
            let mut above = match file.parent(root)? {
                None => None,
                Some(parent) => match open.get(&parent) {
                    None => continue,
                    found => found.copied(),
                },
            };
            let mut is_fine = false;
            for block in file.root_contents(root)?.blocks {
                let number = tree.tiles.len();
                match above {
                    Some(above) => tree.tiles[above].children.push(number),
                    None => tree.tops.push(number),
                }
                let (level, error, triangles) = (block.level, block.error, block.triangle_count);
                tree.tiles.push(Tile {
                    root,
                    level,
                    error,
                    triangles,
                    bytes: 0,
                    bounds: None,
                    children: vec![],
                    count: 1,
                });
                deviations.push(block.border_deviation);
                tree.border_level = tree.border_level.max(level);
                above = Some(number);
                // Borders are drawn at a finer level, unless this is the finest.
                is_fine = error
                    + if usize::from(level) + 1 < file.level_count() { block.border_deviation } else { 0.0 }
                    <= tolerance;
                if is_fine {
                    break;
                }
            }
            if let Some(last) = above.filter(|_| !is_fine) {
                open.insert(root, last);
            }
        }
        for (tile, deviation) in tree.tiles.iter_mut().zip(deviations) {
            if tile.level < tree.border_level {
                tile.error += deviation;
            }
        }
        Ok(tree)
    }

    /// The cut of some tiles, in this order.
    pub fn cut(&self, numbers: &[usize]) -> Cut {
        let node = |&number: &usize| Node { root: self.tiles[number].root, level: self.tiles[number].level };
        Cut { nodes: numbers.iter().map(node).collect(), ..Cut::default() }
    }

    /// The largest coordinate of a point relative to the origin, rounded up; both are in lattice steps.
    pub fn distance(&self, point: [f64; 3]) -> u64 {
        (0..3).map(|k| (point[k] - self.origin[k] as f64).abs().ceil() as u64 + 1).max().unwrap_or(0)
    }

    /// Once the tiles are drawn: boxes hold those of children, and errors are no smaller than theirs.
    pub fn settle(&mut self) {
        for number in (0..self.tiles.len()).rev() {
            let (above, below) = self.tiles.split_at_mut(number + 1);
            let Some(tile) = above.last_mut() else { continue };
            for child in tile.children.iter().map(|&child| &below[child - number - 1]) {
                tile.error = tile.error.max(child.error);
                tile.count += child.count;
                tile.bounds = union(tile.bounds, child.bounds);
            }
        }
    }
}

/// The box around two boxes.
pub fn union(a: Option<[LatticePoint; 2]>, b: Option<[LatticePoint; 2]>) -> Option<[LatticePoint; 2]> {
    let (Some([a0, a1]), Some([b0, b1])) = (a, b) else { return a.or(b) };
    Some([[0, 1, 2].map(|k| a0[k].min(b0[k])), [0, 1, 2].map(|k| a1[k].max(b1[k]))])
}

fn middle<S: ReadAt>(file: &File<S>) -> LatticePoint {
    let [low, high] = file.bounds().unwrap_or_default();
    file.lattice().units([0, 1, 2].map(|k| 0.5 * (low[k] + high[k]))).map(|units| units.round() as i64)
}
