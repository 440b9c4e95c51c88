//! Arguments of `build` and `atlas`.

use super::raster::{HEADING, RasterArgs};
use super::values::{
    PartRange, Place, ProgressStyle, UpAxis, parse_choice, parse_count, parse_crs, parse_size, parse_threads,
};
use clap::Args;
use lodpack::index::Placement;
use lodpack_cli::import::Objects;
use lodpack_cli::import::raster::RasterForm;
use lodpack_cli::mesh::appearance::Channels;
use lodpack_cli::mesh::tolerance::{Tolerance, Unit};
use lodpack_cli::pipeline::{ColourQuality, Effort, Fillings, LevelChoice, ModelOptions};
use lodpack_cli::region::REGION_TRIANGLES;
use std::path::PathBuf;

/// The options that the bytes of a file depend on.
#[derive(Args, Debug)]
pub struct ModelArgs {
    /// Largest certified error of the finest level: how far its surface and the input may be apart, measured both ways.
    /// A length in input units (0.05), with a unit (0.05mm), a share of the diagonal (0.01%), a multiple of the mean
    /// edge (0.4edge), or auto.
    #[arg(long, default_value = "auto", value_name = "T", allow_hyphen_values = true)]
    pub tolerance: Tolerance,
    /// Unit of the input's coordinates (um, mm, cm, dm, m, km, in, ft, yd), for a tolerance with a unit; the file keeps
    /// it beside --crs, --origin or --up. glTF is in metres unless this says otherwise.
    #[arg(long)]
    pub unit: Option<Unit>,
    /// The coordinate reference system of the coordinates, for exports to globes: EPSG:4978, EPSG:32632 or another
    /// number, or WKT. It is kept in the file and shown by `lodpack info`. With EPSG:4326 or EPSG:4979, coordinates are
    /// lengths to the east, the north and up from --origin, which is a longitude, a latitude and a height.
    #[arg(long, value_name = "CRS", value_parser = parse_crs)]
    pub crs: Option<String>,
    /// What has to be added to coordinates, in metres and with z up, to get those of the CRS: the offset that was taken
    /// off them.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub origin: Option<Place>,
    /// The axis that points up, for exports and viewers; it is kept in the file.
    #[arg(long, value_enum)]
    pub up: Option<UpAxis>,
    /// Run time against bytes and triangles. Every bound is certified at every effort.
    #[arg(long, default_value_t, value_parser = parse_choice(Effort::ALL))]
    pub effort: Effort,
    /// Which levels the file gets. With the finest alone it is a plain compressed mesh: smaller, but nothing coarser
    /// can be drawn.
    #[arg(long, default_value_t, value_parser = parse_choice(LevelChoice::ALL))]
    pub levels: LevelChoice,
    /// Fillings of charts. A grid has nested levels of its own, so a file that may have some gets no tree above its
    /// charts.
    #[arg(long, default_value_t, value_parser = parse_choice(Fillings::ALL))]
    pub fillings: Fillings,
    /// Divide the input by position instead of by amount, so that `lodpack add` can add to it later. Needs a tolerance
    /// that is a length. Regions become smaller and less even, which costs some tenths of a percent in bytes.
    #[arg(long)]
    pub extensible: bool,
    /// What to keep beside the shape: auto for the colour (of vertices, materials and textures) and every number per
    /// vertex that the input has, all for these and all normals, none for the shape alone, or names, as colour,quality.
    #[arg(long, default_value_t, value_name = "auto|all|none|NAME,...")]
    pub channels: Channels,
    /// How good stored colours are, and normals and factors of materials: auto, as good as the input (85, or of JPEG
    /// images as its tables say), a number from 1 (smallest) to 100 (almost exact), or lossless, which keeps the texels
    /// that are made of the input, in 8 bits, as they are, and makes larger files.
    #[arg(long, value_name = "QUALITY", default_value_t, alias = "colour-quality")]
    pub color_quality: ColourQuality,
    /// Cut the surface of an atlas into charts as that of a mesh: fewer and larger ones, which take fewer bytes. By
    /// default each chart of the atlas becomes a root, where it is in one piece and not too large.
    #[arg(long)]
    pub new_charts: bool,
    /// What becomes of the objects that inputs name: nodes of glTF, `o` and `g` of OBJ, and each of several files.
    #[arg(long, default_value_t, value_parser = parse_choice(Objects::ALL))]
    pub objects: Objects,
    /// Most triangles in a region, for tests.
    #[arg(long, value_name = "N", hide = true, default_value_t = REGION_TRIANGLES, value_parser = parse_count::<u64>)]
    pub region_triangles: u64,
    /// What rasters become. `extract`, `export`, `info`, `verify`, the viewers, JavaScript, Python and C read both. Of
    /// heights, --tolerance is how far a height may be off: 0 keeps integers as they are, and auto is half of what a
    /// sample is off the middle of its neighbours, on average.
    #[arg(id = "form", help_heading = HEADING, long = "as", value_name = "FORM", default_value_t, value_parser = parse_choice(RasterForm::ALL))]
    form: RasterForm,
    /// Short for `--as heights`.
    #[arg(long, hide = true, conflicts_with = "form")]
    heights: bool,
    #[command(flatten)]
    pub raster: RasterArgs,
}

impl ModelArgs {
    /// The options that the bytes of a file depend on.
    pub fn options(&self) -> ModelOptions {
        let &Self {
            tolerance, unit, effort, levels, fillings, extensible, region_triangles, new_charts, objects, ..
        } = self;
        let channels = self.channels.clone();
        let (chart_triangles, placement) = (None, self.placement());
        ModelOptions {
            tolerance,
            unit,
            placement,
            effort,
            levels,
            fillings,
            chart_triangles,
            region_triangles,
            extensible,
            channels,
            colour_quality: self.color_quality,
            new_charts,
            objects,
            raster: self.raster.options(),
        }
    }

    /// What rasters are to become.
    pub fn form(&self) -> RasterForm {
        if self.heights { RasterForm::Heights } else { self.form }
    }

    /// The first option that was typed and that only meshes have.
    pub fn of_meshes_alone(&self) -> Option<&'static str> {
        let typed = [
            (self.effort != Effort::default(), "--effort"),
            (self.levels != LevelChoice::default(), "--levels"),
            (self.fillings != Fillings::default(), "--fillings"),
            (self.channels != Channels::default(), "--channels"),
            (self.objects != Objects::default(), "--objects"),
            (self.extensible, "--extensible"),
            (self.new_charts, "--new-charts"),
            (self.up.is_some(), "--up"),
        ];
        typed.into_iter().find_map(|(is_typed, name)| is_typed.then_some(name))
    }

    /// Where the surface is in the world, if anything of that was typed. The unit alone does not count: it may only be
    /// that of the tolerance, on which no byte of the file depends.
    fn placement(&self) -> Option<Placement> {
        if self.up.is_none() && self.origin.is_none() && self.crs.is_none() {
            return None;
        }
        let up = self.up.map_or(lodpack::index::UpAxis::Unknown, UpAxis::axis);
        let (unit, origin) = (self.unit.map(|unit| unit.metres), self.origin.unwrap_or_default().0);
        Some(Placement { up, unit, origin, crs: self.crs.clone().unwrap_or_default() })
    }
}

/// Options that change how a command runs but not what it writes.
#[derive(Args, Debug)]
pub struct RunArgs {
    /// Worker threads; 0 takes all cores. The result does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = parse_threads)]
    pub threads: usize,
    /// Memory that the build may take, as 512MiB or 2GB; data that does not fit goes to temporary files. By default
    /// half of what the machine, the control groups of this process and its limits leave free. The result does not
    /// depend on it.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub memory: Option<u64>,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressStyle,
}

/// Arguments of `build`.
#[derive(Args, Debug)]
pub struct BuildArgs {
    /// Input meshes, joined into one model; rasters of heights, joined into one mosaic; or one atlas directory.
    #[arg(required_unless_present = "job", value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The file to write. By default it lies beside the (first) input and has its name: mesh.obj becomes mesh.lodpack.
    #[arg(short, long, value_name = "OUT.lodpack")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub model: ModelArgs,
    #[command(flatten)]
    pub run: RunArgs,
    /// Write what each thread does when to a file in Chrome's trace-event format, for chrome://tracing or
    /// ui.perfetto.dev.
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["job", "workers"])]
    pub trace: Option<PathBuf>,
    /// Build with this number of processes of this machine, which share memory and threads evenly. The result does not
    /// depend on it.
    #[arg(long, value_name = "N", conflicts_with = "job", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub workers: Option<u32>,
    /// What a mesh stands on: a raster of heights, which may be given several times for a mosaic, or one file that was
    /// made of one. The file then holds both, and everything that reads it has both: a city and its ground.
    /// --crs, --origin and the tolerance count for rasters, too. `lodpack merge --ground` puts a ground under a file
    /// that is there already.
    #[arg(long, value_name = "DEM", conflicts_with_all = ["job", "heights"])]
    pub ground: Vec<PathBuf>,
    /// Directory for temporary files. By default that of the output.
    #[arg(long, value_name = "DIR")]
    pub temp: Option<PathBuf>,
    /// Continue a stopped or killed build of the same output; start one if there is none, with its state on the disk.
    #[arg(long)]
    pub resume: bool,
    /// Build a part of this job, which `lodpack plan` has prepared, into the job's directory or to -o.
    #[arg(long, value_name = "JOB", requires = "part", conflicts_with_all = ["inputs", "tolerance", "unit", "crs", "origin", "up", "effort", "levels", "extensible", "channels", "objects", "surface", "radius", "vertical_unit", "nodata", "spacing", "bounds", "height_code", "drape", "geoid", "ramp", "form", "heights", "temp", "resume"])]
    pub job: Option<PathBuf>,
    /// Number of the part, from 0; or the first and the last of several, as 0-15, built one after the other.
    #[arg(long, value_name = "K", requires = "job")]
    pub part: Option<PartRange>,
    /// Overwrite an existing output, and discard the state of a stopped build.
    #[arg(long, conflicts_with = "resume")]
    pub force: bool,
    /// Print the summary as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `atlas`.
#[derive(Args, Debug)]
pub struct AtlasArgs {
    /// Input meshes, joined into one model.
    #[arg(required = true, value_name = "MESH")]
    pub inputs: Vec<PathBuf>,
    /// The directory to write.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Resolution r: images of 2^r + 1 samples per side. By default about one sample per vertex.
    #[arg(long, value_name = "R", value_parser = clap::value_parser!(u32).range(1..=11))]
    pub resolution: Option<u32>,
    /// Resolution of images of colours and of what else materials have. By default about one texel per texel of the
    /// input, or per vertex.
    #[arg(long, value_name = "R", value_parser = clap::value_parser!(u32).range(1..=11))]
    pub texels: Option<u32>,
    /// Write all coarser resolutions, too, each as an atlas in a folder of its own: mip_01, mip_02 ...
    #[arg(long)]
    pub mips: bool,
    /// What to write images of beside the shape: auto for the colour (of vertices, materials and textures), maps of
    /// materials and every number per vertex that the input has, all for these and all normals, none for the shape
    /// alone, or names, as colour,quality.
    #[arg(long, default_value_t, value_name = "auto|all|none|NAME,...")]
    pub channels: Channels,
    /// Overwrite the images in an existing directory.
    #[arg(long)]
    pub force: bool,
}
