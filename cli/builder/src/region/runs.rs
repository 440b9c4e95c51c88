//! What one process sends to the regions: triangles in runs by region, all in one file.
//!
//! With a file for each pair of a process and a region, a thousand processes would make millions of small files.

use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::decompose::Decomposition;
use super::gather::{Gathered, Gathering};
use super::numbered::NumberedMesh;
use super::packed::{get_ascending, get_triangles, put_ascending, put_triangles};
use lodpack_import::ImportError;
use lodpack_runtime::storage::{DAMAGED, WorkError};

/// A run of triangles of one region.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Run {
    region: u32,
    /// Offset in the file.
    offset: u64,
    bytes: u32,
    triangles: u32,
    /// XXH3 hash of its bytes.
    hash: u64,
}

/// Where the runs of a file are. Runs of one region have the order of the input.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunList {
    runs: Vec<Run>,
    /// Whether the triangles have numbers.
    is_numbered: bool,
}

/// A file of runs.
#[derive(Clone, Debug)]
pub struct RunFile {
    path: PathBuf,
    list: RunList,
}

impl RunList {
    /// Adds the triangles of each region to those in `counts`. None if there are fewer regions.
    pub fn add_to(&self, counts: &mut [u64]) -> Option<()> {
        self.runs.iter().try_for_each(|run| {
            *counts.get_mut(run.region as usize)? += u64::from(run.triangles);
            Some(())
        })
    }

    /// Sends a range of an input's triangles to their regions, through a file that gets its name once it is complete
    /// and on the disk. Returns its size, too.
    ///
    /// # Errors
    /// If the input cannot be read, or the file cannot be written.
    pub fn write(
        input: &NumberedMesh,
        range: Range<u64>,
        tree: &Decomposition,
        is_numbered: bool,
        path: &Path,
    ) -> Result<(Self, u64), ImportError> {
        let temporary = path.with_extension("tmp");
        let failed = |source| WorkError::new(path, "written", source);
        let mut file = File::create(&temporary).map_err(|source| WorkError::new(&temporary, "made", source))?;
        let (mut list, mut offset, mut bytes) = (Self { runs: vec![], is_numbered }, 0, vec![]);
        let mut write = |gathered: &mut [Gathered]| {
            for (region, some) in (0..).zip(gathered).filter(|(_, some)| !some.triangles.is_empty()) {
                bytes.clear();
                put_triangles(&mut bytes, &some.triangles);
                put_ascending(&mut bytes, &some.numbers);
                file.write_all(&bytes).map_err(failed)?;
                let [triangles, length] = [some.triangles.len(), bytes.len()].map(|count| count as u32);
                list.runs.push(Run { region, offset, bytes: length, triangles, hash: xxh3_64(&bytes) });
                offset += bytes.len() as u64;
                some.triangles.clear();
                some.numbers.clear();
            }
            Ok(())
        };
        let (mut gathering, mut failure) = (Gathering::new(tree, is_numbered, range.start as u32), None);
        input.for_each_triangle(range, |triangle| {
            if failure.is_none() {
                failure = gathering.push(triangle, |vertex| input.position(vertex), &mut write).err();
            }
        })?;
        failure.map_or(Ok(()), Err)?;
        gathering.finish(&mut write)?;
        file.sync_all().and_then(|()| fs::rename(&temporary, path)).map_err(failed)?;
        Ok((list, offset))
    }
}

impl RunFile {
    /// The runs of a file.
    pub fn new(path: PathBuf, list: RunList) -> Self {
        Self { path, list }
    }

    /// Appends the triangles of a region.
    pub(super) fn read(&self, region: u32, to: &mut Gathered) -> Result<(), WorkError> {
        let mut runs = self.list.runs.iter().filter(|run| run.region == region).peekable();
        if runs.peek().is_none() {
            return Ok(());
        }
        let failed = |source| WorkError::new(&self.path, "read", source);
        let mut file = File::open(&self.path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        for run in runs {
            let count = run.triangles as usize;
            if run.offset.checked_add(run.bytes.into()).is_none_or(|end| end > length) {
                return Err(WorkError::damaged(&self.path, DAMAGED));
            }
            let mut bytes = vec![0; run.bytes as usize];
            file.seek(SeekFrom::Start(run.offset)).and_then(|_| file.read_exact(&mut bytes)).map_err(failed)?;
            let numbers = if self.list.is_numbered { count } else { 0 };
            let mut rest = &bytes[..];
            let is_sound = xxh3_64(&bytes) == run.hash;
            let read = is_sound.then(|| Some((get_triangles(&mut rest, count)?, get_ascending(&mut rest, numbers)?)));
            let Some((triangles, numbers)) = read.flatten() else {
                return Err(WorkError::damaged(&self.path, DAMAGED));
            };
            to.triangles.extend(triangles);
            to.numbers.extend(numbers);
        }
        Ok(())
    }
}
