//! Prediction of the camera's motion, for prefetching (Correa 2004, section 4.5: linear extrapolation of the position,
//! and of the direction with its angular speed).
#![expect(clippy::disallowed_methods, reason = "views choose what is drawn; no decoded position depends on them")]

use std::time::Duration;

use crate::{
    codec::vector::{Vec3, add, cross, dot, scale, sub},
    select::{Projection, Query, View, rotated},
};

/// A camera's position and orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Its position, world units.
    pub position: [f64; 3],
    /// The direction in which it looks, of any length but zero.
    pub forward: [f64; 3],
    /// The direction that is up in the picture. It need not be perpendicular to `forward`.
    pub up: [f64; 3],
}

impl From<&View> for Pose {
    fn from(&View { position, forward, up, .. }: &View) -> Self {
        Self { position, forward, up }
    }
}

/// Extrapolates a camera's motion from its last three poses.
#[derive(Clone, Copy, Debug, Default)]
pub struct Motion {
    first: Option<(Duration, Pose)>,
    before: Option<(Duration, Pose)>,
    last: Option<(Duration, Pose)>,
}

impl Motion {
    /// A motion without observations.
    pub fn new() -> Self {
        Self::default()
    }

    /// Records the camera's pose at a time. A time that is not after the last one starts a new motion.
    pub fn observe(&mut self, now: Duration, pose: Pose) {
        self.first = self.before.filter(|_| self.last.is_some_and(|(time, _)| time < now));
        self.before = self.last.filter(|(time, _)| *time < now);
        self.last = Some((now, pose));
    }

    /// The pose `ahead` of the last observation if the camera moves on as between the last two: it turns about a fixed
    /// axis at a fixed speed, and moves straight on or, if the path of the last three bends, in a circle. `None` before
    /// the second observation, or if the camera stands still.
    pub fn predict(&self, ahead: Duration) -> Option<Pose> {
        let ((time_before, before), (time, last)) = (self.before?, self.last?);
        if before == last {
            return None;
        }
        let factor = ahead.as_secs_f64() / (time - time_before).as_secs_f64();
        let step = sub(last.position, before.position);
        let bend =
            self.first.map_or(Turn(None), |(_, first)| Turn::between(sub(before.position, first.position), step));
        let position = add(last.position, bend.travel(step, factor));
        let turn = Turn::between(before.forward, last.forward);
        let roll = Turn::between(turn.apply(before.up, 1.0), last.up);
        let ahead = |direction: Vec3| roll.apply(turn.apply(direction, factor), factor);
        Some(Pose { position, forward: ahead(last.forward), up: ahead(last.up) })
    }
}

/// Predicts the query of later frames from those of a moving camera.
#[derive(Clone, Copy, Debug, Default)]
pub struct Expecter {
    motion: Motion,
    ahead: Duration,
}

impl Expecter {
    /// Looks this far ahead: a few times the duration of a read, or zero to predict nothing.
    pub fn new(ahead: Duration) -> Self {
        Self { motion: Motion::new(), ahead }
    }

    /// The query that later frames will probably have. None without a view, or if the camera stands still.
    pub fn expect(&mut self, query: &Query, now: Duration) -> Option<Query> {
        let view = query.view.filter(|_| !self.ahead.is_zero())?;
        self.motion.observe(now, Pose::from(&view));
        let Pose { position, forward, up } = self.motion.predict(self.ahead)?;
        let expected = View { position, forward, up, ..view };
        // A prediction may be no view.
        Projection::new(&expected).ok().map(|_| Query { view: Some(expected), ..query.clone() })
    }
}

/// A rotation about an axis of length one; none if the directions agree or are opposite.
struct Turn(Option<(Vec3, f64)>);

impl Turn {
    fn between(from: Vec3, to: Vec3) -> Self {
        let axis = cross(from, to);
        let sine = dot(axis, axis).sqrt();
        let known = sine > 1e-12 * (dot(from, from) * dot(to, to)).sqrt();
        Self(known.then(|| (scale(axis, 1.0 / sine), sine.atan2(dot(from, to)))))
    }

    /// The sum of `times` steps, each turned against the one before.
    fn travel(&self, step: Vec3, times: f64) -> Vec3 {
        let Some((axis, angle)) = self.0 else { return scale(step, times) };
        // The step is a chord: half a turn behind the motion at its end.
        let (start, end) = (angle * 0.5, angle * (times + 0.5));
        let side = cross(axis, step);
        let along = scale(axis, dot(axis, step) * times);
        let across = sub(step, scale(axis, dot(axis, step)));
        add(
            along,
            scale(add(scale(across, end.sin() - start.sin()), scale(side, start.cos() - end.cos())), 1.0 / angle),
        )
    }

    /// Turns by `times` the angle.
    fn apply(&self, v: Vec3, times: f64) -> Vec3 {
        self.0.map_or(v, |(axis, angle)| rotated(v, axis, angle * times))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Duration = Duration::from_millis(20);

    fn circle(frame: u32) -> Pose {
        let (sine, cosine) = (f64::from(frame) * 0.01).sin_cos();
        Pose { position: [3.0 * cosine, 3.0 * sine, 0.1], forward: [-cosine, -sine, 0.0], up: [0.0, 0.0, 1.0] }
    }

    fn distance(a: Vec3, b: Vec3) -> f64 {
        dot(sub(a, b), sub(a, b)).sqrt()
    }

    #[test]
    fn straight_motion_is_predicted_exactly_and_circles_nearly() {
        let mut motion = Motion::new();
        assert_eq!(motion.predict(STEP), None);
        let pose = |x: f64| Pose { position: [x, 2.0, 3.0], ..circle(0) };
        motion.observe(STEP, pose(1.0));
        assert_eq!(motion.predict(STEP), None);
        motion.observe(2 * STEP, pose(1.5));
        let later = motion.predict(4 * STEP).unwrap();
        assert!(distance(later.position, [3.5, 2.0, 3.0]) < 1e-12);
        assert_eq!(later.forward, circle(0).forward);

        let mut motion = Motion::new();
        motion.observe(STEP, circle(0));
        motion.observe(2 * STEP, circle(1));
        let (later, truth) = (motion.predict(9 * STEP).unwrap(), circle(10));
        // Directions turn at a fixed speed: exact; the position goes straight on: off by the square of the angle.
        assert!(distance(later.forward, truth.forward) < 1e-9);
        assert!(distance(later.up, truth.up) < 1e-9);
        assert!(distance(later.position, truth.position) < 3.0 * 0.1 * 0.1);
        motion.observe(3 * STEP, circle(2));
        assert!(distance(motion.predict(9 * STEP).unwrap().position, circle(11).position) < 1e-4);
    }

    #[test]
    fn rolls_are_predicted_and_standing_still_is_not() {
        let roll = |angle: f64| Pose { up: [angle.sin(), 0.0, angle.cos()], forward: [0.0, 1.0, 0.0], ..circle(0) };
        let mut motion = Motion::new();
        motion.observe(STEP, roll(0.1));
        motion.observe(2 * STEP, roll(0.2));
        assert!(distance(motion.predict(2 * STEP).unwrap().up, roll(0.4).up) < 1e-9);
        motion.observe(3 * STEP, roll(0.2));
        assert_eq!(motion.predict(STEP), None);
        motion.observe(3 * STEP, roll(0.3));
        assert_eq!(motion.predict(STEP), None, "time has not gone on");
    }
}
