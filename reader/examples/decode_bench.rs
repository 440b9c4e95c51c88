//! Prints how fast one thread decodes and joins a whole file at its finest level: decode_bench FILE...
//!
//! A sample is a vertex. Time is processor time where the system reports it (Linux), so other programs do not count;
//! elsewhere it is elapsed time.

mod timing;

use lodpack::{Cut, File, Limits, Result};

/// Measurements repeat until this much time has been spent.
const LEAST_SECONDS: f64 = 2.0;

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    println!("samples  triangles  one root after another    joined (million samples per second)  file");
    for path in std::env::args().skip(1) {
        let bytes = std::fs::read(&path)?;
        let file = File::open(bytes.as_slice(), Limits::default())?;
        let finest = file.level_count() as u8 - 1;
        let cut = file.uniform_cut(finest)?;
        let mesh = file.extract(&cut)?;
        let joined = timing::seconds(LEAST_SECONDS, || file.extract(&cut).map(|mesh| mesh.positions.len()))?;
        let alone = timing::seconds(LEAST_SECONDS, || decode_roots(&file, &cut))?;
        let count = mesh.positions.len();
        let speed = |seconds: f64| count as f64 / seconds / 1e6;
        println!("{count:8}  {:9}  {:22.2}  {:10.2}  {path}", mesh.triangles.len(), speed(alone), speed(joined));
    }
    Ok(())
}

/// Decodes each root on its own, as a streaming viewer does.
fn decode_roots(file: &File<&[u8]>, cut: &Cut) -> Result<usize> {
    cut.nodes.iter().map(|node| Ok(file.decode_root(node.root, node.level)?.patch.interior.len())).sum()
}
