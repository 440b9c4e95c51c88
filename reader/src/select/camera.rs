//! Moving views: what a program with a camera needs.
#![expect(clippy::disallowed_methods, reason = "views choose what is drawn; no decoded position depends on them")]

use crate::{
    codec::vector::{Vec3, add, cross, dot, scale, sub},
    error::Result,
    select::{View, view::Projection},
};

/// [`View::orbit`] stops at this sine of the elevation, short of the poles.
const POLE: f64 = 0.995;

impl View {
    /// Looks at the middle of a box from one side, at a distance where the ball around the box just fits into a picture
    /// that is at least as wide as high. Angles are in radians; the elevation is measured from the plane perpendicular
    /// to `up`. The field of view is 40 degrees.
    pub fn around([low, high]: [[f64; 3]; 2], up: [f64; 3], azimuth: f64, elevation: f64) -> Self {
        let (middle, extent) = (scale(add(low, high), 0.5), sub(high, low));
        // So that a single point is visible too.
        let radius = (dot(extent, extent).sqrt() / 2.0).max(1e-300);
        let near = radius * 1e-4;
        let view = Self { vertical_fov: 40.0_f64.to_radians(), near, ..Self::default() };
        let distance = radius / (view.vertical_fov / 2.0).sin();
        view.orbiting(middle, distance, up, azimuth, elevation)
    }

    /// The same view from another position: `distance` away from `centre`, which is in the middle of the picture.
    /// Angles are those of [`View::around`].
    #[must_use]
    pub fn orbiting(self, centre: [f64; 3], distance: f64, up: [f64; 3], azimuth: f64, elevation: f64) -> Self {
        let up = unit(up).unwrap_or(self.up);
        let (right, toward) = across(up);
        let level = add(scale(right, azimuth.sin()), scale(toward, -azimuth.cos()));
        let out = add(scale(level, elevation.cos()), scale(up, elevation.sin()));
        Self { position: add(centre, scale(out, distance)), forward: scale(out, -1.0), up, ..self }
    }

    /// The camera's axes: right, up and forward, of length one and perpendicular to each other.
    pub fn axes(&self) -> [[f64; 3]; 3] {
        let forward = unit(self.forward).unwrap_or([0.0, 0.0, -1.0]);
        let right = unit(cross(forward, self.up)).unwrap_or_else(|| across(forward).0);
        [right, cross(right, forward), forward]
    }

    /// Pixels per unit of tangent: a point x to the right at depth z appears x / z times as many pixels from the
    /// middle.
    pub fn pixels_per_tangent(&self) -> f64 {
        f64::from(self.viewport[1]) / (2.0 * (self.vertical_fov / 2.0).tan())
    }

    /// Where a box lies across the whole picture: its left and right end, of which 0 and 1 are those of the picture.
    /// None if all of it is behind the near plane; everything if a part of it is.
    pub fn interval_of(&self, bounds: [[f64; 3]; 2]) -> Option<[f64; 2]> {
        let [right, _, forward] = self.axes();
        let scale = self.pixels_per_tangent() / f64::from(self.viewport[0].max(1));
        let (mut interval, mut behind) = ([f64::INFINITY, f64::NEG_INFINITY], 0);
        for corner in 0..8 {
            let to = [0, 1, 2].map(|k| bounds[corner >> k & 1][k] - self.position[k]);
            let depth = dot(to, forward);
            if depth < self.near {
                behind += 1;
                continue;
            }
            let place = 0.5 + dot(to, right) / depth * scale;
            interval = [interval[0].min(place), interval[1].max(place)];
        }
        match behind {
            0 => Some(interval),
            8 => None,
            _ => Some([0.0, 1.0]),
        }
    }

    /// Moves along its own axes: right, up and forward, world units.
    pub fn shift(&mut self, by: [f64; 3]) {
        let axes = self.axes();
        self.position = (0..3).fold(self.position, |at, k| add(at, scale(axes[k], by[k])));
    }

    /// Turns about a point by angles in radians: about `up`, and about its right axis, but not over the poles. The
    /// point in view makes it orbit; its own position makes it look around.
    pub fn orbit(&mut self, pivot: [f64; 3], about_up: f64, about_right: f64) {
        let [right, _, forward] = self.axes();
        let up = unit(self.up).unwrap_or([0.0, 1.0, 0.0]);
        let is_over_pole = dot(rotated(forward, right, about_right), up).abs() > POLE;
        let about_right = if is_over_pole { 0.0 } else { about_right };
        let turned = |v: Vec3| rotated(rotated(v, right, about_right), up, about_up);
        self.position = add(pivot, turned(sub(self.position, pivot)));
        self.forward = turned(forward);
    }

    /// The largest screen error, in pixels, of an error of `error` world units inside a box; zero if the box is out of
    /// sight.
    ///
    /// # Errors
    /// [`crate::Error::Query`] if something in the view is not finite or makes no sense.
    pub fn error_px(&self, bounds: [[f64; 3]; 2], error: f64) -> Result<f64> {
        Ok(Projection::new(self)?.look(bounds).factor * error)
    }
}

/// `a` at length one, if it has a direction.
fn unit(a: Vec3) -> Option<Vec3> {
    let length = dot(a, a).sqrt();
    (length > 0.0 && length.is_finite()).then(|| scale(a, 1.0 / length))
}

/// Two directions perpendicular to an axis of length one and to each other. The first is along x where possible.
fn across(axis: Vec3) -> (Vec3, Vec3) {
    let side = if axis[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let right = unit(sub(side, scale(axis, dot(side, axis)))).unwrap_or(side);
    (right, cross(axis, right))
}

/// Rodrigues' formula about an axis of length one.
pub(crate) fn rotated(v: Vec3, axis: Vec3, angle: f64) -> Vec3 {
    let (sine, cosine) = angle.sin_cos();
    let along = scale(axis, dot(axis, v) * (1.0 - cosine));
    add(add(scale(v, cosine), scale(cross(axis, v), sine)), along)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: [[f64; 3]; 2] = [[-1.0, 2.0, 3.0], [3.0, 4.0, 4.0]];
    const MIDDLE: [f64; 3] = [1.0, 3.0, 3.5];

    fn length(a: Vec3) -> f64 {
        dot(a, a).sqrt()
    }

    #[test]
    fn a_box_that_is_looked_at_is_in_sight_with_all_corners_from_every_side() {
        for up in [[0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 0.0]] {
            for (azimuth, elevation) in [(0.0, 0.0), (1.0, 0.5), (4.0, -1.2)] {
                let view = View::around(BOX, up, azimuth, elevation);
                let [right, above, forward] = view.axes();
                assert!(length(cross(forward, sub(MIDDLE, view.position))) < 1e-12);
                assert!(dot(above, up) > 0.0 && dot(right, up).abs() < 1e-12);
                for corner in (0..8).map(|n| [0, 1, 2].map(|k| BOX[n >> k & 1][k])) {
                    assert!(view.error_px([corner; 2], 1.0).unwrap() > 0.0);
                }
            }
        }
        let there = View::default().orbiting([1.0, 0.0, 0.0], 2.0, [0.0, 0.0, 1.0], 0.0, 0.0);
        assert_eq!((there.position, there.forward), ([1.0, -2.0, 0.0], [0.0, 1.0, 0.0]));
    }

    #[test]
    fn orbiting_keeps_the_distance_and_the_pivot_in_the_middle_and_never_turns_over() {
        let mut view = View::around(BOX, [0.0, 1.0, 0.0], 0.3, 0.2);
        let distance = length(sub(view.position, MIDDLE));
        for step in 0..200 {
            view.orbit(MIDDLE, 0.1, if step % 100 < 50 { 0.2 } else { -0.07 });
            let toward = sub(MIDDLE, view.position);
            assert!((length(toward) - distance).abs() < 1e-9);
            assert!(dot(toward, view.forward) > distance * (1.0 - 1e-9));
            assert!(view.axes()[1][1] > 0.0);
        }
        let before = view;
        view.orbit(view.position, 0.5, 0.0);
        assert!(view.position == before.position && view.forward != before.forward);
    }

    #[test]
    fn a_box_lies_where_its_points_are_drawn() {
        let view = View::around(BOX, [0.0, 1.0, 0.0], 0.3, 0.2);
        let [left, right] = view.interval_of(BOX).unwrap();
        assert!(left > 0.0 && right < 1.0 && left < 0.5 && right > 0.5, "{left} {right}");
        let place = |point: [f64; 3]| {
            let to = sub(point, view.position);
            let [x, _, z] = view.axes().map(|axis| dot(to, axis));
            0.5 + x / z * view.pixels_per_tangent() / f64::from(view.viewport[0])
        };
        let within = |point: [f64; 3]| (left - 1e-12..=right + 1e-12).contains(&place(point));
        assert!(within(BOX[0]) && within(BOX[1]) && within(MIDDLE));
        assert_eq!(View { position: MIDDLE, ..view }.interval_of(BOX), Some([0.0, 1.0]));
        let turned = View { forward: view.forward.map(|x| -x), ..view };
        assert_eq!(turned.interval_of(BOX), None);
    }

    #[test]
    fn shifting_follows_the_axes_and_errors_are_seen_larger_from_near() {
        let mut view = View { forward: [1.0, 0.0, 0.0], up: [0.0, 0.0, 1.0], ..View::default() };
        view.shift([1.0, 2.0, 3.0]);
        assert_eq!(view.position, [3.0, -1.0, 2.0]);
        let point = [[13.0, -1.0, 2.0]; 2];
        let far = view.error_px(point, 0.1).unwrap();
        assert!((far / (0.01 * view.pixels_per_tangent()) - 1.0).abs() < 1e-6);
        view.shift([0.0, 0.0, 5.0]);
        assert!((view.error_px(point, 0.1).unwrap() / far - 2.0).abs() < 1e-6);
        view.shift([0.0, 0.0, 10.0]);
        assert_eq!(view.error_px(point, 0.1).unwrap(), 0.0);
    }
}
