//! The overview: one small mesh of everything, for files whose coarsest cut takes more than the first request.

use super::irregular::QuadricSlide;
use super::scale::Scale;
use crate::certify::{self, CertifyOptions, two_sided};
use crate::chart::{BorderVertex, ChartMesh};
use crate::mesh::NONE;
use crate::repair::{pair_edges, repair};
use crate::simplify::{SimplifyOptions, simplify_chart};
use glam::DVec3;
use lodpack::{
    ArcRecord, ArcSample, File, LatticePoint, Limits, Mesh, Model, OverviewRecord, PatchTarget, RootRecord,
    SymbolBuffer, WriteReport, encode_patch,
};
use std::collections::HashMap;

/// Where header, index and coarsest level take no more than this, they come as fast as an overview would.
pub const OVERVIEW_FROM_BYTES: u64 = 16 << 10;
/// Fewer roots have an index and a coarsest level that fit into it.
pub const OVERVIEW_FROM_ROOTS: usize = 32;
/// Triangles aimed at: one or two kilobytes.
pub const OVERVIEW_TRIANGLES: usize = 2000;
/// With more triangles (of many components, or of long boundaries) it would not be small.
const MAX_TRIANGLES: usize = 2 * OVERVIEW_TRIANGLES;
/// How many of the coarsest levels are tried.
const MAX_LEVELS_TRIED: usize = 2;

/// Makes the overview of a model from its coarsest cut; none where that is read as fast, or where nothing small is found.
///
/// # Errors
/// As [`lodpack::write_file`].
pub(super) fn overview(model: &Model, scale: &Scale) -> Result<Option<OverviewRecord>, lodpack::Error> {
    if model.roots.len() < OVERVIEW_FROM_ROOTS {
        return Ok(None);
    }
    // What is drawn is what a reader makes of the file. The coarsest levels do for that; only where they are small may the
    // whole file be.
    let mut bytes = vec![];
    let mut report = lodpack::write_file(&coarsest_levels(model), &mut bytes)?;
    if bytes_of_first_picture(&report) <= OVERVIEW_FROM_BYTES {
        report = lodpack::write_file(model, &mut std::io::sink())?;
        if bytes_of_first_picture(&report) <= OVERVIEW_FROM_BYTES {
            return Ok(None);
        }
    }
    let file = File::open(bytes.as_slice(), Limits::default())?;
    // A finer level is nearer to the input, and so is what is made of it: 17 instead of 21 mean edges on 8 M triangles.
    for level in (0..file.level_count().min(MAX_LEVELS_TRIED) as u8).rev() {
        let cut = file.uniform_cut(level)?;
        let overview = simplified(file.extract(&cut)?, cut.error, scale);
        if overview.is_some() {
            return Ok(overview);
        }
    }
    Ok(None)
}

/// Bytes up to the end of the coarsest level.
fn bytes_of_first_picture(report: &WriteReport) -> u64 {
    let sections = report.sections.iter().filter(|(name, _)| *name != "pages");
    let before_pages: u64 = sections.map(|section| section.1).sum();
    before_pages + report.levels.first().map_or(0, |parts| parts.iter().sum())
}

/// The model without all that the levels that are tried do not need.
fn coarsest_levels(model: &Model) -> Model {
    let is_coarse = |sample: &&ArcSample| usize::from(sample.level) < MAX_LEVELS_TRIED;
    let at_coarsest = |arc: &ArcRecord| ArcRecord {
        ends: arc.ends,
        samples: arc.samples.iter().filter(is_coarse).copied().collect(),
    };
    let coarse = |root: &RootRecord| RootRecord {
        loops: root.loops.clone(),
        bounds: root.bounds,
        filling: root.filling,
        blocks: root.blocks.iter().take(MAX_LEVELS_TRIED).cloned().collect(),
    };
    Model {
        levels: model.levels.iter().take(MAX_LEVELS_TRIED).cloned().collect(),
        source: model.source.clone(),
        corners: model.corners.clone(),
        arcs: model.arcs.iter().map(at_coarsest).collect(),
        roots: model.roots.iter().map(coarse).collect(),
        overview: None,
        ..*model
    }
}

/// `error` is the bound of the mesh's distance from the input.
fn simplified(mesh: Mesh, error: f64, scale: &Scale) -> Option<OverviewRecord> {
    let lattice = scale.lattice;
    let exact = |p: &[f64; 3]| scale.local_from_lattice(lattice.units(*p).map(|x| x.round() as i64));
    let positions: Vec<DVec3> = mesh.positions.iter().map(exact).collect();
    let reach = positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    let (positions, triangles) = manifold(positions, mesh.triangles)?;
    let loops = boundary_loops(&triangles, positions.len())?;
    let whole = ChartMesh { positions, triangles, loops };
    let options = SimplifyOptions { thresholds: &[2.0 * reach], importance: None, min_triangles: OVERVIEW_TRIANGLES };
    let patch = simplify_chart(&whole, &options).levels.pop().flatten()?;
    if patch.triangles.len() > MAX_TRIANGLES {
        return None;
    }

    let step = scale.step();
    let quantisation = scale.levels.first()?.quantisation;
    let normal_step = (1_u64 << quantisation.normal_shift) as f64;
    let rounded = |v: u32| -> LatticePoint {
        (whole.positions[v as usize] / step).to_array().map(|x| (x / normal_step).round() as i64 * normal_step as i64)
    };
    let mut border = patch.border.iter().map(|&v| rounded(v));
    let loops: Vec<Vec<LatticePoint>> =
        patch.border_loops.iter().map(|&count| border.by_ref().take(count as usize).collect()).collect();
    let interior: Vec<[f64; 3]> = patch.interior.iter().map(|&p| (p / step).to_array()).collect();
    let target = PatchTarget { loops: &loops, interior: &interior, triangles: &patch.triangles };
    let slide = QuadricSlide { patch: &patch, step, bound: normal_step * f64::from(1 << quantisation.tangent_shift) };
    let mut symbols = SymbolBuffer::default();
    let (drawn, _) = encode_patch(&target, quantisation, &slide, &mut symbols).ok()?;

    let points = loops.iter().flatten().chain(&drawn.interior);
    let drawn_positions: Vec<DVec3> = points.map(|&p| scale.local_from_lattice(p)).collect();
    let surface = |positions: &[DVec3], triangles: &[[u32; 3]]| certify::Surface::new(positions, triangles);
    let bound = two_sided(
        &surface(&whole.positions, &whole.triangles),
        &surface(&drawn_positions, &drawn.triangles),
        &CertifyOptions::default(),
    );
    // Rounded up, since adding may round down.
    let error = (error + bound.upper) * (1.0 + 2.0 * f64::EPSILON);
    Some(OverviewRecord { error, quantisation, loops, triangle_count: drawn.triangles.len() as u32, symbols })
}

/// The same surface as a manifold: roots of few triangles may meet along the same edge more than once, by arcs of which nothing is
/// left but their ends, or lie back to back. All but one of such edges and triangles get a vertex in between, and sheets that
/// meet in a vertex one each. None where the surface would open.
fn manifold(mut positions: Vec<DVec3>, mut triangles: Vec<[u32; 3]>) -> Option<(Vec<DVec3>, Vec<[u32; 3]>)> {
    let directed = sorted_edges(&triangles);
    if directed.windows(2).all(|pair| pair[0] != pair[1]) {
        return Some((positions, triangles));
    }
    let count = |edge: [u32; 2]| directed.partition_point(|&e| e <= edge) - directed.partition_point(|&e| e < edge);
    let distinct = directed.chunk_by(|a, b| a == b).map(|same| (same[0], same.len()));
    let open: usize = distinct.map(|([a, b], times)| times.saturating_sub(count([b, a]))).sum();

    // The back of a triangle of its own becomes three. All new vertices are exact between points of the lattice.
    for t in pair_edges(&triangles, &positions).duplicates {
        let corners @ [a, b, c] = triangles[t as usize];
        let [p, q, r] = corners.map(|v| positions[v as usize]);
        let inside = positions.len() as u32;
        positions.push((p + (q + r) * 0.5) * 0.5);
        triangles[t as usize] = [a, b, inside];
        triangles.extend([[b, c, inside], [c, a, inside]]);
    }
    let opposite = pair_edges(&triangles, &positions).opposite;
    let origin = |h: usize| triangles[h / 3][h % 3];
    let mut middles = vec![NONE; opposite.len()];
    let mut seen: HashMap<[u32; 2], i32> = HashMap::new();
    for h in 0..opposite.len() {
        let other = opposite[h];
        if other == NONE || (other as usize) < h {
            continue;
        }
        let ends = [origin(h), origin(other as usize)];
        let times = seen.entry([ends[0].min(ends[1]), ends[0].max(ends[1])]).or_default();
        if *times > 0 {
            // A half, a quarter, an eighth.
            let [p, q] = ends.map(|v| positions[v as usize]);
            (middles[h], middles[other as usize]) = (positions.len() as u32, positions.len() as u32);
            positions.push(p + (q - p) * 2f64.powi(-*times));
        }
        *times += 1;
    }
    let mut divided = Vec::with_capacity(triangles.len());
    for (corners, middles) in triangles.iter().zip(middles.as_chunks::<3>().0) {
        let mut around: Vec<u32> = (0..3).flat_map(|k| [corners[k], middles[k]]).filter(|&v| v != NONE).collect();
        // From a vertex between two others on an edge, if there is one, no triangle is without an area.
        let first = around.iter().position(|v| middles.contains(v)).unwrap_or(0);
        around.rotate_left(first);
        divided.extend((1..around.len() - 1).map(|k| [around[0], around[k], around[k + 1]]));
    }
    let (mesh, adjacency, _) = repair(crate::mesh::Mesh { positions, triangles: divided });
    let still_open = adjacency.opposite.iter().filter(|&&other| other == NONE).count();
    (still_open == open).then_some((mesh.positions, mesh.triangles))
}

/// All edges as their triangles run along them.
fn sorted_edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.sort_unstable();
    edges
}

/// The boundary of a mesh, all of which stays; none where loops touch.
fn boundary_loops(triangles: &[[u32; 3]], vertex_count: usize) -> Option<Vec<Vec<BorderVertex>>> {
    let directed = sorted_edges(triangles);
    let mut next = vec![NONE; vertex_count];
    for &[a, b] in directed.iter().filter(|&&[a, b]| directed.binary_search(&[b, a]).is_err()) {
        if std::mem::replace(&mut next[a as usize], b) != NONE {
            return None;
        }
    }
    let mut loops = vec![];
    for start in 0..vertex_count {
        let mut border: Vec<BorderVertex> = vec![];
        let mut at = start as u32;
        while next[at as usize] != NONE {
            let vertex = at;
            at = std::mem::replace(&mut next[vertex as usize], NONE);
            border.push(BorderVertex { vertex, side: 0, param: 0.0, level: 0 });
        }
        if !border.is_empty() {
            loops.push(border);
        }
    }
    Some(loops)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_that_two_pairs_of_triangles_share_are_told_apart() {
        // Two tetrahedra with an edge in common, 0 1, whichever way they are taken to be connected there.
        let tetrahedron = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d], [a, d, b], [b, d, c]];
        let triangles = [tetrahedron([0, 1, 2, 3]), tetrahedron([0, 1, 4, 5])].concat();
        let places = [[0., 0., 0.], [0., 0., 2.], [2., 0., 0.], [2., 2., 0.], [-2., 0., 0.], [-2., -2., 0.]];
        let positions = places.map(DVec3::from_array).to_vec();
        let (parted, closed) = manifold(positions.clone(), triangles).expect("both are closed");
        assert_eq!(closed.len(), 10);
        let edges = sorted_edges(&closed);
        assert!(edges.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(edges.iter().all(|&[a, b]| edges.binary_search(&[b, a]).is_ok()));
        assert!(parted.iter().all(|p| positions.contains(p) || *p == DVec3::new(0., 0., 1.)));
        // What has no boundary edge twice stays as it is.
        assert_eq!(manifold(positions.clone(), vec![[0, 1, 2]]), Some((positions, vec![[0, 1, 2]])));
    }

    #[test]
    fn boundaries_are_traced_in_the_winding_of_the_triangles() {
        let two = [[0, 1, 2], [0, 2, 3], [4, 5, 6]];
        let loops = boundary_loops(&two, 7).expect("loops do not touch");
        let vertices: Vec<Vec<u32>> = loops.iter().map(|l| l.iter().map(|b| b.vertex).collect()).collect();
        assert_eq!(vertices, [vec![0, 1, 2, 3], vec![4, 5, 6]]);
        assert!(boundary_loops(&[[0, 1, 2], [0, 3, 4]], 5).is_none());
    }
}
