//! OpenEXR: the samples of one channel, of 16 or 32 bits. Its place comes from `--spacing` or `--bounds`.
//!
//! Blocks of an image may come in any order, so it is held as a whole.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::exr::error::Error;
use ::exr::meta::MetaData;
use ::exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel, Vec2, read};

use super::header::{Header, HeightRows};
use super::{ImportError, Parsed, grid_error};
use crate::error::Location;
use lodpack_mesh::images::unread_exr_compression;

/// An image has at most this many samples: a gigabyte of them.
const MAX_SAMPLES: usize = 1 << 28;
/// Names of the channel with heights, where there are several.
const NAMES: [&str; 4] = ["Z", "Y", "height", "R"];

/// The rows of an image.
struct ExrRows {
    columns: usize,
    samples: Vec<f32>,
}

/// The size of an image, and its samples.
type Read = ([usize; 2], Vec<f32>);

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let fault = |error| damaged(path, error);
    let file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    if let Ok(Some(compression)) = unread_exr_compression(BufReader::new(file)) {
        let (feature, remedy) = (format!("{compression} compression"), "save it again with ZIP compression");
        return Err(ImportError::Unsupported { path: path.to_owned(), feature, remedy }.into());
    }
    let metadata = MetaData::read_from_file(path, false).map_err(fault)?;
    let channels: Vec<String> = match metadata.headers.first() {
        Some(header) => header.channels.list.iter().map(|channel| channel.name.to_string()).collect(),
        None => vec![],
    };
    let named = || NAMES.iter().find_map(|name| channels.iter().find(|channel| channel.as_str() == *name));
    let channel = match &channels[..] {
        [only] => only,
        _ => named().ok_or_else(|| {
            let problem = format!(
                "has the channels {channels:?}, of which none is named {NAMES:?}: rename the one with heights to Z"
            );
            grid_error(path, &problem)
        })?,
    };
    // An image that is too large is refused before anything is allocated for it.
    let create = |Vec2(columns, rows): Vec2<usize>, _: &_| -> Read {
        let count = columns.checked_mul(rows).filter(|&count| count <= MAX_SAMPLES);
        ([columns, rows], vec![f32::NAN; count.unwrap_or(0)])
    };
    let set = |(size, samples): &mut Read, Vec2(column, row): Vec2<usize>, (height,): (f32,)| {
        if let Some(sample) = samples.get_mut(row * size[0] + column) {
            *sample = height;
        }
    };
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required(channel.as_str())
        .collect_pixels(create, set)
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_file(path)
        .map_err(fault)?;
    let (size, samples) = image.layer_data.channel_data.pixels;
    let [Ok(columns), Ok(rows)] = size.map(u32::try_from) else {
        return Err(grid_error(path, "has too many columns or rows; cut it into tiles"));
    };
    if samples.len() != size[0] * size[1] {
        let problem = format!("has {columns} x {rows} samples, but at most {MAX_SAMPLES} are read; cut it into tiles");
        return Err(grid_error(path, &problem));
    }
    let header = Header { is_f32: true, ..Header::new([columns, rows]) };
    Ok((header, Box::new(ExrRows { columns: size[0], samples })))
}

impl HeightRows for ExrRows {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        let rows = self.samples.chunks_exact(self.columns).nth(row as usize);
        heights.iter_mut().zip(rows.into_iter().flatten()).for_each(|(height, &sample)| *height = sample.into());
        Ok(())
    }
}

#[cold]
fn damaged(path: &Path, error: Error) -> Box<ImportError> {
    let path = path.to_owned();
    match error {
        Error::Io(source) if source.raw_os_error().is_some() => ImportError::Io { path, source },
        Error::Io(_) => {
            let missing = "the image's data does not go on".into();
            ImportError::Truncated { path, location: Location::Byte(0), missing }
        }
        Error::NotSupported(what) => ImportError::Unsupported {
            path,
            feature: what.into_owned(),
            remedy: "save it again as scan lines with one channel and ZIP compression",
        },
        other => {
            let problem = format!("{other}; the EXR is damaged: copy or save it again");
            ImportError::Syntax { path, location: Location::Byte(0), problem }
        }
    }
    .into()
}
