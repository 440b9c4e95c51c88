//! Hides and isolates random sets of objects and assemblies, and compares pixels with a picture of the input.
//!
//! hidden OBJECTS FILE [SETS [PIXELS]]
//!
//! FILE is built from the GLB that `generate plant OBJECTS` writes. Each of SETS (1,000 by default) is hidden or shown
//! alone at the finest level: the pixels that change are those in which the input shows something hidden. Those that do
//! otherwise are looked at by rays beside them, up to twice the certified error away, as at silhouettes. Cuts of random
//! tolerances show nothing hidden, and their edges lie between two triangles of one object. Ends with 1 if not.

use std::process::ExitCode;

use lodpack::{File, Limits};
use lodpack_tests::hiding::Comparison;
use lodpack_tests::scene::plant;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<ExitCode, Failure> {
    let usage = "usage: hidden OBJECTS FILE [SETS [PIXELS]]";
    let mut args = std::env::args().skip(1);
    let scene = plant(args.next().ok_or(usage)?.parse()?);
    let bytes = std::fs::read(args.next().ok_or(usage)?)?;
    let sets: u32 = args.next().map_or(Ok(1000), |sets| sets.parse())?;
    let pixels: usize = args.next().map_or(Ok(400), |pixels| pixels.parse())?;
    let file = File::open(bytes.as_slice(), Limits::default())?;
    let found = Comparison::new(&scene, &file, pixels)?.random(sets)?;
    println!(
        "{sets} sets: {} of {} pixels change as the input says, {} otherwise within the error, {} wrong",
        found.changed, found.pixels, found.beside, found.wrong
    );
    println!(
        "cuts of random tolerances: {} triangles, {} of hidden objects, {} open edges",
        found.triangles, found.shown, found.open
    );
    Ok(if found.wrong + found.shown + found.open == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
