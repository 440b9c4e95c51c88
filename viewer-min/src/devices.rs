//! Several devices draw one picture, each a part of it from left to right, on a thread of its own (Peng 2013, section
//! 5.5). They share what was loaded and decoded; each has the triangles of its part.

use std::{
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use anyhow::{Result, anyhow};
use image::{RgbaImage, imageops};
use lodpack::select::{ScreenLoad, balanced_cuts};

use crate::{
    args::{Cuts, Size, Way},
    draw::{Renderer, Turn},
    gpu::{Gpu, Targets},
    report::{Report, milliseconds},
    shot::Shot,
};

/// The devices, from left to right.
pub struct Devices {
    parts: Vec<Part>,
    cuts: Cuts,
    size: Size,
}

struct Part {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    targets: Targets,
}

impl Devices {
    /// Opens as many devices: one of each adapter, and where there are fewer adapters, several of each.
    ///
    /// # Errors
    /// If there is no adapter.
    pub fn new(count: usize, cuts: Cuts, size: Size, way: Way) -> Result<Self> {
        let part = |number| {
            let gpu = Arc::new(Gpu::numbered(number)?);
            let (renderer, targets) = (Renderer::new(&gpu, way), Targets::smooth(&gpu, [1, size[1]]));
            Ok(Part { gpu, renderer, targets })
        };
        Ok(Self { parts: (0..count).map(part).collect::<Result<_>>()?, cuts, size })
    }

    /// Draws a picture, and adds the times of the slowest device to a report.
    ///
    /// # Errors
    /// If a device is lost.
    pub fn draw(&mut self, shot: &Shot<'_>, report: &mut Report) -> Result<RgbaImage> {
        let begun = Instant::now();
        let count = self.parts.len();
        let loads: Vec<(u32, ScreenLoad)> = shot
            .roots()
            .filter_map(|drawn| {
                let interval = shot.view.interval_of(drawn.surface.bounds)?;
                Some((drawn.surface.root, ScreenLoad { interval, cost: drawn.triangle_count() as f64 }))
            })
            .collect();
        let cuts = match self.cuts {
            Cuts::Balanced => balanced_cuts(&loads.iter().map(|(_, load)| *load).collect::<Vec<_>>(), count),
            Cuts::Equal => (1..count).map(|part| part as f64 / count as f64).collect(),
        };
        // Parts are whole columns of pixels, at least one each.
        let [width, height] = self.size;
        let mut columns = vec![0];
        for (cut, left) in cuts.iter().zip((1..count as u32).rev()) {
            let last = columns.last().copied().unwrap_or(0);
            let least = (last + 1).min(width);
            columns.push(((cut * f64::from(width)).round() as u32).clamp(least, (width - left.min(width)).max(least)));
        }
        columns.push(width);
        report.select_ms += milliseconds(begun.elapsed());
        let drawn: Vec<Result<(RgbaImage, Duration, Report)>> = thread::scope(|scope| {
            let parts = self.parts.iter_mut().zip(columns.windows(2));
            let threads: Vec<_> = parts
                .map(|(part, columns)| {
                    let ends = [0, 1].map(|k| f64::from(columns[k]) / f64::from(width));
                    let size = [columns[1] - columns[0], height];
                    let meets =
                        |(_, load): &&(u32, ScreenLoad)| load.interval[0] <= ends[1] && load.interval[1] >= ends[0];
                    let share = loads.iter().filter(meets).map(|(root, _)| *root).collect();
                    let shot = shot.through([[ends[0], 0.0], [ends[1], 1.0]]);
                    scope.spawn(move || part.draw(&shot, size, share))
                })
                .collect();
            let join = |thread: thread::ScopedJoinHandle<'_, _>| {
                thread.join().unwrap_or_else(|_| Err(anyhow!("a device failed")))
            };
            threads.into_iter().map(join).collect()
        });
        let mut joined = RgbaImage::new(width, height);
        let mut slowest = Duration::ZERO;
        for (part, column) in drawn.into_iter().zip(columns) {
            let (picture, time, of_part) = part?;
            imageops::replace(&mut joined, &picture, column.into(), 0);
            slowest = slowest.max(time);
            report.uploaded += of_part.uploaded;
            report.upload_ms = report.upload_ms.max(of_part.upload_ms);
            report.record_ms = report.record_ms.max(of_part.record_ms);
        }
        report.draw_ms = milliseconds(slowest);
        Ok(joined)
    }

    /// What could not be drawn as wanted since the last call.
    pub fn take_problems(&mut self) -> Vec<String> {
        self.parts.iter_mut().flat_map(|part| part.renderer.take_problems()).collect()
    }
}

impl Part {
    /// Draws roots into a picture of a size. Returns it with the time until it was drawn, without reading it back.
    fn draw(&mut self, shot: &Shot<'_>, size: Size, share: Vec<u32>) -> Result<(RgbaImage, Duration, Report)> {
        let begun = Instant::now();
        if self.targets.size != size {
            self.targets = Targets::smooth(&self.gpu, size);
        }
        self.renderer.share = Some(share);
        let mut report = Report::default();
        self.renderer.draw_shot(&self.targets, shot, Turn::Only, &mut report)?;
        self.gpu.wait()?;
        let time = begun.elapsed();
        Ok((self.targets.colours(&self.gpu)?, time, report))
    }
}
