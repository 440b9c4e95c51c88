//! Arguments of the commands that read a file: `info`, `extract`, `view`.

use super::values::{BoundingBox, TexelsChoice, parse_count};
use clap::{Args, ValueEnum};
use lodpack_cli::mesh::tolerance::Tolerance;
use std::ffi::OsString;
use std::path::PathBuf;

/// Arguments of `info`.
#[derive(Args, Debug)]
pub struct InfoArgs {
    /// The file: a path or an address (http://, https://; s3://, gs://, az:// where built in).
    pub file: PathBuf,
    /// Account for every byte: what is there and why; what is left out, why, and how many bytes that saves.
    #[arg(long)]
    pub why: bool,
    /// List the objects that the input named and the assemblies that they are parts of: number, leaves and triangles at
    /// the finest level, name, id, and what each is in. Reads all leaves.
    #[arg(long)]
    pub objects: bool,
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Mesh formats that can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OutputFormat {
    /// Binary PLY, double precision.
    Ply,
    /// Wavefront OBJ, full precision.
    Obj,
    /// Binary STL, single precision.
    Stl,
    /// Binary glTF, single precision relative to the middle of the mesh; in metres with y up where the file says its
    /// unit and axis.
    Glb,
}

/// What becomes of the ground that a mesh stands on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum GroundChoice {
    /// Both, where there is a ground.
    #[default]
    Auto,
    /// The mesh alone.
    None,
    /// The ground alone.
    Only,
}

/// Normals of vertices where a file stores none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NormalsChoice {
    /// Means of triangles, which end at creases.
    Smooth,
    /// None: programs shade triangles flat, or by rules of their own.
    None,
}

/// Formats of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ImagesChoice {
    /// What is opaque as JPEG of quality 90 where that is smaller, unless the file holds it without loss; the rest as
    /// PNG.
    Auto,
    /// Exact.
    Png,
    /// What is opaque as JPEG of quality 90, the rest as PNG.
    Jpeg,
    /// Everything as WebP without loss, or as PNG where that is smaller.
    Webp,
}

/// Arguments of `extract`.
#[derive(Args, Clone, Debug)]
pub struct ExtractArgs {
    /// The file: a path or an address (http://, https://; s3://, gs://, az:// where built in).
    pub file: PathBuf,
    /// The mesh to write: .ply, .obj, .stl or .glb; - writes to stdout and needs --format. Of a file of heights also
    /// .tif: a GeoTIFF of the samples that the box touches, or of every second, fourth ... of them where that meets the
    /// tolerance.
    #[arg(short, long, value_name = "MESH")]
    pub output: PathBuf,
    /// Format of the mesh. By default the extension of the output tells.
    #[arg(long, value_enum)]
    pub format: Option<OutputFormat>,
    /// Largest certified error, within the box if there is one: in input units (0.05), a share of the diagonal (0.1%),
    /// or a multiple of the input's mean edge (0.4edge). By default the mesh is as fine as the file.
    #[arg(long, value_name = "T", allow_hyphen_values = true)]
    pub tolerance: Option<Tolerance>,
    /// Most triangles. A finer cut is simplified to that number as a whole, and certified again; see --raw.
    #[arg(long, value_name = "N", value_parser = parse_count::<u64>)]
    pub triangles: Option<u64>,
    /// With --triangles: write a cut as the file holds it, which is a mixture of two levels, and simplify nothing. So
    /// it is with --nodes and --context, too.
    #[arg(long, requires = "triangles")]
    pub raw: bool,
    /// Of a file of heights: the fewest triangles of any shape within --tolerance, not those of its tiles. All samples
    /// that the box touches are read and compared.
    #[arg(long, requires = "tolerance", conflicts_with_all = ["triangles", "nodes", "context"])]
    pub tin: bool,
    /// Most nodes. A node is one root at one level.
    #[arg(long, value_name = "N", value_parser = parse_count::<u64>)]
    pub nodes: Option<u64>,
    /// What to write beside the shape: auto for the colour, if the file and the format have one, or none. GLB gets
    /// images inside, OBJ a material file and images beside it, PLY colours of vertices. Of a mesh that is simplified
    /// to --triangles, images are made anew.
    #[arg(long, value_name = "auto|none", default_value = "auto", value_parser = ["auto", "none"])]
    pub channels: String,
    /// Normals of vertices where the file stores none: smooth for means of the triangles around them, which end at
    /// edges of 30 degrees and more, or none. By default GLB has them, and PLY and OBJ have none. A vertex of PLY has
    /// one normal, which does not end at edges. STL has no room for them. Heights keep their own.
    #[arg(long, value_enum, value_name = "smooth|none")]
    pub normals: Option<NormalsChoice>,
    /// Most texels along each side of the images of a GLB or OBJ, into which what the nodes show is packed by its
    /// shape. What belongs together and is larger has an image of its own.
    #[arg(long, value_name = "N", default_value_t = lodpack::decode::PagedMesh::SIDE,
        value_parser = clap::value_parser!(u32).range(64..=16384))]
    pub page_size: u32,
    /// Texels of a GLB or OBJ: auto, which gives a mesh that is simplified to --triangles fewer of them the fewer
    /// triangles it has: a quarter of the triangles half of the texels; all, as fine as those that the file has; or the
    /// most texels of an image, or of all pages of one kind together: 1048576 for about 1,024 x 1,024.
    #[arg(long, default_value = "auto", value_name = "auto|all|N")]
    pub texels: TexelsChoice,
    /// Images of a GLB or OBJ: auto, which codes what is opaque once more, as JPEG of quality 90, where that is smaller
    /// and the file has not kept it without loss; png, which is exact; jpeg, for all that is opaque; or webp, of GLB
    /// alone, which is exact, too, and smaller, for programs that know EXT_texture_webp. Images with opacity are never
    /// JPEG.
    #[arg(long, value_enum, default_value_t = ImagesChoice::Auto, value_name = "auto|png|jpeg|webp", hide_possible_values = true)]
    pub images: ImagesChoice,
    /// Only roots that touch this box, in input units. Of a file of heights on a globe: degrees of longitude and
    /// latitude, and a number that has no meaning; 170 to 190 crosses the date line.
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    pub bbox: Option<BoundingBox>,
    /// Of a file whose mesh stands on a ground: auto writes both, none the mesh alone, only the ground alone.
    /// --tolerance holds for each, and so for both; --triangles for their sum, which is divided so that both have about
    /// the same error. GLB gets two nodes, each with its look; other formats get one mesh of the shape alone. A .tif is
    /// of the ground.
    #[arg(long, value_enum, default_value_t, value_name = "auto|none|only")]
    pub ground: GroundChoice,
    /// Only objects that the input named so: by name, by id, by the names of all that it is in and its own joined by
    /// slashes, or by number (#12) as info --objects lists them. A star stands for any text, and an assembly for all
    /// that is in it. May come several times. GLB gets their tree with names and ids, OBJ an object each. --tolerance
    /// and --triangles choose among the levels of leaves.
    #[arg(long = "object", value_name = "NAME|ID|#NUMBER",
        conflicts_with_all = ["bbox", "nodes", "context", "tin", "raw"])]
    pub objects: Vec<String>,
    /// Everything but these objects, named as for --object. May come several times.
    #[arg(long = "hide", value_name = "NAME|ID|#NUMBER", conflicts_with_all = ["objects", "tin", "raw"])]
    pub hidden: Vec<String>,
    /// With --bbox: also write the rest of the model, at its coarsest.
    #[arg(long, requires = "bbox")]
    pub context: bool,
    /// Overwrite an existing output.
    #[arg(long)]
    pub force: bool,
    /// Print a summary as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `view`.
#[derive(Args, Debug)]
pub struct ViewArgs {
    /// The file, a path or an address, and any options of lodpack-view.
    #[arg(value_name = "FILE|OPTION", required = true, trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<OsString>,
}
