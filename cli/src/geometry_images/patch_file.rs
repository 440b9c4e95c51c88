//! Patches as PLY files, with what the surface carries at their vertices.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::AtlasError;
use super::looks::{ImageKind, Texel};
use super::patch::Between;
use super::product::{AtlasPatch, Looks};
use super::write::number;
use crate::mesh::export::{Column, write_ply};
use crate::stage::shade::{Face, Shader};

/// Writes a patch: `sampled` is the one with the samples of its borders, which `added` tells of.
pub(super) fn write_patch(
    path: &Path,
    patch: &AtlasPatch,
    sampled: &AtlasPatch,
    added: &[Between],
    looks: &Looks,
    shader: &Shader,
) -> Result<(), AtlasError> {
    let positions: Vec<[f64; 3]> = sampled.positions.iter().map(|p| p.to_array()).collect();
    let values = Values { patch, added, looks, shader };
    let columns: Vec<Column> = (0..looks.appearance.scalars.len()).map(|which| values.column(which)).collect();
    let colours = if looks.appearance.has_colour { values.colours() } else { vec![] };
    let write = || {
        let mut out = BufWriter::new(File::create(path)?);
        match colours.is_empty() {
            true => write_ply::<0>(&mut out, &positions, &sampled.triangles, &[], &columns)?,
            false => write_ply(&mut out, &positions, &sampled.triangles, &colours, &columns)?,
        }
        out.flush()
    };
    write().map_err(|source| AtlasError::Write { path: path.to_owned(), source })
}

/// The name of a property, the number of the scalar being known: names of scalars may be those of coordinates.
pub(super) fn property(which: usize) -> String {
    format!("number{which}")
}

/// Evaluates the vertices of a patch.
struct Values<'a> {
    patch: &'a AtlasPatch,
    added: &'a [Between],
    looks: &'a Looks,
    shader: &'a Shader<'a>,
}

impl Values<'_> {
    fn colours(&self) -> Vec<[u8; 4]> {
        let value = |face: &Face, weights, footprint| {
            let texel = Texel::of(self.looks, face, weights, footprint);
            let mut colour = [0; 4];
            colour.copy_from_slice(texel.bytes(ImageKind::Colour, true));
            colour
        };
        let mix = |a: [u8; 4], b: [u8; 4], share: f64| {
            [0, 1, 2, 3].map(|k| (f64::from(a[k]) + share * (f64::from(b[k]) - f64::from(a[k]))).round() as u8)
        };
        self.of_vertices([255; 4], value, mix)
    }

    fn column(&self, which: usize) -> Column {
        let is_label = self.looks.appearance.scalars.get(which).is_some_and(|range| range.is_label());
        let mix = |a: f32, b: f32, share: f64| match is_label {
            true if share < 0.5 => a,
            true => b,
            false => (f64::from(a) + share * (f64::from(b) - f64::from(a))) as f32,
        };
        let numbers = self.of_vertices(f32::NAN, number(self.looks, which), mix);
        let values = numbers.into_iter().map(f32::to_le_bytes).collect();
        Column { name: property(which), kind: "float", values }
    }

    /// The value of each vertex in the first of its triangles; those of added vertices lie between them.
    fn of_vertices<T: Copy>(
        &self,
        blank: T,
        value: impl Fn(&Face, [f32; 3], f32) -> T,
        mix: impl Fn(T, T, f64) -> T,
    ) -> Vec<T> {
        let AtlasPatch { positions, triangles, numbers, .. } = self.patch;
        let mut values: Vec<Option<T>> = vec![None; positions.len()];
        let mut painter = self.shader.painter(&self.looks.attributes);
        for (triangle, &number) in triangles.iter().zip(numbers) {
            if triangle.iter().all(|&v| values[v as usize].is_some()) {
                continue;
            }
            let [a, b, c] = triangle.map(|v| positions[v as usize]);
            let face = painter.face(number as usize, [a, b, c]);
            // What a vertex stands for: it has two triangles.
            let footprint = (b - a).cross(c - a).length().sqrt() as f32;
            for (corner, &v) in triangle.iter().enumerate() {
                let mut weights = [0.0; 3];
                weights[corner] = 1.0;
                values[v as usize].get_or_insert_with(|| value(&face, weights, footprint));
            }
        }
        let mut values: Vec<T> = values.into_iter().map(|value| value.unwrap_or(blank)).collect();
        for Between { ends: [a, b], share } in self.added {
            values.push(mix(values[*a as usize], values[*b as usize], *share));
        }
        values
    }
}
