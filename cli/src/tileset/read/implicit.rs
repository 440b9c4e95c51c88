//! Implicit tiles: which ones there are follows from bits in files of subtrees (3D Tiles 1.1, "Implicit Tiling"; before
//! that an extension).

use serde::Deserialize;

use super::{ReadError, Tile, Tileset};

/// Tiles of a subtree at most: twelve levels of a quadtree.
const MAX_SUBTREE_TILES: u64 = 1 << 24;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct RawTiling {
    subdivision_scheme: String,
    subtree_levels: u32,
    #[serde(alias = "maximumLevel")]
    available_levels: u32,
    subtrees: RawUri,
}

#[derive(Deserialize)]
struct RawUri {
    uri: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawSubtree {
    #[serde(default)]
    buffers: Vec<RawBuffer>,
    #[serde(default)]
    buffer_views: Vec<RawView>,
    tile_availability: RawBits,
    #[serde(default)]
    content_availability: OneOrMany,
    child_subtree_availability: RawBits,
    #[serde(default)]
    extensions: RawSubtreeExtensions,
}

#[derive(Default, Deserialize)]
struct RawSubtreeExtensions {
    #[serde(rename = "3DTILES_multiple_contents")]
    multiple_contents: Option<RawMultiple>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawMultiple {
    content_availability: Vec<RawBits>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawBuffer {
    uri: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawView {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawBits {
    constant: Option<u8>,
    #[serde(alias = "bufferView")]
    bitstream: Option<usize>,
}

/// The extension has one, and 1.1 has a list.
#[derive(Deserialize)]
#[serde(untagged)]
enum OneOrMany {
    One(RawBits),
    Many(Vec<RawBits>),
}

impl Default for OneOrMany {
    fn default() -> Self {
        Self::Many(vec![])
    }
}

/// Bits, or the same one for all.
enum Bits {
    All(bool),
    These(Vec<u8>),
}

impl Bits {
    fn at(&self, index: u64) -> bool {
        match self {
            Self::All(value) => *value,
            Self::These(bytes) => bytes.get((index / 8) as usize).is_some_and(|byte| byte >> (index % 8) & 1 == 1),
        }
    }
}

/// What a subtree says.
struct Subtree {
    tiles: Bits,
    contents: Vec<Bits>,
    children: Bits,
}

/// A place in the tree: level, x, y and z.
type Place = [u64; 4];

/// A tiling whose subtrees are read.
struct Expansion<'a> {
    tiling: &'a RawTiling,
    /// Dimensions: 2 or 3.
    axes: u32,
    contents: &'a [String],
    /// The tileset that has it.
    name: &'a str,
    /// The error of its root.
    error: f64,
    last_level: u64,
}

/// Adds the tiles that a tile stands for. Their contents have names of this pattern.
pub(super) fn expand(
    tileset: &mut Tileset,
    root: usize,
    tiling: &RawTiling,
    contents: &[String],
    name: &str,
) -> Result<(), ReadError> {
    let path = tileset.files.path(name);
    let axes = match tiling.subdivision_scheme.as_str() {
        "QUADTREE" => 2,
        "OCTREE" => 3,
        _ => {
            let problem = "its implicit tiles are divided neither as a quadtree nor as an octree".to_owned();
            return Err(ReadError::Damaged { path, problem });
        }
    };
    let levels = u64::from(tiling.subtree_levels);
    let count = if levels * u64::from(axes) <= 30 { tile_count(axes, levels) } else { u64::MAX };
    if levels == 0 || count > MAX_SUBTREE_TILES {
        let what = format!("subtrees of {levels} levels have no tiles, or more than are read");
        return Err(ReadError::Limit { path, what });
    }
    let error = tileset.tiles[root].error;
    // Morton codes have 64 bits.
    let last_level = u64::from(tiling.available_levels).min(63 / u64::from(axes));
    let expansion = Expansion { tiling, axes, contents, name, error, last_level };
    let mut open = vec![([0; 4], root)];
    while let Some((place, tile)) = open.pop() {
        expansion.subtree(tileset, place, tile, &mut open)?;
    }
    Ok(())
}

/// Tiles of the given number of levels.
fn tile_count(axes: u32, levels: u64) -> u64 {
    ((1u64 << (u64::from(axes) * levels)) - 1) / ((1 << axes) - 1)
}

impl Expansion<'_> {
    /// Adds the tiles of a subtree, whose root is there already, and notes the subtrees below it.
    fn subtree(
        &self,
        tileset: &mut Tileset,
        root: Place,
        tile: usize,
        open: &mut Vec<(Place, usize)>,
    ) -> Result<(), ReadError> {
        let subtree = self.read(tileset, root)?;
        let mut depth = vec![(0u64, root, tile)];
        let levels = u64::from(self.tiling.subtree_levels);
        if !subtree.tiles.at(0) {
            return Ok(());
        }
        for level in 0..levels {
            let first = tile_count(self.axes, level);
            let mut below = vec![];
            for (morton, place, tile) in depth {
                for (pattern, bits) in self.contents.iter().zip(&subtree.contents) {
                    if bits.at(first + morton) {
                        let name = tileset.files.resolve(self.name, &filled(pattern, place))?;
                        tileset.tiles[tile].contents.push(name);
                    }
                }
                for (child, place) in self.children(morton, place) {
                    if place[0] > self.last_level {
                        continue;
                    }
                    let is_there = match level + 1 < levels {
                        true => subtree.tiles.at(tile_count(self.axes, level + 1) + child),
                        false => subtree.children.at(child),
                    };
                    if is_there {
                        let number = self.push(tileset, tile, place)?;
                        below.push((child, place, number));
                    }
                }
            }
            depth = below;
        }
        // Those of the level below are roots of subtrees.
        open.extend(depth.into_iter().map(|(_, place, tile)| (place, tile)));
        Ok(())
    }

    fn children(&self, morton: u64, [level, x, y, z]: Place) -> impl Iterator<Item = (u64, Place)> + use<> {
        let axes = self.axes;
        (0..1u64 << axes).map(move |k| {
            let bit = |axis: u32| if axis < axes { k >> axis & 1 } else { 0 };
            (morton << axes | k, [level + 1, 2 * x + bit(0), 2 * y + bit(1), 2 * z + bit(2)])
        })
    }

    fn push(&self, tileset: &mut Tileset, parent: usize, place: Place) -> Result<usize, ReadError> {
        let above = &tileset.tiles[parent];
        let error = self.error / (1u64 << place[0]) as f64;
        let (transform, is_added_to, up, depth) = (above.transform, above.is_added_to, above.up, above.depth + 1);
        let tile = Tile { transform, error, is_added_to, contents: vec![], children: vec![], depth, up };
        let path = tileset.files.path(self.name);
        tileset.push(tile, Some(parent), &path)
    }

    fn read(&self, tileset: &Tileset, place: Place) -> Result<Subtree, ReadError> {
        let files = &tileset.files;
        let name = files.resolve(self.name, &filled(&self.tiling.subtrees.uri, place))?;
        let bytes = files.read(&name)?;
        let damaged = |problem: String| ReadError::Damaged { path: files.path(&name), problem };
        let number = |at: usize| -> Option<usize> {
            u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?).try_into().ok()
        };
        let (text, binary) = match bytes.starts_with(b"subt") {
            false => (bytes.as_slice(), &[][..]),
            true => {
                let parts = number(8).zip(number(16)).and_then(|(text, binary)| {
                    let middle = text.checked_add(24)?;
                    Some((bytes.get(24..middle)?, bytes.get(middle..middle.checked_add(binary)?)?))
                });
                parts.ok_or_else(|| damaged("ends before its subtree does; copy it again".to_owned()))?
            }
        };
        let raw: RawSubtree =
            serde_json::from_slice(text).map_err(|error| damaged(format!("its subtree is damaged: {error}")))?;
        let bits = |of: &RawBits, count: u64| -> Result<Bits, ReadError> {
            let Some(view) = of.bitstream else { return Ok(Bits::All(of.constant == Some(1))) };
            let view = raw.buffer_views.get(view).ok_or_else(|| damaged(format!("has no buffer view {view}")))?;
            let buffer =
                raw.buffers.get(view.buffer).ok_or_else(|| damaged(format!("has no buffer {}", view.buffer)))?;
            let outer;
            let buffer = match &buffer.uri {
                None => binary,
                Some(uri) => {
                    outer = files.read(&files.resolve(&name, uri)?)?;
                    &outer
                }
            };
            let range = view.byte_offset..view.byte_offset.saturating_add(view.byte_length);
            let bytes = buffer.get(range).filter(|bytes| bytes.len() as u64 >= count.div_ceil(8));
            let bytes = bytes.ok_or_else(|| damaged("has fewer bits of availability than tiles".to_owned()))?;
            Ok(Bits::These(bytes.to_vec()))
        };
        let levels = u64::from(self.tiling.subtree_levels);
        let count = tile_count(self.axes, levels);
        let contents = match (&raw.extensions.multiple_contents, &raw.content_availability) {
            (Some(multiple), _) => multiple.content_availability.iter().map(|of| bits(of, count)).collect(),
            (None, OneOrMany::Many(many)) => many.iter().map(|of| bits(of, count)).collect(),
            (None, OneOrMany::One(one)) => bits(one, count).map(|bits| vec![bits]),
        }?;
        let children = bits(&raw.child_subtree_availability, 1 << (u64::from(self.axes) * levels))?;
        Ok(Subtree { tiles: bits(&raw.tile_availability, count)?, contents, children })
    }
}

/// A pattern with the numbers of a tile.
fn filled(pattern: &str, [level, x, y, z]: Place) -> String {
    let mut text = pattern.to_owned();
    for (name, value) in [("{level}", level), ("{x}", x), ("{y}", y), ("{z}", z)] {
        text = text.replace(name, &value.to_string());
    }
    text
}
