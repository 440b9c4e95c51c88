//! The work of bench/overhead.py without Python: overhead FILE COUNT TOLERANCE opens a file, selects and extracts,
//! COUNT times.

use lodpack::{File, Limits, Query};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, count, tolerance] = arguments.as_slice() else {
        return Err("name a file, a count and a tolerance".into());
    };
    let query = Query { tolerance: Some(tolerance.parse()?), ..Query::default() };
    for _ in 0..count.parse::<u32>()? {
        let file = File::open(std::fs::File::open(path)?, Limits::default())?;
        let mesh = file.extract(&file.select(&query)?)?;
        std::hint::black_box(mesh);
    }
    Ok(())
}
