//! Text and graphs over the picture: counters, frame times, messages and the key card.

use std::collections::VecDeque;

use font8x8::UnicodeFonts;
use image::{Rgba, RgbaImage, imageops};
use lodpack::{View, stream::Counters};

use crate::{args::Way, channel::ShownChannel, report::Report, scene::Scene};

/// Height of a line of text, pixels.
const LINE: u32 = 10;
pub const INK: Rgba<u8> = Rgba([24, 30, 42, 255]);
pub const WARNING: Rgba<u8> = Rgba([176, 20, 20, 255]);
const PAPER: Rgba<u8> = Rgba([255, 255, 255, 190]);
const BAR: Rgba<u8> = Rgba([44, 110, 166, 255]);

/// Fills a rectangle; parts outside the canvas are ignored.
fn fill(canvas: &mut RgbaImage, [x, y]: [u32; 2], [width, height]: [u32; 2], colour: Rgba<u8>) {
    imageops::replace(canvas, &RgbaImage::from_pixel(width, height, colour), x.into(), y.into());
}

/// Writes lines of text on a pale background, down from an upper left corner. Returns the y coordinate below them.
fn write<S: AsRef<str>>(canvas: &mut RgbaImage, [x, y]: [u32; 2], lines: &[S], ink: Rgba<u8>) -> u32 {
    let columns = lines.iter().map(|line| line.as_ref().chars().count()).max().unwrap_or(0) as u32;
    let height = lines.len() as u32 * LINE + 6;
    fill(canvas, [x, y], [columns * 8 + 8, height], PAPER);
    for (row, line) in (0..).zip(lines) {
        for (column, character) in (0..).zip(line.as_ref().chars()) {
            let glyph = font8x8::BASIC_FONTS.get(character).unwrap_or([0; 8]);
            for (dx, dy) in (0..64).map(|bit| (bit % 8, bit / 8)).filter(|&(dx, dy)| glyph[dy as usize] >> dx & 1 == 1)
            {
                let pixel = canvas.get_pixel_mut_checked(x + 4 + column * 8 + dx, y + 4 + row * LINE + dy);
                pixel.into_iter().for_each(|pixel| *pixel = ink);
            }
        }
    }
    y + height
}

/// Writes text, wrapped to the width, above a y coordinate. Returns the y coordinate above the text.
pub fn write_above(canvas: &mut RgbaImage, bottom: u32, text: &str, ink: Rgba<u8>) -> u32 {
    let columns = (canvas.width() / 8).saturating_sub(4).max(8) as usize;
    let characters: Vec<Vec<char>> = text.lines().map(|line| line.chars().collect()).collect();
    let wrapped = characters.iter().flat_map(|line| line.chunks(columns));
    let lines: Vec<String> = wrapped.map(|line| line.iter().collect()).collect();
    if lines.is_empty() {
        return bottom;
    }
    let top = bottom.saturating_sub(lines.len() as u32 * LINE + 14);
    write(canvas, [8, top], &lines, ink);
    top
}

/// Counters, and the times of the last frames.
#[derive(Default)]
pub struct Panel {
    times: VecDeque<f64>,
}

/// The channel that is shown, with the values of the ramp's ends.
fn channel_text(channel: &ShownChannel, kibibytes: u64, report: &Report) -> String {
    let range = channel.values().map(|[low, high]| format!(": {low:.6} (dark) to {high:.6} (bright)"));
    let late = match report.late_textures {
        0 => String::new(),
        late => format!(", {late} missing"),
    };
    let (name, range, texel_px) = (&channel.info.name, range.unwrap_or_default(), report.texel_px);
    format!("channel {name}{range}\n{kibibytes} KiB images, texels up to {texel_px:.2} px{late}\n")
}

/// Frames in the graph.
const SPAN: usize = 200;
/// Height of the graph, in pixels.
const HEIGHT: u32 = 48;

impl Panel {
    /// Records the time of a frame, in milliseconds.
    pub fn record(&mut self, milliseconds: f64) {
        self.times.push_back(milliseconds);
        self.times.drain(..self.times.len().saturating_sub(SPAN));
    }

    pub fn draw(&self, canvas: &mut RgbaImage, scene: &Scene, look: (&View, Way), report: &Report, notes: &str) {
        let (view, way) = look;
        let [pages, surfaces, images] = scene.first.cached_bytes().map(|bytes| bytes / 1024);
        let [counters, of_texels] = scene.first.counters();
        let Counters { requests, bytes_read, stalls, hits, misses, evictions, .. } = counters;
        let (requests, bytes_read) = (requests + of_texels.requests, bytes_read + of_texels.bytes_read);
        let Report { triangles, nodes, error_px, select_ms, upload_ms, draw_ms, late, .. } = *report;
        let limit = |limit: Option<u64>| limit.map_or("-".to_string(), |limit| limit.to_string());
        let mut text = format!(
            "{triangles} triangles (budget {})\n{nodes} of {} nodes (budget {})\n\
             error {error_px:.2} px (tolerance {:.3})\n\
             select {select_ms:.1} upload {upload_ms:.1} draw {draw_ms:.1} ms, {way:?}\n\
             {requests} requests, {} KiB read, {stalls} stalls\n\
             cache {pages} KiB pages, {surfaces} KiB surfaces\n{hits} hits, {misses} misses, {evictions} evictions\n",
            limit(scene.first.query.max_triangles),
            scene.first.root_count(),
            limit(scene.first.query.max_nodes),
            view.pixel_tolerance,
            bytes_read / 1024,
        );
        if !report.is_complete {
            text += &format!("loading: {late} nodes are coarser than wanted\n");
        }
        if let Some(channel) = &scene.first.channel {
            text += &channel_text(channel, images, report);
        }
        text += notes;
        let (x, y) = (8, write(canvas, [8, 8], &text.lines().collect::<Vec<_>>(), INK) + 6);
        let largest = self.times.iter().copied().fold(1.0, f64::max);
        fill(canvas, [x, y], [SPAN as u32 + 8, HEIGHT + 16], PAPER);
        for (column, &time) in (0..).zip(&self.times) {
            let height = ((time / largest) * f64::from(HEIGHT)).round().max(1.0) as u32;
            fill(canvas, [x + 4 + column, y + 2 + HEIGHT - height], [1, height], BAR);
        }
        let last = self.times.back().copied().unwrap_or_default();
        write(canvas, [x, y + HEIGHT + 2], &[format!("{last:.1} ms, at most {largest:.1}")], INK);
    }
}
