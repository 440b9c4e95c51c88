//! What is typed.

use std::path::PathBuf;

use clap::Parser;

use crate::draw::{Colouring, Style, Way};

/// Shows a .lodpack file, writes pictures of it, and checks that what is drawn is right.
#[derive(Clone, Debug, Parser)]
#[command(version, after_help = crate::overlay::KEY_CARD, after_long_help = crate::overlay::KEY_CARD)]
pub struct Args {
    /// File or URL; without one the window waits for a file to be dropped into it
    pub file: Option<String>,
    /// Write a picture and end; no window
    #[arg(long, value_name = "PNG")]
    pub screenshot: Option<PathBuf>,
    /// Pixels of the picture or window
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1024x768")]
    pub size: Size,
    /// position:target[:up[:degrees]], each of the first three as x,y,z
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true)]
    pub camera: Option<String>,
    /// What is up: x, y or z
    #[arg(long, value_name = "AXIS", default_value = "y", value_parser = ["x", "y", "z"])]
    pub up: String,
    /// Draw all frames of a recorded path, or of a built-in one of so many frames
    #[arg(long, value_name = "JSON|circle:N")]
    pub path: Option<String>,
    /// Write what each frame took (- for the standard output)
    #[arg(long, value_name = "CSV")]
    pub csv: Option<PathBuf>,
    /// Frames wait until everything is loaded; pictures of a single camera always do
    #[arg(long)]
    pub wait: bool,
    /// How roots become triangles
    #[arg(long, value_enum, default_value = "stitched")]
    pub draw: Way,
    /// Screen error, pixels
    #[arg(long, value_name = "PIXELS", default_value = "1")]
    pub tolerance: f64,
    /// Most triangles
    #[arg(long, value_name = "N")]
    pub max_triangles: Option<u64>,
    /// Most nodes
    #[arg(long, value_name = "N")]
    pub max_nodes: Option<u64>,
    /// wire, nodes, levels, errors, seams, text; several with commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = ["wire", "nodes", "levels", "errors", "seams", "text"])]
    pub overlay: Vec<String>,
    /// Draw one tile of the picture: tile X,Y of WxH, from the upper left corner
    #[arg(long, value_name = "X,Y/WxH", value_parser = parse_tile)]
    pub tile: Option<Tile>,
    /// Draw the picture in tiles, one process each, join them, and compare with the picture drawn at once
    #[arg(long, value_name = "WxH", value_parser = parse_size, conflicts_with = "tile")]
    pub tiles: Option<Size>,
    /// Check what is drawn; exit code 0: right, 1: wrong, 2: could not be checked
    #[arg(long)]
    pub check: bool,
    /// The mesh that the file was made from (PLY or OBJ), for --check
    #[arg(long, value_name = "MESH", requires = "check")]
    pub against: Option<PathBuf>,
    /// Views that are checked
    #[arg(long, value_name = "N", default_value = "200")]
    pub views: usize,
    /// Where a difference picture is written if a check fails
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    pub difference: PathBuf,
    /// Lose the graphics device at a frame, to see what happens
    #[arg(long, value_name = "N", hide = true)]
    pub lose_device: Option<u64>,
    /// Close the window after so many frames
    #[arg(long, value_name = "N", hide = true)]
    pub frames: Option<u64>,
}

/// Width and height.
pub type Size = [u32; 2];
/// Which tile, of how many.
pub type Tile = [Size; 2];

fn parse_pair(text: &str, separator: char, least: u32, explain: &str) -> Result<Size, String> {
    let (a, b) = text.split_once(separator).ok_or(explain)?;
    let number = |text: &str| text.parse().ok().filter(|n| (least..=16384).contains(n)).ok_or(explain);
    Ok([number(a)?, number(b)?])
}

fn parse_size(text: &str) -> Result<Size, String> {
    parse_pair(text, 'x', 1, "a size is WxH, each 1 to 16384")
}

fn parse_tile(text: &str) -> Result<Tile, String> {
    let explain = "a tile is X,Y/WxH";
    let (at, counts) = text.split_once('/').ok_or(explain)?;
    Ok([parse_pair(at, ',', 0, explain)?, parse_size(counts)?])
}

impl Args {
    /// What is drawn beside the surface, and whether text is.
    pub fn style(&self) -> (Style, bool) {
        let has = |name: &str| self.overlay.iter().any(|overlay| overlay == name);
        let colourings = [("nodes", Colouring::Nodes), ("levels", Colouring::Levels), ("errors", Colouring::Errors)];
        let colouring = colourings.iter().find(|(name, _)| has(name)).map_or(Colouring::Plain, |&(_, c)| c);
        (Style { colouring, wireframe: has("wire"), seams: has("seams") }, has("text"))
    }

    /// How roots are drawn: lines need pulling.
    pub fn way(&self) -> Way {
        let (style, _) = self.style();
        if style.wireframe || style.seams { Way::Pulled } else { self.draw }
    }

    /// The axis that points up.
    pub fn up(&self) -> glam::DVec3 {
        match self.up.as_str() {
            "x" => glam::DVec3::X,
            "z" => glam::DVec3::Z,
            _ => glam::DVec3::Y,
        }
    }
}
