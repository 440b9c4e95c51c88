//! What the examples `frame_loop` and `latency` share: a recorded camera path, and the query of each view.
#![allow(clippy::disallowed_methods, reason = "cameras and pictures; no file depends on them")]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, TAU};

use lodpack::{Outside, Query, View};

/// The number of frames of the path, and how many of them are drawn per second.
pub const FRAME_COUNT: u32 = 750;
pub const FRAMES_PER_SECOND: u32 = 30;

/// A path around a model.
#[derive(Clone, Copy)]
pub struct Path {
    centre: [f64; 3],
    /// The model's longest extent.
    size: f64,
}

impl Path {
    pub fn around([low, high]: [[f64; 3]; 2]) -> Self {
        let centre = [0, 1, 2].map(|k| low[k] / 2.0 + high[k] / 2.0);
        Self { centre, size: (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max) }
    }

    /// Circles the model, comes close, looks aside and goes away again.
    pub fn view(&self, frame: u32) -> View {
        let t = f64::from(frame) / f64::from(FRAME_COUNT) * TAU;
        let (azimuth, height) = (2.0 * t + 0.6 * (3.0 * t).sin(), 0.5 * (2.0 * t).sin());
        let distance = self.size * (1.15 + 0.5 * (3.0 * t).cos());
        let view = View { near: 1e-3 * self.size, vertical_fov: FRAC_PI_3, ..View::default() };
        let view = view.orbiting(self.centre, distance, [0.0, 0.0, 1.0], azimuth + FRAC_PI_2, height.asin());
        let [right, _, forward] = view.axes();
        let aside = 0.25 * (5.0 * t).sin();
        View { forward: [0, 1, 2].map(|k| forward[k] + aside * right[k]), ..view }
    }
}

/// A query at one pixel of error; what is out of sight is drawn at its coarsest level.
pub fn query(view: View) -> Query {
    Query { view: Some(view), outside: Outside::Coarsest, ..Query::default() }
}
