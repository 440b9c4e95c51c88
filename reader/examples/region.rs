//! Reads what lies in a box, at an error: region FILE X0 Y0 Z0 X1 Y1 Z1 TOLERANCE

use lodpack::{File, Limits, Query, source::Counting};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, numbers @ ..] = arguments.as_slice() else { return Err("name a file".into()) };
    let numbers = numbers.iter().map(|number| number.parse()).collect::<Result<Vec<f64>, _>>()?;
    let [x0, y0, z0, x1, y1, z1, tolerance] = numbers[..] else { return Err("give a box and a tolerance".into()) };

    let file = File::open(Counting::new(std::fs::File::open(path)?), Limits::default())?;
    let query =
        Query { volume: Some([[x0, y0, z0], [x1, y1, z1]].into()), tolerance: Some(tolerance), ..Query::default() };
    let cut = file.select(&query)?;
    let mesh = file.extract(&cut)?;
    println!("{} triangles, {} vertices, error at most {}", mesh.triangles.len(), mesh.positions.len(), cut.error);
    println!("{} bytes in {} requests", file.source().byte_count(), file.source().read_count());
    Ok(())
}
