//! TIFF, GeoTIFF and cloud-optimised GeoTIFF, in strips or tiles, through the crate `tiff`. The first image counts; the
//! others are overviews and masks.

mod rows;

use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

use ::tiff::decoder::Decoder;
use ::tiff::tags::Tag;
use ::tiff::{TiffError, TiffUnsupportedError};

use self::rows::{REMEDY, TiffRows, ViewDecoder};
use super::affine::{Affine, placed};
use super::crs::{Crs, unit_named};
use super::geokeys::{GDAL_METADATA, GEO_DOUBLES, GEO_TEXTS, GeoTags};
use super::header::{Header, HeightRows};
use super::mask::Masked;
use super::pam::Pam;
use super::{ImportError, Parsed, grid_error};
use crate::error::Location;
use lodpack_mesh::images::tiff_compression_name;
use lodpack_mesh::images::tiff_directory::{
    BITS_PER_SAMPLE, Directory, EXTRA_SAMPLES, PHOTOMETRIC, SAMPLE_FORMAT, SAMPLES_PER_PIXEL, is_tiff,
};

const MODEL_PIXEL_SCALE: u16 = 33550;
const MODEL_TIEPOINT: u16 = 33922;
const MODEL_TRANSFORMATION: u16 = 34264;
const GEO_KEY_DIRECTORY: u16 = 34735;
const GDAL_NODATA: u16 = 42113;

/// Opens a TIFF, without what its own masks leave out if these count.
pub(super) fn open(path: &Path, with_masks: bool) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let images = directories(path)?;
    let [image, others @ ..] = &images[..] else { return Err(grid_error(path, "has no image")) };
    let has_alpha = alpha_of(path, image)?;
    let mut rows = TiffRows::open(path, image, 0)?;
    let decoder = &mut rows.decoder;
    let mut header = Header::new(rows.size);
    let (tags, mut pam) = (tags_of(decoder), Pam::beside(path)?);
    let (place, crs) = placed_by(&tags, &mut pam, path)?;
    (header.place, header.turned) = placed(place, path, header.size)?;
    header.crs = crs;
    let text = |decoder: &mut ViewDecoder, tag| decoder.get_tag_ascii_string(Tag::Unknown(tag)).unwrap_or_default();
    header.nodata = text(decoder, GDAL_NODATA).trim_matches(['\0', ' ']).parse().ok();
    let metadata = text(decoder, GDAL_METADATA);
    header.scale = scale_of(&metadata);
    match unit_named(item(&metadata, "unittype").unwrap_or_default()) {
        Ok(metres) => header.vertical = metres,
        Err(remark) => header.crs.remarks.push(remark),
    }
    pam.add_to(&mut header, true);
    let is_float = image.get(SAMPLE_FORMAT) == Some(3);
    header.is_f32 = is_float && image.get(BITS_PER_SAMPLE) == Some(32);
    header.is_integer = !is_float;
    rows.empty = header.nodata.unwrap_or(f64::NAN);
    let mut rows: Box<dyn HeightRows> = Box::new(rows);
    if has_alpha && with_masks {
        rows = Masked::over(rows, mask_rows(path, image, 1, header.size)?);
    }
    if let Some(mask) = others.iter().find(|image| with_masks && image.is_mask()) {
        rows = Masked::over(rows, mask_rows(path, mask, 0, header.size)?);
    }
    Ok((header, rows))
}

/// The directories of a file.
fn directories(path: &Path) -> Parsed<Vec<Directory>> {
    let io = |source| ImportError::Io { path: path.to_owned(), source };
    let (mut file, mut all) = (BufReader::new(File::open(path).map_err(io)?), vec![]);
    match Directory::read_all(&mut file, &mut all) {
        Ok(()) => Ok(all),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
            let (path, location) = (path.to_owned(), Location::Item("image", all.len() as u64));
            let missing = "the TIFF names a list of entries behind the end of the file".to_owned();
            Err(ImportError::Truncated { path, location, missing }.into())
        }
        Err(error) => Err(io(error).into()),
    }
}

/// Refuses what is no single band of heights; says whether a second one is how opaque each sample is.
fn alpha_of(path: &Path, image: &Directory) -> Parsed<bool> {
    let samples = image.get(SAMPLES_PER_PIXEL).unwrap_or(1);
    let what = match (image.get(PHOTOMETRIC), samples) {
        // White or black is zero.
        (None | Some(0 | 1), 1) => return Ok(false),
        (None | Some(0 | 1), 2) if matches!(image.get(EXTRA_SAMPLES), Some(1 | 2)) => return Ok(true),
        (None | Some(0 | 1), count) => format!("{count} bands"),
        (Some(3), _) => "numbers of colours in a palette".to_owned(),
        (Some(4), _) => "a mask".to_owned(),
        (_, count) => format!("colours of {count} bands"),
    };
    let problem = format!(
        "has no single band of heights but {what}; take out the band with heights first, with `gdal_translate -b`, or pass it as --drape"
    );
    Err(grid_error(path, &problem))
}

/// The rows of a file that is a mask of another one of a size.
pub(super) fn open_mask(path: &Path, size: [u32; 2]) -> Parsed<Box<dyn HeightRows>> {
    let images = directories(path)?;
    let Some(image) = images.first() else { return Err(grid_error(path, "has no image")) };
    mask_rows(path, image, 0, size)
}

/// A sample of each pixel of an image as a mask: where nothing is stored, nothing counts.
fn mask_rows(path: &Path, image: &Directory, sample: usize, size: [u32; 2]) -> Parsed<Box<dyn HeightRows>> {
    let mut rows = TiffRows::open(path, image, sample)?;
    if rows.size != size {
        let ([columns, rows], [own_columns, own_rows]) = (size, rows.size);
        let problem = format!(
            "has a mask of {own_columns} x {own_rows} samples over {columns} x {rows}: a mask needs as many; make it again, or remove it"
        );
        return Err(grid_error(path, &problem));
    }
    rows.empty = 0.0;
    Ok(Box::new(rows))
}

/// What the tags of an image and the metadata beside it say about its place and its system, if it is a TIFF, and
/// whether it has a mask of its own. Its kind of pixels does not matter.
pub(super) fn place_of_image(path: &Path, pam: &mut Pam) -> Parsed<Option<(Option<Affine>, Crs, bool)>> {
    let io = |source| ImportError::Io { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(io)?;
    let mut start = [0; 4];
    file.read(&mut start).and_then(|_| file.rewind()).map_err(io)?;
    if !is_tiff(&start) {
        return Ok(None);
    }
    let fault = |error| damaged(path, Location::Byte(0), error);
    let mut decoder = Decoder::new(BufReader::new(file)).map_err(fault)?;
    let has_mask = directories(path)?.iter().skip(1).any(Directory::is_mask);
    let (place, crs) = placed_by(&tags_of(&mut decoder), pam, path)?;
    Ok(Some((place, crs, has_mask)))
}

/// The mask that an image of a size has of its own, and the number that pixels without data have, if it is a TIFF.
#[expect(clippy::type_complexity, reason = "a pair that is used once")]
pub(super) fn opacity_of_image(path: &Path, size: [u32; 2]) -> Parsed<(Option<Box<dyn HeightRows>>, Option<f64>)> {
    let io = |source| ImportError::Io { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(io)?;
    let mut start = [0; 4];
    file.read(&mut start).and_then(|_| file.rewind()).map_err(io)?;
    if !is_tiff(&start) {
        return Ok((None, None));
    }
    let fault = |error| damaged(path, Location::Byte(0), error);
    let mut decoder = Decoder::new(BufReader::new(file)).map_err(fault)?;
    let nodata = decoder.get_tag_ascii_string(Tag::Unknown(GDAL_NODATA)).unwrap_or_default();
    let nodata = nodata.trim_matches(['\0', ' ']).parse().ok();
    // Smaller images have masks, too.
    let images = directories(path)?;
    let is_own = |image: &&Directory| image.is_mask() && image.size() == size.map(u64::from);
    let mask = images.iter().skip(1).find(is_own).map(|image| mask_rows(path, image, 0, size));
    Ok((mask.transpose()?, nodata))
}

/// The place and the system that GDAL's metadata beside a TIFF say, or else its tags: whoever has written these later
/// could not change the file.
fn placed_by(tags: &GeoTags, pam: &mut Pam, path: &Path) -> Parsed<(Option<Affine>, Crs)> {
    let place = pam.place.map_or_else(|| tags.place(path), |place| Ok(Some(place)))?;
    let said = std::mem::take(&mut pam.crs);
    Ok((place, if said.says_nothing() { tags.crs(path)? } else { said }))
}

fn tags_of<R: Read + Seek>(decoder: &mut Decoder<R>) -> GeoTags {
    GeoTags {
        pixel_scale: numbers(decoder, MODEL_PIXEL_SCALE),
        tiepoints: numbers(decoder, MODEL_TIEPOINT),
        transformation: numbers(decoder, MODEL_TRANSFORMATION),
        keys: decoder.get_tag_u16_vec(Tag::Unknown(GEO_KEY_DIRECTORY)).unwrap_or_default(),
        doubles: numbers(decoder, GEO_DOUBLES),
        texts: decoder.get_tag_ascii_string(Tag::Unknown(GEO_TEXTS)).unwrap_or_default(),
    }
}

/// Numbers of a tag; none where there is no such tag or it is damaged.
fn numbers<R: Read + Seek>(decoder: &mut Decoder<R>, tag: u16) -> Vec<f64> {
    decoder.get_tag_f64_vec(Tag::Unknown(tag)).unwrap_or_default()
}

/// Scale and offset in the metadata of GDAL, which has them as `<Item name="SCALE" sample="0" role="scale">0.1</Item>`.
fn scale_of(metadata: &str) -> [f64; 2] {
    let number = |role: &str| item(metadata, role)?.parse::<f64>().ok().filter(|value| value.is_finite());
    [number("scale").unwrap_or(1.0), number("offset").unwrap_or(0.0)]
}

/// What the metadata of GDAL say about a role of the first band.
fn item<'a>(metadata: &'a str, role: &str) -> Option<&'a str> {
    let (_, rest) = metadata.split_once(&format!("role=\"{role}\">"))?;
    Some(rest.split('<').next()?.trim())
}

#[cold]
fn damaged(path: &Path, location: Location, error: TiffError) -> Box<ImportError> {
    let path = path.to_owned();
    match error {
        TiffError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            ImportError::Truncated { path, location, missing: "the TIFF names bytes behind the end of the file".into() }
        }
        TiffError::IoError(source) if source.raw_os_error().is_some() => ImportError::Io { path, source },
        TiffError::UnsupportedError(TiffUnsupportedError::UnsupportedCompressionMethod(method)) => {
            let feature = format!("the compression {}", tiff_compression_name(method));
            ImportError::Unsupported { path, feature, remedy: REMEDY }
        }
        TiffError::UnsupportedError(what) => {
            ImportError::Grid { path, problem: format!("cannot be read: {what}; {REMEDY}") }
        }
        other => {
            let problem = format!("{other}; the TIFF is damaged: copy or export it again");
            ImportError::Syntax { path, location, problem }
        }
    }
    .into()
}
