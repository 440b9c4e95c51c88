//! An account of a file: everything it holds, with the reason why that is needed, and everything that the format could
//! hold but this file does not, with the reason and the bytes saved.
//!
//! All of this follows from the index; no page is read.

mod left_out;
mod there;

use super::open::Source;
use crate::output::{bytes, count, say};
use anyhow::Result;
use lodpack::{
    File,
    index::{FileSummary, LevelSummary},
};
use serde::Serialize;

/// What a file holds, and what it leaves out.
#[derive(Serialize)]
pub struct Account {
    /// Disjoint parts that make up the file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub there: Vec<There>,
    /// What the file could hold but does not.
    pub left_out: Vec<LeftOut>,
}

/// A part of the file.
#[derive(Serialize)]
pub struct There {
    kind: Kind,
    what: String,
    bytes: u64,
    /// Why it is needed.
    why: String,
    /// If it consists of several things: how many are there for which reason.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    reasons: Vec<Reason>,
}

/// A number of things with the same reason; the count begins the sentence.
#[derive(Serialize)]
struct Reason {
    count: u64,
    why: String,
}

/// Something that the file could hold but does not.
#[derive(Serialize)]
pub struct LeftOut {
    pub kind: Kind,
    pub what: String,
    pub why: String,
    saved: Saved,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    reasons: Vec<Reason>,
}

/// The kinds of things that the format distinguishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    Section,
    Channel,
    Level,
    Root,
    Filling,
    Block,
    Arc,
    Symbol,
    Stream,
    Padding,
}

/// The bytes that something left out would take.
#[derive(Serialize)]
struct Saved {
    /// None if nothing in the file tells.
    bytes: Option<u64>,
    known: Known,
    /// What was counted, or how it was estimated.
    how: String,
}

#[derive(Clone, Copy, Serialize)]
#[serde(rename_all = "snake_case")]
enum Known {
    Exactly,
    AtLeast,
    About,
    Unknown,
}

impl Saved {
    fn exactly(bytes: u64, how: impl Into<String>) -> Self {
        Self { bytes: Some(bytes), known: Known::Exactly, how: how.into() }
    }

    fn at_least(bytes: u64, how: impl Into<String>) -> Self {
        Self { bytes: Some(bytes), known: Known::AtLeast, how: how.into() }
    }

    fn about(bytes: f64, how: impl Into<String>) -> Self {
        Self { bytes: Some(bytes.round() as u64), known: Known::About, how: how.into() }
    }

    fn unknown(how: impl Into<String>) -> Self {
        Self { bytes: None, known: Known::Unknown, how: how.into() }
    }

    fn text(&self) -> String {
        let known = match self.known {
            Known::Exactly => "exactly",
            Known::AtLeast => "at least",
            Known::About => "about",
            Known::Unknown => "",
        };
        format!("{known:<8} {:>10}", self.bytes.map_or("unknown".into(), bytes))
    }
}

impl Account {
    /// Makes the account from a file's whole index.
    pub fn new(file: &File<Source>, summary: &FileSummary) -> lodpack::Result<Self> {
        let levels = (0..summary.levels.len()).filter_map(|level| file.level(level)).collect();
        let facts = Facts { file, summary, levels, reasons: block_reasons(file, summary.levels.len())? };
        Ok(Self { there: there::there(&facts), left_out: left_out::left_out(&facts) })
    }

    /// Prints the account of a file with this many bytes.
    pub fn print(&self, file_bytes: u64) -> Result<()> {
        say!(
            "  words      root: a piece of the surface; arc: a line where roots meet, with corners at its ends and samples"
        );
        say!(
            "             between them; level: a resolution, 0 is the coarsest; block: what a root stores at a level;"
        );
        say!(
            "             cluster: up to 32 neighbouring roots; stream: bytes that are fetched, checked and decoded together;"
        );
        say!("             errors and tolerances are in the units of the input");
        say!("  there, and why it is needed");
        for item in &self.there {
            say!("    {:>13} B  {}: {}", count(item.bytes), item.what, item.why);
            print_reasons(&item.reasons, 21)?;
        }
        let sum: u64 = self.there.iter().map(|item| item.bytes).sum();
        if sum == file_bytes {
            say!("    {:>13} B  in all: exactly the size of the file, so every byte is accounted for", count(sum));
        } else {
            say!(
                "    {:>13} B  in all, but the file has {}: this is a defect of lodpack; please report it",
                count(sum),
                count(file_bytes)
            );
        }
        say!("  left out, what that saves, and why it is not needed");
        for item in &self.left_out {
            say!("    {}  {}: {}", item.saved.text(), item.what, item.why);
            print_reasons(&item.reasons, 27)?;
            say!("{:27}[{}]", "", item.saved.how);
        }
        Ok(())
    }
}

/// What both lists are derived from.
struct Facts<'a> {
    file: &'a File<Source>,
    summary: &'a FileSummary,
    levels: Vec<LevelSummary>,
    /// By level.
    reasons: Vec<BlockReasons>,
}

impl Facts<'_> {
    fn section(&self, name: &str) -> Option<u64> {
        self.summary.sections.iter().find(|section| section.0 == name).map(|section| section.1)
    }

    fn root_count(&self) -> u64 {
        self.summary.roots.total()
    }

    /// Bytes to read before level 0 can be drawn, its own included; texels are not read for it.
    fn first_bytes(&self) -> u64 {
        let [pages, texels] = ["pages", "texels"].map(|name| self.section(name).unwrap_or(0));
        self.summary.bytes - pages - texels + self.levels.first().map_or(0, |level| level.page_bytes)
    }
}

/// Why roots have a block at a level, or have none.
#[derive(Clone, Default)]
struct BlockReasons {
    /// Blocks that are their root's coarsest.
    coarsest: u64,
    /// Blocks that lower their root's error by a fifth.
    better: u64,
    /// Blocks without which their root's error would be above the level's tolerance.
    within_tolerance: u64,
    /// Blocks of grids that finer blocks build on.
    base: u64,
    /// All other blocks.
    other: u64,
    /// Roots without a block because the coarser one keeps the level's tolerance, and the triangles they are drawn
    /// with.
    coarser_suffices: [u64; 2],
    /// Roots without a block because it would not have been better by a fifth, and their triangles.
    coarser_as_good: [u64; 2],
}

/// Stored errors are rounded up by at most 0.4 %.
const ROUNDING: f64 = 1.004;
/// A block is kept if it lowers the error to this share of the coarser block's.
const BETTER: f64 = 0.8 * ROUNDING;

fn block_reasons(file: &File<Source>, level_count: usize) -> lodpack::Result<Vec<BlockReasons>> {
    let mut reasons = vec![BlockReasons::default(); level_count];
    for root in 0..file.root_count() {
        let contents = file.root_contents(root)?;
        let mut blocks = contents.blocks.iter().peekable();
        let Some(mut coarser) = blocks.next() else { continue };
        let [first, last] =
            [contents.blocks.first(), contents.blocks.last()].map(|b| b.map_or(0, |b| usize::from(b.level)));
        if let Some(reason) = reasons.get_mut(first) {
            reason.coarsest += 1;
        }
        // Below a group its children are drawn.
        let last = if file.children(root)?.is_empty() { level_count } else { last + 1 };
        for (level, reason) in reasons.iter_mut().enumerate().take(last).skip(first + 1) {
            let tolerance = file.level(level).map_or(0.0, |level| level.tolerance * ROUNDING);
            // If the coarser block is drawn instead, a neighbour may be finer and move the border.
            let without = (coarser.error + coarser.border_deviation) * ROUNDING * ROUNDING;
            if let Some(block) = blocks.next_if(|block| usize::from(block.level) == level) {
                *match () {
                    () if block.error <= coarser.error * BETTER => &mut reason.better,
                    () if block.error <= tolerance && without > tolerance => &mut reason.within_tolerance,
                    () if contents.filling.is_nested() => &mut reason.base,
                    () => &mut reason.other,
                } += 1;
                coarser = block;
            } else {
                let roots =
                    if coarser.error <= tolerance { &mut reason.coarser_suffices } else { &mut reason.coarser_as_good };
                roots[0] += 1;
                roots[1] += u64::from(coarser.triangle_count);
            }
        }
    }
    Ok(reasons)
}

/// A count with its noun.
fn some(number: u64, word: &str) -> String {
    format!("{} {word}{}", count(number), if number == 1 { "" } else { "s" })
}

fn print_reasons(reasons: &[Reason], indent: usize) -> Result<()> {
    for reason in reasons {
        say!("{:indent$}{} {}", "", count(reason.count), reason.why);
    }
    Ok(())
}
