//! STL: binary (80-byte header, count, 50 bytes per triangle, little-endian) and ASCII (`facet`, `outer loop`,
//! `vertex`). STL has no shared vertices: it yields three per triangle, and the stage `repair` welds them.

use glam::DVec3;

use super::error::{Location, Parsed};
use super::scan::{COMMA, Scanner, has_decimal_comma};
use super::sink::MeshSink;
use super::source::Source;

/// Where the number of triangles is.
const COUNT_OFFSET: u64 = 80;
pub(super) const HEADER_BYTES: usize = 84;
pub(super) const RECORD_BYTES: usize = 50;
/// Bytes of a corner, and of the normal that precedes the three corners of a triangle.
pub(super) const CORNER_BYTES: usize = 12;

fn announced_count(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(80..HEADER_BYTES)?;
    Some(u64::from(u32::from_le_bytes(count.try_into().ok()?)))
}

/// Whether the count in the header matches the length of the file to the byte. This holds for every sound binary STL,
/// even one that starts with "solid", and for hardly any other file.
pub(super) fn is_exact_binary_stl(bytes: &[u8]) -> bool {
    announced_count(bytes).is_some_and(|n| n > 0 && HEADER_BYTES as u64 + n * RECORD_BYTES as u64 == bytes.len() as u64)
}

/// Whether a text starts like ASCII STL: "solid", and soon a facet or the end.
pub(super) fn is_ascii_stl(text: &[u8]) -> bool {
    let start = text[..text.len().min(1024)].to_ascii_lowercase();
    let has = |word: &[u8]| start.windows(word.len()).any(|w| w == word);
    start.starts_with(b"solid") && (has(b"facet") || has(b"endsolid"))
}

pub(super) fn read_binary_stl(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let bytes = source.bytes;
    let Some(count) = announced_count(bytes) else {
        return Err(source.truncated(
            Location::Byte(0),
            "a binary STL file has at least 84 bytes, an ASCII one starts with \"solid\"",
        ));
    };
    let records = &bytes[HEADER_BYTES..];
    if count > (records.len() / RECORD_BYTES) as u64 {
        let missing =
            format!("the header announces {count} triangles of 50 bytes, but only {} bytes follow", records.len());
        return Err(source.truncated(Location::Byte(HEADER_BYTES as u64), missing));
    }
    if count == 0 && records.len() >= RECORD_BYTES {
        let problem = format!(
            "the header announces no triangles, but the bytes of {} follow; export it again, or write their number there",
            records.len() / RECORD_BYTES
        );
        return Err(source.syntax(Location::Byte(COUNT_OFFSET), problem));
    }
    super::check_size(source.path, 3 * count, count)?;
    let count = count as usize;
    sink.reserve(3 * count, count)?;
    // Magics writes the colour of all behind this word.
    let mut has_colours = bytes[..COUNT_OFFSET as usize].windows(6).any(|word| word == b"COLOR=");
    let mut has_numbers = false;
    for (record, bytes) in records.chunks_exact(RECORD_BYTES).take(count).enumerate() {
        source.passed(HEADER_BYTES + record * RECORD_BYTES);
        let first = 3 * record as u32;
        for corner in 1..4 {
            let position = position(bytes, CORNER_BYTES * corner);
            if !position.is_finite() {
                let location = Location::Byte((HEADER_BYTES + record * RECORD_BYTES + CORNER_BYTES * corner) as u64);
                return Err(source.coordinate(location, sink.vertex_count(), position));
            }
            sink.push_vertex(position)?;
        }
        sink.push_triangle([first, first + 1, first + 2])?;
        // VisCAM sets the highest bit of the last two bytes where the others are a colour.
        let [low, high] = [bytes[RECORD_BYTES - 2], bytes[RECORD_BYTES - 1]];
        has_colours |= high >= 0x80;
        has_numbers |= [low, high] != [0; 2];
    }
    if has_colours {
        sink.leave_out("colours");
    } else if has_numbers {
        sink.leave_out("numbers of triangles");
    }
    let rest = records.len() - count * RECORD_BYTES;
    source.note_skipped(rest as u64, "bytes after the announced triangles were ignored");
    Ok(())
}

/// The corner at an offset; [`DVec3::NAN`] where there are too few bytes.
pub(super) fn position(bytes: &[u8], at: usize) -> DVec3 {
    let Some(bytes) = bytes.get(at..).and_then(|rest| rest.first_chunk::<CORNER_BYTES>()) else { return DVec3::NAN };
    let [x, y, z] = [0, 4, 8].map(|at| bytes[at..].first_chunk().map_or(0.0, |&word| f32::from_le_bytes(word)));
    DVec3::new(x.into(), y.into(), z.into())
}

pub(super) fn read_ascii_stl(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let mut text = Scanner::new(source.bytes, if source.bytes.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 });
    let (mut inside_solid, mut solids) = (false, 0u64);
    loop {
        source.passed(text.at);
        let word = next_word(&mut text, sink);
        if word.eq_ignore_ascii_case(b"solid") && !inside_solid {
            inside_solid = true;
            solids += 1;
            skip_line(&mut text);
        } else if word.eq_ignore_ascii_case(b"endsolid") && inside_solid {
            inside_solid = false;
            skip_line(&mut text);
        } else if word.eq_ignore_ascii_case(b"facet") && inside_solid {
            read_facet(source, &mut text, sink)?;
        } else if word.is_empty() && !inside_solid {
            if solids > 1 {
                sink.leave_out("groups");
            }
            return Ok(());
        } else {
            return Err(unexpected(source, &text, word, if inside_solid { "facet or endsolid" } else { "solid" }));
        }
    }
}

fn skip_line(text: &mut Scanner) {
    while !text.end_of_line() {
        text.word();
    }
}

/// The next word that is no colour: some CAD write `color` with one or more numbers behind facets or in them.
fn next_word<'a>(text: &mut Scanner<'a>, sink: &mut MeshSink) -> &'a [u8] {
    loop {
        let word = text.word();
        if ![&b"color"[..], b"colour"].iter().any(|colour| word.eq_ignore_ascii_case(colour)) {
            return word;
        }
        sink.leave_out("colours");
        let mut ahead = text.clone();
        while ahead.float().is_ok() {
            *text = ahead.clone();
        }
    }
}

fn read_facet(source: &Source, text: &mut Scanner, sink: &mut MeshSink) -> Parsed<()> {
    expect(source, text, &["normal"], sink)?;
    // The normal is often wrong or not a number, and it repeats what the corners say.
    for _ in 0..3 {
        text.word();
    }
    expect(source, text, &["outer", "loop"], sink)?;
    let first = sink.vertex_count();
    super::check_size(source.path, first + 3, sink.triangle_count() + 1)?;
    for _ in 0..3 {
        expect(source, text, &["vertex"], sink)?;
        let mut position = DVec3::ZERO;
        for axis in 0..3 {
            position[axis] = text.float().map_err(|word| unexpected(source, text, word, "a number"))?;
        }
        if !position.is_finite() {
            return Err(source.coordinate(source.line(text.at), sink.vertex_count(), position));
        }
        sink.push_vertex(position)?;
    }
    expect(source, text, &["endloop", "endfacet"], sink)?;
    let first = first as u32;
    sink.push_triangle([first, first + 1, first + 2])
}

fn expect(source: &Source, text: &mut Scanner, words: &[&str], sink: &mut MeshSink) -> Parsed<()> {
    for expected in words {
        let word = next_word(text, sink);
        if !word.eq_ignore_ascii_case(expected.as_bytes()) {
            return Err(unexpected(source, text, word, expected));
        }
    }
    Ok(())
}

#[cold]
fn unexpected(source: &Source, text: &Scanner, word: &[u8], expected: &str) -> Box<super::ImportError> {
    let location = source.line(text.at);
    if word.is_empty() {
        return source.truncated(location, format!("{expected} is missing"));
    }
    if has_decimal_comma(word) {
        return source.syntax(location, COMMA);
    }
    let word = word[..word.len().min(40)].escape_ascii();
    source.syntax(location, format!("found \"{word}\" instead of {expected}; the file is damaged or not ASCII STL"))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{error_of, import_bytes, import_noting};
    use lodpack_mesh::Mesh;

    const CORNERS: [[f32; 3]; 3] = [[0.5, 0.0, 0.25], [1.0, 0.0, 0.0], [0.0, 1.0, -2.0]];

    fn binary(start: &[u8], triangle_count: u32) -> Vec<u8> {
        let mut bytes = vec![0; 80];
        bytes[..start.len()].copy_from_slice(start);
        bytes.extend(triangle_count.to_le_bytes());
        for _ in 0..triangle_count {
            bytes.extend([0; 12]);
            bytes.extend(CORNERS.iter().flatten().flat_map(|c| c.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn ascii() -> String {
        let vertices: String = CORNERS.iter().map(|[x, y, z]| format!("  vertex {x} {y} {z:e}\r\n")).collect();
        let facet = format!("facet normal nan 0 1\r\n outer loop\r\n{vertices} endloop\r\nendfacet\r\n");
        format!("solid a name with facet words\r\n{facet}{facet}endsolid a name\r\nSOLID\n{facet}ENDSOLID\n")
    }

    fn assert_is_expected(mesh: &Mesh, triangle_count: u32) {
        assert_eq!(mesh.triangles, (0..triangle_count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect::<Vec<_>>());
        for (i, p) in mesh.positions.iter().enumerate() {
            assert_eq!(p.to_array(), CORNERS[i % 3].map(f64::from));
        }
    }

    #[test]
    fn binary_is_read_even_if_it_starts_with_solid() {
        for start in [&b""[..], b"solid facet normal", b"# solid"] {
            for name in ["a.stl", "a.obj", "a"] {
                assert_is_expected(&import_bytes(name, &binary(start, 4)).unwrap(), 4);
            }
        }
    }

    #[test]
    fn ascii_is_read_with_several_solids_and_any_case() {
        for name in ["a.stl", "a"] {
            assert_is_expected(&import_bytes(name, ascii().as_bytes()).unwrap(), 3);
        }
    }

    #[test]
    fn binary_files_cut_anywhere_are_errors_and_extra_bytes_are_noted() {
        for start in [&b"made by hand"[..], b"solid"] {
            let mut bytes = binary(start, 3);
            for length in 1..bytes.len() {
                error_of("a.stl", &bytes[..length]);
            }
            bytes.push(7);
            let (mesh, notes) = import_noting("a.stl", &bytes);
            assert_is_expected(&mesh.unwrap(), 3);
            assert!(notes.contains("1 bytes after"));
            bytes[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
            assert!(error_of("a.stl", &bytes).contains("announces 4294967295 triangles"));
        }
    }

    #[test]
    fn ascii_files_cut_anywhere_are_errors_or_the_same_mesh() {
        let text = ascii();
        let whole = import_bytes("a.stl", text.as_bytes()).unwrap();
        for length in 1..text.len() {
            if let Ok(mesh) = import_bytes("a.stl", &text.as_bytes()[..length]) {
                // The rest of the file is sound: it ends after the first or second "endsolid".
                assert_eq!(mesh.triangles[..], whole.triangles[..mesh.triangles.len()]);
                assert!(text[..length].to_lowercase().contains("endsolid"));
            }
        }
    }

    #[test]
    fn wrong_words_and_numbers_name_their_line() {
        let text = ascii();
        assert!(
            error_of("a.stl", text.replacen("vertex 1 ", "vertex one ", 1).as_bytes())
                .contains("line 5: found \"one\"")
        );
        assert!(
            error_of("a.stl", text.replacen("vertex 1 ", "vertex inf ", 1).as_bytes()).contains("line 5: vertex 1 ")
        );
        assert!(error_of("a.stl", text.replacen("endloop", "vertex 1 2 3", 1).as_bytes()).contains("line 7"));
        let mut bytes = binary(b"", 2);
        bytes[84 + 50 + 12 + 4..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(error_of("a.stl", &bytes).contains("byte 146: vertex 3 has the coordinate NaN"));
        assert!(error_of("a.stl", b"solid\nendsolid\n").contains("no triangles"));
    }
}
