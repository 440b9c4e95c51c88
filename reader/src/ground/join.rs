//! Putting a ground under a surface: a file of heights becomes a section of a file of a mesh.

use std::{
    io::{self, Write},
    ops::Range,
};

use crate::{
    error::{Error, Result},
    file::File,
    format::header::{Header, Section, VERSION_WITH_GROUND, kind},
    ground::GroundFrame,
    heights::Heights,
    source::ReadAt,
};

/// Bytes that are copied at once.
const CHUNK: u64 = 1 << 20;

/// Writes the file `surface` again with the file `ground` under it, in place of a ground that it may have. No page is
/// decoded, and no other byte of a section changes. Returns the size of the new file.
///
/// # Errors
/// [`Error::Query`] if the ground lies on a globe; [`Error::Format`] if it is in another coordinate reference system
/// than the surface;
/// [`Error::Io`], [`Error::Write`].
pub fn join_ground<S: ReadAt, G: ReadAt>(surface: &File<S>, ground: &Heights<G>, out: &mut impl Write) -> Result<u64> {
    if ground.surface().is_globe() {
        let what = "heights on a globe cannot be the ground of a mesh; build them with --surface plane";
        return Err(Error::Query { what: what.into() });
    }
    GroundFrame::new(ground.placement(), surface.placement())?;
    let sizes = [surface.source().size(), ground.source().size()];
    let [surface_bytes, ground_bytes] =
        sizes.map(|size| size.map_err(|source| Error::Io { offset: 0, length: 0, source }));
    let old = surface.index().header();
    let section = Section { kind: kind::GROUND, required: false, checksum: None, offset: 0, length: ground_bytes? };
    let mut parts: Vec<Part<'_, S, G>> = Vec::new();
    let mut sections: Vec<Section> = Vec::new();
    let end = surface_bytes?;
    for known in &old.sections {
        if known.kind == kind::PAGES {
            parts.push(Part::Ground(ground, 0..section.length));
            sections.push(section);
        }
        if known.kind != kind::GROUND {
            let range = known.offset..known.offset.saturating_add(known.length);
            if range.end > end {
                return Err(Error::format("the file is truncated").at(|| "end of the file".to_string()));
            }
            parts.push(Part::Surface(surface, range));
            sections.push(*known);
        }
    }
    let head = Header::new(old.version.max(VERSION_WITH_GROUND), old.lattice, sections).write();
    out.write_all(&head).map_err(|source| Error::Write { source })?;
    let mut total = head.len() as u64;
    for part in parts {
        total += match part {
            Part::Surface(file, range) => copy(file.source(), range, out)?,
            Part::Ground(file, range) => copy(file.source(), range, out)?,
        };
    }
    Ok(total)
}

/// A section of the new file, and where its bytes come from.
enum Part<'f, S, G> {
    Surface(&'f File<S>, Range<u64>),
    Ground(&'f Heights<G>, Range<u64>),
}

/// Copies a range, and returns its length.
fn copy(source: &impl ReadAt, range: Range<u64>, out: &mut impl Write) -> Result<u64> {
    let mut at = range.start;
    while at < range.end {
        let length = CHUNK.min(range.end - at);
        let mut bytes = vec![0; length as usize];
        let read = |source: io::Error| Error::Io { offset: at, length, source };
        source.read_at(at, &mut bytes).map_err(read)?;
        out.write_all(&bytes).map_err(|source| Error::Write { source })?;
        at += length;
    }
    Ok(range.end - range.start)
}
