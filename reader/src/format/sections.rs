//! The small section SOURCE, and what several sections use: parts and runs of bytes.

use crate::{
    codec::bytes::{Cursor, put_varint},
    error::{Error, Result},
    format::records::SourceInfo,
    limits::{Limits, within},
};

/// Section SOURCE: two u64 (triangles, vertices), two f64 (mean edge length, area), then the generator in UTF-8.
pub(crate) fn write_source(info: &SourceInfo) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend(info.triangle_count.to_le_bytes());
    bytes.extend(info.vertex_count.to_le_bytes());
    bytes.extend(info.mean_edge_length.to_le_bytes());
    bytes.extend(info.area.to_le_bytes());
    bytes.extend(info.generator.as_bytes());
    bytes
}

/// Reads what [`write_source`] wrote.
pub(crate) fn parse_source(bytes: &[u8]) -> Result<SourceInfo> {
    let mut cursor = Cursor::new(bytes);
    let (triangle_count, vertex_count) = (cursor.u64()?, cursor.u64()?);
    let (mean_edge_length, area) = (cursor.f64()?, cursor.f64()?);
    let generator = String::from_utf8(cursor.bytes(cursor.left())?.to_vec())
        .map_err(|_| Error::format("the generator's name is not UTF-8"))?;
    Ok(SourceInfo { triangle_count, vertex_count, mean_edge_length, area, generator })
}

/// A part (an index block, a cluster list or a page): its place within its section, and its CRC-32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Part {
    pub offset: u64,
    pub length: u64,
    pub checksum: u32,
}

impl Part {
    /// Writes the length and, unless that is 0, the checksum.
    pub(crate) fn write(&self, bytes: &mut Vec<u8>) {
        put_varint(bytes, self.length);
        if self.length > 0 {
            bytes.extend(self.checksum.to_le_bytes());
        }
    }

    /// Reads what [`Part::write`] wrote. The part lies at `next`, which moves to its end.
    pub(crate) fn parse(cursor: &mut Cursor<'_>, next: &mut u64, limits: &Limits) -> Result<Self> {
        let Extent { offset, length } = Extent::parse(cursor, next, limits)?;
        Ok(Self { offset, length, checksum: if length > 0 { cursor.u32()? } else { 0 } })
    }
}

impl Extent {
    /// Reads the length (varint) of an extent at `next`, which moves to its end.
    pub(crate) fn parse(cursor: &mut Cursor<'_>, next: &mut u64, limits: &Limits) -> Result<Self> {
        let (offset, length) = (*next, cursor.varint()?);
        within(limits.part_bytes, length, "size of an index block, a cluster list or pages")?;
        *next = offset.checked_add(length).ok_or_else(|| Error::format("a part ends beyond 2^64"))?;
        Ok(Self { offset, length })
    }
}

/// A run of bytes within a section.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Extent {
    pub offset: u64,
    pub length: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_source_survives() {
        let source = SourceInfo { triangle_count: 7, area: 2.5, generator: "é".into(), ..SourceInfo::default() };
        let bytes = write_source(&source);
        assert_eq!(parse_source(&bytes).unwrap(), source);
        assert!((0..32).all(|end| parse_source(&bytes[..end]).is_err()));
    }
}
