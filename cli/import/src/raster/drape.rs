//! Colours of a raster's surface: an image over it, through coordinates of corners, or a ramp over its heights, through
//! colours of vertices.

use std::path::Path;

use lodpack::heights::Ramp;

use super::affine::{of_world_file, placed as georeferenced};
use super::crs::{Crs, CrsKind};
use super::header::Georeference;
use super::mosaic::Mosaic;
use super::options::RasterOptions;
use super::pam::Pam;
use super::{Parsed, grid_error, mask, tiff};
use crate::sink::MeshSink;
use crate::usable_image::check;
use lodpack_mesh::appearance::{AlphaMode, COLOUR, Material, TextureUse, Wrap};
use lodpack_mesh::attributes::AttributeLayout;
use lodpack_mesh::images::{EncodedImage, ImageSource, has_opacity, image_size, unreadable};
use lodpack_mesh::srgb::linear_from_srgb;
use lodpack_runtime::progress::Progress;

/// Makes the records of vertices and corners.
pub(super) struct Painter {
    ramp: Option<Ramp>,
    /// From column and row to the image: what is added after what is multiplied, each for both axes.
    image: Option<[[f64; 2]; 2]>,
}

impl Painter {
    /// Declares to the sink what the surface will carry.
    pub fn new(mosaic: &Mosaic, options: &RasterOptions, sink: &mut MeshSink, progress: &dyn Progress) -> Parsed<Self> {
        let mut painter = Self { ramp: None, image: None };
        let source = if options.drape.is_some() { "drape" } else { "ramp" };
        if options.drape.is_none() && options.ramp.is_none() || !sink.attributes.finds(COLOUR, source) {
            return Ok(painter);
        }
        let mut layout = AttributeLayout::default();
        if let Some(drape) = &options.drape {
            let image = ImageSource::File { path: drape.clone(), range: None };
            let placed = place_of(mosaic, drape, &image)?;
            let note = |problem: &str| progress.note(&format!("{}: {problem}", drape.display()));
            if placed.has_opacity {
                note("says how opaque its pixels are, or which of them count; all are shown as if they were opaque");
            }
            if placed.is_part {
                note("covers only a part of the grid; its border is drawn out over the rest");
            }
            painter.image = Some(placed.map);
            let image = sink.attributes.add_image(image);
            let texture = TextureUse { image, uv_set: 0, wrap: [Wrap::Clamp; 2], transform: None };
            let name = drape.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
            let alpha = AlphaMode::Opaque;
            let material = Material { name, base_texture: Some(texture), alpha, ..Material::default() };
            let number = sink.attributes.add_materials(vec![material])?;
            sink.set_material(number);
            layout.add_uv(1);
            sink.set_corner_layout(layout);
        } else if let Some(ramp) = &options.ramp {
            let range = if ramp.needs_range() { mosaic.range(options)? } else { [0.0, 1.0] };
            // Ramps are checked when they are read.
            painter.ramp = ramp.over(range, mosaic.metres_of_heights()).ok();
            layout.add_colour();
            sink.set_vertex_layout(layout);
        }
        Ok(painter)
    }

    /// Whether vertices have records.
    #[inline]
    pub fn has_vertices(&self) -> bool {
        self.ramp.is_some()
    }

    /// Whether corners have records: around the globe, a vertex has two places in the image.
    #[inline]
    pub fn has_corners(&self) -> bool {
        self.image.is_some()
    }

    /// The record of a vertex with a height.
    pub fn vertex(&self, height: f64, record: &mut Vec<f32>) {
        record.clear();
        if let Some(ramp) = &self.ramp {
            record.extend(colour(ramp, height));
        }
    }

    /// The record of a corner at a column and a row.
    pub fn corner(&self, column: f64, row: f64, record: &mut Vec<f32>) {
        record.clear();
        if let Some([scale, offset]) = self.image {
            record.extend([(column * scale[0] + offset[0]) as f32, (row * scale[1] + offset[1]) as f32]);
        }
    }
}

/// Red, green, blue and alpha in linear light.
fn colour(ramp: &Ramp, height: f64) -> [f32; 4] {
    let stops = ramp.stops();
    let above = stops.partition_point(|stop| stop.height <= height);
    let [from, to] = [above.saturating_sub(1), above.min(stops.len() - 1)].map(|number| stops[number]);
    let width = to.height - from.height;
    let share = if width > 0.0 { ((height - from.height) / width).clamp(0.0, 1.0) as f32 } else { 0.0 };
    let mixed = [0, 1, 2].map(|i| {
        let [from, to] = [from, to].map(|stop| f32::from(stop.colour[i]) / 255.0);
        linear_from_srgb(from + share * (to - from))
    });
    [mixed[0], mixed[1], mixed[2], 1.0]
}

/// What to do about an image that cannot be shown.
const REMEDY: &str = "convert it first, with `gdal_translate -of PNG`, and `-expand rgb` if it has a palette";

/// Where an image is over a grid.
pub(super) struct PlacedImage {
    /// From column and row to the image, whose ends are 0 and 1: what is multiplied, and what is added after that, each
    /// for both axes.
    pub map: [[f64; 2]; 2],
    /// Pixels in a row, and rows.
    pub size: [u32; 2],
    /// Whether it says how opaque its pixels are, or which of them count.
    pub has_opacity: bool,
    /// Whether it does not cover the whole grid.
    pub is_part: bool,
}

/// Where an image is: by its own georeference, or over the whole grid, whose edges are half a sample outside.
pub(super) fn place_of(mosaic: &Mosaic, drape: &Path, image: &ImageSource) -> Parsed<PlacedImage> {
    // Somebody asked for it, so a surface without it would not be what was asked for.
    let refuse = |problem: String| grid_error(drape, &format!("cannot be shown: {problem}; {REMEDY}"));
    let extent = check(image).and_then(|()| image_size(open(image)?)).map_err(refuse)?;
    let mut pam = Pam::beside(drape)?;
    let (affine, crs, has_mask) = tiff::place_of_image(drape, &mut pam)?.unwrap_or_default();
    let has_opacity =
        has_mask || mask::beside(drape).is_some() || has_opacity(open(image).map_err(refuse)?).map_err(refuse)?;
    let mut placed = PlacedImage { map: [[0.0; 2]; 2], size: extent, has_opacity, is_part: false };
    let affine = match affine {
        Some(affine) => Some(affine),
        None => of_world_file(drape)?.or(pam.place),
    };
    let crs = if crs.says_nothing() { Crs::beside(drape)?.or(pam.crs) } else { crs };
    let size = mosaic.size.map(|size| size as f64);
    let whole = [size.map(|size| 1.0 / size), size.map(|size| 0.5 / size)];
    let (Some(image), turned) = georeferenced(affine, drape, extent)? else {
        placed.map = whole;
        return Ok(placed);
    };
    image.check(drape)?;
    if !crs.name.is_empty() && !mosaic.crs.name.is_empty() && crs.name != mosaic.crs.name {
        let problem = format!(
            "is in {}, and the grid in {}; bring it into the same, with `gdalwarp -t_srs`",
            crs.name, mosaic.crs.name
        );
        return Err(grid_error(drape, &problem));
    }
    let Georeference { first, spacing } = mosaic.place;
    let extent = extent.map(f64::from);
    // Coordinates of the image count from its edge, half a pixel before the first sample.
    let mut scale = [spacing[0] / (image.spacing[0] * extent[0]), spacing[1] / (image.spacing[1] * extent[1])];
    let mut offset = [
        ((first[0] - image.first[0]) / image.spacing[0] + 0.5) / extent[0],
        ((image.first[1] - first[1]) / image.spacing[1] + 0.5) / extent[1],
    ];
    if mosaic.crs.kind == CrsKind::Geographic {
        // The same place, once more around the globe.
        let turn = 360.0 / (image.spacing[0] * extent[0]);
        let middle = offset[0] + 0.5 * size[0] * scale[0];
        offset[0] -= ((middle - 0.5) / turn).round() * turn;
    }
    let [left, top] = offset;
    let [right, bottom] = [0, 1].map(|k| offset[k] + (size[k] - 1.0) * scale[k]);
    let within = |at: f64| (-1e-6..=1.0 + 1e-6).contains(&at);
    placed.is_part = ![left, top, right, bottom].into_iter().all(within);
    if left > 1.0 || top > 1.0 || right < 0.0 || bottom < 0.0 {
        return Err(grid_error(drape, "lies beside the grid: their georeferences do not meet; check its CRS"));
    }
    for axis in [0, 1].into_iter().filter(|&axis| turned[axis]) {
        (scale[axis], offset[axis]) = (-scale[axis], 1.0 - offset[axis]);
    }
    placed.map = [scale, offset];
    Ok(placed)
}

/// The encoded bytes of an image.
fn open(image: &ImageSource) -> Result<Box<dyn EncodedImage + '_>, String> {
    image.open(None).map_err(|error| unreadable(&error))
}
