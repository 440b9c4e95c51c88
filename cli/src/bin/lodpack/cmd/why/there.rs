//! What a file holds, and why it is needed.

use super::{Facts, Group, Kind, There, some};
use crate::output::{bytes, count, length};
use lodpack::{Filling, LevelContents};

/// Everything that the file holds, in its order.
pub(super) fn there(facts: &Facts) -> Vec<There> {
    facts
        .summary
        .sections
        .iter()
        .flat_map(|&(name, bytes)| match name {
            "header" => header(facts, bytes),
            "index" => index(facts),
            "pages" => pages(facts),
            _ => vec![section(facts, name, bytes)],
        })
        .collect()
}

fn item(kind: Kind, what: impl Into<String>, bytes: u64, why: impl Into<String>) -> There {
    There { kind, what: what.into(), bytes, why: why.into(), groups: vec![] }
}

/// Bytes of a file's first record; what follows is the directory.
const HEADER_BYTES: u64 = 64;

fn header(facts: &Facts, bytes: u64) -> Vec<There> {
    let what = format!("directory of {} sections", facts.summary.sections.len() - 1);
    vec![
        item(
            Kind::Section,
            "header",
            HEADER_BYTES,
            "says that this is a lodpack file, of which version, and where its coordinates lie",
        ),
        item(Kind::Section, what, bytes - HEADER_BYTES, "kind, place, size and checksum of each section, 32 B"),
    ]
}

fn section(facts: &Facts, name: &str, size: u64) -> There {
    let summary = facts.summary;
    let why = match name {
        "source" => "size of the input and the program that wrote the file: so errors can be told in mean edges".into(),
        "levels" => {
            format!(
                "error, triangles, steps and place of {}, 48 B each, and 8 B for all",
                some(facts.levels.len() as u64, "level")
            )
        }
        "tables" => {
            let used: u64 = summary.contexts.iter().map(|context| context.used_count).sum();
            format!(
                "how often each symbol occurs, {} for {}: nothing can be decoded without",
                some(summary.table_count, "table"),
                some(used, "kind") + " of symbols"
            )
        }
        "overview" => format!(
            "{} triangles for the first picture: header, index and level 0 are {}, and take longer",
            count(facts.file.overview_summary().map_or(0, |(_, triangles)| triangles)),
            bytes(facts.first_bytes())
        ),
        "clusters" => format!(
            "place in space and in the file, triangles and errors of {}: what is read on opening",
            some(facts.file.cluster_count().into(), "cluster")
        ),
        _ => "optional, of a kind that this program does not know".into(),
    };
    item(Kind::Section, name, size, why)
}

fn index(facts: &Facts) -> Vec<There> {
    let (summary, file) = (facts.summary, facts.file);
    let mut records = item(
        Kind::Root,
        format!("index, records of {} and {}", some(facts.root_count(), "root"), some(file.arc_count().into(), "arc")),
        summary.record_bytes,
        "borders, boxes, levels, triangles and errors of the roots: from these a cut is chosen",
    );
    let bordered = facts.root_count() - summary.closed_roots;
    records.groups = groups([
        (bordered, "with borders: no other root covers their piece of the surface"),
        (summary.closed_roots, "closed: pieces of their own, which no arc bounds"),
        (
            summary.roots_of(Filling::Irregular),
            "filled irregularly, with vertices and triangles of their own at each level",
        ),
        (summary.roots_of(Filling::Grid), "filled with grids, which take fewer bytes there or were asked for"),
    ]);
    let in_index: u64 = levels_in_index(facts).map(|level| level.sample_count).sum();
    let corners = some(file.corner_count().into(), "corner");
    let (what, levels) = match in_index {
        0 => (format!("index, {corners}"), "all levels".into()),
        samples => {
            (format!("index, {corners} and {}", some(samples, "arc sample")), coarsest(summary.index_arc_levels))
        }
    };
    let why = format!("where roots meet at {levels}, both sides are drawn with these");
    let arcs = item(Kind::Arc, what, summary.index_arc_bytes, why);
    let streams: u64 = summary.levels.iter().map(|level| level.arc_stream_count + level.block_stream_count).sum();
    let places = item(
        Kind::Stream,
        format!("index, places of {} in pages", some(streams, "stream")),
        summary.place_bytes,
        "size and checksum: each stream is fetched and checked alone",
    );
    [records, arcs, places].into_iter().filter(|item| item.bytes > 0).collect()
}

fn levels_in_index<'a>(facts: &Facts<'a>) -> impl Iterator<Item = &'a LevelContents> {
    facts.summary.levels.iter().take(facts.summary.index_arc_levels as usize)
}

/// The coarsest levels in words.
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
            "where roots meet, both sides are drawn with these",
        );
        let tolerance = facts.levels.get(number).map_or(0.0, |level| level.tolerance);
        let mut what = format!("level {number}, {}", some(level.block_count, "block"));
        let grids = level.blocks_of(Filling::Grid);
        if grids > 0 {
            what += &format!(", of grids {}", count(grids));
        }
        let why =
            format!("{}, aimed at an error of {}", some(level.block_triangle_count, "triangle"), length(tolerance));
        let mut blocks = item(Kind::Block, what, level.block_bytes, why);
        let reasons = &facts.reasons[number];
        blocks.groups = groups([
            (if number == 0 { level.block_count } else { 0 }, "at level 0: every root has one there"),
            (reasons.better, "that lower the error of their root by a fifth or more"),
            (reasons.within_tolerance, "that bring the error of their root below the level's"),
            (reasons.base, "of grids, on which finer blocks build"),
            (reasons.other, "that lower the error of their root by less than a fifth"),
        ]);
        items.extend([arcs, blocks].into_iter().filter(|item| item.bytes > 0));
    }
    items
}

/// Those that are not empty.
fn groups<const N: usize>(groups: [(u64, &str); N]) -> Vec<Group> {
    let some = groups.into_iter().filter(|group| group.0 > 0);
    some.map(|(count, why)| Group { count, why: why.into() }).collect()
}
