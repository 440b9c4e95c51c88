//! What a job is for: `job.json`, for people to read and for programs to compare.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

use super::JobError;
use crate::geometry_images::atlas_build::atlas_files;
use crate::mesh::tolerance::{Tolerance, Unit};
use crate::pipeline::{BuildOptions, Effort, Fillings};
use crate::storage::{JobId, WorkError};

/// The manifest's name in a job's directory.
pub const MANIFEST_NAME: &str = "job.json";

/// A job's inputs, options and parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the program that planned the job; others build other bytes.
    pub lodpack: String,
    /// The job's number, 32 hexadecimal digits: a hash of the two lists that follow.
    pub job: String,
    /// What was read, in order.
    pub inputs: Vec<InputFile>,
    /// All that the bytes of the result depend on.
    pub options: JobOptions,
    /// The parts, once the job is planned.
    pub parts: Vec<PartEntry>,
    /// The name of the file that they are merged to where no other is given, once the job is planned.
    pub output: PathBuf,
}

/// An input file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// Where it was.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// The stamp of its last change, nanoseconds since 1970, where the file system has one. It says when a file need not be read
    /// to know that it is the same, and nothing else: what it means as a time does not matter.
    pub modified: Option<u64>,
    /// XXH3 hash of its content, 16 hexadecimal digits.
    pub xxh3: String,
}

/// Options of a build as far as the result depends on them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobOptions {
    /// Bound on the certified error.
    pub tolerance: Tolerance,
    /// Unit of the coordinates.
    pub unit: Option<Unit>,
    /// Run time against bytes.
    pub effort: Effort,
    /// Fillings that may be used.
    pub fillings: Fillings,
    /// Triangles per chart.
    pub chart_triangles: Option<u32>,
    /// Triangles per region at most.
    pub region_triangles: u64,
    /// Whether more can be added.
    pub extensible: bool,
}

/// A part of a job: a run of regions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartEntry {
    /// Number of its first region.
    pub first_region: u32,
    /// How many regions; a part may have none.
    pub regions: u32,
    /// Their triangles.
    pub triangles: u64,
    /// Memory that building it takes.
    pub memory: u64,
}

impl JobOptions {
    /// What to build from these inputs, with no word of memory or places.
    pub fn of_inputs(&self, inputs: Vec<PathBuf>) -> BuildOptions {
        let &Self { tolerance, unit, effort, fillings, chart_triangles, region_triangles, extensible } = self;
        let others = BuildOptions::default();
        BuildOptions {
            inputs,
            tolerance,
            unit,
            effort,
            fillings,
            chart_triangles,
            region_triangles,
            extensible,
            ..others
        }
    }
}

impl Manifest {
    /// Reads all inputs.
    ///
    /// # Errors
    /// Where one cannot be read.
    pub fn of(options: &BuildOptions) -> Result<Self, JobError> {
        let mut inputs = vec![];
        for input in &options.inputs {
            match input.is_dir() {
                true => {
                    let files = atlas_files(input).map_err(|source| WorkError::new(input, "read", source))?;
                    files.into_iter().try_for_each(|path| InputFile::of(path).map(|file| inputs.push(file)))?;
                }
                false => inputs.push(InputFile::of(input.clone())?),
            }
        }
        let &BuildOptions { tolerance, unit, effort, fillings, chart_triangles, region_triangles, extensible, .. } =
            options;
        let options = JobOptions { tolerance, unit, effort, fillings, chart_triangles, region_triangles, extensible };
        let lodpack = env!("CARGO_PKG_VERSION").to_owned();
        let mut manifest = Self { lodpack, job: String::new(), inputs, options, parts: vec![], output: PathBuf::new() };
        manifest.job = manifest.number().to_string();
        Ok(manifest)
    }

    /// The job's number: what the inputs hold, not where they are.
    fn number(&self) -> JobId {
        let contents: Vec<(u64, &str)> = self.inputs.iter().map(|file| (file.bytes, file.xxh3.as_str())).collect();
        // Both are plain data, which JSON can always name.
        let text = serde_json::to_vec(&(&self.lodpack, contents, &self.options)).unwrap_or_default();
        JobId(xxh3_128(&text))
    }

    /// The job's number.
    pub fn id(&self) -> JobId {
        JobId(u128::from_str_radix(&self.job, 16).unwrap_or_default())
    }

    /// Reads the manifest of a job's directory.
    ///
    /// # Errors
    /// Where there is none, or it does not fit its own number.
    pub fn read(directory: &Path) -> Result<Self, JobError> {
        let path = directory.join(MANIFEST_NAME);
        let text = match fs::read(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Err(JobError::NoJob { path: directory.to_owned() });
            }
            Err(source) => return Err(WorkError::new(&path, "read", source).into()),
        };
        let manifest: Self = serde_json::from_slice(&text)
            .map_err(|error| WorkError::new(&path, "read", io::Error::new(io::ErrorKind::InvalidData, error)))?;
        if manifest.lodpack != env!("CARGO_PKG_VERSION") {
            return Err(JobError::Version { path: directory.to_owned(), version: manifest.lodpack });
        }
        if manifest.id() != manifest.number() {
            let what = "its inputs or options do not fit its number: it was edited or is damaged; plan the job again";
            return Err(WorkError::damaged(&path, what).into());
        }
        Ok(manifest)
    }

    /// Writes it, in one go.
    ///
    /// # Errors
    /// Where that is not possible.
    pub fn write(&self, directory: &Path) -> Result<(), JobError> {
        let path = directory.join(MANIFEST_NAME);
        let temporary = directory.join(format!("{MANIFEST_NAME}.{}.tmp", std::process::id()));
        let text = serde_json::to_string_pretty(self).map_err(io::Error::other);
        let written =
            text.and_then(|text| fs::write(&temporary, text + "\n")).and_then(|()| fs::rename(&temporary, &path));
        written.map_err(|source| {
            let _ = fs::remove_file(&temporary);
            WorkError::new(&path, "written", source).into()
        })
    }

    /// In which way another manifest differs; none where a job of this one can be gone on with.
    pub fn difference(&self, now: &Self) -> Option<String> {
        if self.options != now.options {
            return Some("it was begun with other options".into());
        }
        if self.inputs.len() != now.inputs.len() {
            return Some("it was begun with other inputs".into());
        }
        let mut pairs = self.inputs.iter().zip(&now.inputs);
        let changed = pairs.find(|(then, now)| (then.bytes, &then.xxh3) != (now.bytes, &now.xxh3));
        changed.map(|(then, now)| match then.path == now.path {
            true => format!("{} has changed since it was begun", now.path.display()),
            false => format!("it was begun with {} where {} is now", then.path.display(), now.path.display()),
        })
    }

    /// Inputs that are not any more what they were. One that is not there, as on another machine, has not changed.
    pub fn changed_inputs(&self) -> Vec<&Path> {
        let changed = |file: &&InputFile| match fs::metadata(&file.path) {
            Ok(metadata) if metadata.len() == file.bytes => {
                let has_same_stamp = file.modified.is_some() && stamp(&metadata) == file.modified;
                !has_same_stamp && InputFile::of(file.path.clone()).is_ok_and(|now| now.xxh3 != file.xxh3)
            }
            Ok(_) => true,
            Err(_) => false,
        };
        self.inputs.iter().filter(changed).map(|file| file.path.as_path()).collect()
    }
}

impl InputFile {
    fn of(path: PathBuf) -> Result<Self, JobError> {
        let read = || -> io::Result<(u64, Option<u64>, u64)> {
            let (mut file, mut hash, mut bytes) = (File::open(&path)?, Xxh3::new(), 0);
            // Before it is read: what changes meanwhile has another one.
            let modified = stamp(&file.metadata()?);
            let mut buffer = vec![0; 1 << 20];
            loop {
                let count = file.read(&mut buffer)?;
                if count == 0 {
                    return Ok((bytes, modified, hash.digest()));
                }
                hash.update(&buffer[..count]);
                bytes += count as u64;
            }
        };
        let (bytes, modified, hash) = read().map_err(|source| WorkError::new(&path, "read", source))?;
        Ok(Self { path, bytes, modified, xxh3: format!("{hash:016x}") })
    }
}

fn stamp(metadata: &fs::Metadata) -> Option<u64> {
    let since = metadata.modified().ok()?.duration_since(std::time::UNIX_EPOCH).ok()?;
    u64::try_from(since.as_nanos()).ok()
}
