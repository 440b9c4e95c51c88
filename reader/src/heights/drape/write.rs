//! Writing section DRAPE (feature `write`): images of groups arrive in any order, and lie in that of the file.

use std::{
    collections::{HashMap, VecDeque},
    io::{self, Read, Seek, SeekFrom, Write},
};

use super::section::{Directory, Drape, GroupId, HEAD_BYTES, Head};
use crate::{
    codec::texels::{ImageStreams, SCALES},
    error::{Error, Result},
    format::sections::Part,
};

/// The image over the heights of a file that is written. Its streams wait in `scratch`.
#[derive(Debug)]
pub struct DrapeWriter<S> {
    drape: Drape,
    scratch: S,
    length: u64,
    groups: HashMap<GroupId, Group>,
}

/// A group whose streams wait.
#[derive(Debug)]
struct Group {
    images: Vec<[Part; SCALES]>,
    /// Where they begin in the scratch file.
    offset: u64,
    length: u64,
}

/// What is to be written of a group.
struct Placed {
    id: GroupId,
    directory: Directory,
    bytes: Vec<u8>,
    /// The numbers of the groups below, in the order of tiles.
    below: Vec<Option<usize>>,
}

impl<S: Read + Write + Seek> DrapeWriter<S> {
    /// An image without texels yet.
    ///
    /// # Errors
    /// [`Error::Model`] if a file cannot have it.
    pub fn new(drape: Drape, scratch: S) -> Result<Self> {
        match drape.fault() {
            Some(fault) => Err(Error::model(fault)),
            None => Ok(Self { drape, scratch, length: 0, groups: HashMap::new() }),
        }
    }

    /// What is written.
    pub fn drape(&self) -> &Drape {
        &self.drape
    }

    /// How many groups a level has, in columns and rows.
    pub fn groups(&self, level: u8) -> [u64; 2] {
        self.drape.tiles(level).map(|count| count.div_ceil(8))
    }

    /// The first texel and the size of each tile of a group, at its level, in the order in which [`Self::put`] takes
    /// them.
    pub fn tiles(&self, level: u8, [column, row]: [u64; 2]) -> Vec<([u64; 2], [u32; 2])> {
        let tiles = self.drape.tiles_of(GroupId { level, column, row });
        let side = self.drape.side();
        tiles.map(|id| ([id.column * side, id.row * side], self.drape.tile_size(id))).collect()
    }

    /// Takes the images of a group, one for each tile; a tile that shows nothing has streams without bytes.
    ///
    /// # Errors
    /// [`Error::Model`] if it is another number of tiles, [`Error::Write`].
    pub fn put(&mut self, level: u8, [column, row]: [u64; 2], images: &[ImageStreams]) -> Result<()> {
        let id = GroupId { level, column, row };
        if images.len() != self.drape.tiles_of(id).count() {
            return Err(Error::model("a group of images does not have as many as there are tiles in it"));
        }
        if images.iter().all(|streams| streams[0].is_empty()) {
            return Ok(());
        }
        let mut group = Group { images: vec![[Part::default(); SCALES]; images.len()], offset: self.length, length: 0 };
        let write = |source| Error::Write { source };
        self.scratch.seek(SeekFrom::Start(self.length)).map_err(write)?;
        for scale in 0..SCALES {
            for (streams, parts) in images.iter().zip(&mut group.images) {
                let bytes = &streams[scale];
                let checksum = if bytes.is_empty() { 0 } else { crc32fast::hash(bytes) };
                parts[scale] = Part { offset: 0, length: bytes.len() as u64, checksum };
                self.scratch.write_all(bytes).map_err(write)?;
                group.length += bytes.len() as u64;
            }
        }
        self.length += group.length;
        self.groups.insert(id, group);
        Ok(())
    }

    /// Head and directories, and the groups whose streams follow, in their order.
    fn directories(&self) -> Result<(Vec<u8>, Vec<GroupId>)> {
        let mut placed: Vec<Placed> = vec![];
        let mut waiting = VecDeque::new();
        if self.groups.contains_key(&self.drape.top()) {
            waiting.push_back(self.drape.top());
        }
        while let Some(id) = waiting.pop_front() {
            let group = self.groups.get(&id).ok_or_else(|| Error::model("images below an image are missing"))?;
            let has_image = |number: usize| group.images.get(number).is_some_and(|parts| parts[0].length > 0);
            let below: Vec<Option<usize>> = (self.drape.tiles_of(id).enumerate())
                .map(|(number, tile)| {
                    let below = tile.below().filter(|_| has_image(number))?;
                    waiting.push_back(below);
                    Some(placed.len() + waiting.len())
                })
                .collect();
            let directory = Directory {
                images: group.images.clone(),
                below: vec![Part::default(); if id.level > 0 { below.len() } else { 0 }],
            };
            placed.push(Placed { id, directory, bytes: vec![], below });
        }
        if placed.len() != self.groups.len() {
            return Err(Error::model("images lie below one that shows nothing"));
        }
        // Lengths of directories first, from the last one on: each says how long those below it are.
        for number in (0..placed.len()).rev() {
            for k in 0..placed[number].below.len() {
                if let Some(below) = placed[number].below[k] {
                    placed[number].directory.below[k].length = placed[below].bytes.len() as u64;
                }
            }
            placed[number].bytes = placed[number].directory.write(0, 0);
        }
        let (mut offsets, mut next) = (vec![], HEAD_BYTES as u64);
        for one in &placed {
            offsets.push(next);
            next += one.bytes.len() as u64;
        }
        let mut streams = vec![];
        for one in &placed {
            streams.push(next);
            next += self.groups.get(&one.id).map_or(0, |group| group.length);
        }
        let mut top = Part { offset: HEAD_BYTES as u64, length: 0, checksum: 0 };
        for number in (0..placed.len()).rev() {
            let mut first_below = 0;
            for k in 0..placed[number].below.len() {
                let Some(below) = placed[number].below[k] else { continue };
                let checksum = crc32fast::hash(&placed[below].bytes);
                placed[number].directory.below[k].checksum = checksum;
                first_below = if first_below == 0 { offsets[below] } else { first_below };
            }
            placed[number].bytes = placed[number].directory.write(streams[number], first_below);
            top = Part {
                length: placed[number].bytes.len() as u64,
                checksum: crc32fast::hash(&placed[number].bytes),
                ..top
            };
        }
        let mut bytes = Head { drape: self.drape, top }.write();
        placed.iter().for_each(|one| bytes.extend(&one.bytes));
        Ok((bytes, placed.into_iter().map(|one| one.id).collect()))
    }

    /// Length of the section, and what writes it.
    pub(in super::super) fn finish(mut self) -> Result<(u64, impl FnOnce(&mut dyn Write) -> io::Result<()>)> {
        let (head, order) = self.directories()?;
        let length = head.len() as u64 + self.length;
        let write = move |out: &mut dyn Write| {
            out.write_all(&head)?;
            for id in order {
                let Some(group) = self.groups.get(&id) else { continue };
                self.scratch.seek(SeekFrom::Start(group.offset))?;
                if io::copy(&mut (&mut self.scratch).take(group.length), out)? != group.length {
                    return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "images are missing"));
                }
            }
            Ok(())
        };
        Ok((length, write))
    }
}
