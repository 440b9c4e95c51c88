//! What the inputs of a job contain, as hashes of ranges of their bytes: so no process has to read all of them before
//! the others can begin.
//!
//! The bytes of all inputs, one file after the other, are divided into as many ranges as a stage has tasks. Each task
//! hashes its own, file by file. A job is recognised by samples of its inputs; whether an input is still what it was
//! follows from all hashes together.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;

use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::tasks::known_hashes;
use super::{InputFile, Manifest, Stages};
use lodpack_runtime::storage::WorkError;

/// Bytes that are read at once.
const BUFFER_BYTES: usize = 1 << 20;
/// Samples of a file, and the bytes of each. Smaller files are read as a whole.
const SAMPLES: u64 = 64;
const SAMPLE_BYTES: u64 = 64 << 10;

/// Inputs whose bytes are divided into ranges.
pub(super) struct Contents<'a> {
    inputs: &'a [InputFile],
    stages: Stages,
}

impl<'a> Contents<'a> {
    pub fn new(inputs: &'a [InputFile], stages: Stages) -> Self {
        Self { inputs, stages }
    }

    /// What belongs to the range of a task: of each file that has some of it, its number and the bytes.
    pub fn pieces(&self, task: u32) -> impl Iterator<Item = (usize, Range<u64>)> + use<'a> {
        let of_task = self.stages.range(task, self.inputs.iter().map(|file| file.bytes).sum());
        let mut first = 0;
        self.inputs.iter().enumerate().filter_map(move |(number, file)| {
            let [start, end] = [of_task.start, of_task.end].map(|at| at.clamp(first, first + file.bytes) - first);
            first += file.bytes;
            (start < end).then_some((number, start..end))
        })
    }

    /// The hashes of the pieces of a task.
    ///
    /// # Errors
    /// If a file cannot be read, or is shorter than it was.
    pub fn hashes(&self, task: u32) -> Result<Vec<u64>, WorkError> {
        self.pieces(task).map(|(file, bytes)| hash(&self.inputs[file].path, bytes)).collect()
    }

    /// Whether a file that is now called `path` differs from one of the inputs in any piece whose hash is known.
    fn differs(&self, number: usize, path: &Path, known: &[Option<Vec<u64>>]) -> bool {
        let is_same = |(task, hashes): (u32, &Option<Vec<u64>>)| {
            let mut pieces = self.pieces(task).zip(hashes.iter().flatten());
            pieces.all(|((file, bytes), then)| file != number || hash(path, bytes).is_ok_and(|now| now == *then))
        };
        !(0..).zip(known).all(is_same)
    }
}

/// One number for the content of all inputs, from the hashes of all tasks in order.
pub(super) fn root(hashes: impl IntoIterator<Item = Vec<u64>>) -> u64 {
    let bytes: Vec<u8> = hashes.into_iter().flatten().flat_map(u64::to_le_bytes).collect();
    xxh3_64(&bytes)
}

/// Whether the content of a file, by name `path` now, differs from what is known of an input of a job in a directory.
/// The file has the input's size.
pub(super) fn differs(manifest: &Manifest, job: &Path, number: usize, path: &Path) -> bool {
    let input = &manifest.inputs[number];
    match manifest.stages {
        None => InputFile::of(path.to_owned()).is_ok_and(|now| now.xxh3 != input.xxh3),
        Some(stages) => {
            InputFile::sampled(path.to_owned()).is_ok_and(|now| now.xxh3 != input.xxh3)
                || Contents::new(&manifest.inputs, stages).differs(number, path, &known_hashes(job, manifest))
        }
    }
}

/// XXH3 hash of some bytes of a file.
fn hash(path: &Path, bytes: Range<u64>) -> Result<u64, WorkError> {
    let mut hash = Xxh3::new();
    let added = File::open(path).and_then(|mut file| add(&mut hash, &mut file, bytes));
    added.map_err(|source| WorkError::new(path, "read", source))?;
    Ok(hash.digest())
}

/// XXH3 hash of samples of a file that are spread evenly, its beginning and its end among them.
///
/// # Errors
/// If the file cannot be read.
pub(super) fn sample(file: &mut File, length: u64) -> io::Result<u64> {
    let mut hash = Xxh3::new();
    if length <= SAMPLES * SAMPLE_BYTES {
        add(&mut hash, file, 0..length)?;
    } else {
        for sample in 0..SAMPLES {
            let start = (u128::from(length - SAMPLE_BYTES) * u128::from(sample) / u128::from(SAMPLES - 1)) as u64;
            add(&mut hash, file, start..start + SAMPLE_BYTES)?;
        }
    }
    Ok(hash.digest())
}

fn add(hash: &mut Xxh3, file: &mut File, bytes: Range<u64>) -> io::Result<()> {
    file.seek(SeekFrom::Start(bytes.start))?;
    let mut left = bytes.end - bytes.start;
    let mut buffer = vec![0; BUFFER_BYTES.min(left as usize)];
    while left > 0 {
        let size = left.min(buffer.len() as u64) as usize;
        file.read_exact(&mut buffer[..size])?;
        hash.update(&buffer[..size]);
        left -= size as u64;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn inputs(folder: &Path, contents: &[&[u8]]) -> Vec<InputFile> {
        let input = |(number, content): (usize, &&[u8])| {
            let path = folder.join(format!("{number}.ply"));
            fs::write(&path, content).unwrap();
            InputFile::sampled(path).unwrap()
        };
        contents.iter().enumerate().map(input).collect()
    }

    #[test]
    fn pieces_hold_every_byte_of_every_file_once() {
        let folder = tempfile::tempdir().unwrap();
        let inputs = inputs(folder.path(), &[&[1; 10], &[2; 1], &[3; 25]]);
        for ranges in [1, 2, 7, 36, 50] {
            let stages = Stages { ranges, ..Stages::default() };
            let contents = Contents::new(&inputs, stages);
            let pieces = (0..ranges).flat_map(|task| contents.pieces(task));
            let bytes: Vec<(usize, u64)> = pieces.flat_map(|(file, bytes)| bytes.map(move |at| (file, at))).collect();
            let all = [10, 1, 25].into_iter().enumerate();
            assert_eq!(bytes, all.flat_map(|(file, size)| (0..size).map(move |at| (file, at))).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_changed_byte_is_found_in_its_file_and_range() {
        let folder = tempfile::tempdir().unwrap();
        let inputs = inputs(folder.path(), &[&[1; 1000], &[2; 500]]);
        let contents = Contents::new(&inputs, Stages { ranges: 4, ..Stages::default() });
        let mut known: Vec<_> = (0..4).map(|task| contents.hashes(task).ok()).collect();
        let [first, second] = [0, 1].map(|number: usize| inputs[number].path.clone());
        assert!(!contents.differs(0, &first, &known) && !contents.differs(1, &second, &known));
        let mut bytes = vec![1; 1000];
        bytes[400] = 7;
        fs::write(&first, &bytes).unwrap();
        assert!(contents.differs(0, &first, &known) && !contents.differs(1, &second, &known));
        // The byte is in the second range, of which nothing is known now.
        known[1] = None;
        assert!(!contents.differs(0, &first, &known));
        fs::remove_file(&second).unwrap();
        assert!(contents.differs(1, &second, &known));
    }

    #[test]
    fn samples_of_a_large_file_reach_from_its_beginning_to_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large");
        let size = (SAMPLES * SAMPLE_BYTES * 3) as usize;
        let sampled = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            sample(&mut File::open(&path).unwrap(), size as u64).unwrap()
        };
        let mut bytes = vec![0; size];
        let before = sampled(&bytes);
        for at in [0, size - 1] {
            bytes[at] = 1;
            assert_ne!(sampled(&bytes), before, "{at}");
            bytes[at] = 0;
        }
        assert_eq!(sampled(&bytes), before);
    }
}
