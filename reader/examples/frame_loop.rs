//! A frame loop: threads load while every frame draws what is loaded. Prints what a viewer would upload, and the
//! counters.
//!
//! ```sh
//! cargo run --release -p lodpack --example frame_loop -- model.lodpack
//! ```

mod viewing;

use std::{collections::BTreeSet, error::Error, sync::Arc, time::Duration};

use lodpack::{
    File, Limits,
    stream::{Frame, Shows, StreamerOptions},
};
use viewing::{FRAME_COUNT, FRAMES_PER_SECOND, Path, query};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: frame_loop model.lodpack")?;
    let file = File::open(Arc::new(std::fs::File::open(path)?), Limits::default())?;
    let path = Path::around(file.bounds().ok_or("the file is empty")?);
    let mut streamer = file.streamer(StreamerOptions::default())?;
    for number in 0..FRAME_COUNT {
        let view = path.view(number);
        let streamed = streamer.frame(&query(view))?;

        // A viewer uploads the roots that changed, frees those that were removed, and draws all that remain.
        if number % 50 == 0 {
            let what = match streamed.frame.shows {
                Shows::Nothing => "nothing".to_string(),
                Shows::Overview => "the overview".to_string(),
                Shows::Picture => {
                    format!("{} triangles, {:.2} pixels off", streamer.triangle_count(), streamer.error_px(&view)?)
                }
            };
            let Frame { changes, late_roots, .. } = &streamed.frame;
            let strips = changes.strips.iter().map(|(root, _)| root);
            let changed: BTreeSet<u32> = strips.chain(&changes.surfaces).copied().collect();
            let drawn = changed.iter().filter_map(|&root| streamer.picture().root(root));
            let bytes: usize = drawn.map(|root| root.joined()).map(|(v, t)| size_of_val(&*v) + size_of_val(&*t)).sum();
            println!("frame {number}: {what}; {} roots, {bytes} bytes to upload; {late_roots} late", changed.len());
        }
        for problem in streamer.take_problems() {
            eprintln!("{}: {}", problem.location, problem.error);
        }
        let frame_time = Duration::from_secs(1) / FRAMES_PER_SECOND;
        std::thread::sleep(frame_time.saturating_sub(streamed.select_time + streamed.update_time));
    }
    println!("{:#?}", streamer.counters()[0]);
    Ok(())
}
