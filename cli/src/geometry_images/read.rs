//! From geometry images and patches, made here or elsewhere, to a triangle mesh.

use std::path::Path;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::border_edges::BorderEdges;
use super::image::GeometryImage;
use super::manifest::{Manifest, Root};
use super::weld::Points;
use super::{AtlasError, MANIFEST_NAME};
use crate::import::import_meshes;
use crate::mesh::Mesh;
use crate::progress::Silent;

/// Reads a folder that [`super::write_atlas`] wrote, or that has the same layout, as one mesh in input units.
///
/// Every sample becomes a vertex, welded along the edges that `atlas.json` declares common. Every cell becomes two triangles, cut along
/// the shorter diagonal except where two cells would get the same one. Triangles that welding makes degenerate are dropped. The triangles
/// of the patches follow; where a patch has vertices between the samples of an image's edge, the image's triangles there become fans.
///
/// # Errors
/// [`AtlasError`] if a file is missing or unreadable, `atlas.json` is inconsistent, an image has the wrong size or a sample that is
/// not finite, or two neighbours hold different samples along a common edge.
pub fn read_atlas(dir: &Path) -> Result<Mesh, AtlasError> {
    let path = dir.join(MANIFEST_NAME);
    let text = std::fs::read(&path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound if dir.is_dir() => {
            AtlasError::NoAtlas { folder: dir.to_owned(), meshes: dir.join(pattern_of_meshes(dir)) }
        }
        _ => AtlasError::Io { path: path.clone(), source },
    })?;
    let manifest: Manifest =
        serde_json::from_slice(&text).map_err(|source| AtlasError::Manifest { path: path.clone(), source })?;
    manifest.check().map_err(|what| AtlasError::Format { path, what })?;

    let read = |root: &Root| GeometryImage::read(&dir.join(&root.file), root.resolution);
    let images: Vec<Result<GeometryImage, AtlasError>> = manifest.roots.par_iter().map(read).collect();
    let images: Vec<GeometryImage> = images.into_iter().collect::<Result<_, _>>()?;
    let mut patches = Vec::with_capacity(manifest.patches.len());
    for patch in &manifest.patches {
        patches.push(import_meshes(&[dir.join(&patch.file)], &Silent)?);
    }
    let points = Points::new(dir, &manifest, &images, &patches)?;
    Ok(triangulate(&images, &patches, points, DVec3::from_array(manifest.origin)))
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

fn triangulate(images: &[GeometryImage], patches: &[Mesh], points: Points, origin: DVec3) -> Mesh {
    let Points { representative: mut welded, inserted, .. } = points;
    // Representatives become consecutive vertices; each comes before the points that it stands for.
    let mut mesh = Mesh::default();
    let samples = images.iter().flat_map(|image| &image.samples).map(|sample| Vec3::from_array(*sample).as_dvec3());
    let vertices = patches.iter().flat_map(|patch| patch.positions.iter().copied());
    for (v, position) in samples.chain(vertices).enumerate() {
        welded[v] = if welded[v] as usize == v {
            mesh.positions.push(origin + position);
            mesh.positions.len() as u32 - 1
        } else {
            welded[welded[v] as usize]
        };
    }
    let mut first: usize = images.iter().map(|image| image.samples.len()).sum();
    let image_vertex_count = welded[..first].iter().copied().max().map_or(0, |v| v + 1);
    let mut is_shared = vec![false; mesh.positions.len()];
    let mut patch_triangles = Vec::new();
    for patch in patches {
        patch_triangles.extend(patch.triangles.iter().map(|t| t.map(|v| welded[first + v as usize])));
        first += patch.positions.len();
    }
    for &v in patch_triangles.iter().flatten().filter(|&&v| v < image_vertex_count) {
        is_shared[v as usize] = true;
    }

    first = 0;
    let mut cells = Vec::with_capacity(welded.len());
    for image in images {
        let side = image.last + 1;
        for y in 0..image.last {
            for x in 0..image.last {
                let v = |x: usize, y: usize| welded[first + y * side + x];
                let [a, b, c, d] = [v(x, y), v(x + 1, y), v(x + 1, y + 1), v(x, y + 1)];
                // A patch in the corner of an image may have the same edge from border to border, so such a diagonal is avoided.
                let cost = |a: u32, b: u32| {
                    let both_shared = is_shared[a as usize] && is_shared[b as usize];
                    (both_shared, mesh.positions[a as usize].distance_squared(mesh.positions[b as usize]))
                };
                // Cells are cut along the diagonal between their first and third vertex.
                cells.push(if cost(b, d) < cost(a, c) { [b, c, d, a] } else { [a, b, c, d] });
            }
        }
        first += side * side;
    }
    separate_doubled_diagonals(&mut cells);
    let triangles = cells.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    mesh.triangles.extend(triangles.filter(|[a, b, c]| a != b && b != c && c != a));

    let mut edges = BorderEdges::new(&mesh.triangles, &is_shared);
    for run in &inserted {
        let between: Vec<u32> = run.between.iter().map(|&v| welded[v as usize]).collect();
        // Where welding left nothing of the edge's triangle, there is nothing to split.
        edges.insert(&mut mesh.triangles, welded[run.from as usize], welded[run.to as usize], &between);
    }
    mesh.triangles.extend(patch_triangles);
    mesh
}

/// Turns the diagonal of cells that share it with another cell. Beside a fold, or in the coarsest images, cells can share opposite
/// vertices, and an edge with four triangles would not be manifold.
fn separate_doubled_diagonals(cells: &mut [[u32; 4]]) {
    let mut diagonals: Vec<(u32, u32, u32)> =
        cells.iter().enumerate().map(|(i, &[a, _, c, _])| (a.min(c), a.max(c), i as u32)).collect();
    diagonals.sort_unstable();
    let is_taken = |a: u32, b: u32| {
        let key = (a.min(b), a.max(b));
        let first = diagonals.partition_point(|&(a, b, _)| (a, b) < key);
        diagonals.get(first).is_some_and(|&(a, b, _)| (a, b) == key)
    };
    for same in diagonals.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        for &(_, _, cell) in &same[1..] {
            let [a, b, c, d] = cells[cell as usize];
            if !is_taken(b, d) {
                cells[cell as usize] = [b, c, d, a];
            }
        }
    }
}
