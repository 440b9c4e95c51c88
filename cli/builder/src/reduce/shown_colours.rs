//! What colours a cut shows, and how those of a reduced one can be compared with them.

use glam::DVec3;
use lodpack::decode::{ChannelImage, TexturedMesh};

use super::cells::Sampled;

/// The colour that a triangle shows where its corners have these weights, of 255. None where it has no image.
pub(super) fn colour_at(cut: &TexturedMesh, channel: usize, triangle: usize, weights: [f64; 3]) -> Option<[f64; 3]> {
    let texture = cut.textures.get(cut.mesh.triangle_nodes[triangle] as usize)?;
    let Some(ChannelImage::Colours(image)) = texture.images.get(channel)?.as_ref() else { return None };
    let places = cut.places[triangle].map(|place| place.map(f64::from));
    let [red, green, blue, _] =
        image.interpolated([0, 1].map(|axis| (0..3).map(|k| weights[k] * places[k][axis]).sum()));
    Some([red, green, blue])
}

/// A cut with points of its colours, relative to an origin, for about the given number of cells, which are no smaller
/// than its texels.
pub(super) fn sampled(cut: &TexturedMesh, channel: usize, origin: DVec3, [texel, cells]: [f64; 2]) -> Sampled {
    let corner = |&vertex: &u32| DVec3::from(cut.mesh.positions[vertex as usize]) - origin;
    let corners = cut.mesh.triangles.iter().map(|corners| [0, 1, 2].map(|k| corner(&corners[k]))).collect();
    Sampled::new(corners, cells, texel, |triangle, weights| colour_at(cut, channel, triangle, weights))
}

#[cfg(test)]
mod tests {
    use lodpack::Mesh;
    use lodpack::decode::Texture;
    use lodpack::decode::texels::Image;

    use super::*;

    /// A square at a height, the left half of which has one grey, and the other half another one.
    fn square(height: f64, greys: [u8; 2]) -> TexturedMesh {
        let data = (0..8).flat_map(|x| [greys[usize::from(x >= 4)]; 3]).collect();
        let image = ChannelImage::Colours(Image { size: [8, 1], components: 3, data });
        let positions = [[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]].map(|[x, y]| [x, y, height]).to_vec();
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let place = |&corner: &u32| [positions[corner as usize][0] as f32, 0.5];
        TexturedMesh {
            places: triangles.iter().map(|corners: &[u32; 3]| [0, 1, 2].map(|k| place(&corners[k]))).collect(),
            textures: vec![Texture { level: 0, map: None, images: vec![None, Some(image)] }],
            mesh: Mesh { positions, triangle_nodes: vec![0; 2], triangles },
        }
    }

    #[test]
    fn colours_are_compared_where_points_are_closest() {
        let origin = DVec3::new(3.0, 0.0, 1.0);
        let positions = |of: &TexturedMesh| of.mesh.positions.iter().map(|&p| DVec3::from(p) - origin).collect();
        let cut = square(0.0, [100, 200]);
        let sampled = |cut: &TexturedMesh| sampled(cut, 1, origin, [0.05, 131_072.0]);
        let alike = sampled(&cut).seen(positions(&square(-3.0, [0, 0])), &cut.mesh.triangles);
        // Colours between two texels differ within cells.
        assert!(alike.mean().is_some_and(|mean| mean < 1.0), "{:?}", alike.mean());
        // A second one above it, which is seen in the same places.
        let mut both = square(0.0, [100, 200]);
        both.mesh.positions.extend(square(0.5, [0; 2]).mesh.positions);
        both.mesh.triangles.extend([[4, 5, 6], [4, 6, 7]]);
        both.mesh.triangle_nodes.extend([1; 2]);
        both.places.extend(square(0.5, [0; 2]).places);
        both.textures.extend(square(0.5, [120, 200]).textures);
        let off = sampled(&both).seen(positions(&square(-2.0, [0, 0])), &cut.mesh.triangles);
        // Half of it is ten off the mean on both squares, but for what lies between two texels.
        assert!(off.mean().is_some_and(|mean| (44.0..51.0).contains(&mean)), "{:?}", off.mean());
        let worst = off.worst(0.5);
        assert!(!worst.is_empty() && worst.iter().all(|point| point.x + origin.x < 4.0));
        let none = super::sampled(&cut, 0, origin, [0.05, 131_072.0]).seen(positions(&cut), &cut.mesh.triangles);
        assert!(none.mean().is_none() && none.worst(0.5).is_empty());
    }
}
