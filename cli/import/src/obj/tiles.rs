//! Images in tiles, as films and museums have them (UDIM): the tile of a point is that of its texture coordinates, 1001
//! from 0 to 1, 1002 to the right of it, 1011 above it, and each tile is a file with its number in the name.

use std::collections::BTreeSet;
use std::path::PathBuf;

use crate::beside::Beside;
use lodpack_mesh::appearance::{TextureUse, Wrap};

/// Column and row of a tile.
pub(super) type Tile = [u32; 2];

/// What stands for the number in a name.
const PLACEHOLDER: &[u8] = b"<udim>";
/// The number of the first tile, and of tiles in a row.
const FIRST: u32 = 1001;
const COLUMNS: u32 = 10;

/// Where the number is in a name, and how long it is there: a placeholder, or that of the first tile between other
/// signs.
fn number_in(name: &[u8]) -> Option<(usize, usize)> {
    let lower = name.to_ascii_lowercase();
    let find = |what: &[u8]| lower.windows(what.len()).rposition(|part| part == what);
    if let Some(at) = find(PLACEHOLDER) {
        return Some((at, PLACEHOLDER.len()));
    }
    let [dotted, underlined] = [&b".1001."[..], b"_1001."].map(find);
    dotted.or(underlined).map(|at| (at + 1, 4))
}

/// The tiles of an image that are there; none where its name does not stand for tiles. `others` are all names of the
/// library: whoever names each tile by itself does not mean the first one to stand for all.
pub(super) fn find_tiles(name: &[u8], others: &BTreeSet<Vec<u8>>, beside: &Beside) -> Vec<(Tile, PathBuf)> {
    let Some((at, length)) = number_in(name) else { return vec![] };
    let (before, after) = (&name[..at], &name[at + length..]);
    let tiles: Vec<(Tile, PathBuf)> = (beside.numbered(before, after).into_iter())
        .filter_map(|(number, path)| Some((number.checked_sub(FIRST)?, path)))
        .map(|(place, path)| ([place % COLUMNS, place / COLUMNS], path))
        .collect();
    let is_stated = length == PLACEHOLDER.len();
    let is_other = |tile: &Tile| *tile != [0; 2] && others.contains(&name_of(before, *tile, after));
    let are_meant = is_stated || tiles.len() > 1 && !tiles.iter().any(|(tile, _)| is_other(tile));
    if are_meant { tiles } else { vec![] }
}

/// The name of a tile.
fn name_of(before: &[u8], [column, row]: Tile, after: &[u8]) -> Vec<u8> {
    let number = (FIRST + column + COLUMNS * row).to_string();
    [before, number.as_bytes(), after].concat()
}

/// Has an image shown on its tile, beyond which there is another one.
pub(super) fn place(texture: &mut TextureUse, [column, row]: Tile) {
    texture.wrap = [Wrap::Clamp; 2];
    if [column, row] != [0; 2] {
        let [a, b, c, d, e, f] = texture.transform.unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        // Rows count from above here.
        let [right, down] = [-(column as f32), row as f32];
        texture.transform = Some([a, b, c + a * right + b * down, d, e, f + d * right + e * down]);
    }
}

/// The tile of a face, given the texture coordinates of its corners with rows from above, and whether it reaches beyond
/// it. None if it is on no tile.
pub(super) fn tile_of(uvs: impl Iterator<Item = [f32; 2]> + Clone) -> Option<(Tile, bool)> {
    let (sum, count) = uvs
        .clone()
        .fold(([0.0; 2], 0.0), |([u, v], count), [x, y]| ([u + f64::from(x), v + 1.0 - f64::from(y)], count + 1.0));
    let [column, row] = sum.map(|sum: f64| (sum / count).floor());
    let is_tile = (0.0..f64::from(COLUMNS)).contains(&column) && (0.0..900.0).contains(&row);
    let is_within = |at: f64, first: f64| (first - BORDER..=first + 1.0 + BORDER).contains(&at);
    let is_outside = |[x, y]: [f32; 2]| !is_within(f64::from(x), column) || !is_within(1.0 - f64::from(y), row);
    is_tile.then(|| ([column as u32, row as u32], { uvs }.any(is_outside)))
}

/// By how much a corner on the border of its tile may be beyond it.
const BORDER: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_tiles_stand_in_names() {
        for (name, expected) in [
            ("a.<UDIM>.png", Some((2, 6))),
            ("a_<udim>.exr", Some((2, 6))),
            ("tex/a.1001.png", Some((6, 4))),
            ("a_1001.png", Some((2, 4))),
            ("a1001.png", None),
            ("a.1002.png", None),
        ] {
            assert_eq!(number_in(name.as_bytes()), expected, "{name}");
        }
    }

    #[test]
    fn faces_lie_on_the_tile_of_their_middle() {
        let tile = |uvs: [[f32; 2]; 3]| tile_of(uvs.map(|[u, v]| [u, 1.0 - v]).into_iter());
        assert_eq!(tile([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), Some(([0, 0], false)));
        assert_eq!(tile([[1.0, 2.0], [2.0, 2.0], [2.0, 3.0]]), Some(([1, 2], false)));
        assert_eq!(tile([[0.5, 0.0], [1.9, 0.0], [0.5, 1.0]]), Some(([0, 0], true)));
        assert_eq!(tile([[-0.5, 0.0], [-0.1, 0.0], [-0.5, 1.0]]), None);
        assert_eq!(tile([[10.5, 0.0], [10.1, 0.0], [10.5, 1.0]]), None);
    }
}
