//! What a file holds, and why it is needed.

use super::{Facts, Kind, Reason, There, some};
use crate::output::{bytes, count, length};
use lodpack::index::LevelContents;

/// Everything that the file holds, in file order.
pub(super) fn there(facts: &Facts) -> Vec<There> {
    facts
        .summary
        .sections
        .iter()
        .flat_map(|&(name, bytes)| match name {
            "header" => header(facts, bytes),
            "index" => index(facts),
            "pages" => pages(facts),
            "texels" => texels(facts, bytes),
            _ => vec![section(facts, name, bytes)],
        })
        .collect()
}

fn item(kind: Kind, what: impl Into<String>, bytes: u64, why: impl Into<String>) -> There {
    There { kind, what: what.into(), bytes, why: why.into(), reasons: vec![] }
}

/// Bytes of a file's first record, which the directory follows.
const HEADER_BYTES: u64 = 64;

fn header(facts: &Facts, bytes: u64) -> Vec<There> {
    let what = format!("directory of {} sections", facts.summary.sections.len() - 1);
    vec![
        item(Kind::Section, "header", HEADER_BYTES, "magic number, format version, and the lattice of coordinates"),
        item(Kind::Section, what, bytes - HEADER_BYTES, "kind, offset, size and checksum of each section, 32 B each"),
    ]
}

fn section(facts: &Facts, name: &str, size: u64) -> There {
    let summary = facts.summary;
    let why = match name {
        "source" => {
            "size of the input, with which errors are given in mean edges, and the program that wrote the file".into()
        }
        "placement" => {
            "where the surface is in the world: what `lodpack build` was told with --crs, --origin, --up and --unit"
                .into()
        }
        "levels" => {
            format!(
                "tolerance, error, triangles and pages of {}, 40 B each; steps of each filling; and 8 B for all",
                some(facts.levels.len() as u64, "level")
            )
        }
        "tables" => {
            let used: u64 = summary.contexts.iter().map(|context| context.used_count).sum();
            format!(
                "how often each symbol occurs, {} for {}; decoding needs them",
                some(summary.table_count, "table"),
                some(used, "kind") + " of symbols"
            )
        }
        "overview" => format!(
            "{} triangles for a first picture: header, index and level 0 are {} and would take longer",
            count(facts.file.index().overview_summary().map_or(0, |(_, triangles)| triangles)),
            bytes(facts.first_bytes())
        ),
        "clusters" => format!(
            "where the index blocks of {} are, with their bounds, triangles and errors: the topmost list, read when the file is opened",
            some(facts.file.index().cluster_count().into(), "cluster")
        ),
        "channels" => format!(
            "name, kind and range of values of {}, and how many bytes each takes",
            some(facts.file.channels().len() as u64, "channel")
        ),
        "objects" => "how many objects and assemblies the input named, and where lists of them begin; --objects join leaves them out".into(),
        "object pages" => "names, ids, parents and look-up of objects, and for each island of the leaves' blocks the object that it belongs to; read a page at a time".into(),
        "ground" => "the heights that the mesh stands on: a whole file of heights, which --ground put there; files without it have only their mesh".into(),
        _ => "optional, of a kind that this version of lodpack does not know".into(),
    };
    item(Kind::Section, name, size, why)
}

fn index(facts: &Facts) -> Vec<There> {
    let (summary, file) = (facts.summary, facts.file);
    let mut records = item(
        Kind::Root,
        format!(
            "index, records of {} and {}",
            some(facts.root_count(), "root"),
            some(file.index().arc_count().into(), "arc")
        ),
        summary.record_bytes,
        "borders, boxes, levels, triangles and errors of the roots, from which a cut is chosen",
    );
    let bordered = facts.root_count() - summary.closed_roots;
    records.reasons = reasons(&[
        (bordered, "with borders, which they share with other roots or with the boundary of the surface"),
        (summary.closed_roots, "closed: whole components of the surface, which no arc bounds"),
    ]);
    records.reasons.extend(summary.roots.iter().filter(|&(_, count)| count > 0).map(|(filling, count)| Reason {
        count,
        why: format!("with {} fillings: {}", filling.name(), filling.description()),
    }));
    let in_index: u64 = levels_in_index(facts).map(|level| level.sample_count).sum();
    let corners = some(file.index().corner_count().into(), "corner");
    let (what, levels) = match in_index {
        0 => (format!("index, {corners}"), "all levels".into()),
        samples => {
            (format!("index, {corners} and {}", some(samples, "arc sample")), coarsest(summary.index_arc_levels))
        }
    };
    let why = format!("where roots meet at {levels}, both sides are drawn with these points");
    let arcs = item(Kind::Arc, what, summary.index_arc_bytes, why);
    let stream_count: u64 = summary.levels.iter().map(|level| level.arc_stream_count + level.block_stream_count).sum();
    let streams = item(
        Kind::Stream,
        format!("index, pages of {}", some(stream_count, "stream")),
        summary.place_bytes,
        "size and checksum, so that each stream is fetched and checked alone",
    );
    let lists = item(
        Kind::Section,
        "index, lists of clusters",
        summary.list_bytes,
        "like the topmost list, for clusters that have no room in it; read where a query gets to them",
    );
    [lists, records, arcs, streams].into_iter().filter(|item| item.bytes > 0).collect()
}

fn levels_in_index<'a>(facts: &Facts<'a>) -> impl Iterator<Item = &'a LevelContents> {
    facts.summary.levels.iter().take(facts.summary.index_arc_levels as usize)
}

/// The coarsest levels by number.
pub(super) fn coarsest(level_count: u64) -> String {
    if level_count <= 1 { "level 0".into() } else { format!("levels 0 to {}", level_count - 1) }
}

fn pages(facts: &Facts) -> Vec<There> {
    let mut items = vec![];
    for (number, level) in facts.summary.levels.iter().enumerate() {
        let arcs = item(
            Kind::Arc,
            format!(
                "level {number}, {} of {}",
                some(level.sample_count, "sample"),
                some(level.refined_arc_count, "arc")
            ),
            level.arc_bytes,
            "where roots meet, both sides are drawn with these points",
        );
        let tolerance = facts.levels.get(number).map_or(0.0, |level| level.tolerance);
        let mut what = format!("level {number}, {}", some(level.block_count, "block"));
        for (filling, blocks) in level.blocks.iter().filter(|&(filling, blocks)| filling.is_nested() && blocks > 0) {
            what += &format!(", {} {}", count(blocks), filling.name());
        }
        let why = format!("{}, for an error of {}", some(level.block_triangle_count, "triangle"), length(tolerance));
        let mut blocks = item(Kind::Block, what, level.block_bytes, why);
        let counts = &facts.reasons[number];
        blocks.reasons = reasons(&[
            (counts.coarsest, "that are the coarsest of their root"),
            (counts.better, "that lower the error of their root by a fifth or more"),
            (counts.within_tolerance, "that bring the error of their root within the level's tolerance"),
            (counts.base, "which finer blocks build on"),
            (counts.other, "that lower the error of their root by less than a fifth"),
        ]);
        items.extend([arcs, blocks].into_iter().filter(|item| item.bytes > 0));
    }
    items
}

/// The section TEXELS, which is read only where channels are wanted.
fn texels(facts: &Facts, size: u64) -> Vec<There> {
    let streams = facts.file.index().texel_bytes();
    let (maps, images) = (streams.first().copied().unwrap_or(0), streams.get(1..).unwrap_or(&[]));
    let places = size.saturating_sub(streams.iter().fold(0, |sum: u64, &bytes| sum.saturating_add(bytes)));
    let mut items = vec![
        item(Kind::Stream, "texels, table and directories", places, "where each map and image is, and its checksum"),
        item(Kind::Channel, "texels, maps", maps, "where each piece of a block's surface lies in its images"),
    ];
    for (channel, &bytes) in facts.file.channels().iter().zip(images) {
        let why = format!("the values of a channel of kind {}", channel.kind.name());
        items.push(item(Kind::Channel, format!("texels, images of {}", channel.name), bytes, why));
    }
    items.into_iter().filter(|item| item.bytes > 0).collect()
}

/// The reasons that apply to anything.
fn reasons(reasons: &[(u64, &str)]) -> Vec<Reason> {
    let some = reasons.iter().filter(|reason| reason.0 > 0);
    some.map(|&(count, why)| Reason { count, why: why.into() }).collect()
}
