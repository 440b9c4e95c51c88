//! Writes binary glTF 2.0 with pages of images inside: one mesh, or the levels of one (extension MSFT_lod).

use std::collections::HashMap;
use std::io::{self, Write};

use glam::DVec3;
use serde_json::{Value, json};

use super::encoded::{Formats, WEBP, Written, encoded};
use super::material::{UNLIT, draw, material, plain};
use super::pages::{PagedMesh, Part};
use super::smooth::COMPUTED;
use super::textured::Binary;
use super::upright::Upright;

/// The extension of textures whose image is WebP.
const OF_WEBP: &str = "EXT_texture_webp";
const ARRAY_BUFFER: Option<u32> = Some(34962);
const ELEMENT_ARRAY_BUFFER: Option<u32> = Some(34963);
/// Pixels of the picture for which levels are chosen, and error in pixels up to which a level is shown.
const PICTURE: [f64; 2] = [1920.0, 1080.0];
const SHOWN_ERROR: f64 = 1.0;

/// A level of a mesh.
#[derive(Clone, Debug)]
pub struct GlbLevel {
    /// Its triangles, with images if it has some.
    pub mesh: PagedMesh,
    /// Name of the node.
    pub name: String,
    /// Certified two-sided distance to the input, in the units of the positions.
    pub error: f64,
}

/// What meshes of one file consist of.
#[derive(Default)]
pub(super) struct Scene {
    binary: Binary,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    /// The number of each material, by its text.
    material_numbers: HashMap<String, usize>,
    textures: Vec<Value>,
    images: Vec<Value>,
    written: Written,
}

/// Writes GLB with the pages inside, in these formats, and says which images these are. Coordinates are relative to a
/// node translation.
///
/// # Errors
/// Any error of the writer; [`io::ErrorKind::InvalidInput`] beyond 4 GiB.
pub fn write_textured_glb(
    out: impl Write,
    mesh: &PagedMesh,
    formats: Formats,
    upright: Upright,
) -> io::Result<Written> {
    let mut scene = Scene::default();
    let centre = super::export::glb_origin(&mesh.positions);
    scene.add(mesh, centre, formats)?;
    scene.write(out, &[upright.node(0, centre)], &[0], None)
}

/// Adds to the errors of levels what single precision adds to them once they are written together.
pub fn add_rounding(levels: &mut [GlbLevel]) {
    let Some(centre) = levels.first().map(|finest| super::export::glb_origin(&finest.mesh.positions)) else { return };
    for level in levels {
        level.error += super::export::rounding_around(centre, &level.mesh.positions);
    }
}

/// Writes the levels of a mesh, the finest first, as nodes of which a program shows one by the share of the picture
/// that the model covers: a level from where on its error is below a pixel at 1,920 x 1,080. Programs that do not know
/// the extension show the finest. Returns which images were written.
///
/// # Errors
/// Any error of the writer; [`io::ErrorKind::InvalidInput`] without a level or beyond 4 GiB.
pub fn write_levels_glb(
    out: impl Write,
    levels: &[GlbLevel],
    formats: Formats,
    upright: Upright,
) -> io::Result<Written> {
    let Some(finest) = levels.first() else {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "there is no level to write"));
    };
    let mut scene = Scene::default();
    let centre = super::export::glb_origin(&finest.mesh.positions);
    for level in levels {
        scene.add(&level.mesh, centre, formats)?;
    }
    let mut nodes: Vec<Value> = levels
        .iter()
        .enumerate()
        .map(|(mesh, level)| {
            let triangles: usize = level.mesh.triangles.iter().map(Vec::len).sum();
            let mut node = upright.node(mesh, centre);
            node["name"] = level.name.as_str().into();
            node["extras"] = json!({"certified_error": level.error * upright.unit, "triangles": triangles});
            node
        })
        .collect();
    if levels.len() > 1 {
        nodes[0]["extensions"] = json!({"MSFT_lod": {"ids": (1..levels.len()).collect::<Vec<usize>>()}});
        nodes[0]["extras"]["MSFT_screencoverage"] = screen_coverages(levels).into();
    }
    scene.write(out, &nodes, &[0], (levels.len() > 1).then_some("MSFT_lod"))
}

/// For each level the least share of the picture that the model's bounding sphere covers while the level is shown.
pub fn screen_coverages(levels: &[GlbLevel]) -> Vec<f64> {
    let [low, high] = levels.first().map(|level| super::export::bounds(&level.mesh.positions)).unwrap_or_default();
    let diameter = DVec3::from_array(low).distance(DVec3::from_array(high));
    let least_of = |next: &GlbLevel| {
        let pixels = diameter / next.error * SHOWN_ERROR;
        let share = std::f64::consts::PI * 0.25 * pixels * pixels / (PICTURE[0] * PICTURE[1]);
        // Without an error any distance will do.
        if share < 1.0 { share } else { 1.0 }
    };
    levels.iter().skip(1).map(least_of).chain([0.0]).collect()
}

impl Scene {
    /// Adds a mesh, relative to an origin.
    pub(super) fn add(&mut self, mesh: &PagedMesh, origin: [f64; 3], formats: Formats) -> io::Result<()> {
        let [low, high] = if mesh.positions.is_empty() { [origin; 2] } else { super::export::bounds(&mesh.positions) };
        let local = |p: &[f64; 3]| [0, 1, 2].map(|k| (p[k] - origin[k]) as f32);
        let count = mesh.positions.len();
        let float =
            |view: usize, kind: &str| json!({"bufferView": view, "componentType": 5126, "count": count, "type": kind});
        let positions = self.binary.add(mesh.positions.iter().flat_map(local).flat_map(f32::to_le_bytes), ARRAY_BUFFER);
        let mut accessor = float(positions, "VEC3");
        (accessor["min"], accessor["max"]) = (json!(local(&low)), json!(local(&high)));
        let mut bare = json!({"POSITION": self.accessors.len()});
        self.accessors.push(accessor);
        if !mesh.normals.is_empty() {
            bare["NORMAL"] = self.accessors.len().into();
            let view = self.binary.add(mesh.normals.iter().flatten().copied().flat_map(f32::to_le_bytes), ARRAY_BUFFER);
            let mut accessor = float(view, "VEC3");
            accessor["name"] = COMPUTED.into();
            self.accessors.push(accessor);
        }
        let (known, mut of_pages) = (self.textures.len(), vec![]);
        for page in &mesh.pages {
            of_pages.push(material(page, |layer, image| {
                let encoded = encoded(layer, image, formats)?;
                self.written.add(image, &encoded);
                let (bytes, media_type) = encoded;
                let view = self.binary.add(bytes.into_iter(), None);
                self.images.push(json!({"bufferView": view, "mimeType": media_type}));
                let source = json!({"source": self.images.len() - 1});
                self.textures.push(match media_type {
                    WEBP => json!({"sampler": 0, "extensions": {OF_WEBP: source}}),
                    _ => json!({"sampler": 0, "source": source["source"]}),
                });
                Ok(self.textures.len() - 1)
            })?);
        }
        let mut attributes = bare.clone();
        if self.textures.len() > known {
            let places = mesh.places.iter().flatten().copied().flat_map(f32::to_le_bytes);
            attributes["TEXCOORD_0"] = self.accessors.len().into();
            let view = self.binary.add(places, ARRAY_BUFFER);
            self.accessors.push(float(view, "VEC2"));
        }
        if !mesh.frames.is_empty() {
            let normals = mesh.frames.iter().flat_map(|frame| frame[1]).flat_map(f32::to_le_bytes);
            let view = self.binary.add(normals, ARRAY_BUFFER);
            attributes["NORMAL"] = self.accessors.len().into();
            self.accessors.push(float(view, "VEC3"));
        }
        if of_pages.iter().any(|of_page| of_page["normalTexture"].is_object()) {
            // The last number says that the third direction lies to the right of the tangent, seen from outside: rows
            // count from above.
            let tangents = mesh.frames.iter().flat_map(|frame| frame[0].into_iter().chain([-1.0]));
            let view = self.binary.add(tangents.flat_map(f32::to_le_bytes), ARRAY_BUFFER);
            attributes["TANGENT"] = self.accessors.len().into();
            self.accessors.push(float(view, "VEC4"));
        }
        let mut primitives = vec![];
        for Part { page, drawing, triangles } in mesh.parts() {
            let view = self.binary.add(triangles.iter().flatten().flat_map(|v| v.to_le_bytes()), ELEMENT_ARRAY_BUFFER);
            let mut primitive = json!({"attributes": bare, "indices": self.accessors.len()});
            self.accessors.push(
                json!({"bufferView": view, "componentType": 5125, "count": triangles.len() * 3, "type": "SCALAR"}),
            );
            if let Some(of_page) = of_pages.get(page) {
                primitive["attributes"] = attributes.clone();
                if let Some(own) = primitive["attributes"].as_object_mut()
                    && drawing.is_some_and(|drawing| drawing.is_unlit)
                    && !mesh.normals.is_empty()
                {
                    // What has no light needs none.
                    own.remove("NORMAL");
                }
                let mut own = of_page.clone();
                drawing.into_iter().for_each(|drawing| draw(&mut own, drawing));
                primitive["material"] = self.material(own).into();
            } else {
                // Without a material it would be of metal.
                primitive["material"] = self.material(plain()).into();
            }
            primitives.push(primitive);
        }
        self.meshes.push(json!({"primitives": primitives}));
        Ok(())
    }

    /// The number of a material: one for all that look the same, as of thousands of objects there are a few.
    fn material(&mut self, material: Value) -> usize {
        *self.material_numbers.entry(material.to_string()).or_insert_with(|| {
            self.materials.push(material);
            self.materials.len() - 1
        })
    }

    /// Writes everything; the scene shows the nodes of these numbers.
    pub(super) fn write(
        self,
        out: impl Write,
        nodes: &[Value],
        shown: &[usize],
        extension: Option<&str>,
    ) -> io::Result<Written> {
        let mut document = json!({
            "asset": {"version": "2.0", "generator": "lodpack"},
            "scene": 0, "scenes": [{"nodes": shown}],
            "nodes": nodes,
            "meshes": self.meshes,
            "buffers": [{"byteLength": self.binary.bytes.len()}],
            "bufferViews": self.binary.views,
            "accessors": self.accessors,
        });
        let mut extensions: Vec<&str> = extension.into_iter().collect();
        if !self.materials.is_empty() {
            if self.materials.iter().any(|material| material["extensions"][UNLIT].is_object()) {
                extensions.push(UNLIT);
            }
            document["materials"] = self.materials.into();
        }
        if self.images.iter().any(|image| image["mimeType"] == WEBP) {
            extensions.push(OF_WEBP);
            // There are no other images for those who do not know it.
            document["extensionsRequired"] = json!([OF_WEBP]);
        }
        if !self.images.is_empty() {
            document["textures"] = self.textures.into();
            document["images"] = self.images.into();
            document["samplers"] = json!([{"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}]);
        }
        if !extensions.is_empty() {
            document["extensionsUsed"] = json!(extensions);
        }
        super::export::write_glb_chunks(out, &document, &self.binary.bytes)?;
        Ok(self.written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(side: f64, error: f64) -> GlbLevel {
        let positions = vec![[0.0; 3], [side, 0.0, 0.0], [0.0, side, 0.0]];
        let mesh = PagedMesh { positions, triangles: vec![vec![[0, 1, 2]]], ..PagedMesh::default() };
        GlbLevel { mesh, name: "level".into(), error }
    }

    #[test]
    fn a_level_is_shown_while_its_error_is_below_a_pixel() {
        let levels = [level(100.0, 0.001), level(100.0, 0.1), level(100.0, 1.0), level(100.0, 10.0)];
        let coverages = screen_coverages(&levels);
        assert_eq!((coverages[0], coverages[3]), (1.0_f64.min(coverages[0]), 0.0));
        assert!(coverages.windows(2).all(|pair| pair[0] > pair[1]), "{coverages:?}");
        // The last level has an error of ten units, and so of a pixel where the diagonal of 141 units has 14 pixels.
        let pixels = 2.0_f64.sqrt() * 10.0;
        let expected = std::f64::consts::PI * pixels * pixels / 4.0 / (1920.0 * 1080.0);
        assert!((coverages[2] - expected).abs() < 1e-12, "{coverages:?}");
        // What has no error may always be shown.
        assert_eq!(screen_coverages(&[level(1.0, 0.0), level(1.0, 0.0)]), [1.0, 0.0]);
    }
}
