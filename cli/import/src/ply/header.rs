//! The PLY header.

use super::super::error::{Location, Parsed};
use super::super::scan::Scanner;
use super::super::source::Source;

/// How the body is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A number type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            // Programs that write NumPy's integers as they are.
            "int64" => Scalar::I64,
            "uint64" => Scalar::U64,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    pub(super) fn byte_count(self) -> u64 {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }
}

/// One number, or a list: its length and then its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    /// The count in the header, not yet compared with the size of the body.
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// The header line that declares the element.
    pub(super) line: u64,
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Byte offset of the body.
    pub(super) body: usize,
    /// The images that comments name, as MeshLab writes them, in whatever encoding.
    pub(super) textures: Vec<Vec<u8>>,
}

/// Parses the header. Its lines may end with LF, CR LF or CR, all in the same way as the first.
pub(super) fn parse_header(source: &Source) -> Parsed<Header> {
    let bytes = source.bytes;
    let line_end: &[u8] = match bytes.iter().position(|&b| b == b'\n' || b == b'\r') {
        Some(i) if bytes[i..].starts_with(b"\r\n") => b"\r\n",
        Some(i) if bytes[i] == b'\r' => b"\r",
        _ => b"\n",
    };
    let last = *line_end.last().unwrap_or(&b'\n');
    let (mut encoding, mut elements): (Option<Encoding>, Vec<Element>) = (None, Vec::new());
    let (mut at, mut number, mut textures) = (0, 0u64, vec![]);
    loop {
        number += 1;
        let location = Location::Line(number);
        let Some(length) = bytes[at..].iter().position(|&b| b == last) else {
            return Err(source.truncated(location, "the header has no line \"end_header\""));
        };
        let line = bytes[at..at + length].trim_ascii();
        at += length + 1;
        textures.extend(texture_name(line).map(<[u8]>::to_owned));
        let Ok(line) = std::str::from_utf8(line) else {
            if line.starts_with(b"comment") || line.starts_with(b"obj_info") {
                continue;
            }
            return Err(source.syntax(location, "this header line is not text; the file is damaged or not PLY"));
        };
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] if number == 1 => {}
            ["comment" | "obj_info", ..] | [] => {}
            ["format", name, version] => {
                encoding = Some(match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    _ => {
                        return Err(
                            source.syntax(location, format!("unknown PLY format \"{name}\"; save as ascii or binary"))
                        );
                    }
                });
                if version != "1.0" {
                    return Err(source.unsupported(format!("PLY version {version}"), "save it as PLY version 1.0"));
                }
            }
            ["element", name, count] => {
                let Ok(count) = count.parse() else {
                    return Err(source.syntax(location, format!("the number of elements, \"{count}\", is not a count")));
                };
                if elements.iter().any(|e| e.name == name) {
                    return Err(source.syntax(location, format!("element \"{name}\" is declared twice")));
                }
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new(), line: number });
            }
            ["property", ref kind @ .., name] => {
                let scalar = |name: &str| {
                    let known = "char, uchar, short, ushort, int, uint, float, double or their int8..float64 names";
                    Scalar::parse(name)
                        .ok_or_else(|| source.syntax(location, format!("unknown type \"{name}\"; use {known}")))
                };
                let kind = match *kind {
                    [item] => Kind::Scalar(scalar(item)?),
                    ["list", count, item] => Kind::List { count: scalar(count)?, item: scalar(item)? },
                    _ => return Err(source.syntax(location, format!("cannot understand the property line \"{line}\""))),
                };
                let Some(element) = elements.last_mut() else {
                    return Err(source.syntax(location, format!("property \"{name}\" comes before any element")));
                };
                element.properties.push(Property { name: name.to_owned(), kind });
            }
            ["end_header"] => break,
            _ => return Err(source.syntax(location, format!("cannot understand the header line \"{line}\""))),
        }
    }
    let Some(encoding) = encoding else {
        return Err(source.syntax(Location::Line(number), "the header has no line \"format\""));
    };
    Ok(Header { encoding, elements, body: at, textures })
}

/// The image that a line `comment TextureFile` names; programs write the word with capitals or without.
fn texture_name(line: &[u8]) -> Option<&[u8]> {
    let mut words = Scanner::new(line, 0);
    let is_texture = words.word() == b"comment" && words.word().eq_ignore_ascii_case(b"texturefile");
    is_texture.then(|| line[words.at..].trim_ascii())
}
