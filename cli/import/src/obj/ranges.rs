//! OBJ in ranges of its bytes: a statement belongs to the range in which it begins.
//!
//! Positions and faces alone are read; [`super::read_obj`] reads the rest.

use std::ops::Range;

use super::{FaceProblem, Statements, find_bad_index, numbers_left, read_face, read_vertex};
use crate::error::Parsed;
use crate::source::Source;
use crate::text::{TextCounts, TextSink};

/// Why a vertex with a colour is refused: only an import of the whole reads colours.
const HAS_COLOURS: &str =
    "this vertex has a colour, which is not read in ranges; plan it without --stages, or with --channels none";

/// Counts what begins in a range. `with_colours` says that colours of vertices are wanted.
pub fn count_in_range(source: &Source, range: Range<usize>, with_colours: bool) -> Parsed<TextCounts> {
    let mut statements = Statements::within(*source, range, 0);
    let mut vertices = 0;
    while let Some((_, mut words)) = statements.next() {
        if words.word() == b"v" {
            vertices += 1;
            let count = if with_colours { super::words_left(&mut words).take(6).count() } else { 0 };
            if count >= 6 {
                return Err(source.syntax(source.line(statements.at.saturating_sub(1)), HAS_COLOURS));
            }
        }
    }
    Ok(TextCounts { lines: statements.lines_passed, vertices })
}

/// Reads what begins in a range. `before` counts what precedes it, and `all` what the file has.
pub fn read_range(
    source: &Source,
    range: Range<usize>,
    before: TextCounts,
    all: TextCounts,
    sink: &mut TextSink,
) -> Parsed<()> {
    let mut statements = Statements::within(*source, range, before.lines);
    let mut vertex_count = before.vertices;
    let (mut polygon, mut beside) = (vec![], vec![]);
    while let Some((location, mut words)) = statements.next() {
        match words.word() {
            b"v" => {
                vertex_count += 1;
                let position = read_vertex(source, location, vertex_count, &mut words)?;
                let rest = numbers_left(&mut words);
                if rest.len() == 1 && rest[0] != 1.0 {
                    sink.skip(WEIGHTS, 1);
                }
                if rest.len() >= 3 {
                    sink.leave_out("colours");
                }
                sink.push_vertex(position)?;
            }
            b"f" => match read_face(&mut words, [vertex_count, 0, 0], &mut polygon, &mut beside) {
                Ok(needs) if needs > all.vertices => return Err(find_bad_index(source)),
                // An import of the whole reads polygons that precede a vertex of theirs after all others.
                Ok(needs) => sink.push_face(&polygon, polygon.len() > 3 && needs > vertex_count)?,
                Err(FaceProblem::Thin) => sink.skip_thin(),
                Err(FaceProblem::Index) => return Err(find_bad_index(source)),
                Err(FaceProblem::Words) => return Err(source.syntax(location, super::BAD_FACE)),
            },
            b"surf" | b"curv" => sink.skip(FREE_FORMS, 1),
            b"vn" => sink.leave_out("normals"),
            b"vt" => sink.leave_out("texture coordinates"),
            b"usemtl" => sink.leave_out("materials"),
            word @ (b"g" | b"o") => sink.name(word == b"o", &words.bytes[words.at..]),
            _ => {}
        }
    }
    Ok(())
}

pub(super) const WEIGHTS: &str = "vertices have a weight other than 1, which only curves use: ignored";
pub(super) const FREE_FORMS: &str =
    "free-form curves and surfaces were left out; convert them to polygons to keep them";
