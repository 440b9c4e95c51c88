//! Reads an atlas directory as an input: a mesh whose materials are the images of its roots.

use std::path::Path;

use lodpack::decode::Drawing;

use super::AtlasError;
use super::looks::{ImageChannel, ImageKind};
use super::read::read_surface;
use super::surface::AtlasSurface;
use lodpack_import::{ImportError, ImportOptions, Imported, MeshSink, Room, import_with};
use lodpack_mesh::appearance::{
    AlphaMode, COLOUR, DRAWING, EMISSIVE, METALLIC, Material, NORMAL, OCCLUSION, ROUGHNESS, TextureUse, Wrap,
};
use lodpack_mesh::attributes::AttributeLayout;
use lodpack_mesh::images::ImageSource;
use lodpack_runtime::progress::Progress;

type Pushed<T> = Result<T, Box<ImportError>>;

/// Reads the atlas in a directory, with what its surface carries.
///
/// # Errors
/// [`AtlasError`], which names the file; and those of imports.
pub fn import_atlas(
    dir: &Path,
    room: &Room,
    options: &ImportOptions,
    progress: &dyn Progress,
) -> Result<Imported, AtlasError> {
    let mut atlas = read_surface(dir, &options.channels)?;
    progress.note("errors of the file are to the images, not to what these were made of");
    Ok(import_with(dir, room, options, progress, |sink| push(&mut atlas, !options.new_charts, sink))?)
}

fn push(atlas: &mut AtlasSurface, has_charts: bool, sink: &mut MeshSink) -> Pushed<()> {
    let first = add_materials(atlas, sink)?;
    let layout = layout_of(atlas, sink);
    let positions = std::mem::take(&mut atlas.mesh.positions);
    sink.reserve(positions.len(), atlas.mesh.triangles.len())?;
    if layout.stride > 0 {
        sink.set_corner_layout(layout.clone());
    }
    positions.into_iter().try_for_each(|position| sink.push_vertex(position))?;
    let numbers = numbers_of(atlas);
    let place_of = |name: &String| layout.scalars.iter().find(|(known, _)| known == name).map(|(_, place)| *place);
    // Which number goes where, of those that are wanted.
    let scalars: Vec<(usize, usize)> =
        numbers.iter().enumerate().filter_map(|(which, name)| Some((which, place_of(name)?))).collect();
    let mut record = layout.blank();
    let mut latest = None;
    for (triangle, &piece) in atlas.piece_of.iter().enumerate() {
        if latest.replace(piece) != Some(piece) {
            sink.set_material(first.map_or(0, |first| first + piece as usize));
            if has_charts {
                sink.set_chart(atlas.pieces[piece as usize].chart);
            }
        }
        for corner in atlas.corners(triangle) {
            layout.uv.iter().for_each(|&place| record[place..place + 2].copy_from_slice(&atlas.place(corner)));
            scalars.iter().for_each(|&(which, place)| record[place] = atlas.number(which, corner));
            if layout.stride > 0 {
                sink.attributes.push_corner(&record);
            }
        }
        sink.push_triangle(atlas.mesh.triangles[triangle])?;
    }
    Ok(())
}

/// The names of the channels of numbers.
fn numbers_of(atlas: &AtlasSurface) -> Vec<String> {
    let numbers = atlas.channels.iter().filter(|channel| !channel.kind.has_texels());
    numbers.map(|channel| channel.name.clone()).collect()
}

/// What corners carry, of what is wanted.
fn layout_of(atlas: &AtlasSurface, sink: &mut MeshSink) -> AttributeLayout {
    let mut layout = AttributeLayout::default();
    if atlas.channels.iter().any(|channel| channel.kind.has_texels()) && sink.attributes.wants_materials() {
        layout.add_uv(1);
    }
    for name in numbers_of(atlas) {
        if sink.attributes.finds(&name, "atlas") {
            layout.add_scalar(&name);
        }
    }
    layout
}

/// Adds a material for each piece, if something of materials is wanted; returns the number of the first.
fn add_materials(atlas: &AtlasSurface, sink: &mut MeshSink) -> Pushed<Option<usize>> {
    let is_painted = atlas.channels.iter().any(|channel| channel.kind.has_texels())
        || atlas.pieces.iter().any(|piece| piece.drawing != 0);
    if !is_painted || !sink.attributes.wants_materials() {
        return Ok(None);
    }
    let has_drawings = atlas.pieces.iter().any(|piece| piece.drawing != 0);
    let mut materials = vec![];
    for piece in &atlas.pieces {
        let mut material = Material { name: piece.name.clone(), ..Material::default() };
        if has_drawings && sink.attributes.finds(DRAWING, "atlas") {
            material.draw(Drawing::of_number(piece.drawing));
        }
        let of_texels = atlas.channels.iter().filter(|channel| channel.kind.has_texels());
        for (channel, path) in of_texels.zip(&piece.images) {
            let source = ImageSource::File { path: path.clone(), range: None };
            let image = sink.attributes.add_image(source);
            let texture = texture_of(channel, image, piece.is_root);
            add_texture(&mut material, channel, texture, sink);
        }
        materials.push(material);
    }
    sink.attributes.add_materials(materials).map(Some)
}

/// How an image is used.
fn texture_of(channel: &ImageChannel, image: u32, is_root: bool) -> TextureUse {
    // Samples lie at the ends of a root's sides, texels half a texel from the border of an image.
    let side = ((1u32 << channel.resolution) + 1) as f32;
    let (step, start) = ((side - 1.0) / side, 0.5 / side);
    let transform = is_root.then_some([step, 0.0, start, 0.0, step, start]);
    TextureUse { image, uv_set: 0, wrap: [Wrap::Clamp; 2], transform }
}

/// Adds the image of a channel to a material.
fn add_texture(material: &mut Material, channel: &ImageChannel, texture: TextureUse, sink: &mut MeshSink) {
    match channel.kind {
        ImageKind::Colour => {
            sink.attributes.finds(COLOUR, "atlas");
            material.base_texture = Some(texture);
            if !channel.alpha && material.alpha == AlphaMode::Unstated {
                material.alpha = AlphaMode::Opaque;
            }
        }
        ImageKind::Normal => {
            sink.attributes.finds(NORMAL, "atlas");
            (material.normal_texture, material.has_object_normals) = (Some((texture, 1.0)), true);
        }
        ImageKind::Emissive => {
            sink.attributes.finds(EMISSIVE, "atlas");
            (material.emissive, material.emissive_texture) = ([1.0; 3], Some(texture));
        }
        ImageKind::Factors => {
            let has = |name: &str| channel.factors.iter().any(|known| known == name);
            [OCCLUSION, METALLIC, ROUGHNESS].into_iter().filter(|name| has(name)).for_each(|name| {
                sink.attributes.finds(name, "atlas");
            });
            if has(METALLIC) || has(ROUGHNESS) {
                material.metallic = if has(METALLIC) { 1.0 } else { 0.0 };
                material.metallic_roughness_texture = Some(texture.clone());
            }
            material.occlusion_texture = has(OCCLUSION).then_some((texture, 1.0));
        }
        ImageKind::Scalar | ImageKind::Label => {}
    }
}
