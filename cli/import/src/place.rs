//! Where in the world mesh files say that they are: their formats, their comments, and the small files that programs of
//! photogrammetry put beside meshes whose coordinates they have moved.
//!
//! | says it | what |
//! |---|---|
//! | glTF | y is up, the unit is the metre |
//! | `.lodpack` | all that its section PLACEMENT has |
//! | comments of PLY and OBJ | `offset X Y Z` (also `shift`, `origin`, `translation`), `EPSG:N`, `WKT ...` |
//! | `metadata.xml` (ContextCapture, DJI Terra, Metashape) | `SRS` and `SRSOrigin` |
//! | `NAME_offset.xyz`, `offset.txt` (Pix4D, Skycatch), `SHIFT.txt` (3DSC) | three numbers, maybe after an EPSG code |
//! | `NAME.prj`, `NAME_wkt.prj` (Pix4D) | WKT |
//!
//! Whatever is not understood says nothing.

use std::fs;
use std::path::{Path, PathBuf};

use lodpack::index::{Placement, UpAxis};

use super::source::{FileBytes, Source};
use super::{Format, detect_format};
use lodpack_runtime::progress::{Progress, Silent};

/// Bytes of a text file whose comments are read.
const COMMENT_BYTES: usize = 1 << 16;
/// The largest file beside a mesh that is read.
const SMALL_BYTES: u64 = 1 << 16;
/// Folders above a mesh in which its metadata may be.
const FOLDERS_UP: usize = 2;
/// Words after which three numbers are what was taken off the coordinates.
const OFFSETS: [&str; 4] = ["offset", "shift", "origin", "translation"];

/// What all of the files say alike about their coordinates; none if they say nothing, or do not agree. Notes say which
/// it is.
pub fn survey_meshes(paths: &[PathBuf], progress: &dyn Progress) -> Option<Placement> {
    let mut agreed: Option<(Placement, String)> = None;
    for (number, path) in paths.iter().enumerate() {
        let (placement, by) = place_of(path);
        match &agreed {
            _ if number == 0 => agreed = Some((placement, by)),
            Some((known, _)) if *known == placement => {}
            _ => {
                progress.note("the inputs do not all say the same about their place in the world, so the file says nothing; --crs, --origin, --up and --unit do");
                return None;
            }
        }
    }
    let (placement, by) =
        agreed.filter(|(placement, _)| *placement != Placement::default() && placement.fault().is_none())?;
    // The rules of a format are no news.
    if placement.origin != [0.0; 3] || !placement.crs.is_empty() {
        progress.note(&format!("{by} places the coordinates: {}", described(&placement)));
    }
    Some(placement)
}

/// What a file says, and where it is said.
fn place_of(path: &Path) -> (Placement, String) {
    let mut place = Place::default();
    let Ok(bytes) = FileBytes::open(path) else { return Default::default() };
    match detect_format(&Source::of_file(path, &bytes, &Silent)) {
        Ok(Format::Glb | Format::Gltf) => {
            place.placement.up = UpAxis::Y;
            place.placement.unit = Some(1.0);
        }
        Ok(Format::Lodpack) => {
            let file =
                fs::File::open(path).ok().and_then(|file| lodpack::File::open(file, lodpack::Limits::default()).ok());
            let placement = file.and_then(|file| file.placement().cloned());
            return (placement.unwrap_or_default(), path.display().to_string());
        }
        Ok(Format::Ply) => comments(&bytes, b"end_header").for_each(|line| place.read_comment(line, path)),
        Ok(Format::Obj) => comments(&bytes, b"f ").for_each(|line| place.read_comment(line, path)),
        _ => {}
    }
    place.read_beside(path);
    if !place.placement.crs.is_empty() && place.placement.up == UpAxis::Unknown {
        place.placement.up = UpAxis::Z;
    }
    (place.placement, place.by)
}

/// The comments before a line with a certain beginning.
fn comments<'a>(bytes: &'a [u8], end: &'a [u8]) -> impl Iterator<Item = &'a str> {
    let lines = bytes[..bytes.len().min(COMMENT_BYTES)].split(|&b| b == b'\n' || b == b'\r').map(<[u8]>::trim_ascii);
    lines.take_while(move |line| !line.starts_with(end)).filter_map(|line| {
        let text = std::str::from_utf8(line).ok()?;
        ["comment", "obj_info", "#"].into_iter().find_map(|word| text.strip_prefix(word))
    })
}

/// What was found so far, and where.
#[derive(Default)]
struct Place {
    placement: Placement,
    by: String,
}

impl Place {
    fn read_comment(&mut self, text: &str, path: &Path) {
        let lower = text.to_ascii_lowercase();
        let offset = OFFSETS.iter().find_map(|word| lower.find(word).map(|at| at + word.len()));
        let found = [
            offset.and_then(|at| three_numbers(&text[at..])).map(|origin| self.placement.origin = origin).is_some(),
            crs_in(text).map(|crs| self.placement.crs = crs).is_some(),
        ];
        if found.contains(&true) {
            self.by = format!("a comment in {}", path.display());
        }
    }

    /// Reads the files beside a mesh. A CRS without an offset counts, too: coordinates may be those of the CRS.
    fn read_beside(&mut self, path: &Path) {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let named = |name: String| path.with_file_name(name);
        for file in path.ancestors().skip(1).take(1 + FOLDERS_UP).map(|folder| folder.join("metadata.xml")) {
            if let Some(text) = small_text(&file)
                && self.read_metadata(&text)
            {
                self.by = file.display().to_string();
                return;
            }
        }
        for file in [named(format!("{stem}_offset.xyz")), named("offset.txt".into()), named("SHIFT.txt".into())] {
            let Some(text) = small_text(&file) else { continue };
            if let Some(origin) = three_numbers(without_code(&text)) {
                self.placement.origin = origin;
                self.placement.crs = crs_in(&text).unwrap_or(std::mem::take(&mut self.placement.crs));
                self.by = file.display().to_string();
                break;
            }
        }
        for file in [named(format!("{stem}.prj")), named(format!("{stem}_wkt.prj"))] {
            let Some(crs) = small_text(&file).and_then(|text| crs_in(&text)) else { continue };
            self.by = if self.by.is_empty() {
                file.display().to_string()
            } else {
                format!("{} with {}", self.by, file.display())
            };
            self.placement.crs = crs;
            break;
        }
    }

    /// Reads `<SRS>` and `<SRSOrigin>`. A local system, `ENU:latitude,longitude`, has its origin there.
    fn read_metadata(&mut self, text: &str) -> bool {
        let element = |name: &str| {
            let (_, rest) = text.split_once(&format!("<{name}>"))?;
            Some(rest.split_once("</")?.0.trim().to_owned())
        };
        let Some(srs) = element("SRS") else { return false };
        let origin = element("SRSOrigin").and_then(|origin| three_numbers(&origin)).unwrap_or_default();
        if let Some(rest) = srs.strip_prefix("ENU:") {
            let mut degrees = rest.split(',').filter_map(|number| number.trim().parse::<f64>().ok());
            let (Some(latitude), Some(longitude)) = (degrees.next(), degrees.next()) else { return false };
            // Lengths to the east and the north of the place itself.
            if origin[0] != 0.0 || origin[1] != 0.0 {
                return false;
            }
            self.placement.crs = "EPSG:4979".into();
            self.placement.origin = [longitude, latitude, origin[2]];
        } else if let Some(crs) = crs_in(&srs) {
            (self.placement.crs, self.placement.origin) = (crs, origin);
        } else {
            return false;
        }
        (self.placement.up, self.placement.unit) = (UpAxis::Z, Some(1.0));
        true
    }
}

fn small_text(path: &Path) -> Option<String> {
    let is_small = fs::metadata(path).is_ok_and(|file| file.is_file() && file.len() <= SMALL_BYTES);
    if is_small { fs::read_to_string(path).ok() } else { None }
}

/// The coordinate reference system that a text names: `EPSG:N`, `EPSG::N`, or WKT.
fn crs_in(text: &str) -> Option<String> {
    if let Some(at) = ["PROJCS[", "PROJCRS[", "GEOGCS[", "GEOGCRS[", "COMPD_CS[", "COMPOUNDCRS[", "GEOCCS[", "GEODCRS["]
        .iter()
        .filter_map(|word| text.find(word))
        .min()
    {
        let wkt = &text[at..];
        return Some(wkt[..=wkt.rfind(']')?].to_owned());
    }
    let at = text.to_ascii_uppercase().find("EPSG:")?;
    let digits: String =
        text[at + 5..].trim_start_matches([':', ' ']).chars().take_while(char::is_ascii_digit).collect();
    digits.parse::<u32>().ok().map(|number| format!("EPSG:{number}"))
}

/// A text behind its first word, if that is a code of EPSG.
fn without_code(text: &str) -> &str {
    let text = text.trim_start();
    match text.get(..5).is_some_and(|start| start.eq_ignore_ascii_case("EPSG:")) {
        true => text.trim_start_matches(|c: char| !c.is_whitespace()),
        false => text,
    }
}

/// Three numbers at the beginning of a text, behind signs like `:` and `=`; nothing but space may follow on their line.
fn three_numbers(text: &str) -> Option<[f64; 3]> {
    let text = text.trim_start_matches(|c: char| c.is_whitespace() || ":=([".contains(c));
    let line = text.lines().find(|line| !line.trim().is_empty())?.trim_end_matches([')', ']', ' ']);
    let mut numbers = line.split(|c: char| c.is_whitespace() || c == ',' || c == ';').filter(|word| !word.is_empty());
    let mut next = || numbers.next()?.parse::<f64>().ok().filter(|number| number.is_finite());
    let three = [next()?, next()?, next()?];
    numbers.next().is_none().then_some(three)
}

fn described(placement: &Placement) -> String {
    let [x, y, z] = placement.origin;
    // WKT has a name in quotes.
    let name = placement.crs.split('"').nth(1).unwrap_or(&placement.crs);
    let parts = [
        (!name.is_empty()).then(|| name.to_owned()),
        (placement.origin != [0.0; 3]).then(|| format!("origin {x} {y} {z}")),
        match placement.up {
            UpAxis::Y => Some("y up".to_owned()),
            UpAxis::Z => Some("z up".to_owned()),
            UpAxis::Unknown => None,
        },
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLY: &str = "ply\nformat ascii 1.0\n@element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    const OBJ: &str = "@v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    /// What files say of which the first is a mesh.
    fn said(files: &[(&str, &str)]) -> Option<(String, [f64; 3], UpAxis)> {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        let placement = survey_meshes(&[dir.path().join(files[0].0)], &Silent)?;
        Some((placement.crs, placement.origin, placement.up))
    }

    fn placed(crs: &str, origin: [f64; 3]) -> Option<(String, [f64; 3], UpAxis)> {
        let up = if crs.is_empty() { UpAxis::Unknown } else { UpAxis::Z };
        Some((crs.to_owned(), origin, up))
    }

    #[test]
    fn comments_and_files_beside_a_mesh_place_it() {
        let ply = |comment: &str| PLY.replace('@', comment);
        let obj = |comment: &str| OBJ.replace('@', comment);
        let xml = |srs: &str, origin: &str| {
            format!(
                "<?xml version=\"1.0\"?><ModelMetadata version=\"1\"><SRS>{srs}</SRS><SRSOrigin>{origin}</SRSOrigin></ModelMetadata>"
            )
        };
        let utm = "EPSG:32632";
        let wkt = "PROJCS[\"ETRS89 / UTM zone 32N\",UNIT[\"metre\",1]]";
        assert_eq!(said(&[("a.ply", &ply(""))]), None);
        assert_eq!(said(&[("a.ply", &ply("comment offset 500000 5000000 100\n"))]), placed("", [5e5, 5e6, 100.0]));
        let both = ply("comment Global shift: 500000, 5000000, 0\ncomment CRS EPSG:32632\n");
        assert_eq!(said(&[("a.ply", &both)]), placed(utm, [5e5, 5e6, 0.0]));
        assert_eq!(said(&[("a.obj", &obj("# origin = (1.5 2 3)\n# epsg:32632\n"))]), placed(utm, [1.5, 2.0, 3.0]));
        // Words about something else, numbers of which there are too many or too few, and statements are not meant.
        for not in ["# offset of layer 3\n", "# offset 1 2\n", "# shift 1 2 3 4\n", "# shift 1 2 NaN\n", "o offset\n"] {
            assert_eq!(said(&[("a.obj", &obj(not))]), None, "{not}");
        }
        let plain = obj("");
        assert_eq!(said(&[("a.obj", &plain), ("metadata.xml", &xml(utm, "5,6,7"))]), placed(utm, [5.0, 6.0, 7.0]));
        assert_eq!(
            said(&[("Data/T1/a.obj", &plain), ("metadata.xml", &xml(utm, "5,6,7"))]),
            placed(utm, [5.0, 6.0, 7.0])
        );
        let local = xml("ENU:48.5,9.25", "0,0,0");
        assert_eq!(said(&[("a.obj", &plain), ("metadata.xml", &local)]), placed("EPSG:4979", [9.25, 48.5, 0.0]));
        assert_eq!(said(&[("a.obj", &plain), ("metadata.xml", "<SRS>EPSG</SRS>")]), None);
        let pix4d = [("a.obj", plain.as_str()), ("a_offset.xyz", "500000 5000000 10\n"), ("a_wkt.prj", wkt)];
        assert_eq!(said(&pix4d), placed(wkt, [5e5, 5e6, 10.0]));
        assert_eq!(said(&[("a.obj", &plain), ("SHIFT.txt", "EPSG::32632 1 2 3")]), placed(utm, [1.0, 2.0, 3.0]));
        assert_eq!(said(&[("a.obj", &plain), ("offset.txt", "none")]), None);
    }

    #[test]
    fn inputs_that_do_not_agree_say_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, comment: &str| {
            fs::write(dir.path().join(name), OBJ.replace('@', comment)).unwrap();
            dir.path().join(name)
        };
        let inputs = [
            write("a.obj", "# offset 1 2 3\n"),
            write("b.obj", "# offset 1 2 3\n"),
            write("c.obj", "# offset 1 2 4\n"),
        ];
        assert_eq!(survey_meshes(&inputs[..2], &Silent).map(|placement| placement.origin), Some([1.0, 2.0, 3.0]));
        assert_eq!(survey_meshes(&inputs, &Silent), None);
    }
}
