//! Cracks: pixels at which front and back faces do not cancel out.

use std::collections::{HashMap, HashSet};

use anyhow::Result;
use lodpack::{Mesh, View, stream::BorderEdge};

use crate::{
    camera::middle_of,
    draw::Renderer,
    gpu::{Gpu, Targets},
    surface::Surface,
};

/// Triangles that close an open surface. They join each edge on arcs that only one half-arc of the finest surface uses
/// with a single point. The file knows where the surface ends, and of heights the mesh of the same cut; an edge that is
/// open anywhere else stays open.
pub fn caps(surface: &Surface) -> Result<Mesh> {
    let mut made = Mesh { positions: vec![middle_of(surface.bounds).0.into()], ..Mesh::default() };
    let mut close = |ends: [[f64; 3]; 2]| {
        let first = made.positions.len() as u32;
        made.positions.extend(ends);
        made.triangles.push([first, first + 1, 0]);
    };
    if let Some(heights) = surface.heights() {
        // What the reader joins from all tiles at once ends where the surface does, and where nothing is drawn.
        let cut = surface.heights_cut().unwrap_or_default();
        let mesh = heights.file.mesh(&cut)?;
        let edges: HashSet<[u32; 2]> = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        for &[from, to] in edges.iter().filter(|[from, to]| !edges.contains(&[*to, *from])) {
            close([to, from].map(|vertex| mesh.positions[vertex as usize]));
        }
        return Ok(made);
    }
    let content = surface.mesh()?;
    // Roots without children use every arc.
    let mut uses: HashMap<u32, u32> = HashMap::new();
    let tree = content.tree()?;
    for &arc in tree.leaves.iter().flat_map(|&root| &tree.arcs[root as usize]) {
        *uses.entry(arc).or_default() += 1;
    }
    for drawn in surface.picture().roots() {
        let surface = &drawn.surface;
        let arcs: Vec<u32> = surface.half_arcs().map(|half_arc| half_arc.arc).collect();
        for (corners, edges) in surface.border_triangles() {
            let is_open = |part: &BorderEdge| uses.get(&arcs[part.side as usize]) == Some(&1);
            for k in (0..3).filter(|&k| !edges[k].is_empty() && edges[k].iter().all(is_open)) {
                let ends = [corners[(k + 1) % 3], corners[k]];
                close(ends.map(|vertex| surface.positions[vertex as usize]));
            }
        }
    }
    Ok(made)
}

/// Pixels at which the drawing of a renderer and the caps do not cancel out.
pub fn uneven_pixels(gpu: &Gpu, targets: &Targets, renderers: [&Renderer; 2], view: &View) -> Result<Vec<usize>> {
    for (renderer, is_first) in renderers.into_iter().zip([true, false]) {
        renderer.count_faces(targets, view, is_first);
    }
    let counts = gpu.read::<u8>(&targets.textures[3])?;
    Ok((0..counts.len()).filter(|&pixel| counts[pixel] != 0).collect())
}
