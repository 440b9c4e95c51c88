//! What colours a cut shows, and how far those of a reduced one are from them.

use glam::DVec3;
use lodpack::decode::{ChannelImage, TexturedMesh};

use super::spread_points::for_each_point;
use crate::stage::bake::barycentric;
use crate::stage::certify::{Near, TriangleBvh};

/// Points at which cuts are compared.
const COMPARED_POINTS: usize = 30_000;

/// The colour that a triangle shows where its corners have these weights, of 255. None where it has no image.
pub(super) fn colour_at(cut: &TexturedMesh, channel: usize, triangle: usize, weights: [f64; 3]) -> Option<[f64; 3]> {
    let texture = cut.textures.get(cut.mesh.triangle_nodes[triangle] as usize)?;
    let Some(ChannelImage::Colours(image)) = texture.images.get(channel)?.as_ref() else { return None };
    let places = cut.places[triangle].map(|place| place.map(f64::from));
    let [red, green, blue, _] =
        image.interpolated([0, 1].map(|axis| (0..3).map(|k| weights[k] * places[k][axis]).sum()));
    Some([red, green, blue])
}

/// By how much colours of a cut differ from what a reduced one shows.
#[derive(Default)]
pub(super) struct Difference {
    /// Points of the cut with the square of the difference there.
    points: Vec<(DVec3, f64)>,
    sum: f64,
}

impl Difference {
    /// Of points and squares.
    #[cfg(test)]
    pub fn of(points: Vec<(DVec3, f64)>) -> Self {
        Self { sum: points.iter().map(|(_, square)| square).sum(), points }
    }

    /// The mean square.
    pub fn mean(&self) -> f64 {
        self.sum / self.points.len() as f64
    }

    /// The points where it is largest, which make up a share of all.
    pub fn worst(mut self, share: f64) -> Vec<DVec3> {
        self.points.sort_by(|(_, one), (_, other)| other.total_cmp(one));
        let mut rest = share * self.sum;
        let is_wanted = |&(_, square): &(DVec3, f64)| {
            let is_wanted = rest > 0.0 && square > 0.0;
            rest -= square;
            is_wanted
        };
        self.points.into_iter().take_while(is_wanted).map(|(point, _)| point).collect()
    }
}

/// Compares colours of a cut with what a reduced one shows at the closest points, whatever way these face: a part that is gone shows the colours of
/// another one. None if they have no colours in common.
pub(super) fn difference(cut: &TexturedMesh, reduced: &TexturedMesh, channel: usize) -> Option<Difference> {
    let positions = |of: &TexturedMesh| of.mesh.positions.iter().map(|&p| DVec3::from(p)).collect::<Vec<_>>();
    let [of_cut, of_reduced] = [cut, reduced].map(positions);
    let corners = |corners: &[u32; 3]| corners.map(|vertex| of_cut[vertex as usize]);
    let areas: Vec<f64> =
        cut.mesh.triangles.iter().map(corners).map(|[a, b, c]| (b - a).cross(c - a).length()).collect();
    let bvh = TriangleBvh::new(&of_reduced, &reduced.mesh.triangles);
    let (mut near, mut difference) = (Near::default(), Difference::default());
    for_each_point(&areas, COMPARED_POINTS, |triangle, weights| {
        let Some(wanted) = colour_at(cut, channel, triangle, weights) else { return };
        let corners = corners(&cut.mesh.triangles[triangle]);
        let point = (0..3).map(|k| corners[k] * weights[k]).sum();
        let closest = bvh.closest_near(point, &mut near);
        let Some(corners) = reduced.mesh.triangles.get(closest.triangle as usize) else { return };
        let weights = barycentric(corners.map(|vertex| of_reduced[vertex as usize]), closest.point);
        let Some(shown) = colour_at(reduced, channel, closest.triangle as usize, weights) else { return };
        let square = (0..3).map(|k| (wanted[k] - shown[k]) * (wanted[k] - shown[k])).sum::<f64>() / 3.0;
        difference.points.push((point, square));
        difference.sum += square;
    });
    Some(difference).filter(|difference| !difference.points.is_empty())
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
        let cut = square(0.0, [100, 200]);
        let alike = difference(&cut, &square(3.0, [100, 200]), 1).expect("both have colours");
        assert!(alike.mean() < 1e-9, "{}", alike.mean());
        let off = difference(&cut, &square(-2.0, [110, 200]), 1).expect("both have colours");
        // Half of it is off by ten, but for what lies between two texels.
        assert!((46.5..49.5).contains(&off.mean()), "{}", off.mean());
        assert!(difference(&cut, &cut, 0).is_none() && difference(&cut, &cut, 2).is_none());
        let count = off.points.len();
        let worst = off.worst(0.5);
        assert!(worst.iter().all(|point| point.x < 4.0) && worst.len() < count / 3, "{} of {count}", worst.len());
    }
}
