//! From charts to geometry images.

use std::fs;
use std::path::Path;

use rayon::prelude::*;

use super::image::GeometryImage;
use super::manifest::{ImageEdge, Manifest, Neighbour, Neighbours, Patch, Root};
use super::patch::{Surroundings, sampled_patch};
use super::product::AtlasProduct;
use super::sides::{Side, chart_sides, sample_arcs, sides_of_arcs};
use super::{AtlasError, MANIFEST_NAME, MAX_RESOLUTION, UNFINISHED_MANIFEST};
use crate::mesh::export::{MeshFormat, write_mesh};
use crate::stage::chart::ChartMesh;
use crate::stage::embed::{Embedding, quad_point};

/// Writes every chart as geometry images of (2^`resolution` + 1)^2 samples, one for each corner (`root_CCCCC_K.exr` for corner K of
/// chart C), every patch as `patch_PPPPP.ply`, and `atlas.json` last: a folder without it is incomplete.
///
/// # Errors
/// If the folder cannot be made or written to, `resolution` is above [`MAX_RESOLUTION`], or a position does not fit in 32-bit floats.
pub fn write_atlas(dir: &Path, product: &AtlasProduct, resolution: u32) -> Result<(), AtlasError> {
    let manifest_path = dir.join(MANIFEST_NAME);
    let io_error = |path: &Path| {
        let path = path.to_owned();
        move |source| AtlasError::Write { path, source }
    };
    if resolution > MAX_RESOLUTION {
        let what = format!("resolution {resolution} is above {MAX_RESOLUTION}");
        return Err(AtlasError::Format { path: manifest_path, what });
    }
    fs::create_dir_all(dir).map_err(|source| AtlasError::Write { path: dir.to_owned(), source })?;

    // Both sides of an arc take the same samples from here on.
    let charts = &product.charts;
    let arc_samples = sample_arcs(&product.arcs, resolution);
    let sides_of = sides_of_arcs(charts, product.arcs.len());
    let sides = chart_sides(charts, &arc_samples, &sides_of);
    let corner_count: Vec<u32> = charts.iter().map(|chart| chart.embedding.corner_count as u32).collect();
    // The root of corner k of chart c has the index first_root[c] + k.
    let mut next = 0;
    let mut first_root = Vec::with_capacity(charts.len());
    for count in &corner_count {
        first_root.push(next);
        next += count;
    }
    let around = Surroundings {
        arcs: &product.arcs,
        arc_samples: &arc_samples,
        sides_of: &sides_of,
        first_root: &first_root,
        corner_count: &corner_count,
    };

    let written: Vec<Result<Vec<Root>, AtlasError>> = charts
        .par_iter()
        .enumerate()
        .map(|(index, chart)| {
            let images = chart_images(&chart.mesh, &chart.embedding, &sides[index], resolution);
            let mut roots = Vec::with_capacity(images.len());
            for (corner, image) in images.iter().enumerate() {
                let file = format!("root_{index:05}_{corner}.exr");
                image.write(&dir.join(&file))?;
                let neighbours = neighbours_of(index, corner, &sides[index], &around);
                roots.push(Root { file, resolution, chart: index as u32, corner: corner as u32, neighbours });
            }
            Ok(roots)
        })
        .collect();
    let roots: Vec<Vec<Root>> = written.into_iter().collect::<Result<_, _>>()?;
    let mut patches = Vec::with_capacity(product.patches.len());
    for (index, patch) in product.patches.iter().enumerate() {
        let (mesh, borders) = sampled_patch(patch, &around);
        let file = format!("patch_{index:05}.ply");
        let path = dir.join(&file);
        let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
        let out = fs::File::create(&path).map_err(io_error(&path))?;
        write_mesh(out, MeshFormat::Ply, &positions, &mesh.triangles).map_err(io_error(&path))?;
        patches.push(Patch { file, borders });
    }

    let roots = roots.into_iter().flatten().collect();
    let manifest = Manifest::new(product.header.origin.to_array(), product.header.units.clone(), roots, patches);
    manifest.check().map_err(|what| AtlasError::Format { path: manifest_path.clone(), what })?;
    let text = serde_json::to_vec_pretty(&manifest)
        .map_err(|source| AtlasError::Manifest { path: manifest_path.clone(), source })?;
    let temporary = dir.join(UNFINISHED_MANIFEST);
    fs::write(&temporary, text).map_err(io_error(&temporary))?;
    fs::rename(&temporary, &manifest_path).map_err(io_error(&manifest_path))
}

/// The images of a chart's quads. Outer edges take the sides' samples; the centre and the spokes are evaluated only once.
fn chart_images(mesh: &ChartMesh, embedding: &Embedding, sides: &[Side], resolution: u32) -> Vec<GeometryImage> {
    let n = embedding.corner_count;
    let last = 1usize << resolution;
    let positions = embedding.positions(mesh);
    let locator = embedding.locator();
    let mut hint = 0;
    let mut evaluate = |quad, x: usize, y: usize| {
        let point = quad_point(n, quad, x as f64 / last as f64, y as f64 / last as f64);
        // A point that is not found is not finite; such a sample is refused when the image is written.
        locator.find(point, hint).map_or([f32::NAN; 3], |location| {
            hint = location.triangle;
            locator.evaluate(&positions, location).as_vec3().to_array()
        })
    };
    let centre = evaluate(0, 0, 0);
    // Spoke i runs from the centre to the middle of side i: the left edge of quad i, the top edge of quad i + 1.
    let mut spokes: Vec<Vec<[f32; 3]>> = Vec::with_capacity(n);
    for quad in 0..n {
        let inner = (1..last).map(|y| evaluate(quad, 0, y));
        let mut spoke = vec![centre];
        spoke.extend(inner);
        spoke.push(sides[quad].samples[last]);
        spokes.push(spoke);
    }
    let mut images = Vec::with_capacity(n);
    for quad in 0..n {
        let previous = (quad + n - 1) % n;
        let mut samples = Vec::with_capacity((last + 1) * (last + 1));
        for y in 0..=last {
            for x in 0..=last {
                samples.push(if x == last {
                    sides[previous].samples[last + y]
                } else if y == last {
                    sides[quad].samples[last - x]
                } else if x == 0 {
                    spokes[quad][y]
                } else if y == 0 {
                    spokes[previous][x]
                } else {
                    evaluate(quad, x, y)
                });
            }
        }
        images.push(GeometryImage { last, samples });
    }
    images
}

/// The neighbours of a quad's image. Spokes border on the quads beside them. Half-sides border on the other half of the partner side,
/// which runs the other way; but all outer edges of images run from the middle of a side to a corner, so the edges run the same way.
fn neighbours_of(chart: usize, corner: usize, sides: &[Side], around: &Surroundings) -> Neighbours {
    let (first_root, corner_count) = (around.first_root, sides.len());
    let previous = (corner + corner_count - 1) % corner_count;
    let next = (corner + 1) % corner_count;
    let same = |root: u32, edge| Some(Neighbour { root, edge, reversed: false });
    let partner_root = |side: usize, ahead: u32| {
        let partner = sides[side].partner?;
        let count = around.corner_count[partner.chart as usize];
        Some(first_root[partner.chart as usize] + (partner.side + ahead) % count)
    };
    Neighbours {
        left: same(first_root[chart] + next as u32, ImageEdge::Top),
        top: same(first_root[chart] + previous as u32, ImageEdge::Left),
        // The second half of the side before the corner is the first half of its partner.
        right: partner_root(previous, 0).and_then(|root| same(root, ImageEdge::Bottom)),
        // The first half of the side after the corner is the second half of its partner.
        bottom: partner_root(corner, 1).and_then(|root| same(root, ImageEdge::Right)),
    }
}
