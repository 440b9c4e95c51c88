//! Subdivide: divides triangles that show so many texels that charts of few of them would have more than a map holds.
//!
//! A photograph of a quarter of a gigatexel may lie on two triangles. The surface stays as it is, and so does what it
//! shows: edges are divided at their middles, the longest first, each together with both of its triangles (longest-edge
//! propagation paths; Rivara, "New longest-edge algorithms for the refinement and/or improvement of unstructured
//! triangulations", 1997). Inner vertices of charts that are flat go again when patches are simplified.

use std::collections::HashMap;

use glam::DVec3;

use lodpack_mesh::appearance::{Appearance, TextureUse, images_on};
use lodpack_mesh::attributes::RegionAttributes;
use lodpack_mesh::{Adjacency, Mesh, NONE, next_half_edge};

/// The most texels of images on a triangle that stays whole, a sixteenth of those of a chart.
const MOST_TEXELS: f64 = MOST_CHART_TEXELS / 16.0;
/// Triangles that are added, about: with more texels in a region, triangles keep more.
const MOST_ADDED: f64 = 65_536.0;
/// The most texels of images on a chart. Files have about two for each, and maps hold as many twice over.
const MOST_CHART_TEXELS: f64 = 2_097_152.0;

/// What was added to a region.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Subdivided {
    /// Triangles.
    pub triangles: u64,
    /// Vertices.
    pub vertices: u64,
    /// Texels of images that the region shows.
    pub texels: f64,
}

/// Divides the triangles of a region. Those at its boundary keep the edges there unless it is alone: other regions have
/// them, too.
pub fn subdivide(
    mesh: &mut Mesh,
    adjacency: &mut Adjacency,
    attributes: &mut RegionAttributes,
    appearance: &Appearance,
    is_alone: bool,
) -> Subdivided {
    let texels = texels_of_triangles(attributes, appearance, mesh.triangles.len());
    let sum: f64 = texels.iter().sum();
    if sum <= MOST_CHART_TEXELS {
        return Subdivided { texels: sum, ..Subdivided::default() };
    }
    let most = MOST_TEXELS.max(sum / MOST_ADDED);
    let mut open: Vec<u32> = (0..).zip(&texels).filter(|(_, texels)| **texels > most).map(|(t, _)| t).collect();
    let before = [mesh.triangles.len(), mesh.positions.len()];
    let (labels, means) = (appearance.label_places(), HashMap::new());
    let stride = appearance.layout.stride;
    let mut refined = Refined { mesh, adjacency, attributes, stride, labels, is_alone, texels, means };
    let limit = before[0] + 4 * MOST_ADDED as usize;
    while let Some(triangle) = open.pop() {
        if refined.texels[triangle as usize] > most && refined.texels.len() < limit {
            // Where an edge is too short for a middle, nothing more is done.
            let Some(edge) = refined.last_edge(triangle) else { continue };
            let Some(touched) = refined.divide(edge) else { continue };
            open.extend(touched.into_iter().filter(|&other| other != NONE && other != triangle));
            open.push(triangle);
        }
    }
    let [triangles, vertices] = [refined.mesh.triangles.len() - before[0], refined.mesh.positions.len() - before[1]];
    Subdivided { triangles: triangles as u64, vertices: vertices as u64, texels: sum }
}

/// The texels that triangles show of which a file keeps this share, as shares of the most that a chart should have;
/// nothing if there are no images.
pub fn texel_shares(attributes: &RegionAttributes, appearance: &Appearance, triangles: usize, kept: f64) -> Vec<f64> {
    let mut shares = texels_of_triangles(attributes, appearance, triangles);
    shares.iter_mut().for_each(|texels| *texels *= kept / MOST_CHART_TEXELS);
    shares
}

/// The texels of images that each triangle shows; nothing if there are no images.
fn texels_of_triangles(attributes: &RegionAttributes, appearance: &Appearance, triangles: usize) -> Vec<f64> {
    let count = if appearance.texels > 0 { triangles } else { 0 };
    (0..count).map(|triangle| texels_of(attributes, appearance, triangle)).collect()
}

/// The texels that a triangle shows of the image of which it shows most.
fn texels_of(attributes: &RegionAttributes, appearance: &Appearance, triangle: usize) -> f64 {
    let Some(material) = appearance.materials.get(usize::from(attributes.material(triangle))) else { return 0.0 };
    let records = attributes.records_of(triangle, appearance.layout.stride);
    let of_texture = |texture: &TextureUse| {
        let [width, height] = appearance.image_sizes.get(texture.image as usize)?.map(f64::from);
        // However often an image repeats, there is no more in it.
        Some(images_on(texture.corners(&appearance.layout, records)?).min(1.0) * width * height)
    };
    material.textures().filter_map(of_texture).fold(0.0, f64::max)
}

/// A region while triangles of it are divided.
struct Refined<'a> {
    mesh: &'a mut Mesh,
    adjacency: &'a mut Adjacency,
    attributes: &'a mut RegionAttributes,
    /// Numbers in a record.
    stride: usize,
    /// Which of them are labels.
    labels: Vec<usize>,
    is_alone: bool,
    /// Of each triangle.
    texels: Vec<f64>,
    /// The record in the middle between two.
    means: HashMap<[u32; 2], u32>,
}

impl Refined<'_> {
    fn ends(&self, edge: u32) -> [u32; 2] {
        [edge, next_half_edge(edge)].map(|h| self.mesh.triangles[h as usize / 3][h as usize % 3])
    }

    /// The longest of the edges of a triangle for which something holds. An order of all edges: none is as long as
    /// another.
    fn longest(&self, triangle: u32, holds: impl Fn(&u32) -> bool) -> Option<u32> {
        let key = |edge: u32| {
            let [a, b] = self.ends(edge);
            let length = self.mesh.positions[a as usize].distance_squared(self.mesh.positions[b as usize]);
            (length, [a.min(b), a.max(b)])
        };
        (3 * triangle..3 * triangle + 3).filter(holds).max_by(|&one, &other| {
            let (one, other) = (key(one), key(other));
            one.0.total_cmp(&other.0).then(one.1.cmp(&other.1))
        })
    }

    fn may_divide(&self, edge: u32) -> bool {
        self.is_alone || self.adjacency.opposite[edge as usize] != NONE
    }

    /// Where a path ends that leads over longest edges: at one that is the longest of both its triangles, or that of
    /// one beyond which the longest must stay.
    fn last_edge(&self, mut triangle: u32) -> Option<u32> {
        let mut last = self.longest(triangle, |&edge| self.may_divide(edge))?;
        while self.longest(triangle, |_| true) == Some(last) {
            let opposite = self.adjacency.opposite[last as usize];
            if opposite == NONE {
                break;
            }
            match self.longest(opposite / 3, |_| true) {
                Some(next) if next != opposite && self.may_divide(next) => (triangle, last) = (opposite / 3, next),
                _ => break,
            }
        }
        Some(last)
    }

    /// Divides an edge, and with it its triangles, all of which are returned; [`NONE`] for what is not there.
    fn divide(&mut self, edge: u32) -> Option<[u32; 4]> {
        let ends = self.ends(edge).map(|vertex| self.mesh.positions[vertex as usize]);
        let middle: DVec3 = 0.5 * (ends[0] + ends[1]);
        if ends.contains(&middle) {
            return None;
        }
        let (vertex, opposite) = (self.mesh.positions.len() as u32, self.adjacency.opposite[edge as usize]);
        self.mesh.positions.push(middle);
        let added = self.split(edge, vertex);
        if opposite == NONE {
            return Some([edge / 3, added / 3, NONE, NONE]);
        }
        let other_added = self.split(opposite, vertex);
        for [one, other] in [[edge, other_added], [added, opposite]] {
            self.adjacency.opposite[one as usize] = other;
            self.adjacency.opposite[other as usize] = one;
        }
        Some([edge / 3, added / 3, opposite / 3, other_added / 3])
    }

    /// Puts a vertex on an edge of a triangle: the triangle keeps the part up to it. Returns the edge from there on, of
    /// a new triangle.
    fn split(&mut self, edge: u32, vertex: u32) -> u32 {
        let (triangle, first) = (edge as usize / 3, edge as usize % 3);
        let second = (first + 1) % 3;
        let number = self.mesh.triangles.len();
        let mut corners = self.mesh.triangles[triangle];
        self.mesh.triangles[triangle][second] = vertex;
        corners[first] = vertex;
        self.mesh.triangles.push(corners);
        if let Some(&of_corners) = self.attributes.corners.get(triangle) {
            let mean = self.mean([of_corners[first], of_corners[second]]);
            self.attributes.corners[triangle][second] = mean;
            let mut others = of_corners;
            others[first] = mean;
            self.attributes.corners.push(others);
        }
        let RegionAttributes { materials, charts, objects, .. } = &mut *self.attributes;
        materials.extend(materials.get(triangle).copied());
        charts.extend(charts.get(triangle).copied());
        objects.extend(objects.get(triangle).copied());
        self.texels[triangle] *= 0.5;
        self.texels.push(self.texels[triangle]);

        let edge_of = |triangle: usize, k: usize| (3 * triangle + k % 3) as u32;
        let (outer, inner) = (edge_of(triangle, second), edge_of(number, first + 2));
        let beyond = self.adjacency.opposite[outer as usize];
        let mut opposites = [NONE; 3];
        opposites[second] = beyond;
        opposites[(first + 2) % 3] = outer;
        self.adjacency.opposite.extend(opposites);
        self.adjacency.opposite[outer as usize] = inner;
        if beyond != NONE {
            self.adjacency.opposite[beyond as usize] = edge_of(number, second);
        }
        edge_of(number, first)
    }

    /// The record in the middle between two: means, but of labels that of the first.
    fn mean(&mut self, records: [u32; 2]) -> u32 {
        let stride = self.stride;
        let [low, high] = [records[0].min(records[1]), records[0].max(records[1])];
        if let Some(&known) = self.means.get(&[low, high]) {
            return known;
        }
        let [one, other] = [low, high].map(|record| &self.attributes.records[record as usize * stride..][..stride]);
        let mut mean: Vec<f32> = one.iter().zip(other).map(|(one, other)| 0.5 * (one + other)).collect();
        self.labels.iter().for_each(|&place| mean[place] = one[place]);
        let number = (self.attributes.records.len() / stride) as u32;
        self.attributes.records.extend(mean);
        self.means.insert([low, high], number);
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_mesh::appearance::{Material, Wrap};
    use lodpack_mesh::attributes::AttributeLayout;

    /// A sheet of two triangles with an image, and a third triangle beside them without.
    fn sheet(side: u32) -> (Mesh, Adjacency, RegionAttributes, Appearance) {
        let mut layout = AttributeLayout::default();
        layout.add_uv(1);
        let texture = TextureUse { image: 0, uv_set: 0, wrap: [Wrap::Repeat; 2], transform: None };
        let textured = Material { base_texture: Some(texture), ..Material::default() };
        let appearance = Appearance {
            layout,
            has_colour: true,
            materials: vec![Material::default(), textured],
            image_sizes: vec![[side, side]],
            texels: u64::from(side * side),
            ..Appearance::default()
        };
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.0]];
        let positions: Vec<DVec3> = corners.iter().map(|&[x, y]| DVec3::new(3.0 * x, y, 0.1)).collect();
        let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]];
        let adjacency = Adjacency::new(&triangles, positions.len());
        let attributes = RegionAttributes {
            corners: triangles.clone(),
            records: corners.iter().flatten().map(|&x| x as f32).collect(),
            materials: vec![1, 1, 0],
            ..RegionAttributes::default()
        };
        (Mesh { positions, triangles }, adjacency, attributes, appearance)
    }

    #[test]
    fn a_large_image_on_two_triangles_is_on_many_that_show_the_same() {
        for is_alone in [true, false] {
            let (mut mesh, mut adjacency, mut attributes, appearance) = sheet(2048);
            let boundary = |mesh: &Mesh, adjacency: &Adjacency| {
                let open = (0..adjacency.opposite.len()).filter(|&h| adjacency.opposite[h] == NONE);
                open.map(|h| [h, next_half_edge(h as u32) as usize].map(|h| mesh.triangles[h / 3][h % 3]))
                    .collect::<std::collections::BTreeSet<_>>()
            };
            let before = boundary(&mesh, &adjacency);
            let done = subdivide(&mut mesh, &mut adjacency, &mut attributes, &appearance, is_alone);
            assert_eq!(
                [mesh.triangles.len(), mesh.positions.len()],
                [3 + done.triangles as usize, 5 + done.vertices as usize]
            );
            assert!(done.triangles >= 14, "{done:?}");
            assert!((0..mesh.triangles.len()).all(|t| texels_of(&attributes, &appearance, t) <= MOST_TEXELS));
            assert!(attributes.fits(mesh.triangles.len()));
            assert_eq!(adjacency, Adjacency::new(&mesh.triangles, mesh.positions.len()));
            assert_eq!(boundary(&mesh, &adjacency) == before, !is_alone);
            let areas = (0..mesh.triangles.len() as u32).map(|t| mesh.doubled_area(t).z);
            let (sum, least) = areas.fold((0.0, f64::INFINITY), |(sum, least), area| (sum + area, area.min(least)));
            assert!((sum - 9.0).abs() < 1e-9 && least > 0.0, "{sum} {least}");
            // What a corner shows is still what lies there.
            for (corners, records) in mesh.triangles.iter().zip(&attributes.corners) {
                for (&corner, &record) in corners.iter().zip(records) {
                    let (position, uv) = (mesh.positions[corner as usize], &attributes.records[2 * record as usize..]);
                    assert_eq!([position.x / 3.0, position.y], [f64::from(uv[0]), f64::from(uv[1])]);
                }
            }
        }
    }

    #[test]
    fn few_texels_change_nothing_and_absurd_coordinates_end() {
        let (mut mesh, mut adjacency, mut attributes, appearance) = sheet(256);
        let before = (mesh.clone(), adjacency.clone(), attributes.clone());
        let done = subdivide(&mut mesh, &mut adjacency, &mut attributes, &appearance, true);
        assert_eq!((done.triangles, done.vertices), (0, 0));
        assert!(before == (mesh.clone(), adjacency.clone(), attributes.clone()));

        for far in [1e9, f32::MAX, f32::INFINITY, f32::NAN] {
            let (mut mesh, mut adjacency, mut attributes, appearance) = sheet(16_384);
            attributes.records[4] = far;
            let done = subdivide(&mut mesh, &mut adjacency, &mut attributes, &appearance, true);
            assert!(done.triangles <= 5 * MOST_ADDED as u64, "{done:?}");
            assert_eq!(adjacency, Adjacency::new(&mesh.triangles, mesh.positions.len()));
        }
    }

    #[test]
    fn what_is_too_small_to_divide_stays() {
        let (mut mesh, mut adjacency, mut attributes, appearance) = sheet(2048);
        mesh.positions.iter_mut().for_each(|point| *point *= f64::MIN_POSITIVE * f64::EPSILON);
        let done = subdivide(&mut mesh, &mut adjacency, &mut attributes, &appearance, true);
        assert!(done.triangles < 64, "{done:?}");
    }
}
