//! Arguments of `export`.

use super::read::{GroundChoice, NormalsChoice};
use super::values::{ProgressStyle, UpAxis, parse_threads};
use clap::{Args, ValueEnum};
use lodpack_cli::mesh::tolerance::Tolerance;
use std::path::PathBuf;

/// Formats of levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// 3D Tiles 1.1: tileset.json and a folder of binary glTF.
    #[value(name = "3dtiles")]
    Tiles3d,
    /// Terrain tiles for Cesium, of a file of heights on the ellipsoid: quantized-mesh 1.0, and layer.json.
    #[value(name = "quantized-mesh")]
    QuantizedMesh,
    /// One binary glTF with all levels as nodes (extension MSFT_lod; named _LOD0, _LOD1 ...), for engines that choose
    /// among levels.
    #[value(name = "glb-lod")]
    GlbLod,
}

/// Arguments of `export`.
#[derive(Args, Debug)]
pub struct ExportArgs {
    /// The file: a path or an address (http://, https://; s3://, gs://, az:// where built in).
    pub file: PathBuf,
    /// The format.
    #[arg(long = "as", value_enum, value_name = "FORMAT")]
    pub format: ExportFormat,
    /// The folder to write, a new or an empty one; or, with a name that ends in .3tz, the archive: all tiles in one
    /// file. Levels in one file go to a name that ends in .glb.
    #[arg(short, long, value_name = "DIR|FILE.3tz|FILE.glb")]
    pub output: PathBuf,
    /// Write nothing finer where this error is met: in input units (0.05), a share of the diagonal (0.1%), or a
    /// multiple of the input's mean edge (0.4edge). By default everything is written.
    #[arg(long, value_name = "T", allow_hyphen_values = true)]
    pub tolerance: Option<Tolerance>,
    /// The file's axis that points up; tilesets have z up, and GLB has y up. By default what the file says, z if it
    /// only says its CRS, else y.
    #[arg(long, value_enum)]
    pub up: Option<UpAxis>,
    /// Leave the file's place on the globe out: metres from its own origin.
    #[arg(long)]
    pub local: bool,
    /// Of a file whose mesh stands on a ground: auto writes both as one tileset, with --tolerance for each; none the
    /// mesh alone, only the ground alone. glb-lod has the mesh alone.
    #[arg(long, value_enum, default_value_t, value_name = "auto|none|only")]
    pub ground: GroundChoice,
    /// auto: tiles show colours and what else materials have, if the file has them; none: the shape alone.
    #[arg(long, default_value = "auto", value_name = "C", value_parser = ["auto", "none"])]
    pub channels: String,
    /// Normals of vertices where the file stores none: smooth for means of the triangles around them, which end at
    /// edges of 30 degrees and more; along borders of tiles they are those of the finest level, so that neighbours of
    /// any levels agree. Or none: some programs then show colours without light (Cesium), others triangles flat.
    /// Heights keep their own.
    #[arg(long, value_enum, value_name = "smooth|none", default_value = "smooth")]
    pub normals: NormalsChoice,
    /// Replace the file or archive, or a tileset that an earlier export has left in the folder.
    #[arg(long)]
    pub force: bool,
    /// Threads; 0 takes all cores.
    #[arg(long, default_value = "0", value_name = "N", value_parser = parse_threads)]
    pub threads: usize,
    /// How to show progress.
    #[arg(long, value_enum, default_value_t, value_name = "STYLE")]
    pub progress: ProgressStyle,
    /// Print a summary as JSON.
    #[arg(long)]
    pub json: bool,
}
