mod borders;
mod damage;
mod following;
mod heights;
mod images;
mod light;
#[cfg(feature = "threads")]
mod lists;
mod loading;
mod modes;
mod pace;
#[cfg(all(feature = "pool", feature = "threads"))]
mod pool;
mod textures;
#[cfg(feature = "threads")]
mod threads;
mod trees;

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use super::{Options, Session, frame::Difference};
use crate::{
    Cut, File, Limits, Mesh, Node,
    source::ReadAt,
    tests::synthetic::{Options as ModelOptions, Random, cube, file_of},
};

/// Every page is read on its own, so each one's fate is its own.
const APART: Options = Options {
    mode: super::Mode::Asynchronous,
    byte_cache: 64 << 20,
    decoded_cache: 64 << 20,
    texel_cache: 64 << 20,
    texels_per_pixel: 1.0,
    max_reads: 4,
    max_gap: 0,
    max_read_bytes: 0,
    prefetch_bytes: 1 << 20,
    max_attempts: 3,
    retry_delay: Duration::from_millis(10),
    may_stay_finer: true,
    upload_bytes: u64::MAX,
    sample_px: f64::INFINITY,
    light: false,
};

/// A closed surface of 6 n^2 roots with four levels; one of four is a grid.
fn model(n: i64) -> Arc<File<Vec<u8>>> {
    let bytes = file_of(&cube(n), ModelOptions { levels: 4, seed: 5, grids_of_four: 1, heights: 0 });
    Arc::new(File::open(bytes, Limits::default()).unwrap())
}

fn cut_of(nodes: &[Node]) -> Cut {
    let nodes = nodes.to_vec();
    Cut { nodes, ..Cut::default() }
}

/// The roots around a place that wanders over the surface are fine.
fn wandering_cut(file: &File<Vec<u8>>, step: u32) -> Vec<Node> {
    let count = file.root_count();
    let centre = step * 3 % count;
    let level = |root: u32| 3_u8.saturating_sub((root.abs_diff(centre) / 3).min(3) as u8);
    (0..count).map(|root| Node { root, level: level(root) }).collect()
}

fn random_cut(file: &File<Vec<u8>>, random: &mut Random) -> Vec<Node> {
    (0..file.root_count()).map(|root| Node { root, level: random.below(4) as u8 }).collect()
}

type Points = [[u64; 3]; 3];

/// Triangles by their positions, each beginning with its least corner.
fn triangles(mesh: &Mesh) -> Vec<Points> {
    let mut triangles: Vec<Points> = mesh.triangles.iter().map(|t| corners(mesh, t)).collect();
    triangles.iter_mut().for_each(|triangle| {
        let least = (0..3).min_by_key(|&k| triangle[k]).unwrap();
        triangle.rotate_left(least);
    });
    triangles.sort_unstable();
    triangles
}

fn corners(mesh: &Mesh, triangle: &[u32; 3]) -> Points {
    triangle.map(|vertex| mesh.positions[vertex as usize].map(f64::to_bits))
}

/// Bytes of which some cannot be read, or come damaged.
struct Faulty {
    bytes: Vec<u8>,
    /// Reads that begin here fail so often.
    failures: Mutex<BTreeMap<u64, u32>>,
    /// Bytes here come damaged.
    damaged: BTreeSet<u64>,
}

impl Faulty {
    fn new(bytes: &[u8]) -> Self {
        Self { bytes: bytes.to_vec(), failures: Mutex::default(), damaged: BTreeSet::new() }
    }
}

impl ReadAt for Faulty {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        let mut failures = self.failures.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(left) = failures.get_mut(&offset).filter(|left| **left > 0) {
            *left -= 1;
            return Err(io::ErrorKind::ConnectionReset.into());
        }
        self.bytes.read_at(offset, buf)?;
        for at in self.damaged.range(offset..offset + buf.len() as u64) {
            buf[(at - offset) as usize] ^= 0x55;
        }
        Ok(())
    }

    fn size(&self) -> io::Result<u64> {
        self.bytes.size()
    }
}

fn session(file: &Arc<File<Vec<u8>>>, options: Options) -> Session {
    file.session(options).unwrap()
}

/// Offsets of the reads that a session does to draw a cut, by level of what they bring, if each page is read on its
/// own.
fn reads_of(file: &Arc<File<Vec<u8>>>, cuts: &[Vec<Node>]) -> Vec<u64> {
    let mut session = session(file, APART);
    let mut offsets = Vec::new();
    for wanted in cuts {
        session.begin(wanted, &[], Duration::ZERO).unwrap();
        while let Some(job) = session.poll(Duration::ZERO) {
            match job {
                crate::stream::Job::Read(read) => {
                    offsets.push(read.offset);
                    session.supply(&read, read.run(file.source()), Duration::ZERO);
                }
                crate::stream::Job::Decode(decoding) => session.finish(decoding.run(), Duration::ZERO),
            }
        }
        session.end(Duration::ZERO).unwrap();
    }
    offsets
}

fn uniform(file: &File<Vec<u8>>, level: u8) -> Vec<Node> {
    (0..file.root_count()).map(|root| Node { root, level }).collect()
}
