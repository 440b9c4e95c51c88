//! Wavefront OBJ: vertices and faces in one pass with constant memory, positions in f64.
//!
//! Only `v` and `f` statements are geometry. Colours, texture coordinates and materials are read where channels are
//! wanted ([`attributes`]); these take memory. Objects and groups name faces ([`objects`]). Normals, lines and points
//! are skipped, whatever they contain. Faces may name vertices that come later. A triangle does not need their
//! positions, but a polygon does, so a file with such polygons is read a second time.

mod attributes;
mod image_name;
mod libraries;
mod mtl;
mod objects;
mod opacity;
mod ranges;
mod tiles;

use std::ops::Range;

use glam::DVec3;

use self::attributes::ObjAttributes;
pub(super) use self::libraries::files_beside;
pub(super) use self::objects::ObjObjects;
use self::objects::Place;
pub(super) use self::ranges::{count_in_range, read_range};
use crate::MAX_VERTICES;
use crate::colour_numbers::ColourNumbers;
use crate::error::{ImportError, Location, Parsed};
use crate::lines::{first_line_from, is_continued};
use crate::polygon::Triangulator;
use crate::scan::{COMMA, Scanner, has_decimal_comma, parse_float};
use crate::sink::MeshSink;
use crate::source::Source;
use lodpack_mesh::NONE;

/// What is wrong with a face whose corners are no numbers.
const BAD_FACE: &str = "a face needs vertex numbers like 7, 7/2, 7//3 or 7/2/3; the file is damaged or not OBJ";

/// Words that can start the first statement of an OBJ file.
const FIRST_WORDS: [&[u8]; 9] = [b"v", b"vt", b"vn", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl"];

/// Whether the first statement of a text, after comments, is an OBJ statement.
pub(super) fn looks_like_obj(text: &[u8]) -> bool {
    let first = text
        .split(|&b| b == b'\n' || b == b'\r')
        .map(<[u8]>::trim_ascii)
        .find(|l| !l.is_empty() && !l.starts_with(b"#"));
    first.is_some_and(|line| FIRST_WORDS.contains(&Scanner::new(line, 0).word()))
}

pub(super) fn read_obj(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let mut statements = Statements::new(*source);
    let mut faces = Triangulator::default();
    let (mut weight_count, mut free_form_count, mut thin_count) = (0, 0, 0);
    let (mut vertex_count, mut needed) = (0, 0);
    let (mut has_normals, mut has_texture, mut has_materials, mut has_groups) = (false, false, false, false);
    let mut has_colours = false;
    let (mut polygon, mut beside) = (Vec::new(), Vec::new());
    let mut attributes = ObjAttributes::new(sink);
    let mut material = vec![];
    let mut objects = ObjObjects::new();
    let mut early = None;
    loop {
        let start = statements.at;
        let Some((location, mut words)) = statements.next() else { break };
        match words.word() {
            b"v" => {
                vertex_count += 1;
                let position = read_vertex(source, location, vertex_count, &mut words)?;
                let rest = numbers_left(&mut words);
                // One number is a weight, three are a colour; neither is geometry.
                weight_count += u64::from(rest.len() == 1 && rest[0] != 1.0);
                attributes.push_colour(&rest, || colours_from(source, start), source, sink);
                has_colours |= rest.len() >= 3;
                sink.push_vertex(position)?;
            }
            b"f" => match read_face(&mut words, attributes.counts(vertex_count), &mut polygon, &mut beside) {
                Ok(needs) => {
                    needed = needs.max(needed);
                    if polygon.len() == 3 || needs <= vertex_count {
                        attributes.push_face(&polygon, &beside, sink, &mut faces)?;
                    } else if early.is_none() {
                        let counts = attributes.counts(vertex_count);
                        early = Some(Early { start, counts, material: material.clone(), place: objects.place() });
                    }
                }
                Err(FaceProblem::Thin) => thin_count += 1,
                Err(FaceProblem::Index) => return Err(find_bad_index(source)),
                Err(FaceProblem::Words) => return Err(source.syntax(location, BAD_FACE)),
            },
            b"surf" | b"curv" => free_form_count += 1,
            b"vn" => {
                has_normals = true;
                attributes.push_normal(&mut words, sink);
            }
            b"vt" => {
                has_texture = true;
                attributes.push_uv(&mut words, sink);
            }
            b"usemtl" => {
                has_materials = true;
                material = words.bytes[words.at..].to_vec();
                attributes.find_material(&material, statements.at, source, sink)?;
                attributes.use_material(&material, sink);
            }
            b"mtllib" => {
                let names = words.bytes[words.at..].to_vec();
                attributes.read_libraries(&names, source, sink)?;
            }
            word @ (b"g" | b"o") => {
                has_groups = true;
                begin_object(word, &words, &mut objects, sink);
            }
            _ => {}
        }
    }
    let dropped = [
        (has_normals && !attributes.reads_normals(), "normals"),
        (has_texture && !attributes.has_textures(), "texture coordinates"),
        (has_materials && !attributes.reads_colours(), "materials"),
        (has_colours && !attributes.reads_colours(), "colours"),
        (has_groups && !sink.wants_objects(), "groups"),
    ];
    dropped.into_iter().filter(|(is_there, _)| *is_there).for_each(|(_, what)| sink.leave_out(what));
    if needed > vertex_count {
        return Err(find_bad_index(source));
    }
    if let Some(early) = early {
        push_early_polygons(source, early, &mut attributes, &mut objects, sink, &mut faces)?;
    }
    attributes.note(source);
    source.note_missing_line_end();
    faces.count_thin(thin_count);
    faces.note(source);
    source.note_skipped(weight_count, ranges::WEIGHTS);
    source.note_skipped(free_form_count, ranges::FREE_FORMS);
    Ok(())
}

/// Begins the object or the group that a statement names.
fn begin_object(word: &[u8], words: &Scanner, objects: &mut ObjObjects, sink: &mut MeshSink) {
    if sink.wants_objects() {
        let node = objects.begin(word == b"o", &words.bytes[words.at..], |node| sink.add_node(node));
        sink.set_object(node);
    }
}

/// Where the first polygon is that precedes one of its vertices.
struct Early {
    start: usize,
    /// Vertices, texture coordinates and normals before it.
    counts: [u64; 3],
    /// The name of its material.
    material: Vec<u8>,
    /// Its object and group.
    place: Place,
}

/// Reads the file again, from a location on, for polygons that precede one of their vertices. By now, the sink has all
/// vertices.
fn push_early_polygons(
    source: &Source,
    early: Early,
    attributes: &mut ObjAttributes,
    objects: &mut ObjObjects,
    sink: &mut MeshSink,
    faces: &mut Triangulator,
) -> Parsed<()> {
    let all = sink.vertex_count();
    let mut statements = Statements { at: early.start, ..Statements::new(*source) };
    let mut counts = early.counts;
    attributes.use_material(&early.material, sink);
    let node = objects.go_back(early.place);
    sink.set_object(node);
    let (mut polygon, mut beside) = (Vec::new(), Vec::new());
    while let Some((_, mut words)) = statements.next() {
        match words.word() {
            b"v" => counts[0] += 1,
            b"vt" => counts[1] += 1,
            b"vn" => counts[2] += 1,
            b"usemtl" => attributes.use_material(&words.bytes[words.at..], sink),
            word @ (b"g" | b"o") => begin_object(word, &words, objects, sink),
            b"f" => match read_face(&mut words, counts, &mut polygon, &mut beside) {
                Ok(needs) if polygon.len() == 3 || needs <= counts[0] => {}
                Ok(needs) if needs <= all => attributes.push_face(&polygon, &beside, sink, faces)?,
                Err(FaceProblem::Thin) => {}
                // The file has changed since it was read.
                _ => return Err(find_bad_index(source)),
            },
            _ => {}
        }
    }
    Ok(())
}

/// The position of a vertex, counted from 1.
fn read_vertex(source: &Source, location: Location, number: u64, words: &mut Scanner) -> Parsed<DVec3> {
    let mut position = DVec3::ZERO;
    for axis in 0..3 {
        position[axis] = words.float().map_err(|word| match has_decimal_comma(word) {
            true => source.syntax(location, COMMA),
            false => source.syntax(location, "a vertex needs three numbers; the file is damaged or not OBJ"),
        })?;
    }
    if !position.is_finite() {
        return Err(source.coordinate(location, number, position));
    }
    Ok(position)
}

/// The numbers that follow x, y, z. A word that is no number is NaN.
fn numbers_left(words: &mut Scanner) -> ArrayVec {
    let mut rest = ArrayVec::default();
    for word in words_left(words).take(MAX_REST) {
        rest.values[rest.count] = parse_float(word).unwrap_or(f64::NAN);
        rest.count += 1;
    }
    rest
}

/// What the colours of vertices have in common, from an offset on.
fn colours_from(source: &Source, start: usize) -> ColourNumbers {
    let (mut numbers, mut statements) = (ColourNumbers::default(), Statements::new(*source));
    statements.at = start;
    // Most colours are shares, which the first of them tells.
    while let Some((_, mut words)) = statements.next().filter(|_| !numbers.are_shares()) {
        if words.word() == b"v" {
            for _ in 0..3 {
                let _ = words.float();
            }
            let rest = numbers_left(&mut words);
            numbers.add(if rest.len() >= 3 { &rest } else { &[] });
        }
    }
    numbers
}

/// A colour with alpha has four numbers.
const MAX_REST: usize = 4;

/// A few numbers.
#[derive(Default)]
struct ArrayVec {
    values: [f64; MAX_REST],
    count: usize,
}

impl std::ops::Deref for ArrayVec {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.values[..self.count]
    }
}

/// Why a face is invalid.
enum FaceProblem {
    /// It has fewer than three corners.
    Thin,
    /// Some corner is not a number.
    Words,
    /// Some corner cannot be a vertex.
    Index,
}

/// Reads the corners of a face into `polygon`, counted from 0, and the numbers of their texture coordinates and normals
/// into `beside`, [`NONE`] where there are none. Negative numbers count back from the latest of `counts`. Returns the
/// number of vertices that must exist.
fn read_face(
    words: &mut Scanner,
    counts: [u64; 3],
    polygon: &mut Vec<u32>,
    beside: &mut Vec<[u32; 2]>,
) -> Result<u64, FaceProblem> {
    let [vertex_count, uv_count, normal_count] = counts;
    polygon.clear();
    beside.clear();
    let mut needs = 0;
    loop {
        let word = words.word();
        if word.is_empty() {
            break;
        }
        let from_0 = |number: i64, count: u64| match number {
            1.. => Some(number as u64 - 1),
            _ => count.checked_sub(number.unsigned_abs()).filter(|_| number < 0),
        };
        let vertex = match parse_corner(word) {
            Some([number, uv, normal]) => {
                let of = |number: i64, count: u64| {
                    let number = from_0(number, count).filter(|_| number != 0);
                    number.map_or(NONE, |number| u32::try_from(number).unwrap_or(NONE))
                };
                beside.push([of(uv, uv_count), of(normal, normal_count)]);
                from_0(number, vertex_count).ok_or(FaceProblem::Index)
            }
            None => Err(FaceProblem::Words),
        };
        match vertex {
            Ok(vertex) if vertex < MAX_VERTICES => {
                polygon.push(vertex as u32);
                needs = needs.max(vertex + 1);
            }
            bad => {
                let more = words_left(words).take(2).count();
                let is_thin = polygon.len() + 1 + more < 3;
                return Err(if is_thin { FaceProblem::Thin } else { bad.err().unwrap_or(FaceProblem::Index) });
            }
        }
    }
    if polygon.len() < 3 { Err(FaceProblem::Thin) } else { Ok(needs) }
}

fn words_left<'a>(words: &mut Scanner<'a>) -> impl Iterator<Item = &'a [u8]> {
    std::iter::from_fn(|| Some(words.word()).filter(|word| !word.is_empty()))
}

/// The vertex, the texture coordinates and the normal of a corner like 7, 7/2, 7//3 or 7/2/3, as written; 0 where one
/// is missing.
fn parse_corner(word: &[u8]) -> Option<[i64; 3]> {
    let mut parts = word.split(|&b| b == b'/');
    let vertex = parts.next().filter(|part| !part.is_empty()).map_or(Some(0), parse_integer)?;
    let mut beside = [0; 2];
    for (place, part) in parts.enumerate() {
        if part.is_empty() {
            continue;
        }
        *beside.get_mut(place)? = parse_integer(part)?;
    }
    Some([vertex, beside[0], beside[1]])
}

#[inline]
fn parse_integer(word: &[u8]) -> Option<i64> {
    let mut value = 0;
    if word.len() > 18 {
        return parse_long_integer(word);
    }
    for &byte in word {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            return parse_long_integer(word);
        }
        value = 10 * value + i64::from(digit);
    }
    Some(value)
}

/// Signed numbers, and numbers of nearly 64 bits.
#[cold]
fn parse_long_integer(word: &[u8]) -> Option<i64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The statements of a file: lines without comments, joined where they end in a backslash.
struct Statements<'a> {
    source: Source<'a>,
    at: usize,
    /// Statements that begin here or later are left out.
    end: usize,
    lines_passed: u64,
    joined: Vec<u8>,
}

impl<'a> Statements<'a> {
    fn new(source: Source<'a>) -> Self {
        let at = if source.bytes.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 };
        Self { source, at, end: usize::MAX, lines_passed: 0, joined: Vec::new() }
    }

    /// The statements that begin in a range, given the number of lines before it.
    fn within(source: Source<'a>, range: Range<usize>, lines_passed: u64) -> Self {
        let mut statements = Self { end: range.end, lines_passed, ..Self::new(source) };
        if range.start > 0 {
            let text = source.bytes;
            statements.at = first_line_from(text, range.start);
            // These lines belong to a statement that begins before the range.
            while statements.at < text.len() && is_continued(text, statements.at) {
                statements.at = first_line_from(text, statements.at + 1);
            }
        }
        statements
    }

    fn next_line(&mut self) -> Option<&'a [u8]> {
        let rest = self.source.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        self.at += length + if rest[length..].starts_with(b"\r\n") { 2 } else { 1 };
        self.lines_passed += 1;
        Some(rest[..length].trim_ascii())
    }

    /// The next statement, and the line on which it begins.
    fn next(&mut self) -> Option<(Location, Scanner<'_>)> {
        self.source.passed(self.at);
        if self.at >= self.end {
            return None;
        }
        let line = self.next_line()?;
        let location = Location::Line(self.lines_passed);
        if line.last() != Some(&b'\\') {
            return Some((location, Scanner::new(statement(line), 0)));
        }
        self.joined.clear();
        let mut part = Some(line);
        while let Some(line) = part {
            let continued = line.strip_suffix(b"\\");
            self.joined.extend_from_slice(continued.unwrap_or(line));
            self.joined.push(b' ');
            part = if continued.is_some() { self.next_line() } else { None };
        }
        Some((location, Scanner::new(statement(&self.joined), 0)))
    }
}

/// A line without its comment. Names may contain the sign of comments, so statements that are names are left as they
/// are.
fn statement(line: &[u8]) -> &[u8] {
    let is_name = || NAMING_WORDS.contains(&Scanner::new(line, 0).word());
    if matches!(line, [b'u' | b'm' | b'o' | b'g', ..]) && is_name() { line } else { without_comment(line) }
}

/// Statements that are a name, or several.
const NAMING_WORDS: [&[u8]; 4] = [b"usemtl", b"mtllib", b"o", b"g"];

fn without_comment(line: &[u8]) -> &[u8] {
    line.split(|&b| b == b'#').next().unwrap_or_default()
}

/// Reads the file again to find which face names a vertex that does not exist.
#[cold]
fn find_bad_index(source: &Source) -> Box<ImportError> {
    let mut statements = Statements::new(*source);
    let mut total = 0;
    while let Some((_, mut words)) = statements.next() {
        total += u64::from(words.word() == b"v");
    }
    if let Err(too_large) = crate::check_size(source.path, total, 0) {
        return too_large;
    }
    let mut statements = Statements::new(*source);
    let (mut face, mut so_far) = (0, 0);
    while let Some((location, mut words)) = statements.next() {
        match words.word() {
            b"v" => so_far += 1,
            b"f" => {
                let numbers: Vec<_> =
                    words_left(&mut words).map(|word| parse_corner(word).map_or(0, |[vertex, ..]| vertex)).collect();
                if numbers.len() < 3 {
                    continue;
                }
                face += 1;
                for index in numbers {
                    let vertex_count = if index < 0 { so_far } else { total };
                    if index == 0 || index.unsigned_abs() > vertex_count {
                        let path = source.path.to_owned();
                        return ImportError::Index { path, location, face, index, vertex_count, first_vertex: 1 }
                            .into();
                    }
                }
            }
            _ => {}
        }
    }
    source.syntax(Location::Byte(0), "a face names a vertex that does not exist; export the file again")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{error_of, import_bytes, import_noting};

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    fn triangles(faces: &str) -> Vec<[[f64; 3]; 3]> {
        let mesh = import_bytes("a.obj", format!("{SQUARE}{faces}\n").as_bytes()).unwrap();
        (0..mesh.triangles.len() as u32).map(|t| mesh.corners(t).map(|p| p.to_array())).collect()
    }

    #[test]
    fn all_ways_to_name_a_vertex_give_the_same_mesh() {
        let expected = triangles("f 1 2 3\nf 1 3 4");
        assert_eq!(expected[1], [[0., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
        for faces in [
            "f 1 2 3 4",
            "f -4 -3 -2 -1",
            "vt 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1 4/2/1",
            "f 1//7 2//7 3//7 4//7",
            "f 1/1 2/1 3/1 4/1  # a comment",
            "f 1 2 \\\n 3 \\\r\n 4",
            "mtllib missing.mtl\nusemtl nowhere\nusemtl\ng\no x\ns off\nf 1 2 3\ng y z\nusemtl b\nf 1 3 4",
            "l 1 2 3 4\np 1\nf 1 2 3 4\nl 1 2",
            "# caf\u{e9}\nf\t1\t2\t3\t4",
        ] {
            assert_eq!(triangles(faces), expected, "{faces}");
        }
        assert_eq!(import_bytes("a", format!("# \n{SQUARE}f 1 2 3\nf 1 3 4\n").as_bytes()).unwrap().triangles.len(), 2);
    }

    #[test]
    fn text_that_is_not_utf8_may_stand_in_comments_and_names() {
        let text = [b"# caf\xe9\no \xff\n", SQUARE.as_bytes(), b"f 1 2 3\n"].concat();
        assert_eq!(import_bytes("a.obj", &text).unwrap().triangles.len(), 1);
        assert!(error_of("a.obj", &[SQUARE.as_bytes(), b"f 1 2 3\xe9\n"].concat()).contains("line 5"));
    }

    #[test]
    fn colours_at_some_vertices_and_weights_do_not_matter() {
        let text = "v 0 0 0 1 0 0\nv 2 0 0\nv 2 2 0 0.5\nv 0 2 0 1 1 1 1\nf 1 2 3 4\n";
        let (mesh, notes) = import_noting("a.obj", text.as_bytes());
        assert_eq!(mesh.unwrap().bounds()[1], DVec3::new(2.0, 2.0, 0.0));
        assert!(notes.contains("1 vertices have a weight"));
    }

    #[test]
    fn vertices_may_follow_their_faces() {
        let mesh = import_bytes("a.obj", format!("f 1 2 3\n{SQUARE}").as_bytes()).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        // Polygons need the positions of their vertices; those that still lack some come last.
        let text =
            "v 0 0 0\nf 1 3 4 2\nf -1 2 3\nv 1 0 0\nf 1 2 4 3 # a comment\nv 0 1 0\nf 1 2 3\nv 1 1 0\nf -4 -3 -1 -2\n";
        let mesh = import_bytes("a.obj", text.as_bytes()).unwrap();
        assert_eq!(mesh.triangles[..4], [[0, 1, 2], [0, 1, 2], [0, 1, 3], [0, 3, 2]]);
        assert_eq!(mesh.triangles[4..], [[0, 2, 3], [0, 3, 1], [0, 1, 3], [0, 3, 2]]);
    }

    #[test]
    fn bad_indices_name_file_line_face_and_vertex() {
        for (faces, expected) in [
            ("f 1 2 3\nf 1 2 5", "a.obj: line 6: face 2 uses vertex 5, but the file has 4 vertices numbered from 1"),
            ("f 1 2 0", "line 5: face 1 uses vertex 0"),
            ("f 1 2 -5", "line 5: face 1 uses vertex -5"),
            ("f 1 2 9000000000000000000", "vertex 9000000000000000000"),
            ("f 1 2 99999999999999999999", "line 5: a face needs"),
            ("f 1 2 x", "line 5: a face needs"),
            ("f 1/1/1/1 2 3", "line 5: a face needs"),
            ("f 1 2 3.0", "line 5: a face needs"),
            ("f /1 2 3", "line 5: face 1 uses vertex 0"),
            ("f 1 2 3 4\nf 4 3 5 1\nf 1 2 6", "line 6: face 2 uses vertex 5, but the file has 4"),
            ("f 1 5 2\nf 1 2 x", "line 6: a face needs"),
            ("f 1 2\nf x 1\nf 9 9\nf 1 2 8589934592", "line 8: face 1 uses vertex 8589934592"),
        ] {
            let error = error_of("a.obj", format!("{SQUARE}{faces}\n").as_bytes());
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn bad_vertices_name_their_line() {
        let faces = "f 1 2 3\n";
        assert!(error_of("a.obj", format!("v 1 2\n{SQUARE}{faces}").as_bytes()).contains("line 1: a vertex needs"));
        assert!(
            error_of("a.obj", format!("{SQUARE}v 1 2 three\n{faces}").as_bytes()).contains("line 5: a vertex needs")
        );
        let error = error_of("a.obj", format!("#\nv 0 0 0\nv 0 -inf 1\nv 0 1 0\n{faces}").as_bytes());
        assert!(error.contains("line 3: vertex 2 has the coordinate -inf"), "{error}");
        assert!(error_of("a.obj", format!("v nan 0 0\n{SQUARE}{faces}").as_bytes()).contains("line 1: vertex 1"));
        assert!(error_of("a.obj", format!("v 1e999 0 0\n{SQUARE}{faces}").as_bytes()).contains("coordinate inf"));
    }

    #[test]
    fn thin_faces_are_noted_and_files_without_faces_are_refused() {
        let (mesh, notes) = import_noting("a.obj", format!("{SQUARE}f\nf 1\nf 1 2\nf 1 1 2 2 1\nf 1 2 3").as_bytes());
        assert_eq!(mesh.unwrap().triangles.len(), 1);
        assert!(notes.contains("4 faces with fewer than three") && notes.contains("no line end"), "{notes}");
        for faces in ["", "f 1 2\n", "l 1 2 3\n", "p 1\n"] {
            assert!(
                error_of("a.obj", format!("{SQUARE}{faces}").as_bytes())
                    .contains("no triangles: the file has 4 vertices")
            );
        }
    }

    #[test]
    fn files_cut_anywhere_give_an_error_or_a_mesh() {
        let text = format!("{SQUARE}f 1//1 2//1 3//1\nf -1 -2 -4\nf 1 2 \\\n3 4\n");
        for length in 0..text.len() {
            let _ = import_bytes("a.obj", &text.as_bytes()[..length]);
        }
    }

    #[test]
    fn far_coordinates_keep_their_millimetres() {
        let mesh =
            import_bytes("a.obj", b"v 5000000.001 -5e6 0\nv 5000000.002 1 0\nv 5000000.003 0 1\nf 1 2 3\n").unwrap();
        assert_eq!(mesh.positions[0].x, 5000000.001);
        assert_eq!(mesh.positions[1].x, 5000000.002);
    }
}
