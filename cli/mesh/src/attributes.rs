//! What a mesh carries beside its shape: numbers per vertex or per corner, and a material and a chart per triangle.
//!
//! Each input file has a layout of its own ([`FileAttributes`]), because its parser finds out only while it reads what
//! there is. Regions have one layout for all: [`RegionAttributes::gather`] makes the records of their corners, each
//! stored once.

use serde::{Deserialize, Serialize};

use super::Mesh;
use super::appearance::Appearance;
pub use super::layout::AttributeLayout;
pub use lodpack::write::ObjectNode;

/// A mesh with what it carries beside its shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// The shape.
    pub mesh: Mesh,
    /// Numbers and materials, as the input has them.
    pub attributes: Attributes,
    /// What they mean.
    pub appearance: Appearance,
}

impl From<Mesh> for Surface {
    fn from(mesh: Mesh) -> Self {
        Self { mesh, ..Self::default() }
    }
}

/// The attributes of an input. On disk, the values are in files of their own.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Attributes {
    /// By input file.
    pub files: Vec<FileAttributes>,
    /// The materials of triangles: runs of one material, by their first triangle. Triangles before the first run have
    /// material 0.
    pub materials: Vec<MaterialRun>,
    /// The charts that the input itself cuts its triangles into, as runs like those of materials; empty if it is not
    /// cut.
    pub charts: Vec<ChartRun>,
    /// What the input names: objects, and assemblies of them; empty if nothing of it is kept. Parents come first.
    pub nodes: Vec<ObjectNode>,
    /// The objects of triangles, as runs like those of materials: each triangle has one, unless there are no nodes.
    pub objects: Vec<ObjectRun>,
    /// The values of all vertices of all files.
    pub vertex_values: Vec<f32>,
    /// The values of all corners of all triangles of all files.
    pub corner_values: Vec<f32>,
}

impl Attributes {
    /// Whether triangles carry nothing, so that regions do not have to know their numbers.
    pub fn are_empty(&self, appearance: &Appearance) -> bool {
        appearance.is_empty() && self.charts.is_empty() && self.objects.is_empty()
    }

    /// Forgets what the input names.
    pub fn join_objects(&mut self) {
        (self.nodes, self.objects) = (vec![], vec![]);
    }

    /// The object of a triangle.
    #[inline]
    pub fn object(&self, triangle: u32) -> u32 {
        run_of(&self.objects, triangle, |run| run.first_triangle).map_or(0, |run| run.node)
    }

    /// How many nodes are objects, and how many are assemblies.
    pub fn node_counts(&self) -> [u64; 2] {
        let mut is_object = vec![false; self.nodes.len()];
        self.objects.iter().for_each(|run| is_object[run.node as usize] = true);
        let objects = is_object.iter().filter(|&&is_object| is_object).count();
        [objects as u64, (self.nodes.len() - objects) as u64]
    }
}

/// The attributes of an input file. The record of a corner is that of its vertex, followed by its own.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileAttributes {
    /// Its first vertex.
    pub first_vertex: u32,
    /// Its first triangle.
    pub first_triangle: u32,
    /// Where its values begin among those of vertices.
    pub first_vertex_value: u64,
    /// Where its values begin among those of corners.
    pub first_corner_value: u64,
    /// Values per vertex.
    pub vertex_stride: usize,
    /// Values per corner.
    pub corner_stride: usize,
    /// The layout of a corner's record.
    pub layout: AttributeLayout,
    /// Whether the alpha of its colours means nothing.
    pub ignores_alpha: bool,
}

impl FileAttributes {
    /// For each number of a record of a layout its place in the records of this file, if it has it.
    fn places(&self, layout: &AttributeLayout) -> Vec<Option<usize>> {
        let mut places = layout.places_in(&self.layout);
        if let Some(colour) = layout.colour.filter(|_| self.ignores_alpha) {
            places[colour + 3] = None;
        }
        places
    }
}

/// Consecutive triangles of one material, up to the next run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MaterialRun {
    /// The first triangle.
    pub first_triangle: u32,
    /// The number of the material.
    pub material: u16,
}

/// Consecutive triangles of one chart, up to the next run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChartRun {
    /// The first triangle.
    pub first_triangle: u32,
    /// The number of the chart.
    pub chart: u32,
}

/// The run that a triangle is in; none before the first.
#[inline]
fn run_of<T>(runs: &[T], triangle: u32, first_triangle: impl Fn(&T) -> u32) -> Option<&T> {
    runs.get(runs.partition_point(|run| first_triangle(run) <= triangle).checked_sub(1)?)
}

/// Consecutive triangles of one object, up to the next run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ObjectRun {
    /// The first triangle.
    pub first_triangle: u32,
    /// The number of the object among the nodes.
    pub node: u32,
}

/// Where the values of an input are.
pub trait AttributeValues {
    /// Copies values of vertices, beginning with a place.
    fn of_vertex(&self, place: u64, values: &mut [f32]);
    /// Copies values of corners, beginning with a place.
    fn of_corner(&self, place: u64, values: &mut [f32]);
}

impl AttributeValues for Attributes {
    fn of_vertex(&self, place: u64, values: &mut [f32]) {
        values.copy_from_slice(&self.vertex_values[place as usize..][..values.len()]);
    }

    fn of_corner(&self, place: u64, values: &mut [f32]) {
        values.copy_from_slice(&self.corner_values[place as usize..][..values.len()]);
    }
}

/// The attributes of the triangles of a region, all in the layout of the input's [`Appearance`].
#[derive(Clone, Debug, Default)]
pub struct RegionAttributes {
    /// For each triangle the records of its corners; empty if records have no numbers.
    pub corners: Vec<[u32; 3]>,
    /// The records, one after the other.
    pub records: Vec<f32>,
    /// The material of each triangle; empty if it is 0 for all.
    pub materials: Vec<u16>,
    /// The chart of each triangle; empty if the input is not cut into charts.
    pub charts: Vec<u32>,
    /// The object of each triangle, as a number of a node of the input; empty if it has none.
    pub objects: Vec<u32>,
}

impl PartialEq for RegionAttributes {
    /// Whether all bits are the same. Missing values are NaN, and equal.
    fn eq(&self, other: &Self) -> bool {
        let bits = |of: &Self| -> Vec<u32> { of.records.iter().map(|value| value.to_bits()).collect() };
        let is_same = self.corners == other.corners && self.materials == other.materials && self.charts == other.charts;
        is_same && self.objects == other.objects && bits(self) == bits(other)
    }
}

impl RegionAttributes {
    /// Gathers the attributes of triangles, which are given by their number in the input and their vertices there.
    pub fn gather(
        attributes: &Attributes,
        appearance: &Appearance,
        values: &impl AttributeValues,
        triangles: impl ExactSizeIterator<Item = (u32, [u32; 3])>,
    ) -> Self {
        let mut all = Self::default();
        if attributes.are_empty(appearance) {
            return all;
        }
        let layout = &appearance.layout;
        let blank = layout.blank();
        let places: Vec<_> = attributes.files.iter().map(|file| file.places(layout)).collect();
        let mut set = RecordSet::new(layout.stride);
        let (mut own, mut record) = (vec![], blank.clone());
        if layout.stride > 0 {
            all.corners.reserve_exact(triangles.len());
        }
        for (number, triangle) in triangles {
            let run = run_of(&attributes.materials, number, |run| run.first_triangle);
            all.materials.push(run.map_or(0, |run| run.material));
            if !attributes.charts.is_empty() {
                let run = run_of(&attributes.charts, number, |run| run.first_triangle);
                all.charts.push(run.map_or(0, |run| run.chart));
            }
            if !attributes.objects.is_empty() {
                all.objects.push(attributes.object(number));
            }
            if layout.stride == 0 {
                continue;
            }
            let index = attributes.files.partition_point(|file| file.first_triangle <= number).saturating_sub(1);
            let Some(file) = attributes.files.get(index) else { continue };
            own.resize(file.vertex_stride + file.corner_stride, 0.0);
            all.corners.push([0, 1, 2].map(|k| {
                let vertex = u64::from(triangle[k].wrapping_sub(file.first_vertex));
                let corner = 3 * u64::from(number - file.first_triangle) + k as u64;
                let (of_vertex, of_corner) = own.split_at_mut(file.vertex_stride);
                if !of_vertex.is_empty() {
                    values.of_vertex(file.first_vertex_value + vertex * file.vertex_stride as u64, of_vertex);
                }
                if !of_corner.is_empty() {
                    values.of_corner(file.first_corner_value + corner * file.corner_stride as u64, of_corner);
                }
                for ((value, place), &blank) in record.iter_mut().zip(&places[index]).zip(&blank) {
                    *value = place.map_or(blank, |place| own[place]);
                }
                set.number_of(&record, &mut all.records)
            }));
        }
        all.records.shrink_to_fit();
        if all.materials.iter().all(|&material| material == 0) {
            all.materials = vec![];
        }
        all
    }

    /// Keeps some triangles: their numbers before repair, and whether repair has reversed them.
    pub fn keep(&mut self, kept: impl ExactSizeIterator<Item = (u32, bool)>) {
        let (corners, materials) = (std::mem::take(&mut self.corners), std::mem::take(&mut self.materials));
        let (charts, objects) = (std::mem::take(&mut self.charts), std::mem::take(&mut self.objects));
        if !corners.is_empty() {
            self.corners.reserve_exact(kept.len());
        }
        if !materials.is_empty() {
            self.materials.reserve_exact(kept.len());
        }
        for (number, is_reversed) in kept {
            if let Some(&[a, b, c]) = corners.get(number as usize) {
                self.corners.push(if is_reversed { [a, c, b] } else { [a, b, c] });
            }
            self.materials.extend(materials.get(number as usize));
            self.charts.extend(charts.get(number as usize));
            self.objects.extend(objects.get(number as usize));
        }
    }

    /// The records of a triangle's corners.
    #[inline]
    pub fn records_of(&self, triangle: usize, stride: usize) -> [&[f32]; 3] {
        let corners = self.corners.get(triangle).copied().unwrap_or_default();
        corners.map(|corner| {
            self.records.get(corner as usize * stride..).and_then(|rest| rest.get(..stride)).unwrap_or_default()
        })
    }

    /// The number of a triangle's material.
    #[inline]
    pub fn material(&self, triangle: usize) -> u16 {
        self.materials.get(triangle).copied().unwrap_or(0)
    }

    /// Bytes of memory that it takes.
    pub fn bytes(&self) -> u64 {
        let numbers = self.records.len() + self.charts.len() + self.objects.len();
        (12 * self.corners.len() + 4 * numbers + 2 * self.materials.len()) as u64
    }

    /// Whether a region with this number of triangles can have these attributes.
    pub fn fits(&self, triangles: usize) -> bool {
        let of_all = |count: usize| count == 0 || count == triangles;
        let counts = [self.corners.len(), self.materials.len(), self.charts.len(), self.objects.len()];
        counts.into_iter().all(of_all)
    }
}

/// Numbers records by their bits: a hash table with open addressing that grows as needed.
struct RecordSet {
    stride: usize,
    /// Numbers of records; a free slot has [`super::NONE`]. The length is a power of two.
    slots: Vec<u32>,
    count: usize,
}

impl RecordSet {
    fn new(stride: usize) -> Self {
        Self { stride, slots: vec![super::NONE; 16], count: 0 }
    }

    /// The number of a record, which is appended to `records` if it is new.
    fn number_of(&mut self, record: &[f32], records: &mut Vec<f32>) -> u32 {
        if 4 * self.count > 3 * self.slots.len() {
            let mut larger = vec![super::NONE; 2 * self.slots.len()];
            for number in 0..self.count {
                let known = &records[number * self.stride..][..self.stride];
                let at = free(&larger, hash(known), |_| false);
                larger[at] = number as u32;
            }
            self.slots = larger;
        }
        let is_same = |number: u32| {
            let known = &records[number as usize * self.stride..][..self.stride];
            known.iter().zip(record).all(|(a, b)| a.to_bits() == b.to_bits())
        };
        let at = free(&self.slots, hash(record), is_same);
        if self.slots[at] == super::NONE {
            self.slots[at] = self.count as u32;
            self.count += 1;
            records.extend_from_slice(record);
        }
        self.slots[at]
    }
}

/// The slot of a record: the one that has it, or a free one.
fn free(slots: &[u32], hash: u64, is_same: impl Fn(u32) -> bool) -> usize {
    let mask = slots.len() - 1;
    let mut at = hash as usize & mask;
    while slots[at] != super::NONE && !is_same(slots[at]) {
        at = (at + 1) & mask;
    }
    at
}

fn hash(record: &[f32]) -> u64 {
    let mut hash = 0u64;
    for value in record {
        hash = (hash ^ u64::from(value.to_bits())).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        hash ^= hash >> 29;
    }
    hash ^ hash >> 32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_different_layouts_become_one_with_each_record_once() {
        let mut first = AttributeLayout::default();
        first.add_scalar("quality");
        let mut second = AttributeLayout::default();
        second.add_colour();
        second.add_uv(1);
        let mut layout = first.clone();
        layout.join(&second);
        assert_eq!((layout.stride, layout.colour, &layout.uv[..]), (7, Some(1), &[5][..]));
        let attributes = Attributes {
            files: vec![
                FileAttributes { vertex_stride: 1, layout: first, ..FileAttributes::default() },
                FileAttributes {
                    first_vertex: 3,
                    first_triangle: 1,
                    first_vertex_value: 3,
                    vertex_stride: 4,
                    corner_stride: 2,
                    layout: second,
                    ..FileAttributes::default()
                },
            ],
            materials: vec![MaterialRun { first_triangle: 1, material: 7 }],
            charts: vec![],
            nodes: vec![ObjectNode::default(); 4],
            objects: [(0, 3), (1, 2)].map(|(first_triangle, node)| ObjectRun { first_triangle, node }).to_vec(),
            vertex_values: [&[10.0, 11.0, 11.0][..], &[0.25; 12]].concat(),
            corner_values: vec![0.5, 0.5, 0.5, 0.5, 0.75, 0.5],
        };
        let appearance = Appearance { layout, has_colour: true, ..Appearance::default() };
        let triangles = [(0, [0, 1, 2]), (1, [3, 4, 5])];
        let mut region = RegionAttributes::gather(&attributes, &appearance, &attributes, triangles.into_iter());
        assert_eq!(region.corners, [[0, 1, 1], [2, 2, 3]]);
        assert_eq!((&region.materials[..], &region.objects[..]), (&[0, 7][..], &[3, 2][..]));
        assert_eq!(attributes.node_counts(), [2, 2]);
        let [a, b, _] = region.records_of(0, 7);
        assert_eq!((a[0], b[0], &a[1..5]), (10.0, 11.0, &[1.0; 4][..]));
        assert!(a[5].is_nan() && a[6].is_nan());
        let [_, _, c] = region.records_of(1, 7);
        assert!(c[0].is_nan());
        assert_eq!(c[1..], [0.25, 0.25, 0.25, 0.25, 0.75, 0.5]);
        assert!(region == region.clone() && region.fits(2) && !region.fits(3));
        region.keep([(1, true)].into_iter());
        assert_eq!((&region.corners[..], &region.materials[..]), (&[[2, 3, 2]][..], &[7][..]));
        assert_eq!(region.objects, [2]);
    }

    #[test]
    fn many_records_keep_their_numbers() {
        let (mut set, mut records) = (RecordSet::new(2), vec![]);
        for round in 0..2 {
            for i in 0..5000u32 {
                assert_eq!(set.number_of(&[i as f32, f32::NAN], &mut records), i, "{round}");
            }
        }
        assert_eq!(records.len(), 10_000);
    }
}
