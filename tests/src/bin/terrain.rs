//! Writes generated terrain as GeoTIFFs: terrain flat|globe COLUMNS ROWS OUT.tif, or with --tile N as tiles of N x N
//! samples in the folder OUT. --seed N makes another world; with --island a globe is a level sea but for an island of
//! 10 degrees. A row is held at a time, so any size can be written.

use lodpack_tests::terrain::{Fractal, Grid};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let option =
        |name: &str| args.iter().position(|arg| arg == name).and_then(|at| args.get(at + 1)?.parse::<u32>().ok());
    let [kind, columns, rows, out, ..] = args.as_slice() else {
        return Err("usage: terrain flat|globe COLUMNS ROWS OUT [--tile N] [--seed N] [--island]".into());
    };
    let size: [u32; 2] = [columns.parse()?, rows.parse()?];
    let is_sea = args.iter().any(|arg| arg == "--island");
    let fractal = Fractal::of_samples(option("--seed").unwrap_or(1).into(), size[0].max(size[1]));
    let is_globe = kind == "globe";
    let grid = if is_globe { Grid::globe(size) } else { Grid::utm(size) };
    let write = |path: &Path, first: [u32; 2], part: [u32; 2]| {
        let mut file = BufWriter::new(File::create(path)?);
        grid.window(first, part).write(&mut file, |row, heights| match is_globe {
            true => {
                fractal.globe_row(size, first[1] + row, first[0], heights);
                if is_sea {
                    island(size, [first[0], first[1] + row], heights);
                }
            }
            false => fractal.flat_row(size, first[1] + row, first[0], heights),
        })
    };
    let out = Path::new(out);
    let Some(tile) = option("--tile").filter(|&tile| tile > 0) else { return Ok(write(out, [0, 0], size)?) };
    std::fs::create_dir_all(out)?;
    for y in (0..size[1]).step_by(tile as usize) {
        for x in (0..size[0]).step_by(tile as usize) {
            let part = [tile.min(size[0] - x), tile.min(size[1] - y)];
            write(&out.join(format!("{}-{}.tif", y / tile, x / tile)), [x, y], part)?;
        }
    }
    Ok(())
}

/// Leaves of a row of a globe what lies above the sea within 5 degrees of 20 degrees east and 10 degrees north.
fn island(size: [u32; 2], [first, row]: [u32; 2], heights: &mut [f32]) {
    let latitude = 90.0 - 180.0 * f64::from(row) / f64::from(size[1] - 1);
    for (column, height) in (first..).zip(heights) {
        let longitude = -180.0 + 360.0 * f64::from(column) / f64::from(size[0]);
        let [x, y] = [longitude - 20.0, latitude - 10.0];
        let is_near = x * x + y * y < 25.0;
        *height = if is_near { height.abs() } else { 0.0 };
    }
}
