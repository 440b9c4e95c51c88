//! Prints how fast one thread decodes and joins a whole file at its finest level: decode_bench FILE...
//!
//! A sample is a vertex. Time is processor time where the system reports it (Linux), so other programs do not count;
//! elsewhere it is elapsed time.

use std::time::Instant;

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
        let joined = seconds(|| file.extract(&cut).map(|mesh| mesh.positions.len()))?;
        let alone = seconds(|| decode_roots(&file, &cut))?;
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

/// Processor seconds of one call.
fn seconds(call: impl Fn() -> Result<usize>) -> Result<f64> {
    call()?;
    let (start, mut count) = (now(), 0);
    loop {
        std::hint::black_box(call()?);
        count += 1;
        let passed = now() - start;
        if passed > LEAST_SECONDS {
            return Ok(passed / f64::from(count));
        }
    }
}

/// Processor time of this thread, or elapsed time.
fn now() -> f64 {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let used: Option<f64> = text.split(' ').next().and_then(|nanoseconds| nanoseconds.parse().ok());
    used.map_or_else(|| START.get_or_init(Instant::now).elapsed().as_secs_f64(), |nanoseconds| nanoseconds * 1e-9)
}
