//! The section GROUND (SPEC.md, chapter 23): a whole file of heights within the file of a mesh.

use super::{Container, GROUND, HEIGHT_INDEX, HEIGHTS, Handmade, PAGES, PLACEMENT, Section};

/// A file of heights of one cell; it is one of the vectors.
const CELL: &[u8] = include_bytes!("../../../format-spec/vectors/heights/cell.lodpack");
/// One of an ellipsoid.
const GLOBE: &[u8] = include_bytes!("../../../format-spec/vectors/heights/globe.lodpack");

/// The worked example on a ground of one cell. The example has y up, its unit is a quarter of a metre, and it lies
/// elsewhere; the ground says nothing of that.
pub fn grounded() -> Container {
    let mut container = Handmade::example().container();
    container.version[1] = 3;
    container.sections.insert(0, placement(1, 0.25, [16.0, -4.0, 0.5], ""));
    put_under(&mut container, CELL.to_vec());
    container
}

/// Puts a file as a ground under a mesh.
pub fn put_under(container: &mut Container, content: Vec<u8>) {
    let pages = container.sections.iter().position(|section| section.kind == PAGES).unwrap_or(container.sections.len());
    container.sections.insert(pages, Section { kind: GROUND, flags: 2, content, reserved: 0 });
}

/// Heights under an image.
const DRAPED: &[u8] = include_bytes!("../../../format-spec/vectors/heights/draped.lodpack");

/// A file of heights with an image over them, which has a hole and three levels.
pub fn draped() -> Container {
    sections_of(DRAPED)
}

/// Heights around a globe, as a file.
pub fn globe() -> Vec<u8> {
    GLOBE.to_vec()
}

/// The sections of a file, whose checksums are taken to be right.
pub fn sections_of(file: &[u8]) -> Container {
    let number = |at: usize| u32::from_le_bytes([file[at], file[at + 1], file[at + 2], file[at + 3]]);
    let mut container = Container { version: [4, file[10].into()], ..Container::default() };
    for entry in (0..number(44) as usize).map(|section| 64 + 32 * section) {
        let (offset, length) = (number(entry + 8) as usize, number(entry + 16) as usize);
        let content = file[offset..offset + length].to_vec();
        container.sections.push(Section { kind: number(entry), flags: number(entry + 4), content, reserved: 0 });
    }
    container
}

/// A section PLACEMENT.
pub fn placement(up: u8, unit: f64, origin: [f64; 3], crs: &str) -> Section {
    let mut content = vec![up, 0, 0, 0, 0, 0, 0, 0];
    [unit].iter().chain(&origin).for_each(|x| content.extend(x.to_le_bytes()));
    content.extend(crs.as_bytes());
    Section { kind: PLACEMENT, flags: 0, content, reserved: 0 }
}

/// A file of heights that has a ground itself.
pub fn ground_in_ground() -> Vec<u8> {
    let mut heights = sections_of(CELL);
    heights.version[1] = 3;
    put_under(&mut heights, CELL.to_vec());
    heights.bytes()
}

/// A file of heights that says in which coordinate reference system it is.
pub fn heights_in(crs: &str) -> Vec<u8> {
    let mut heights = sections_of(CELL);
    heights.sections.retain(|section| section.kind != PLACEMENT);
    heights.sections.insert(0, placement(2, 1.0, [0.0; 3], crs));
    heights.bytes()
}

/// The sections of heights beside those of a mesh.
pub fn heights_beside(container: &mut Container) {
    let heights = sections_of(CELL).sections.into_iter().filter(|s| [HEIGHTS, HEIGHT_INDEX].contains(&s.kind));
    container.sections.splice(1..1, heights);
}
