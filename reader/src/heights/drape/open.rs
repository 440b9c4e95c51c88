//! The image over the heights of an open file: directories that have been read, images used last, and texels.

use std::{
    collections::HashMap,
    ops::Range,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{
    section::{Directory, Drape, GroupId, Head, ImageId},
    window::{DrapeImage, DrapeWindow},
};
use crate::{
    codec::{
        bytes::has_checksum,
        texels::{Image, SCALES},
    },
    error::{Error, Result},
    format::{header::Section, sections::Part},
    limits::Limits,
    source::{Fetched, requests::plan},
};

/// Bytes of images that are kept decoded.
const KEPT_BYTES: usize = 64 << 20;

/// An image over heights, as far as it is known.
#[derive(Debug)]
pub struct OpenDrape {
    drape: Drape,
    top: Part,
    section: Section,
    limits: Limits,
    known: Mutex<Known>,
    kept: Mutex<Kept>,
}

/// Directories that have been read.
#[derive(Debug, Default)]
struct Known {
    directories: HashMap<GroupId, Arc<Directory>>,
    bytes: u64,
}

/// When an image was used last, and the image.
type Used = (u64, Arc<Image<u8>>);

/// Images at scales, those used last.
#[derive(Debug, Default)]
struct Kept {
    images: HashMap<(ImageId, usize), Used>,
    uses: u64,
    bytes: usize,
}

/// No answer depends on what another thread did while it panicked: maps only grow by whole entries.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Bytes that have been read.
pub(in super::super) type Read<'a> = [&'a Fetched; 2];

fn bytes_of<'a>(read: Read<'a>, range: &Range<u64>) -> Option<&'a [u8]> {
    read.iter().find_map(|fetched| fetched.get(range.clone()))
}

impl OpenDrape {
    /// Reads the head of the section.
    pub fn parse(bytes: &[u8], section: Section, limits: &Limits) -> Result<Self> {
        let Head { drape, top } = Head::parse(bytes, limits)?;
        let (known, kept) = (Mutex::default(), Mutex::default());
        Ok(Self { drape, top, section, limits: *limits, known, kept })
    }

    /// What the file says about it.
    pub fn drape(&self) -> &Drape {
        &self.drape
    }

    /// Bytes of its section.
    pub fn bytes(&self) -> u64 {
        self.section.length
    }

    #[cfg(test)]
    pub fn section_range(&self) -> Range<u64> {
        self.section.offset..self.section.offset + self.section.length
    }

    /// A part as a range of the file.
    fn range(&self, part: &Part) -> Result<Range<u64>> {
        let end = part.offset.checked_add(part.length).filter(|&end| end <= self.section.length);
        let end = end.ok_or_else(|| Error::format("a part is not within its section"))?;
        Ok(self.section.offset + part.offset..self.section.offset + end)
    }

    /// The directory of a group; none if it has no images. [`Error::Missing`] with that on the way to it which has not
    /// been read.
    fn directory(&self, group: GroupId, read: Read<'_>) -> Result<Option<Arc<Directory>>> {
        let top = self.drape.top();
        let mut path = vec![group];
        while let Some(&group) = path.last().filter(|group| group.level < top.level) {
            path.push(group.above().group());
        }
        let mut part = self.top;
        let mut directory = None;
        while let Some(group) = path.pop() {
            if part.length == 0 {
                return Ok(None);
            }
            let found = self.known_or_read(group, &part, read)?;
            if let Some(next) = path.last() {
                let number = self.drape.tiles_of(group).position(|id| id == next.above());
                part = number.and_then(|number| found.below.get(number)).copied().unwrap_or_default();
            }
            directory = Some(found);
        }
        Ok(directory)
    }

    fn known_or_read(&self, group: GroupId, part: &Part, read: Read<'_>) -> Result<Arc<Directory>> {
        if let Some(known) = lock(&self.known).directories.get(&group) {
            return Ok(Arc::clone(known));
        }
        let location = || format!("directory of images below {}", group.above().name());
        let range = self.range(part).map_err(|error| error.at(location))?;
        let Some(bytes) = bytes_of(read, &range) else { return Err(Error::Missing { ranges: vec![range] }) };
        let parse = || {
            if !has_checksum(bytes, part.checksum) {
                return Err(Error::format("the checksum does not match"));
            }
            let directory = Directory::parse(bytes, self.drape.tiles_of(group).count(), group.level > 0, &self.limits)?;
            if self.drape.components == 3 && directory.images.iter().any(|parts| parts[0].length == 0) {
                return Err(Error::format("an image without opacity has a gap"));
            }
            Ok(directory)
        };
        let directory = Arc::new(parse().map_err(|error| error.at(location))?);
        let mut known = lock(&self.known);
        if known.directories.insert(group, Arc::clone(&directory)).is_none() {
            known.bytes += part.length;
        }
        // Otherwise a small file could have as many tiles as its image has room for.
        match known.bytes <= self.section.length {
            true => Ok(directory),
            false => Err(Error::format("directories of images overlap").at(|| "section drape".to_string())),
        }
    }

    /// The streams of a tile, the coarsest first; none if it shows nothing.
    fn parts(&self, id: ImageId, read: Read<'_>) -> Result<Option<[Part; SCALES]>> {
        let Some(directory) = self.directory(id.group(), read)? else { return Ok(None) };
        let number = self.drape.tiles_of(id.group()).position(|other| other == id);
        let parts = number.and_then(|number| directory.images.get(number)).copied();
        Ok(parts.filter(|parts| parts[0].length > 0))
    }

    /// A tile at a scale, from 0 (an eighth) to 3; none if it shows nothing.
    fn tile(&self, id: ImageId, scale: usize, read: Read<'_>) -> Result<Option<Arc<Image<u8>>>> {
        if let Some(image) = lock(&self.kept).get(id, scale) {
            return Ok(Some(image));
        }
        let Some(parts) = self.parts(id, read)? else { return Ok(None) };
        let location = || format!("image {}", id.name());
        let (mut streams, mut missing) = (Vec::with_capacity(SCALES), vec![]);
        for part in parts.iter().take(scale + 1) {
            let range = self.range(part).map_err(|error| error.at(location))?;
            match bytes_of(read, &range) {
                Some(bytes) if bytes.is_empty() || has_checksum(bytes, part.checksum) => streams.push(bytes),
                Some(_) => return Err(Error::format("the checksum does not match").at(location)),
                None => missing.push(range),
            }
        }
        if !missing.is_empty() {
            return Err(Error::Missing { ranges: missing });
        }
        let image = Image::decode_scaled(&streams, self.drape.tile_size(id), self.drape.components);
        let image = Arc::new(image.map_err(|error| error.at(location))?);
        lock(&self.kept).keep(id, scale, &image);
        Ok(Some(image))
    }

    /// What a window takes of the image.
    fn covered(&self, window: &DrapeWindow) -> Result<Covered> {
        let drape = &self.drape;
        let size = drape.size_at(window.halvings);
        let texels = u64::from(window.size[0]) * u64::from(window.size[1]);
        if window.size.contains(&0) || window.halvings > drape.most_halvings() || texels > self.limits.texel_count {
            let [width, height] = window.size;
            let what = format!("an image of {width} x {height} texels is asked for: ask for a smaller or coarser one");
            return Err(Error::Query { what });
        }
        let ends = [0, 1].map(|axis| {
            let [first, last] = [window.first[axis], window.first[axis].saturating_add(window.size[axis].into())];
            [first.clamp(0, size[axis] as i64) as u64, last.clamp(0, size[axis] as i64) as u64]
        });
        let level = (window.halvings / 3).min(drape.level_count() - 1);
        let scale = usize::from(3 - (window.halvings - 3 * level));
        Ok(Covered { ends, level, scale, side: drape.side() >> (3 - scale) })
    }

    /// The streams that a window takes, and where they are. [`Error::Missing`] with directories that have not been
    /// read.
    pub fn streams(&self, window: &DrapeWindow, read: Read<'_>) -> Result<Vec<(ImageId, u8, Range<u64>)>> {
        let Covered { ends, level, scale, side } = self.covered(window)?;
        let (mut streams, mut missing) = (vec![], vec![]);
        for id in tiles_in(ends, level, side) {
            match self.parts(id, read) {
                Ok(parts) => {
                    for (scale, part) in (0..).zip(parts.iter().flatten().take(scale + 1)) {
                        if part.length > 0 {
                            streams.push((id, scale, self.range(part)?));
                        }
                    }
                }
                Err(Error::Missing { ranges }) => missing.extend(ranges),
                Err(error) => return Err(error),
            }
        }
        if missing.is_empty() { Ok(streams) } else { Err(Error::Missing { ranges: plan(missing) }) }
    }

    /// Where a stream is, and its checksum, if its directory is known.
    pub fn stream(&self, id: ImageId, scale: u8) -> Option<(Range<u64>, u32)> {
        let directory = lock(&self.known).directories.get(&id.group()).cloned()?;
        let number = self.drape.tiles_of(id.group()).position(|other| other == id)?;
        let part = directory.images.get(number)?.get(usize::from(scale))?;
        Some((self.range(part).ok()?, part.checksum))
    }

    /// The texels of a window, from what has been read; [`Error::Missing`] if more is needed.
    pub fn image(&self, window: &DrapeWindow, read: Read<'_>) -> Result<DrapeImage> {
        let drape = &self.drape;
        let Covered { ends, level, scale, side } = self.covered(window)?;
        let is_whole = [0, 1].iter().all(|&axis| ends[axis][1] - ends[axis][0] == u64::from(window.size[axis]));
        let components = if is_whole { drape.components } else { 4 };
        let (mut tiles, mut missing) = (vec![], vec![]);
        for id in tiles_in(ends, level, side) {
            match self.tile(id, scale, read) {
                Ok(tile) => tiles.extend(tile.map(|tile| (id, tile))),
                Err(Error::Missing { ranges }) => missing.extend(ranges),
                Err(error) => return Err(error),
            }
        }
        if !missing.is_empty() {
            return Err(Error::Missing { ranges: plan(missing) });
        }
        let [width, height] = window.size.map(|size| size as usize);
        let mut data = vec![0; width * height * usize::from(components)];
        for (id, tile) in &tiles {
            let first = [id.column * side, id.row * side];
            let of = |axis: usize| {
                let [from, to] = [first[axis], first[axis] + u64::from(tile.size[axis])];
                from.max(ends[axis][0])..to.min(ends[axis][1])
            };
            for y in of(1) {
                for x in of(0) {
                    let texel = tile.texel((x - first[0]) as u32, (y - first[1]) as u32);
                    let [to_x, to_y] = [x as i64 - window.first[0], y as i64 - window.first[1]].map(|at| at as usize);
                    let to = &mut data[(to_y * width + to_x) * usize::from(components)..][..components.into()];
                    to.iter_mut().zip(texel.iter().chain([&255])).for_each(|(to, from)| *to = *from);
                }
            }
        }
        Ok(drape.place(window, Image { size: window.size, components, data }))
    }

    /// Reads and decodes everything, and checks that the parts fill the section. `head` came with opening, and `fetch`
    /// reads ranges of the file.
    pub fn verify(&self, head: &Fetched, mut fetch: impl FnMut(&[Range<u64>]) -> Result<Fetched>) -> Result<()> {
        let mut groups = std::collections::VecDeque::from([self.drape.top()]);
        let mut next = self.range(&self.top)?.end - self.section.offset;
        let (mut runs, mut is_first) = (vec![], true);
        while let Some(group) = groups.pop_front() {
            let mut fetched = Fetched::default();
            let directory = loop {
                match self.directory(group, [head, &fetched]) {
                    Err(Error::Missing { ranges }) => fetched = fetch(&ranges)?,
                    directory => break directory?,
                }
            };
            let Some(directory) = directory else {
                if std::mem::take(&mut is_first) {
                    continue;
                }
                return Err(Error::format("a directory of images is missing"));
            };
            is_first = false;
            let gap = || Error::format("there is a gap between parts of the image over the heights, or they overlap");
            for part in directory.below.iter().filter(|part| part.length > 0) {
                if part.offset != next {
                    return Err(gap().at(|| format!("directories below {}", group.above().name())));
                }
                next += part.length;
            }
            let mut run: Option<Range<u64>> = None;
            for part in (0..SCALES).flat_map(|scale| directory.images.iter().map(move |parts| parts[scale])) {
                if part.length > 0 {
                    run = Some(run.map_or(part.offset, |run| run.start)..part.offset + part.length);
                }
            }
            runs.extend(run.map(|run| (group, run)));
            for (number, id) in self.drape.tiles_of(group).enumerate() {
                let Some(parts) = directory.images.get(number).filter(|parts| parts[0].length > 0) else { continue };
                let ranges = parts.iter().map(|part| self.range(part)).collect::<Result<Vec<_>>>()?;
                let fetched = fetch(&plan(ranges))?;
                self.tile(id, SCALES - 1, [head, &fetched])?;
                groups.extend(id.below());
            }
        }
        for (group, run) in runs {
            if run.start != next {
                let what = "there is a gap between the images of the heights, or they overlap";
                return Err(Error::format(what).at(|| format!("images below {}", group.above().name())));
            }
            next = run.end;
        }
        match next == self.section.length {
            true => Ok(()),
            false => Err(Error::format("there are bytes behind the last image").at(|| "section drape".to_string())),
        }
    }
}

/// What a window takes of the image.
struct Covered {
    /// Of each axis the first texel of the image in the window, and the one behind the last.
    ends: [[u64; 2]; 2],
    level: u8,
    /// Of the tiles at this level.
    scale: usize,
    /// Texels along a side of a tile at this scale.
    side: u64,
}

/// The tiles of a level that texels lie in, row by row.
fn tiles_in(ends: [[u64; 2]; 2], level: u8, side: u64) -> impl Iterator<Item = ImageId> {
    let range = move |[from, to]: [u64; 2]| if from < to { from / side..to.div_ceil(side) } else { 0..0 };
    range(ends[1]).flat_map(move |row| range(ends[0]).map(move |column| ImageId { level, column, row }))
}

impl Kept {
    fn get(&mut self, id: ImageId, scale: usize) -> Option<Arc<Image<u8>>> {
        self.uses += 1;
        let (used, image) = self.images.get_mut(&(id, scale))?;
        *used = self.uses;
        Some(Arc::clone(image))
    }

    fn keep(&mut self, id: ImageId, scale: usize, image: &Arc<Image<u8>>) {
        self.uses += 1;
        self.bytes += image.data.len();
        if let Some((_, before)) = self.images.insert((id, scale), (self.uses, Arc::clone(image))) {
            self.bytes -= before.data.len();
        }
        if self.bytes > KEPT_BYTES && self.images.len() > 1 {
            // Half of the images have not been used for longer than the others.
            let mut uses: Vec<u64> = self.images.values().map(|&(used, _)| used).collect();
            let middle = uses.len() / 2;
            let limit = *uses.select_nth_unstable(middle).1;
            self.images.retain(|_, (used, _)| *used >= limit);
            self.bytes = self.images.values().map(|(_, image)| image.data.len()).sum();
        }
    }
}
