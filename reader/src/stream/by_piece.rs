//! A root's triangles for programs that draw with texture coordinates: maps store none, so each vertex has to lie in
//! one piece.

use std::collections::HashMap;

use super::{lit::Lit, picture::DrawnRoot, texel_content::DrawnTexture};

/// A root's triangles, of which each vertex lies in one piece of the map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ByPiece {
    /// World positions, as [`DrawnRoot::joined`] has them. Vertices on lines between pieces are there once for each, at
    /// the end.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// The number of each vertex's piece in [`crate::decode::texels::Map::pieces`].
    pub pieces: Vec<u32>,
    /// The normal of each vertex, as [`super::Lit`] has them; none in a session without light.
    pub normals: Vec<[i16; 2]>,
}

impl DrawnTexture {
    /// The pieces of triangles of which this is said where in the block's patch they lie; 0 without a map.
    pub fn labels<'s>(&'s self, origins: impl IntoIterator<Item = &'s u32> + 's) -> impl Iterator<Item = u32> + 's {
        let labels = self.texture.map.as_ref().map_or(&[][..], |map| &map.labels);
        origins.into_iter().map(|&origin| labels.get(origin as usize).copied().unwrap_or(0).into())
    }
}

impl DrawnRoot {
    /// [`DrawnRoot::joined`] for a root with images, split along the lines between the pieces of its map; None without
    /// images.
    pub fn by_piece(&self) -> Option<ByPiece> {
        let texture = self.texture()?;
        let inner = self.surface.origins.iter().take(self.surface.triangles.len());
        let labels = texture.labels(inner.chain(self.strips.iter().flat_map(|strip| &strip.origins)));
        let (mut positions, mut triangles, mut normals) = match self.lit() {
            Some(Lit { positions, triangles, normals }) => (positions, triangles, normals),
            None => {
                let (positions, triangles) = self.joined();
                (positions, triangles, Vec::new())
            }
        };
        let before = positions.len();
        let (pieces, doubled) = split(&mut positions, &mut triangles, labels);
        if normals.len() == before {
            normals.extend(doubled.iter().map(|&vertex| normals[vertex as usize]).collect::<Vec<_>>());
        }
        Some(ByPiece { positions, triangles, pieces, normals })
    }
}

/// Gives each vertex one piece: those on lines between pieces are doubled. Returns the piece of each vertex, and of
/// which vertices those at the end are doubles.
fn split(
    positions: &mut Vec<[f64; 3]>,
    triangles: &mut [[u32; 3]],
    labels: impl IntoIterator<Item = u32>,
) -> (Vec<u32>, Vec<u32>) {
    const NONE: u32 = u32::MAX;
    let mut pieces = vec![NONE; positions.len()];
    let (mut doubled, mut sources) = (HashMap::new(), Vec::new());
    for (corners, label) in triangles.iter_mut().zip(labels) {
        for corner in corners {
            let piece = &mut pieces[*corner as usize];
            if *piece == NONE {
                *piece = label;
            }
            if *piece != label {
                *corner = *doubled.entry((*corner, label)).or_insert_with(|| {
                    positions.push(positions[*corner as usize]);
                    pieces.push(label);
                    sources.push(*corner);
                    positions.len() as u32 - 1
                });
            }
        }
    }
    // A vertex without triangles.
    pieces.iter_mut().filter(|piece| **piece == NONE).for_each(|piece| *piece = 0);
    (pieces, sources)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn split_triangles_keep_their_points_and_have_one_piece_each() {
        let before: Vec<[f64; 3]> = (0..5).map(|k| [f64::from(k), 0.0, 0.0]).collect();
        let fan = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        for labels in [[0, 0, 0, 0], [0, 1, 0, 1], [3, 2, 1, 0]] {
            let (mut positions, mut triangles) = (before.clone(), fan);
            let (pieces, sources) = split(&mut positions, &mut triangles, labels);
            assert_eq!(pieces.len(), positions.len());
            let doubles = &positions[positions.len() - sources.len()..];
            assert!(doubles.iter().zip(sources).all(|(at, source)| *at == before[source as usize]));
            for ((corners, old), label) in triangles.iter().zip(fan).zip(labels) {
                assert_eq!(corners.map(|k| positions[k as usize]), old.map(|k| before[k as usize]));
                assert!(corners.iter().all(|&k| pieces[k as usize] == label));
            }
            let different = labels.iter().collect::<std::collections::BTreeSet<_>>().len();
            assert!(positions.len() <= 4 * different + 1);
        }
    }
}
