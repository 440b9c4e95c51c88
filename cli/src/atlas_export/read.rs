//! Geometry images, made here or elsewhere, to a triangle mesh.

use std::path::Path;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::image::GeometryImage;
use super::manifest::{ImageEdge, Manifest, Root};
use super::{AtlasError, MANIFEST_NAME};
use crate::mesh::Mesh;

/// Reads a folder written by [`super::write_atlas`] or laid out in the same way, as one mesh in input units.
///
/// Every sample is a vertex, welded along the edges that `atlas.json` declares common; every cell is two triangles, cut along
/// the shorter diagonal, except where two cells would get the same diagonal. Triangles that welding makes degenerate are left out.
///
/// # Errors
/// If a file is missing or unreadable, `atlas.json` is inconsistent, an image has the wrong size or a sample that is not
/// finite, or two roots hold different samples along a common edge; see [`AtlasError`].
pub fn read_atlas(dir: &Path) -> Result<Mesh, AtlasError> {
    let path = dir.join(MANIFEST_NAME);
    let text = std::fs::read(&path).map_err(|source| AtlasError::Io { path: path.clone(), source })?;
    let manifest: Manifest =
        serde_json::from_slice(&text).map_err(|source| AtlasError::Manifest { path: path.clone(), source })?;
    manifest.check().map_err(|what| AtlasError::Format { path, what })?;

    let read = |root: &Root| GeometryImage::read(&dir.join(&root.file), root.resolution);
    let images: Vec<Result<GeometryImage, AtlasError>> = manifest.roots.par_iter().map(read).collect();
    let images: Vec<GeometryImage> = images.into_iter().collect::<Result<_, _>>()?;
    let welded = weld_edges(&manifest, &images)?;
    Ok(triangulate(&images, welded, DVec3::from_array(manifest.origin)))
}

/// For each sample of all images, one after the other, a sample that stands for all that are the same point. The
/// representative is the first of them.
fn weld_edges(manifest: &Manifest, images: &[GeometryImage]) -> Result<Vec<u32>, AtlasError> {
    let mut first_sample = Vec::with_capacity(images.len());
    let mut sample_count = 0;
    for image in images {
        first_sample.push(sample_count);
        sample_count += image.samples.len();
    }
    // The manifest's check keeps the count below 2^32.
    let mut representative: Vec<u32> = (0..sample_count as u32).collect();
    for (index, root) in manifest.roots.iter().enumerate() {
        let image = &images[index];
        for edge in ImageEdge::ALL {
            let Some(neighbour) = root.neighbours.across(edge) else { continue };
            let (other_root, other) = (neighbour.root as usize, &images[neighbour.root as usize]);
            let disagree = |what| AtlasError::EdgesDisagree {
                first: root.file.clone(),
                first_edge: edge,
                second: manifest.roots[other_root].file.clone(),
                second_edge: neighbour.edge,
                what,
            };
            if image.last != other.last {
                return Err(disagree(format!("{} and {} samples", image.last + 1, other.last + 1)));
            }
            for k in 0..=image.last {
                let here = edge.pixel(k, image.last);
                let there = neighbour.edge.pixel(if neighbour.reversed { image.last - k } else { k }, image.last);
                let (a, b) = (image.at(here), other.at(there));
                if a != b {
                    return Err(disagree(format!("sample {k} is {a:?} and {b:?}")));
                }
                let vertex = |root: usize, (column, row)| (first_sample[root] + row * (image.last + 1) + column) as u32;
                join(&mut representative, vertex(index, here), vertex(other_root, there));
            }
        }
    }
    for v in 0..sample_count as u32 {
        representative[v as usize] = find(&mut representative, v);
    }
    Ok(representative)
}

fn find(representative: &mut [u32], mut v: u32) -> u32 {
    while representative[v as usize] != v {
        let up = representative[v as usize];
        representative[v as usize] = representative[up as usize];
        v = up;
    }
    v
}

fn join(representative: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(representative, a), find(representative, b));
    representative[a.max(b) as usize] = a.min(b);
}

fn triangulate(images: &[GeometryImage], mut welded: Vec<u32>, origin: DVec3) -> Mesh {
    // From representatives to consecutive vertices: a representative comes before what it stands for.
    let mut mesh = Mesh::default();
    let samples = images.iter().flat_map(|image| &image.samples);
    for (v, sample) in samples.enumerate() {
        welded[v] = if welded[v] as usize == v {
            mesh.positions.push(origin + Vec3::from_array(*sample).as_dvec3());
            mesh.positions.len() as u32 - 1
        } else {
            welded[welded[v] as usize]
        };
    }
    let mut first = 0;
    let mut cells = Vec::with_capacity(welded.len());
    for image in images {
        let side = image.last + 1;
        for y in 0..image.last {
            for x in 0..image.last {
                let v = |x: usize, y: usize| welded[first + y * side + x];
                let [a, b, c, d] = [v(x, y), v(x + 1, y), v(x + 1, y + 1), v(x, y + 1)];
                let length = |a: u32, b: u32| mesh.positions[a as usize].distance_squared(mesh.positions[b as usize]);
                // The diagonal between the first and the third vertex is the one to cut along.
                cells.push(if length(b, d) < length(a, c) { [b, c, d, a] } else { [a, b, c, d] });
            }
        }
        first += side * side;
    }
    separate_doubled_diagonals(&mut cells);
    let triangles = cells.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    mesh.triangles.extend(triangles.filter(|[a, b, c]| a != b && b != c && c != a));
    mesh
}

/// Turns cells whose diagonal another cell has too: beside a fold, or in the coarsest of images, cells can share opposite
/// vertices, and an edge with four triangles is not manifold.
fn separate_doubled_diagonals(cells: &mut [[u32; 4]]) {
    let mut diagonals: Vec<(u32, u32, u32)> =
        cells.iter().enumerate().map(|(i, &[a, _, c, _])| (a.min(c), a.max(c), i as u32)).collect();
    diagonals.sort_unstable();
    let is_taken = |a: u32, b: u32| {
        let key = (a.min(b), a.max(b));
        let place = diagonals.partition_point(|&(a, b, _)| (a, b) < key);
        diagonals.get(place).is_some_and(|&(a, b, _)| (a, b) == key)
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
