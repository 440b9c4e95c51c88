//! The tileset's files of JSON: one, or one that leads to more where there are many tiles.

use super::ENTRY;
use super::tree::{Tile, Tree};
use lodpack::{Lattice, LatticePoint};
use serde_json::{Value, json};

/// Subtrees of fewer tiles stay in one file; those of more are divided at each power of this.
const TILES_IN_FILE: u64 = 512;
/// A file of fewer tiles is not worth a request.
const LEAST_TILES: u64 = 32;

/// From the file's coordinates to those of the tileset, which are metres, and have z up or are ECEF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Where the file's axes lead, as columns: unit vectors times the metres in a unit of the file.
    pub axes: [[f64; 3]; 3],
    /// Where the file's origin is.
    pub origin: [f64; 3],
}

impl Frame {
    /// The frame of a file without a place, whose unit counts as a metre.
    pub fn local(is_y_up: bool) -> Self {
        let axes = match is_y_up {
            true => [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
            false => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
        Self { axes, origin: [0.0; 3] }
    }

    /// Metres in a unit of the file.
    fn scale(&self) -> f64 {
        self.axes.iter().map(|axis| axis.iter().map(|c| c * c).sum::<f64>().sqrt()).fold(0.0, f64::max)
    }

    /// As 3D Tiles has it, column after column, with the tiles' coordinates relative to `middle`.
    fn matrix(&self, middle: [f64; 3]) -> [f64; 16] {
        let [x, y, z] = self.axes;
        let at = [0, 1, 2].map(|k| self.origin[k] + x[k] * middle[0] + y[k] * middle[1] + z[k] * middle[2]);
        let column = |axis: [f64; 3], last: f64| [axis[0], axis[1], axis[2], last];
        let columns = [column(x, 0.0), column(y, 0.0), column(z, 0.0), column(at, 1.0)];
        std::array::from_fn(|k| columns[k / 4][k % 4])
    }
}

/// Names and texts of all files.
pub fn tilesets(tree: &Tree, lattice: &Lattice, frame: &Frame) -> Vec<(String, String)> {
    let mut writer = Writer { tree, lattice, files: vec![] };
    let mut root = match tree.tops[..] {
        [top] => writer.tile(top, ""),
        _ => {
            let bounds = tree.tops.iter().fold(None, |bounds, &top| super::tree::union(bounds, tree.tiles[top].bounds));
            let children: Vec<Value> = tree.tops.iter().map(|&top| writer.tile(top, "")).collect();
            json!({"boundingVolume": writer.volume(bounds), "geometricError": writer.size(bounds), "children": children})
        }
    };
    root["refine"] = "REPLACE".into();
    root["transform"] = json!(frame.matrix(lattice.world(tree.origin)));
    let bounds = tree.tops.iter().fold(None, |bounds, &top| super::tree::union(bounds, tree.tiles[top].bounds));
    // Of not drawing it at all. Tiles' errors are in units of the file, since viewers apply the transform to them.
    let error = writer.size(bounds).max(root["geometricError"].as_f64().unwrap_or(0.0)) * frame.scale();
    writer.file(ENTRY.into(), error, &root);
    writer.files
}

struct Writer<'t> {
    tree: &'t Tree,
    lattice: &'t Lattice,
    files: Vec<(String, String)>,
}

impl Writer<'_> {
    fn file(&mut self, name: String, error: f64, root: &Value) {
        let asset = json!({"version": "1.1", "generator": concat!("lodpack ", env!("CARGO_PKG_VERSION"))});
        let text = json!({"asset": {"version": asset["version"], "extras": {"generator": asset["generator"]}}, "geometricError": error, "root": root});
        self.files.push((name, text.to_string()));
    }

    /// A tile with all below it. `up` leads from its file to the folder of the tileset.
    fn tile(&mut self, number: usize, up: &str) -> Value {
        let tile = &self.tree.tiles[number];
        let mut value = json!({"boundingVolume": self.volume(tile.bounds), "geometricError": tile.error});
        if tile.bytes > 0 {
            value["content"] = json!({"uri": format!("{up}{}", tile.uri("glb"))});
        }
        let children: Vec<Value> = tile.children.iter().map(|&child| self.child(tile, child, up)).collect();
        if !children.is_empty() {
            value["children"] = children.into();
        }
        value
    }

    /// A child, in the same file or in one of its own.
    fn child(&mut self, above: &Tile, number: usize, up: &str) -> Value {
        let tile = &self.tree.tiles[number];
        if tile.count < LEAST_TILES || order(tile.count) == order(above.count) {
            return self.tile(number, up);
        }
        let mut root = self.tile(number, "../");
        root["refine"] = "REPLACE".into();
        let name = tile.uri("json");
        self.file(name.clone(), tile.error, &root);
        json!({
            "boundingVolume": self.volume(tile.bounds), "geometricError": tile.error,
            "content": {"uri": format!("{up}{name}")},
        })
    }

    /// A box, relative to the tileset's origin. A tile that draws nothing has one at a point.
    fn volume(&self, bounds: Option<[LatticePoint; 2]>) -> Value {
        let [low, high] = bounds.unwrap_or([self.tree.origin; 2]);
        let step = self.lattice.step();
        let half = [0, 1, 2].map(|k| 0.5 * (high[k] - low[k]) as f64 * step);
        let middle = [0, 1, 2].map(|k| (low[k] - self.tree.origin[k]) as f64 * step + half[k]);
        json!({"box": [middle[0], middle[1], middle[2], half[0], 0.0, 0.0, 0.0, half[1], 0.0, 0.0, 0.0, half[2]]})
    }

    /// The diagonal of a box.
    fn size(&self, bounds: Option<[LatticePoint; 2]>) -> f64 {
        let [low, high] = bounds.unwrap_or_default();
        (0..3).map(|k| (high[k] - low[k]) as f64 * self.lattice.step()).map(|side| side * side).sum::<f64>().sqrt()
    }
}

/// How often a number can be divided by [`TILES_IN_FILE`].
fn order(count: u64) -> u32 {
    count.max(1).ilog(TILES_IN_FILE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// A complete tree of tiles with four children each.
    fn tree(levels: u32) -> Tree {
        let mut tree = Tree { tiles: vec![], tops: vec![0], border_level: levels as u8, origin: [0; 3] };
        let mut first = 0;
        for level in 0..levels {
            let count = 4_usize.pow(level);
            for k in 0..count {
                let next = first + count + 4 * k;
                let children = if level + 1 < levels { (next..next + 4).collect() } else { vec![] };
                let (root, level) = ((first + k) as u32, level as u8);
                let error = f64::from(levels - u32::from(level));
                let bounds = Some([[0; 3], [1; 3]]);
                tree.tiles.push(Tile { root, level, error, triangles: 1, bytes: 1, bounds, children, count: 1 });
            }
            first += count;
        }
        tree.settle();
        tree
    }

    /// Counts the contents below a tile of a file, and follows references.
    fn walk(files: &BTreeMap<String, Value>, name: &str, tile: &Value, found: &mut BTreeSet<String>) {
        if let Some(uri) = tile["content"]["uri"].as_str() {
            let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder);
            let path = match uri.strip_prefix("../") {
                Some(rest) => rest.to_owned(),
                None if folder.is_empty() => uri.to_owned(),
                None => format!("{folder}/{uri}"),
            };
            assert!(found.insert(path.clone()), "{path} twice");
            if path.ends_with(".json") {
                assert_eq!(files[&path]["root"]["geometricError"], tile["geometricError"]);
                return walk(files, &path, &files[&path]["root"], found);
            }
        }
        tile["children"].as_array().into_iter().flatten().for_each(|child| walk(files, name, child, found));
    }

    #[test]
    fn many_tiles_are_divided_among_files_and_each_is_found_once() {
        for (levels, most_files) in [(1, 1), (4, 1), (6, 5), (8, 70)] {
            let tree = tree(levels);
            let files = tilesets(&tree, &Lattice::default(), &Frame::local(false));
            assert!(files.len() <= most_files, "{levels}: {} files", files.len());
            let longest = files.iter().map(|(_, text)| text.len()).max().unwrap_or(0);
            assert!(longest < 250 * 1024, "{levels}: {longest} bytes");
            let count = files.len();
            let parse = |(name, text): (String, String)| (name, serde_json::from_str(&text).expect("JSON"));
            let files: BTreeMap<String, Value> = files.into_iter().map(parse).collect();
            let mut found = BTreeSet::new();
            walk(&files, ENTRY, &files[ENTRY]["root"], &mut found);
            assert_eq!(found.len(), tree.tiles.len() + count - 1);
        }
    }

    #[test]
    fn a_frame_turns_and_scales_about_the_origin() {
        let m = Frame { axes: [[0.0, 2.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 2.0]], origin: [10.0, 0.0, 0.0] };
        let matrix = m.matrix([1.0, 0.0, 3.0]);
        assert_eq!(matrix[12..], [10.0, 2.0, 6.0, 1.0]);
        assert_eq!((&matrix[..4], m.scale()), (&[0.0, 2.0, 0.0, 0.0][..], 2.0));
    }
}
