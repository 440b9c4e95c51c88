//! Terrain tiles of any maker: quantized-mesh 1.0 in a folder with a `layer.json`, as triangles from the middle of the
//! earth.
//!
//! Tiles cover whole squares of degrees, so a level is cut off at the edges of what it is compared with: beyond them it
//! states nothing.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use glam::DVec3;
use rayon::prelude::*;
use serde::Deserialize;

use super::{ReadError, append, without_mark};
use crate::mesh::Mesh;
use crate::progress::Progress;
use crate::tileset::geodesy::Crs;
use crate::tileset::quantized::{LAST, LAYER, degrees_of, level_error};

/// Bytes of a tile at most, once it is unpacked.
const MAX_TILE_BYTES: u64 = 1 << 28;
/// Bytes before the vertices.
const HEADER: usize = 88;
/// Vertices beyond which numbers have 32 bits.
const SHORT: usize = 1 << 16;

/// A folder of terrain tiles.
pub struct Terrain {
    folder: PathBuf,
    is_from_south: bool,
    /// Columns and rows of the tiles that are there, by level.
    levels: BTreeMap<u32, Vec<[u64; 2]>>,
}

#[derive(Deserialize)]
struct RawLayer {
    #[serde(default)]
    format: String,
    projection: Option<String>,
    scheme: Option<String>,
    tiles: Option<Vec<String>>,
}

/// A triangle's corner: place in degrees, and in space.
#[derive(Clone, Copy)]
struct Corner {
    degrees: [f64; 2],
    place: DVec3,
}

impl Terrain {
    /// Finds the tiles that a `layer.json` leads to. None if the file is another one.
    ///
    /// # Errors
    /// [`ReadError`] if these tiles cannot be read.
    pub fn open(path: &Path) -> Result<Option<Self>, ReadError> {
        let is_layer = path.file_name().is_some_and(|name| name == LAYER);
        if !is_layer {
            return Ok(None);
        }
        let io = |source| ReadError::Io { path: path.to_owned(), source };
        let damaged = |problem: String| ReadError::Damaged { path: path.to_owned(), problem };
        let bytes = fs::read(path).map_err(io)?;
        let layer: RawLayer = serde_json::from_slice(without_mark(&bytes))
            .map_err(|error| damaged(format!("is no list of terrain tiles: {error}")))?;
        if !layer.format.starts_with("quantized-mesh") {
            return Err(damaged(format!("its tiles are {}, and only quantized-mesh-1.0 is read", layer.format)));
        }
        if layer.projection.as_deref().is_some_and(|name| name != "EPSG:4326") {
            return Err(damaged("its tiles are not squares of degrees (EPSG:4326), which alone are read".to_owned()));
        }
        if let Some(uri) = layer.tiles.iter().flatten().find(|name| name.contains("://") || name.starts_with('/')) {
            return Err(ReadError::Elsewhere { path: path.to_owned(), uri: uri.clone() });
        }
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        let is_from_south = layer.scheme.as_deref().is_none_or(|scheme| scheme == "tms");
        let mut levels: BTreeMap<u32, Vec<[u64; 2]>> = BTreeMap::new();
        // What is there counts, not what the list says.
        for (level, of_level) in numbered(&folder).map_err(io)? {
            let Ok(level) = u32::try_from(level) else { continue };
            for (x, column) in numbered(&of_level).map_err(io)? {
                let tiles = fs::read_dir(&column).map_err(io)?;
                let rows = tiles.flatten().filter_map(|entry| {
                    let name = entry.file_name().into_string().ok()?;
                    name.strip_suffix(".terrain")?.parse().ok()
                });
                levels.entry(level).or_default().extend(rows.map(|y: u64| [x, y]));
            }
        }
        levels.retain(|&level, tiles| level < 32 && !tiles.is_empty());
        levels.values_mut().for_each(|tiles| tiles.sort_unstable());
        if levels.is_empty() {
            return Err(damaged("no tiles as 0/0/0.terrain are beside it".to_owned()));
        }
        Ok(Some(Self { folder, is_from_south, levels }))
    }

    /// The levels that have tiles.
    #[must_use]
    pub fn levels(&self) -> Vec<u32> {
        self.levels.keys().copied().collect()
    }

    /// How far off Cesium takes a level to be, in metres: the format states no error.
    #[must_use]
    pub fn assumed_error(level: u32) -> f64 {
        level_error(level)
    }

    /// The triangles of a level in metres from the middle of the earth, cut off at the edges (west, south, east, north)
    /// of an area if there is one.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn mesh(&self, level: u32, within: Option<[f64; 4]>, progress: &dyn Progress) -> Result<Mesh, ReadError> {
        let side = degrees_of(level.min(62));
        let tiles = self.levels.get(&level).map(Vec::as_slice).unwrap_or_default();
        progress.begin("tiles", tiles.len() as u64);
        let of_tile = |&[x, y]: &[u64; 2]| -> Result<(PathBuf, Mesh), ReadError> {
            let path = self.folder.join(format!("{level}/{x}/{y}.terrain"));
            let row = if self.is_from_south { y as f64 } else { 180.0 / side - 1.0 - y as f64 };
            let first = [-180.0 + side * x as f64, -90.0 + side * row];
            let is_outside = |[west, south, east, north]: [f64; 4]| {
                let is_beside = |turn: f64| first[0] + turn > east || first[0] + turn + side < west;
                [-360.0, 0.0, 360.0].into_iter().all(is_beside) || first[1] > north || first[1] + side < south
            };
            let mesh = match within.is_some_and(is_outside) {
                true => Mesh::default(),
                false => triangles_of(&path, first, side, within)?,
            };
            progress.advance(1);
            Ok((path, mesh))
        };
        let meshes: Vec<(PathBuf, Mesh)> = tiles.par_iter().map(of_tile).collect::<Result<_, _>>()?;
        let mut all = Mesh::default();
        for (path, mesh) in meshes {
            append(&mut all, mesh.positions.into_iter(), &mesh.triangles, &path)?;
        }
        Ok(all)
    }
}

/// The folders in a folder whose names are numbers.
fn numbered(folder: &Path) -> io::Result<Vec<(u64, PathBuf)>> {
    let mut found = vec![];
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let number = entry.file_name().to_str().and_then(|name| name.parse().ok());
        found.extend(number.filter(|_| entry.path().is_dir()).map(|number| (number, entry.path())));
    }
    found.sort_unstable();
    Ok(found)
}

/// The triangles of a tile whose south-western corner and side are known in degrees.
fn triangles_of(path: &Path, first: [f64; 2], side: f64, within: Option<[f64; 4]>) -> Result<Mesh, ReadError> {
    let io = |source| ReadError::Io { path: path.to_owned(), source };
    let mut bytes = fs::read(path).map_err(io)?;
    if bytes.starts_with(&[0x1f, 0x8b]) {
        let mut unpacked = vec![];
        GzDecoder::new(bytes.as_slice()).take(MAX_TILE_BYTES).read_to_end(&mut unpacked).map_err(io)?;
        bytes = unpacked;
    }
    let problem =
        "is no tile of quantized-mesh: it ends too early, or numbers vertices that it has not; write it again";
    let (vertices, triangles) =
        decoded(&bytes).ok_or_else(|| ReadError::Damaged { path: path.to_owned(), problem: problem.to_owned() })?;
    let corners: Vec<Corner> = vertices
        .iter()
        .map(|&[u, v, height]| {
            let degrees = [first[0] + u * side, first[1] + v * side];
            Corner { degrees, place: DVec3::from_array(Crs::Geographic.ecef([degrees[0], degrees[1], height])) }
        })
        .collect();
    let Some(within) = within else {
        return Ok(Mesh { positions: corners.into_iter().map(|corner| corner.place).collect(), triangles });
    };
    // The same meridian may be called by another turn.
    let middle = first[0] + 0.5 * side;
    let turn = 360.0 * ((0.5 * (within[0] + within[2]) - middle) / 360.0).round();
    let edges = [within[0] - turn, within[1], within[2] - turn, within[3]];
    let mut mesh = Mesh::default();
    for triangle in triangles {
        let polygon = clipped(triangle.map(|at| corners[at as usize]), edges);
        let at = mesh.positions.len() as u32;
        mesh.positions.extend(polygon.iter().map(|corner| corner.place));
        mesh.triangles.extend((2..polygon.len() as u32).map(|k| [at, at + k - 1, at + k]));
    }
    Ok(mesh)
}

/// The part of a triangle between edges in degrees.
fn clipped(triangle: [Corner; 3], [west, south, east, north]: [f64; 4]) -> Vec<Corner> {
    let mut polygon = triangle.to_vec();
    for (axis, edge, sign) in [(0, west, 1.0), (1, south, 1.0), (0, east, -1.0), (1, north, -1.0)] {
        let inside = |corner: &Corner| sign * (corner.degrees[axis] - edge);
        let mut next = Vec::with_capacity(polygon.len() + 1);
        for (k, here) in polygon.iter().enumerate() {
            let there = &polygon[(k + 1) % polygon.len()];
            let (a, b) = (inside(here), inside(there));
            if a >= 0.0 {
                next.push(*here);
            }
            if a * b < 0.0 {
                let share = a / (a - b);
                let degrees = [0, 1].map(|k| here.degrees[k] + share * (there.degrees[k] - here.degrees[k]));
                next.push(Corner { degrees, place: here.place.lerp(there.place, share) });
            }
        }
        polygon = next;
    }
    if polygon.len() < 3 { vec![] } else { polygon }
}

/// Vertices as shares of the side and metres of height, and triangles. None if the bytes are damaged.
#[expect(clippy::type_complexity, reason = "a mesh in the tile's own coordinates")]
fn decoded(bytes: &[u8]) -> Option<(Vec<[f64; 3]>, Vec<[u32; 3]>)> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?));
    let [low, high] = [24, 28].map(|at| word(at).map(|bits| f64::from(f32::from_bits(bits))));
    let (low, high) = (low?, high?);
    let count = word(HEADER)? as usize;
    let start = HEADER + 4;
    let columns = bytes.get(start..start.checked_add(count.checked_mul(6)?)?)?;
    let column = |axis: usize| {
        let mut now = 0i32;
        let words = columns[2 * count * axis..2 * count * (axis + 1)].chunks_exact(2);
        let values = words.map(move |pair| {
            let word = i32::from(u16::from_le_bytes([pair[0], pair[1]]));
            now = now.wrapping_add((word >> 1) ^ -(word & 1));
            f64::from(now) / LAST
        });
        values.collect::<Vec<f64>>()
    };
    let [u, v, h] = [0, 1, 2].map(column);
    let vertices: Vec<[f64; 3]> = (0..count).map(|at| [u[at], v[at], low + h[at] * (high - low)]).collect();
    if !vertices.iter().flatten().all(|x| x.is_finite()) {
        return None;
    }
    let width = if count > SHORT { 4 } else { 2 };
    let at = (start + columns.len()).next_multiple_of(width);
    let triangle_count = word(at)? as usize;
    let codes = bytes.get(at + 4..(at + 4).checked_add(triangle_count.checked_mul(3 * width)?)?)?;
    let mut highest = 0u32;
    let mut number = |code: &[u8]| {
        let code = code.iter().rev().fold(0u32, |code, &byte| code << 8 | u32::from(byte));
        let number = highest.checked_sub(code)?;
        highest = highest.checked_add(u32::from(code == 0))?;
        ((number as usize) < count).then_some(number)
    };
    let triangles = codes.chunks_exact(3 * width).map(|three| {
        let mut corners = three.chunks_exact(width);
        Some([number(corners.next()?)?, number(corners.next()?)?, number(corners.next()?)?])
    });
    Some((vertices, triangles.collect::<Option<_>>()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of two triangles.
    fn tile() -> Vec<u8> {
        let mut bytes = vec![0; HEADER];
        bytes[24..28].copy_from_slice(&100f32.to_le_bytes());
        bytes[28..32].copy_from_slice(&200f32.to_le_bytes());
        bytes.extend(4u32.to_le_bytes());
        for column in [[0i32, 32767, 0, 32767], [0, 0, 32767, 32767], [0, 0, 0, 32767]] {
            let mut before = 0;
            for value in column {
                let delta = value - before;
                bytes.extend((((delta << 1) ^ (delta >> 31)) as u16).to_le_bytes());
                before = value;
            }
        }
        bytes.extend(2u32.to_le_bytes());
        for code in [0u16, 0, 0, 1, 3, 0] {
            bytes.extend(code.to_le_bytes());
        }
        bytes
    }

    #[test]
    fn a_tile_has_the_vertices_that_it_was_made_of() {
        let (vertices, triangles) = decoded(&tile()).expect("it is sound");
        assert_eq!(vertices, [[0.0, 0.0, 100.0], [1.0, 0.0, 100.0], [0.0, 1.0, 100.0], [1.0, 1.0, 200.0]]);
        assert_eq!(triangles, [[0, 1, 2], [2, 0, 3]]);
    }

    #[test]
    fn a_damaged_tile_is_refused_or_has_vertices_that_are_there_at_every_byte_and_length() {
        let sound = tile();
        for length in 0..sound.len() {
            assert!(decoded(&sound[..length]).is_none(), "{length}");
        }
        for at in 0..sound.len() {
            for value in [0, 1, 0x7f, 0x80, 0xff] {
                let mut bytes = sound.clone();
                bytes[at] = value;
                if let Some((vertices, triangles)) = decoded(&bytes) {
                    assert!(
                        triangles.iter().flatten().all(|&number| (number as usize) < vertices.len()),
                        "{at} {value}"
                    );
                }
            }
        }
    }

    #[test]
    fn triangles_are_cut_off_at_edges() {
        let corner = |x: f64, y: f64| Corner { degrees: [x, y], place: DVec3::new(x, y, 0.0) };
        let triangle = [corner(0.0, 0.0), corner(4.0, 0.0), corner(0.0, 4.0)];
        let area = |polygon: &[Corner]| -> f64 {
            (2..polygon.len())
                .map(|k| {
                    let [a, b, c] = [0, k - 1, k].map(|at| polygon[at].place);
                    0.5 * (b - a).cross(c - a).length()
                })
                .sum()
        };
        assert!((area(&clipped(triangle, [1.0, 1.0, 5.0, 5.0])) - 2.0).abs() < 1e-12);
        assert!((area(&clipped(triangle, [-1.0, -1.0, 9.0, 9.0])) - 8.0).abs() < 1e-12);
        assert_eq!(clipped(triangle, [5.0, 5.0, 9.0, 9.0]).len(), 0);
    }
}
