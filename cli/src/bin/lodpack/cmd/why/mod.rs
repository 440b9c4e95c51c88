//! An account of a file: everything that is there with the reason why it is needed, and everything that the format knows
//! and that is not there, with the reason and what that saves.
//!
//! The index says all of it; no page is read.

mod left_out;
mod there;

use super::open::Source;
use crate::output::{bytes, count, say};
use anyhow::Result;
use lodpack::{File, FileSummary, LevelSummary};
use serde::Serialize;

/// What is there and what is not.
#[derive(Serialize)]
pub struct Account {
    /// Disjoint pieces that make up the file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub there: Vec<There>,
    /// What could have been there.
    pub left_out: Vec<LeftOut>,
}

/// A piece of the file.
#[derive(Serialize)]
pub struct There {
    kind: Kind,
    what: String,
    bytes: u64,
    /// Why it is needed.
    why: String,
    /// Where it has several parts: how many for which reason.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    groups: Vec<Group>,
}

/// How many things have one reason. The sentence begins with the count.
#[derive(Serialize)]
struct Group {
    count: u64,
    why: String,
}

/// Something that could have been there.
#[derive(Serialize)]
pub struct LeftOut {
    pub kind: Kind,
    pub what: String,
    pub why: String,
    saved: Saved,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    groups: Vec<Group>,
}

/// What the format distinguishes.
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

/// Bytes that something would take that is not there.
#[derive(Serialize)]
struct Saved {
    /// Null where nothing in the file tells.
    bytes: Option<u64>,
    known: Known,
    /// What is counted, or how it was estimated.
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
    /// Looks at the whole index of a file.
    pub fn new(file: &File<Source>, summary: &FileSummary) -> lodpack::Result<Self> {
        let levels = (0..summary.levels.len()).filter_map(|level| file.level(level)).collect();
        let facts = Facts { file, summary, levels, reasons: block_reasons(file, summary.levels.len())? };
        Ok(Self { there: there::there(&facts), left_out: left_out::left_out(&facts) })
    }

    /// Prints the account of a file of so many bytes.
    pub fn print(&self, file_bytes: u64) -> Result<()> {
        say!(
            "  words      root: a piece of the surface; arc: a line along which roots meet, with corners at its ends and"
        );
        say!(
            "             samples between; level: 0 is the coarsest; block: what one root stores at one level; cluster: up"
        );
        say!("             to 32 neighbouring roots; stream: what is fetched, checked and decoded as one;");
        say!("             errors and tolerances are in the units of the input");
        say!("  there, and why it is needed");
        for item in &self.there {
            say!("    {:>13} B  {}: {}", count(item.bytes), item.what, item.why);
            print_groups(&item.groups, 21)?;
        }
        let sum: u64 = self.there.iter().map(|item| item.bytes).sum();
        if sum == file_bytes {
            say!("    {:>13} B  in all: exactly the size of the file, every byte is named above", count(sum));
        } else {
            say!(
                "    {:>13} B  in all, but the file has {}: this is a defect of lodpack",
                count(sum),
                count(file_bytes)
            );
        }
        say!("  left out, what that saves, and why it is not needed");
        for item in &self.left_out {
            say!("    {}  {}: {}", item.saved.text(), item.what, item.why);
            print_groups(&item.groups, 27)?;
            say!("{:27}[{}]", "", item.saved.how);
        }
        Ok(())
    }
}

/// What both lists are made from.
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
        self.summary.filling_root_counts.values().sum()
    }

    /// Bytes that have to be read before level 0 can be drawn, and those of level 0.
    fn first_bytes(&self) -> u64 {
        let pages = self.section("pages").unwrap_or(0);
        self.summary.bytes - pages + self.levels.first().map_or(0, |level| level.page_bytes)
    }
}

/// Why the roots have a block at a level, or have none.
#[derive(Clone, Default)]
struct BlockReasons {
    /// Blocks that lower their root's error by a fifth.
    better: u64,
    /// Blocks without which their root's error would be above the level's tolerance.
    within_tolerance: u64,
    /// Blocks of grids that finer ones build on.
    base: u64,
    /// All others.
    other: u64,
    /// Roots without a block, and the triangles that they are drawn with: the coarser block keeps the level's tolerance.
    coarser_suffices: [u64; 2],
    /// The same: a finer block would not have been better by a fifth.
    coarser_as_good: [u64; 2],
}

/// Stored errors are rounded up by at most 0.4 %.
const ROUNDING: f64 = 1.004;
/// A block is kept where it lowers the error to this share of the coarser block's.
const BETTER: f64 = 0.8 * ROUNDING;

fn block_reasons(file: &File<Source>, level_count: usize) -> lodpack::Result<Vec<BlockReasons>> {
    let mut reasons = vec![BlockReasons::default(); level_count];
    for root in 0..file.root_count() {
        let contents = file.root_contents(root)?;
        let mut blocks = contents.blocks.iter().peekable();
        let Some(mut coarser) = blocks.next() else { continue };
        for (level, reason) in reasons.iter_mut().enumerate().skip(1) {
            let tolerance = file.level(level).map_or(0.0, |level| level.tolerance * ROUNDING);
            // Where the coarser one is drawn instead, a neighbour may be finer.
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
                let group =
                    if coarser.error <= tolerance { &mut reason.coarser_suffices } else { &mut reason.coarser_as_good };
                group[0] += 1;
                group[1] += u64::from(coarser.triangle_count);
            }
        }
    }
    Ok(reasons)
}

/// A count and what is counted.
fn some(number: u64, word: &str) -> String {
    format!("{} {word}{}", count(number), if number == 1 { "" } else { "s" })
}

fn print_groups(groups: &[Group], indent: usize) -> Result<()> {
    for group in groups {
        say!("{:indent$}{} {}", "", count(group.count), group.why);
    }
    Ok(())
}
