//! What a file of heights holds.

use super::super::info::PlacementInfo;
use super::super::open::{Source, in_file};
use super::super::print_json;
use super::image_line;
use crate::args::InfoArgs;
use crate::output::{bound, bytes, count, length, say};
use anyhow::Result;
use lodpack::ReadAt;
use lodpack::heights::{Base, Heights, TileId};
use serde::Serialize;

/// Without `--why`, tables end at this depth: its tiles are known as soon as the file is open.
const FIRST_DEPTHS: u32 = 4;

#[derive(Serialize)]
struct Info {
    /// "heights".
    holds: &'static str,
    generator: String,
    bytes: u64,
    samples: u64,
    /// Columns and rows of cells.
    cells: [u64; 2],
    bits_per_sample: f64,
    /// "plane", "sphere" or "ellipsoid".
    surface: &'static str,
    /// Of the first sample: x and y, or degrees.
    first: [f64; 2],
    /// To the next column and the next row.
    spacing: [f64; 2],
    /// Whether the grid closes around the globe.
    wraps: bool,
    /// Whether the first and the last row are a pole.
    poles: [bool; 2],
    lowest: f64,
    highest: f64,
    step: f64,
    sample_error: f64,
    ramp: Option<RampInfo>,
    /// The image over the heights.
    drape: Option<DrapeInfo>,
    placement: Option<PlacementInfo>,
    depths: Vec<Depth>,
    depth_count: u32,
    /// Tiles from which everything below follows, as far as the depths are shown.
    level_tiles: u64,
    bytes_read: u64,
    requests: u64,
}

/// Colours by height.
#[derive(Serialize)]
struct RampInfo {
    name: String,
    /// Height, and red, green and blue from 0 to 255.
    stops: Vec<(f64, [u8; 3])>,
}

/// An image.
#[derive(Serialize)]
struct DrapeInfo {
    /// Texels in a row, and rows.
    size: [u64; 2],
    /// 3, or 4 with opacity.
    components: u8,
    /// Columns and rows of samples from a texel to the next one.
    spacing: [f64; 2],
    /// Of the centre of its first texel: column and row of samples.
    first: [f64; 2],
    bytes: u64,
    bits_per_texel: f64,
}

/// The tiles of a depth.
#[derive(Default, Serialize)]
struct Depth {
    tiles: u64,
    block_bytes: u64,
    /// Those of them from which everything below follows.
    level_tiles: u64,
    /// At the coarsest and the finest resolution.
    triangles: [u64; 2],
    /// The largest errors of these.
    errors: [f64; 2],
}

/// Prints what a file holds.
pub fn run(file: &Heights<Source>, args: &InfoArgs) -> Result<()> {
    let mut depths: Vec<Depth> = vec![];
    let last = if args.why { u32::MAX } else { FIRST_DEPTHS - 1 };
    let mut range = [i32::MAX, i32::MIN];
    for &root in file.roots() {
        in_file(&args.file, walk(file, root, last, &mut depths))?;
        if let Some(record) = in_file(&args.file, file.record(root))? {
            range = [range[0].min(record.lowest), range[1].max(record.highest)];
        }
    }
    let (about, grid, surface) = (file.info(), file.grid(), file.surface());
    let [columns, rows] = grid.samples();
    let total = in_file(
        &args.file,
        file.source().size().map_err(|source| lodpack::Error::Io { offset: 0, length: 0, source }),
    )?;
    let drape = file.drape().map(|drape| {
        let bytes = file.index().drape_bytes();
        DrapeInfo {
            size: drape.size,
            components: drape.components,
            spacing: drape.spacing,
            first: drape.first,
            bytes,
            bits_per_texel: 8.0 * bytes as f64 / (drape.size[0] as f64 * drape.size[1] as f64),
        }
    });
    let of_heights = total - drape.as_ref().map_or(0, |drape| drape.bytes.min(total));
    let info = Info {
        holds: "heights",
        generator: file.source_info().map(|source| source.generator.clone()).unwrap_or_default(),
        bytes: total,
        samples: columns * rows,
        cells: grid.cells(),
        bits_per_sample: 8.0 * of_heights as f64 / (columns as f64 * rows as f64),
        surface: match surface.base {
            Base::Plane => "plane",
            Base::Ellipsoid { eccentricity: 0.0, .. } => "sphere",
            Base::Ellipsoid { .. } => "ellipsoid",
        },
        first: surface.first,
        spacing: surface.spacing,
        wraps: grid.wraps(),
        poles: grid.poles(),
        lowest: about.height(range[0]),
        highest: about.height(range[1]),
        step: about.step,
        sample_error: about.sample_error,
        ramp: file.ramp().map(|ramp| RampInfo {
            name: about.ramp.clone(),
            stops: ramp.stops().iter().map(|stop| (stop.height, stop.colour)).collect(),
        }),
        drape,
        placement: file.placement().map(PlacementInfo::new),
        level_tiles: depths.iter().map(|depth| depth.level_tiles).sum(),
        depths,
        depth_count: grid.depth() + 1,
        bytes_read: file.source().byte_count(),
        requests: file.source().read_count(),
    };
    if args.json { print_json(&info) } else { print(&info, file, args) }
}

fn walk(file: &Heights<Source>, id: TileId, last: u32, depths: &mut Vec<Depth>) -> lodpack::Result<()> {
    let Some(record) = file.record(id)? else { return Ok(()) };
    let number = id.depth as usize;
    if depths.len() <= number {
        depths.resize_with(number + 1, Depth::default);
    }
    let depth = &mut depths[number];
    depth.tiles += 1;
    depth.block_bytes += record.block_bytes;
    depth.level_tiles += u64::from(record.is_level);
    for (k, resolution) in [record.resolutions.first(), record.resolutions.last()].into_iter().flatten().enumerate() {
        depth.triangles[k] += u64::from(resolution.triangle_count);
        depth.errors[k] = depth.errors[k].max(resolution.error);
    }
    // What follows from level tiles takes no bytes.
    let mut children = record.child_tiles().filter(|child| child.depth <= last && !record.is_level);
    children.try_for_each(|child| walk(file, child, last, depths))
}

fn print(info: &Info, file: &Heights<Source>, args: &InfoArgs) -> Result<()> {
    say!("{}: a grid of heights, written by {}", args.file.display(), info.generator);
    say!("  grid       {} samples, {} x {} cells", count(info.samples), count(info.cells[0]), count(info.cells[1]));
    say!("  surface    {}, {}", info.surface, super::reach(file));
    if info.wraps || info.poles.contains(&true) {
        let poles = ["no pole", "the north pole", "the south pole", "both poles"];
        let poles = poles[usize::from(info.poles[0]) + 2 * usize::from(info.poles[1])];
        say!("  globe      {}, with {poles}", if info.wraps { "closed" } else { "open" });
    }
    if let Some(placement) = &info.placement {
        say!("  place      {}", placement.text());
    }
    say!("  heights    {} to {}, in steps of {}", length(info.lowest), length(info.highest), length(info.step));
    if let Some(ramp) = &info.ramp {
        say!("  ramp       {}, {} colours", ramp.name, count(ramp.stops.len() as u64));
    }
    if let Some(drape) = &info.drape {
        say!("{}", image_line(drape.size, drape.components, drape.bytes));
    }
    say!("  error      samples {} at most", bound(info.sample_error));
    say!("  size       {}, {:.2} bits per sample", bytes(info.bytes), info.bits_per_sample);
    for (number, depth) in info.depths.iter().enumerate() {
        say!(
            "  depth {number:<4} {:>9} tiles, {:>12} to {} triangles, error {} to {}, {}",
            count(depth.tiles),
            count(depth.triangles[0]),
            count(depth.triangles[1]),
            bound(depth.errors[0]),
            bound(depth.errors[1]),
            bytes(depth.block_bytes)
        );
    }
    if info.level_tiles > 0 {
        say!("  level      {} tiles, from which all below them follow", count(info.level_tiles));
    }
    if info.depths.len() < info.depth_count as usize && !args.why {
        say!("  ({} depths in all; --why shows them, and reads the whole index)", info.depth_count);
    }
    say!("  read       {} in {} requests", bytes(info.bytes_read), info.requests);
    Ok(())
}
