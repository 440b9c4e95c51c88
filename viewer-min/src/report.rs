//! What a frame has taken: a row of the table of frames.

use anyhow::Result;
use lodpack::{Limiter, select::FrameTimes};

/// Times and counters of a frame: a row of the table of frames. Times are in milliseconds; those of fetching and
/// decoding are summed over all threads, and `update_ms` lasts until the picture was updated, waiting included.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
#[expect(missing_docs, reason = "the columns of the table have these names and units")]
pub struct Report {
    pub frame: usize,
    pub select_ms: f64,
    pub fetch_ms: f64,
    pub decode_ms: f64,
    pub update_ms: f64,
    /// Of the processor: for handing over what is new, and for writing the commands.
    pub upload_ms: f64,
    pub record_ms: f64,
    /// Of the device, which does this beside the next frame.
    pub draw_ms: f64,
    /// How long the processor waited for the device.
    pub wait_ms: f64,
    /// Of the processor: all of the frame, waiting included.
    pub frame_ms: f64,
    pub nodes: usize,
    pub triangles: u64,
    /// Bytes that were read.
    pub bytes: u64,
    /// Bytes that were uploaded.
    pub uploaded: u64,
    /// 1 if the frame waited for pages.
    pub stalls: u8,
    /// Roots drawn coarser than wanted.
    pub late: u32,
    /// Roots drawn without images that they need.
    pub late_textures: u32,
    /// Largest screen error of the visible nodes, in pixels.
    pub error_px: f64,
    /// Size of the largest visible texel, in pixels.
    pub texel_px: f64,
    /// 1 if a whole surface is drawn: the overview or all roots.
    pub surface: u8,
    /// Whether everything is drawn as wanted.
    #[serde(skip)]
    pub is_complete: bool,
    /// The budget that even the coarsest cut of the view exceeds, if there is one. That cut is drawn.
    #[serde(skip)]
    pub exceeded: Option<Limiter>,
}

impl Report {
    /// Of two things in one picture.
    pub(crate) fn and(self, other: &Self) -> Self {
        Self {
            select_ms: self.select_ms + other.select_ms,
            fetch_ms: self.fetch_ms + other.fetch_ms,
            decode_ms: self.decode_ms + other.decode_ms,
            update_ms: self.update_ms + other.update_ms,
            nodes: self.nodes + other.nodes,
            triangles: self.triangles + other.triangles,
            bytes: self.bytes + other.bytes,
            stalls: self.stalls.max(other.stalls),
            late: self.late + other.late,
            late_textures: self.late_textures + other.late_textures,
            error_px: self.error_px.max(other.error_px),
            texel_px: self.texel_px.max(other.texel_px),
            surface: self.surface.min(other.surface),
            is_complete: self.is_complete && other.is_complete,
            exceeded: self.exceeded.or(other.exceeded),
            ..self
        }
    }

    /// Whether the picture is the same, as far as is known.
    fn is_as(&self, other: &Self) -> bool {
        let of = |report: &Self| (report.nodes, report.triangles, report.error_px.to_bits());
        of(self) == of(other)
    }

    /// What performance mode has to know: the slower one of processor and device decides, since they work side by side.
    pub(crate) fn times(&self) -> FrameTimes {
        FrameTimes {
            frame: self.draw_ms.max(self.frame_ms - self.wait_ms),
            adapt: self.select_ms,
            node_count: self.nodes as u64,
            triangle_count: self.triangles,
            upload_bytes: self.uploaded,
        }
    }

    /// Says that a budget is too small for the view, if it is.
    pub(crate) fn complaint(&self) -> Option<String> {
        let what = match self.exceeded? {
            Limiter::Nodes => "--max-nodes",
            Limiter::Triangles => "--max-triangles",
            _ => "a budget",
        };
        Some(format!("{what} is too small for this view: its coarsest cut takes more; raise it"))
    }
}

/// Frames for one picture, at most. A tree has fewer heights of lists, and budgets are shared out after fewer.
const MOST_FRAMES: usize = 64;

/// Draws until a frame is as the one before, and says itself that it stays: what could not be loaded by then does not
/// come either.
pub(crate) fn until_it_stays(mut draw: impl FnMut() -> Result<(Report, bool)>) -> Result<Report> {
    let (mut report, _) = draw()?;
    for _ in 0..MOST_FRAMES {
        let (next, stays) = draw()?;
        if stays && next.is_as(&report) {
            break;
        }
        report = next;
    }
    Ok(report)
}

/// In milliseconds, as in tables.
pub(crate) fn milliseconds(time: std::time::Duration) -> f64 {
    rounded(time.as_secs_f64() * 1e3)
}

/// Rounded to three digits.
pub(crate) fn rounded(number: f64) -> f64 {
    (number * 1e3).round() / 1e3
}
