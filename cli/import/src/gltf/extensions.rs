//! Extensions that a document requires: those that are read, and those without which its surface is the same.

use super::document::Document;
use super::material_fields::{UNREAD_IMAGES, WEBP};
use crate::error::Parsed;
use crate::source::Source;

/// What is read wherever it stands, required or not.
const READ: [&str; 11] = [
    "CESIUM_RTC",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_draco_mesh_compression",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Kinds of extensions that say how a surface looks, moves or is used, but not where it is, by their names behind the
/// prefix.
const HARMLESS_KINDS: [&str; 5] = ["animation_", "audio", "lights_", "materials_", "texture_"];

/// The same of single extensions.
const HARMLESS: [&str; 19] = [
    "environment_map",
    "feature_metadata",
    "implicit_shapes",
    "instance_features",
    "interactivity",
    "lod",
    "mesh_features",
    "mesh_manifold",
    "node_hoverability",
    "node_selectability",
    "packing_normalRoughnessMetallic",
    "packing_occlusionRoughnessMetallic",
    "physics_rigid_bodies",
    "primitive_outline",
    "structural_metadata",
    "techniques_webgl",
    "vrm",
    "xmp",
    "xmp_json_ld",
];

/// Refuses documents that require an extension by which the surface may be another; those that require others lose
/// something, which a note says.
pub(super) fn check_required(source: &Source, document: &Document) -> Parsed<()> {
    for name in &document.extensions_required {
        let name = name.as_str();
        // Images that are not read are noted where a texture needs them.
        if READ.contains(&name) || name == WEBP || UNREAD_IMAGES.contains(&name) {
            continue;
        }
        let kind = name.split_once('_').map_or("", |(_, kind)| kind);
        if HARMLESS.contains(&kind) || HARMLESS_KINDS.iter().any(|prefix| kind.starts_with(prefix)) {
            source.note(&format!("uses the extension {name}, which is not supported; the surface is read without it"));
        } else {
            return Err(source.unsupported(
                format!("the extension {name}"),
                "the surface may depend on it: convert the file with a program that knows it",
            ));
        }
    }
    Ok(())
}
