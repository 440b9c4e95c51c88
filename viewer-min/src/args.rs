//! The command line.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Parser, ValueEnum};
use lodpack::View;

use crate::camera::{Extent, circling, parse, path_from_json, whole};

/// How roots become triangles on the screen (Niski 2007, sections 5.1.1 and 5.1.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Way {
    /// The CPU stitches index lists, with cached borders.
    #[default]
    Stitched,
    /// The vertex shader pulls block data and snaps borders.
    Pulled,
}

/// How several devices share a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Cuts {
    /// So that all devices draw as many triangles.
    #[default]
    Balanced,
    /// Into parts of one width.
    Equal,
}

/// Layers over the plain surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Overlay {
    /// Edges of triangles.
    Wire,
    /// One colour per node.
    Nodes,
    /// Blue where coarse, red where fine.
    Levels,
    /// Green below the tolerance, yellow at it, red above.
    Errors,
    /// One colour for each depth in the tree: blue at the top.
    Depths,
    /// Arcs, the borders between roots.
    #[value(alias = "seams")]
    Borders,
    /// Counters and frame times.
    Text,
    /// The keys and what they do.
    Keys,
}

/// The keys and what they do, for `--help` and the window.
pub const KEY_CARD: &str = "\
Keys in the window
  drag left, touchpad   orbit             W A S D Q E   fly
  drag right            look around       wheel         nearer, farther
  + -   tolerance half, double            T U           triangle budget double, half
  N M   node budget double, half          P             hold a frame rate
  1 2 3 4 5   shading, nodes, levels, errors, depths
  G   next channel, or none              K             channel with or without light
  L   wireframe      B   borders          V             stitched or pulled
  F   freeze the cut                      I             counters
  X   screenshot     R   record a path    C             camera: recent, back
  O   whole model    Y   read again what failed
  H   this card      Esc close            drop a file   open it
  click   select an object; then   H   hide it   I   show it alone   J   show all   Esc   select nothing
";

/// The text below the options.
fn more_help() -> String {
    let examples = "Examples:
  lodpack-view scan.lodpack
  lodpack-view https://example.org/scan.lodpack --tolerance 2
  lodpack-view terrain.lodpack bridge.lodpack station.lodpack --max-triangles 1000000
  lodpack-view scan.lodpack --screenshot scan.png --size 1600x1200 --camera 0,0,3:0,0,0
  lodpack-view scan.lodpack --path circle:200 --csv frames.csv
  lodpack-view scan.lodpack --wall 2x2 --listen 0.0.0.0:4600 --path circle:1000
  lodpack-view scan.lodpack --join controller:4600 --place 0,1 --full-screen
  lodpack-view --check scan.lodpack --against scan.ply

Exit status: 0 success; 1 --check found errors; 2 the request could not be carried out.";
    format!("{examples}\n\n{KEY_CARD}")
}

/// Shows .lodpack files, writes pictures of them, and checks that they are drawn correctly.
#[derive(Clone, Debug, Parser)]
#[command(version, args_override_self = true, after_help = more_help(), after_long_help = more_help())]
pub struct Args {
    /// Files or URLs, drawn into one picture; without one, the window waits for a file to be dropped
    #[arg(value_name = "FILE")]
    pub files: Vec<String>,
    /// Write a picture and exit, without a window; {n} in its name writes one for each frame
    #[arg(long, value_name = "PNG")]
    pub screenshot: Option<PathBuf>,
    /// Size of the picture or window in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1024x768")]
    pub size: Size,
    /// position:target, or position:target:up, or position:target:up:degrees; the first three as x,y,z
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true)]
    pub camera: Option<String>,
    /// Up axis: x, y or z; without this option the axis that the file says, or else z for heights, and y for anything
    /// else
    #[arg(long, value_name = "AXIS", value_parser = ["x", "y", "z"])]
    pub up: Option<String>,
    /// Draw all frames of a recorded path, or of a built-in one with N frames
    #[arg(long, value_name = "JSON|circle:N")]
    pub path: Option<String>,
    /// Write the times and counters of each frame (- for standard output)
    #[arg(long, value_name = "CSV")]
    pub csv: Option<PathBuf>,
    /// Wait in each frame until everything is loaded; pictures of a single camera always wait
    #[arg(long)]
    pub wait: bool,
    /// How roots become triangles
    #[arg(long, value_enum, default_value = "stitched")]
    pub draw: Way,
    /// Tolerated screen error in pixels
    #[arg(long, value_name = "PIXELS", default_value = "1")]
    pub tolerance: f64,
    /// Most triangles to draw
    #[arg(long, value_name = "N")]
    pub max_triangles: Option<u64>,
    /// Most nodes to draw
    #[arg(long, value_name = "N")]
    pub max_nodes: Option<u64>,
    /// Frames a second to hold, by budgets that follow from what frames take; key P in the window
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub frame_rate: Option<f64>,
    /// Layers over the surface, separated by commas
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',')]
    pub overlay: Vec<Overlay>,
    /// Channel to show, or none; without this option the first one of colours, if the file has one
    #[arg(long, value_name = "NAME|none")]
    pub channel: Option<String>,
    /// Values that get the first and the last colour of the ramp, for channels of numbers
    #[arg(long, value_name = "LOW:HIGH", value_parser = parse_range, allow_hyphen_values = true)]
    pub range: Option<[f64; 2]>,
    /// Show the channel without light
    #[arg(long)]
    pub unlit: bool,
    /// Shade triangles flat where the file stores no normals, instead of smoothly
    #[arg(long)]
    pub flat: bool,
    /// Do not draw the objects of this name or id, or number (#12); may come several times
    #[arg(long, value_name = "NAME|ID|#N")]
    pub hide: Vec<String>,
    /// Draw only the objects of this name or id, or number; may come several times
    #[arg(long, value_name = "NAME|ID|#N")]
    pub only: Vec<String>,
    /// Select the object of this name or id, or number; without --camera, look at it
    #[arg(long, value_name = "NAME|ID|#N")]
    pub find: Option<String>,
    /// Draw one tile of the picture: tile X,Y of WxH tiles, counted from the upper left corner
    #[arg(long, value_name = "X,Y/WxH", value_parser = parse_tile, overrides_with = "tiles")]
    pub tile: Option<Tile>,
    /// Draw the picture in WxH tiles, one process each, join them, and compare with the whole picture (1x1: no tiles)
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub tiles: Option<Size>,
    /// Fill the screen
    #[arg(long)]
    pub full_screen: bool,
    /// Control a wall of WxH displays, each a process of its own; --size is that of all together. With --path without a
    /// window
    #[arg(long, value_name = "WxH", value_parser = parse_wall, requires = "listen")]
    pub wall: Option<Size>,
    /// Where the displays of --wall reach the controller, for instance 0.0.0.0:4600; nobody is asked for a password
    #[arg(long, value_name = "HOST:PORT", requires = "wall")]
    pub listen: Option<String>,
    /// Be a display of the wall whose controller listens there; with --screenshot without a window
    #[arg(long, value_name = "HOST:PORT", conflicts_with = "wall")]
    pub join: Option<String>,
    /// Which display to be, column and row from the upper left one; without this option any that is missing
    #[arg(long, value_name = "X,Y", value_parser = parse_place, requires = "join")]
    pub place: Option<Size>,
    /// Draw each picture with N devices side by side, with --screenshot or --csv
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64), default_value = "1")]
    pub devices: u8,
    /// How the picture is divided among --devices
    #[arg(long, value_enum, default_value = "balanced")]
    pub cuts: Cuts,
    /// Check the drawing; exit status 0: correct, 1: wrong, 2: could not be checked
    #[arg(long)]
    pub check: bool,
    /// The mesh from which the file was built (PLY), for --check
    #[arg(long, value_name = "MESH", requires = "check")]
    pub against: Option<PathBuf>,
    /// Number of views to check
    #[arg(long, value_name = "N", default_value = "200", value_parser = parse_views, allow_negative_numbers = true)]
    pub views: usize,
    /// Folder for the difference pictures of failed checks
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    pub difference: PathBuf,
    /// Frames that the device may have before another is begun, for measuring: with 1 nothing overlaps
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=3), default_value = "2", hide = true)]
    pub in_flight: u8,
    /// Lose the graphics device at a frame, for tests
    #[arg(long, value_name = "N", hide = true)]
    pub lose_device: Option<u64>,
}

/// Width and height.
pub type Size = [u32; 2];
/// Which tile, and of how many.
pub type Tile = [Size; 2];

fn parse_pair(text: &str, separator: char, least: u32, explain: &'static str) -> Result<Size, &'static str> {
    let (a, b) = text.split_once(separator).ok_or(explain)?;
    let number = |text: &str| text.parse().ok().filter(|n| (least..=16384).contains(n)).ok_or(explain);
    Ok([number(a)?, number(b)?])
}

fn parse_size(text: &str) -> Result<Size, &'static str> {
    parse_pair(text, 'x', 1, "a size is WxH, both from 1 to 16384")
}

fn parse_range(text: &str) -> Result<[f64; 2], &'static str> {
    let explain = "a range is LOW:HIGH, the lower one first";
    let (low, high) = text.split_once(':').ok_or(explain)?;
    let number = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.is_finite()).ok_or(explain);
    let range = [number(low)?, number(high)?];
    if range[0] < range[1] { Ok(range) } else { Err(explain) }
}

fn parse_rate(text: &str) -> Result<f64, &'static str> {
    text.parse().ok().filter(|rate| (0.1..=1000.0).contains(rate)).ok_or("a frame rate is a number from .1 to 1000")
}

fn parse_views(text: &str) -> Result<usize, &'static str> {
    text.parse()
        .ok()
        .filter(|&views| views > 0)
        .ok_or("the number of views must be 1 or more; with none, nothing would be checked")
}

/// A wall has so many displays at most.
const MOST_DISPLAYS: u32 = 1024;

fn parse_wall(text: &str) -> Result<Size, &'static str> {
    let size = parse_size(text)?;
    if size[0] * size[1] <= MOST_DISPLAYS { Ok(size) } else { Err("a wall has at most 1024 displays") }
}

fn parse_place(text: &str) -> Result<Size, &'static str> {
    parse_pair(text, ',', 0, "a place is X,Y")
}

fn parse_tile(text: &str) -> Result<Tile, &'static str> {
    let explain = "a tile is X,Y/WxH";
    let (at, counts) = text.split_once('/').ok_or(explain)?;
    Ok([parse_pair(at, ',', 0, explain)?, parse_size(counts)?])
}

impl Default for Args {
    fn default() -> Self {
        Self::parse_from([""])
    }
}

impl Args {
    /// Whether a layer is drawn over the surface.
    pub(crate) fn has(&self, overlay: Overlay) -> bool {
        self.overlay.contains(&overlay)
    }

    /// How roots are drawn. Lines need pulling.
    pub(crate) fn way(&self) -> Way {
        if self.has(Overlay::Wire) || self.has(Overlay::Borders) { Way::Pulled } else { self.draw }
    }

    /// The view from a camera, with the tolerance as set.
    pub(crate) fn view(&self, from: View) -> View {
        View { viewport: self.size, pixel_tolerance: self.tolerance, ..from }
    }

    /// The view that shows the whole model.
    pub(crate) fn whole_model(&self, Extent { bounds, up, near_share }: Extent) -> View {
        let up = self.up.as_deref().unwrap_or(up);
        let up = ["x", "y", "z"].map(|axis| f64::from(u8::from(up == axis)));
        let view = whole(bounds, up, f64::from(self.size[0]) / f64::from(self.size[1].max(1)));
        self.view(View { near: view.near * near_share, ..view })
    }

    /// The view from --camera; without it, one that shows the whole model.
    pub(crate) fn first_view(&self, extent: Extent) -> Result<View> {
        let default = self.whole_model(extent);
        self.camera.as_ref().map_or(Ok(default), |text| parse(text, &default))
    }

    /// The views of all frames.
    pub(crate) fn views(&self, extent: Extent) -> Result<Vec<View>> {
        let first = self.first_view(extent)?;
        let Some(path) = &self.path else { return Ok(vec![first]) };
        let Some(count) = path.strip_prefix("circle:") else {
            let json = std::fs::read_to_string(path).with_context(|| format!("{path} cannot be read"))?;
            return path_from_json(&json, &first).with_context(|| path.clone());
        };
        let count = count.parse().ok().filter(|count| (1..=1_000_000).contains(count));
        let path = circling(extent.bounds, first.up, count.context("circle:N needs the number of frames N")?);
        Ok(path.into_iter().map(|view| self.view(view)).collect())
    }
}

#[cfg(test)]
mod tests {
    use lodpack::index::UpAxis;

    use super::*;
    use crate::camera::Subject;

    #[test]
    fn a_file_is_shown_with_the_axis_up_that_it_says_unless_another_one_is_typed() {
        let shown = |up: UpAxis, typed: &[&str]| {
            let words = [&["lodpack-view", "a.lodpack"][..], typed].concat();
            let extent = Extent::of([[0.0; 3], [3.0, 2.0, 1.0]], Subject::Mesh { up, has_ground: false });
            Args::try_parse_from(words).expect("sound").whole_model(extent)
        };
        let [y, z] = [UpAxis::Y, UpAxis::Z].map(|up| shown(up, &[]));
        assert_eq!((y.up, z.up), ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]));
        assert_ne!(y, z);
        assert_eq!((shown(UpAxis::Z, &["--up", "z"]), shown(UpAxis::Z, &["--up", "y"])), (z, y));
        assert_eq!((shown(UpAxis::Y, &["--up", "z"]), shown(UpAxis::Unknown, &[])), (z, y));
        for subject in [Subject::Heights, Subject::Mesh { up: UpAxis::Unknown, has_ground: true }] {
            assert_eq!(Extent::of([[0.0; 3], [1.0; 3]], subject).up, "z");
        }
    }
}
