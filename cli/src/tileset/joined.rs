//! Several tilesets as one: a file that leads to all of them, and draws them side by side.

use super::{ENTRY, TilesetError, TilesetSummary};
use serde_json::{Value, json};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;

/// The folder of each tileset in that of the joined one.
#[must_use]
pub fn folder_of(number: usize) -> String {
    number.to_string()
}

/// Writes the file that leads to the tilesets in the first folders of a folder, one for each summary, and sums these
/// up.
///
/// # Errors
/// [`TilesetError`].
pub fn write_joined(folder: &Path, parts: &[TilesetSummary]) -> Result<TilesetSummary, TilesetError> {
    let mut children: Vec<Value> = vec![];
    let (mut corners, mut largest) = (Vec::<[f64; 3]>::new(), 0.0_f64);
    for number in 0..parts.len() {
        let name = format!("{}/{ENTRY}", folder_of(number));
        let path = folder.join(&name);
        let read = fs::read(&path).and_then(|text| Ok(serde_json::from_slice::<Value>(&text)?));
        let document = read.map_err(|source| TilesetError::Write { path: path.clone(), source })?;
        let Some(volume) = moved_box(&document["root"]) else {
            let source = io::Error::new(ErrorKind::InvalidData, "its first tile has no box");
            return Err(TilesetError::Write { path, source });
        };
        // What it is off if it is not drawn, in metres.
        let error = document["geometricError"].as_f64().unwrap_or(0.0);
        largest = largest.max(error);
        corners.extend(corners_of(&volume));
        children.push(json!({"boundingVolume": {"box": volume}, "geometricError": error, "content": {"uri": name}}));
    }
    let side = |pick: fn(f64, f64) -> f64| [0, 1, 2].map(|k| corners.iter().map(|p| p[k]).reduce(pick).unwrap_or(0.0));
    let (low, high) = (side(f64::min), side(f64::max));
    let [middle, half] = [[0, 1, 2].map(|k| 0.5 * (low[k] + high[k])), [0, 1, 2].map(|k| 0.5 * (high[k] - low[k]))];
    let volume = [middle[0], middle[1], middle[2], half[0], 0.0, 0.0, 0.0, half[1], 0.0, 0.0, 0.0, half[2]];
    let document = json!({
        "asset": {"version": "1.1", "extras": {"generator": concat!("lodpack ", env!("CARGO_PKG_VERSION"))}},
        "geometricError": largest,
        "root": {"boundingVolume": {"box": volume}, "geometricError": largest, "refine": "ADD", "children": children},
    });
    let text = document.to_string();
    super::write(folder, ENTRY, text.as_bytes())?;
    let own = TilesetSummary {
        tilesets: 1,
        bytes: text.len() as u64,
        first_picture_bytes: text.len() as u64,
        first_picture_requests: 1,
        ..TilesetSummary::default()
    };
    Ok(parts.iter().fold(own, |sum, part| TilesetSummary {
        tiles: sum.tiles + part.tiles,
        tilesets: sum.tilesets + part.tilesets,
        triangles: sum.triangles + part.triangles,
        border_triangles: sum.border_triangles + part.border_triangles,
        finest_triangles: sum.finest_triangles + part.finest_triangles,
        certified_error: sum.certified_error.max(part.certified_error),
        bytes: sum.bytes + part.bytes,
        first_picture_bytes: sum.first_picture_bytes + part.first_picture_bytes,
        first_picture_requests: sum.first_picture_requests + part.first_picture_requests,
    }))
}

/// The box of a tile where its transform puts it: its middle, then three half axes.
fn moved_box(root: &Value) -> Option<[f64; 12]> {
    let numbers =
        |value: &Value| value.as_array().map(|all| all.iter().filter_map(Value::as_f64).collect::<Vec<f64>>());
    let volume: [f64; 12] = numbers(&root["boundingVolume"]["box"])?.try_into().ok()?;
    let Some(matrix) = numbers(&root["transform"]) else { return Some(volume) };
    let matrix: [f64; 16] = matrix.try_into().ok()?;
    let turned = |at: usize, k: usize| (0..3).map(|column| matrix[4 * column + k] * volume[at + column]).sum::<f64>();
    let moved = |number: usize| {
        let (at, k) = (number / 3 * 3, number % 3);
        turned(at, k) + if at == 0 { matrix[12 + k] } else { 0.0 }
    };
    Some(std::array::from_fn(moved))
}

fn corners_of(volume: &[f64; 12]) -> impl Iterator<Item = [f64; 3]> + use<> {
    let volume = *volume;
    (0..8).map(move |corner| {
        let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        [0, 1, 2].map(|k| volume[k] + (0..3).map(|axis| sign(axis) * volume[3 + 3 * axis + k]).sum::<f64>())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_turned_scaled_and_moved_by_its_transform() {
        // x becomes y, y becomes -x, twice as long, moved along x.
        let root = json!({
            "boundingVolume": {"box": [1, 2, 3, 1, 0, 0, 0, 2, 0, 0, 0, 3]},
            "transform": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 100, 0, 0, 1],
        });
        let moved = moved_box(&root).unwrap();
        assert_eq!(moved, [96.0, 2.0, 6.0, 0.0, 2.0, 0.0, -4.0, 0.0, 0.0, 0.0, 0.0, 6.0]);
        let corners: Vec<[f64; 3]> = corners_of(&moved).collect();
        assert!(corners.contains(&[92.0, 0.0, 0.0]) && corners.contains(&[100.0, 4.0, 12.0]));
    }
}
