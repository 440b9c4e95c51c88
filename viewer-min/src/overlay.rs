//! Text and graphs over the picture: counters, frame times, messages and the key card.

use std::collections::VecDeque;

use font8x8::UnicodeFonts;

use crate::{
    draw::Way,
    picture::Picture,
    scene::{Budget, Report, Scene},
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
const INK: [u8; 4] = [24, 30, 42, 255];
const PAPER: [u8; 4] = [255, 255, 255, 190];
const WARNING: [u8; 4] = [176, 20, 20, 255];

/// Pixels to be put over a picture.
pub struct Canvas {
    /// Width and height.
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
    pub fn fill(&mut self, [x, y]: [u32; 2], [width, height]: [u32; 2], colour: [u8; 4]) {
        for row in y..(y + height).min(self.size[1]) {
            let start = (row * self.size[0]) as usize;
            let (from, to) = (x.min(self.size[0]) as usize, (x + width).min(self.size[0]) as usize);
            self.pixels[start + from..start + to].fill(colour);
        }
    }

    /// Writes lines of text on a pale ground, from an upper left corner on. Returns the y coordinate below.
    pub fn text(&mut self, [x, y]: [u32; 2], lines: &[String], ink: [u8; 4]) -> u32 {
        let columns = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0) as u32;
        let height = lines.len() as u32 * LINE;
        self.fill([x, y], [columns * 8 + 8, height + 6], PAPER);
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
        y + height + 6
    }

    /// Puts it over a picture of the same size.
    pub fn put_over(&self, picture: &mut Picture) {
        for (pixel, [r, g, b, opacity]) in picture.colours.iter_mut().zip(&self.pixels) {
            let mix = |under: u8, over: u8| {
                let (under, over, part) = (u32::from(under), u32::from(over), u32::from(*opacity));
                ((over * part + under * (255 - part) + 127) / 255) as u8
            };
            *pixel = [mix(pixel[0], *r), mix(pixel[1], *g), mix(pixel[2], *b)];
        }
    }
}

/// Counters and frame times of the last frames.
#[derive(Clone, Debug, Default)]
pub struct Panel {
    times: VecDeque<f64>,
}

/// Frames in the graph.
const SPAN: usize = 200;

impl Panel {
    /// Notes how long a frame took, milliseconds.
    pub fn record(&mut self, milliseconds: f64) {
        self.times.push_back(milliseconds);
        if self.times.len() > SPAN {
            self.times.pop_front();
        }
    }

    /// Writes counters, the graph and messages.
    pub fn draw(
        &self,
        canvas: &mut Canvas,
        scene: &Scene,
        report: &Report,
        budget: &Budget,
        way: Way,
        notes: &[String],
    ) {
        let (counters, cached) = scene.counters();
        let limit = |limit: Option<u64>| limit.map_or("-".to_string(), |limit| limit.to_string());
        let kib = |bytes: u64| bytes / 1024;
        let mut lines = vec![
            format!("{} triangles (budget {})", report.triangles, limit(budget.max_triangles)),
            format!("{} of {} nodes (budget {})", report.nodes, scene.roots.len(), limit(budget.max_nodes)),
            format!("error {:.2} px (tolerance {:.3})", report.error_px, budget.tolerance_px),
            format!("select {:.1} upload {:.1} draw {:.1} ms, {way:?}", report.select, report.upload, report.draw),
            format!(
                "{} requests, {} KiB read, {} stalls",
                counters.requests,
                kib(counters.bytes_read),
                counters.stalls
            ),
            format!("cache {} KiB pages, {} KiB surfaces", kib(cached[0]), kib(cached[1])),
            format!("{} hits, {} misses, {} evictions", counters.hits, counters.misses, counters.evictions),
        ];
        if report.late > 0 || !report.is_complete {
            lines.push(format!("loading: {} nodes are coarser than wanted", report.late));
        }
        lines.extend_from_slice(notes);
        let below = canvas.text([8, 8], &lines, INK);
        self.graph(canvas, [8, below + 6]);
    }

    fn graph(&self, canvas: &mut Canvas, [x, y]: [u32; 2]) {
        const HEIGHT: u32 = 48;
        let largest = self.times.iter().copied().fold(1.0, f64::max);
        canvas.fill([x, y], [SPAN as u32 + 8, HEIGHT + 16], PAPER);
        for (column, &time) in (0..).zip(&self.times) {
            let height = ((time / largest) * f64::from(HEIGHT)).round().max(1.0) as u32;
            canvas.fill([x + 4 + column, y + 2 + HEIGHT - height], [1, height], [44, 110, 166, 255]);
        }
        let last = self.times.back().copied().unwrap_or_default();
        let line = format!("{last:.1} ms, at most {largest:.1}");
        let row = canvas.size[0].min(x);
        canvas.text([row, y + HEIGHT + 2], &[line], INK);
    }
}

/// Writes the key card into the lower left corner.
pub fn draw_key_card(canvas: &mut Canvas) {
    let lines: Vec<String> = KEY_CARD.lines().map(str::to_string).collect();
    let top = canvas.size[1].saturating_sub(lines.len() as u32 * LINE + 14);
    canvas.text([8, top], &lines, INK);
}

/// Writes messages at the lower border.
pub fn draw_messages(canvas: &mut Canvas, messages: &[String]) {
    let columns = (canvas.size[0] / 8).saturating_sub(4).max(8) as usize;
    let characters: Vec<Vec<char>> = messages.iter().map(|message| message.chars().collect()).collect();
    let lines: Vec<String> =
        characters.iter().flat_map(|message| message.chunks(columns)).map(|line| line.iter().collect()).collect();
    if !lines.is_empty() {
        let top = canvas.size[1].saturating_sub(lines.len() as u32 * LINE + 14);
        canvas.text([8, top], &lines, WARNING);
    }
}
