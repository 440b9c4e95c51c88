//! What is wrong with images, in one line each, and what to do.

use std::io;

use image::ImageError;
use image::error::{ImageFormatHint, UnsupportedErrorKind};

/// A name of a file as messages show it: in one line, and without its middle where it is very long.
pub fn shown_name(name: &str) -> String {
    const MOST: usize = 200;
    let count = name.chars().count();
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    if count <= MOST {
        return name.chars().map(plain).collect();
    }
    let [start, end] = [0, count - MOST / 2].map(|skipped| name.chars().skip(skipped).take(MOST / 2).map(plain));
    start.chain("...".chars()).chain(end).collect()
}

/// What is wrong with an image that cannot be opened or read, and what to do.
pub fn unreadable(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file: put it there".into(),
        io::ErrorKind::UnexpectedEof => damaged("unexpected end of file"),
        _ => in_one_line(&error.to_string()),
    }
}

/// What is wrong with an image whose bytes are damaged, and what to do.
pub(super) fn damaged(problem: &str) -> String {
    format!("it is damaged ({}): copy or export it again", in_one_line(problem))
}

/// What is wrong with an image that cannot be decoded, and what to do.
pub(super) fn undecodable(error: &ImageError) -> String {
    match error {
        ImageError::Unsupported(problem) => match problem.kind() {
            UnsupportedErrorKind::Format(ImageFormatHint::Exact(format)) => {
                unread_format(&format!("its format ({format:?}) is not read"))
            }
            UnsupportedErrorKind::Format(_) => unread_format("its format is unknown"),
            _ => in_one_line(&error.to_string()),
        },
        ImageError::IoError(error) => unreadable(error),
        ImageError::Decoding(problem) => damaged(&problem.to_string()),
        other => in_one_line(&other.to_string()),
    }
}

fn unread_format(problem: &str) -> String {
    format!("{problem}: convert it to PNG, JPEG, WebP, TIFF or EXR")
}

pub(super) fn png_problem(error: &png::DecodingError) -> String {
    match error {
        png::DecodingError::IoError(error) => unreadable(error),
        png::DecodingError::Format(_) => damaged(&error.to_string()),
        other => in_one_line(&other.to_string()),
    }
}

/// Notes have one line each.
fn in_one_line(problem: &str) -> String {
    let words: Vec<&str> = problem.split_whitespace().collect();
    words.join(" ").trim_end_matches('.').to_owned()
}
