//! A surface as an atlas has it: a mesh, and what its corners carry.

use std::collections::HashMap;
use std::path::PathBuf;

use super::image::GeometryImage;
use super::looks::ImageChannel;
use super::manifest::Manifest;
use super::patch_file::property;
use super::triangulate::Triangulated;
use crate::mesh::Mesh;
use crate::mesh::attributes::Surface;

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
}

/// A root or a patch.
pub(super) struct Piece {
    /// Its file.
    pub name: String,
    /// Its images of the channels that have texels; none of a patch.
    pub images: Vec<PathBuf>,
    /// How it is drawn, as files number it.
    pub drawing: u16,
}

/// What the vertices of a patch carry.
#[derive(Default)]
pub(super) struct PatchValues {
    /// Linear, with alpha; empty if there are none.
    colours: Vec<[f32; 4]>,
    /// Of each number, in the order of the atlas's channels of numbers; empty where there is none.
    numbers: Vec<Vec<f32>>,
}

impl PatchValues {
    /// Those of a file that was read.
    pub fn of(surface: &Surface) -> Self {
        let Some(file) = surface.attributes.files.first() else { return Self::default() };
        let records = surface.attributes.vertex_values.chunks_exact(file.vertex_stride.max(1));
        let colours =
            |place: usize| records.clone().filter_map(|record| record.get(place..)?.first_chunk().copied()).collect();
        let colours = file.layout.colour.map(colours).unwrap_or_default();
        let column = |place: usize| records.clone().filter_map(|record| record.get(place).copied()).collect();
        let place = |which: usize| {
            let name = property(which);
            file.layout.scalars.iter().find(|(known, _)| *known == name).map(|(_, place)| *place)
        };
        // Files of others may have more, in any order.
        let numbers = (0..file.layout.scalars.len()).map(|which| place(which).map(column).unwrap_or_default());
        Self { colours, numbers: numbers.collect() }
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
        let roots = manifest.roots.into_iter().zip(texels).map(|(root, images)| Piece {
            name: root.file,
            images,
            drawing: root.drawing,
        });
        let of_patches = manifest.patches.into_iter().map(|patch| Piece {
            name: patch.file,
            images: vec![],
            drawing: patch.drawing,
        });
        Self {
            mesh,
            channels: manifest.channels,
            pieces: roots.chain(of_patches).collect(),
            piece_of,
            points,
            last: images.iter().map(|image| image.last as u32).collect(),
            first,
            between,
            numbers,
            patches,
        }
    }

    /// Whether vertices of patches have colours.
    pub fn has_patch_colours(&self) -> bool {
        self.patches.iter().any(|patch| !patch.colours.is_empty())
    }

    /// The corners of a triangle, to ask for what they carry.
    pub fn corners(&self, triangle: usize) -> [Corner; 3] {
        let piece = self.piece_of[triangle];
        self.points[triangle].map(|point| Corner { piece, point })
    }

    /// Where a corner lies in its root, (s, t) from 0 to 1; NaN in a patch.
    pub fn place(&self, corner: Corner) -> [f32; 2] {
        let Some(&last) = self.last.get(corner.piece as usize) else { return [f32::NAN; 2] };
        let place = |point: u32| {
            let number = point - self.first[corner.piece as usize];
            [number % (last + 1), number / (last + 1)].map(|x| x as f32 / last as f32)
        };
        match self.between.get(&corner.point) {
            Some(&([from, to], share)) => {
                let ([s, t], [u, v]) = (place(from), place(to));
                [s + share * (u - s), t + share * (v - t)]
            }
            None => place(corner.point),
        }
    }

    /// The colour of a corner in a patch, linear with alpha; white elsewhere.
    pub fn colour(&self, corner: Corner) -> [f32; 4] {
        let colour = self.in_patch(corner).and_then(|(patch, vertex)| patch.colours.get(vertex).copied());
        colour.filter(|_| corner.piece as usize >= self.last.len()).unwrap_or([1.0; 4])
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

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    piece: u32,
    point: u32,
}
