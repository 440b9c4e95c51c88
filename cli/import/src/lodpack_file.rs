//! Reads a lodpack file as an input: its finest surface, with what it carries. So a file can be built again with
//! another tolerance, without channels, or together with others, when its own input is gone.

use std::collections::HashMap;
use std::fs::File;

use glam::DVec3;
use lodpack::decode::texels::{Image, Map};
use lodpack::decode::{Drawing, TexturedMesh};
use lodpack::index::{ChannelInfo, ChannelKind};
use lodpack::{Cut, Limits, Query};

use super::error::{ImportError, Parsed};
use super::sink::MeshSink;
use super::source::Source;
use lodpack_mesh::NONE;
use lodpack_mesh::appearance::{
    AlphaMode, COLOUR, EMISSIVE, METALLIC, Material, NORMAL, OCCLUSION, ROUGHNESS, TextureUse, Wrap,
};
use lodpack_mesh::attributes::{AttributeLayout, ObjectNode};
use lodpack_mesh::encoded::png;
use lodpack_mesh::images::ImageSource;
use lodpack_mesh::layers::{Layer, Look};
use lodpack_mesh::pages::{PagedMesh, Part};
use lodpack_mesh::srgb::LINEAR_OF_BYTE;

/// Bytes that decoding and joining take for a triangle, at most, without images.
const TRIANGLE_BYTES: u64 = 160;
/// Bytes of a texel while its image is packed into a page and coded: decoded, in the page, as PNG, for each channel.
const TEXEL_BYTES: u64 = 12;
/// A palette of more colours comes in as images.
const MOST_MATERIALS: usize = 32_768;
/// Pages are no larger than images that other programs read.
const PAGE_SIDE: u32 = 8192;

/// Reads the finest surface of a file.
pub(super) fn read_lodpack(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let fault = |error: lodpack::Error| ImportError::Lodpack { path: source.path.to_owned(), source: error };
    let io = |error| ImportError::Io { path: source.path.to_owned(), source: error };
    let file = File::open(source.path).map_err(io)?;
    let file = lodpack::File::open(file, Limits::default()).map_err(fault)?;
    let cut = file.select(&Query::default()).map_err(fault)?;
    let (look, channels) = wanted(file.channels(), sink);
    // What the file says of its triangles is not trusted with memory: decoding them checks it.
    let texels = if channels.is_empty() { 0 } else { TEXEL_BYTES * source.bytes.len() as u64 };
    sink.hold_whole(source, cut.triangle_count.saturating_mul(TRIANGLE_BYTES).saturating_add(texels))?;
    note_error(source, &cut);
    let objects = if sink.wants_objects() { objects_of(&file, &cut, sink).map_err(fault)? } else { vec![] };
    if channels.is_empty() {
        let mesh = file.extract(&cut).map_err(fault)?;
        sink.reserve(mesh.positions.len(), mesh.triangles.len())?;
        mesh.positions.into_iter().try_for_each(|position| sink.push_vertex(DVec3::from_array(position)))?;
        return mesh.triangles.into_iter().enumerate().try_for_each(|(number, triangle)| {
            objects.get(number).iter().for_each(|&&object| sink.set_object(object));
            sink.push_triangle(triangle)
        });
    }
    let textured = file.extract_textured(&cut, &channels).map_err(fault)?;
    let infos = channels.iter().filter_map(|&number| file.channels().get(usize::from(number)));
    let records = Records::new(&textured, &infos.collect::<Vec<_>>(), sink);
    let textures = || textured.textures.iter().filter_map(|texture| texture.map.as_ref());
    // Materials without images have no occlusion.
    let has_occlusion = file.channels().iter().any(|channel| channel.name == OCCLUSION);
    let are_palettes = textures().next().is_some() && textures().all(Map::is_palette) && !has_occlusion;
    push_textured(source, (&textured, &objects), (&look, are_palettes), &records, sink)
}

/// Adds the objects of a file; returns which one each triangle of a cut of leaves belongs to, in the sink's numbers.
/// Without objects there are none.
fn objects_of(file: &lodpack::File<File>, cut: &Cut, sink: &mut MeshSink) -> lodpack::Result<Vec<u32>> {
    let Some(objects) = file.objects() else { return Ok(vec![]) };
    let mut nodes = objects.nodes()?;
    let mut numbers: Vec<Option<u32>> = vec![None; nodes.len()];
    for node in 0..nodes.len() {
        // Parents come first. Reading has checked that there are no circles.
        let mut waiting = vec![node];
        while let Some(&last) = waiting.last() {
            let parent = nodes[last].parent.map(|parent| parent as usize);
            match parent.filter(|&parent| parent < nodes.len() && numbers[parent].is_none()) {
                Some(parent) if waiting.len() <= nodes.len() => waiting.push(parent),
                _ => {
                    waiting.pop();
                    if numbers[last].is_none() {
                        let parent = parent.and_then(|parent| *numbers.get(parent)?);
                        numbers[last] = Some(sink.add_node(ObjectNode { parent, ..std::mem::take(&mut nodes[last]) }));
                    }
                }
            }
        }
    }
    let (_, of_triangles) = file.extract_objects_with_borders(cut, 0)?;
    let number = |object: u32| numbers.get(object as usize).copied().flatten();
    Ok(of_triangles.into_iter().map(|object| object.and_then(number).unwrap_or(NONE)).collect())
}

/// Certified errors of the new file are to this surface, not to the one that it was made from.
fn note_error(source: &Source, cut: &Cut) {
    if cut.error > 0.0 {
        source.note(&format!(
            "its finest surface is built again, which is at most {:.3e} off what it was made from; errors of the new file do not include that",
            cut.error
        ));
    }
}

/// The channels that are wanted: the look, and behind it numbers and normals of vertices.
fn wanted(channels: &[ChannelInfo], sink: &mut MeshSink) -> (Look, Vec<u8>) {
    let mut kept = channels.to_vec();
    for channel in &mut kept {
        let is_known = match channel.kind {
            ChannelKind::Colour => [COLOUR, EMISSIVE].contains(&channel.name.as_str()),
            ChannelKind::Factor => [OCCLUSION, METALLIC, ROUGHNESS].contains(&channel.name.as_str()),
            ChannelKind::Normal => channel.name == NORMAL && sink.attributes.wants_normals(true),
            ChannelKind::Scalar | ChannelKind::Label | ChannelKind::Drawing => true,
            _ => false,
        };
        let is_wanted = is_known && sink.attributes.finds(&channel.name, "lodpack file");
        if !is_known {
            sink.leave_out("some channels");
        }
        if !is_wanted {
            // So that nothing finds it.
            channel.kind = ChannelKind::Unknown(u8::MAX);
        }
    }
    let (mut look, mut numbers) = Look::of(&kept, true);
    look.layers.retain(|&layer| layer != Layer::Normal);
    let is_more = |channel: &ChannelInfo| matches!(channel.kind, ChannelKind::Scalar | ChannelKind::Label);
    let more = (0u8..=u8::MAX).zip(&kept).filter(|(_, channel)| is_more(channel)).map(|(number, _)| number);
    numbers.extend(more);
    (look, numbers)
}

/// Normals and numbers of vertices.
struct Records {
    layout: AttributeLayout,
    /// For each vertex of the mesh as many numbers as the layout has.
    values: Vec<f32>,
}

impl Records {
    fn new(textured: &TexturedMesh, channels: &[&ChannelInfo], sink: &mut MeshSink) -> Self {
        let mut layout = AttributeLayout::default();
        let mut columns = vec![];
        for (number, channel) in channels.iter().enumerate() {
            match channel.kind {
                ChannelKind::Normal => layout.add_normal(),
                ChannelKind::Scalar | ChannelKind::Label => layout.add_scalar(&channel.name),
                _ => continue,
            }
            columns.push((number, *channel));
        }
        let mut values = layout.blank().repeat(textured.mesh.positions.len());
        for (number, channel) in columns {
            let of_vertices = textured.vertex_values(number, channel.kind);
            let scalar = layout.scalars.iter().find(|(name, _)| *name == channel.name).map(|(_, place)| *place);
            for (record, known) in values.chunks_exact_mut(layout.stride).zip(of_vertices) {
                let Some(numbers) = known else { continue };
                match (channel.kind, layout.normal, scalar) {
                    (ChannelKind::Normal, Some(place), _) => {
                        (0..3).for_each(|k| record[place + k] = ((numbers[k] - 128.0) / 127.0) as f32);
                    }
                    (_, _, Some(place)) => record[place] = (channel.low + numbers[0] * channel.step) as f32,
                    _ => {}
                }
            }
        }
        if layout.stride > 0 {
            sink.set_vertex_layout(layout.clone());
        }
        Self { layout, values }
    }

    fn of(&self, vertex: u32) -> &[f32] {
        let stride = self.layout.stride;
        self.values.get(vertex as usize * stride..).and_then(|rest| rest.get(..stride)).unwrap_or_default()
    }
}

fn push_textured(
    source: &Source,
    (textured, objects): (&TexturedMesh, &[u32]),
    (look, are_palettes): (&Look, bool),
    records: &Records,
    sink: &mut MeshSink,
) -> Parsed<()> {
    let has_records = records.layout.stride > 0;
    let paged = PagedMesh::new(textured, look, PAGE_SIDE);
    let parts = paged.parts();
    let even = if are_palettes { EvenMaterials::of(&paged, &parts) } else { None };
    let has_images = !look.layers.is_empty() && even.is_none();
    let is_painted = !look.layers.is_empty() || !paged.drawings.is_empty();
    let first = match even.as_ref() {
        Some(even) => Some(sink.attributes.add_materials(even.materials.clone())?),
        None if is_painted => Some(add_materials(source, &paged, &parts, sink)?),
        None => None,
    };
    if has_images {
        let mut layout = AttributeLayout::default();
        layout.add_uv(1);
        sink.set_corner_layout(layout);
    }
    for (position, &(triangle, corner)) in paged.positions.iter().zip(&paged.corners) {
        sink.push_vertex(DVec3::from_array(*position))?;
        if has_records {
            let vertex = textured.mesh.triangles[triangle as usize][usize::from(corner)];
            sink.attributes.push_vertex(records.of(vertex));
        }
    }
    for (number, part) in parts.iter().enumerate() {
        if let Some(first) = first {
            // The last list has no texels.
            sink.set_material(if part.page < paged.pages.len() { first + number } else { 0 });
        }
        for &triangle in part.triangles.iter() {
            let (of_textured, _) = paged.corners[triangle[0] as usize];
            objects.get(of_textured as usize).iter().for_each(|&&object| sink.set_object(object));
            if let (Some(even), Some(first)) = (&even, first) {
                sink.set_material(even.of_triangles.get(&of_textured).map_or(0, |number| first + number));
            }
            if has_images {
                triangle.iter().for_each(|&vertex| sink.attributes.push_corner(&paged.places[vertex as usize]));
            }
            sink.push_triangle(triangle)?;
        }
    }
    Ok(())
}

/// Materials of palettes: one for each look, without images.
struct EvenMaterials {
    materials: Vec<Material>,
    /// Of each triangle of the textured mesh, if it has one.
    of_triangles: HashMap<u32, usize>,
}

impl EvenMaterials {
    /// None if there are too many.
    fn of(paged: &PagedMesh, parts: &[Part]) -> Option<Self> {
        let mut this = Self { materials: vec![], of_triangles: HashMap::new() };
        let mut known: HashMap<(Vec<u8>, Option<u16>), usize> = HashMap::new();
        for part in parts {
            let Some(page) = paged.pages.get(part.page) else { continue };
            for triangle in part.triangles.iter() {
                let mut bytes = vec![];
                let mut material = Material { alpha: AlphaMode::Opaque, ..Material::default() };
                for (layer, image) in page {
                    let texel = texel_at(image, paged.places[triangle[0] as usize]);
                    bytes.extend_from_slice(texel);
                    dress(&mut material, *layer, texel);
                }
                part.drawing.into_iter().for_each(|drawing| material.draw(drawing));
                let number = *known.entry((bytes, part.drawing.map(Drawing::number))).or_insert_with(|| {
                    this.materials.push(material);
                    this.materials.len() - 1
                });
                this.of_triangles.insert(paged.corners[triangle[0] as usize].0, number);
                if this.materials.len() > MOST_MATERIALS {
                    return None;
                }
            }
        }
        Some(this)
    }
}

/// The texel at a place, a share of an image's width and height.
fn texel_at(image: &Image<u8>, place: [f32; 2]) -> &[u8] {
    let [x, y] = [0, 1].map(|k| ((place[k] * image.size[k] as f32) as u32).min(image.size[k].saturating_sub(1)));
    image.texel(x, y)
}

/// Gives a material what a texel of a layer says.
fn dress(material: &mut Material, layer: Layer, texel: &[u8]) {
    let [red, green, blue] = [0, 1, 2].map(|k| texel.get(k).copied().unwrap_or_default());
    match layer {
        Layer::Colour => {
            let alpha = texel.get(3).map_or(1.0, |&alpha| f32::from(alpha) / 255.0);
            let [red, green, blue] = [red, green, blue].map(|byte| LINEAR_OF_BYTE[usize::from(byte)]);
            material.base_colour = [red, green, blue, alpha];
            if texel.len() == 4 {
                material.alpha = AlphaMode::Unstated;
            }
        }
        Layer::Emissive => material.emissive = [red, green, blue].map(|byte| LINEAR_OF_BYTE[usize::from(byte)]),
        Layer::Factors => {
            (material.roughness, material.metallic) = (f32::from(green) / 255.0, f32::from(blue) / 255.0);
        }
        Layer::Normal => {}
    }
}

/// Adds a material for each part; returns the number of the first.
fn add_materials(source: &Source, paged: &PagedMesh, parts: &[Part], sink: &mut MeshSink) -> Parsed<usize> {
    let of_pages = materials_of_pages(source, paged, sink)?;
    let of_part = |part: &Part| {
        let mut material = of_pages.get(part.page).cloned().unwrap_or_default();
        if let Some(drawing) = part.drawing {
            material.draw(drawing);
        }
        material
    };
    sink.attributes.add_materials(parts.iter().map(of_part).collect())
}

/// A material for each page.
fn materials_of_pages(source: &Source, paged: &PagedMesh, sink: &mut MeshSink) -> Parsed<Vec<Material>> {
    let mut materials = vec![];
    for (number, page) in paged.pages.iter().enumerate() {
        let mut material = Material { name: format!("page {number}"), alpha: AlphaMode::Opaque, ..Material::default() };
        for (layer, image) in page {
            let bytes = png(image).map_err(|error| ImportError::Io { path: source.path.to_owned(), source: error })?;
            let name = format!("{}: page {number}, {layer:?}", source.path.display());
            let image_number = sink.attributes.add_image(ImageSource::Inline { name, bytes });
            let texture = TextureUse { image: image_number, uv_set: 0, wrap: [Wrap::Clamp; 2], transform: None };
            match layer {
                Layer::Colour => {
                    material.base_texture = Some(texture);
                    if image.components == 4 {
                        material.alpha = AlphaMode::Unstated;
                    }
                }
                Layer::Emissive => (material.emissive, material.emissive_texture) = ([1.0; 3], Some(texture)),
                Layer::Factors => {
                    material.metallic = 1.0;
                    material.metallic_roughness_texture = Some(texture.clone());
                    material.occlusion_texture = Some((texture, 1.0));
                }
                Layer::Normal => {}
            }
        }
        materials.push(material);
    }
    Ok(materials)
}
