//! Opens lodpack files by path or address, and explains what is wrong with those that cannot be opened.

use super::slow_server::Watched;
use crate::messages;
use crate::output::shell;
use anyhow::{Context, Error, Result, anyhow, bail};
use lodpack::heights::Heights;
use lodpack::source::{Counting, Request, Within};
use lodpack::{File, Ground, GroundFrame, Limits, Opener, ReadAt};
use lodpack_cli::mesh::images::tiff_directory::is_tiff;
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::progress::Progress;
use lodpack_cli::storage::default_memory;
use std::path::Path;
use std::sync::Arc;

/// A source of any kind that counts its requests and bytes.
pub type Source = Counting<Box<dyn ReadAt + Send + Sync>>;

/// The bytes of a path or an address, which may be opened more than once.
pub type AnySource = Arc<dyn ReadAt + Send + Sync>;

/// Bytes of the first request of a copy, which tells how many there are.
const START_BYTES: usize = 64 << 10;
/// Bytes of each further one, several of which are under way at a time.
const COPIED_AT_ONCE: usize = 4 << 20;

/// The first bytes of a lodpack file, before those that a conversion of text would change.
pub const BEGINNING: &[u8] = Opener::MAGIC.split_at(4).0;

/// A file of either kind.
pub type Opened = lodpack::Opened<Source>;

/// Opens a file of a mesh for reading: a path, an address with `http` or `https` or, with the feature `object-store`,
/// `s3`, `gs` or `az`.
pub fn open(path: &Path) -> Result<File<Source>> {
    match open_any(path)? {
        Opened::Mesh(file) => Ok(file),
        Opened::Heights(_) => bail!(
            "{} holds a grid of heights, which this command does not read yet; extract a mesh of it with `lodpack extract {}`",
            path.display(),
            shell(path)
        ),
    }
}

/// [`open`] for either kind of file.
pub fn open_any(path: &Path) -> Result<Opened> {
    try_open(path)?
}

/// [`open_any`] with two results: the outer one fails if nothing can be read, the inner one if it is not a sound
/// lodpack file.
pub fn try_open(path: &Path) -> Result<Result<Opened>> {
    try_open_in(path, &source_of(path)?)
}

/// [`try_open`], given the source of the path.
pub fn try_open_in(path: &Path, source: &AnySource) -> Result<Result<Opened>> {
    match Opened::open(Counting::new(Box::new(source.clone())), Limits::default()) {
        Ok(file) => Ok(Ok(file)),
        Err(error @ lodpack::Error::Format { .. }) => {
            // A source that can no longer be read has no known beginning.
            let start = source.read_start(64).map_or(vec![], |(bytes, _)| bytes);
            Ok(Err(
                match start.starts_with(BEGINNING) || start.is_empty() && source.size().is_ok_and(|size| size > 0) {
                    true => named(path, error),
                    false => anyhow!("{} is not a lodpack file: {}", path.display(), described(&start)),
                },
            ))
        }
        Err(error) => Err(named(path, error)),
    }
}

/// [`source_of`] for commands that read everything, and most of it again and again: what an address has is copied into
/// memory once, unless it takes too much of it.
pub fn source_of_all(path: &Path, progress: &dyn Progress) -> Result<AnySource> {
    let source = source_of(path)?;
    if path.to_str().and_then(address).is_none() {
        return Ok(source);
    }
    progress.begin("copy", 0);
    let io = |length| move |source| named(path, lodpack::Error::Io { offset: 0, length, source });
    let (mut bytes, size) = source.read_start(START_BYTES).map_err(io(START_BYTES as u64))?;
    let known = bytes.len();
    match usize::try_from(size) {
        Ok(count) if size <= default_memory() / 4 && known <= count => bytes.resize(count, 0),
        _ => return Ok(source),
    }
    let offsets = (known as u64..).step_by(COPIED_AT_ONCE);
    let parts = bytes[known..].chunks_mut(COPIED_AT_ONCE).zip(offsets);
    let mut requests: Vec<Request<'_>> = parts.map(|(buf, offset)| Request { offset, buf }).collect();
    source.read_ranges(&mut requests).map_err(io(size))?;
    Ok(Arc::new(bytes))
}

/// The bytes of a path or an address.
pub fn source_of(path: &Path) -> Result<AnySource> {
    Ok(match path.to_str().and_then(address) {
        Some((scheme, url)) => match scheme.as_str() {
            "http" | "https" => {
                let options = lodpack::source::HttpOptions::default();
                Arc::new(Watched::new(lodpack::source::Http::new(&url, options), url))
            }
            "s3" | "gs" | "az" => Arc::from(open_object(&url)?),
            "file" => {
                let name = url.trim_start_matches("file://").trim_start_matches("localhost");
                bail!("{url}: name files of this machine by their path, as {name}")
            }
            _ => bail!("{}: addresses with {scheme}:// cannot be read; use http, https, or a path", path.display()),
        },
        None if path.is_dir() => bail!("{} is a directory; name a .lodpack file", path.display()),
        // A pipe might never be opened, and has no end to begin with.
        None if std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) => {
            bail!("{} is a device or pipe; name a .lodpack file", path.display())
        }
        None => Arc::new(std::fs::File::open(path).with_context(|| format!("cannot open {}", path.display()))?),
    })
}

/// The ground of a file as a file of heights of its own, with requests that are counted apart, and how it lies under
/// the mesh; none if the file has none.
pub fn open_ground(path: &Path, file: &File<Source>) -> Result<Option<(Heights<Source>, GroundFrame)>> {
    match file.index().ground_range() {
        Some(_) => open_ground_in(path, source_of(path)?, file),
        None => Ok(None),
    }
}

/// [`open_ground`], given the source of the path.
pub fn open_ground_in(
    path: &Path,
    source: AnySource,
    file: &File<Source>,
) -> Result<Option<(Heights<Source>, GroundFrame)>> {
    let Some(range) = file.index().ground_range() else { return Ok(None) };
    let source: Box<dyn ReadAt + Send + Sync> = Box::new(Within::new(source, range));
    let Ground { heights, frame } = in_file(path, Ground::within(file.index(), Counting::new(source)))?;
    Ok(Some((heights, frame)))
}

/// Why lengths with a unit mean nothing, and what to do.
const NO_UNIT: &str = "this file does not record the unit of its coordinates (build records --unit beside --up, --crs or --origin); \
    give --tolerance in input units (0.05)";

/// A tolerance in the units of a grid of heights.
pub fn tolerance_in_heights(file: &Heights<Source>, tolerance: Tolerance) -> Result<f64> {
    match (tolerance, file.placement().and_then(|placement| placement.unit)) {
        (Tolerance::InputUnits(length), _) => Ok(length),
        (Tolerance::Metres(metres), Some(unit)) => Ok(metres / unit),
        (Tolerance::Metres(_), None) => {
            bail!("{NO_UNIT}")
        }
        _ => bail!("the tolerance of a grid of heights is a length, as 0.5 or 20cm"),
    }
}

/// A tolerance in the units of a file.
pub fn tolerance_in(file: &File<Source>, tolerance: Tolerance) -> Result<f64> {
    let diagonal =
        |[low, high]: [[f64; 3]; 2]| (0..3).map(|k| (high[k] - low[k]) * (high[k] - low[k])).sum::<f64>().sqrt();
    let unit = file.placement().and_then(|placement| placement.unit);
    match tolerance {
        Tolerance::InputUnits(length) => Ok(length),
        Tolerance::OfDiagonal(fraction) => Ok(fraction * file.bounds().map_or(0.0, diagonal)),
        Tolerance::OfMeanEdge(factor) => Ok(factor * file.source_info().map_or(0.0, |source| source.mean_edge_length)),
        Tolerance::Metres(metres) if unit.is_some() => Ok(metres / unit.unwrap_or(1.0)),
        Tolerance::Auto | Tolerance::OfBend(_) | Tolerance::Metres(_) => bail!(
            "{NO_UNIT}, as a share of the diagonal \
             (0.1%) or in mean edges (0.4edge)"
        ),
    }
}

/// Adds the file's name to an error of reading it, and advice if it is damaged.
pub fn in_file<T>(path: &Path, answer: lodpack::Result<T>) -> Result<T> {
    answer.map_err(|error| named(path, error))
}

fn named(path: &Path, error: lodpack::Error) -> Error {
    let is_damage = matches!(error, lodpack::Error::Format { .. });
    let error = Error::new(error).context(path.display().to_string());
    match is_damage {
        true => anyhow!(
            "{}; copy, download or build it again (`lodpack verify {}` shows what is damaged)",
            messages::with_reasons(&error),
            shell(path)
        ),
        false => error,
    }
}

/// What a file with this beginning is, and what to do.
fn described(start: &[u8]) -> String {
    let text = start.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(start).trim_ascii_start();
    let has = |word: &str| text.get(..word.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(word.as_bytes()));
    let is_mesh = ["ply", "off", "coff", "noff", "solid", "glTF", "v ", "o ", "# "].into_iter().any(has)
        || text.starts_with(b"{");
    match start {
        [] => "it is empty; copy or build it again".into(),
        _ if has("<!doctype") || has("<html") || has("<?xml") => {
            "it is a web page; check the address, and whether the server asks for a login".into()
        }
        _ if is_tiff(start) => {
            "it looks like a GeoTIFF; build a lodpack file from its heights with `lodpack build`".into()
        }
        _ if is_mesh => "it looks like a mesh; build a lodpack file from it with `lodpack build`".into(),
        [0x1f, 0x8b, ..] | [b'P', b'K', 3, 4, ..] => "it is compressed; unpack it first".into(),
        _ => format!("it begins with \"{}\"", start[..start.len().min(16)].escape_ascii()),
    }
}

/// The scheme of an address, in lower case, and the whole address; none for a path.
fn address(text: &str) -> Option<(String, String)> {
    let (scheme, rest) = text.split_once("://")?;
    // A single letter is a drive.
    let is_scheme = scheme.len() > 1 && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric());
    let scheme = scheme.to_ascii_lowercase();
    is_scheme.then(|| (scheme.clone(), format!("{scheme}://{rest}")))
}

#[cfg(feature = "object-store")]
fn open_object(url: &str) -> Result<Box<dyn ReadAt + Send + Sync>> {
    Ok(Box::new(lodpack::source::Object::open(url)?))
}

#[cfg(not(feature = "object-store"))]
fn open_object(url: &str) -> Result<Box<dyn ReadAt + Send + Sync>> {
    bail!("{url}: this lodpack was built without the feature object-store; download the file, or use its https address")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_differ_from_paths_and_schemes_have_no_case() {
        assert_eq!(address("HTTP://Host/A"), Some(("http".into(), "http://Host/A".into())));
        assert_eq!(address("C://file"), None);
        assert_eq!(address("folder/file"), None);
    }

    #[test]
    fn other_files_are_recognised_by_their_beginning() {
        for (start, word) in [
            (&b"<!DOCTYPE html><html>"[..], "web page"),
            (b"\n  <html lang=en>", "web page"),
            (b"ply\nformat ascii 1.0", "lodpack build"),
            (b"{\"asset\":", "lodpack build"),
            (b"\x1f\x8b\x08", "unpack"),
            (b"", "empty"),
            (b"\x00\x01", "\\x00\\x01"),
        ] {
            assert!(described(start).contains(word), "{start:?}: {}", described(start));
        }
    }
}
