//! What a file could hold but does not, why, and what that saves.

use super::there::coarsest;
use super::{Facts, Kind, LeftOut, ROUNDING, Reason, Saved, some};
use crate::output::{bytes, count, length};
use lodpack::index::Filling;
use lodpack_cli::pipeline::{OVERVIEW_FROM_BYTES, OVERVIEW_FROM_ROOTS, OVERVIEW_TRIANGLES};

/// Everything that the format provides for and the file does not have.
pub(super) fn left_out(facts: &Facts) -> Vec<LeftOut> {
    let mut items = vec![];
    items.extend(source(facts));
    items.extend(placement(facts));
    items.extend(overview(facts));
    if facts.file.channels().is_empty() {
        items.push(item(
            Kind::Channel,
            "channels: colours, normals, measured values",
            "the file was built from positions only",
            Saved::unknown("the file does not record whether the input had any"),
        ));
    }
    items.extend([coarser_level(facts), finer_level(facts)].into_iter().flatten());
    if facts.file.top_count() == facts.file.root_count() {
        items.push(item(
            Kind::Root,
            "groups of roots for views from afar",
            "no root stands for others; seen from afar, every root is drawn at its coarsest level",
            Saved::unknown("nothing in the file tells how large they would be"),
        ));
    }
    items.extend(fillings(facts));
    items.extend(blocks(facts));
    items.extend(arcs(facts));
    items.extend(symbols(facts));
    items.extend(streams(facts));
    items.push(padding(facts));
    items
}

fn item(kind: Kind, what: impl Into<String>, why: impl Into<String>, saved: Saved) -> LeftOut {
    LeftOut { kind, what: what.into(), why: why.into(), saved, reasons: vec![] }
}

/// Bytes of a section's entry in the directory, and of the section SOURCE without the program's name.
const ENTRY_BYTES: u64 = 32;
const SOURCE_BYTES: u64 = 32;
/// Bytes of the section PLACEMENT without a CRS.
const PLACEMENT_BYTES: u64 = 40;
/// Bytes of a level in the section LEVELS with the steps of one filling, and the least for each cluster in the section
/// CLUSTERS.
const LEVEL_BYTES: u64 = 42;
const CLUSTER_LEVEL_BYTES: u64 = 5;
/// Bytes that every stream takes: the state of its decoder and its checksum, and its size, which is stored elsewhere.
const STREAM_BYTES: u64 = 8;
const STREAM_SIZE_BYTES: u64 = 1;

fn source(facts: &Facts) -> Option<LeftOut> {
    facts.file.source_info().is_none().then(|| {
        let saved = Saved::at_least(
            ENTRY_BYTES + SOURCE_BYTES,
            "its numbers and its entry in the directory, without the program's name",
        );
        item(
            Kind::Section,
            "source",
            "the program that wrote the file recorded nothing about the input; optional",
            saved,
        )
    })
}

fn placement(facts: &Facts) -> Option<LeftOut> {
    facts.file.placement().is_none().then(|| {
        let saved =
            Saved::at_least(ENTRY_BYTES + PLACEMENT_BYTES, "its numbers and its entry in the directory, without a CRS");
        item(
            Kind::Section,
            "placement",
            "nobody has said where the surface is: --crs, --origin or --up of `lodpack build`",
            saved,
        )
    })
}

fn overview(facts: &Facts) -> Option<LeftOut> {
    if facts.file.index().overview_summary().is_some() {
        return None;
    }
    let (first, limit) = (facts.first_bytes(), OVERVIEW_FROM_BYTES);
    let why = if first <= limit {
        format!("header, index and level 0 are {} together: up to {}, they load as fast", bytes(first), bytes(limit))
    } else if facts.root_count() < OVERVIEW_FROM_ROOTS {
        format!("level 0 with fewer than {OVERVIEW_FROM_ROOTS} roots is drawn as fast")
    } else {
        "no surface of so few triangles was found: its parts lie in one line or plane, or its borders touch themselves"
            .into()
    };
    let level = facts.summary.levels.first()?;
    let triangles = level.block_triangle_count.min(OVERVIEW_TRIANGLES as u64);
    let how = format!("{} at the rate of level 0, and its entry in the directory", some(triangles, "triangle"));
    let estimate = triangles as f64 * per(level.block_bytes, level.block_triangle_count) + ENTRY_BYTES as f64;
    Some(item(Kind::Section, "overview", why, Saved::about(estimate, how)))
}

/// A ratio, 0 where there is nothing.
fn per(value: u64, count: u64) -> f64 {
    if count == 0 { 0.0 } else { value as f64 / count as f64 }
}

fn coarser_level(facts: &Facts) -> Option<LeftOut> {
    /// A level with more triangles per root always has coarser ones, unless the builder was told to leave them out.
    const ALONE_TRIANGLES: f64 = 100.0;
    let (level, roots) = (facts.summary.levels.first()?, facts.root_count());
    let clusters = u64::from(facts.file.index().cluster_count());
    let each = per(level.block_triangle_count, roots);
    let has = match level.block_triangle_count {
        0 => "level 0 has no triangles".to_owned(),
        count => format!("level 0 is the whole model in {}", some(count, "triangle")),
    };
    let why = match facts.levels.len() {
        1 if each > ALONE_TRIANGLES => format!("{has}: the file was built with its finest level alone"),
        _ => format!("{has}, and a coarser level would have hardly fewer"),
    };
    Some(item(
        Kind::Level,
        "levels coarser than level 0",
        why,
        Saved::at_least(
            LEVEL_BYTES + CLUSTER_LEVEL_BYTES * clusters,
            "its entries in the sections levels and clusters; blocks and samples would come on top",
        ),
    ))
}

fn finer_level(facts: &Facts) -> Option<LeftOut> {
    /// How many times the bytes of a level the next finer one takes, if the file has only one.
    const RATIO: f64 = 4.0;
    let number = facts.levels.len().checked_sub(1)?;
    let finest = facts.levels.get(number)?;
    let coarser = number.checked_sub(1).and_then(|number| facts.levels.get(number));
    let why = if finest.max_error <= finest.tolerance * ROUNDING {
        format!(
            "level {number} keeps the tolerance of {} that the file was built for: its error, rounded up, is {}",
            length(finest.tolerance),
            length(finest.max_error)
        )
    } else {
        format!("level {number} has the certified error {}; nothing finer was built", length(finest.max_error))
    };
    let (ratio, how) = match coarser.filter(|coarser| coarser.page_bytes > 0 && finest.page_bytes > 0) {
        Some(coarser) => {
            let ratio = per(finest.page_bytes, coarser.page_bytes);
            (ratio, format!("{ratio:.1} times the pages of level {number}, the ratio of these to level {}", number - 1))
        }
        None => (RATIO, format!("{RATIO} times the pages of level {number}")),
    };
    let estimate = finest.page_bytes as f64 * ratio + LEVEL_BYTES as f64;
    Some(item(Kind::Level, format!("levels finer than level {number}"), why, Saved::about(estimate, how)))
}

fn fillings(facts: &Facts) -> Vec<LeftOut> {
    let absent = facts.summary.roots.iter().filter(|&(_, count)| count == 0);
    let left_out = absent.map(|(filling, _)| {
        // Every chart is filled irregularly first.
        let why = match filling {
            Filling::Irregular => {
                "no root has one: every root has another filling, as the build found better or was told"
            }
            _ => "no root has one: wherever one was tried, the irregular filling took fewer bytes at the same error",
        };
        let how = "nothing in the file tells how large they would be";
        item(Kind::Filling, format!("{} fillings", filling.name()), why, Saved::unknown(how))
    });
    left_out.collect()
}

fn blocks(facts: &Facts) -> Vec<LeftOut> {
    let mut items = vec![];
    let (mut rate, mut rate_level) = (0.0, 0);
    for (number, (level, reasons)) in facts.summary.levels.iter().zip(&facts.reasons).enumerate() {
        if level.block_triangle_count > 0 {
            (rate, rate_level) = (per(level.block_bytes, level.block_triangle_count), number);
        }
        let tolerance = length(facts.levels.get(number).map_or(0.0, |level| level.tolerance));
        for ([blocks, triangles], why) in [
            (
                reasons.coarser_suffices,
                format!(
                    "the coarser block is drawn, whose error is already within this level's tolerance of {tolerance}"
                ),
            ),
            (
                reasons.coarser_as_good,
                "the coarser block is drawn: a finer one would lower the error by less than a fifth".into(),
            ),
        ] {
            if blocks > 0 {
                let how = format!(
                    "{} drawn instead, at {rate:.2} B each as in the blocks of level {rate_level}",
                    some(triangles, "triangle")
                );
                let what = format!("{} of level {number}", some(blocks, "block"));
                items.push(item(Kind::Block, what, why, Saved::about(triangles as f64 * rate, how)));
            }
        }
    }
    items
}

fn arcs(facts: &Facts) -> Option<LeftOut> {
    let (summary, file) = (facts.summary, facts.file);
    let (arcs, corners) = (u64::from(file.index().arc_count()), u64::from(file.index().corner_count()));
    if arcs == 0 {
        let saved = Saved::unknown("the file has no arc to compare with");
        return Some(item(Kind::Arc, "arcs and corners", "every root is closed, so no two meet", saved));
    }
    let bare = summary.bare_arc_count;
    if bare == 0 {
        return None;
    }
    let in_pages: u64 = summary.levels.iter().map(|level| level.arc_bytes).sum();
    let rate = per(summary.index_arc_bytes + in_pages, corners + summary.sample_count);
    Some(item(
        Kind::Arc,
        format!("samples of {} among {}", some(bare, "arc"), count(arcs)),
        "they are single edges, or straight within the tolerance at every level, so the corners at their ends suffice",
        Saved::about(
            bare as f64 * rate,
            format!("one sample each, at {rate:.2} B, the mean over corners and samples in this file"),
        ),
    ))
}

fn symbols(facts: &Facts) -> Option<LeftOut> {
    let contexts = || facts.summary.contexts.iter();
    let (all, used) = contexts().fold((0, 0), |(all, used), context| (all + context.count, used + context.used_count));
    let rate = per(facts.section("tables")?, used);
    let reasons: Vec<Reason> = contexts()
        .filter(|context| context.used_count < context.count)
        .map(|context| Reason {
            count: context.count - context.used_count,
            why: format!("of {} for {}", count(context.count), context.name),
        })
        .collect();
    (all > used).then(|| LeftOut {
        reasons,
        ..item(
            Kind::Symbol,
            format!("tables for {} of {} kinds of symbols", count(all - used), count(all)),
            "none of these occurs in the file",
            Saved::about(
                (all - used) as f64 * rate,
                format!("{rate:.1} B each, as the section takes for each kind that occurs"),
            ),
        )
    })
}

/// What this many more streams would take beside their symbols.
fn streams_of_their_own(count: u64) -> Saved {
    let each = STREAM_BYTES + STREAM_SIZE_BYTES;
    Saved::about((count * each) as f64, format!("{each} B each: decoder state, checksum and size"))
}

fn streams(facts: &Facts) -> Vec<LeftOut> {
    let summary = facts.summary;
    let total = |count: fn(&lodpack::index::LevelContents) -> u64| summary.levels.iter().map(count).sum::<u64>();
    let mut items = vec![];
    let in_index = summary.arc_run_count * summary.index_arc_levels;
    if in_index > 0 {
        items.push(item(
            Kind::Stream,
            format!("{} of arc samples", some(in_index, "stream")),
            format!(
                "the samples of {} are stored in the index, beside the corners",
                coarsest(summary.index_arc_levels)
            ),
            streams_of_their_own(in_index),
        ));
    }
    let empty = total(|level| level.empty_stream_count);
    if empty > 0 {
        items.push(item(
            Kind::Stream,
            format!("the bytes of {}", some(empty, "stream")),
            "they have nothing to say: none of their arcs gains a sample, or all symbols are certain",
            Saved::exactly(empty * STREAM_BYTES, "8 B each, decoder state and checksum; a size of 0 remains"),
        ));
    }
    let joined = total(|level| level.block_count) - total(|level| level.block_stream_count);
    if joined > 0 {
        items.push(item(
            Kind::Stream,
            format!("streams of their own for {}", some(joined, "block")),
            "they share the stream of an earlier block while that is small",
            streams_of_their_own(joined),
        ));
    }
    items
}

fn padding(facts: &Facts) -> LeftOut {
    const ALIGNMENT: u64 = 8;
    let gaps: u64 = facts.summary.sections.iter().map(|&(_, bytes)| bytes.next_multiple_of(ALIGNMENT) - bytes).sum();
    item(
        Kind::Padding,
        "padding",
        "sections, streams and blocks follow each other without gaps",
        Saved::exactly(gaps, "what aligning the sections to 8 B would take"),
    )
}
