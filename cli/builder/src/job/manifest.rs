//! `job.json`: the inputs, options and parts of a job, for people to read and for programs to compare.

use std::fs::{self, File};
use std::io::{self, Read};
use std::iter;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

use super::{BuildOptions, JobError, Stages, content};
use crate::geometry_images::atlas_files;
use crate::pipeline::ModelOptions;
use lodpack_import::{files_beside, files_of_drape};
use lodpack_mesh::appearance::Channels;
use lodpack_runtime::storage::{JobId, MANIFEST_NAME, WorkError};

/// A job's inputs, options and parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The version of lodpack that planned the job; another version may build other bytes.
    pub lodpack: String,
    /// The job's number, 32 hexadecimal digits: a hash of the fields that follow, up to the options.
    pub job: String,
    /// The files that were read, in order.
    pub inputs: Vec<InputFile>,
    /// What the inputs are read together with: headers of rasters, their drape, and, where colours are kept, libraries
    /// of materials and images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<InputFile>,
    /// What the ground that the mesh stands on was made of. The job's directory has the ground itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ground: Vec<InputFile>,
    /// The options that the bytes of the file depend on.
    pub options: ModelOptions,
    /// Whether the job makes a file of heights: its regions are units of the grid.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub heights: bool,
    /// The parts, once the job is planned.
    pub parts: Vec<PartEntry>,
    /// XXH3 hash over the hashes of all ranges of the inputs, 16 hexadecimal digits, once a job is planned in stages.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub content: Option<String>,
    /// How the job is divided into tasks, where its planning is divided, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stages: Option<Stages>,
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
    /// The time stamp of its last change in nanoseconds since 1970, where the file system has one. A file with the same
    /// stamp need not be read again; the stamp has no other meaning.
    pub modified: Option<u64>,
    /// XXH3 hash, 16 hexadecimal digits: of its content; of samples of an input whose job is planned in stages.
    pub xxh3: String,
}

/// A part of a job: a run of regions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartEntry {
    /// Number of its first region.
    pub first_region: u32,
    /// The number of its regions; a part may have none.
    pub regions: u32,
    /// Their triangles.
    pub triangles: u64,
    /// Bytes of memory that building it takes.
    pub memory: u64,
}

impl Manifest {
    /// Reads all inputs to make the manifest of a new job.
    ///
    /// # Errors
    /// If an input cannot be read.
    pub fn of(options: &BuildOptions) -> Result<Self, JobError> {
        Self::read_by(options, InputFile::of)
    }

    /// Reads samples of all inputs to make the manifest of a new job whose tasks read the rest.
    pub(super) fn sampled(options: &BuildOptions) -> Result<Self, JobError> {
        Self::read_by(options, InputFile::sampled)
    }

    fn read_by(options: &BuildOptions, read: fn(PathBuf) -> Result<InputFile, WorkError>) -> Result<Self, JobError> {
        let mut inputs = vec![];
        for input in &options.inputs {
            match input.is_dir() {
                true => {
                    let files = atlas_files(input).map_err(|source| WorkError::new(input, "read", source))?;
                    files.into_iter().try_for_each(|path| read(path).map(|file| inputs.push(file)))?;
                }
                false => inputs.push(read(input.clone())?),
            }
        }
        let files = options.inputs.iter().filter(|input| !input.is_dir());
        let beside = files.flat_map(|input| files_beside(input, &options.model.channels));
        let raster = &options.model.raster;
        let beside = beside.chain(raster.drape.iter().flat_map(|drape| files_of_drape(drape)));
        let geoid =
            raster.geoid.iter().flat_map(|path| iter::once(path.clone()).chain(files_beside(path, &Channels::None)));
        let beside = beside.chain(geoid);
        // The import names those that are missing.
        let beside = beside.filter(|path| path.is_file()).map(InputFile::of);
        let beside = beside.collect::<Result<_, _>>()?;
        let ground =
            options.ground.iter().flat_map(|path| iter::once(path.clone()).chain(files_beside(path, &Channels::None)));
        let ground = ground.filter(|path| path.is_file()).map(InputFile::of).collect::<Result<_, _>>()?;
        let lodpack = env!("CARGO_PKG_VERSION").to_owned();
        let mut manifest = Self {
            lodpack,
            job: String::new(),
            inputs,
            beside,
            ground,
            options: options.model.clone(),
            heights: options.heights,
            parts: vec![],
            content: None,
            stages: None,
            output: PathBuf::new(),
        };
        manifest.job = manifest.number().to_string();
        Ok(manifest)
    }

    /// The inputs, what they name, and what the ground was made of.
    fn files(&self) -> impl Iterator<Item = &InputFile> {
        self.inputs.iter().chain(&self.beside).chain(&self.ground)
    }

    /// The job's number. It depends on the contents of the inputs, not on their paths.
    fn number(&self) -> JobId {
        let contents: Vec<(u64, &str)> = self.files().map(|file| (file.bytes, file.xxh3.as_str())).collect();
        // Plain data always has a JSON form.
        let mut text = serde_json::to_vec(&(&self.lodpack, contents, &self.options)).unwrap_or_default();
        if self.heights {
            text.extend(b"heights");
        }
        if !self.ground.is_empty() {
            text.extend(format!("ground {}", self.ground.len()).bytes());
        }
        JobId(xxh3_128(&text))
    }

    /// Whether a part has nothing to build, and its file nothing that a merge needs: the first one of heights has what
    /// all have in common.
    pub(super) fn is_empty_part(&self, part: u32) -> bool {
        !(self.heights && part == 0) && self.parts.get(part as usize).is_some_and(|entry| entry.regions == 0)
    }

    /// The job's number.
    pub fn id(&self) -> JobId {
        JobId(u128::from_str_radix(&self.job, 16).unwrap_or_default())
    }

    /// The number of the job's parts: they belong together only if all of the inputs was the same.
    pub fn part_id(&self) -> JobId {
        match &self.content {
            None => self.id(),
            Some(content) => JobId(xxh3_128(format!("{} {content}", self.job).as_bytes())),
        }
    }

    /// Reads the manifest of a job's directory.
    ///
    /// # Errors
    /// If there is none, another version wrote it, or it does not match its own number.
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
            let what = "its inputs or options do not match its number: it was edited or is damaged; plan the job again";
            return Err(WorkError::damaged(&path, what).into());
        }
        Ok(manifest)
    }

    /// Writes it under another name, then gives it its own.
    ///
    /// # Errors
    /// If the directory cannot be written.
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

    /// How another manifest differs; none if it can resume a job of this one.
    pub fn difference(&self, now: &Self) -> Option<String> {
        if self.options != now.options || self.heights != now.heights {
            return Some("it was begun with other options".into());
        }
        let counts = |manifest: &Self| [&manifest.inputs, &manifest.beside, &manifest.ground].map(Vec::len);
        if counts(self) != counts(now) {
            return Some("it was begun with other inputs".into());
        }
        let mut pairs = self.files().zip(now.files());
        let changed = pairs.find(|(then, now)| (then.bytes, &then.xxh3) != (now.bytes, &now.xxh3));
        changed.map(|(then, now)| match then.path == now.path {
            true => format!("{} has changed since it was begun", now.path.display()),
            false => format!("it was begun with {} in place of {}", then.path.display(), now.path.display()),
        })
    }

    /// The inputs whose contents have changed since the job in a directory was begun. An input that is not there, as on
    /// another machine, counts as unchanged.
    pub fn changed_inputs(&self, job: &Path) -> Vec<&Path> {
        let changed = |&(number, file): &(usize, &InputFile)| match fs::metadata(&file.path) {
            Ok(metadata) if metadata.len() == file.bytes => {
                let has_same_stamp = file.modified.is_some() && stamp(&metadata) == file.modified;
                !has_same_stamp && self.differs(job, number, &file.path)
            }
            Ok(_) => true,
            Err(_) => false,
        };
        self.files().enumerate().filter(changed).map(|(_, file)| file.path.as_path()).collect()
    }

    /// The first input of `now`, a manifest without [`Self::difference`], whose content is not what the job in a
    /// directory has read.
    pub(super) fn changed_since<'n>(&self, job: &Path, now: &'n Self) -> Option<&'n Path> {
        let pairs = self.files().zip(now.files()).enumerate();
        let mut changed = pairs.filter(|(number, (then, now))| {
            let has_same_stamp = now.path == then.path && now.modified.is_some() && now.modified == then.modified;
            !has_same_stamp && self.differs(job, *number, &now.path)
        });
        changed.next().map(|(_, (_, now))| now.path.as_path())
    }

    /// Whether a file has another content than one of [`Self::files`] had, as far as that is known.
    fn differs(&self, job: &Path, number: usize, path: &Path) -> bool {
        match self.files().nth(number) {
            Some(_) if number < self.inputs.len() => content::differs(self, job, number, path),
            Some(file) => InputFile::of(path.to_owned()).is_ok_and(|now| now.xxh3 != file.xxh3),
            None => false,
        }
    }

    /// Size and time stamp of all files; none where one has no stamp, or is not there.
    pub(super) fn stamps(&self) -> Option<Vec<(u64, u64)>> {
        let of_file = |file: &InputFile| {
            let metadata = fs::metadata(&file.path).ok()?;
            Some((metadata.len(), stamp(&metadata)?))
        };
        self.files().map(of_file).collect()
    }
}

impl InputFile {
    pub(super) fn of(path: PathBuf) -> Result<Self, WorkError> {
        Self::read_by(path, |file, _| {
            let (mut hash, mut bytes) = (Xxh3::new(), 0);
            let mut buffer = vec![0; 1 << 20];
            loop {
                let count = file.read(&mut buffer)?;
                if count == 0 {
                    return Ok((bytes, hash.digest()));
                }
                hash.update(&buffer[..count]);
                bytes += count as u64;
            }
        })
    }

    /// A file of which only samples are read.
    pub(super) fn sampled(path: PathBuf) -> Result<Self, WorkError> {
        Self::read_by(path, |file, bytes| Ok((bytes, content::sample(file, bytes)?)))
    }

    /// `read` returns the size and a hash.
    fn read_by(path: PathBuf, read: impl Fn(&mut File, u64) -> io::Result<(u64, u64)>) -> Result<Self, WorkError> {
        let read = || -> io::Result<(u64, Option<u64>, u64)> {
            let mut file = File::open(&path)?;
            // The stamp is taken before the file is read, so that a file that changes meanwhile gets another one.
            let metadata = file.metadata()?;
            let (bytes, hash) = read(&mut file, metadata.len())?;
            Ok((bytes, stamp(&metadata), hash))
        };
        let (bytes, modified, hash) = read().map_err(|source| WorkError::new(&path, "read", source))?;
        Ok(Self { path, bytes, modified, xxh3: format!("{hash:016x}") })
    }
}

fn stamp(metadata: &fs::Metadata) -> Option<u64> {
    let since = metadata.modified().ok()?.duration_since(std::time::UNIX_EPOCH).ok()?;
    u64::try_from(since.as_nanos()).ok()
}
