//! From charts to images.

use std::fs;
use std::path::Path;

use lodpack::decode::texels::Image;
use rayon::prelude::*;

use super::files::MIP_NAME;
use super::image::GeometryImage;
use super::looks::{ImageChannel, Texel, number};
use super::manifest::{ImageEdge, Manifest, Neighbour, Neighbours, Patch, Root};
use super::numbers::write_numbers;
use super::paint::{Borders, Painting};
use super::patch::{Surroundings, sampled_patch};
use super::patch_file::PatchFiles;
use super::product::{AtlasChart, AtlasProduct, Looks};
use super::quads::{sample_quads, samples_of_sides};
use super::sides::{SideId, partners_of, sample_arcs, sides_of_arcs};
use super::{AtlasError, MANIFEST_NAME, MAX_RESOLUTION, UNFINISHED_MANIFEST};
use lodpack_mesh::encoded::png;
use lodpack_runtime::progress::Progress;
use lodpack_stage::embed::quad_point;
use lodpack_stage::shade::{Face, Shader};

/// Bytes of the input's decoded images that are kept while an atlas is written.
const TEXTURE_MEMORY: u64 = 1 << 30;

/// How an atlas is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// The resolution of the images of positions and of numbers: each has (2^resolution + 1)^2 samples. About one
    /// sample for each vertex where there is none.
    pub resolution: Option<u32>,
    /// The resolution of images with texels. About one for each texel of the input where there is none.
    pub texel_resolution: Option<u32>,
    /// Whether all coarser resolutions are written, too.
    pub mips: bool,
}

impl WriteOptions {
    /// Positions and texels at one resolution, without mips.
    pub fn at(resolution: u32) -> Self {
        Self { resolution: Some(resolution), texel_resolution: Some(resolution), mips: false }
    }
}

/// The resolutions of an atlas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolutions {
    /// Of positions and numbers.
    pub positions: u32,
    /// Of images with texels.
    pub texels: u32,
    /// How many folders of coarser images there are.
    pub mips: u32,
}

/// Writes every chart as geometry images of (2^r + 1)^2 samples, one for each corner (`root_CCCCC_K.exr` for corner K
/// of chart C), with images of what the surface carries beside them (`root_CCCCC_K_colour.png`), every patch as
/// `patch_PPPPP.ply`, and `atlas.json` last: a folder without it is incomplete. Mips come first, each in a folder of
/// its own.
///
/// # Errors
/// If the folder cannot be made or written to, a resolution is above [`MAX_RESOLUTION`], or a position does not fit in
/// 32-bit floats.
pub fn write_atlas(
    dir: &Path,
    product: &AtlasProduct,
    options: &WriteOptions,
    progress: &dyn Progress,
) -> Result<Resolutions, AtlasError> {
    fs::create_dir_all(dir).map_err(|source| AtlasError::Write { path: dir.to_owned(), source })?;
    let note = |message: &str| progress.note(message);
    let shader = Shader::new(&product.looks.appearance, None, dir, TEXTURE_MEMORY, &note);
    let resolution = options.resolution.unwrap_or_else(|| product.default_resolution());
    let texels = options.texel_resolution.unwrap_or_else(|| product.texel_resolution(&shader));
    for resolution in [resolution, texels] {
        if resolution > MAX_RESOLUTION {
            let what = format!("resolution {resolution} is above {MAX_RESOLUTION}");
            return Err(AtlasError::Format { path: dir.join(MANIFEST_NAME), what });
        }
    }
    let mips = if options.mips { resolution } else { 0 };
    for mip in 1..=mips {
        let folder = dir.join(format!("{MIP_NAME}{mip:02}"));
        fs::create_dir_all(&folder).map_err(|source| AtlasError::Write { path: folder.clone(), source })?;
        write_level(&folder, product, &shader, mip, [resolution - mip, texels.saturating_sub(mip)])?;
    }
    write_level(dir, product, &shader, 0, [resolution, texels])?;
    Ok(Resolutions { positions: resolution, texels, mips })
}

/// Writes one folder, at the resolutions of positions and of texels.
fn write_level(
    dir: &Path,
    product: &AtlasProduct,
    shader: &Shader,
    mip: u32,
    [resolution, texel_resolution]: [u32; 2],
) -> Result<(), AtlasError> {
    // Both sides of an arc take the same samples from here on.
    let charts = &product.charts;
    let arc_samples = sample_arcs(&product.arcs, resolution);
    let sides_of = sides_of_arcs(charts, product.arcs.len());
    let partners = partners_of(charts, &sides_of);
    let corner_count: Vec<u32> = charts.iter().map(|chart| chart.embedding.corner_count as u32).collect();
    // The root of corner k of chart c has the index first_root[c] + k.
    let mut next = 0;
    let mut first_root = Vec::with_capacity(charts.len());
    for count in &corner_count {
        first_root.push(next);
        next += count;
    }
    let around = Surroundings {
        arcs: &product.arcs,
        arc_samples: &arc_samples,
        sides_of: &sides_of,
        first_root: &first_root,
        corner_count: &corner_count,
    };

    let painting = Painting::new(product, shader, &sides_of);
    let channels = product.looks.channels(texel_resolution, resolution);
    let carried = Carried::new(&painting, &product.looks, &channels);
    let of_chart = |(index, chart): (usize, &AtlasChart)| {
        let images = chart_images(chart, &arc_samples, resolution);
        let mut names = carried.write(dir, index)?.into_iter();
        let mut roots = Vec::with_capacity(images.len());
        for (corner, image) in images.iter().enumerate() {
            let file = format!("root_{index:05}_{corner}.exr");
            image.write(&dir.join(&file))?;
            roots.push(Root {
                file,
                resolution,
                chart: Some(index as u32),
                corner: corner as u32,
                neighbours: neighbours_of(index, corner, &partners[index], &around),
                images: names.next().unwrap_or_default(),
                drawing: painting.drawing(index),
            });
        }
        Ok(roots)
    };
    let written: Vec<Result<Vec<Root>, AtlasError>> = charts.par_iter().enumerate().map(of_chart).collect();
    let roots: Vec<Vec<Root>> = written.into_iter().collect::<Result<_, _>>()?;
    let mut patches = Vec::with_capacity(product.patches.len());
    let patch_files = PatchFiles { dir, looks: &product.looks, channels: &channels, shader, mip };
    for (index, patch) in product.patches.iter().enumerate() {
        let sampled = sampled_patch(patch, &around);
        let (file, images) = patch_files.write(index, patch, &sampled)?;
        let drawing = patch.numbers.first().map_or(0, |&first| product.looks.drawing(first));
        patches.push(Patch { file, images, borders: sampled.borders, drawing });
    }
    shader.check()?;
    let roots = roots.into_iter().flatten().collect();
    write_manifest(dir, &Manifest::new(&product.header, channels, roots, patches))
}

/// Writes `atlas.json`, which appears when it is complete.
fn write_manifest(dir: &Path, manifest: &Manifest) -> Result<(), AtlasError> {
    let path = dir.join(MANIFEST_NAME);
    manifest.check().map_err(|what| AtlasError::Format { path: path.clone(), what })?;
    let text =
        serde_json::to_vec_pretty(manifest).map_err(|source| AtlasError::Manifest { path: path.clone(), source })?;
    let temporary = dir.join(UNFINISHED_MANIFEST);
    fs::write(&temporary, text).map_err(|source| AtlasError::Write { path: temporary.clone(), source })?;
    fs::rename(&temporary, &path).map_err(|source| AtlasError::Write { path, source })
}

/// What the surface carries, with the values along the sides of charts.
struct Carried<'a> {
    painting: &'a Painting<'a>,
    looks: &'a Looks,
    channels: &'a [ImageChannel],
    texels: Borders<Texel>,
    /// Of each channel of numbers.
    numbers: Vec<Borders<f32>>,
}

impl<'a> Carried<'a> {
    fn new(painting: &'a Painting<'a>, looks: &'a Looks, channels: &'a [ImageChannel]) -> Self {
        let first = channels.iter().find(|channel| channel.kind.has_texels());
        let texel = |face: &Face, weights, footprint| Texel::of(looks, face, weights, footprint);
        let texels = first.map(|channel| painting.borders(channel.resolution, &texel)).unwrap_or_default();
        let numbers = channels.iter().filter(|channel| !channel.kind.has_texels()).enumerate();
        let numbers = numbers.map(|(which, channel)| painting.borders(channel.resolution, &number(looks, which)));
        Self { painting, looks, channels, texels, numbers: numbers.collect() }
    }

    /// Writes the images of a chart; returns their names for each root.
    fn write(&self, dir: &Path, chart: usize) -> Result<Vec<Vec<String>>, AtlasError> {
        let mut names: Vec<Vec<String>> = vec![];
        let mut quads: Vec<Vec<Texel>> = vec![];
        let mut which = 0;
        for channel in self.channels {
            let side = (1usize << channel.resolution) + 1;
            let name = |corner: usize| format!("root_{chart:05}_{corner}_{}", channel.suffix(which));
            if channel.kind.has_texels() {
                if quads.is_empty() {
                    let texel = |face: &Face, weights, footprint| Texel::of(self.looks, face, weights, footprint);
                    quads = self.painting.quads(chart, channel.resolution, &self.texels, &texel);
                }
                for (corner, texels) in quads.iter().enumerate() {
                    let bytes = texels.iter().flat_map(|texel| texel.bytes(channel.kind, channel.alpha));
                    let data: Vec<u8> = bytes.copied().collect();
                    let components = (data.len() / texels.len()) as u8;
                    let image = Image { size: [side as u32; 2], components, data };
                    let path = dir.join(name(corner));
                    let written = png(&image).and_then(|bytes| fs::write(&path, bytes));
                    written.map_err(|source| AtlasError::Write { path, source })?;
                    add(&mut names, corner, name(corner));
                }
                continue;
            }
            let of_quads =
                self.painting.quads(chart, channel.resolution, &self.numbers[which], &number(self.looks, which));
            for (corner, numbers) in of_quads.iter().enumerate() {
                write_numbers(&dir.join(name(corner)), side, numbers)?;
                add(&mut names, corner, name(corner));
            }
            which += 1;
        }
        Ok(names)
    }
}

/// Adds the name of a root's file.
fn add(names: &mut Vec<Vec<String>>, corner: usize, name: String) {
    names.resize(names.len().max(corner + 1), vec![]);
    names[corner].push(name);
}

/// The images of positions of a chart's quads.
fn chart_images(chart: &AtlasChart, arc_samples: &[Vec<[f32; 3]>], resolution: u32) -> Vec<GeometryImage> {
    let embedding = &chart.embedding;
    let positions = embedding.positions(&chart.mesh);
    let locator = embedding.locator();
    let mut hint = 0;
    let evaluate = |quad, s, t| {
        // A point that is not found is not finite; such a sample is refused when the image is written.
        locator.find(quad_point(embedding.corner_count, quad, s, t), hint).map_or([f32::NAN; 3], |location| {
            hint = location.triangle;
            locator.evaluate(&positions, location).as_vec3().to_array()
        })
    };
    let images = sample_quads(resolution, &samples_of_sides(chart, arc_samples), evaluate);
    images.into_iter().map(|samples| GeometryImage { last: 1 << resolution, samples }).collect()
}

/// The neighbours of a quad's image. Spokes border on the quads beside them. Half-sides border on the other half of the
/// partner side, which runs the other way; but all outer edges of images run from the middle of a side to a corner, so
/// the edges run the same way.
fn neighbours_of(chart: usize, corner: usize, partners: &[Option<SideId>], around: &Surroundings) -> Neighbours {
    let (first_root, corner_count) = (around.first_root, partners.len());
    let previous = (corner + corner_count - 1) % corner_count;
    let next = (corner + 1) % corner_count;
    let same = |root: u32, edge| Some(Neighbour { root, edge, reversed: false });
    let partner_root = |side: usize, ahead: u32| {
        let partner = partners[side]?;
        let count = around.corner_count[partner.chart as usize];
        Some(first_root[partner.chart as usize] + (partner.side + ahead) % count)
    };
    Neighbours {
        left: same(first_root[chart] + next as u32, ImageEdge::Top),
        top: same(first_root[chart] + previous as u32, ImageEdge::Left),
        // The second half of the side before the corner is the first half of its partner.
        right: partner_root(previous, 0).and_then(|root| same(root, ImageEdge::Bottom)),
        // The first half of the side after the corner is the second half of its partner.
        bottom: partner_root(corner, 1).and_then(|root| same(root, ImageEdge::Right)),
    }
}
