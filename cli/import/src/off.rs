//! OFF (Geomview's text format, <http://www.geomview.org/docs/html/OFF.html>): a line with the word OFF, a line with
//! the numbers of vertices, faces and edges, then a line for each vertex and each face.
//!
//! Letters before the word announce what vertices carry beside their position (`COFF`, `NOFF`, `STCNOFF`, in any
//! order), and faces may end in a colour. Colours of vertices are read where channels are wanted; the rest is stepped
//! over. Writers disagree on how many numbers a colour has, so a vertex is the first three numbers of its line,
//! whatever follows.

use glam::DVec3;

use super::colour_numbers::{ColourNumbers, ColourRange};
use super::error::{ImportError, Location, Parsed};
use super::polygon::Triangulator;
use super::scan::{COMMA, Scanner, has_decimal_comma, parse_float};
use super::sink::MeshSink;
use super::source::Source;
use lodpack_mesh::appearance::COLOUR;
use lodpack_mesh::attributes::AttributeLayout;
use lodpack_mesh::srgb::linear_from_srgb;

/// Fewest bytes of a vertex ("0 0 0" and a line end) and of a face with a surface ("3 0 1 2" and a line end).
const VERTEX_BYTES: u64 = 6;
const FACE_BYTES: u64 = 8;

/// Whether the first word of a text, after comments, is OFF's.
pub(super) fn looks_like_off(text: &[u8]) -> bool {
    Lines::new(text).next().is_some_and(|(_, mut words)| Keyword::parse(words.word()).is_some())
}

pub(super) fn read_off(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let mut lines = Lines::new(source.bytes);
    let Header { letters, counts: [vertex_count, face_count] } = read_header(source, &mut lines)?;
    let has_colour = letters.contains('C') && sink.attributes.finds(COLOUR, "vertex colours");
    leave_out_announced(source, &letters, has_colour, sink)?;
    let colours =
        if has_colour { ColourColumns::find(&letters, &lines, vertex_count) } else { ColourColumns::default() };
    let mut layout = AttributeLayout::default();
    if has_colour {
        layout.add_colour();
        sink.set_vertex_layout(layout);
    }
    super::check_size(source.path, vertex_count, 0)?;
    check_room(source, &lines, [vertex_count, face_count])?;
    sink.reserve(vertex_count as usize, face_count as usize)?;
    let mut has_more = false;
    for vertex in 0..vertex_count {
        source.passed(lines.at);
        let (location, mut words) =
            lines.next().ok_or_else(|| missing(source, &lines, "vertices", vertex, vertex_count))?;
        let mut position = DVec3::ZERO;
        for axis in 0..3 {
            position[axis] = words
                .float()
                .map_err(|word| not_a_number(source, location, word, "a vertex needs three numbers on its line"))?;
        }
        if !position.is_finite() {
            return Err(source.coordinate(location, vertex, position));
        }
        if has_colour {
            sink.attributes.push_vertex(&colours.read(words.clone()));
        }
        has_more |= !words.word().is_empty();
        sink.push_vertex(position)?;
    }
    if has_more && letters.is_empty() {
        sink.leave_out("further numbers of vertices");
    }
    read_faces(source, &mut lines, [vertex_count, face_count], sink)?;
    source.note_missing_line_end();
    Ok(())
}

/// Which of the numbers behind a position are its colour.
#[derive(Clone, Copy, Debug, Default)]
struct ColourColumns {
    /// Numbers of normals before them and behind them, and of texture coordinates behind all.
    before: usize,
    behind: usize,
    range: ColourRange,
}

/// The most numbers behind a position: a normal, a colour and texture coordinates.
const MOST_NUMBERS: usize = 9;

impl ColourColumns {
    /// The columns that the letters before the word OFF announce. `lines` are those of the vertices.
    fn find(letters: &str, lines: &Lines, vertex_count: u64) -> Self {
        let width = |announced: &str, width: usize| if letters.contains(announced) { width } else { 0 };
        let (normal, texture) = (width("N", 3), width("ST", 2));
        let normals_first = Self { before: normal, behind: texture, ..Self::default() };
        let colours_first = Self { before: 0, behind: normal + texture, ..Self::default() };
        // Geomview's order is that of CNOFF. MeshLab writes NCOFF, and colours before normals.
        let is_reversed = letters.find('N') < letters.find('C');
        let (likely, other) = if is_reversed { (colours_first, normals_first) } else { (normals_first, colours_first) };
        let (mut numbers, mut of_others) = (ColourNumbers::default(), ColourNumbers::default());
        let mut has_negative = [false; 2];
        let mut lines = lines.clone();
        for (_, mut words) in (0..vertex_count).map_while(|_| lines.next()) {
            for _ in 0..3 {
                let _ = words.float();
            }
            let columns = [(likely, &mut numbers), (other, &mut of_others)];
            // Without normals both are the same.
            let ways = if normal > 0 { 2 } else { 1 };
            for ((columns, numbers), has_negative) in columns.into_iter().zip(&mut has_negative).take(ways) {
                let colour = columns.of_line(words.clone());
                *has_negative |= colour.iter().any(|value| *value < 0.0);
                numbers.add(&colour);
            }
        }
        // Colours are never below 0, and normals are in half of all directions.
        let is_other = normal > 0 && has_negative == [true, false];
        let (columns, numbers) = if is_other { (other, of_others) } else { (likely, numbers) };
        Self { range: numbers.range(), ..columns }
    }

    /// The numbers of the colour, given what follows a position; none if there are too few.
    fn of_line(&self, mut words: Scanner) -> Vec<f64> {
        let mut all: Vec<f64> = vec![];
        while all.len() < MOST_NUMBERS {
            let word = words.word();
            if word.is_empty() {
                break;
            }
            all.push(parse_float(word).unwrap_or(0.0));
        }
        all.truncate(all.len().saturating_sub(self.behind));
        let colour = all.split_off(self.before.min(all.len()));
        if colour.len() < 3 { vec![] } else { colour }
    }

    /// The colour among what follows a position. White if there is none.
    fn read(&self, words: Scanner) -> [f32; 4] {
        let ColourRange { colour: full, alpha } = self.range;
        let (mut colour, of_line) = ([1.0; 4], self.of_line(words));
        for ((value, written), full) in colour.iter_mut().zip(&of_line).zip([full, full, full, alpha]) {
            *value = (written / full).clamp(0.0, 1.0) as f32;
        }
        if !of_line.is_empty() {
            colour[..3].iter_mut().for_each(|value| *value = linear_from_srgb(*value));
        }
        colour
    }
}

fn read_faces(
    source: &Source,
    lines: &mut Lines,
    [vertex_count, face_count]: [u64; 2],
    sink: &mut MeshSink,
) -> Parsed<()> {
    let mut faces = Triangulator::default();
    let mut polygon = Vec::new();
    let mut has_colours = false;
    for face in 0..face_count {
        source.passed(lines.at);
        let (location, mut words) = lines.next().ok_or_else(|| missing(source, lines, "faces", face, face_count))?;
        let rule = "a face needs the number of its corners and then their vertices, on one line";
        let corner_count = words.integer().map_err(|word| not_a_number(source, location, word, rule))?;
        polygon.clear();
        for _ in 0..corner_count {
            // As many as there are words on the line, whatever the number says.
            let index = words.integer().map_err(|word| not_a_number(source, location, word, rule))?;
            match u64::try_from(index) {
                Ok(vertex) if vertex < vertex_count => polygon.push(vertex as u32),
                _ => {
                    let path = source.path.to_owned();
                    return Err(
                        ImportError::Index { path, location, face, index, vertex_count, first_vertex: 0 }.into()
                    );
                }
            }
        }
        has_colours |= !words.word().is_empty();
        sink.push_polygon(&polygon, &mut faces)?;
    }
    if has_colours {
        sink.leave_out("colours");
    }
    faces.note(source);
    let rest = std::iter::from_fn(|| lines.next()).count();
    source.note_skipped(rest as u64, "lines after the last face were ignored");
    Ok(())
}

/// The word OFF.
struct Keyword {
    /// Letters before it, as "CN".
    letters: String,
    /// Digits that follow it without a space between: some writers forget the line end.
    digits: usize,
}

impl Keyword {
    fn parse(word: &[u8]) -> Option<Self> {
        let word = std::str::from_utf8(word).ok()?;
        let (letters, digits) = word.split_once("OFF")?;
        // Each at most once; programs write them in any order.
        let mut rest = letters.to_owned();
        for letter in ["ST", "C", "N", "4", "n"] {
            rest = rest.replacen(letter, "", 1);
        }
        let is_keyword = rest.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit());
        is_keyword.then(|| Self { letters: letters.to_owned(), digits: digits.len() })
    }
}

/// What stands before the vertices.
struct Header {
    letters: String,
    /// Of vertices and faces.
    counts: [u64; 2],
}

/// Reads the word OFF, which may be missing, and the counts on the same line or the next.
fn read_header(source: &Source, lines: &mut Lines) -> Parsed<Header> {
    let Some((mut location, mut words)) = lines.next() else {
        return Err(source.truncated(Location::Byte(0), "the word OFF is missing, and everything after it"));
    };
    let begin = words.clone();
    let word = words.word();
    let letters = match Keyword::parse(word) {
        Some(Keyword { letters, digits }) => {
            words.at -= digits;
            letters
        }
        None if word.first().is_some_and(u8::is_ascii_digit) => {
            words = begin;
            String::new()
        }
        None => return Err(source.wrong_magic("an OFF file must start with the word OFF or with its counts")),
    };
    match words.clone().word() {
        [] => {
            let missing = || source.truncated(location, "the numbers of vertices and faces are missing");
            (location, words) = lines.next().ok_or_else(missing)?;
        }
        b"BINARY" => return Err(source.unsupported("binary OFF", "convert it to text OFF, PLY or GLB")),
        _ => {}
    }
    let mut counts = [0; 2];
    for count in &mut counts {
        let number = words.integer().ok().and_then(|number| u64::try_from(number).ok());
        let rule = "the numbers of vertices and faces must stand here, as 8 6 12; the file is damaged or not OFF";
        *count = number.ok_or_else(|| source.syntax(location, rule))?;
    }
    Ok(Header { letters, counts })
}

/// Notes what the letters before the word OFF announce, and refuses what cannot be read.
fn leave_out_announced(source: &Source, letters: &str, has_colour: bool, sink: &mut MeshSink) -> Parsed<()> {
    if letters.contains(['4', 'n']) {
        let feature = format!("vertices of other than three coordinates ({letters}OFF)");
        return Err(source.unsupported(feature, "export positions as x, y, z"));
    }
    for (announced, what) in [("ST", "texture coordinates"), ("C", "colours"), ("N", "normals")] {
        if letters.contains(announced) && !(announced == "C" && has_colour) {
            sink.leave_out(what);
        }
    }
    Ok(())
}

/// Refuses counts that the bytes left cannot hold, before anything is allocated for them.
fn check_room(source: &Source, lines: &Lines, [vertices, faces]: [u64; 2]) -> Parsed<()> {
    // The last line may lack its end.
    let bytes = source.bytes.len().saturating_sub(lines.at) as u64;
    let fits = |count: u64, size: u64| count.checked_mul(size).is_some_and(|least| least <= bytes + 1);
    if fits(vertices, VERTEX_BYTES) && fits(faces, FACE_BYTES) {
        return Ok(());
    }
    let missing = format!("{vertices} vertices and {faces} faces are announced, but only {bytes} bytes follow");
    Err(source.truncated(Location::Line(lines.number), missing))
}

#[cold]
fn missing(source: &Source, lines: &Lines, what: &str, found: u64, announced: u64) -> Box<ImportError> {
    source.truncated(Location::Line(lines.number), format!("{announced} {what} are announced, {found} are there"))
}

#[cold]
fn not_a_number(source: &Source, location: Location, word: &[u8], rule: &str) -> Box<ImportError> {
    let found = match word {
        [] => "the line ends too early".to_owned(),
        word => format!("\"{}\" stands there", word[..word.len().min(40)].escape_ascii()),
    };
    if has_decimal_comma(word) {
        return source.syntax(location, COMMA);
    }
    source.syntax(location, format!("{rule}, but {found}; the file is damaged or not OFF"))
}

/// The lines of a text that hold more than blanks and comments.
#[derive(Clone)]
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Of the line before `at`, counted from 1.
    number: u64,
}

impl<'a> Lines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: if bytes.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 }, number: 0 }
    }

    fn next(&mut self) -> Option<(Location, Scanner<'a>)> {
        while let Some(rest) = self.bytes.get(self.at..).filter(|rest| !rest.is_empty()) {
            let length = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
            self.at += length + if rest[length..].starts_with(b"\r\n") { 2 } else { 1 };
            self.number += 1;
            let line = rest[..length].split(|&b| b == b'#').next().unwrap_or_default().trim_ascii();
            if !line.is_empty() {
                return Some((Location::Line(self.number), Scanner::new(line, 0)));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{error_of, import_bytes, import_noting};
    use super::*;

    const SQUARE: &str = "OFF\n4 2 5\n0 0 0\n1 0 0.5\n1 1e0 -0\n0 1 0\n3 0 1 2\n3 0 2 3\n";

    #[test]
    fn all_ways_to_write_a_square_give_the_same_mesh() {
        let expected = import_bytes("a.off", SQUARE.as_bytes()).unwrap();
        assert_eq!(expected.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(expected.positions[1], DVec3::new(1.0, 0.0, 0.5));
        for text in [
            SQUARE.replace('\n', "\r\n"),
            SQUARE.replace('\n', "\r"),
            SQUARE.replace("OFF\n4 2 5", "OFF 4 2 5"),
            // As in ModelNet, whose writer has forgotten a line end.
            SQUARE.replace("OFF\n4 2 5", "OFF4 2 5"),
            SQUARE.replace("4 2 5", "4 2"),
            SQUARE.replace("4 2 5", "# a comment\n\n  4 2 0 # and another\n#\n"),
            format!("\u{feff}# first\n{SQUARE}"),
            SQUARE.replace("3 0 1 2\n3 0 2 3", "3  0\t1 2  255 0 0\n3 0 2 3 0.5 0.5 0.5 1"),
            SQUARE.trim_end().to_owned(),
        ] {
            for name in ["a.off", "a", "a.txt"] {
                assert!(import_bytes(name, text.as_bytes()).unwrap() == expected, "{text}");
            }
        }
        // Without its word only the name tells.
        let bare = SQUARE.replace("OFF\n", "");
        assert!(import_bytes("a.off", bare.as_bytes()).unwrap() == expected);
        assert!(error_of("a", bare.as_bytes()).contains("starts with"));
    }

    #[test]
    fn what_vertices_carry_beside_their_position_is_left_out_and_noted() {
        let expected = import_bytes("a.off", SQUARE.as_bytes()).unwrap();
        for (keyword, more, left_out) in [
            ("COFF", "255 0 0 255", "colours"),
            ("COFF", "0.5 0.5 0.5", "colours"),
            ("NOFF", "0 0 1", "normals"),
            ("STCNOFF", "0 0 1 1 0 0 1 0.5 0.5", "colours, normals, texture coordinates"),
            ("OFF", "7", "further numbers of vertices"),
        ] {
            let text = SQUARE.replace("OFF", keyword).replace("0 0 0\n", &format!("0 0 0 {more}\n"));
            let text = text.replace("0 1 0\n", &format!("0 1 0 {more}\n"));
            let (mesh, notes) = import_noting("a.off", text.as_bytes());
            assert!(mesh.unwrap() == expected, "{keyword}");
            assert!(notes.starts_with(&format!("{left_out} of the input are left out")), "{keyword}: {notes}");
        }
        let (_, notes) = import_noting("a.off", SQUARE.replace("3 0 2 3", "3 0 2 3 255 0 0").as_bytes());
        assert!(notes.starts_with("colours of the input"), "{notes}");
    }

    #[test]
    fn polygons_are_triangulated_and_thin_faces_noted() {
        let text = "OFF\n5 4 0\n0 0 0\n4 0 0\n1 1 0\n0 4 0\n9 9 9\n4 0 1 2 3\n2 0 1\n0\n4 1 1 2 2\n";
        let (mesh, notes) = import_noting("a.off", text.as_bytes());
        let mesh = mesh.unwrap();
        let area = |t: u32| {
            let [a, b, c] = mesh.corners(t);
            (b - a).cross(c - a).z / 2.0
        };
        // A dart, which a fan would not cover.
        assert_eq!((mesh.triangles.len(), area(0) + area(1)), (2, 4.0));
        assert!(area(0) > 0.0 && area(1) > 0.0);
        assert!(notes.contains("3 faces with fewer than three"), "{notes}");
    }

    #[test]
    fn counts_allocate_nothing_and_must_fit_the_file() {
        for counts in ["1000000000000000 2 0", "4 1000000000000000 0", "4294967295 2 0", "900000000000000000 1 1"] {
            let error = error_of("a.off", SQUARE.replace("4 2 5", counts).as_bytes());
            assert!(error.contains("ends too early") || error.contains("takes at most"), "{error}");
        }
        for (counts, expected) in [
            ("5 2 5", "line 8: the file ends too early: 2 faces are announced, 1 are there"),
            ("4 3 5", "line 8: the file ends too early: 3 faces are announced, 2 are there"),
            ("4 0 0", "no triangles: the file has 4 vertices"),
            ("-4 2 5", "line 2: the numbers of vertices and faces"),
            ("4", "line 2: the numbers of vertices and faces"),
            ("4 2.5 1", "line 2: the numbers of vertices and faces"),
            ("99999999999999999999 2", "line 2: the numbers of vertices and faces"),
        ] {
            let error = error_of("a.off", SQUARE.replace("4 2 5", counts).as_bytes());
            assert!(error.contains(expected), "{counts}: {error}");
        }
        let (mesh, notes) = import_noting("a.off", SQUARE.replace("4 2 5", "4 1 5").as_bytes());
        assert!(mesh.unwrap().triangles.len() == 1 && notes.contains("1 lines after the last face"), "{notes}");
    }

    #[test]
    fn bad_values_name_their_line() {
        for (from, to, expected) in [
            ("3 0 1 2", "3 0 1 4", "a.off: line 7: face 0 uses vertex 4, but the file has 4 vertices numbered from 0"),
            ("3 0 2 3", "3 0 -1 3", "line 8: face 1 uses vertex -1"),
            ("3 0 2 3", "3 0 2", "line 8: a face needs the number of its corners"),
            ("3 0 2 3", "9000000000000000 0 2 3", "the line ends too early"),
            ("3 0 2 3", "3 0 1.5 3", "line 8: a face needs"),
            ("3 0 2 3", "x 0 2 3", "\"x\" stands there"),
            ("1 0 0.5", "1 nan 0.5", "line 4: vertex 1 has the coordinate NaN"),
            ("1 0 0.5", "1 0 1e999", "line 4: vertex 1 has the coordinate inf"),
            ("1 0 0.5", "1 0", "line 4: a vertex needs three numbers on its line"),
            ("1 0 0.5", "1 0 x", "line 4: a vertex needs three numbers on its line, but \"x\""),
            ("OFF", "4OFF", "vertices of other than three coordinates (4OFF)"),
            ("OFF", "nOFF", "vertices of other than three coordinates (nOFF)"),
            ("OFF\n4 2 5", "OFF BINARY\n4 2 5", "uses binary OFF, which is not supported"),
            ("OFF\n4", "OFX\n4", "must start with the word OFF"),
        ] {
            let error = error_of("a.off", SQUARE.replacen(from, to, 1).as_bytes());
            assert!(error.contains(expected), "{from} -> {to}: {error}");
        }
    }

    #[test]
    fn files_cut_anywhere_are_errors_or_whole_and_flipped_bytes_never_panic() {
        let whole = import_bytes("a.off", SQUARE.as_bytes()).unwrap();
        for length in 1..SQUARE.len() {
            if let Ok(mesh) = import_bytes("a.off", &SQUARE.as_bytes()[..length]) {
                assert!(mesh == whole && length + 1 == SQUARE.len(), "{length}");
            }
        }
        for at in 0..SQUARE.len() {
            for value in [0, 0xFF, SQUARE.as_bytes()[at] ^ 1, SQUARE.as_bytes()[at] ^ 0x10, b'9', b'-', b'\n', b'#'] {
                let mut damaged = SQUARE.as_bytes().to_vec();
                damaged[at] = value;
                let _ = import_bytes("a.off", &damaged);
            }
        }
    }

    #[test]
    fn far_coordinates_keep_their_millimetres() {
        let text = SQUARE.replace("1 0 0.5", "5000000.001 0 0.5");
        assert_eq!(import_bytes("a.off", text.as_bytes()).unwrap().positions[1].x, 5000000.001);
    }
}
