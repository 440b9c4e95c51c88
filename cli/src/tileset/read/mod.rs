//! Tilesets of any maker as surfaces: 3D Tiles 1.0 and 1.1, with explicit and implicit tiles, at each depth of their
//! trees.
//!
//! A *level* is what a viewer draws that refines everything to a depth: tiles that are replaced are not drawn, tiles
//! that are added to stay, and tiles without content give way to their children. The error that a level claims is the
//! largest `geometricError` among its tiles that it does not refine, which 3D Tiles defines as what is wrong if a tile
//! is drawn and its children are not.
//!
//! Nothing is read but files in the folder of the tileset.

mod content;
mod files;
mod implicit;
mod lod;
mod terrain;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use glam::{DMat4, DVec3};
use serde::Deserialize;

use crate::import::ImportError;
use crate::mesh::Mesh;
use crate::progress::Progress;
use content::Reader;
use files::Files;
pub use lod::GltfLevels;
pub use terrain::Terrain;

/// Tiles that are read at most.
const MAX_TILES: usize = 4_000_000;
/// Tilesets that lead to each other, one below the other.
const MAX_NESTED: usize = 100;
/// Vertices and triangles are numbered with 32 bits.
const MAX_VERTICES: usize = u32::MAX as usize - 1;

/// Why a tileset cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// A file is not there, or cannot be read.
    #[error("{}: cannot be read; check that the tileset is complete", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file is damaged.
    #[error("{}: {problem}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// A file names one that is not in the folder of the tileset.
    #[error("{}: names {uri}, which is not in the folder of the tileset: only files there are read; download it, and name it by its path", path.display())]
    Elsewhere {
        /// The file that names it.
        path: PathBuf,
        /// The name, shortened.
        uri: String,
    },
    /// Tilesets lead to each other in a circle.
    #[error("{}: leads to {uri}, which leads back to it: such a tileset has no end", path.display())]
    Circle {
        /// The file.
        path: PathBuf,
        /// What it names.
        uri: String,
    },
    /// More than is read.
    #[error("{}: {what}", path.display())]
    Limit {
        /// The file.
        path: PathBuf,
        /// What there is too much of.
        what: String,
    },
    /// The content of a tile cannot be read.
    #[error(transparent)]
    Content(#[from] ImportError),
}

/// What a viewer draws of a tileset at once.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// The depth to which tiles are refined.
    pub depth: u32,
    /// The largest error that the tileset states for what is drawn, in the units of its coordinates.
    pub claimed: f64,
    /// Contents of tiles, by number.
    contents: Vec<(usize, usize)>,
}

/// The tree of a tileset.
pub struct Tileset {
    files: Files,
    tiles: Vec<Tile>,
}

struct Tile {
    /// From its content to the coordinates of the tileset.
    transform: DMat4,
    error: f64,
    /// Whether children are drawn beside it, not in its place.
    is_added_to: bool,
    /// Names of files, from the folder of the tileset.
    contents: Vec<String>,
    children: Vec<usize>,
    depth: u32,
    /// The axis of contents that points up, if it is not y.
    up: char,
}

#[derive(Deserialize)]
struct RawTileset {
    #[serde(default)]
    asset: RawAsset,
    root: RawTile,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawAsset {
    gltf_up_axis: Option<String>,
}

/// A tile as it is written. What is not needed is not looked at.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawTile {
    geometric_error: f64,
    refine: Option<String>,
    transform: Option<Vec<f64>>,
    content: Option<RawContent>,
    contents: Option<Vec<RawContent>>,
    #[serde(default)]
    children: Vec<RawTile>,
    implicit_tiling: Option<implicit::RawTiling>,
    #[serde(default)]
    extensions: RawExtensions,
}

#[derive(Default, Deserialize)]
struct RawExtensions {
    #[serde(rename = "3DTILES_implicit_tiling")]
    implicit_tiling: Option<implicit::RawTiling>,
    #[serde(rename = "3DTILES_multiple_contents")]
    multiple_contents: Option<RawContents>,
}

#[derive(Deserialize)]
struct RawContents {
    #[serde(alias = "contents")]
    content: Vec<RawContent>,
}

#[derive(Deserialize)]
struct RawContent {
    /// Version 1.0 of 3D Tiles and earlier ones call it url.
    #[serde(alias = "url")]
    uri: String,
}

impl RawTile {
    /// Names of all contents.
    fn uris(&mut self) -> Vec<String> {
        let several = self.contents.take().or_else(|| Some(self.extensions.multiple_contents.take()?.content));
        self.content.take().into_iter().chain(several.unwrap_or_default()).map(|content| content.uri).collect()
    }
}

/// A tileset whose tiles are still to be read.
struct Waiting {
    name: String,
    /// Tilesets that lead to it.
    above: Vec<String>,
    /// The tile that it hangs from.
    parent: Option<usize>,
}

/// Whether a file leads to the tiles of a tileset: it is JSON with a root, or an archive of 3D Tiles.
#[must_use]
pub fn is_tileset(path: &Path) -> bool {
    if files::is_archive(path) {
        return true;
    }
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    is_json && std::fs::read(path).is_ok_and(|bytes| serde_json::from_slice::<RootAlone>(without_mark(&bytes)).is_ok())
}

/// JSON without the byte order mark that some programs write before it.
fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)
}

#[derive(Deserialize)]
struct RootAlone {
    #[expect(dead_code, reason = "it only has to be there")]
    root: serde::de::IgnoredAny,
}

impl Tileset {
    /// Reads the tree of a tileset: all of its files but the contents of tiles.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let (files, first) = Files::open(path)?;
        let mut tileset = Self { files, tiles: vec![] };
        let mut waiting = vec![Waiting { name: first, above: vec![], parent: None }];
        while let Some(next) = waiting.pop() {
            let path = tileset.files.path(&next.name);
            if next.above.contains(&next.name) {
                let from = next.above.last().map_or(path, |last| tileset.files.path(last));
                return Err(ReadError::Circle { path: from, uri: next.name });
            }
            if next.above.len() >= MAX_NESTED {
                let what = format!("more than {MAX_NESTED} tilesets lead to each other, one below the other");
                return Err(ReadError::Limit { path, what });
            }
            let bytes = tileset.files.read(&next.name)?;
            let raw: RawTileset = serde_json::from_slice(without_mark(&bytes)).map_err(|error| ReadError::Damaged {
                path: path.clone(),
                problem: format!("is no tileset that can be read: {error}"),
            })?;
            let up = match raw.asset.gltf_up_axis.as_deref() {
                Some("Z" | "z") => 'z',
                Some("X" | "x") => 'x',
                _ => 'y',
            };
            tileset.add(raw.root, &next, up, &mut waiting)?;
        }
        Ok(tileset)
    }

    /// Adds the tiles of a file, and notes the tilesets that they lead to.
    fn add(&mut self, root: RawTile, file: &Waiting, up: char, waiting: &mut Vec<Waiting>) -> Result<(), ReadError> {
        let mut open = vec![(root, file.parent)];
        while let Some((mut raw, parent)) = open.pop() {
            let path = self.files.path(&file.name);
            let damaged = |problem: &str| ReadError::Damaged { path: path.clone(), problem: problem.to_owned() };
            let own = match raw.transform.as_deref().map(<[f64; 16]>::try_from) {
                None => DMat4::IDENTITY,
                Some(Ok(matrix)) if matrix.iter().all(|x| x.is_finite()) => DMat4::from_cols_array(&matrix),
                Some(_) => return Err(damaged("a transform is not 16 finite numbers")),
            };
            let above = parent.map(|parent| &self.tiles[parent]);
            let transform = above.map_or(DMat4::IDENTITY, |tile| tile.transform) * own;
            let is_added_to = match raw.refine.as_deref() {
                Some(refine) => refine.eq_ignore_ascii_case("ADD"),
                None => above.is_some_and(|tile| tile.is_added_to),
            };
            if !raw.geometric_error.is_finite() || raw.geometric_error < 0.0 {
                return Err(damaged("a geometricError is negative"));
            }
            let depth = above.map_or(0, |tile| tile.depth + 1);
            let tiling = raw.implicit_tiling.take().or(raw.extensions.implicit_tiling.take());
            let uris = raw.uris();
            let error = raw.geometric_error * largest_scale(&transform);
            let tile = Tile { transform, error, is_added_to, contents: vec![], children: vec![], depth, up };
            let number = self.push(tile, parent, &path)?;
            if let Some(tiling) = tiling {
                implicit::expand(self, number, &tiling, &uris, &file.name)?;
                continue;
            }
            for uri in uris {
                let name = self.files.resolve(&file.name, &uri)?;
                match files::extension_of(&name).as_deref() {
                    Some("json") => {
                        let above = file.above.iter().chain([&file.name]).cloned().collect();
                        waiting.push(Waiting { name, above, parent: Some(number) });
                    }
                    _ => self.tiles[number].contents.push(name),
                }
            }
            open.extend(raw.children.into_iter().map(|child| (child, Some(number))));
        }
        Ok(())
    }

    fn push(&mut self, tile: Tile, parent: Option<usize>, path: &Path) -> Result<usize, ReadError> {
        let number = self.tiles.len();
        if number >= MAX_TILES {
            let what = format!("the tileset has more than {MAX_TILES} tiles, which is more than are read");
            return Err(ReadError::Limit { path: path.to_owned(), what });
        }
        self.tiles.push(tile);
        if let Some(parent) = parent {
            self.tiles[parent].children.push(number);
        }
        Ok(number)
    }

    /// The levels at all depths, the coarsest first; of several that draw the same, the first.
    #[must_use]
    pub fn levels(&self) -> Vec<Level> {
        let deepest = self.tiles.iter().map(|tile| tile.depth).max().unwrap_or(0);
        let mut levels: Vec<Level> = vec![];
        for depth in 0..=deepest {
            let level = self.level(depth, |tile| tile.depth < depth);
            if !level.contents.is_empty() && levels.last().is_none_or(|last| last.contents != level.contents) {
                levels.push(level);
            }
        }
        levels
    }

    /// What is drawn where tiles are refined until they claim at most this error.
    #[must_use]
    pub fn within(&self, tolerance: f64) -> Level {
        self.level(0, |tile| tile.error > tolerance)
    }

    fn level(&self, depth: u32, is_refined: impl Fn(&Tile) -> bool) -> Level {
        let mut level = Level { depth, claimed: 0.0, contents: vec![] };
        let mut open: Vec<usize> = if self.tiles.is_empty() { vec![] } else { vec![0] };
        while let Some(number) = open.pop() {
            let tile = &self.tiles[number];
            let goes_on = !tile.children.is_empty() && (tile.contents.is_empty() || is_refined(tile));
            if goes_on {
                open.extend(&tile.children);
            }
            if !goes_on || tile.is_added_to {
                level.contents.extend((0..tile.contents.len()).map(|content| (number, content)));
            }
            if !goes_on && !tile.contents.is_empty() {
                level.claimed = level.claimed.max(tile.error);
            }
        }
        level.contents.sort_unstable();
        level
    }

    /// The triangles of a level, in the coordinates of the tileset.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn mesh(&self, level: &Level, progress: &dyn Progress) -> Result<Mesh, ReadError> {
        let notes = Notes::default();
        let mut reader = Reader { files: &self.files, notes: &notes, mesh: Mesh::default(), without: BTreeMap::new() };
        progress.begin("tiles", level.contents.len() as u64);
        for &(number, content) in &level.contents {
            let tile = &self.tiles[number];
            reader.read(&tile.contents[content], &tile.transform, tile.up)?;
            progress.advance(1);
        }
        for (kind, count) in &reader.without {
            progress.note(&format!("{count} contents of tiles {kind}: they have no surface, and are left out"));
        }
        let mesh = reader.mesh;
        notes.tell(progress);
        Ok(mesh)
    }
}

/// What is appended to is numbered with 32 bits.
fn append(
    all: &mut Mesh,
    points: impl Iterator<Item = DVec3>,
    triangles: &[[u32; 3]],
    path: &Path,
) -> Result<(), ReadError> {
    let first = all.positions.len();
    all.positions.extend(points);
    if all.positions.len() > MAX_VERTICES {
        let what = "a level has more than 2^32 vertices, which is more than are compared at once".to_owned();
        return Err(ReadError::Limit { path: path.to_owned(), what });
    }
    all.triangles.extend(triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first as u32)));
    Ok(())
}

/// The largest factor by which a transform stretches its axes.
fn largest_scale(transform: &DMat4) -> f64 {
    [transform.x_axis, transform.y_axis, transform.z_axis]
        .map(|axis| axis.truncate().length())
        .into_iter()
        .fold(0.0, f64::max)
}

/// Notes of many files, of which each is told once.
#[derive(Default)]
struct Notes(Mutex<BTreeMap<String, (String, u64)>>);

impl Notes {
    fn tell(&self, progress: &dyn Progress) {
        let Ok(all) = self.0.lock() else { return };
        for (text, (file, count)) in all.iter() {
            match count {
                1 => progress.note(&format!("{file}: {text}")),
                count => progress.note(&format!("{file} and {} others: {text}", count - 1)),
            }
        }
    }
}

impl Progress for Notes {
    fn begin(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _amount: u64) {}
    fn note(&self, text: &str) {
        let (file, text) = text.split_once(": ").unwrap_or(("", text));
        if let Ok(mut all) = self.0.lock() {
            all.entry(text.to_owned()).or_insert_with(|| (file.to_owned(), 0)).1 += 1;
        }
    }
}

#[cfg(test)]
mod tests;
