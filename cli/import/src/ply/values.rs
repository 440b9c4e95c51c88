//! The numbers of a PLY body, in any encoding.

use super::super::error::{Location, Parsed};
use super::super::scan::{COMMA, Scanner, has_decimal_comma};
use super::super::source::Source;
use super::header::{Element, Kind, Scalar};

/// A cursor over the body. A clone remembers a location to which to return.
pub(super) trait Values: Clone {
    /// Byte offset of the cursor.
    fn offset(&self) -> usize;
    /// The location of a byte offset, for messages.
    fn location(&self, offset: usize) -> Location;
    /// The fewest bytes that a number takes.
    fn least_byte_count(scalar: Scalar) -> u64;
    /// Bytes between the cursor and the end, plus one line end if the last may be missing.
    fn bytes_left(&self) -> u64;
    /// The next number as f64.
    fn float(&mut self, scalar: Scalar) -> Parsed<f64>;
    /// The next number as a whole number.
    fn integer(&mut self, scalar: Scalar) -> Parsed<i64>;
    /// Skips numbers.
    fn skip(&mut self, scalar: Scalar, count: u64) -> Parsed<()>;
    /// Ends an item of an element.
    fn end_item(&mut self) -> Parsed<()>;
    /// Ends the body, and notes what follows it.
    fn finish(&self);
    /// A syntax error at the cursor.
    fn problem(&self, problem: String) -> Box<super::ImportError>;
    /// An error: an element does not fit in the file.
    fn no_room(&self, element: &Element) -> Box<super::ImportError>;

    /// Compares an element's count with the bytes left. From here on, memory for the count is in proportion to the
    /// file.
    fn check_room(&self, element: &Element) -> Parsed<()> {
        let least: u64 = element
            .properties
            .iter()
            .map(|p| match p.kind {
                Kind::Scalar(scalar) | Kind::List { count: scalar, .. } => Self::least_byte_count(scalar),
            })
            .sum();
        match element.count.checked_mul(least) {
            Some(bytes) if bytes <= self.bytes_left() => Ok(()),
            _ => Err(self.no_room(element)),
        }
    }

    /// The number of triangles if all faces are triangles, limited by what the bytes left can hold.
    fn likely_triangle_count(&self, element: &Element) -> usize {
        let bytes: u64 = element
            .properties
            .iter()
            .map(|p| match p.kind {
                Kind::Scalar(scalar) => Self::least_byte_count(scalar),
                Kind::List { count, item } => Self::least_byte_count(count) + 3 * Self::least_byte_count(item),
            })
            .sum();
        element.count.min(self.bytes_left() / bytes.max(1)) as usize
    }

    /// The length of a list, not yet compared with the size of the file.
    #[inline]
    fn list_length(&mut self, scalar: Scalar) -> Parsed<u64> {
        let length = self.integer(scalar)?;
        u64::try_from(length).map_err(|_| self.problem(format!("a list has the length {length}; the file is damaged")))
    }
}

/// Numbers as text. An item ends with its line; it may have fewer line ends than numbers, but never more numbers than
/// announced.
#[derive(Clone)]
pub(super) struct AsciiValues<'a> {
    source: Source<'a>,
    text: Scanner<'a>,
}

impl<'a> AsciiValues<'a> {
    pub(super) fn new(source: Source<'a>, offset: usize) -> Self {
        Self { source, text: Scanner::new(source.bytes, offset) }
    }

    #[cold]
    fn not_a_number(&self, word: &[u8], kind: &str) -> Box<super::ImportError> {
        let location = self.source.line(self.text.at);
        if word.is_empty() {
            return self.source.truncated(location, "the header announces more numbers");
        }
        if has_decimal_comma(word) {
            return self.source.syntax(location, COMMA);
        }
        let word = &word[..word.len().min(40)];
        self.source.syntax(
            location,
            format!("\"{}\" is not a {kind}; the file is damaged or the header is wrong", word.escape_ascii()),
        )
    }
}

impl Values for AsciiValues<'_> {
    fn offset(&self) -> usize {
        self.text.at
    }

    fn location(&self, offset: usize) -> Location {
        self.source.line(offset)
    }

    fn least_byte_count(_scalar: Scalar) -> u64 {
        2
    }

    fn bytes_left(&self) -> u64 {
        (self.text.bytes.len() - self.text.at) as u64 + 1
    }

    #[inline]
    fn float(&mut self, _scalar: Scalar) -> Parsed<f64> {
        self.text.float().map_err(|word| self.not_a_number(word, "number"))
    }

    #[inline]
    fn integer(&mut self, _scalar: Scalar) -> Parsed<i64> {
        self.text.integer().map_err(|word| self.not_a_number(word, "whole number"))
    }

    fn skip(&mut self, _scalar: Scalar, count: u64) -> Parsed<()> {
        for _ in 0..count {
            let word = self.text.word();
            if word.is_empty() {
                return Err(self.not_a_number(word, "number"));
            }
        }
        Ok(())
    }

    #[inline]
    fn end_item(&mut self) -> Parsed<()> {
        if self.text.end_of_line() {
            return Ok(());
        }
        Err(self.problem(
            "this line has more numbers than the header announces; the header or the file is wrong".to_owned(),
        ))
    }

    fn finish(&self) {
        self.source.note_missing_line_end();
        let rest = self.text.bytes[self.text.at..].trim_ascii();
        self.source.note_skipped(rest.len() as u64, "bytes after the last element were ignored");
    }

    fn problem(&self, problem: String) -> Box<super::ImportError> {
        self.source.syntax(self.source.line(self.text.at), problem)
    }

    fn no_room(&self, element: &Element) -> Box<super::ImportError> {
        let missing = format!(
            "the header announces {} times \"{}\", but only {} bytes follow",
            element.count,
            element.name,
            self.bytes_left() - 1
        );
        self.source.truncated(self.source.line(self.text.at), missing)
    }
}

/// Numbers as bytes, big-endian or little-endian.
#[derive(Clone)]
pub(super) struct BinaryValues<'a, const BIG_ENDIAN: bool> {
    source: Source<'a>,
    at: usize,
}

impl<'a, const BIG_ENDIAN: bool> BinaryValues<'a, BIG_ENDIAN> {
    pub(super) fn new(source: Source<'a>, offset: usize) -> Self {
        Self { source, at: offset }
    }

    #[inline(always)]
    fn take<const N: usize>(&mut self) -> Parsed<[u8; N]> {
        let Some(bytes) = self.source.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>()) else {
            return Err(self.too_short(N as u64));
        };
        self.at += N;
        let mut bytes = *bytes;
        if BIG_ENDIAN {
            bytes.reverse();
        }
        Ok(bytes)
    }

    #[cold]
    fn too_short(&self, needed: u64) -> Box<super::ImportError> {
        let missing = format!("{needed} more bytes are announced, {} are there", self.bytes_left());
        self.source.truncated(Location::Byte(self.at as u64), missing)
    }
}

impl<const BIG_ENDIAN: bool> Values for BinaryValues<'_, BIG_ENDIAN> {
    fn offset(&self) -> usize {
        self.at
    }

    fn location(&self, offset: usize) -> Location {
        Location::Byte(offset as u64)
    }

    fn least_byte_count(scalar: Scalar) -> u64 {
        scalar.byte_count()
    }

    fn bytes_left(&self) -> u64 {
        (self.source.bytes.len() - self.at) as u64
    }

    #[inline]
    fn float(&mut self, scalar: Scalar) -> Parsed<f64> {
        Ok(match scalar {
            Scalar::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Scalar::F64 => f64::from_le_bytes(self.take()?),
            Scalar::U64 => u64::from_le_bytes(self.take()?) as f64,
            _ => self.integer(scalar)? as f64,
        })
    }

    #[inline]
    fn integer(&mut self, scalar: Scalar) -> Parsed<i64> {
        Ok(match scalar {
            Scalar::I32 => i64::from(i32::from_le_bytes(self.take()?)),
            Scalar::U32 => i64::from(u32::from_le_bytes(self.take()?)),
            Scalar::U8 => i64::from(u8::from_le_bytes(self.take()?)),
            Scalar::I8 => i64::from(i8::from_le_bytes(self.take()?)),
            Scalar::I16 => i64::from(i16::from_le_bytes(self.take()?)),
            Scalar::U16 => i64::from(u16::from_le_bytes(self.take()?)),
            Scalar::I64 => i64::from_le_bytes(self.take()?),
            Scalar::U64 => {
                let value = u64::from_le_bytes(self.take()?);
                i64::try_from(value).map_err(|_| self.problem(format!("{value} is too large; the file is damaged")))?
            }
            Scalar::F32 | Scalar::F64 => {
                let value = self.float(scalar)?;
                if value.fract() != 0.0 || value.abs() > 9e15 {
                    return Err(self.problem(format!(
                        "{value} is not a whole number; the file is damaged or the header is wrong"
                    )));
                }
                value as i64
            }
        })
    }

    #[inline]
    fn skip(&mut self, scalar: Scalar, count: u64) -> Parsed<()> {
        match count.checked_mul(scalar.byte_count()) {
            Some(bytes) if bytes <= self.bytes_left() => {
                self.at += bytes as usize;
                Ok(())
            }
            _ => Err(self.too_short(count.saturating_mul(scalar.byte_count()))),
        }
    }

    #[inline]
    fn end_item(&mut self) -> Parsed<()> {
        Ok(())
    }

    fn finish(&self) {
        self.source.note_skipped(self.bytes_left(), "bytes after the last element were ignored");
    }

    fn problem(&self, problem: String) -> Box<super::ImportError> {
        self.source.syntax(Location::Byte(self.at as u64), problem)
    }

    fn no_room(&self, element: &Element) -> Box<super::ImportError> {
        let missing = format!(
            "the header announces {} times \"{}\", but only {} bytes follow",
            element.count,
            element.name,
            self.bytes_left()
        );
        self.source.truncated(Location::Byte(self.at as u64), missing)
    }
}
