//! A surface as an atlas has it: a mesh, and what its corners carry.

use std::collections::HashMap;
use std::path::PathBuf;

use super::image::GeometryImage;
use super::looks::ImageChannel;
use super::manifest::Manifest;
use super::patch_file::property;
use super::triangulate::Triangulated;
use lodpack_mesh::Mesh;
use lodpack_mesh::attributes::Surface;

/// A surface that was read from an atlas.
pub(super) struct AtlasSurface {
    /// In input units.
    pub mesh: Mesh,
    /// The channels that its pieces have.
    pub channels: Vec<ImageChannel>,
    /// The pieces that triangles are parts of: roots, and patches behind them.
    pub pieces: Vec<Piece>,
    /// For each triangle the number of its piece; pieces follow each other.
    pub piece_of: Vec<u32>,
    /// The points at the corners of each triangle.
    points: Vec<[u32; 3]>,
    /// The first point of each piece.
    first: Vec<u32>,
    /// Samples along a side of each root, less one.
    last: Vec<u32>,
    /// For vertices of patches between two samples of a root: these, and how far they are from the first to the second.
    between: HashMap<u32, ([u32; 2], f32)>,
    /// Of each channel of numbers, sample after sample, root after root.
    numbers: Vec<Vec<f32>>,
    patches: Vec<PatchValues>,
    /// The first triangle of the patches, which come last.
    first_of_patches: usize,
    /// For each corner of the patches' triangles its place in the patch's images, from 0 to 1; NaN where it has none.
    patch_places: Vec<[f32; 2]>,
}

/// A root or a patch.
pub(super) struct Piece {
    /// Its file.
    pub name: String,
    /// Whether the samples of its images are at the places of a lattice.
    pub is_root: bool,
    /// Its images of the channels that have texels.
    pub images: Vec<PathBuf>,
    /// How it is drawn, as files number it.
    pub drawing: u16,
    /// The chart that it is, or a part of.
    pub chart: u32,
}

/// What the vertices of a patch carry.
#[derive(Default)]
pub(super) struct PatchValues {
    /// For each corner its place in the images, from the left and from above; empty if there are none.
    places: Vec<[f32; 2]>,
    /// Of each number, in the order of the atlas's channels of numbers; empty where there is none.
    numbers: Vec<Vec<f32>>,
}

impl PatchValues {
    /// Those of a file that was read.
    pub fn of(surface: &Surface) -> Self {
        let Some(file) = surface.attributes.files.first() else { return Self::default() };
        let records = surface.attributes.vertex_values.chunks_exact(file.vertex_stride.max(1));
        let corners = surface.attributes.corner_values.chunks_exact(file.corner_stride.max(1));
        let places_at = |at: usize| corners.filter_map(|record| record.get(at..)?.first_chunk().copied()).collect();
        // Coordinates of corners come behind what vertices have.
        let first = file.layout.uv.first().and_then(|at| at.checked_sub(file.vertex_stride));
        let places = first.map(places_at).unwrap_or_default();
        let column = |place: usize| records.clone().filter_map(|record| record.get(place).copied()).collect();
        let place = |which: usize| {
            let name = property(which);
            file.layout.scalars.iter().find(|(known, _)| *known == name).map(|(_, place)| *place)
        };
        // Files of others may have more, in any order.
        let numbers = (0..file.layout.scalars.len()).map(|which| place(which).map(column).unwrap_or_default());
        Self { places, numbers: numbers.collect() }
    }
}

impl AtlasSurface {
    pub(super) fn new(
        manifest: Manifest,
        images: &[GeometryImage],
        triangulated: Triangulated,
        texels: Vec<Vec<PathBuf>>,
        numbers: Vec<Vec<f32>>,
        patches: Vec<PatchValues>,
    ) -> Self {
        let Triangulated { mesh, points, pieces: piece_of, first, between } = triangulated;
        let charts = charts_of(&manifest);
        let roots = manifest.roots.into_iter().map(|root| (root.file, true, root.drawing));
        let of_patches = manifest.patches.into_iter().map(|patch| (patch.file, false, patch.drawing));
        let pieces = roots.chain(of_patches).zip(texels).zip(charts);
        let piece = |(((name, is_root, drawing), images), chart)| Piece { name, is_root, images, drawing, chart };
        let pieces = pieces.map(piece);
        let first_of_patches = piece_of.partition_point(|&piece| (piece as usize) < images.len());
        let mut patch_places = vec![];
        for (number, patch) in (images.len() as u32..).zip(&patches) {
            patch_places.extend(&patch.places);
            let corners = 3 * (piece_of.partition_point(|&piece| piece <= number) - first_of_patches);
            patch_places.resize(corners, [f32::NAN; 2]);
        }
        Self {
            mesh,
            channels: manifest.channels,
            pieces: pieces.collect(),
            first_of_patches,
            patch_places,
            piece_of,
            points,
            last: images.iter().map(|image| image.last as u32).collect(),
            first,
            between,
            numbers,
            patches,
        }
    }

    /// The corners of a triangle, to ask for what they carry.
    pub fn corners(&self, triangle: usize) -> [Corner; 3] {
        let [a, b, c] = self.points[triangle];
        let piece = self.piece_of[triangle];
        [(a, 0), (b, 1), (c, 2)].map(|(point, k)| Corner { piece, point, number: 3 * triangle + k })
    }

    /// Where a corner lies in its root, (s, t) from 0 to 1, or in the images of its patch. NaN where that is not known.
    pub fn place(&self, corner: Corner) -> [f32; 2] {
        let Some(&last) = self.last.get(corner.piece as usize) else {
            let number = corner.number - 3 * self.first_of_patches;
            return self.patch_places.get(number).copied().unwrap_or([f32::NAN; 2]);
        };
        let place = |point: u32| match point.checked_sub(self.first[corner.piece as usize]) {
            Some(number) => [number % (last + 1), number / (last + 1)].map(|x| x as f32 / last as f32),
            // Two roots that are declared to have one border have triangles there that are one of both.
            None => [f32::NAN; 2],
        };
        match self.between.get(&corner.point) {
            Some(&([from, to], share)) => {
                let ([s, t], [u, v]) = (place(from), place(to));
                [s + share * (u - s), t + share * (v - t)]
            }
            None => place(corner.point),
        }
    }

    /// A number, counted among the channels of numbers. NaN where there is none.
    pub fn number(&self, which: usize, corner: Corner) -> f32 {
        let number = match self.in_patch(corner) {
            Some((patch, vertex)) => patch.numbers.get(which).and_then(|numbers| numbers.get(vertex)),
            None => self.numbers.get(which).and_then(|numbers| numbers.get(corner.point as usize)),
        };
        number.copied().unwrap_or(f32::NAN)
    }

    /// The patch that a point is a vertex of, and which one.
    fn in_patch(&self, corner: Corner) -> Option<(&PatchValues, usize)> {
        let piece = self.first.partition_point(|&first| first <= corner.point).checked_sub(1)?;
        let patch = self.patches.get(piece.checked_sub(self.last.len())?)?;
        Some((patch, (corner.point - self.first[piece]) as usize))
    }
}

/// The chart of each piece: roots may share one, patches do not.
fn charts_of(manifest: &Manifest) -> Vec<u32> {
    let (mut numbers, mut count) = (HashMap::new(), 0);
    let of_roots = manifest.roots.iter().map(|root| root.chart);
    let of_pieces = of_roots.chain(manifest.patches.iter().map(|_| None));
    let next = |chart: Option<u32>| {
        let known = chart.and_then(|chart| numbers.get(&chart).copied());
        known.unwrap_or_else(|| {
            count += 1;
            chart.and_then(|chart| numbers.insert(chart, count - 1));
            count - 1
        })
    };
    of_pieces.map(next).collect()
}

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    piece: u32,
    point: u32,
    /// Among all corners.
    number: usize,
}
