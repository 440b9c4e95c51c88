//! Writes meshes with what they look like: PLY with colours of vertices, OBJ with a material file and pages of colours.
//! GLB is next door.

use std::io::{self, BufWriter, Write};

use lodpack::decode::TexturedMesh;
use lodpack::index::{ChannelInfo, ChannelKind};
use serde_json::{Value, json};

use super::export::{Column, normal_columns};
use super::layers::Layer;
use super::pages::PagedMesh;

/// Writes binary PLY: each vertex has the mean of what the triangles around it show there, and the label of one of
/// them. `colour` and `numbers` are places among the channels that the mesh has; `normals` are of its vertices, or
/// there are none.
///
/// # Errors
/// Any error of the writer.
pub fn write_textured_ply(
    out: impl Write,
    textured: &TexturedMesh,
    colour: Option<usize>,
    numbers: &[(usize, &ChannelInfo)],
    normals: Option<&[[f32; 3]]>,
) -> io::Result<()> {
    let (positions, triangles) = (&textured.mesh.positions, &textured.mesh.triangles);
    let mut columns: Vec<Column> = normals.map_or(vec![], normal_columns);
    for &(place, channel) in numbers {
        let mut column = column(textured, place, channel);
        // Other properties may have the name.
        while ["x", "y", "z", "red", "green", "blue", "alpha"].contains(&column.name.as_str())
            || columns.iter().any(|other| other.name == column.name)
        {
            column.name.push('_');
        }
        columns.push(column);
    }
    let mut out = BufWriter::with_capacity(1 << 20, out);
    match colour {
        Some(colour) => {
            super::export::write_ply(&mut out, positions, triangles, &vertex_colours(textured, colour), &columns)?;
        }
        None => super::export::write_ply::<0>(&mut out, positions, triangles, &[], &columns)?,
    }
    out.flush()
}

/// The numbers of a channel of one component: NaN, or the label 0, where nothing is known.
fn column(textured: &TexturedMesh, place: usize, channel: &ChannelInfo) -> Column {
    let is_label = channel.kind == ChannelKind::Label;
    let value = |values: Option<[f64; 4]>| values.map(|[number, ..]| channel.low + channel.step * number);
    let bytes = |value: Option<f64>| match is_label {
        // The conversion saturates.
        true => (value.unwrap_or(0.0).round() as i32).to_le_bytes(),
        false => (value.unwrap_or(f64::NAN) as f32).to_le_bytes(),
    };
    Column {
        name: channel.name.chars().map(|c| if c.is_ascii_graphic() { c } else { '_' }).collect(),
        kind: if is_label { "int" } else { "float" },
        values: textured.vertex_values(place, channel.kind).into_iter().map(|values| bytes(value(values))).collect(),
    }
}

/// The colour of each vertex; white where nothing is known.
fn vertex_colours(textured: &TexturedMesh, channel: usize) -> Vec<[u8; 4]> {
    let colour = |values: Option<[f64; 4]>| {
        let [red, green, blue, alpha] = values.unwrap_or([255.0; 4]);
        [red, green, blue, if alpha.is_nan() { 255.0 } else { alpha }].map(|x| (x + 0.5) as u8)
    };
    textured.vertex_values(channel, ChannelKind::Colour).into_iter().map(colour).collect()
}

/// Writes OBJ, whose material file has this name.
///
/// # Errors
/// Any error of the writer.
pub fn write_textured_obj(out: impl Write, mesh: &PagedMesh, material_file: &str) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 20, out);
    writeln!(out, "mtllib {material_file}")?;
    for [x, y, z] in &mesh.positions {
        writeln!(out, "v {x} {y} {z}")?;
    }
    // The first row of an image is at the top.
    for [u, v] in &mesh.places {
        writeln!(out, "vt {u} {}", 1.0 - v)?;
    }
    for [x, y, z] in &mesh.normals {
        writeln!(out, "vn {x} {y} {z}")?;
    }
    for (page, triangles) in mesh.triangles.iter().enumerate().filter(|(_, triangles)| !triangles.is_empty()) {
        let is_bare = page == mesh.pages.len();
        writeln!(out, "usemtl {}", if is_bare { "bare".into() } else { format!("page{page}") })?;
        for triangle in triangles {
            let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
            match (is_bare, mesh.normals.is_empty()) {
                (true, true) => writeln!(out, "f {a} {b} {c}")?,
                (false, true) => writeln!(out, "f {a}/{a} {b}/{b} {c}/{c}")?,
                (true, false) => writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?,
                (false, false) => writeln!(out, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}")?,
            }
        }
    }
    out.flush()
}

/// The material file of an OBJ, given the images of pages: their numbers, and the names of the files.
pub fn material_file(mesh: &PagedMesh, images: &[(usize, &str)]) -> String {
    let mut text = String::from("newmtl bare\nKd 1 1 1\n");
    for &(page, file) in images {
        // Images of heights may end within the mesh.
        let is_beyond = mesh.places.iter().flatten().any(|x| !(0.0..=1.0).contains(x));
        let clamped = if is_beyond { "-clamp on " } else { "" };
        text += &format!("newmtl page{page}\nKd 1 1 1\nmap_Kd {clamped}{file}\n");
        if mesh.image(page, Layer::Colour).is_some_and(|image| image.components == 4) {
            text += &format!("map_d {file}\n");
        }
    }
    text
}

/// The binary part of a GLB.
#[derive(Default)]
pub(super) struct Binary {
    pub bytes: Vec<u8>,
    pub views: Vec<Value>,
}

impl Binary {
    /// Adds a view; returns its number.
    pub fn add(&mut self, bytes: impl Iterator<Item = u8>, target: Option<u32>) -> usize {
        let first = self.bytes.len();
        self.bytes.extend(bytes);
        let mut view = json!({"buffer": 0, "byteOffset": first, "byteLength": self.bytes.len() - first});
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(view);
        self.views.len() - 1
    }
}
