//! Performance mode: holds a frame time (Niski 2007, section 7.7; formulas of section 7.3).
//!
//! A pure controller: times go in, a tolerance and a node budget come out. Two stages alternate. The first moves the
//! tolerance,
//!
//! > error_new = sqrt(time_old / time_target) error_old,
//!
//! until the frame time is near its target. The second then tries a node budget that is one step larger, later one step
//! smaller, and keeps it if frames have become faster, so that the first can lower the error again. If adapting takes
//! too long, the node budget is lowered:
//!
//! > nodes_new = sqrt(time_target / time_old) nodes_old.
//!
//! The square roots make each step half as large, in logarithms, as a cost proportional to 1 / error would need:
//! they "promote hysteresis and temporal coherence". Times are means over a window of frames.

use crate::error::{Error, Result};

/// The times to hold, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerformanceTarget {
    /// Time for drawing a frame, in any unit; above zero.
    pub frame_time: f64,
    /// Longest time for adapting in a frame, in the same unit; above zero.
    pub adapt_time: f64,
    /// The number of frames between two adjustments, over which times are averaged; at least one.
    pub window: u32,
    /// How near the frame time has to come before node budgets are tried, as a fraction of the target.
    pub nearness: f64,
    /// Step by which the node budget is changed.
    pub node_step: u64,
}

impl Default for PerformanceTarget {
    /// 60 frames a second in milliseconds, a quarter of that for adapting.
    fn default() -> Self {
        Self { frame_time: 1000.0 / 60.0, adapt_time: 1000.0 / 240.0, window: 3, nearness: 0.05, node_step: 32 }
    }
}

/// The limits for the next frame's cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controls {
    /// Tolerance, in pixels or world units as the caller's query has it.
    pub tolerance: f64,
    /// Node budget.
    pub max_nodes: u64,
}

/// What a frame took, in the unit of the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTimes {
    /// Drawing.
    pub frame: f64,
    /// Adapting.
    pub adapt: f64,
    /// Nodes of the frame's cut. More than the budget means that no cut has fewer.
    pub node_count: u64,
}

/// A change of the node budget on trial.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Trial {
    /// Budget and frame time before.
    max_nodes: u64,
    frame_time: f64,
}

/// Holds a frame time from frame to frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PerformanceMode {
    target: PerformanceTarget,
    controls: Controls,
    /// Limits of tolerance and node budget.
    tolerances: [f64; 2],
    node_counts: [u64; 2],
    /// Times of this window so far: drawing and adapting.
    sums: [f64; 2],
    frame_count: u32,
    /// The fewest nodes that could show what was in sight when fewer were last tried, and windows until fewer are tried
    /// again.
    least_nodes: u64,
    least_nodes_hold: u32,
    trial: Option<Trial>,
    grows: bool,
    /// Windows until a node budget is tried again: the last trials have brought nothing.
    rest: u32,
}

/// Windows without a trial after one in each direction has failed, or after a node budget was too small.
const REST: u32 = 8;

impl PerformanceMode {
    /// Begins with `controls`, and keeps the tolerance and the node budget within limits.
    ///
    /// # Errors
    /// [`Error::Query`] if a time, a tolerance or the window is not above zero, or limits are in the wrong order.
    pub fn new(
        target: PerformanceTarget,
        controls: Controls,
        tolerances: [f64; 2],
        node_counts: [u64; 2],
    ) -> Result<Self> {
        let is_sound = target.frame_time > 0.0
            && target.adapt_time > 0.0
            && target.window > 0
            && tolerances[0] > 0.0
            && tolerances[0] <= tolerances[1]
            && 0 < node_counts[0]
            && node_counts[0] <= node_counts[1]
            && controls.tolerance > 0.0;
        if !is_sound {
            let what = "performance mode needs times, a window and limits above zero, with the smaller limit first";
            return Err(Error::Query { what: what.into() });
        }
        let mut this = Self {
            target,
            controls,
            tolerances,
            node_counts,
            sums: [0.0; 2],
            frame_count: 0,
            least_nodes: 0,
            least_nodes_hold: 0,
            trial: None,
            grows: true,
            rest: 0,
        };
        this.set_tolerance(controls.tolerance);
        this.set_nodes(controls.max_nodes);
        Ok(this)
    }

    /// What the next frame is to be adapted to.
    pub fn controls(&self) -> Controls {
        self.controls
    }

    /// Records a frame and returns the limits for the next one. Ignores times that are not numbers above zero.
    pub fn record(&mut self, times: FrameTimes) -> Controls {
        if !(times.frame > 0.0 && times.frame.is_finite() && times.adapt >= 0.0 && times.adapt.is_finite()) {
            return self.controls;
        }
        // A cut with more nodes than asked for is the smallest; one with fewer shows that fewer suffice.
        if times.node_count > self.controls.max_nodes {
            (self.least_nodes, self.least_nodes_hold) = (times.node_count, REST);
            self.set_nodes(times.node_count);
        }
        self.least_nodes = self.least_nodes.min(times.node_count);
        self.sums = [self.sums[0] + times.frame, self.sums[1] + times.adapt];
        self.frame_count += 1;
        if self.frame_count == self.target.window {
            let [frame, adapt] = self.sums.map(|sum| sum / f64::from(self.frame_count));
            (self.sums, self.frame_count) = ([0.0; 2], 0);
            self.least_nodes_hold = self.least_nodes_hold.saturating_sub(1);
            if self.least_nodes_hold == 0 {
                self.least_nodes = 0;
            }
            self.adjust(frame, adapt);
        }
        self.controls
    }

    /// Takes the mean times of a window, drawing and adapting.
    fn adjust(&mut self, frame: f64, adapt: f64) {
        let ratio = frame / self.target.frame_time;
        let is_near = (ratio - 1.0).abs() <= self.target.nearness;
        if let Some(trial) = self.trial.take() {
            // Less than a fiftieth is noise.
            if frame < trial.frame_time * 0.98 {
                self.rest = 0;
            } else {
                self.set_nodes(trial.max_nodes);
                // After growing shrinking is tried, after both nothing for a while.
                self.rest = if self.grows { 0 } else { REST };
                self.grows = !self.grows;
                if is_near {
                    return;
                }
            }
        }
        if adapt > self.target.adapt_time {
            let nodes = (self.target.adapt_time / adapt).sqrt() * self.controls.max_nodes as f64;
            self.set_nodes(nodes as u64);
        }
        if !is_near {
            self.set_tolerance(ratio.sqrt() * self.controls.tolerance);
            return;
        }
        if self.rest > 0 {
            self.rest -= 1;
            return;
        }
        let (max_nodes, step) = (self.controls.max_nodes, self.target.node_step);
        let tried = if self.grows { max_nodes.saturating_add(step) } else { max_nodes.saturating_sub(step) };
        let may_grow = !self.grows || adapt < 0.9 * self.target.adapt_time;
        if may_grow {
            self.set_nodes(tried);
            self.trial = Some(Trial { max_nodes, frame_time: frame });
        } else {
            self.grows = false;
        }
    }

    fn set_tolerance(&mut self, tolerance: f64) {
        self.controls.tolerance = tolerance.clamp(self.tolerances[0], self.tolerances[1]);
    }

    fn set_nodes(&mut self, max_nodes: u64) {
        self.controls.max_nodes = max_nodes.max(self.least_nodes).clamp(self.node_counts[0], self.node_counts[1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A renderer: the triangles that a tolerance and a node budget take, and the time for these.
    struct Renderer {
        /// Times per millisecond.
        speed: f64,
        noise: f64,
        state: u64,
    }

    impl Renderer {
        fn draw(&mut self, controls: Controls) -> FrameTimes {
            self.state ^= self.state << 13;
            self.state ^= self.state >> 7;
            self.state ^= self.state << 17;
            let noise = 1.0 + self.noise * ((self.state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0);
            let nodes = controls.max_nodes as f64;
            // More nodes fit better; each costs a call.
            let triangles = 1e6 / controls.tolerance * (1.0 + 60.0 / nodes);
            FrameTimes {
                frame: (triangles * 1e-5 + nodes * 2e-3) / self.speed * noise,
                adapt: nodes * 1e-3 * noise,
                node_count: controls.max_nodes,
            }
        }
    }

    fn mode(tolerance: f64) -> PerformanceMode {
        let controls = Controls { tolerance, max_nodes: 500 };
        PerformanceMode::new(PerformanceTarget::default(), controls, [1e-3, 1e3], [16, 100_000]).unwrap()
    }

    /// Means of ten frames, relative to the target, from the 30th on.
    fn run(mode: &mut PerformanceMode, renderer: &mut Renderer, frames: u32) -> Vec<f64> {
        let times: Vec<f64> = (0..frames)
            .map(|_| {
                let times = renderer.draw(mode.controls());
                mode.record(times);
                times.frame / PerformanceTarget::default().frame_time
            })
            .collect();
        times[30..].windows(10).map(|ten| ten.iter().sum::<f64>() / 10.0).collect()
    }

    #[test]
    fn converges_within_thirty_frames_and_holds_through_a_threefold_change_of_speed() {
        for noise in [0.0, 0.03, 0.1] {
            for start in [0.05, 0.3, 1.0, 10.0] {
                let (mut mode, mut renderer) = (mode(start), Renderer { speed: 1.0, noise, state: 77 });
                for speed in [1.0, 3.0, 1.0, 1.0 / 3.0] {
                    renderer.speed = speed;
                    for mean in run(&mut mode, &mut renderer, 150) {
                        assert!((mean - 1.0).abs() <= 0.1, "noise {noise}, start {start}, speed {speed}: {mean}");
                    }
                }
            }
        }
    }

    #[test]
    fn finds_a_node_budget_that_draws_faster() {
        let (mut mode, mut renderer) = (mode(1.0), Renderer { speed: 1.0, noise: 0.0, state: 1 });
        mode.controls.max_nodes = 32;
        run(&mut mode, &mut renderer, 60);
        let early = mode.controls();
        run(&mut mode, &mut renderer, 600);
        let late = mode.controls();
        assert!(late.max_nodes > early.max_nodes && late.tolerance < early.tolerance, "{early:?} {late:?}");
    }

    #[test]
    fn slow_adapting_lowers_the_node_budget() {
        let (mut mode, mut renderer) = (mode(1.0), Renderer { speed: 1.0, noise: 0.0, state: 1 });
        mode.controls.max_nodes = 60_000;
        run(&mut mode, &mut renderer, 90);
        assert!(mode.controls().max_nodes as f64 * 1e-3 < PerformanceTarget::default().adapt_time * 1.1);
    }

    #[test]
    fn the_node_budget_is_rarely_below_what_is_in_sight() {
        let mut mode = mode(1.0);
        // Adapting takes too long whatever the budget; the camera sees this many roots, which cannot be fewer nodes.
        let mut record = |roots: u64| {
            let node_count = mode.controls().max_nodes.max(roots);
            mode.record(FrameTimes { frame: 1.0, adapt: 100.0, node_count }).max_nodes
        };
        let mut last = |roots: u64| (0..240).map(|_| record(roots)).collect::<Vec<u64>>().split_off(120);
        for roots in [120, 300, 50] {
            // A smaller one is tried now and then, in case that fewer are in sight.
            let budgets = last(roots);
            let kept = budgets.iter().filter(|&&budget| budget == roots).count();
            assert!(kept >= 100 && budgets.iter().all(|&budget| budget <= roots), "{roots}: {budgets:?}");
        }
    }

    #[test]
    fn nonsense_is_refused_or_left_out() {
        let target = PerformanceTarget { frame_time: 0.0, ..PerformanceTarget::default() };
        let controls = Controls { tolerance: 1.0, max_nodes: 1 };
        assert!(PerformanceMode::new(target, controls, [1.0, 2.0], [1, 2]).is_err());
        let target = PerformanceTarget::default();
        assert!(PerformanceMode::new(target, controls, [2.0, 1.0], [1, 2]).is_err());
        let mut mode = mode(1.0);
        for _ in 0..20 {
            mode.record(FrameTimes { frame: f64::NAN, adapt: 0.0, node_count: 1 });
        }
        assert_eq!(mode.controls().tolerance, 1.0);
    }
}
