//! Files of heights as 3D Tiles: the tiles of the file at one of their resolutions each.
//!
//! A viewer draws neighbours of different depths side by side, and a tile cannot know which: so skirts hang from its
//! borders, which reach below what a neighbour up to two depths coarser draws there. Each tile has an origin of its
//! own, because single precision does not reach from the middle of a globe to a metre on it. Samples in a projection
//! that is known go to their places on the globe one by one, and what the globe bends away from straight sides counts
//! as error.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;
use lodpack::heights::{Base, CELLS, DrawnTile, Grid, Heights, MOST_LEVEL, Ramp, Resolution, SIDE, TileId, TileValues};
use lodpack::{Lattice, LatticePoint, ReadAt};
use rayon::prelude::*;

use super::glb::{Content, Positions};
use super::material::Paint;
use super::tree::{Tile, Tree};
use super::{Projection, TilesetError, TilesetOptions, TilesetSummary, Written, finish, write};
use crate::heights::range_of;
use crate::mesh::draped::{opaque, padded};
use crate::mesh::shaded::Shading;
use crate::progress::Progress;

/// Tiles that a thread draws one after the other: neighbours, whose ancestors are decoded once.
const TILES_AT_ONCE: usize = 64;
/// A coarser resolution is drawn if its error is at most this many times that of the finest one: more triangles would
/// show next to nothing.
const NEARLY_FINEST: f64 = 1.25;
/// Lattice steps in the smallest error that is told apart from 0.
const STEPS_IN_ERROR: f64 = 64.0;
/// Bits of the largest coordinate in lattice steps.
const COORDINATE_BITS: i32 = 60;
/// A skirt reaches below what a tile this many depths above draws.
const DEPTHS_APART: usize = 2;
/// A tile this many depths above has sides of four times the length, which the globe bends away from sixteen times as
/// far.
const BENDS_IN_SKIRT: f64 = 17.0;
/// Texels along a side of the image over a tile: four a sample, and of one that has none below it more.
const TEXELS: u32 = 256;
const TEXELS_OF_LAST: u32 = 1024;
/// Metres: nowhere is the ellipsoid of WGS 84 curved more.
const LEAST_RADIUS: f64 = 6_335_000.0;

/// A tile of heights that is written.
struct Drawing {
    id: TileId,
    resolution: Resolution,
    /// The number of the tile above; none at the top.
    parent: Option<usize>,
    /// The error at which it would be drawn without a tolerance, at most.
    most: f64,
    /// How far its skirt hangs down.
    skirt: f64,
}

/// Where samples of a file are written.
struct Space<'a> {
    projection: Option<&'a Projection>,
    /// Whether down is towards the origin.
    is_globe: bool,
    lattice: Lattice,
}

/// Writes a file of heights as a tileset into a folder, which exists and is empty. With a projection the tileset is
/// earth-centred, in metres, and the frame of the options has to be that of such coordinates.
///
/// # Errors
/// [`TilesetError`].
pub fn write_terrain<S: ReadAt + Sync>(
    file: &Heights<S>,
    folder: &Path,
    options: &TilesetOptions,
    projection: Option<&Projection>,
    progress: &dyn Progress,
) -> Result<TilesetSummary, TilesetError> {
    progress.begin("index", 0);
    let (tree, drawings) = tiles_of(file, options.tolerance.unwrap_or(0.0))?;
    if tree.tops.is_empty() {
        return Err(TilesetError::Empty);
    }
    let mut bounds = bounds_of(file)?;
    if let Some(projection) = projection {
        let middle = projection.ecef([0, 1, 2].map(|k| 0.5 * (bounds[0][k] + bounds[1][k])));
        let reach = (0..3).map(|k| bounds[1][k] - bounds[0][k]).fold(0.0, f64::max) * projection.unit;
        bounds = [-reach, reach].map(|by| middle.map(|x| x + by));
    }
    let lattice = lattice_of(bounds, &drawings);
    let space = Space { projection, is_globe: projection.is_some() || file.surface().is_globe(), lattice };
    progress.begin("tiles", drawings.len() as u64);
    // Neighbours of a depth follow each other.
    let mut numbers: Vec<usize> = (0..drawings.len()).collect();
    numbers.sort_by_key(|&number| drawings[number].id.order(file.grid()));
    let draw_batch = |batch: &[usize]| -> Result<Vec<Written>, TilesetError> {
        let mut written = vec![];
        for &number in batch {
            written.extend(draw(file, folder, &tree.tiles[number], (number, &drawings[number]), &space)?);
            progress.advance(1);
        }
        Ok(written)
    };
    let written: Vec<Vec<Written>> = numbers.par_chunks(TILES_AT_ONCE).map(draw_batch).collect::<Result<_, _>>()?;
    finish(tree, written.into_iter().flatten(), &lattice, folder, &options.frame)
}

/// The tiles that reach a tolerance, or all; each before its children.
fn tiles_of<S: ReadAt>(file: &Heights<S>, tolerance: f64) -> Result<(Tree, Vec<Drawing>), TilesetError> {
    let mut tree = Tree { tiles: vec![], tops: vec![], border_level: 0, origin: [0; 3] };
    let mut drawings: Vec<Drawing> = vec![];
    let mut parents: HashMap<TileId, usize> = HashMap::new();
    let mut depth: Vec<TileId> = file.roots().to_vec();
    let mut level_count = 0;
    while !depth.is_empty() {
        let (mut next, mut numbers) = (vec![], HashMap::new());
        for id in depth {
            let Some(record) = file.record(id)? else { continue };
            let finest = record.finest_error();
            let is_enough = |resolution: &&Resolution| resolution.error <= (NEARLY_FINEST * finest).max(tolerance);
            let Some(&resolution) = record.resolutions.iter().find(is_enough) else { continue };
            let (number, parent) = (tree.tiles.len(), id.parent().and_then(|parent| parents.get(&parent)).copied());
            match parent {
                Some(parent) => tree.tiles[parent].children.push(number),
                None => tree.tops.push(number),
            }
            let ancestors = std::iter::successors(parent, |&above| drawings[above].parent).take(DEPTHS_APART);
            let coarsest = ancestors.map(|above| drawings[above].most).fold(resolution.error, f64::max);
            let (most, skirt) = (NEARLY_FINEST * finest, resolution.error + coarsest);
            drawings.push(Drawing { id, resolution, parent, most, skirt });
            tree.tiles.push(Tile {
                root: number as u32,
                level: id.depth as u8,
                error: resolution.error,
                triangles: resolution.triangle_count,
                bytes: 0,
                bounds: None,
                children: vec![],
                count: 1,
            });
            numbers.insert(id, number);
            level_count += u64::from(record.is_level);
            if resolution.error > tolerance && (!record.is_level || level_count <= MOST_LEVEL) {
                next.extend(record.child_tiles());
            }
        }
        (depth, parents) = (next, numbers);
    }
    Ok((tree, drawings))
}

/// A lattice in which the smallest error counts, around the middle of the file.
fn lattice_of([low, high]: [[f64; 3]; 2], drawings: &[Drawing]) -> Lattice {
    let origin = [0, 1, 2].map(|k| 0.5 * (low[k] + high[k]));
    let reach = (0..3).map(|k| high[k] - low[k]).fold(f64::MIN_POSITIVE, f64::max);
    let errors = drawings.iter().map(|drawing| drawing.resolution.error).filter(|&error| error > 0.0);
    let wanted = libm::log2(errors.fold(reach, f64::min) / STEPS_IN_ERROR).floor() as i32;
    let least = libm::log2(reach).ceil() as i32 - COORDINATE_BITS;
    Lattice { origin, step_log2: wanted.max(least).clamp(-100, 100) }
}

/// A box around what the coarsest tiles draw; finer ones may reach a little further.
///
/// # Errors
/// Those of reading the index.
pub fn bounds_of<S: ReadAt>(file: &Heights<S>) -> lodpack::Result<[[f64; 3]; 2]> {
    let surface = file.surface();
    let range = range_of(file)?.map(|height| height * surface.height_scale);
    let [low, high] = if range[0] <= range[1] { range } else { [0.0; 2] };
    Ok(match surface.base {
        Base::Ellipsoid { axis, .. } => [[-axis - high.abs(); 3], [axis + high.abs(); 3]],
        Base::Plane => {
            let last = [0, 1].map(|k| surface.first[k] + surface.spacing[k] * file.grid().cells()[k] as f64);
            let first = surface.first;
            [[first[0].min(last[0]), first[1].min(last[1]), low], [first[0].max(last[0]), first[1].max(last[1]), high]]
        }
    })
}

/// Draws and writes a tile; nothing if it shows nothing.
fn draw<S: ReadAt>(
    file: &Heights<S>,
    folder: &Path,
    tile: &Tile,
    (number, drawing): (usize, &Drawing),
    space: &Space,
) -> Result<Option<Written>, TilesetError> {
    let lattice = &space.lattice;
    let Some(values) = file.tile(drawing.id)? else { return Ok(None) };
    let drawn = file.draw(drawing.id, &values, drawing.resolution.tolerance);
    let unit = space.projection.map_or(1.0, |projection| projection.unit);
    let Skirted { places, samples, triangles, bend } = with_skirts(file.grid(), &drawn, drawing, space);
    let Some(&first) = places.first() else { return Ok(None) };
    let corners = places
        .iter()
        .fold([first; 2], |[low, high], p| [[0, 1, 2].map(|k| low[k].min(p[k])), [0, 1, 2].map(|k| high[k].max(p[k]))]);
    let units = |p: [f64; 3]| lattice.units(p).map(|units| units.round() as i64);
    let middle = units([0, 1, 2].map(|k| 0.5 * (corners[0][k] + corners[1][k])));
    let extent = corners.iter().flat_map(|&p| units(p).into_iter().zip(middle)).map(|(a, b)| a.abs_diff(b)).max();
    let positions = Positions::around(lattice, [0; 3], middle, extent.unwrap_or(0));
    if !positions.fits() {
        return Err(TilesetError::Size);
    }
    let points: Vec<LatticePoint> = places.iter().map(|&place| positions.on_lattice(place)).collect();
    let uri = tile.uri("glb");
    let shading = shading(file, (drawing.id, &values, &drawn), &samples, space)?;
    let paint = paint(file, drawing.id, &drawn, &samples, triangles.len())?;
    // An image has its own colours.
    let shading = if paint.is_some() { Shading { colours: None, ..shading } } else { shading };
    let content = Content::new(&points, &triangles, (paint.as_ref(), Some(&shading), None), &positions);
    let content = content.map_err(|source| TilesetError::Write { path: folder.join(&uri), source })?;
    let Some(glb) = &content.glb else { return Ok(None) };
    write(folder, &uri, glb)?;
    let error = tile.error * unit + bend + (0.5 * 3_f64.sqrt() + positions.rounding()) * lattice.step();
    let triangles = triangles.len().try_into().unwrap_or(u32::MAX);
    Ok(Some(Written { number, bounds: content.bounds, triangles, bytes: glb.len() as u64, error }))
}

/// What the drawn samples of a tile look like. A skirt has what is above it.
fn shading<S: ReadAt>(
    file: &Heights<S>,
    (id, values, drawn): (TileId, &TileValues, &DrawnTile),
    samples: &[usize],
    space: &Space,
) -> lodpack::Result<Shading> {
    let normals = file.normals(id, values)?;
    let normal = |&at: &usize| {
        let normal = DVec3::from_array(normals[at].map(f64::from)).normalize_or_zero();
        let Some(projection) = space.projection else { return normal };
        // The directions of the axes at the place.
        let place = drawn.position(at);
        let ecef = |place: [f64; 3]| DVec3::from_array(projection.ecef(place));
        let here = ecef(place);
        let along = |axis: usize| {
            let mut there = place;
            there[axis] += 1.0;
            (ecef(there) - here).normalize_or_zero()
        };
        (normal.x * along(0) + normal.y * along(1) + normal.z * along(2)).normalize_or_zero()
    };
    let colour = |ramp: &Ramp| samples.iter().map(|&at| ramp.colour(file.info().height(values.steps[at]))).collect();
    let normals = samples.iter().map(|at| normal(at).as_vec3().to_array()).collect();
    Ok(Shading { normals, colours: file.ramp().map(colour), ..Shading::default() })
}

/// The image over a tile, if there is one. A skirt has what is above it.
fn paint<S: ReadAt>(
    file: &Heights<S>,
    id: TileId,
    drawn: &DrawnTile,
    samples: &[usize],
    triangle_count: usize,
) -> lodpack::Result<Option<Paint>> {
    let has_finer = file.record(id)?.is_some_and(|record| record.children != 0);
    let most = if has_finer { TEXELS } else { TEXELS_OF_LAST };
    let Some(piece) = file.tile_image(id, most)? else { return Ok(None) };
    let piece = padded(piece, file.grid().ends(id), 2 * TEXELS_OF_LAST);
    let size = piece.image.size.map(f64::from);
    let place = |&at: &usize| {
        let (column, row) = (drawn.lines.columns[at % SIDE], drawn.lines.rows[at / SIDE]);
        let place = piece.place([column as f64, row as f64]);
        [0, 1].map(|axis| (place[axis] / size[axis]) as f32)
    };
    let places = samples.iter().map(place).collect();
    Ok(Some(Paint::of_image(opaque(&piece.image), places, triangle_count)))
}

/// The triangles of a tile, behind them its skirt.
struct Skirted {
    places: Vec<[f64; 3]>,
    /// The number of the sample that each vertex is, or hangs from.
    samples: Vec<usize>,
    triangles: Vec<[u32; 3]>,
    /// How far the globe bends away from the triangles.
    bend: f64,
}

fn with_skirts(grid: &Grid, drawn: &DrawnTile, drawing: &Drawing, space: &Space) -> Skirted {
    let tops = drawn.triangles(drawing.resolution.tolerance);
    let mut numbers = vec![u32::MAX; 2 * SIDE * SIDE];
    let (mut places, mut samples) = (vec![], vec![]);
    let mut longest = 0.0_f64;
    let at = |at: usize| {
        let place = drawn.position(at);
        space.projection.map_or(place, |projection| projection.ecef(place))
    };
    if space.projection.is_some() {
        for triangle in &tops {
            let corners = triangle.map(|corner| DVec3::from_array(at(corner.into())));
            let squares = [[0, 1], [1, 2], [2, 0]].map(|[a, b]| corners[a].distance_squared(corners[b]));
            longest = squares.into_iter().fold(longest, f64::max);
        }
    }
    let bend = longest / (8.0 * LEAST_RADIUS);
    let skirt = space.projection.map_or(1.0, |projection| projection.unit) * drawing.skirt + BENDS_IN_SKIRT * bend;
    let mut vertex = |corner: usize, is_low: bool| {
        let slot = &mut numbers[2 * corner + usize::from(is_low)];
        if *slot == u32::MAX {
            *slot = places.len() as u32;
            samples.push(corner);
            places.push(if is_low { lowered(at(corner), skirt, space.is_globe) } else { at(corner) });
        }
        *slot
    };
    let mut triangles: Vec<[u32; 3]> =
        tops.iter().map(|triangle| triangle.map(|corner| vertex(usize::from(corner), false))).collect();
    if skirt > 0.0 {
        for triangle in &tops {
            for k in 0..3 {
                let [a, b] = [triangle[k], triangle[(k + 1) % 3]].map(usize::from);
                if is_border(grid, drawn, a, b) {
                    let [top_a, top_b, low_a, low_b] =
                        [vertex(a, false), vertex(b, false), vertex(a, true), vertex(b, true)];
                    triangles.extend([[top_b, top_a, low_a], [top_b, low_a, low_b]]);
                }
            }
        }
    }
    Skirted { places, samples, triangles, bend }
}

/// Whether a side of a triangle is where another tile may begin: it runs along a border of the tile that is no border
/// of the grid.
fn is_border(grid: &Grid, drawn: &DrawnTile, a: usize, b: usize) -> bool {
    let lines = [(&drawn.lines.columns, a % SIDE, b % SIDE), (&drawn.lines.rows, a / SIDE, b / SIDE)];
    lines.into_iter().enumerate().any(|(axis, (lines, a, b))| {
        let is_end = (lines[a] == 0 || lines[a] == grid.cells()[axis]) && !(axis == 0 && grid.wraps());
        lines[a] == lines[b] && (lines[a] == lines[0] || lines[a] == lines[CELLS]) && !is_end
    })
}

/// A place moved down; on a globe towards its middle.
fn lowered(place: [f64; 3], by: f64, is_globe: bool) -> [f64; 3] {
    if !is_globe {
        return [place[0], place[1], place[2] - by];
    }
    let place = DVec3::from_array(place);
    (place - place.normalize_or_zero() * by).to_array()
}
