//! `lodpack compare`

mod surface;

use super::{print_json, use_threads};
use crate::args::CompareArgs;
use crate::interrupt;
use crate::output::{bound, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::Result;
use glam::DVec3;
use lodpack_cli::measure::two_sided::{OneSided, Side};
use lodpack_cli::progress::Progress;
use serde::Serialize;
use std::process::ExitCode;
use surface::{Chosen, Space, Surface, transform};

/// Distances below this share of the diagonal of A are not told apart from none.
const FLOOR: f64 = 1e-9;

#[derive(Serialize)]
struct Comparison {
    a: Named,
    b: Named,
    /// In which coordinates they are compared; lengths are in their unit.
    coordinates: &'static str,
    /// Of B, the coarsest first.
    levels: Vec<Compared>,
}

#[derive(Serialize)]
struct Named {
    path: String,
    kind: &'static str,
    triangles: usize,
}

/// A level of B beside A.
#[derive(Serialize)]
struct Compared {
    name: String,
    triangles: usize,
    /// What B says of its own error, and how that is called.
    claimed: Option<f64>,
    claim: &'static str,
    /// Whether it says so of the samples of a grid alone.
    claims_of_samples: bool,
    /// Whether it is less than a distance that occurs, by more than rounding makes of equal surfaces.
    claims_too_little: bool,
    /// The larger one of both directions, between these bounds.
    distance: [f64; 2],
    a_to_b: Distance,
    b_to_a: Distance,
    /// Of the samples of A, if it is a raster.
    samples_of_a_to_b: Option<Distance>,
}

/// How far a surface is from another.
#[derive(Serialize)]
struct Distance {
    /// A distance that occurs.
    lower: f64,
    /// None is larger.
    upper: f64,
    /// Where the lower bound occurs.
    at: [f64; 3],
    /// Root mean square over points spread evenly.
    rms: f64,
}

/// Compares two surfaces.
pub fn run(args: &CompareArgs) -> Result<ExitCode> {
    use_threads(args.threads)?;
    interrupt::on_stop_leave_nothing();
    let progress = Terminal::new(args.progress, progress_bar::COMPARE);
    progress.begin("import", 0);
    let b = Surface::open(&args.b, args, false)?;
    let a = Surface::open(&args.a, args, b.is_terrain())?;
    // What A is compared with may itself lie on the globe.
    let b = if a.is_terrain() && b.is_raster() { Surface::open(&args.b, args, true)? } else { b };
    let space = if args.matrix.is_some() { Space::Own } else { a.space().max(b.space()) };
    let edges = [b.edges(), a.edges()];
    let finest = a.finest()?;
    let mut mesh = a.mesh(&finest, edges[0], &progress)?;
    match &args.matrix {
        Some(matrix) => transform(matrix, &mut mesh.positions),
        None => drop(a.take_to(space, &mut mesh, args)?),
    }
    // Positions relative to one of them keep their digits far from the origin.
    let [origin, high] = mesh.bounds();
    mesh.positions.iter_mut().for_each(|p| *p -= origin);
    let floor = FLOOR * origin.distance(high);
    let samples = a.is_raster().then_some(mesh.positions.as_slice());
    let side = Side::new(&mesh.positions, &mesh.triangles);
    let levels = b.chosen(args.level, args.tolerance)?;
    let mut compared = vec![];
    for level in &levels {
        let mut other = b.mesh(level, edges[1], &progress)?;
        let unit = if args.matrix.is_some() { 1.0 } else { b.take_to(space, &mut other, args)? };
        other.positions.iter_mut().for_each(|p| *p -= origin);
        let other_side = Side::new(&other.positions, &other.triangles);
        let measure = Measure { args, floor, origin, progress: &progress };
        compared.push(measure.compare((&side, samples), &other_side, (level, unit), other.triangles.len()));
    }
    progress.complete();
    let named = |path: &std::path::Path, surface: &Surface, triangles| Named {
        path: path.display().to_string(),
        kind: surface.kind(),
        triangles,
    };
    let comparison = Comparison {
        b: named(&args.b, &b, compared.last().map_or(0, |level| level.triangles)),
        a: named(&args.a, &a, mesh.triangles.len()),
        coordinates: if args.matrix.is_some() { "those of B" } else { space.text() },
        levels: compared,
    };
    match args.json {
        true => print_json(&comparison)?,
        false => print(&comparison)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// What all levels are measured with.
struct Measure<'a> {
    args: &'a CompareArgs,
    floor: f64,
    origin: DVec3,
    progress: &'a Terminal,
}

impl Measure<'_> {
    fn compare(
        &self,
        (a, samples): (&Side, Option<&[DVec3]>),
        b: &Side,
        (level, unit): (&Chosen, f64),
        triangles: usize,
    ) -> Compared {
        let Self { args, floor, progress, .. } = *self;
        progress.begin("compare", 128);
        let one_way = |from: &Side, to: &Side| {
            self.distance(from.measured(to, args.samples as usize, (args.gap, floor), &|| progress.advance(1)))
        };
        let (a_to_b, b_to_a) = (one_way(a, b), one_way(b, a));
        let distance = [a_to_b.lower.max(b_to_a.lower), a_to_b.upper.max(b_to_a.upper)];
        let claimed = level.claimed.map(|claimed| claimed * unit);
        let samples_of_a_to_b = samples.map(|samples| self.distance(b.of_points(samples)));
        let claims_of_samples = level.is_of_samples && samples_of_a_to_b.is_some();
        let occurs =
            samples_of_a_to_b.as_ref().filter(|_| claims_of_samples).map_or(distance[0], |samples| samples.lower);
        Compared {
            name: level.name.clone(),
            triangles,
            claimed,
            claim: level.claim,
            claims_of_samples,
            claims_too_little: claimed.is_some_and(|claimed| claimed + floor < occurs),
            distance,
            a_to_b,
            b_to_a,
            samples_of_a_to_b,
        }
    }

    fn distance(&self, found: OneSided) -> Distance {
        let OneSided { lower, upper, at, rms } = found;
        Distance { lower, upper, at: (at + self.origin).to_array(), rms }
    }
}

fn print(all: &Comparison) -> Result<()> {
    for (letter, one) in [("A", &all.a), ("B", &all.b)] {
        say!("{letter}: {}, {} of {} triangles", one.path, one.kind, count(one.triangles as u64));
    }
    say!("coordinates and lengths: {}", all.coordinates);
    for level in &all.levels {
        say!("{}, {} triangles", level.name, count(level.triangles as u64));
        let line = |name: &str, distance: &Distance| -> Result<()> {
            let [x, y, z] = distance.at;
            say!(
                "  {name:<17} {:>10} to {:<10}  RMS {:<10}  largest at {x}, {y}, {z}",
                length(distance.lower),
                bound(distance.upper),
                length(distance.rms)
            );
            Ok(())
        };
        line("A to B", &level.a_to_b)?;
        line("B to A", &level.b_to_a)?;
        if let Some(samples) = &level.samples_of_a_to_b {
            line("samples of A to B", samples)?;
        }
        say!("  {:<17} {:>10} to {}", "distance", length(level.distance[0]), bound(level.distance[1]));
        if let Some(claimed) = level.claimed {
            let of = if level.claims_of_samples { "samples" } else { "distance" };
            let verdict = if level.claims_too_little { format!(": less than the {of}") } else { String::new() };
            say!("  B claims          {:>10} ({}){verdict}", length(claimed), level.claim);
        }
    }
    Ok(())
}
