//! Makes a coarse surface a manifold with simple boundaries, so that it can be simplified.

use glam::DVec3;
use lodpack_mesh::exact::power_of_two;
use lodpack_mesh::{Mesh, NONE, next_half_edge};
use lodpack_stage::chart::BorderVertex;
use lodpack_stage::repair::{pair_edges, sew};
use std::collections::HashMap;

/// The same surface as a manifold. Roots of few triangles may meet along one edge more than once, where only the ends
/// are left of the arcs between them, or lie back to back. All but one of such edges and triangles get a vertex in
/// between, and sheets that meet in a vertex get one each. None if that would open the surface.
pub(crate) fn manifold(mut positions: Vec<DVec3>, mut triangles: Vec<[u32; 3]>) -> Option<(Vec<DVec3>, Vec<[u32; 3]>)> {
    let directed = sorted_edges(&triangles);
    if directed.windows(2).all(|pair| pair[0] != pair[1]) {
        return Some((positions, triangles));
    }
    let mut open = open_edges(&triangles).len();

    // Of two triangles back to back one becomes three. New vertices are means of two or four lattice points, which are
    // exact.
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
        if other != NONE && (other as usize) < h {
            continue;
        }
        // An edge of the boundary may have the ends of another one, too.
        let ends = [origin(h), origin(next_half_edge(h as u32) as usize)];
        let times = seen.entry([ends[0].min(ends[1]), ends[0].max(ends[1])]).or_default();
        if *times > 0 {
            // A half, a quarter, an eighth: all different, and exact.
            let [p, q] = ends.map(|v| positions[v as usize]);
            let sides = [Some(h), (other != NONE).then_some(other as usize)];
            sides.into_iter().flatten().for_each(|side| middles[side] = positions.len() as u32);
            // One of the boundary becomes two.
            open += usize::from(other == NONE);
            positions.push(p + (q - p) * power_of_two((-*times).max(-1022)));
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
    let (mesh, adjacency) = sew(Mesh { positions, triangles: divided });
    let still_open = adjacency.opposite.iter().filter(|&&other| other == NONE).count();
    (still_open == open).then_some((mesh.positions, mesh.triangles))
}

/// All edges in the directions of their triangles, sorted.
fn sorted_edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.sort_unstable();
    edges
}

/// The open edges: each directed edge as often as more triangles run along it than against it.
pub(crate) fn open_edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let edges = sorted_edges(triangles);
    let count = |edge: [u32; 2]| edges.partition_point(|&e| e <= edge) - edges.partition_point(|&e| e < edge);
    let distinct = edges.chunk_by(|a, b| a == b).map(|same| (same[0], same.len()));
    distinct.flat_map(|([a, b], times)| std::iter::repeat_n([a, b], times.saturating_sub(count([b, a])))).collect()
}

/// The boundary loops of a mesh, as borders that the simplifier keeps entirely. None if loops touch.
pub(crate) fn boundary_loops(triangles: &[[u32; 3]], vertex_count: usize) -> Option<Vec<Vec<BorderVertex>>> {
    let mut next = vec![NONE; vertex_count];
    for [a, b] in open_edges(triangles) {
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
        // A triangle of the boundary beside an edge that two others share.
        let slit = vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]];
        let (_, triangles) = manifold(positions.clone(), slit).expect("boundaries may have an edge twice");
        let edges = sorted_edges(&triangles);
        assert!(edges.windows(2).all(|pair| pair[0] != pair[1]));
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
