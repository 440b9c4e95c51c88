//! Patches as PLY files, with numbers at their vertices and places in their images at their corners.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use glam::DVec2;
use lodpack::decode::texels::Image;

use super::AtlasError;
use super::looks::{ImageChannel, Texel, number};
use super::patch::{Between, SampledPatch};
use super::patch_image::PatchImage;
use super::product::{AtlasPatch, Looks};
use lodpack_mesh::encoded::png;
use lodpack_stage::shade::{Face, Shader};

/// The name of a property, the number of the scalar being known: names of scalars may be those of coordinates.
pub(super) fn property(which: usize) -> String {
    format!("number{which}")
}

/// Writes patches into a folder.
pub(super) struct PatchFiles<'a> {
    pub dir: &'a Path,
    pub looks: &'a Looks,
    pub channels: &'a [ImageChannel],
    pub shader: &'a Shader<'a>,
    /// Which mip the folder is; 0 for the finest.
    pub mip: u32,
}

impl PatchFiles<'_> {
    /// Writes a patch; `sampled` is the one with the samples of its borders. Returns the names of its mesh and of its
    /// images, one for each channel with texels.
    pub fn write(
        &self,
        index: usize,
        patch: &AtlasPatch,
        sampled: &SampledPatch,
    ) -> Result<(String, Vec<String>), AtlasError> {
        let name = format!("patch_{index:05}.ply");
        let mut images = vec![];
        let mut places = vec![];
        let with_texels: Vec<&ImageChannel> =
            self.channels.iter().filter(|channel| channel.kind.has_texels()).collect();
        if !with_texels.is_empty() {
            let image = PatchImage::new(patch, self.looks, self.shader, self.mip);
            for channel in with_texels {
                let name = format!("patch_{index:05}_{}", channel.suffix(0));
                self.write_image(&name, channel, &image)?;
                images.push(name);
            }
            places = sampled.places(patch, &image);
        }
        let numbers: Vec<Vec<f32>> =
            (0..self.looks.appearance.scalars.len()).map(|which| self.numbers(which, patch, sampled)).collect();
        let path = self.dir.join(&name);
        let write = || {
            let mut out = BufWriter::new(File::create(&path)?);
            write_ply(&mut out, &sampled.patch, &numbers, images.first().map(|image| (image.as_str(), &places[..])))?;
            out.flush()
        };
        write().map_err(|source| AtlasError::Write { path: path.clone(), source })?;
        Ok((name, images))
    }

    fn write_image(&self, name: &str, channel: &ImageChannel, image: &PatchImage) -> Result<(), AtlasError> {
        let bytes = |texel: &Texel| texel.bytes(channel.kind, channel.alpha).to_vec();
        let data: Vec<u8> = image.texels.iter().flat_map(bytes).collect();
        let components = (data.len() / image.texels.len().max(1)) as u8;
        let path = self.dir.join(name);
        let mut shown = Image { size: image.size, components, data };
        // What is averaged over more than a square goes on as at its border.
        shown.extrude(&image.drawn);
        let written = png(&shown).and_then(|bytes| fs::write(&path, bytes));
        written.map_err(|source| AtlasError::Write { path, source })
    }

    /// The number of each vertex in the first of its triangles; those of added vertices lie between them.
    fn numbers(&self, which: usize, patch: &AtlasPatch, sampled: &SampledPatch) -> Vec<f32> {
        let mut numbers = vec![None; patch.positions.len()];
        let mut painter = self.shader.painter(&self.looks.attributes);
        let value = number(self.looks, which);
        for (triangle, &number) in patch.triangles.iter().zip(&patch.numbers) {
            let face: Face = painter.face(number as usize, triangle.map(|v| patch.positions[v as usize]));
            for (corner, &v) in triangle.iter().enumerate() {
                let mut weights = [0.0; 3];
                weights[corner] = 1.0;
                numbers[v as usize].get_or_insert_with(|| value(&face, weights, 0.0));
            }
        }
        let mut numbers: Vec<f32> = numbers.into_iter().map(|number| number.unwrap_or(f32::NAN)).collect();
        let is_label = self.looks.appearance.scalars[which].is_label();
        for &Between { ends, share } in &sampled.added {
            let [a, b] = ends.map(|v| numbers[v as usize]);
            numbers.push(match is_label {
                true if share < 0.5 => a,
                true => b,
                false => (f64::from(a) + share * (f64::from(b) - f64::from(a))) as f32,
            });
        }
        numbers
    }
}

impl SampledPatch {
    /// The places in an image of the corners of all triangles, as shares of its size, counted from its lower left
    /// corner as PLY has them.
    fn places(&self, patch: &AtlasPatch, image: &PatchImage) -> Vec<[f32; 2]> {
        let size = DVec2::new(f64::from(image.size[0]), f64::from(image.size[1]));
        let mut places = Vec::with_capacity(3 * self.patch.triangles.len());
        for (triangle, &parent) in self.patch.triangles.iter().zip(&self.parents) {
            let own = |v: u32| {
                let corner = patch.triangles[parent as usize].iter().position(|&known| known == v).unwrap_or(0);
                image.places[parent as usize][corner]
            };
            for &v in triangle {
                let place = match (v as usize).checked_sub(patch.positions.len()) {
                    None => own(v),
                    Some(number) => {
                        let Between { ends: [a, b], share } = self.added[number];
                        own(a) + (own(b) - own(a)) * share
                    }
                };
                let place = place / size;
                places.push([place.x as f32, 1.0 - place.y as f32]);
            }
        }
        places
    }
}

/// Writes binary PLY with an image, and places in it for each corner.
fn write_ply(
    out: &mut impl Write,
    patch: &AtlasPatch,
    numbers: &[Vec<f32>],
    image: Option<(&str, &[[f32; 2]])>,
) -> io::Result<()> {
    out.write_all(b"ply\nformat binary_little_endian 1.0\n")?;
    if let Some((name, _)) = image {
        writeln!(out, "comment TextureFile {name}")?;
    }
    writeln!(out, "element vertex {}", patch.positions.len())?;
    out.write_all(b"property double x\nproperty double y\nproperty double z\n")?;
    (0..numbers.len()).try_for_each(|which| writeln!(out, "property float {}", property(which)))?;
    write!(out, "element face {}\nproperty list uchar uint vertex_indices\n", patch.triangles.len())?;
    if image.is_some() {
        out.write_all(b"property list uchar float texcoord\n")?;
    }
    out.write_all(b"end_header\n")?;
    for (vertex, position) in patch.positions.iter().enumerate() {
        position.to_array().iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        numbers.iter().try_for_each(|numbers| out.write_all(&numbers[vertex].to_le_bytes()))?;
    }
    for (number, triangle) in patch.triangles.iter().enumerate() {
        out.write_all(&[3])?;
        triangle.iter().try_for_each(|vertex| out.write_all(&vertex.to_le_bytes()))?;
        if let Some((_, places)) = image {
            out.write_all(&[6])?;
            let own = places[3 * number..][..3].iter().flatten();
            own.copied().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
    }
    Ok(())
}
