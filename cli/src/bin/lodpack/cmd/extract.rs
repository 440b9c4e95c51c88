//! `lodpack extract`

use super::heights;
use super::images::{self, ImageSummary};
use super::objects::drawn::{DrawnObjects, Wanted, drawn_of as objects_of, hiding, is_of_leaves, of_cut};
use super::open::{Opened, Source, in_file, open_any, open_ground, tolerance_in, tolerance_in_heights};
use super::print_json;
use crate::args::{ExtractArgs, GroundChoice, ImagesChoice, NormalsChoice, OutputFormat, TexelsChoice};
use crate::interrupt;
use crate::messages;
use crate::output::{PendingFile, bound, bytes, count, finish_all, length, say};
use crate::progress_bar::Terminal;
use anyhow::{Context, Result, bail};
use lodpack::decode::TexturedMesh;
use lodpack::index::{ChannelInfo, ChannelKind};
use lodpack::{Cut, Lattice, Limiter, Outside, Query};
use lodpack_cli::mesh::encoded::{Formats, Written, encoded};
use lodpack_cli::mesh::export::{MeshFormat, rounding, write_mesh_with_normals};
use lodpack_cli::mesh::glb::write_textured_glb;
use lodpack_cli::mesh::glb_nodes::write_joined_glb;
use lodpack_cli::mesh::layers::{Layer, Look};
use lodpack_cli::mesh::objects::{GlbForm, ObjectPart, write_objects_glb, write_objects_obj};
use lodpack_cli::mesh::pages::PagedMesh;
use lodpack_cli::mesh::shaded::{Shading, write_shaded_mesh};
use lodpack_cli::mesh::smooth::{Creases, Fans};
use lodpack_cli::mesh::textured::{material_file, write_textured_obj, write_textured_ply};
use lodpack_cli::mesh::upright::Upright;
use lodpack_cli::progress::Progress;
use lodpack_cli::reduce::{CutPainter, Topology, cut_to_finish, finish, is_nearer};
use serde::Serialize;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::process::ExitCode;

/// Rounding by an output format is noted from this share of the certified error on.
const NOTABLE_ROUNDING: f64 = 0.1;

#[derive(Serialize)]
struct ExtractSummary {
    triangles: u64,
    vertices: u64,
    /// Roots, each at one level, or tiles of a grid of heights.
    nodes: u64,
    #[serde(skip)]
    kind_of_nodes: &'static str,
    /// Triangles of the cut that was simplified to meet the budget; none for a cut as the file holds it.
    simplified_from: Option<u64>,
    /// "kept", or how the budget changed it: "resampled" (handles are closed, thin parts gone) or "clustered" (parts
    /// have merged).
    topology: Topology,
    /// Of everything written, as the format holds it.
    certified_error: f64,
    /// Of what lies in the box, if there is one: the tolerance concerns this.
    certified_error_in_box: Option<f64>,
    /// How much of that the format adds: STL and GLB are in single precision.
    rounding: f64,
    /// The tolerance asked for, in input units.
    tolerance: Option<f64>,
    /// What keeps the mesh from being finer: "tolerance" (it is as fine as was asked for), "finest" (the file has
    /// nothing finer), "triangles" or "nodes" (a budget).
    limited_by: &'static str,
    /// Images that were written, if some were.
    images: Option<ImageSummary>,
    bytes_read: u64,
    requests: u64,
}

/// Selects a cut and writes it as a mesh.
pub fn run(args: &ExtractArgs) -> Result<ExitCode> {
    if is_raster(args) {
        interrupt::on_stop_leave_nothing();
        return heights::raster::run(args);
    }
    let format = format_of(args)?;
    interrupt::on_stop_leave_nothing();
    // An unsuitable output is refused before anything is read.
    let output = Output::create(args)?;
    let upright;
    let (drawn, tolerance, (nodes, kind_of_nodes), traffic) = match open_any(&args.file)? {
        Opened::Mesh(file) => {
            let has_ground = file.index().ground_range().is_some();
            upright = if has_ground { Upright::along_z(file.placement()) } else { Upright::of(file.placement()) };
            drawn_of(&file, format, args)?
        }
        Opened::Heights(_) if !args.objects.is_empty() => {
            bail!("{}: it holds a grid of heights, which has no objects; omit --object", args.file.display())
        }
        Opened::Heights(_) if !args.hidden.is_empty() => {
            bail!("{}: it holds a grid of heights, which has no objects; omit --hide", args.file.display())
        }
        Opened::Heights(file) => {
            // A globe has no axis that points up.
            let is_globe = file.surface().is_globe();
            upright = if is_globe { Upright::default() } else { Upright::along_z(file.placement()) };
            let tolerance = args.tolerance.map(|tolerance| tolerance_in_heights(&file, tolerance)).transpose()?;
            let (drawn, nodes) = match tolerance.filter(|_| args.tin) {
                Some(tolerance) => heights::extract::tin_of(&file, tolerance, args)?,
                None => heights::extract::mesh_of(&file, tolerance, args)?,
            };
            (vec![("heights", drawn)], tolerance, nodes, [file.source().byte_count(), file.source().read_count()])
        }
    };
    let mut most_moved = 0.0;
    for (_, part) in &drawn {
        let moved = rounding(format, &part.positions);
        tell(part, tolerance, moved, args);
        most_moved = f64::max(most_moved, moved);
    }
    let written = {
        let progress = Terminal::while_waiting();
        progress.begin("write", 0);
        output.write(args, (format, upright), &drawn)?
    };
    let coarser = drawn.iter().map(|(_, part)| part.coarser).fold(1.0, f64::max);
    let sum = |count: fn(&Drawn) -> usize| drawn.iter().map(|(_, part)| count(part) as u64).sum::<u64>();
    let largest = |error: fn(&Drawn) -> f64| drawn.iter().map(|(_, part)| error(part)).fold(0.0, f64::max);
    // What is farthest off says what keeps all of it from being finer.
    let coarsest = drawn.iter().map(|(_, part)| part).max_by(|a, b| a.error.total_cmp(&b.error));
    let Some(coarsest) = coarsest else { bail!("{}: nothing is drawn", args.file.display()) };
    let summary = ExtractSummary {
        triangles: sum(|part| part.triangles.len()),
        vertices: sum(|part| part.positions.len()),
        nodes,
        kind_of_nodes,
        simplified_from: drawn.iter().find_map(|(_, part)| part.cut_triangles),
        topology: drawn.first().map_or(Topology::Kept, |(_, part)| part.topology),
        certified_error: largest(|part| part.error_everywhere) + most_moved,
        rounding: most_moved,
        certified_error_in_box: args.bbox.map(|_| largest(|part| part.error) + most_moved),
        tolerance,
        limited_by: coarsest.limited_by.name(),
        images: images::tell(written, coarser, args),
        bytes_read: traffic[0],
        requests: traffic[1],
    };
    print(&summary, args)?;
    Ok(ExitCode::SUCCESS)
}

/// Notes what people may not expect of a mesh that is written. The format moves its coordinates by up to `moved`.
fn tell(drawn: &Drawn, tolerance: Option<f64>, moved: f64, args: &ExtractArgs) {
    match drawn.topology {
        Topology::Kept => {}
        Topology::Resampled => {
            messages::tell("note", "so few triangles leave no room for all handles: small ones are closed")
        }
        Topology::Clustered => {
            messages::tell("note", "so few triangles leave no room for all parts: small ones are merged or gone")
        }
    }
    if let Some(what) = shortfall(drawn, tolerance, args) {
        messages::tell("note", &what);
    }
    if moved > drawn.error * NOTABLE_ROUNDING {
        let output = args.output.display();
        let moved = length(moved);
        messages::tell(
            "note",
            &format!("{output}: single precision moves coordinates by up to {moved}; write PLY or OBJ to keep them"),
        );
    }
}

/// Notes what the format has no place for, of channels that are wanted.
fn tell_of_channels(
    file: &lodpack::File<Source>,
    (look, written): (&Look, &[u8]),
    format: MeshFormat,
    args: &ExtractArgs,
) {
    if args.channels != "auto" {
        return;
    }
    let tell_of = |is_it: &dyn Fn(&ChannelInfo) -> bool, better: &str| {
        let all = (0..).zip(file.channels());
        let left = all.filter(|(number, channel)| !written.contains(number) && is_it(channel));
        let names: Vec<&str> = left.map(|(_, channel)| channel.name.as_str()).collect();
        let (are, them) = if names.len() > 1 { ("are", "them") } else { ("is", "it") };
        if !names.is_empty() {
            messages::tell("note", &format!("{} {are} not written: write {better} to keep {them}", names.join(", ")));
        }
    };
    tell_of(&is_number, "PLY");
    if format != MeshFormat::Glb {
        let is_look = |channel: &ChannelInfo| {
            matches!(channel.kind, ChannelKind::Colour | ChannelKind::Normal | ChannelKind::Factor)
        };
        tell_of(&is_look, "GLB");
    }
    if format == MeshFormat::Ply && look.colour().is_some() {
        messages::tell("note", "PLY has colours of vertices alone: write GLB or OBJ to keep what lies between them");
    }
}

/// What is written with their names, the tolerance in units of the file, how many nodes that is, and bytes and
/// requests.
type Answer = (Vec<(&'static str, Drawn)>, Option<f64>, (u64, &'static str), [u64; 2]);

/// A mesh, its ground or both.
fn drawn_of(file: &lodpack::File<Source>, format: MeshFormat, args: &ExtractArgs) -> Result<Answer> {
    let name = args.file.display();
    let traffic = |source: &Source| [source.byte_count(), source.read_count()];
    let ground = match args.ground {
        GroundChoice::None => None,
        // Objects are those of the mesh.
        _ if !args.objects.is_empty() => None,
        GroundChoice::Auto | GroundChoice::Only => open_ground(&args.file, file)?,
    };
    let Some(ground) = ground else {
        if args.ground == GroundChoice::Only {
            bail!("{name}: its mesh stands on no ground; omit --ground only");
        }
        if args.tin {
            bail!("{name} holds a mesh, and --tin is for grids of heights; omit it");
        }
        let tolerance = args.tolerance.map(|tolerance| tolerance_in(file, tolerance)).transpose()?;
        let (drawn, nodes) = mesh_of(file, tolerance, format, args)?;
        return Ok((vec![("surface", drawn)], tolerance, (nodes, "roots"), traffic(file.source())));
    };
    if args.ground == GroundChoice::Only {
        let tolerance = heights::ground::tolerance_alone(&ground, args)?;
        let (drawn, nodes) = heights::ground::drawn_of(&ground, tolerance, args)?;
        let [[bytes, reads], [more_bytes, more_reads]] = [traffic(file.source()), traffic(ground.0.source())];
        return Ok((vec![("ground", drawn)], tolerance, nodes, [bytes + more_bytes, reads + more_reads]));
    }
    let tolerance = args.tolerance.map(|tolerance| tolerance_in(file, tolerance)).transpose()?;
    let [of_surface, of_ground] = heights::ground::shares(file, &ground, tolerance, args)?;
    let (mut drawn, mut nodes, mut kind) = (vec![], 0, "roots");
    if let Some(args) = of_surface {
        let (part, count) = mesh_of(file, tolerance, format, &args)?;
        drawn.push(("surface", part));
        nodes += count;
    }
    if let Some(args) = of_ground {
        let (part, (count, of_ground)) = heights::ground::drawn_of(&ground, tolerance, &args)?;
        kind = match (of_ground, drawn.is_empty()) {
            (of_ground, true) => of_ground,
            ("samples", false) => "roots and samples",
            (_, false) => "roots and tiles",
        };
        drawn.push(("ground", part));
        nodes += count;
    }
    if drawn.len() > 1 && format != MeshFormat::Glb && drawn.iter().any(|(_, part)| part.has_look()) {
        messages::tell(
            "note",
            "the mesh and its ground become one mesh of the shape alone; GLB keeps what both look like",
        );
    }
    let [[bytes, reads], [more_bytes, more_reads]] = [traffic(file.source()), traffic(ground.0.source())];
    Ok((drawn, tolerance, (nodes, kind), [bytes + more_bytes, reads + more_reads]))
}

/// The part of a mesh that was asked for, and how many nodes its cut has.
fn mesh_of(
    file: &lodpack::File<Source>,
    tolerance: Option<f64>,
    format: MeshFormat,
    args: &ExtractArgs,
) -> Result<(Drawn, u64)> {
    let (look, channels) = look_of(file, format, args);
    tell_of_channels(file, (&look, &channels), format, args);
    let progress = Terminal::while_waiting();
    progress.begin("read", 0);
    if !args.objects.is_empty() {
        return drawn_objects(file, tolerance, (look, &channels), format, args);
    }
    let finishing = args.triangles.filter(|_| !args.raw && !args.context && args.nodes.is_none());
    let query = Query {
        volume: args.bbox.map(|bbox| bbox.0.into()),
        outside: if args.context { Outside::Coarsest } else { Outside::Drop },
        tolerance,
        max_triangles: args.triangles,
        max_nodes: args.nodes,
        objects: hiding(file, &args.file, &args.hidden)?,
        ..Query::default()
    };
    let selected = match finishing {
        Some(triangles) => cut_to_finish(file, &query, triangles),
        None => file.select(&query).map(|cut| (cut, None)),
    };
    let (mut cut, coarser) = in_file(&args.file, selected)?;
    if cut.nodes.is_empty() {
        let [low, high] = file.bounds().unwrap_or_default();
        let file = args.file.display();
        if query.objects.is_some() {
            let or = if args.bbox.is_some() { ", or omit --bbox" } else { "" };
            bail!("{file}: nothing is left of it; hide fewer objects{or}");
        }
        bail!("{file}: nothing touches the box; the model reaches from {low:?} to {high:?}");
    }
    let draw = |cut: &Cut, with_all: bool| {
        if channels.is_empty() {
            return anyhow::Ok(Drawn::new(in_file(&args.file, file.extract(cut))?, cut));
        }
        let shown = match with_all || !has_pages(format) {
            true => file.extract_textured(cut, &channels).map(|textured| (textured, 1.0)),
            false => images::extracted(file, cut, &channels, args),
        };
        let (textured, coarser) = in_file(&args.file, shown)?;
        Ok(Drawn { coarser, ..Drawn::textured(textured, look.clone(), cut) })
    };
    if finishing.is_none_or(|most| cut.triangle_count <= most)
        && (format == MeshFormat::Glb
            || format == MeshFormat::Obj && channels.is_empty() && creases(args, format).is_none())
        && file.objects().is_some_and(|objects| objects.count() > 1)
    {
        if is_of_leaves(&args.file, file, &cut)? {
            let shown = if channels.is_empty() { None } else { Some(draw(&cut, false)?) };
            let coarser = shown.as_ref().map_or(1.0, |shown| shown.coarser);
            let textured = shown.and_then(|shown| shown.textured).map(|(textured, _)| textured);
            let objects = of_cut(&args.file, file, &cut, textured)?;
            let drawn = Drawn { coarser, ..Drawn::of_objects(file, objects, look, &channels) };
            return Ok((drawn, cut.nodes.len() as u64));
        }
        let is_whole = args.bbox.is_none() && args.nodes.is_none() && !args.context && !args.raw;
        let or = if is_whole && args.hidden.is_empty() { ", or pass --object '*'," } else { "" };
        messages::tell(
            "note",
            &format!("objects are merged in groups of this cut: ask for a finer one{or} to keep them apart"),
        );
    }
    // What is simplified has all its texels: from these come fewer.
    let mut drawn = draw(&cut, finishing.is_some_and(|most| cut.triangle_count > most))?;
    let known: Vec<&ChannelInfo> =
        channels.iter().filter_map(|&channel| file.channels().get(usize::from(channel))).collect();
    if let Some(most) = finishing.filter(|&most| drawn.triangles.len() as u64 > most) {
        progress.begin("simplify", 0);
        drawn = drawn.finished(&file.lattice(), most, &known, (format, args), &progress)?;
        if let Some(coarser) = coarser.filter(|coarser| is_nearer(coarser, drawn.error)) {
            drawn = draw(&coarser, false)?;
            cut = coarser;
        }
    }
    drawn.numbers = known.into_iter().cloned().enumerate().filter(|(_, channel)| is_number(channel)).collect();
    Ok((drawn, cut.nodes.len() as u64))
}

/// The objects that were asked for, and how many leaves hold them.
fn drawn_objects(
    file: &lodpack::File<Source>,
    tolerance: Option<f64>,
    (look, channels): (Look, &[u8]),
    format: MeshFormat,
    args: &ExtractArgs,
) -> Result<(Drawn, u64)> {
    // Materials of OBJ belong to one mesh.
    let channels = if format == MeshFormat::Obj { &[] } else { channels };
    let wanted = Wanted { path: &args.file, patterns: &args.objects, tolerance, triangles: args.triangles, channels };
    let objects = objects_of(file, &wanted)?;
    let leaves = objects.cut.nodes.len() as u64;
    Ok((Drawn::of_objects(file, objects, look, channels), leaves))
}

/// The mesh that is written.
pub struct Drawn {
    pub positions: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// Certified, inside the box if there is one.
    pub error: f64,
    pub error_everywhere: f64,
    pub limited_by: Limiter,
    /// Triangles of the cut that was simplified, if one was.
    pub cut_triangles: Option<u64>,
    pub topology: Topology,
    /// The same with images of its look.
    pub textured: Option<(TexturedMesh, Look)>,
    /// How many times as long the sides of texels are as those of the cut in the file.
    pub coarser: f64,
    /// Measured numbers and labels among its channels, with their places.
    pub numbers: Vec<(usize, ChannelInfo)>,
    /// Of heights: normals, and colours if there is a ramp or an image.
    pub shading: Option<Shading>,
    /// Of heights: the same with the image over it, where the format has room for that.
    pub draped: Option<PagedMesh>,
    /// The objects that its triangles belong to, if some were asked for, and the mesh with the roots of triangles.
    pub objects: Option<(lodpack::Mesh, Vec<ObjectPart>)>,
}

impl Drawn {
    /// A cut as it is.
    fn new(mesh: lodpack::Mesh, cut: &Cut) -> Self {
        Self {
            positions: mesh.positions,
            triangles: mesh.triangles,
            error: cut.error,
            error_everywhere: cut.error_everywhere(),
            limited_by: cut.limited_by,
            cut_triangles: None,
            topology: Topology::Kept,
            textured: None,
            coarser: 1.0,
            numbers: vec![],
            shading: None,
            draped: None,
            objects: None,
        }
    }

    /// A cut as it is, with its look.
    fn textured(textured: TexturedMesh, look: Look, cut: &Cut) -> Self {
        Self { textured: Some((textured.clone(), look)), ..Self::new(textured.mesh, cut) }
    }

    /// Objects, with their look if they have these channels.
    fn of_objects(file: &lodpack::File<Source>, objects: DrawnObjects, look: Look, channels: &[u8]) -> Self {
        let DrawnObjects { mesh, textured, cut, parts } = objects;
        let drawn = match textured {
            Some(textured) => Self::textured(textured, look, &cut),
            None => Self::new(mesh.clone(), &cut),
        };
        let known = channels.iter().filter_map(|&channel| file.channels().get(usize::from(channel)));
        let numbers = known.cloned().enumerate().filter(|(_, channel)| is_number(channel)).collect();
        Self { numbers, objects: Some((mesh, parts)), ..drawn }
    }

    /// Whether it carries more than its shape.
    fn has_look(&self) -> bool {
        self.textured.is_some()
            || self.draped.is_some()
            || self.shading.as_ref().is_some_and(|shading| shading.colours.is_some())
    }

    /// The cut, simplified to a number of triangles; `channels` are those of its images.
    fn finished(
        self,
        lattice: &Lattice,
        most: u64,
        channels: &[&ChannelInfo],
        (format, args): (MeshFormat, &ExtractArgs),
        progress: &Terminal,
    ) -> Result<Self> {
        let triangles = usize::try_from(most).unwrap_or(usize::MAX);
        let error = self.error_everywhere;
        let painter = self.textured.as_ref().and_then(|(cut, _)| CutPainter::new(cut, channels, lattice));
        let finished = match &painter {
            Some(painter) => painter.finished(error, triangles),
            None => finish(&self.positions, &self.triangles, error, lattice, triangles),
        };
        let Some(finished) = finished else {
            bail!("no surface like this one has only {} triangles; ask for more with --triangles", count(most));
        };
        let painted = painter.and_then(|painter| images::painted(&painter, &finished, has_pages(format), args));
        if self.textured.is_some() && painted.is_none() {
            progress.note("no image can be made for so few triangles: what is written has its shape alone");
        }
        let (painted, coarser) = painted.map_or((None, 1.0), |(painted, coarser)| (Some(painted), coarser));
        let textured = painted.zip(self.textured.map(|(_, look)| look));
        Ok(Self {
            positions: finished.positions,
            triangles: finished.triangles,
            error: finished.error,
            error_everywhere: finished.error,
            limited_by: Limiter::Triangles,
            cut_triangles: Some(self.triangles.len() as u64),
            topology: finished.topology,
            textured,
            coarser,
            numbers: vec![],
            shading: None,
            draped: None,
            objects: None,
        })
    }
}

/// Whether a format has images of what a mesh looks like.
fn has_pages(format: MeshFormat) -> bool {
    matches!(format, MeshFormat::Obj | MeshFormat::Glb)
}

/// The look that is written, and its channels; none where the format has no room for them.
fn look_of(file: &lodpack::File<Source>, format: MeshFormat, args: &ExtractArgs) -> (Look, Vec<u8>) {
    let has_room = match format {
        MeshFormat::Stl => false,
        // Its images are files of their own.
        MeshFormat::Obj => !is_stdout(&args.output),
        MeshFormat::Ply | MeshFormat::Glb => true,
    };
    if !has_room || args.channels != "auto" {
        return Default::default();
    }
    let (look, mut channels) = Look::of(file.channels(), format == MeshFormat::Glb);
    if format == MeshFormat::Ply {
        channels.extend((0..).zip(file.channels()).filter(|(_, channel)| is_number(channel)).map(|(number, _)| number));
    }
    (look, channels)
}

/// Whether a channel is a property of vertices in PLY.
fn is_number(channel: &ChannelInfo) -> bool {
    channel.components == 1
        && match channel.kind {
            ChannelKind::Scalar => true,
            ChannelKind::Label => channel.step == 1.0,
            _ => false,
        }
}

pub(super) fn format_of(args: &ExtractArgs) -> Result<MeshFormat> {
    let named = args.format.map(|format| match format {
        OutputFormat::Ply => MeshFormat::Ply,
        OutputFormat::Obj => MeshFormat::Obj,
        OutputFormat::Stl => MeshFormat::Stl,
        OutputFormat::Glb => MeshFormat::Glb,
    });
    match named.or_else(|| MeshFormat::from_path(&args.output)) {
        Some(MeshFormat::Stl) if args.normals == Some(NormalsChoice::Smooth) => {
            bail!("STL has no room for normals of vertices; omit --normals, or write GLB, OBJ or PLY")
        }
        Some(MeshFormat::Obj) if args.images == ImagesChoice::Webp => {
            bail!("programs that read OBJ know no WebP; write GLB, or --images png or jpeg")
        }
        Some(format) if matches!(args.texels, TexelsChoice::Most(_)) && !has_pages(format) => {
            bail!("only GLB and OBJ have images; omit --texels, or write one of them")
        }
        Some(format) => Ok(format),
        None if is_stdout(&args.output) => bail!("-o - needs --format: ply, obj, stl or glb"),
        None => bail!(
            "{}: the extension tells no format; use .ply, .obj, .stl or .glb (.tif for samples of a grid of heights), or pass --format",
            args.output.display()
        ),
    }
}

/// Whether samples are asked for, not triangles.
fn is_raster(args: &ExtractArgs) -> bool {
    let extension = args.output.extension().map(|extension| extension.to_ascii_lowercase());
    args.format.is_none() && extension.is_some_and(|extension| extension == "tif" || extension == "tiff")
}

pub(super) fn is_stdout(output: &Path) -> bool {
    output.as_os_str() == "-"
}

/// The destination of the mesh.
enum Output {
    Stdout,
    File(PendingFile, File),
}

impl Output {
    fn create(args: &ExtractArgs) -> Result<Self> {
        if !is_stdout(&args.output) {
            let (pending, file) = PendingFile::create(&args.output, args.force, [args.file.as_path()])?;
            return Ok(Self::File(pending, file));
        }
        if args.json {
            bail!("the mesh and the JSON summary would both go to stdout; name a file with -o, or omit --json");
        }
        Ok(Self::Stdout)
    }

    /// Writes meshes; returns which images they have.
    fn write(self, args: &ExtractArgs, format: (MeshFormat, Upright), mesh: &[(&str, Drawn)]) -> Result<Written> {
        let cannot_write = || format!("cannot write {}", args.output.display());
        let mut beside = vec![];
        let written = match self {
            Self::Stdout => match write(io::stdout().lock(), args, format, mesh, &mut beside) {
                // A closed pipe is no error: its reader, such as `head`, has seen enough.
                Err(error) if is_closed_pipe(&error) => Written::default(),
                written => written.context("cannot write to stdout")?,
            },
            Self::File(pending, out) => {
                let written = write(&out, args, format, mesh, &mut beside).with_context(cannot_write)?;
                beside.push((pending, out));
                written
            }
        };
        finish_all(beside)?;
        Ok(written)
    }
}

fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
}

/// Files beside the output, which get their names with it.
type Beside = Vec<(PendingFile, File)>;

/// Writes one mesh, or all of them as nodes or as one.
fn write(
    out: impl io::Write,
    args: &ExtractArgs,
    format: (MeshFormat, Upright),
    meshes: &[(&str, Drawn)],
    beside: &mut Beside,
) -> Result<Written> {
    if let [(_, mesh)] = meshes {
        return write_one(out, args, format, mesh, beside);
    }
    if format.0 == MeshFormat::Glb {
        let (mut models, mut written) = (vec![], Written::default());
        for (name, mesh) in meshes {
            let mut bytes = vec![];
            written.add_all(&write_one(&mut bytes, args, format, mesh, beside)?);
            models.push((*name, bytes));
        }
        write_joined_glb(out, &models)?;
        return Ok(written);
    }
    let (mut positions, mut triangles) = (vec![], vec![]);
    for (_, mesh) in meshes {
        let Ok(first) = u32::try_from(positions.len() + mesh.positions.len()).map(|_| positions.len() as u32) else {
            bail!("the mesh and its ground have too many vertices for one mesh; ask for less with --tolerance");
        };
        positions.extend_from_slice(&mesh.positions);
        triangles.extend(mesh.triangles.iter().map(|triangle| triangle.map(|vertex| first + vertex)));
    }
    write_bare(out, args, format, (&positions, &triangles))?;
    Ok(Written::default())
}

/// The normals that are computed for a mesh that stores none.
fn creases(args: &ExtractArgs, format: MeshFormat) -> Option<Creases> {
    let by_default = if format == MeshFormat::Glb { NormalsChoice::Smooth } else { NormalsChoice::None };
    match (args.normals.unwrap_or(by_default), format) {
        (NormalsChoice::None, _) | (_, MeshFormat::Stl) => None,
        (NormalsChoice::Smooth, MeshFormat::Ply) => Some(Creases::Smoothed),
        (NormalsChoice::Smooth, MeshFormat::Obj | MeshFormat::Glb) => Some(Creases::Kept),
    }
}

/// Writes the shape alone, and its normals.
fn write_bare(
    out: impl io::Write,
    args: &ExtractArgs,
    (format, upright): (MeshFormat, Upright),
    (positions, triangles): (&[[f64; 3]], &[[u32; 3]]),
) -> Result<()> {
    let fans = creases(args, format).map(|creases| Fans::new(positions, triangles, creases)).transpose()?;
    Ok(write_mesh_with_normals(out, format, (positions, triangles), fans.as_ref(), upright)?)
}

/// Writes a mesh; returns which images it has.
fn write_one(
    out: impl io::Write,
    args: &ExtractArgs,
    form: (MeshFormat, Upright),
    mesh: &Drawn,
    beside: &mut Beside,
) -> Result<Written> {
    let (format, upright) = form;
    let mut written = Written::default();
    match &mesh.objects {
        Some((whole, parts)) if format == MeshFormat::Glb => {
            let textured = mesh.textured.as_ref().map(|(textured, look)| (textured, look));
            let look = textured.map(|(_, look)| look.clone()).unwrap_or_default();
            let form = GlbForm {
                formats: images::formats(&look, args),
                upright,
                page_size: args.page_size,
                is_smooth: creases(args, format).is_some(),
            };
            return Ok(write_objects_glb(out, whole, textured, parts, form)?);
        }
        Some((whole, parts)) if format == MeshFormat::Obj => {
            write_objects_obj(out, whole, parts)?;
            return Ok(written);
        }
        _ => {}
    }
    if let Some(draped) = &mesh.draped {
        let formats = images::formats(&Look::default(), args);
        match format {
            MeshFormat::Glb => return Ok(write_textured_glb(out, draped, formats, upright)?),
            MeshFormat::Obj => return write_obj(out, (args, beside), draped, formats),
            MeshFormat::Ply | MeshFormat::Stl => {}
        }
    }
    if let Some(shading) = &mesh.shading {
        write_shaded_mesh(out, format, (&mesh.positions, &mesh.triangles), shading, upright)?;
        return Ok(written);
    }
    let Some((textured, look)) = &mesh.textured else {
        write_bare(out, args, form, (&mesh.positions, &mesh.triangles))?;
        return Ok(written);
    };
    let creases = creases(args, format);
    let paged = || {
        let paged = PagedMesh::new(textured, look, args.page_size);
        if creases.is_some() { paged.smooth(&textured.mesh) } else { Ok(paged) }
    };
    let formats = images::formats(look, args);
    match format {
        MeshFormat::Ply | MeshFormat::Stl => {
            let numbers: Vec<(usize, &ChannelInfo)> =
                mesh.numbers.iter().map(|(place, channel)| (*place, channel)).collect();
            let fans = creases.map(|creases| Fans::new(&mesh.positions, &mesh.triangles, creases)).transpose()?;
            let normals = fans.as_ref().map(|fans| fans.normals.as_slice());
            write_textured_ply(out, textured, look.colour(), &numbers, normals)?;
        }
        MeshFormat::Glb => written = write_textured_glb(out, &paged()?, formats, upright)?,
        MeshFormat::Obj => written = write_obj(out, (args, beside), &paged()?, formats)?,
    }
    Ok(written)
}

/// Writes OBJ, and beside it its materials and images; returns which images it has.
fn write_obj(
    out: impl io::Write,
    (args, beside): (&ExtractArgs, &mut Beside),
    paged: &PagedMesh,
    formats: Formats,
) -> Result<Written> {
    let mut written = Written::default();
    let name = args.output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut files = vec![];
    for page in 0..paged.pages.len() {
        let Some(image) = paged.image(page, Layer::Colour) else { continue };
        let encoded = encoded(Layer::Colour, image, formats)?;
        written.add(image, &encoded);
        let (bytes, media_type) = encoded;
        let extension = if media_type == "image/png" { "png" } else { "jpg" };
        files.push((page, format!("{name}-{page}.{extension}"), bytes));
    }
    let material_name = format!("{name}.mtl");
    write_textured_obj(out, paged, &material_name)?;
    let names: Vec<(usize, &str)> = files.iter().map(|(page, name, _)| (*page, name.as_str())).collect();
    beside.push(write_beside(args, &material_name, material_file(paged, &names).as_bytes())?);
    for (_, name, bytes) in &files {
        beside.push(write_beside(args, name, bytes)?);
    }
    Ok(written)
}

/// Writes a file into the folder of the output.
fn write_beside(args: &ExtractArgs, name: &str, content: &[u8]) -> Result<(PendingFile, File)> {
    let path = args.output.with_file_name(name);
    let (pending, mut file) = PendingFile::create(&path, args.force, [args.file.as_path()])?;
    io::Write::write_all(&mut file, content).with_context(|| format!("cannot write {}", path.display()))?;
    Ok((pending, file))
}

/// Why a cut misses the tolerance that was asked for, if it does.
fn shortfall(drawn: &Drawn, tolerance: Option<f64>, args: &ExtractArgs) -> Option<String> {
    let tolerance = tolerance.filter(|&tolerance| drawn.error > tolerance)?;
    let budget = |name: &str, most: Option<u64>| {
        format!("the budget of {} {name} allows only {}", count(most.unwrap_or_default()), length(drawn.error))
    };
    let why = match drawn.limited_by {
        Limiter::Triangles => budget("triangles", args.triangles),
        Limiter::Nodes => budget("nodes", args.nodes),
        _ => format!("the finest level has {}; build the file with a finer --tolerance", length(drawn.error)),
    };
    Some(format!("the tolerance of {} is not reached: {why}", length(tolerance)))
}

fn print(summary: &ExtractSummary, args: &ExtractArgs) -> Result<()> {
    if args.json {
        return print_json(summary);
    }
    let error = match summary.certified_error_in_box {
        Some(inside) if inside < summary.certified_error => {
            format!("{} in the box, {} everywhere", bound(inside), bound(summary.certified_error))
        }
        _ => bound(summary.certified_error),
    };
    let source = match summary.simplified_from {
        None => format!("of {} {}", count(summary.nodes), summary.kind_of_nodes),
        Some(triangles) => format!("simplified from {} of {} roots", count(triangles), count(summary.nodes)),
    };
    let text = format!(
        "{}: {} triangles {source}, certified error {error}; {} read in {} requests",
        args.output.display(),
        count(summary.triangles),
        bytes(summary.bytes_read),
        summary.requests
    );
    match is_stdout(&args.output) {
        true => messages::line(format_args!("{text}")),
        false => say!("{text}"),
    }
    Ok(())
}
