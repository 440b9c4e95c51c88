//! Performance mode: the parameters that nobody should have to set (Niski 2007, section 7.7; Peng 2013, section 4.7.5).
//!
//! A pure controller: what frames have taken goes in, a tolerance and budgets come out. A [`FrameModel`] says what a
//! frame with so many nodes and triangles would take, so one step leads to the goal, where the square roots of the
//! thesis come near it by halves. They remain for what the model does not explain: the goal of a step is corrected by
//!
//! > goal_new = sqrt(time_target / time_old) goal_old
//!
//! as often as a window of frames misses it.

use super::frame_model::{FrameModel, FrameTimes};
use crate::error::{Error, Result};

/// What performance mode holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PerformanceGoal {
    /// The time of a frame, in the unit of the times that are recorded; above zero. Errors are as small as it allows,
    /// but no smaller than the tolerance.
    FrameTime(f64),
    /// The tolerance, however long frames take.
    Quality,
    /// This share of the triangles a second that the machine could draw in endless frames, above 0 and below 1: frames
    /// as short as that allows.
    Throughput(f64),
}

/// The goal, and the limits of what performance mode chooses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerformanceTarget {
    /// What is held.
    pub goal: PerformanceGoal,
    /// Tolerance, in pixels or world units as the caller's query has it: nothing is drawn finer; above zero.
    pub tolerance: f64,
    /// Longest time for adapting in a frame, in the unit of the times that are recorded; above zero.
    pub adapt_time: f64,
    /// The fewest and the most nodes; at least one.
    pub nodes: [u64; 2],
    /// The fewest and the most triangles; at least one.
    pub triangles: [u64; 2],
}

impl Default for PerformanceTarget {
    /// 60 frames a second in milliseconds, a quarter of that for adapting; half a pixel.
    fn default() -> Self {
        Self {
            goal: PerformanceGoal::FrameTime(1000.0 / 60.0),
            tolerance: 0.5,
            adapt_time: 1000.0 / 240.0,
            nodes: [16, u64::MAX],
            triangles: [1000, u64::MAX],
        }
    }
}

/// The limits for the next frame's cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controls {
    /// Tolerance, in pixels or world units as the caller's query has it.
    pub tolerance: f64,
    /// Node budget.
    pub max_nodes: u64,
    /// Triangle budget.
    pub max_triangles: u64,
}

/// Triangles before any frame was drawn.
const FIRST_TRIANGLES: u64 = 100_000;
/// Triangles change by this factor at most from frame to frame.
const STEP: f64 = 8.0;
/// Frames after which the goal is corrected, and by how much at most.
const WINDOW: u32 = 8;
const CORRECTION: [f64; 2] = [0.5, 2.0];
/// Nearer to its goal than this share nothing is corrected, nor farther off.
const NEAR: f64 = 0.02;
const FAR: f64 = 0.25;

/// Holds a goal from frame to frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PerformanceMode {
    target: PerformanceTarget,
    controls: Controls,
    model: FrameModel,
    /// What adapting takes a node; a mean of the last frames.
    adapt_cost: f64,
    /// Bytes of an upload; a mean of the last frames.
    upload_bytes: f64,
    /// What the time of the goal is multiplied with, since frames take more or less than predicted.
    correction: f64,
    /// Times of this window so far.
    sum: f64,
    frame_count: u32,
}

impl PerformanceMode {
    /// Begins with a target.
    ///
    /// # Errors
    /// [`Error::Query`] if a goal, a time, a tolerance or a budget is not above zero, or limits are in the wrong order.
    pub fn new(target: PerformanceTarget) -> Result<Self> {
        let is_above_zero = |number: f64| number > 0.0 && number.is_finite();
        let has_order = |[least, most]: [u64; 2]| 0 < least && least <= most;
        let is_goal = match target.goal {
            PerformanceGoal::FrameTime(time) => is_above_zero(time),
            PerformanceGoal::Quality => true,
            PerformanceGoal::Throughput(share) => is_above_zero(share) && share < 1.0,
        };
        let is_sound = is_goal
            && is_above_zero(target.tolerance)
            && is_above_zero(target.adapt_time)
            && has_order(target.nodes)
            && has_order(target.triangles);
        if !is_sound {
            let what = "performance mode needs a goal, times, a tolerance and budgets above zero, with the smaller \
                        limit first";
            return Err(Error::Query { what: what.into() });
        }
        let max_triangles = match target.goal {
            PerformanceGoal::Quality => target.triangles[1],
            _ => FIRST_TRIANGLES.clamp(target.triangles[0], target.triangles[1]),
        };
        Ok(Self {
            target,
            controls: Controls { tolerance: target.tolerance, max_nodes: target.nodes[1], max_triangles },
            model: FrameModel::default(),
            adapt_cost: 0.0,
            upload_bytes: 0.0,
            correction: 1.0,
            sum: 0.0,
            frame_count: 0,
        })
    }

    /// What the next frame is to be adapted to.
    pub fn controls(&self) -> Controls {
        self.controls
    }

    /// What frames take.
    pub fn model(&self) -> &FrameModel {
        &self.model
    }

    /// Records a frame and returns the limits for the next one. Ignores times that are not numbers above zero.
    pub fn record(&mut self, times: FrameTimes) -> Controls {
        let is_sound = times.frame > 0.0 && times.frame.is_finite() && times.adapt >= 0.0 && times.adapt.is_finite();
        if !is_sound {
            return self.controls;
        }
        let is_first = self.model.costs() == [0.0; 4];
        self.model.record(&times);
        let mean = |before: f64, now: f64| if is_first { now } else { before + (now - before) / f64::from(WINDOW) };
        // What adapting costs a node is known where it takes long. Of a file that is beginning to load, a few nodes may
        // take long as well: that is soon forgotten.
        self.adapt_cost = if times.adapt > self.target.adapt_time / 2.0 {
            mean(self.adapt_cost, times.adapt / times.node_count.max(1) as f64)
        } else {
            self.adapt_cost / 2.0
        };
        self.upload_bytes = mean(self.upload_bytes, times.upload_bytes as f64);
        let [fixed, of_node, of_triangle, of_byte] = self.model.costs();
        let rest = fixed + of_node * times.node_count as f64 + of_byte * self.upload_bytes;
        let triangles = match self.target.goal {
            PerformanceGoal::Quality => f64::INFINITY,
            PerformanceGoal::Throughput(share) => share / (1.0 - share) * rest / of_triangle,
            PerformanceGoal::FrameTime(time) => {
                self.correct(time, &times);
                (time * self.correction - rest) / of_triangle
            }
        };
        let drawn = times.triangle_count.max(1) as f64;
        let stepwise = triangles.clamp(drawn / STEP, (drawn * STEP).max(FIRST_TRIANGLES as f64));
        let triangles =
            if triangles.is_nan() || self.target.goal == PerformanceGoal::Quality { triangles } else { stepwise };
        if !triangles.is_nan() {
            let [least, most] = self.target.triangles;
            self.controls.max_triangles = (triangles as u64).clamp(least, most);
        }
        let [least, most] = self.target.nodes;
        // What a node costs to draw says nothing here: fewer nodes are no cheaper where they have more triangles each.
        let nodes = self.target.adapt_time / self.adapt_cost;
        self.controls.max_nodes = if nodes.is_nan() { most } else { (nodes as u64).clamp(least, most) };
        self.controls
    }

    /// Corrects the goal where a window of frames has missed it. Frames that the tolerance keeps short do not count,
    /// nor those that miss it by far: they teach the model.
    fn correct(&mut self, goal: f64, times: &FrameTimes) {
        let is_limited = times.triangle_count as f64 > 0.9 * self.controls.max_triangles as f64;
        if !is_limited || (times.frame / goal - 1.0).abs() > FAR {
            (self.sum, self.frame_count) = (0.0, 0);
            return;
        }
        self.sum += times.frame;
        self.frame_count += 1;
        if self.frame_count == WINDOW {
            let ratio = goal * f64::from(WINDOW) / self.sum;
            if (ratio - 1.0).abs() > NEAR {
                self.correction = (self.correction * ratio.sqrt()).clamp(CORRECTION[0], CORRECTION[1]);
            }
            (self.sum, self.frame_count) = (0.0, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A renderer: the triangles that it has in sight, and the time for those that it draws.
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
            let node_count = controls.max_nodes.min(2000);
            let most = 5e7 / controls.tolerance * (1.0 + 60.0 / node_count as f64);
            let triangle_count = controls.max_triangles.min(most as u64);
            let (nodes, triangles) = (node_count as f64, triangle_count as f64);
            FrameTimes {
                frame: (1.0 + triangles * 1e-5 + nodes * 2e-3) / self.speed * noise,
                adapt: nodes * 1e-3 * noise,
                node_count,
                triangle_count,
                upload_bytes: 0,
            }
        }
    }

    fn mode(goal: PerformanceGoal) -> PerformanceMode {
        PerformanceMode::new(PerformanceTarget { goal, ..PerformanceTarget::default() }).unwrap()
    }

    /// Times of frames, relative to the target.
    fn run(mode: &mut PerformanceMode, renderer: &mut Renderer, frames: u32) -> Vec<f64> {
        let frame = |_| {
            let times = renderer.draw(mode.controls());
            mode.record(times);
            times.frame * 60.0 / 1000.0
        };
        (0..frames).map(frame).collect()
    }

    #[test]
    fn converges_within_ten_frames_and_holds_through_a_threefold_change_of_speed() {
        for noise in [0.0, 0.03, 0.1] {
            let (mut mode, mut renderer) =
                (mode(PerformanceGoal::FrameTime(1000.0 / 60.0)), Renderer { speed: 1.0, noise, state: 77 });
            for speed in [1.0, 3.0, 1.0, 1.0 / 3.0] {
                renderer.speed = speed;
                let times = run(&mut mode, &mut renderer, 150);
                for ten in times[10..].windows(10) {
                    let mean = ten.iter().sum::<f64>() / 10.0;
                    assert!((mean - 1.0).abs() <= 0.05 + noise * 0.7, "noise {noise}, speed {speed}: {mean}");
                }
            }
        }
    }

    #[test]
    fn quality_keeps_the_tolerance_and_throughput_most_of_the_triangles_a_second() {
        let (mut quality, mut renderer) =
            (mode(PerformanceGoal::Quality), Renderer { speed: 1.0, noise: 0.0, state: 1 });
        run(&mut quality, &mut renderer, 20);
        let controls = quality.controls();
        assert_eq!((controls.tolerance, controls.max_triangles), (0.5, u64::MAX));
        for share in [0.5, 0.9] {
            let mut throughput = mode(PerformanceGoal::Throughput(share));
            run(&mut throughput, &mut renderer, 50);
            let times = renderer.draw(throughput.controls());
            let of_most = times.triangle_count as f64 / times.frame * 1e-5;
            assert!((of_most / share - 1.0).abs() < 0.05, "{share}: {of_most}");
        }
    }

    #[test]
    fn slow_adapting_lowers_the_node_budget() {
        let (mut mode, mut renderer) =
            (mode(PerformanceGoal::FrameTime(1e4)), Renderer { speed: 1.0, noise: 0.0, state: 1 });
        mode.target.adapt_time = 0.5;
        run(&mut mode, &mut renderer, 30);
        assert!((490..=510).contains(&mode.controls().max_nodes), "{:?}", mode.controls());
    }

    #[test]
    fn a_few_slow_frames_of_a_few_nodes_are_soon_forgotten() {
        let (mut mode, mut renderer) =
            (mode(PerformanceGoal::FrameTime(1000.0 / 60.0)), Renderer { speed: 1.0, noise: 0.0, state: 1 });
        for _ in 0..5 {
            let controls = mode.record(FrameTimes { frame: 20.0, adapt: 20.0, node_count: 2, ..FrameTimes::default() });
            assert_eq!(controls.max_nodes, 16);
        }
        run(&mut mode, &mut renderer, 12);
        assert!(mode.controls().max_nodes >= 1000, "{:?}", mode.controls());
    }

    #[test]
    fn frames_that_the_tolerance_keeps_short_do_not_lower_errors_that_come_later() {
        let (mut mode, mut renderer) =
            (mode(PerformanceGoal::FrameTime(1000.0 / 60.0)), Renderer { speed: 1.0, noise: 0.0, state: 1 });
        mode.controls.tolerance = 500.0;
        run(&mut mode, &mut renderer, 200);
        assert_eq!(mode.correction, 1.0);
    }

    #[test]
    fn nonsense_is_refused_or_left_out() {
        let whole = PerformanceTarget::default();
        for target in [
            PerformanceTarget { goal: PerformanceGoal::FrameTime(0.0), ..whole },
            PerformanceTarget { goal: PerformanceGoal::FrameTime(f64::NAN), ..whole },
            PerformanceTarget { goal: PerformanceGoal::Throughput(1.0), ..whole },
            PerformanceTarget { tolerance: f64::INFINITY, ..whole },
            PerformanceTarget { adapt_time: -1.0, ..whole },
            PerformanceTarget { nodes: [0, 1], ..whole },
            PerformanceTarget { triangles: [2, 1], ..whole },
        ] {
            assert!(PerformanceMode::new(target).is_err(), "{target:?}");
        }
        let mut mode = mode(whole.goal);
        let before = mode.clone();
        for (frame, adapt) in [(f64::NAN, 0.0), (1.0, f64::NAN), (-1.0, 0.0), (f64::INFINITY, 0.0)] {
            mode.record(FrameTimes { frame, adapt, node_count: 1, ..FrameTimes::default() });
        }
        assert_eq!(mode, before);
        for times in
            [FrameTimes { frame: 1.0, ..FrameTimes::default() }, FrameTimes { frame: 1e300, ..FrameTimes::default() }]
        {
            let controls = mode.record(times);
            assert!(controls.max_nodes >= 16 && controls.max_triangles >= 1000);
        }
    }
}
