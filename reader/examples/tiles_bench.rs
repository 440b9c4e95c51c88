//! Prints what four tiles on as many threads as there are processors take beside one for the whole picture, and how
//! evenly borders that move share the work of a flight that sees a model in one half of the picture.
//!
//! `cargo run --release -p lodpack --example tiles_bench FILE`

#[allow(dead_code, reason = "other examples use the rest")]
mod viewing;

use std::{error::Error, sync::Arc};

use lodpack::{
    File, Limits, Query, View,
    select::{Coherence, TileTree, Tiles, Unification},
};
use viewing::{FRAME_COUNT, Path};

/// What a flight has taken.
#[derive(Default)]
struct Sums {
    /// Boxes projected and errors evaluated.
    evaluations: u64,
    /// Seconds of all tiles.
    seconds: f64,
    /// Sums over the frames of the largest share of a tile over the mean one: of seconds, of triangles.
    uneven: [f64; 2],
    frames: u32,
}

fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args().nth(1).ok_or("which file?")?;
    let file = File::open(std::fs::read(name)?, Limits::default())?;
    let path = Path::around(file.bounds().ok_or("the file is empty")?);
    let hierarchy = Arc::new(file.hierarchy()?);
    let query = |frame: u32, aside: f64| {
        let view = path.view(frame);
        let [right, _, forward] = view.axes();
        let forward = [0, 1, 2].map(|k| forward[k] + aside * right[k]);
        Query { view: Some(View { forward, ..view }), ..Query::default() }
    };
    let fly = |depth: u32, aside: f64, moves: Option<usize>| -> Result<Sums, Box<dyn Error>> {
        let mut tree = TileTree::new(depth)?;
        let mut tiles =
            Tiles::new(&hierarchy, &tree.queries(&query(0, aside))?, Coherence::default(), Unification::Quality)?;
        let mut sums = Sums::default();
        for frame in 1..FRAME_COUNT {
            let report = tiles.update(&tree.queries(&query(frame, aside))?)?;
            let seconds: Vec<f64> = report.times.iter().map(std::time::Duration::as_secs_f64).collect();
            let triangles: Vec<f64> = report.tiles.iter().map(|tile| tile.triangle_count as f64).collect();
            sums.evaluations += report.tiles.iter().map(|tile| tile.evaluation_count).sum::<u64>();
            sums.seconds += seconds.iter().sum::<f64>();
            sums.frames += 1;
            for (uneven, loads) in sums.uneven.iter_mut().zip([&seconds, &triangles]) {
                let mean = loads.iter().sum::<f64>() / loads.len() as f64;
                *uneven += loads.iter().copied().fold(0.0, f64::max) / mean.max(f64::MIN_POSITIVE);
            }
            if let Some(by) = moves {
                tree.rebalance([&seconds, &triangles][by]);
            }
        }
        Ok(sums)
    };
    let (one, four) = (fly(0, 0.0, None)?, fly(2, 0.0, None)?);
    println!(
        "four tiles: {:.2} of the evaluations of one, {:.2} of its time, {} threads",
        four.evaluations as f64 / one.evaluations as f64,
        four.seconds / one.seconds,
        std::thread::available_parallelism()?
    );
    println!("slowest tile over the mean, model in one half of the picture:");
    for (name, moves) in [("equal tiles", None), ("borders by seconds", Some(0)), ("borders by triangles", Some(1))] {
        let sums = fly(2, 0.5, moves)?;
        let [seconds, triangles] = sums.uneven.map(|sum| sum / f64::from(sums.frames));
        println!("  {name:20}  seconds {seconds:.2}  triangles {triangles:.2}");
    }
    Ok(())
}
