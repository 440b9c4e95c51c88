//! Text and graphs over the picture: counters, frame times, messages and the key card.

use std::collections::VecDeque;

use font8x8::UnicodeFonts;

use crate::{
    args::Way,
    picture::Picture,
    scene::{Report, Scene},
};

/// What keys do; shown by `--help` and in the window.
pub const KEY_CARD: &str = "\
Keys in the window
  drag left, touchpad   orbit             W A S D Q E   fly
  drag right            look around       wheel         nearer, farther
  + -   tolerance half, double            T U           triangle budget double, half
  N M   node budget double, half          P             hold 30 frames a second
  1 2 3 4   shading, nodes, levels, errors
  L   wireframe      B   seams            V             stitched or pulled
  F   freeze the cut                      I             counters
  X   screenshot     R   record a path    C             camera: recent, back
  O   whole model    Y   read again what failed
  H   this card      Esc close            drop a file   open it
";

/// Height of a line of text, pixels.
const LINE: u32 = 10;
pub const INK: [u8; 4] = [24, 30, 42, 255];
pub const WARNING: [u8; 4] = [176, 20, 20, 255];
const PAPER: [u8; 4] = [255, 255, 255, 190];
const BAR: [u8; 4] = [44, 110, 166, 255];

/// Pixels to be put over a picture.
#[derive(Default)]
pub struct Canvas {
    pub size: [u32; 2],
    /// Red, green, blue, opacity.
    pub pixels: Vec<[u8; 4]>,
}

impl Canvas {
    /// Nothing on it.
    pub fn new(size: [u32; 2]) -> Self {
        Self { size, pixels: vec![[0; 4]; size[0] as usize * size[1] as usize] }
    }

    /// Fills a rectangle; what lies outside is left out.
    fn fill(&mut self, [x, y]: [u32; 2], [width, height]: [u32; 2], colour: [u8; 4]) {
        for row in y..(y + height).min(self.size[1]) {
            let (from, to) = (x.min(self.size[0]), (x + width).min(self.size[0]));
            let start = row * self.size[0];
            self.pixels[(start + from) as usize..(start + to) as usize].fill(colour);
        }
    }

    /// Writes lines of text on a pale ground, from an upper left corner on. Returns the y coordinate below.
    fn text<'t>(&mut self, [x, y]: [u32; 2], lines: impl Iterator<Item = &'t str> + Clone, ink: [u8; 4]) -> u32 {
        let columns = lines.clone().map(|line| line.chars().count()).max().unwrap_or(0) as u32;
        let height = lines.clone().count() as u32 * LINE + 6;
        self.fill([x, y], [columns * 8 + 8, height], PAPER);
        for (row, line) in (0..).zip(lines) {
            for (column, character) in (0..).zip(line.chars()) {
                let glyph = font8x8::BASIC_FONTS.get(character).unwrap_or([0; 8]);
                for (dy, bits) in (0..).zip(glyph) {
                    for dx in (0..8).filter(|dx| bits >> dx & 1 == 1) {
                        self.fill([x + 4 + column * 8 + dx, y + 4 + row * LINE + dy], [1, 1], ink);
                    }
                }
            }
        }
        y + height
    }

    /// Writes text at the lower border, wrapped to the width.
    pub fn text_below(&mut self, text: &str, ink: [u8; 4]) {
        let columns = (self.size[0] / 8).saturating_sub(4).max(8) as usize;
        let characters: Vec<Vec<char>> = text.lines().map(|line| line.chars().collect()).collect();
        let wrapped = characters.iter().flat_map(|line| line.chunks(columns));
        let lines: Vec<String> = wrapped.map(|line| line.iter().collect()).collect();
        let top = self.size[1].saturating_sub(lines.len() as u32 * LINE + 14);
        if !lines.is_empty() {
            self.text([8, top], lines.iter().map(String::as_str), ink);
        }
    }

    /// Puts it over a picture of the same size.
    pub fn put_over(&self, picture: &mut Picture) {
        for (pixel, &[r, g, b, opacity]) in picture.colours.iter_mut().zip(&self.pixels) {
            let part = u32::from(opacity);
            let mix = |over: u8, under: u8| (u32::from(over) * part + u32::from(under) * (255 - part) + 127) / 255;
            *pixel = [mix(r, pixel[0]), mix(g, pixel[1]), mix(b, pixel[2])].map(|x| x as u8);
        }
    }
}

/// Counters and frame times of the last frames.
#[derive(Default)]
pub struct Panel {
    times: VecDeque<f64>,
}

/// Frames in the graph.
const SPAN: usize = 200;

impl Panel {
    /// Notes how long a frame took, milliseconds.
    pub fn record(&mut self, milliseconds: f64) {
        self.times.push_back(milliseconds);
        self.times.drain(..self.times.len().saturating_sub(SPAN));
    }

    /// Writes counters, notes and the graph.
    pub fn draw(&self, canvas: &mut Canvas, scene: &Scene, report: &Report, way: Way, notes: &str) {
        let ([pages, surfaces], budget) = (scene.session.cached_bytes().map(|bytes| bytes / 1024), scene.query);
        let lodpack::session::Counters { requests, bytes_read, stalls, hits, misses, evictions, .. } =
            scene.session.counters();
        let Report { triangles, nodes, error_px, select_ms, upload_ms, draw_ms, late, .. } = *report;
        let limit = |limit: Option<u64>| limit.map_or("-".to_string(), |limit| limit.to_string());
        let mut text = format!(
            "{triangles} triangles (budget {})\n{nodes} of {} nodes (budget {})\n\
             error {error_px:.2} px (tolerance {:.3})\n\
             select {select_ms:.1} upload {upload_ms:.1} draw {draw_ms:.1} ms, {way:?}\n\
             {requests} requests, {} KiB read, {stalls} stalls\n\
             cache {pages} KiB pages, {surfaces} KiB surfaces\n{hits} hits, {misses} misses, {evictions} evictions\n",
            limit(budget.max_triangles),
            scene.roots.len(),
            limit(budget.max_nodes),
            scene.tolerance_px,
            bytes_read / 1024,
        );
        if !report.is_complete {
            text += &format!("loading: {late} nodes are coarser than wanted\n");
        }
        text += notes;
        let below = canvas.text([8, 8], text.lines(), INK);
        self.graph(canvas, [8, below + 6]);
    }

    fn graph(&self, canvas: &mut Canvas, [x, y]: [u32; 2]) {
        const HEIGHT: u32 = 48;
        let largest = self.times.iter().copied().fold(1.0, f64::max);
        canvas.fill([x, y], [SPAN as u32 + 8, HEIGHT + 16], PAPER);
        for (column, &time) in (0..).zip(&self.times) {
            let height = ((time / largest) * f64::from(HEIGHT)).round().max(1.0) as u32;
            canvas.fill([x + 4 + column, y + 2 + HEIGHT - height], [1, height], BAR);
        }
        let last = self.times.back().copied().unwrap_or_default();
        let line = format!("{last:.1} ms, at most {largest:.1}");
        canvas.text([x, y + HEIGHT + 2], std::iter::once(line.as_str()), INK);
    }
}
