//! Wavefront OBJ through `tobj`, positions in f64.
//!
//! What `tobj` sees is only geometry: [`GeometryLines`] stands before it and passes on `v` and `f` lines. That keeps
//! out what `tobj` would get wrong or refuse (polylines of three points, which it takes for faces; missing material
//! files; continued lines; comments behind numbers; text that is not UTF-8; colours at some vertices only), and it
//! knows the line for messages.

use std::io::{BufRead, Read};

use glam::DVec3;
use tobj::{LoadError, LoadOptions};

use super::error::{ImportError, Parsed, Place};
use super::polygon::Triangulator;
use super::scan::{Scanner, parse_float};
use super::source::Source;
use crate::mesh::Mesh;

/// Words that can start the first statement of an OBJ file.
const FIRST_WORDS: [&[u8]; 9] = [b"v", b"vt", b"vn", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl"];

/// Whether the first statement of a text, after comments, is one of OBJ's.
pub(super) fn looks_like_obj(text: &[u8]) -> bool {
    let first = text
        .split(|&b| b == b'\n' || b == b'\r')
        .map(<[u8]>::trim_ascii)
        .find(|l| !l.is_empty() && !l.starts_with(b"#"));
    first.is_some_and(|line| FIRST_WORDS.contains(&Scanner::new(line, 0).word()))
}

pub(super) fn read_obj(source: &Source) -> Parsed<Mesh> {
    let mut lines = GeometryLines::new(source.bytes);
    let options = LoadOptions { ignore_lines: true, ignore_points: true, ..LoadOptions::default() };
    let no_materials = |_: &std::path::Path| Err(LoadError::OpenFileFailed);
    let models = match tobj::load_obj_buf(&mut lines, &options, no_materials) {
        Ok((models, _)) => models,
        Err(error) => return Err(explain(source, &lines, error)),
    };
    let mut faces = Triangulator::default();
    let mut mesh = Mesh::default();
    for model in models {
        let (first, corners) = (mesh.positions.len() as u32, model.mesh.indices.len() as u64);
        super::check_size(source.path, u64::from(first) + model.mesh.positions.len() as u64 / 3, corners / 3)?;
        mesh.positions.extend(model.mesh.positions.chunks_exact(3).map(DVec3::from_slice));
        if first > 0 {
            return Err(source.syntax(Place::Byte(0), "the faces came in several pieces; please report this file"));
        }
        if model.mesh.face_arities.is_empty() {
            mesh.triangles.extend(model.mesh.indices.as_chunks::<3>().0);
            continue;
        }
        let mut rest = &model.mesh.indices[..];
        for &arity in &model.mesh.face_arities {
            let Some((polygon, others)) = rest.split_at_checked(arity as usize) else { break };
            faces.push_polygon(polygon, |v| mesh.positions[v as usize], &mut mesh.triangles);
            rest = others;
        }
    }
    if mesh.positions.iter().any(|p| !p.is_finite()) {
        return Err(find_bad_coordinate(source));
    }
    source.note_missing_line_end();
    faces.count_thin(lines.thin_face_count);
    faces.note(source);
    source.note_skipped(lines.weight_count, "vertices have a weight other than 1, which only curves use: ignored");
    source.note_skipped(
        lines.free_form_count,
        "free-form curves and surfaces were left out; convert them to polygons to keep them",
    );
    if mesh.triangles.is_empty() {
        return Err(ImportError::NoTriangles { path: source.path.to_owned(), vertex_count: lines.vertex_count }.into());
    }
    Ok(mesh)
}

/// The statements of an OBJ file that carry polygons, one a line, as a stream that `tobj` can read.
struct GeometryLines<'a> {
    statements: Statements<'a>,
    /// The statement that is handed out, and how much of it is read.
    line: Vec<u8>,
    read: usize,
    vertex_count: u64,
    thin_face_count: u64,
    weight_count: u64,
    free_form_count: u64,
}

impl<'a> GeometryLines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        let statements = Statements::new(bytes);
        Self {
            statements,
            line: Vec::new(),
            read: 0,
            vertex_count: 0,
            thin_face_count: 0,
            weight_count: 0,
            free_form_count: 0,
        }
    }

    /// Puts the next statement that matters into `line`; leaves it empty at the end of the file.
    fn load_next(&mut self) {
        self.line.clear();
        self.read = 0;
        while let Some(statement) = self.statements.next() {
            let mut words = Scanner::new(statement, 0);
            match words.word() {
                b"v" => {
                    // Behind x, y, z may stand a weight (one number) or a colour (three), neither of which is geometry.
                    words.skip_space();
                    let start = words.at;
                    for _ in 0..3 {
                        words.word();
                    }
                    self.line.extend_from_slice(b"v ");
                    self.line.extend_from_slice(&statement[start..words.at]);
                    let (weight, more) = (words.word(), words.word());
                    let weighted = !weight.is_empty() && more.is_empty() && parse_float(weight) != Some(1.0);
                    self.weight_count += u64::from(weighted);
                    self.vertex_count += 1;
                }
                b"f" => {
                    let start = words.at;
                    let corner_count =
                        std::iter::from_fn(|| Some(words.word()).filter(|w| !w.is_empty())).take(3).count();
                    if corner_count < 3 {
                        self.thin_face_count += 1;
                        continue;
                    }
                    self.line.push(b'f');
                    self.line.extend_from_slice(&statement[start..]);
                }
                b"surf" | b"curv" => {
                    self.free_form_count += 1;
                    continue;
                }
                _ => continue,
            }
            self.line.push(b'\n');
            return;
        }
    }
}

impl Read for GeometryLines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let length = self.fill_buf()?.read(buffer)?;
        self.consume(length);
        Ok(length)
    }
}

impl BufRead for GeometryLines<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        if self.read >= self.line.len() {
            self.load_next();
        }
        Ok(self.line.get(self.read..).unwrap_or_default())
    }

    fn consume(&mut self, amount: usize) {
        self.read += amount;
    }
}

/// The statements of a file: lines without comments, joined where they end with a backslash.
struct Statements<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Line ends passed so far, and the number of the line on which the last statement began.
    lines_passed: u64,
    line: u64,
    joined: Vec<u8>,
}

impl<'a> Statements<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        let at = if bytes.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 };
        Self { bytes, at, lines_passed: 0, line: 0, joined: Vec::new() }
    }

    fn next_line(&mut self) -> Option<&'a [u8]> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        self.at += length + if rest[length..].starts_with(b"\r\n") { 2 } else { 1 };
        self.lines_passed += 1;
        Some(rest[..length].trim_ascii())
    }

    fn next(&mut self) -> Option<&[u8]> {
        let line = self.next_line()?;
        self.line = self.lines_passed;
        if line.last() != Some(&b'\\') {
            return Some(without_comment(line));
        }
        self.joined.clear();
        let mut part = Some(line);
        while let Some(line) = part {
            let continued = line.strip_suffix(b"\\");
            self.joined.extend_from_slice(continued.unwrap_or(line));
            self.joined.push(b' ');
            part = if continued.is_some() { self.next_line() } else { None };
        }
        Some(without_comment(&self.joined))
    }
}

fn without_comment(line: &[u8]) -> &[u8] {
    line.split(|&b| b == b'#').next().unwrap_or_default()
}

/// Turns an error of `tobj` into one that says where.
fn explain(source: &Source, lines: &GeometryLines, error: LoadError) -> Box<ImportError> {
    let place = Place::Line(lines.statements.line);
    match error {
        LoadError::FaceVertexOutOfBounds => find_bad_index(source),
        LoadError::PositionParseError => {
            source.syntax(place, "a vertex needs three numbers; the file is damaged or not OBJ")
        }
        LoadError::FaceParseError => source
            .syntax(place, "a face needs vertex numbers like 7, 7/2, 7//3 or 7/2/3; the file is damaged or not OBJ"),
        LoadError::ReadError => source.syntax(place, "this line is not text; the file is damaged or not OBJ"),
        other => source.syntax(place, format!("{other}; the file is damaged or not OBJ")),
    }
}

/// Reads the file again to say which face names a vertex that is not there.
fn find_bad_index(source: &Source) -> Box<ImportError> {
    let mut all = GeometryLines::new(source.bytes);
    while !{
        all.load_next();
        all.line.is_empty()
    } {}
    let total = all.vertex_count as i64;
    let mut lines = GeometryLines::new(source.bytes);
    let mut face = 0;
    loop {
        lines.load_next();
        match lines.line.first() {
            None => {
                return source.syntax(Place::Byte(0), "a face names a vertex that is not there; export the file again");
            }
            Some(b'f') => face += 1,
            Some(_) => continue,
        }
        let so_far = lines.vertex_count as i64;
        let corners = lines.line.split(|&b| b <= b' ').skip(1).filter(|word| !word.is_empty());
        for corner in corners {
            let number = corner.split(|&b| b == b'/').next().and_then(|n| std::str::from_utf8(n).ok());
            let index: i64 = number.and_then(|n| n.parse().ok()).unwrap_or(0);
            if index == 0 || index > total || index < -so_far {
                let vertex_count = if index < 0 { so_far } else { total } as u64;
                let (path, place) = (source.path.to_owned(), Place::Line(lines.statements.line));
                return ImportError::Index { path, place, face, index, vertex_count, first_vertex: 1 }.into();
            }
        }
    }
}

/// Reads the file again to say which vertex is not finite.
fn find_bad_coordinate(source: &Source) -> Box<ImportError> {
    let mut lines = GeometryLines::new(source.bytes);
    loop {
        lines.load_next();
        if lines.line.is_empty() {
            return source.syntax(Place::Byte(0), "a coordinate is not finite; export the file again");
        }
        if lines.line.first() != Some(&b'v') {
            continue;
        }
        let mut words = Scanner::new(&lines.line, 1);
        let mut position = DVec3::ZERO;
        for axis in 0..3 {
            position[axis] = words.float().unwrap_or(f64::NAN);
        }
        if !position.is_finite() {
            return source.coordinate(Place::Line(lines.statements.line), lines.vertex_count, position);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{error_of, import_bytes, import_noting};
    use super::*;

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
    fn thin_faces_are_noted_and_files_without_faces_refused() {
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
    fn cut_anywhere_gives_an_error_or_a_mesh() {
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
