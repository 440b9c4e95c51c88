//! Prints how long a session takes for a frame when everything is loaded: `begin` and `end`, for a cut that does not
//! change and for a cut of which a thousandth changes in every frame.
//!
//! `cargo run --release -p lodpack --example session_bench -- FILE...`
//!
//! This makes files of many roots: `lodpack report MESH --trial --chart-triangles 100 -o many.lodpack`.

use std::{error::Error, time::Duration, time::Instant};

use lodpack::{
    File, Limits, Node,
    stream::{Mode, Options, Simulation},
};

const FRAMES: usize = 200;
/// The cut is at this level; roots that change go to the next coarser level and back.
const LEVEL: u8 = 1;
/// One root in this many changes in every frame.
const SHARE: usize = 1000;

fn main() -> Result<(), Box<dyn Error>> {
    println!("   nodes  cut             begin ms    end ms  worst ms  surfaces and strips made anew");
    for name in std::env::args().skip(1) {
        measure(&File::open(std::fs::read(name)?, Limits::default())?)?;
    }
    Ok(())
}

fn measure(file: &File<Vec<u8>>) -> lodpack::Result<()> {
    let unbounded = u64::MAX / 4;
    let options =
        Options { mode: Mode::Asynchronous, byte_cache: unbounded, decoded_cache: unbounded, ..Options::default() };
    let mut session = file.session(options)?;
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let mut cut: Vec<Node> = (0..file.root_count()).map(|root| Node { root, level: LEVEL }).collect();
    loop {
        let frame = simulation.frame(&mut session, &cut, &[])?;
        if frame.is_complete {
            break;
        }
        simulation.settle(&session);
    }
    for (name, changing) in [("unchanged", 0), ("a thousandth", cut.len().div_ceil(SHARE))] {
        let (mut begin, mut end, mut all) = (Vec::new(), Vec::new(), Vec::new());
        let (mut next, mut anew) = (0, 0);
        for _ in 0..FRAMES {
            for _ in 0..changing {
                // Numbers that are far apart, each as often as any other.
                next = (next + 7919) % cut.len();
                cut[next].level = LEVEL - cut[next].level.min(LEVEL);
            }
            let start = Instant::now();
            session.begin(&cut, &[], simulation.now())?;
            let begun = start.elapsed();
            let frame = session.end(simulation.now());
            let ended = start.elapsed();
            let Some(frame) = frame.filter(|frame| frame.is_complete) else { continue };
            anew += frame.changes.surfaces.len() + frame.changes.strips.len();
            begin.push(begun);
            end.push(ended - begun);
            all.push(ended);
        }
        let ms = |values: &mut Vec<Duration>, share: f64| {
            values.sort_unstable();
            let at = (values.len().saturating_sub(1) as f64 * share) as usize;
            values.get(at).map_or(f64::NAN, |time| time.as_secs_f64() * 1e3)
        };
        println!(
            "{:8}  {name:14}  {:8.3}  {:8.3}  {:8.3}  {:8.1}",
            cut.len(),
            ms(&mut begin, 0.5),
            ms(&mut end, 0.5),
            ms(&mut all, 1.0),
            anew as f64 / all.len().max(1) as f64
        );
    }
    Ok(())
}
