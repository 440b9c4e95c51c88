//! `lodpack info`

use super::heights;
use super::heights::ground::GroundInfo;
use super::objects::list::{self, Listed};
use super::open::{Opened, Source, in_file, open_any, open_ground};
use super::print_json;
use super::why::{Account, Kind};
use crate::args::InfoArgs;
use crate::output::{bound, by_filling, bytes, count, length, number, say};
use anyhow::Result;
use lodpack::index::{FillingCounts, Placement, UpAxis};
use lodpack_cli::pipeline::summary::roots_by_name;
use lodpack_cli::text::line;
use serde::Serialize;
use std::process::ExitCode;

#[derive(Serialize)]
struct Info {
    version: String,
    generator: String,
    bytes: u64,
    source_triangles: u64,
    source_vertices: u64,
    bits_per_source_vertex: f64,
    mean_edge_length: f64,
    bounds: [[f64; 3]; 2],
    lattice_step: f64,
    placement: Option<PlacementInfo>,
    roots: u64,
    #[serde(flatten, serialize_with = "roots_by_name")]
    roots_by_filling: FillingCounts,
    arcs: u64,
    corners: u64,
    sections: Vec<Section>,
    /// What the input named.
    #[serde(skip_serializing_if = "Option::is_none")]
    objects: Option<ObjectsInfo>,
    channels: Vec<Channel>,
    /// Bytes of the maps, which all channels share.
    map_bytes: u64,
    overview: Option<OverviewInfo>,
    /// The heights that the mesh stands on.
    #[serde(skip_serializing_if = "Option::is_none")]
    ground: Option<GroundInfo>,
    levels: Vec<Level>,
    #[serde(flatten)]
    account: Account,
    /// How much this command read.
    bytes_read: u64,
    requests: u64,
}

#[derive(Serialize)]
pub struct PlacementInfo {
    /// "y" or "z".
    up: Option<&'static str>,
    /// Metres.
    unit: Option<f64>,
    origin: [f64; 3],
    crs: Option<String>,
}

impl PlacementInfo {
    pub fn new(placement: &Placement) -> Self {
        let up = match placement.up {
            UpAxis::Unknown => None,
            UpAxis::Y => Some("y"),
            UpAxis::Z => Some("z"),
        };
        let crs = Some(placement.crs.clone()).filter(|crs| !crs.is_empty());
        Self { up, unit: placement.unit, origin: placement.origin, crs }
    }

    pub fn text(&self) -> String {
        let up = self.up.map(|up| format!("{up} up"));
        let unit = self.unit.map(|unit| format!("a unit is {unit} m"));
        // Line breaks and the rest of a long WKT are for --json.
        let crs = self.crs.as_ref().map(|crs| line(crs, 60));
        let origin = (self.origin != [0.0; 3]).then(|| format!("origin {:?}", self.origin));
        [crs, origin, up, unit].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

#[derive(Serialize)]
struct Section {
    name: String,
    bytes: u64,
}

#[derive(Serialize)]
struct Channel {
    name: String,
    kind: &'static str,
    /// Whether texels of a colour, a normal or a factor come back as they were made.
    lossless: bool,
    components: u8,
    low: f64,
    step: f64,
    bound: f64,
    /// Of its images.
    bytes: u64,
}

#[derive(Serialize)]
struct ObjectsInfo {
    objects: u32,
    assemblies: u32,
    /// Each of them, if that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    list: Option<Vec<Listed>>,
}

#[derive(Serialize)]
struct OverviewInfo {
    triangles: u64,
    certified_error: f64,
    error_in_mean_edges: f64,
}

#[derive(Serialize)]
struct Level {
    level: u8,
    triangles: u64,
    certified_error: f64,
    error_in_mean_edges: f64,
    arc_bytes: u64,
    block_bytes: u64,
    blocks: u64,
}

/// Prints what a file holds.
pub fn run(args: &InfoArgs) -> Result<ExitCode> {
    let file = match open_any(&args.file)? {
        Opened::Mesh(file) => file,
        Opened::Heights(file) => {
            heights::info::run(&file, args)?;
            return Ok(ExitCode::SUCCESS);
        }
    };
    let mut info = in_file(&args.file, collect(&file, args.why))?;
    if let Some(objects) = info.objects.as_mut().filter(|_| args.objects) {
        objects.list = list::collect(&args.file, &file)?;
        (info.bytes_read, info.requests) = (file.source().byte_count(), file.source().read_count());
    }
    if let Some(ground) = open_ground(&args.file, &file)? {
        let ground = in_file(&args.file, GroundInfo::new(&ground))?;
        // Bits are those of the mesh.
        info.bits_per_source_vertex *= 1.0 - ground.bytes as f64 / info.bytes.max(1) as f64;
        info.bytes_read += ground.bytes_read;
        info.requests += ground.requests;
        info.ground = Some(ground);
    }
    if args.json {
        print_json(&info)?;
    } else {
        print(&info, args)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn collect(file: &lodpack::File<Source>, with_why: bool) -> lodpack::Result<Info> {
    let source = file.source_info().cloned().unwrap_or_default();
    let summary = file.summary()?;
    let edge = source.mean_edge_length.max(f64::MIN_POSITIVE);
    let levels: Vec<Level> = summary
        .levels
        .iter()
        .enumerate()
        // A level without blocks is that beside it.
        .filter(|(_, l)| l.block_count > 0)
        .map(|(level, l)| Level {
            level: level as u8,
            triangles: l.triangle_count,
            certified_error: l.max_error,
            error_in_mean_edges: l.max_error / edge,
            arc_bytes: l.arc_bytes,
            block_bytes: l.block_bytes,
            blocks: l.block_count,
        })
        .collect();
    let overview = file.index().overview_summary().map(|(certified_error, triangles)| OverviewInfo {
        triangles,
        certified_error,
        error_in_mean_edges: certified_error / edge,
    });
    let texel_bytes = file.index().texel_bytes();
    let channels = file.channels().iter().zip(texel_bytes.iter().skip(1));
    let channels = channels.map(|(channel, &bytes)| Channel {
        name: channel.name.clone(),
        kind: channel.kind.name(),
        lossless: channel.is_exact,
        components: channel.components,
        low: channel.low,
        step: channel.step,
        bound: channel.bound,
        bytes,
    });
    let mut account = Account::new(file, &summary)?;
    if !with_why {
        account.there.clear();
    }
    let (major, minor) = file.index().version();
    Ok(Info {
        version: format!("{major}.{minor}"),
        generator: source.generator.clone(),
        bytes: summary.bytes,
        source_triangles: source.triangle_count,
        source_vertices: source.vertex_count,
        bits_per_source_vertex: summary.bytes as f64 * 8.0 / source.vertex_count.max(1) as f64,
        mean_edge_length: source.mean_edge_length,
        bounds: file.bounds().unwrap_or_default(),
        lattice_step: file.lattice().step(),
        placement: file.placement().map(PlacementInfo::new),
        roots: summary.roots.total(),
        roots_by_filling: summary.roots.clone(),
        arcs: u64::from(file.index().arc_count()),
        corners: u64::from(file.index().corner_count()),
        sections: summary
            .sections
            .iter()
            .map(|(name, bytes)| Section { name: name.to_string(), bytes: *bytes })
            .collect(),
        objects: file.objects().map(|objects| ObjectsInfo {
            objects: objects.count(),
            assemblies: objects.node_count() - objects.count(),
            list: None,
        }),
        channels: channels.collect(),
        map_bytes: texel_bytes.first().copied().unwrap_or(0),
        overview,
        ground: None,
        levels,
        account,
        bytes_read: file.source().byte_count(),
        requests: file.source().read_count(),
    })
}

fn print(info: &Info, args: &InfoArgs) -> Result<()> {
    say!("{}: lodpack {}, written by {}", args.file.display(), info.version, line(&info.generator, 80));
    say!(
        "  source     {} triangles, {} vertices, mean edge {}",
        count(info.source_triangles),
        count(info.source_vertices),
        length(info.mean_edge_length)
    );
    let [low, high] = info.bounds;
    say!("  box        {low:?} to {high:?}");
    say!("  lattice    step {:e}", info.lattice_step);
    if let Some(placement) = &info.placement {
        say!("  place      {}", placement.text());
    }
    say!("  size       {}, {:.2} bits per source vertex", bytes(info.bytes), info.bits_per_source_vertex);
    for section in &info.sections {
        say!("    {:<10} {:>12}", section.name, bytes(section.bytes));
    }
    say!(
        "  roots      {} ({}), {} arcs, {} corners",
        count(info.roots),
        by_filling(&info.roots_by_filling),
        count(info.arcs),
        count(info.corners)
    );
    if let Some(ObjectsInfo { objects, assemblies, .. }) = &info.objects {
        let hint = if args.objects { "" } else { " (--objects lists them)" };
        say!("  objects    {} in {} assemblies{hint}", count((*objects).into()), count((*assemblies).into()));
    }
    for (place, channel) in info.channels.iter().enumerate() {
        let Channel { name, kind, lossless, components, low, step, bound, bytes: size } = channel;
        let components = if *components == 1 { "1 component".into() } else { format!("{components} components") };
        let [low, step] = [low, step].map(|value| number(*value));
        let bound = if *bound > 0.0 { format!(", texels within {}", number(*bound)) } else { String::new() };
        let kind = if *lossless { format!("lossless {kind}") } else { kind.to_string() };
        let head = if place == 0 { "channels" } else { "" };
        let name = line(name, 80);
        say!("  {head:<10} {name}: {kind}, {components} from {low} in steps of {step}{bound}; images {}", bytes(*size));
    }
    if !info.channels.is_empty() {
        say!("  {:<10} maps of all channels {}", "", bytes(info.map_bytes));
    }
    info.ground.iter().try_for_each(GroundInfo::print)?;
    say!("  level    triangles        error   mean edges     blocks    arc bytes  block bytes");
    if let Some(o) = &info.overview {
        let (triangles, error) = (count(o.triangles), bound(o.certified_error));
        say!("  overview {:>9} {:>12} {:>12.3}", triangles, error, o.error_in_mean_edges);
    }
    for l in &info.levels {
        say!(
            "  {:<5} {:>12} {:>12} {:>12.3} {:>10} {:>12} {:>12}",
            l.level,
            count(l.triangles),
            bound(l.certified_error),
            l.error_in_mean_edges,
            count(l.blocks),
            bytes(l.arc_bytes),
            bytes(l.block_bytes)
        );
    }
    if args.why {
        info.account.print(info.bytes)?;
    } else {
        say!("  left out   (--why also shows what that saves, and why everything else is needed)");
        // Only --why shows details as fine as these.
        let is_fine = |kind: Kind| matches!(kind, Kind::Arc | Kind::Symbol | Kind::Stream | Kind::Padding);
        for item in info.account.left_out.iter().filter(|item| !is_fine(item.kind)) {
            say!("    {}: {}", item.what, item.why);
        }
    }
    if let Some(listed) = info.objects.as_ref().and_then(|objects| objects.list.as_ref()) {
        list::print(listed)?;
    }
    say!("  read       {} in {} requests", bytes(info.bytes_read), info.requests);
    Ok(())
}
