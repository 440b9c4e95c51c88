//! The camera: a [`View`] as text, and paths of views.

use anyhow::{Context, Result, bail};
use glam::DVec3;
use lodpack::View;
use lodpack::index::UpAxis;

/// A box in world coordinates: smallest and largest.
pub type Bounds = [[f64; 3]; 2];

/// What a view of a whole model has to know.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Its box.
    pub bounds: Bounds,
    /// The axis that is up, if nobody says another one.
    pub up: &'static str,
    /// The near plane, as a share of where it is for models that are looked at from outside.
    pub near_share: f64,
}

/// What is looked at.
#[derive(Clone, Copy, Debug)]
pub enum Subject {
    /// A grid of heights.
    Heights,
    /// A mesh.
    Mesh {
        /// What its file says.
        up: UpAxis,
        /// Whether it stands on heights.
        has_ground: bool,
    },
}

impl Extent {
    /// A mesh has the axis up that its file says, or else y. Heights go along z, and are looked at from near the
    /// ground; so is a mesh that stands on some, unless it says that y is up.
    pub fn of(bounds: Bounds, subject: Subject) -> Self {
        let (up, near_share) = match subject {
            Subject::Mesh { up: UpAxis::Y, has_ground: true } => ("y", 1e-2),
            Subject::Heights | Subject::Mesh { has_ground: true, .. } => ("z", 1e-2),
            Subject::Mesh { up: UpAxis::Z, has_ground: false } => ("z", 1.0),
            Subject::Mesh { has_ground: false, .. } => ("y", 1.0),
        };
        Self { bounds, up, near_share }
    }
}

/// A position as the sum of two floats per axis, the larger ones first: 48 bits of precision.
pub type Pair = [f32; 6];

/// Splits a position into pairs of floats.
pub fn pair(position: [f64; 3]) -> Pair {
    let high = position.map(|x| x as f32);
    let low = [0, 1, 2].map(|k| (position[k] - f64::from(high[k])) as f32);
    [high[0], high[1], high[2], low[0], low[1], low[2]]
}

/// A vertex on the GPU: the bits of its position's pair, then its normal as two numbers, the first one lower.
pub type Vertex = [u32; 7];

/// The normal of a vertex that has none, which no direction is.
pub const NO_NORMAL: [i16; 2] = [i16::MIN; 2];

/// A vertex with a normal, as [`lodpack::stream::Lit`] has it.
pub fn vertex(position: [f64; 3], normal: [i16; 2]) -> Vertex {
    let [a, b, c, d, e, f] = pair(position).map(f32::to_bits);
    [a, b, c, d, e, f, packed(normal)]
}

/// Vertices with these normals; without any where the list is empty.
pub fn vertices(positions: &[[f64; 3]], normals: &[[i16; 2]]) -> Vec<Vertex> {
    let normals = normals.iter().copied().chain(std::iter::repeat(NO_NORMAL));
    positions.iter().zip(normals).map(|(&position, normal)| vertex(position, normal)).collect()
}

/// A normal in one number.
pub fn packed([x, y]: [i16; 2]) -> u32 {
    u32::from(x as u16) | u32::from(y as u16) << 16
}

/// The middle of a box, and half its diagonal.
pub fn middle_of([low, high]: Bounds) -> (DVec3, f64) {
    let (low, high) = (DVec3::from(low), DVec3::from(high));
    ((low + high) / 2.0, (high - low).length() / 2.0)
}

/// Looks at a box from an azimuth and elevation, in radians, at a share of the distance from which nothing can be cut
/// off.
fn toward(bounds: Bounds, up: [f64; 3], [azimuth, elevation]: [f64; 2], part: f64) -> View {
    let mut view = View::around(bounds, up, azimuth, elevation);
    let distance = (DVec3::from(view.position) - middle_of(bounds).0).length();
    view.shift([0.0, 0.0, (1.0 - part) * distance]);
    view
}

/// Looks at a whole model, in a picture that is `aspect` times as wide as high. Few models fill the ball around their
/// box, so it looks from closer than that ball would need.
pub fn whole(bounds: Bounds, up: [f64; 3], aspect: f64) -> View {
    let half = View::around(bounds, up, 0.0, 0.0).vertical_fov / 2.0;
    let narrower = (half.tan() * aspect.clamp(1e-3, 1.0)).atan();
    toward(bounds, up, [0.5, 0.25], 0.8 * half.sin() / narrower.sin())
}

/// The built-in path: circles the model, approaches, looks aside and moves away again.
pub fn circling(bounds: Bounds, up: [f64; 3], frame_count: usize) -> Vec<View> {
    let pose = |frame: usize| {
        let t = frame as f64 / frame_count as f64 * std::f64::consts::TAU;
        let angles = [2.0 * t + 0.6 * (3.0 * t).sin(), 0.5 * (2.0 * t).sin()];
        let view = toward(bounds, up, angles, 0.8 * (0.66 + 0.34 * (3.0 * t).cos()));
        let [right, _, forward] = view.axes().map(DVec3::from);
        View { forward: (forward + right * 0.25 * (5.0 * t).sin()).into(), ..view }
    };
    (0..frame_count).map(pose).collect()
}

/// Parses `x,y,z:x,y,z[:x,y,z[:degrees]]`: position, target, up, vertical angle. Everything else is as in `default`.
pub fn parse(text: &str, default: &View) -> Result<View> {
    let explain = "a camera is position:target[:up[:degrees]], the first three as x,y,z";
    let numbers = text.split([',', ':']).map(|number| number.trim().parse());
    let numbers: Vec<f64> = numbers.collect::<Result<_, _>>().context(explain)?;
    if !matches!(numbers.len(), 6 | 9 | 10) || numbers.iter().any(|number| !number.is_finite()) {
        bail!(explain);
    }
    let vector = |at: usize| numbers.get(at..at + 3).map(DVec3::from_slice);
    let (position, target) = (vector(0).context(explain)?, vector(3).context(explain)?);
    let forward = (target - position).try_normalize();
    let forward = forward.context("a camera's target must differ from its position")?.into();
    let vertical_fov = numbers.get(9).map_or(default.vertical_fov, |degrees| degrees.to_radians());
    if !(vertical_fov > 0.0 && vertical_fov < 3.1) {
        bail!("a camera's angle must be between 0 and 177 degrees");
    }
    let up = vector(6).map_or(default.up, DVec3::into);
    Ok(View { position: position.into(), forward, up, vertical_fov, ..*default })
}

/// The text that [`parse`] reads.
pub fn text(view: &View) -> String {
    let target = DVec3::from(view.position) + DVec3::from(view.forward).normalize();
    let [p, t, u] = [view.position, target.into(), view.up].map(|[x, y, z]| format!("{x},{y},{z}"));
    format!("{p}:{t}:{u}:{}", view.vertical_fov.to_degrees())
}

/// Writes a path as a list of texts for [`parse`].
pub fn path_to_json(path: &[View]) -> String {
    serde_json::json!(path.iter().map(text).collect::<Vec<_>>()).to_string()
}

/// Reads the output of [`path_to_json`].
pub fn path_from_json(json: &str, default: &View) -> Result<Vec<View>> {
    let explain = "a path is a JSON list of cameras, each as text in the form of --camera";
    let cameras: Vec<String> = serde_json::from_str(json).context(explain)?;
    if cameras.is_empty() {
        bail!("the path has no frames");
    }
    cameras.iter().map(|camera| parse(camera, default)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_pictures_show_the_whole_model() {
        let bounds = [[-1.0; 3], [1.0; 3]];
        let [wide, high] = [2.0, 0.5].map(|aspect| whole(bounds, [0.0, 1.0, 0.0], aspect));
        assert_eq!(wide, whole(bounds, [0.0, 1.0, 0.0], 1.0));
        let tangent = |view: &View| {
            let distance = DVec3::from(view.position).length();
            (3.0_f64.sqrt() / distance).asin().tan() / (view.vertical_fov / 2.0).tan()
        };
        // The ball around the box ends as far beyond the nearer sides.
        assert!((tangent(&wide) - 2.0 * tangent(&high)).abs() < 0.2 && tangent(&high) < 0.7);
    }
}
