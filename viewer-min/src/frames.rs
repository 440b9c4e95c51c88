//! Frames that overlap: while the device draws one, the next is chosen and written (Niski 2007, section 5.1.6).

use std::{
    collections::VecDeque,
    sync::{Arc, OnceLock},
    time::Instant,
};

use anyhow::Result;
use wgpu::{BufferUsages, SubmissionIndex};

use crate::{
    gpu::Gpu,
    report::{Report, milliseconds},
};

/// Frames that the device may have: with two it draws one while the other is written, and pictures are late by no more
/// than one.
pub const IN_FLIGHT: usize = 2;
/// Two timestamps.
const BYTES: u64 = 16;

/// The frames that the device has not finished.
pub struct Frames {
    gpu: Arc<Gpu>,
    in_flight: usize,
    clock: Option<Clock>,
    under_way: VecDeque<UnderWay>,
    begun: usize,
    drawn: Vec<Report>,
    /// When the last frame was found finished.
    last_end: Option<Instant>,
}

/// Where the device writes when a frame begins and ends.
struct Clock {
    stamps: wgpu::QuerySet,
    /// Nanoseconds of a tick.
    period: f64,
}

struct UnderWay {
    report: Report,
    submission: Option<SubmissionIndex>,
    submitted: Instant,
    /// When it was found finished.
    ended: Arc<OnceLock<Instant>>,
    stamps: Option<wgpu::Buffer>,
}

impl Frames {
    /// Frames of which the device may have so many, at least one: with one, nothing overlaps.
    pub fn new(gpu: &Arc<Gpu>, in_flight: usize) -> Self {
        let clock = gpu.has_clock.then(|| Clock {
            stamps: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2 * in_flight as u32,
            }),
            period: f64::from(gpu.queue.get_timestamp_period()),
        });
        Self {
            gpu: Arc::clone(gpu),
            in_flight,
            clock,
            under_way: VecDeque::new(),
            begun: 0,
            drawn: Vec::new(),
            last_end: None,
        }
    }

    /// Begins a frame, as soon as the device has finished the one before the last. Returns the milliseconds that this
    /// took.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn begin(&mut self) -> Result<f64> {
        let begun = Instant::now();
        while self.under_way.len() >= self.in_flight {
            self.wait_for_first()?;
        }
        let waited = milliseconds(begun.elapsed());
        if let Some(clock) = &self.clock {
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            encoder.write_timestamp(&clock.stamps, self.first_stamp());
            self.gpu.queue.submit([encoder.finish()]);
        }
        Ok(waited)
    }

    /// Ends the frame that was begun: all its commands have been handed over.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn end(&mut self, report: Report) -> Result<()> {
        let gpu = &self.gpu;
        let first = self.first_stamp();
        let timed = self.clock.as_ref().map(|clock| {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.write_timestamp(&clock.stamps, first + 1);
            let resolved = gpu.empty_buffer(BYTES, BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC);
            let mapped = gpu.empty_buffer(BYTES, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
            encoder.resolve_query_set(&clock.stamps, first..first + 2, &resolved, 0);
            encoder.copy_buffer_to_buffer(&resolved, 0, &mapped, 0, BYTES);
            (gpu.queue.submit([encoder.finish()]), mapped)
        });
        let (submission, stamps) = timed.unzip();
        let submission = submission.or_else(|| gpu.last_submission());
        let submitted = Instant::now();
        let ended = Arc::<OnceLock<Instant>>::default();
        stamps.iter().for_each(|stamps| stamps.slice(..).map_async(wgpu::MapMode::Read, |_| ()));
        let end = Arc::clone(&ended);
        gpu.queue.on_submitted_work_done(move || {
            let _ = end.set(Instant::now());
        });
        self.under_way.push_back(UnderWay { report, submission, submitted, ended, stamps });
        self.begun += 1;
        if self.in_flight == 1 { self.finish() } else { Ok(()) }
    }

    /// Waits until all frames are finished.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn finish(&mut self) -> Result<()> {
        while !self.under_way.is_empty() {
            self.wait_for_first()?;
        }
        Ok(())
    }

    /// The frames that were found finished since the last call, with the time that the device took for each. Of one
    /// that has no clock of its own, it is the time in which it had nothing else to do.
    pub fn take_drawn(&mut self) -> Vec<Report> {
        std::mem::take(&mut self.drawn)
    }

    fn first_stamp(&self) -> u32 {
        2 * (self.begun % self.in_flight) as u32
    }

    fn wait_for_first(&mut self) -> Result<()> {
        let Some(UnderWay { report, submission, submitted, ended, stamps }) = self.under_way.pop_front() else {
            return Ok(());
        };
        submission.map_or(Ok(()), |submission| self.gpu.wait_for(submission))?;
        let end = ended.get().copied().unwrap_or_else(Instant::now);
        let begun = self.last_end.map_or(submitted, |last| last.max(submitted));
        self.last_end = Some(end);
        let ticks = stamps.as_ref().and_then(|stamps| {
            let mapped = stamps.slice(..).get_mapped_range().ok()?;
            let (stamps, _) = mapped.as_chunks::<8>();
            let [begin, end] = [stamps.first()?, stamps.get(1)?].map(|bytes| u64::from_le_bytes(*bytes));
            end.checked_sub(begin)
        });
        let of_clock = self.clock.as_ref().zip(ticks).map(|(clock, ticks)| ticks as f64 * clock.period * 1e-6);
        let draw_ms = of_clock.unwrap_or_else(|| milliseconds(end.saturating_duration_since(begun)));
        self.drawn.push(Report { draw_ms, ..report });
        Ok(())
    }
}
