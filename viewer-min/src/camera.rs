//! Where the picture is taken from: parsed, moved, recorded and replayed.

use anyhow::{Context, Result, bail};
use glam::{DQuat, DVec3};
use lodpack::View;

/// A pinhole camera in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it is.
    pub position: DVec3,
    /// Where it looks; of length one.
    pub forward: DVec3,
    /// What is up in the picture; need not be at a right angle to `forward`.
    pub up: DVec3,
    /// Full vertical angle, radians.
    pub fov: f64,
    /// Nothing nearer is drawn.
    pub near: f64,
}

/// A rectangle of a larger picture in pixels, from its upper left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Width and height of the whole picture.
    pub whole: [u32; 2],
    /// Upper left corner of what is drawn.
    pub origin: [u32; 2],
    /// Size of what is drawn.
    pub size: [u32; 2],
}

impl Frame {
    /// A whole picture.
    pub fn whole(size: [u32; 2]) -> Self {
        Self { whole: size, origin: [0, 0], size }
    }
}

/// A position as the sum of two floats for each axis, the larger ones first: 48 bits.
pub type Pair = [f32; 6];

/// Splits a position.
pub fn pair(position: [f64; 3]) -> Pair {
    let high = position.map(|x| x as f32);
    let low = [0, 1, 2].map(|k| (position[k] - f64::from(high[k])) as f32);
    [high[0], high[1], high[2], low[0], low[1], low[2]]
}

/// Middle of a box, and half its diagonal.
pub fn middle_of([low, high]: [[f64; 3]; 2]) -> (DVec3, f64) {
    let (low, high) = (DVec3::from(low), DVec3::from(high));
    ((low + high) / 2.0, (high - low).length() / 2.0)
}

impl Camera {
    /// Looks at a box from azimuth and elevation (radians, `up` upwards), so that all of it is seen.
    pub fn around(bounds: [[f64; 3]; 2], up: DVec3, azimuth: f64, elevation: f64) -> Self {
        let (middle, radius) = middle_of(bounds);
        let radius = radius.max(1e-300);
        let side = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Z };
        let right = side.reject_from_normalized(up).normalize();
        let toward = up.cross(right);
        let out = (right * azimuth.sin() - toward * azimuth.cos()) * elevation.cos() + up * elevation.sin();
        let fov: f64 = 40.0_f64.to_radians();
        let distance = 0.8 * radius / (fov / 2.0).sin();
        Self { position: middle + out * distance, forward: -out, up, fov, near: radius * 1e-4 }
    }

    /// Right, up and forward, all of length one and at right angles.
    pub fn axes(&self) -> [DVec3; 3] {
        let right =
            self.forward.cross(self.up).try_normalize().unwrap_or_else(|| self.forward.any_orthonormal_vector());
        [right, right.cross(self.forward).normalize(), self.forward.normalize()]
    }

    /// Pixels per unit of tangent in a picture of this height.
    pub fn pixels_per_tangent(&self, height: u32) -> f64 {
        f64::from(height) / (2.0 * (self.fov / 2.0).tan())
    }

    /// What a query is told.
    pub fn view(&self, frame: Frame, pixel_tolerance: f64) -> View {
        let part = |k: usize, at: u32| f64::from(at) / f64::from(frame.whole[k]);
        let [x, y] = frame.origin;
        let (right, bottom) = (part(0, x + frame.size[0]), part(1, y + frame.size[1]));
        View {
            position: self.position.into(),
            forward: self.forward.into(),
            up: self.axes()[1].into(),
            viewport: frame.whole,
            vertical_fov: self.fov,
            near: self.near,
            pixel_tolerance,
            window: [[part(0, x), (1.0 - bottom).max(0.0)], [right, 1.0 - part(1, y)]],
        }
    }

    /// Parses `x,y,z:x,y,z[:x,y,z[:degrees]]`: position, what it looks at, up, vertical angle.
    ///
    /// # Errors
    /// Where it is something else.
    pub fn parse(text: &str, default: &Self) -> Result<Self> {
        let explain = "a camera is position:target[:up[:degrees]], each of the first three as x,y,z";
        let numbers = text.split([',', ':']).map(|number| number.trim().parse());
        let numbers: Vec<f64> = numbers.collect::<Result<_, _>>().context(explain)?;
        if !matches!(numbers.len(), 6 | 9 | 10) || numbers.iter().any(|number| !number.is_finite()) {
            bail!(explain);
        }
        let vector = |at: usize| numbers.get(at..at + 3).map(DVec3::from_slice);
        let (position, target) = (vector(0).context(explain)?, vector(3).context(explain)?);
        let forward = (target - position).try_normalize();
        let forward = forward.context("a camera has to look at another place than its own")?;
        let fov = numbers.get(9).map_or(default.fov, |degrees| degrees.to_radians());
        if !(fov > 0.0 && fov < 3.1) {
            bail!("a camera's angle has to be between 0 and 177 degrees");
        }
        Ok(Self { position, forward, up: vector(6).unwrap_or(default.up), fov, near: default.near })
    }

    /// What [`Camera::parse`] takes.
    pub fn text(&self) -> String {
        let [p, f, u] =
            [self.position, self.position + self.forward, self.up].map(|v| format!("{},{},{}", v.x, v.y, v.z));
        format!("{p}:{f}:{u}:{}", self.fov.to_degrees())
    }

    /// Turns about a point: angles in radians, about up and about right.
    pub fn orbit(&mut self, pivot: DVec3, about_up: f64, about_right: f64) {
        let turn = DQuat::from_axis_angle(self.up.normalize(), about_up);
        let tilt = DQuat::from_axis_angle(self.axes()[0], about_right);
        let forward = turn * (tilt * self.forward);
        // Not over the poles.
        let tilt = if forward.dot(self.up.normalize()).abs() > 0.995 { DQuat::IDENTITY } else { tilt };
        self.position = pivot + turn * (tilt * (self.position - pivot));
        self.forward = (turn * (tilt * self.forward)).normalize();
    }

    /// Moves along its own axes, world units.
    pub fn shift(&mut self, by: DVec3) {
        let [right, up, forward] = self.axes();
        self.position += right * by.x + up * by.y + forward * by.z;
    }
}

/// The built-in path number: circles the model, comes close, looks aside and goes away again.
pub fn circling(bounds: [[f64; 3]; 2], up: DVec3, frame_count: usize) -> Vec<Camera> {
    let (centre, _) = middle_of(bounds);
    let pose = |frame: usize| {
        let t = frame as f64 / frame_count as f64 * std::f64::consts::TAU;
        let mut camera = Camera::around(bounds, up, 2.0 * t + 0.6 * (3.0 * t).sin(), 0.5 * (2.0 * t).sin());
        let near = 0.66 + 0.34 * (3.0 * t).cos();
        camera.position = centre + (camera.position - centre) * near;
        let aside = camera.axes()[0];
        camera.forward = (camera.forward + aside * 0.25 * (5.0 * t).sin()).normalize();
        camera
    };
    (0..frame_count).map(pose).collect()
}

/// Writes a path: a list of what [`Camera::parse`] takes.
pub fn path_to_json(path: &[Camera]) -> String {
    serde_json::json!(path.iter().map(Camera::text).collect::<Vec<_>>()).to_string()
}

/// Reads what [`path_to_json`] writes.
///
/// # Errors
/// Where it is something else.
pub fn path_from_json(text: &str, default: &Camera) -> Result<Vec<Camera>> {
    let explain = "a path is a JSON list of cameras, each a text as --camera takes it";
    let cameras: Vec<String> = serde_json::from_str(text).context(explain)?;
    if cameras.is_empty() {
        bail!("the path has no frames");
    }
    cameras.iter().map(|camera| Camera::parse(camera, default)).collect()
}
