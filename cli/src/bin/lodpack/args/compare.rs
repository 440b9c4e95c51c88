//! Arguments of `compare`.

use super::raster::RasterArgs;
use super::values::{LevelChoice, ProgressStyle, UpAxis, parse_share, parse_threads};
use clap::Args;
use lodpack_cli::mesh::tolerance::Tolerance;
use std::path::PathBuf;

/// Arguments of `compare`.
#[derive(Args, Debug)]
pub struct CompareArgs {
    /// A surface: a mesh or a raster of heights as `lodpack build` reads it, a .lodpack file (path or address), glTF
    /// with levels (MSFT_lod), a tileset (tileset.json or .3tz), or terrain tiles (layer.json). Of levels, A is the
    /// finest.
    pub a: PathBuf,
    /// Another one. Both are held in memory, a level of B at a time: some 200 bytes a triangle.
    pub b: PathBuf,
    /// The levels of B: all, finest, or the number of one. By default the finest of a .lodpack file, and all of
    /// everything else.
    #[arg(long, value_name = "all|finest|N")]
    pub level: Option<LevelChoice>,
    /// In place of --level: what B draws where this error is asked for, in its units.
    #[arg(long, value_name = "T", allow_hyphen_values = true, conflicts_with = "level")]
    pub tolerance: Option<Tolerance>,
    /// How far the bounds of a distance may be apart, as a share of it.
    #[arg(long, value_name = "SHARE", default_value = "1%", value_parser = parse_share)]
    pub gap: f64,
    /// Points on each surface for root mean squares.
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = clap::value_parser!(u32).range(100..=100_000_000))]
    pub samples: u32,
    /// Where A goes before it is compared: 16 numbers, column after column as in 3D Tiles, in place of what the files
    /// say of their axes, units and places.
    #[arg(long, value_name = "NUMBERS", allow_hyphen_values = true, value_parser = parse_matrix)]
    pub matrix: Option<[f64; 16]>,
    /// The axis of a mesh that points up, where the other surface is a tileset. By default as `lodpack export` takes
    /// it.
    #[arg(long, value_enum)]
    pub up: Option<UpAxis>,
    /// Leave places on the globe out, as `lodpack export --local` does.
    #[arg(long)]
    pub local: bool,
    /// Worker threads; 0 takes all cores.
    #[arg(long, default_value_t = 0, value_parser = parse_threads)]
    pub threads: usize,
    /// How to show progress.
    #[arg(long, value_enum, default_value_t, value_name = "STYLE")]
    pub progress: ProgressStyle,
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub raster: RasterArgs,
}

/// Sixteen numbers between commas or blanks.
fn parse_matrix(text: &str) -> Result<[f64; 16], String> {
    let words = text.split([',', ' ', '[', ']']).filter(|word| !word.is_empty());
    let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
    let numbers = numbers.ok().filter(|numbers| numbers.iter().all(|x| x.is_finite()));
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| "a matrix is 16 numbers".to_owned())
}
