//! The content of a tile: glTF, or the formats of 3D Tiles 1.0 around it (b3dm, i3dm, cmpt).

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DMat4, DVec3};
use serde::Deserialize;

use super::files::Files;
use super::{Notes, ReadError, append};
use crate::import::{ImportError, import_bytes};
use crate::mesh::Mesh;
use crate::tileset::geodesy::up_east_north_at;

/// Contents within each other: a composite may hold composites.
const MAX_NESTED: usize = 16;

/// Reads contents into one mesh.
pub struct Reader<'a> {
    pub files: &'a Files,
    pub notes: &'a Notes,
    pub mesh: Mesh,
    /// How many contents have no surface, by what they are.
    pub without: BTreeMap<&'static str, u64>,
}

/// What a feature table says of instances.
#[derive(Default, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE", default)]
struct Features {
    rtc_center: Option<Numbers>,
    instances_length: Option<u64>,
    position: Option<At>,
    position_quantized: Option<At>,
    quantized_volume_offset: Option<[f64; 3]>,
    quantized_volume_scale: Option<[f64; 3]>,
    normal_up: Option<At>,
    normal_right: Option<At>,
    normal_up_oct32p: Option<At>,
    normal_right_oct32p: Option<At>,
    scale: Option<At>,
    scale_non_uniform: Option<At>,
    east_north_up: bool,
}

/// Where numbers begin in the binary part.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "camelCase")]
struct At {
    byte_offset: usize,
}

/// Numbers as they are, or where they begin.
#[derive(Deserialize)]
#[serde(untagged)]
enum Numbers {
    Here([f64; 3]),
    There(At),
}

impl Reader<'_> {
    /// Adds the content of a file.
    pub fn read(&mut self, name: &str, transform: &DMat4, up: char) -> Result<(), ReadError> {
        let path = self.files.path(name);
        let bytes = self.files.read(name)?;
        self.add(&path, (name, &bytes), transform, up, 0)
    }

    fn add(
        &mut self,
        path: &Path,
        (name, bytes): (&str, &[u8]),
        transform: &DMat4,
        up: char,
        nested: usize,
    ) -> Result<(), ReadError> {
        let damaged = |problem: &str| ReadError::Damaged { path: path.to_owned(), problem: problem.to_owned() };
        let short = || damaged("ends within its header; copy it again");
        match bytes.get(..4).unwrap_or_default() {
            b"b3dm" => {
                let (features, _, rest) = tables(bytes, 28).ok_or_else(short)?;
                let features: Features = parsed(features).map_err(|problem| damaged(&problem))?;
                let moved = match features.rtc_center {
                    None => DMat4::IDENTITY,
                    Some(Numbers::Here(centre)) => DMat4::from_translation(DVec3::from_array(centre)),
                    Some(Numbers::There(_)) => return Err(damaged("has an RTC_CENTER that is no list of numbers")),
                };
                self.model(path, rest, &(*transform * moved), up)
            }
            b"i3dm" => {
                let is_inside = word(bytes, 28).ok_or_else(short)? == 1;
                let (features, binary, rest) = tables(bytes, 32).ok_or_else(short)?;
                let features: Features = parsed(features).map_err(|problem| damaged(&problem))?;
                let places =
                    instances(&features, binary).ok_or_else(|| damaged("has instances that lie beyond its end"))?;
                let model = match is_inside {
                    true => self.triangles(path, rest)?,
                    false => {
                        let uri = String::from_utf8_lossy(rest);
                        let name = self.files.resolve(name, uri.trim_end_matches(['\0', ' ']))?;
                        let bytes = self.files.read(&name)?;
                        self.triangles(&self.files.path(&name), &bytes)?
                    }
                };
                let Some(model) = model else { return Ok(()) };
                let turned = upright(up);
                for place in places {
                    let to = *transform * place * turned;
                    append(
                        &mut self.mesh,
                        model.positions.iter().map(|&p| to.transform_point3(p)),
                        &model.triangles,
                        path,
                    )?;
                }
                Ok(())
            }
            b"cmpt" => {
                if nested == MAX_NESTED {
                    return Err(damaged("has composites within each other, more than are read"));
                }
                let count = word(bytes, 12).ok_or_else(short)?;
                let mut rest = bytes.get(16..).unwrap_or_default();
                for _ in 0..count {
                    let length = word(rest, 8).ok_or_else(short)? as usize;
                    let inner = rest.get(..length).filter(|inner| inner.len() >= 12).ok_or_else(short)?;
                    self.add(path, (name, inner), transform, up, nested + 1)?;
                    rest = &rest[length..];
                }
                Ok(())
            }
            b"pnts" => self.leave_out("are clouds of points"),
            b"vctr" | b"geom" => self.leave_out("are vector data"),
            _ => self.model(path, bytes, transform, up),
        }
    }

    fn leave_out(&mut self, kind: &'static str) -> Result<(), ReadError> {
        *self.without.entry(kind).or_default() += 1;
        Ok(())
    }

    /// Adds glTF.
    fn model(&mut self, path: &Path, bytes: &[u8], transform: &DMat4, up: char) -> Result<(), ReadError> {
        let Some(model) = self.triangles(path, bytes)? else { return Ok(()) };
        let to = *transform * upright(up);
        append(&mut self.mesh, model.positions.iter().map(|&p| to.transform_point3(p)), &model.triangles, path)
    }

    /// The triangles of glTF; none where it has none.
    fn triangles(&mut self, path: &Path, bytes: &[u8]) -> Result<Option<Mesh>, ReadError> {
        match import_bytes(path, bytes, self.notes) {
            Ok(mesh) => Ok(Some(mesh)),
            Err(ImportError::NoTriangles { .. }) => {
                self.leave_out("have no triangles")?;
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }
}

/// From glTF, whose y points up, to a tile, whose z does. Some makers of version 0 wrote glTF with other axes.
fn upright(up: char) -> DMat4 {
    match up {
        'z' => DMat4::IDENTITY,
        'x' => {
            DMat4::from_cols_array(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        }
        _ => DMat4::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

/// The feature table as text and as bytes, and what comes behind all tables. None if the file ends before.
fn tables(bytes: &[u8], header: usize) -> Option<(&[u8], &[u8], &[u8])> {
    let length = word(bytes, 8)? as usize;
    let bytes = bytes.get(..length)?;
    let mut at = header;
    let mut part = |size: u32| {
        let from = at;
        at = at.checked_add(size as usize)?;
        bytes.get(from..at)
    };
    let [text, binary, batch, batch_binary] = [12, 16, 20, 24].map(|at| word(bytes, at));
    let (text, binary) = (part(text?)?, part(binary?)?);
    part(batch?)?;
    part(batch_binary?)?;
    Some((text, binary, &bytes[at..]))
}

/// A feature table; an empty one where there is none.
fn parsed(text: &[u8]) -> Result<Features, String> {
    let text = text.trim_ascii_end();
    let text = text.strip_suffix(b"\0").unwrap_or(text);
    match text.is_empty() {
        true => Ok(Features::default()),
        false => serde_json::from_slice(text).map_err(|error| format!("its feature table is damaged: {error}")),
    }
}

/// Where instances are. None if the file has fewer than it says.
fn instances(features: &Features, binary: &[u8]) -> Option<Vec<DMat4>> {
    let count = usize::try_from(features.instances_length?).ok()?;
    // Positions take six bytes each at least, so this many fit.
    if count > binary.len() / 6 {
        return None;
    }
    let float = |at: usize| Some(f64::from(f32::from_le_bytes(*binary.get(at..)?.first_chunk()?)));
    let short = |at: usize| Some(f64::from(u16::from_le_bytes(*binary.get(at..)?.first_chunk()?)));
    let vector = |at: At, i: usize| {
        let at = at.byte_offset.checked_add(12 * i)?;
        Some(DVec3::new(float(at)?, float(at + 4)?, float(at + 8)?))
    };
    let octahedral = |at: At, i: usize| {
        let at = at.byte_offset.checked_add(4 * i)?;
        let [x, y] = [short(at)?, short(at + 2)?].map(|value| value / 65535.0 * 2.0 - 1.0);
        let z = 1.0 - x.abs() - y.abs();
        let folded = |a: f64, b: f64| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
        Some(DVec3::new(folded(x, y), folded(y, x), z).normalize_or_zero())
    };
    let centre = match &features.rtc_center {
        None => DVec3::ZERO,
        Some(Numbers::Here(centre)) => DVec3::from_array(*centre),
        Some(Numbers::There(at)) => vector(*at, 0)?,
    };
    let place = |i: usize| {
        let position = match (features.position, features.position_quantized) {
            (Some(at), _) => vector(at, i)?,
            (None, Some(at)) => {
                let at = at.byte_offset.checked_add(6 * i)?;
                let share = DVec3::new(short(at)?, short(at + 2)?, short(at + 4)?) / 65535.0;
                DVec3::from_array(features.quantized_volume_offset?)
                    + share * DVec3::from_array(features.quantized_volume_scale?)
            }
            _ => return None,
        };
        let position = centre + position;
        let up = match (features.normal_up, features.normal_up_oct32p) {
            (Some(at), _) => Some(vector(at, i)?),
            (None, Some(at)) => Some(octahedral(at, i)?),
            _ => None,
        };
        let right = match (features.normal_right, features.normal_right_oct32p) {
            (Some(at), _) => Some(vector(at, i)?),
            (None, Some(at)) => Some(octahedral(at, i)?),
            _ => None,
        };
        let turned = match (up, right) {
            (Some(up), Some(right)) => DMat3::from_cols(right, up, right.cross(up)),
            _ if features.east_north_up => {
                let [up, east, north] = up_east_north_at(position);
                DMat3::from_cols(east, north, up)
            }
            _ => DMat3::IDENTITY,
        };
        let mut scale = DVec3::ONE;
        if let Some(at) = features.scale {
            scale *= float(at.byte_offset.checked_add(4 * i)?)?;
        }
        if let Some(at) = features.scale_non_uniform {
            scale *= vector(at, i)?;
        }
        Some(DMat4::from_translation(position) * DMat4::from_mat3(turned) * DMat4::from_scale(scale))
    };
    (0..count).map(place).collect()
}
