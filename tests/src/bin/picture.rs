//! Draws a mesh beside cuts of a lodpack file at several tolerances, with nodes coloured by resolution.
//!
//! picture MESH FILE.lodpack OUT.png [--tolerances T1,T2,..] [--view AZIMUTH,ELEVATION] [--size PX]
//!
//! Tolerances are in mean edge lengths of the input.

use glam::DVec3;
use lodpack::{File, Limits, Query};
use lodpack_cli::import::import_meshes;
use lodpack_cli::progress::Silent;
use lodpack_tests::raster::{Picture, View};
use std::path::PathBuf;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut paths = vec![];
    let (mut tolerances, mut view, mut size) = (vec![0.5, 2.0, 8.0, 32.0], [30.0, 15.0], 420usize);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or(format!("{arg} needs a value"));
        match arg.as_str() {
            "--tolerances" => tolerances = numbers(&value()?)?,
            "--view" => view = numbers(&value()?)?.try_into().map_err(|_| "--view needs AZIMUTH,ELEVATION")?,
            "--size" => size = value()?.parse()?,
            _ => paths.push(PathBuf::from(arg)),
        }
    }
    let [mesh, file, out] = <[PathBuf; 3]>::try_from(paths).map_err(|_| "usage: picture MESH FILE.lodpack OUT.png")?;

    let original = import_meshes(&[mesh], &Silent)?;
    let file = File::open(std::fs::File::open(file)?, Limits::default())?;
    // Drawn at twice the size and halved.
    let panel = 2 * size;
    let mut picture = Picture::new(panel * (tolerances.len() + 1), panel);
    let view = View::around(original.bounds(), view[0], view[1], panel);
    let middle = |column: usize| [(column as f64 + 0.5) * panel as f64, panel as f64 * 0.5];
    for t in 0..original.triangles.len() as u32 {
        picture.triangle(&view, middle(0), original.corners(t), [0.75, 0.75, 0.78]);
    }
    let unit = file.source_info().map_or(1.0, |source| source.mean_edge_length);
    for (column, tolerance) in tolerances.iter().enumerate() {
        let cut = file.select(&Query { tolerance: Some(tolerance * unit), ..Query::default() })?;
        let mesh = file.extract(&cut)?;
        println!("{tolerance} mean edges: {} triangles, certified error {}", mesh.triangles.len(), cut.error / unit);
        let levels = file.level_count();
        for (triangle, &node) in mesh.triangles.iter().zip(&mesh.triangle_nodes) {
            let node = &cut.nodes[node as usize];
            let colour = block_colour(usize::from(node.level), levels, node.root);
            let corners = triangle.map(|v| DVec3::from_array(mesh.positions[v as usize]));
            picture.triangle(&view, middle(column + 1), corners, colour);
        }
    }
    picture.halved().save(&out)?;
    Ok(())
}

/// Blue where coarse, red where fine. Neighbouring roots differ a little in brightness.
fn block_colour(level: usize, levels: usize, root: u32) -> [f64; 3] {
    let t = level as f64 / (levels.max(2) - 1) as f64;
    let ramp = [[0.15, 0.3, 0.85], [0.1, 0.7, 0.75], [0.3, 0.75, 0.2], [0.95, 0.75, 0.1], [0.9, 0.25, 0.15]];
    let at = t * (ramp.len() - 1) as f64;
    let i = (at as usize).min(ramp.len() - 2);
    let f = at - i as f64;
    let bright = 0.75 + 0.25 * f64::from(root.wrapping_mul(2_654_435_761) >> 24) / 255.0;
    [0, 1, 2].map(|k| (ramp[i][k] * (1.0 - f) + ramp[i + 1][k] * f) * bright)
}

fn numbers(text: &str) -> Result<Vec<f64>, Failure> {
    Ok(text.split(',').map(str::parse).collect::<Result<_, _>>()?)
}
