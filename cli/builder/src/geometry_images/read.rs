//! From geometry images and patches, made here or elsewhere, to a triangle mesh.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::image::{GeometryImage, check_size};
use super::looks::ImageChannel;
use super::manifest::{Manifest, Root};
use super::numbers::read_numbers;
use super::surface::{AtlasSurface, PatchValues};
use super::triangulate::triangulate;
use super::weld::Points;
use super::{AtlasError, MANIFEST_NAME};
use lodpack_import::{ImportOptions, Imported, MAX_MATERIALS, Objects, Room, import_large_meshes, size_of_file};
use lodpack_mesh::Mesh;
use lodpack_mesh::appearance::Channels;
use lodpack_mesh::images::{ImageSource, image_size};
use lodpack_runtime::progress::Silent;

/// Reads a folder that [`super::write_atlas`] wrote, or that has the same layout, as one mesh in input units.
///
/// Every sample becomes a vertex, welded along the edges that `atlas.json` declares common. Every cell becomes two
/// triangles, cut along the shorter diagonal except where two cells would get the same one. Triangles that welding
/// makes degenerate are dropped. The triangles of the patches follow; where a patch has vertices between the samples of
/// an image's edge, the image's triangles there become fans.
///
/// # Errors
/// [`AtlasError`] if a file is missing or unreadable, `atlas.json` is inconsistent, an image has the wrong size or a
/// sample that is not finite, or two neighbours hold different samples along a common edge.
pub fn read_atlas(dir: &Path) -> Result<Mesh, AtlasError> {
    Ok(read_surface(dir, &Channels::None)?.mesh)
}

/// As [`read_atlas`], with what of the surface is wanted beside its shape.
///
/// # Errors
/// Those of [`read_atlas`], images of channels that are missing or have the wrong size, and more of them than a build
/// takes.
pub(super) fn read_surface(dir: &Path, channels: &Channels) -> Result<AtlasSurface, AtlasError> {
    let path = dir.join(MANIFEST_NAME);
    if dir.is_dir() && !path.exists() {
        return Err(AtlasError::NoAtlas { folder: dir.to_owned(), meshes: dir.join(pattern_of_meshes(dir)) });
    }
    let text = std::fs::read(regular(path.clone())?).map_err(|source| AtlasError::Io { path: path.clone(), source })?;
    let mut manifest: Manifest =
        serde_json::from_slice(&text).map_err(|source| AtlasError::Manifest { path: path.clone(), source })?;
    manifest.check().map_err(|what| AtlasError::Format { path: path.clone(), what })?;
    // Before any image is read. Material 0 is that of triangles without one.
    let (count, most) = (manifest.material_count(), MAX_MATERIALS - 1);
    if count > most && channels.wants_materials() {
        return Err(AtlasError::Pieces { path, count, most });
    }
    if *channels == Channels::None {
        manifest.channels.clear();
    }

    let read = |root: &Root| GeometryImage::read(&regular(dir.join(&root.file))?, root.resolution);
    let images: Vec<Result<GeometryImage, AtlasError>> = manifest.roots.par_iter().map(read).collect();
    let images: Vec<GeometryImage> = images.into_iter().collect::<Result<_, _>>()?;
    let mut patches = Vec::with_capacity(manifest.patches.len());
    let mut patch_values = Vec::with_capacity(manifest.patches.len());
    for patch in &manifest.patches {
        let channels = if manifest.channels.is_empty() { Channels::None } else { Channels::Auto };
        let (mesh, values) = read_patch(dir.join(&patch.file), channels)?;
        patches.push(mesh);
        patch_values.push(values);
    }
    let numbers = read_all_numbers(dir, &manifest)?;
    let texels = texel_files(dir, &manifest)?;
    let points = Points::new(dir, &manifest, &images, &patches)?;
    let triangulated = triangulate(&images, &patches, points, manifest.origin.into());
    Ok(AtlasSurface::new(manifest, &images, triangulated, texels, numbers, patch_values))
}

/// A patch, and what its vertices carry.
fn read_patch(path: PathBuf, channels: Channels) -> Result<(Mesh, PatchValues), AtlasError> {
    let options = ImportOptions { channels, objects: Objects::Join, ..ImportOptions::default() };
    match import_large_meshes(&[path], &Room::memory_alone(), &options, &Silent)? {
        Imported::Memory(surface) => {
            let values = PatchValues::of(&surface);
            Ok((surface.mesh, values))
        }
        // Unlimited memory never spills.
        Imported::Spilled(_) => Ok(Default::default()),
    }
}

/// The numbers of each channel that has numbers, root after root.
fn read_all_numbers(dir: &Path, manifest: &Manifest) -> Result<Vec<Vec<f32>>, AtlasError> {
    let mut all = vec![];
    for (number, _) in manifest.channels.iter().enumerate().filter(|(_, channel)| !channel.kind.has_texels()) {
        let read = |root: &Root| read_numbers(&regular(dir.join(&root.images[number]))?, root.resolution);
        let of_roots: Vec<Result<Vec<f32>, AtlasError>> = manifest.roots.par_iter().map(read).collect();
        let of_roots: Vec<Vec<f32>> = of_roots.into_iter().collect::<Result<_, _>>()?;
        all.push(of_roots.concat());
    }
    Ok(all)
}

/// The files of each piece's images with texels: of roots, which have the size that is stated, and of patches.
fn texel_files(dir: &Path, manifest: &Manifest) -> Result<Vec<Vec<PathBuf>>, AtlasError> {
    let channels: Vec<&ImageChannel> = manifest.channels.iter().collect();
    let with_texels: Vec<&ImageChannel> =
        channels.iter().copied().filter(|channel| channel.kind.has_texels()).collect();
    let mut files = vec![];
    for root in &manifest.roots {
        let named = channels.iter().zip(&root.images).filter(|(channel, _)| channel.kind.has_texels());
        files.push(
            named
                .map(|(channel, name)| texel_file(dir.join(name), Some(channel.resolution)))
                .collect::<Result<_, _>>()?,
        );
    }
    for patch in &manifest.patches {
        let named = with_texels.iter().zip(&patch.images);
        files.push(named.map(|(_, name)| texel_file(dir.join(name), None)).collect::<Result<_, _>>()?);
    }
    Ok(files)
}

/// An image that can be read, of the size of a resolution where there is one.
fn texel_file(path: PathBuf, resolution: Option<u32>) -> Result<PathBuf, AtlasError> {
    let source = ImageSource::File { path: path.clone(), range: None };
    let image = source.open(None).map_err(|source| AtlasError::Io { path: path.clone(), source })?;
    let size = image_size(image);
    let size = size.map_err(|what| AtlasError::Texels { path: path.clone(), what })?.map(|x| x as usize);
    resolution.map_or(Ok(()), |resolution| check_size(&path, size, resolution)).map(|()| path)
}

/// A file that is no folder, device or pipe.
fn regular(path: PathBuf) -> Result<PathBuf, AtlasError> {
    match size_of_file(&path) {
        Ok(_) => Ok(path),
        Err(source) => Err(AtlasError::Io { path, source }),
    }
}

/// A pattern that matches meshes in a directory, those of one format.
fn pattern_of_meshes(dir: &Path) -> String {
    let mut names: Vec<String> = std::fs::read_dir(dir)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| Some(entry.path().extension()?.to_str()?.to_owned()))
        .filter(|extension| ["ply", "obj", "stl", "glb", "gltf"].contains(&extension.to_ascii_lowercase().as_str()))
        .collect();
    names.sort();
    format!("*.{}", names.first().map_or("ply", String::as_str))
}
