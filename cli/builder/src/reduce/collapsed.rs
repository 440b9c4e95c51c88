//! Edge collapse of a whole surface to a stated number of triangles.

use lodpack_mesh::Mesh;
use lodpack_stage::areas::Areas;
use lodpack_stage::chart::ChartMesh;
use lodpack_stage::simplify::{SimplifyOptions, simplify_chart};

/// See [`SimplifyOptions::stops`].
pub(super) const STOPS: [f64; 3] = [16.0, 8.0, 4.0];

/// A surface simplified to the given number of triangles with its topology and the border that it has to keep; more
/// triangles where these need more.
pub(crate) fn collapsed(chart: &ChartMesh, triangles: usize) -> Option<Mesh> {
    collapsed_in_areas(chart, None, triangles, &STOPS, None).map(|(mesh, _)| mesh)
}

/// As [`collapsed`], with lines between areas that stay as near as the surface; and the area of each triangle, if some
/// are given. `stops` are as in [`SimplifyOptions::stops`].
pub(super) fn collapsed_in_areas(
    chart: &ChartMesh,
    areas: Option<Areas<'_>>,
    triangles: usize,
    stops: &[f64],
    importance: Option<&[f32]>,
) -> Option<(Mesh, Vec<u32>)> {
    // A collapse takes two triangles.
    let least = triangles.saturating_sub(1).max(1);
    let options = SimplifyOptions {
        thresholds: &[f64::INFINITY],
        min_triangles: least,
        stops,
        areas,
        importance,
        ..SimplifyOptions::default()
    };
    let patch = simplify_chart(chart, &options).levels.pop().flatten()?;
    let border = patch.border.iter().map(|&v| chart.positions[v as usize]);
    let positions = border.chain(patch.interior.iter().copied()).collect();
    Some((Mesh { positions, triangles: patch.triangles }, patch.areas))
}
