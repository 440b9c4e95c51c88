//! Reading parts of a section in few requests.

use crate::{
    error::{Error, Result},
    sections::Part,
    source::ReadAt,
};

/// Parts that lie no further apart are read at once: a request costs more than these bytes.
const MAX_GAP: u64 = 16 << 10;
/// A request is not extended beyond this size, so that memory stays bounded.
const MAX_REQUEST: u64 = 16 << 20;

/// A part that is wanted, and what to call it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece<K> {
    pub key: K,
    pub part: Part,
}

/// Reads parts of the section at `base` and checks them; each comes back once, by place in the file. Parts without bytes
/// come back empty.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] at `place` where a checksum does not match or the file ends before.
pub(crate) fn read_pieces<K: Copy + Ord>(
    source: &impl ReadAt,
    base: u64,
    mut pieces: Vec<Piece<K>>,
    place: &dyn Fn(K) -> String,
) -> Result<Vec<(K, Vec<u8>)>> {
    pieces.sort_unstable_by_key(|piece| (piece.part.offset, piece.key));
    pieces.dedup_by_key(|piece| piece.key);
    let mut result = Vec::with_capacity(pieces.len());
    let mut rest = pieces.as_slice();
    while let Some(first) = rest.first() {
        let start = first.part.offset;
        let mut end = start;
        let count = rest
            .iter()
            .take_while(|piece| {
                let piece_end = piece.part.offset.saturating_add(piece.part.length);
                let joins = end == start
                    || piece.part.length == 0
                    || piece.part.offset <= end.saturating_add(MAX_GAP) && piece_end - start <= MAX_REQUEST;
                if joins {
                    end = end.max(if piece.part.length == 0 { 0 } else { piece_end });
                }
                joins
            })
            .count();
        let (group, others) = rest.split_at(count.max(1));
        rest = others;
        // Leading parts without bytes may lie far before the first one with bytes.
        let start = group.iter().find(|piece| piece.part.length > 0).map_or(end, |piece| piece.part.offset);
        let mut bytes = vec![0; (end - start) as usize];
        if !bytes.is_empty() {
            let offset = base.saturating_add(start);
            source.read_at(offset, &mut bytes).map_err(|source| match source.kind() {
                std::io::ErrorKind::UnexpectedEof => Error::format("the file is truncated").at(|| place(first.key)),
                _ => Error::Io { offset, length: end - start, source },
            })?;
        }
        for piece in group {
            let at = piece.part.offset.saturating_sub(start) as usize;
            let part =
                if piece.part.length == 0 { Some(&[][..]) } else { bytes.get(at..at + piece.part.length as usize) };
            let part = part.filter(|part| part.is_empty() || crc32fast::hash(part) == piece.part.checksum);
            let part = part.ok_or_else(|| Error::format("the checksum does not match").at(|| place(piece.key)))?;
            result.push((piece.key, part.to_vec()));
        }
    }
    Ok(result)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Counting;

    #[test]
    fn near_parts_are_read_at_once_and_far_ones_apart() {
        let bytes: Vec<u8> = (0..200_000_u32).map(|i| (i * 7 / 3) as u8).collect();
        let part = |offset: u64, length: u64| {
            let piece = &bytes[offset as usize..(offset + length) as usize];
            Part { offset, length, checksum: crc32fast::hash(piece) }
        };
        let parts = [part(100_000, 50), part(0, 10), part(10, 90), part(300, 5), part(100_020, 1000), part(50_000, 0)];
        let pieces: Vec<_> = (0..).zip(parts).map(|(key, part)| Piece { key, part }).collect();
        let source = Counting::new(bytes.clone());
        let read = read_pieces(&source, 0, pieces.clone(), &|key: u32| key.to_string()).unwrap();
        assert_eq!(source.read_count(), 2);
        assert_eq!(source.byte_count(), 305 + 1020);
        assert_eq!(read.len(), parts.len());
        for (key, found) in read {
            let part = parts[key as usize];
            assert_eq!(found, bytes[part.offset as usize..(part.offset + part.length) as usize]);
        }
        let mut wrong = pieces;
        wrong[2].part.checksum ^= 1;
        assert!(read_pieces(&source, 0, wrong, &|key: u32| key.to_string()).is_err());
    }
}
