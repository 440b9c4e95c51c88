//! Picks in a file beside brute force over the plant that it was built from, and what they read.
//!
//! picks OBJECTS FILE [RAYS]
//!
//! FILE is built from the GLB that `generate plant OBJECTS` writes. Half of the rays (10,000 by default) begin outside,
//! half within the plant. A pick is right if it has the object, and the distance within the certified error, of the
//! first triangle of the input that the ray meets. Where it has another object, this may touch the first one, or the
//! ray may have passed an edge by less than the error: the ray must meet that object no farther away then, or rays
//! beside it, by up to twice the error, must meet it first.

use std::fs;

use glam::DVec3;
use lodpack::index::Ray;
use lodpack::source::Counting;
use lodpack::{File, Limits, Query};
use lodpack_tests::rays::{Hit, brute, meets, placed};
use lodpack_tests::scene::plant;
use rayon::prelude::*;

type Failure = Box<dyn std::error::Error>;

/// How much farther than its error a pick may be: rays meet surfaces at a slant.
const SLANT: f64 = 20.0;

/// The part of `count` at which a number of a low-discrepancy sequence lies.
fn share(number: u32, base: u32) -> f64 {
    let (mut rest, mut scale, mut sum) = (number, 1.0, 0.0);
    while rest > 0 {
        scale /= f64::from(base);
        sum += scale * f64::from(rest % base);
        rest /= base;
    }
    sum
}

#[derive(Default)]
struct Tally {
    right: u32,
    beside: u32,
    wrong: u32,
    met: u32,
    requests: Vec<u64>,
    bytes: Vec<u64>,
}

fn main() -> Result<(), Failure> {
    let usage = "usage: picks OBJECTS FILE [RAYS]";
    let mut args = std::env::args().skip(1);
    let count: u32 = args.next().ok_or(usage)?.parse()?;
    let bytes = fs::read(args.next().ok_or(usage)?)?;
    let rays: u32 = args.next().map_or(Ok(10_000), |rays| rays.parse())?;
    let scene = plant(count);
    let objects = placed(&scene);
    let whole = File::open(bytes.as_slice(), Limits::default())?;
    let [low, high] = whole.bounds().ok_or("the file is empty")?.map(DVec3::from);
    let ids = |node: u32| (scene.nodes[node as usize].name.clone(), scene.nodes[node as usize].id.clone());
    let finest = whole.select(&Query::default())?.error;
    let (size, middle) = (high - low, (low + high) / 2.0);
    let one = |number: u32| -> Result<Tally, lodpack::Error> {
        let place = |bases: [u32; 3]| low + size * DVec3::from(bases.map(|base| share(number + 1, base)));
        let to = place([2, 3, 5]);
        let from = place([7, 11, 13]);
        let origin = if number.is_multiple_of(2) {
            middle + (from - middle).normalize_or(DVec3::Y) * size.length()
        } else {
            from
        };
        let direction = (to - origin).normalize_or(DVec3::X);
        let expected = brute(&objects, origin, direction);
        let file = File::open(Counting::new(bytes.as_slice()), Limits::default())?;
        let opened = [file.source().read_count(), file.source().byte_count()];
        let pick = file.pick(Ray { origin: origin.into(), direction: direction.into() })?;
        let mut tally = Tally {
            met: u32::from(expected.is_some()),
            requests: vec![file.source().read_count() - opened[0]],
            bytes: vec![file.source().byte_count() - opened[1]],
            ..Tally::default()
        };
        let named = |pick: &lodpack::decode::Pick| -> Result<(Option<String>, Option<String>), lodpack::Error> {
            let objects = whole.objects().zip(pick.object);
            let node = objects.map(|(objects, object)| objects.node(object)).transpose()?.unwrap_or_default();
            Ok((node.name, node.id))
        };
        let is_it = |hit: Hit| -> Result<bool, lodpack::Error> {
            Ok(match (hit, &pick) {
                (None, None) => true,
                (Some((distance, node)), Some(pick)) => {
                    (distance - pick.distance).abs() <= SLANT * pick.error && ids(node) == named(pick)?
                }
                _ => false,
            })
        };
        if is_it(expected)? {
            tally.right = 1;
            return Ok(tally);
        }
        let error = pick.as_ref().map_or(finest, |pick| pick.error);
        if let (Some((distance, _)), Some(found)) = (expected, &pick) {
            let name = named(found)?;
            let own = objects.iter().filter(|object| ids(object.node) == name);
            let meets = own.flat_map(|object| object.triangles.iter()).filter_map(|&t| meets(t, origin, direction));
            if meets.into_iter().any(|other| (other - distance).abs() <= SLANT * error) {
                tally.beside = 1;
                return Ok(tally);
            }
        }
        let [x, y] = [direction.any_orthonormal_vector(), direction.cross(direction.any_orthonormal_vector())];
        let steps = || (-4..=4).map(|step| f64::from(step) / 2.0);
        for (across, up) in steps().flat_map(|across| steps().map(move |up| (across, up))) {
            let away = (x * across + y * up) * error;
            if is_it(brute(&objects, origin + away, direction))? {
                tally.beside = 1;
                return Ok(tally);
            }
        }
        tally.wrong = 1;
        println!("wrong: from {origin} to {direction}: {expected:?} {pick:?}");
        Ok(tally)
    };
    let all: Vec<Tally> = (0..rays).into_par_iter().map(one).collect::<Result<_, _>>()?;
    let sum = |of: fn(&Tally) -> u32| all.iter().map(of).sum::<u32>();
    println!(
        "{rays} rays, {} meet something: {} picks as brute force, {} of what is as near within the error, {} wrong",
        sum(|tally| tally.met),
        sum(|tally| tally.right),
        sum(|tally| tally.beside),
        sum(|tally| tally.wrong)
    );
    for (what, of) in
        [("requests", (|tally| &tally.requests) as fn(&Tally) -> &Vec<u64>), ("bytes", |tally| &tally.bytes)]
    {
        let mut numbers: Vec<u64> = all.iter().flat_map(|tally| of(tally).clone()).collect();
        numbers.sort_unstable();
        let at = |share: usize| numbers[(numbers.len() - 1) * share / 100];
        println!("{what} a pick: median {}, of 95 % at most {}, at most {}", at(50), at(95), at(100));
    }
    Ok(())
}
