//! A frame loop: threads load while every frame draws what is there. Prints what a viewer would upload, and the counters.
//!
//! ```sh
//! cargo run --release -p lodpack --example frame_loop -- model.lodpack
//! ```

mod viewing;

use std::{error::Error, sync::Arc, time::Duration};

use lodpack::{
    File, Limits,
    session::{Loaders, Motion, Options, Session, Shows},
};
use viewing::{FRAME_COUNT, FRAMES_PER_SECOND, Scene};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: frame_loop model.lodpack")?;
    let file = File::open(Arc::new(std::fs::File::open(path)?), Limits::default())?;
    let mut scene = Scene::new(&file)?;
    let mut session = Session::open(&file, Options::default())?;
    let loaders = Loaders::spawn(&session, file.source().clone(), 4);
    let mut motion = Motion::new();
    let frame_time = Duration::from_secs(1) / FRAMES_PER_SECOND;
    for number in 0..FRAME_COUNT {
        let started = loaders.now();
        let pose = scene.pose(number);
        motion.observe(frame_time * (number + 1), pose);
        let (wanted, expected) = (scene.cut(&pose)?, scene.expect(&motion, Duration::from_millis(200))?);
        let frame = loaders.frame(&mut session, &wanted, &expected)?;

        // A viewer uploads surfaces and strips that changed, frees what was removed, and draws all roots.
        let what = match frame.shows {
            Shows::Nothing => "nothing".to_string(),
            Shows::Overview => "the overview".to_string(),
            Shows::Picture => format!("{} triangles", session.picture().triangle_count()),
        };
        if number % 50 == 0 {
            let (surfaces, strips) = (frame.changes.surfaces.len(), frame.changes.strips.len());
            let late = frame.late_roots;
            println!("frame {number}: {what}; {surfaces} surfaces and {strips} strips to upload, {late} roots late");
        }
        for problem in session.take_problems() {
            eprintln!("{}: {}", problem.place, problem.error);
        }
        std::thread::sleep(frame_time.saturating_sub(loaders.now() - started));
    }
    println!("{:#?}", session.counters());
    Ok(())
}
