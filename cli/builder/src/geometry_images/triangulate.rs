//! Triangles between the samples of images, and those of patches.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::border_edges::BorderEdges;
use super::image::GeometryImage;
use super::weld::Points;
use lodpack_mesh::Mesh;

/// A mesh, with what each of its triangles comes from.
pub(super) struct Triangulated {
    pub mesh: Mesh,
    /// The points at the corners of each triangle: samples, image after image, and vertices of patches behind them.
    pub points: Vec<[u32; 3]>,
    /// For each triangle its image, or its patch, which are counted behind the images.
    pub pieces: Vec<u32>,
    /// The first point of each piece.
    pub first: Vec<u32>,
    /// For vertices of patches between two samples of an image: these, and how far they are from the first to the
    /// second, 0 to 1.
    pub between: HashMap<u32, ([u32; 2], f32)>,
}

/// Triangulates images and patches, whose points are welded, around an origin.
pub(super) fn triangulate(images: &[GeometryImage], patches: &[Mesh], points: Points, origin: DVec3) -> Triangulated {
    let Points { representative: mut welded, inserted, first: firsts } = points;
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
    let vertex_of = |point: u32| welded[point as usize];
    let mut first: usize = images.iter().map(|image| image.samples.len()).sum();
    let image_vertex_count = welded[..first].iter().copied().max().map_or(0, |v| v + 1);
    let mut is_shared = vec![false; mesh.positions.len()];
    let (mut of_patches, mut patch_of) = (Vec::new(), Vec::new());
    for (number, patch) in (images.len() as u32..).zip(patches) {
        of_patches.extend(patch.triangles.iter().map(|t| t.map(|v| first as u32 + v)));
        patch_of.resize(of_patches.len(), number);
        first += patch.positions.len();
    }
    for v in of_patches.iter().flatten().map(|&point| vertex_of(point)).filter(|&v| v < image_vertex_count) {
        is_shared[v as usize] = true;
    }

    let mut cells = cells_of(images, |a: u32, b: u32| {
        let [a, b] = [a, b].map(|point| vertex_of(point) as usize);
        // A patch in the corner of an image may have the same edge from border to border, so such a diagonal is
        // avoided.
        (is_shared[a] && is_shared[b], mesh.positions[a].distance_squared(mesh.positions[b]))
    });
    separate_doubled_diagonals(&mut cells, vertex_of);
    let mut pieces = Vec::with_capacity(2 * cells.len());
    let mut triangles = Vec::with_capacity(2 * cells.len());
    let mut rest = cells.iter();
    for (number, image) in (0..).zip(images) {
        for &[a, b, c, d] in rest.by_ref().take(image.last * image.last) {
            for triangle in [[a, b, c], [a, c, d]] {
                let [a, b, c] = triangle.map(vertex_of);
                if a != b && b != c && c != a {
                    triangles.push(triangle);
                    pieces.push(number);
                }
            }
        }
    }
    drop(cells);

    let mut edges = BorderEdges::new(&triangles, &is_shared, vertex_of);
    for run in &inserted {
        // Where welding left nothing of the edge's triangle, there is nothing to split.
        if let Some(split) = edges.insert(&mut triangles, run.from, run.to, &run.between) {
            pieces.resize(triangles.len(), pieces[split as usize]);
        }
    }
    triangles.extend(of_patches);
    pieces.extend(patch_of);
    let mut between = HashMap::new();
    for run in &inserted {
        let position = |point: u32| mesh.positions[vertex_of(point) as usize];
        let [from, to] = [run.from, run.to].map(position);
        for &point in &run.between {
            let share = (position(point).distance(from) / to.distance(from)).clamp(0.0, 1.0) as f32;
            between.insert(point, ([run.from, run.to], share));
        }
    }
    mesh.triangles = triangles.iter().map(|triangle| triangle.map(vertex_of)).collect();
    Triangulated { mesh, points: triangles, pieces, first: firsts, between }
}

/// The cells of all images, each to be cut along the diagonal between its first and third point: the one of smaller
/// cost.
fn cells_of<C: PartialOrd>(images: &[GeometryImage], cost: impl Fn(u32, u32) -> C) -> Vec<[u32; 4]> {
    let mut cells = Vec::with_capacity(images.iter().map(|image| image.last * image.last).sum());
    let mut first = 0;
    for image in images {
        let side = image.last + 1;
        for y in 0..image.last {
            for x in 0..image.last {
                let point = |x: usize, y: usize| (first + y * side + x) as u32;
                let [a, b, c, d] = [point(x, y), point(x + 1, y), point(x + 1, y + 1), point(x, y + 1)];
                cells.push(if cost(b, d) < cost(a, c) { [b, c, d, a] } else { [a, b, c, d] });
            }
        }
        first += side * side;
    }
    cells
}

/// Turns the diagonal of cells that share it with another cell. Beside a fold, or in the coarsest images, cells can
/// share opposite vertices, and an edge with four triangles would not be manifold.
fn separate_doubled_diagonals(cells: &mut [[u32; 4]], vertex_of: impl Fn(u32) -> u32) {
    let key = |a: u32, b: u32| {
        let (a, b) = (vertex_of(a), vertex_of(b));
        (a.min(b), a.max(b))
    };
    let mut diagonals: Vec<((u32, u32), u32)> = (0..).zip(&*cells).map(|(i, &[a, _, c, _])| (key(a, c), i)).collect();
    diagonals.sort_unstable();
    let is_taken = |a: u32, b: u32| {
        let first = diagonals.partition_point(|&(known, _)| known < key(a, b));
        diagonals.get(first).is_some_and(|&(known, _)| known == key(a, b))
    };
    for same in diagonals.chunk_by(|a, b| a.0 == b.0) {
        for &(_, cell) in &same[1..] {
            let [a, b, c, d] = cells[cell as usize];
            if !is_taken(b, d) {
                cells[cell as usize] = [b, c, d, a];
            }
        }
    }
}
