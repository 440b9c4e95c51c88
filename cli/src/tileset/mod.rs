//! Files as 3D Tiles 1.1, for the globes and viewers that read these: explicit tiles that mirror the file's own tree.
//!
//! A *tile* is a root at one of its levels. Its content is glTF with quantised and compressed triangles, its geometric
//! error is the certified error (3D Tiles asks for what a certificate is: the error, in metres, if the tile is drawn
//! and its children are not), and it is replaced by the finer levels of its root, then by the root's children. The
//! borders of all tiles are drawn with all samples that any tile has, so neighbours of any levels meet without a crack,
//! and no tile needs a skirt.

mod archive;
mod features;
mod finest;
mod geodesy;
mod glb;
mod joined;
mod json;
mod light;
mod material;
mod place;
mod quantized;
mod read;
mod terrain;
mod tree;

pub use archive::{ARCHIVE_EXTENSION, write_archive};
pub use joined::{folder_of, write_joined};
pub use json::Frame;
pub use place::{PlaceError, Placed, Projection, place};
pub use quantized::{LAYER, QuantizedSummary, is_on_wgs84, write_quantized};
pub use read::{GltfLevels, Level, ReadError, Terrain, Tileset, is_tileset};
pub use terrain::{bounds_of, write_terrain};

use crate::mesh::layers::{Layer, Look};
use crate::progress::Progress;
use features::Features;
use glb::{Content, Positions};
use light::BorderNormals;
use lodpack::decode::TexturedMesh;
use lodpack::{File, Lattice, LatticePoint, ReadAt};
use material::Surface;
use rayon::prelude::*;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::{fs, io};
use tree::Tree;

/// The name of the file that leads to all others.
pub const ENTRY: &str = "tileset.json";

/// Tiles that are decoded together: they share arcs, and their neighbours' index blocks.
const TILES_AT_ONCE: usize = 32;

/// Whether a name at the top of a folder may be that of something that [`write_tileset`] or [`write_quantized`] has
/// written.
pub fn is_product(name: &str) -> bool {
    name == ENTRY || name == LAYER || name.bytes().all(|digit| digit.is_ascii_digit())
}

/// What is written.
#[derive(Clone, Copy, Debug)]
pub struct TilesetOptions {
    /// Nothing finer is written where this error is met, in units of the file. By default everything is.
    pub tolerance: Option<f64>,
    /// From the file's coordinates to those of the tileset.
    pub frame: Frame,
    /// Whether tiles get images of what the surface looks like.
    pub with_channels: bool,
    /// Whether tiles get normals where the file stores none. Those of heights always do.
    pub with_normals: bool,
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TilesetSummary {
    /// Tiles with triangles.
    pub tiles: u64,
    /// Files of JSON: tileset.json, and those that it leads to.
    pub tilesets: u64,
    /// Of all tiles.
    pub triangles: u64,
    /// Those among them that borders at the finest samples, or skirts of heights, add.
    pub border_triangles: u64,
    /// Triangles of all tiles that nothing finer replaces.
    pub finest_triangles: u64,
    /// Largest certified error among these, in units of the file.
    pub certified_error: f64,
    /// Of all files.
    pub bytes: u64,
    /// Bytes of tileset.json and of the tiles that show everything at its coarsest, and how many files these are.
    pub first_picture_bytes: u64,
    /// See `first_picture_bytes`.
    pub first_picture_requests: u64,
}

/// Why a tileset cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TilesetError {
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] lodpack::Error),
    /// The tiles cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Single precision cannot hold it.
    #[error("the coordinates are beyond the range of single precision, which glTF has")]
    Size,
    /// There is nothing to write.
    #[error("the file is empty: there are no triangles to write")]
    Empty,
}

/// Writes a file as a tileset into a folder, which exists and is empty.
///
/// # Errors
/// [`TilesetError`].
pub fn write_tileset<S: ReadAt + Sync>(
    file: &File<S>,
    folder: &Path,
    options: &TilesetOptions,
    progress: &dyn Progress,
) -> Result<TilesetSummary, TilesetError> {
    progress.begin("index", 0);
    let mut tree = Tree::new(file, options.tolerance)?;
    if tree.tops.is_empty() {
        return Err(TilesetError::Empty);
    }
    let lattice = file.lattice();
    let extent = file.bounds().into_iter().flatten().map(|corner| tree.distance(lattice.units(corner))).max();
    let positions = Positions::new(&lattice, tree.origin, extent.unwrap_or(0));
    if !positions.fits() {
        return Err(TilesetError::Size);
    }
    tree.tiles.iter_mut().for_each(|tile| tile.error += positions.rounding() * lattice.step());
    let look = if options.with_channels { Look::of(file.channels(), true) } else { Default::default() };
    let needs_light = options.with_normals && !look.0.layers.contains(&Layer::Normal);
    let light = needs_light.then(|| BorderNormals::of(file, &tree, &positions, progress)).transpose()?;
    progress.begin("tiles", tree.tiles.len() as u64);
    let batches = batches_of(&tree, (0..tree.tiles.len()).collect());
    let writer = Writer { file, folder, tree: &tree, look: &look, light: light.as_ref(), positions: &positions };
    let write_batch = |batch: &Vec<usize>| writer.write(batch, progress);
    let written: Vec<Vec<Written>> = batches.par_iter().map(write_batch).collect::<Result<_, TilesetError>>()?;
    finish(tree, written.into_iter().flatten(), &lattice, folder, &options.frame)
}

/// Notes what tiles have become once they are written, and writes the files of JSON.
fn finish(
    mut tree: Tree,
    written: impl Iterator<Item = Written>,
    lattice: &Lattice,
    folder: &Path,
    frame: &Frame,
) -> Result<TilesetSummary, TilesetError> {
    let mut border_triangles = 0;
    for Written { number, bounds, triangles, bytes, error } in written {
        let tile = &mut tree.tiles[number];
        border_triangles += u64::from(triangles.saturating_sub(tile.triangles));
        (tile.bounds, tile.triangles, tile.bytes, tile.error) = (bounds, triangles, bytes, error);
    }
    tree.settle();
    let mut summary = summary_of(&tree, border_triangles);
    for (name, text) in json::tilesets(&tree, lattice, frame) {
        write(folder, &name, text.as_bytes())?;
        summary.tilesets += 1;
        summary.bytes += text.len() as u64;
        if name == ENTRY {
            summary.first_picture_bytes += text.len() as u64;
        }
    }
    Ok(summary)
}

/// A tile that is done.
struct Written {
    number: usize,
    bounds: Option<[LatticePoint; 2]>,
    triangles: u32,
    bytes: u64,
    /// Of the tile as it is drawn.
    error: f64,
}

/// Tiles that are decoded together. Those of a level that follow each other are near each other, and share arcs.
fn batches_of(tree: &Tree, mut numbers: Vec<usize>) -> Vec<Vec<usize>> {
    numbers.sort_by_key(|&number| (tree.tiles[number].level, tree.tiles[number].root));
    let levels = numbers.chunk_by(|&a, &b| tree.tiles[a].level == tree.tiles[b].level);
    levels.flat_map(|of_level| of_level.chunks(TILES_AT_ONCE)).map(<[usize]>::to_vec).collect()
}

/// What all tiles are written with.
struct Writer<'a, S> {
    file: &'a File<S>,
    folder: &'a Path,
    tree: &'a Tree,
    look: &'a (Look, Vec<u8>),
    light: Option<&'a BorderNormals>,
    positions: &'a Positions,
}

impl<S: ReadAt> Writer<'_, S> {
    /// Reads, decodes and writes tiles of one level, by ascending root.
    fn write(&self, numbers: &[usize], progress: &dyn Progress) -> Result<Vec<Written>, TilesetError> {
        let Self { file, folder, tree, .. } = *self;
        let cut = tree.cut(numbers);
        let (look, channels) = self.look;
        let (mesh, objects) = if file.objects().is_some() {
            file.extract_objects_with_borders(&cut, tree.border_level)?
        } else if channels.is_empty() {
            (file.extract_with_borders(&cut, tree.border_level)?, vec![])
        } else {
            Default::default()
        };
        let textured = if channels.is_empty() {
            TexturedMesh { mesh, ..TexturedMesh::default() }
        } else {
            file.extract_textured_with_borders(&cut, tree.border_level, channels)?
        };
        // A node's triangles follow each other.
        let mut begin = 0;
        let mut written = vec![];
        for (node, &number) in (0..).zip(numbers) {
            let of_node = textured.mesh.triangle_nodes[begin..].iter().take_while(|&&other| other == node);
            let own = begin..begin + of_node.count();
            begin = own.end;
            let count = own.len().try_into().unwrap_or(u32::MAX);
            let uri = tree.tiles[number].uri("glb");
            let of_own: Option<Vec<u32>> = objects.get(own.clone()).and_then(|all| all.iter().copied().collect());
            let cannot_write = |source| TilesetError::Write { path: folder.join(&uri), source };
            let of_own = of_own.unwrap_or_default();
            let surface = Surface::of_node(&textured, (own, &of_own), look, self.light, self.positions);
            let Surface { points, triangles, paint, shading, objects } = surface.map_err(cannot_write)?;
            let features = Features::of(file, objects)?;
            let looks = (paint.as_ref(), shading.as_ref(), features.as_ref());
            let content = Content::new(&points, &triangles, looks, self.positions).map_err(cannot_write)?;
            if let Some(glb) = &content.glb {
                write(folder, &uri, glb)?;
            }
            let bytes = content.glb.map_or(0, |glb| glb.len() as u64);
            let (bounds, error) = (content.bounds, tree.tiles[number].error);
            written.push(Written { number, bounds, triangles: count, bytes, error });
            progress.advance(1);
        }
        Ok(written)
    }
}

fn summary_of(tree: &Tree, border_triangles: u64) -> TilesetSummary {
    let mut summary = TilesetSummary { border_triangles, first_picture_requests: 1, ..TilesetSummary::default() };
    for tile in tree.tiles.iter().filter(|tile| tile.bytes > 0) {
        summary.tiles += 1;
        summary.triangles += u64::from(tile.triangles);
        summary.bytes += tile.bytes;
        if tile.children.is_empty() {
            summary.finest_triangles += u64::from(tile.triangles);
            summary.certified_error = summary.certified_error.max(tile.error);
        }
    }
    for &top in &tree.tops {
        summary.first_picture_requests += u64::from(tree.tiles[top].bytes > 0);
        summary.first_picture_bytes += tree.tiles[top].bytes;
    }
    summary
}

/// Writes a file into the folder, and the folder that it lies in.
fn write(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), TilesetError> {
    let path = folder.join(name);
    let folder = path.parent().unwrap_or(folder);
    let written = fs::create_dir_all(folder).and_then(|()| fs::write(&path, bytes));
    written.map_err(|source| TilesetError::Write { path, source })
}
