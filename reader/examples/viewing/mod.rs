//! What both examples need: a recorded camera path, and the cuts that its views want.

use std::{sync::Arc, time::Duration};

use lodpack::{
    Adapter, Coherence, File, Node, Outside, Query, ReadAt, Result, View,
    session::{Motion, Pose},
};

/// Frames of the path, and how many of them a second has.
pub const FRAME_COUNT: u32 = 750;
pub const FRAMES_PER_SECOND: u32 = 30;

type Vec3 = [f64; 3];

fn add(a: Vec3, b: Vec3, factor: f64) -> Vec3 {
    [0, 1, 2].map(|k| a[k] + factor * b[k])
}

/// A model to be looked at.
#[derive(Clone)]
pub struct Scene {
    centre: Vec3,
    /// Its longest extent.
    pub size: f64,
    /// The cut that is wanted, and the one that will be: each follows its own camera from frame to frame.
    now: Adapter,
    later: Adapter,
}

impl Scene {
    pub fn new<S: ReadAt>(file: &File<S>) -> Result<Self> {
        let [low, high] = file.bounds().unwrap_or_default();
        let (centre, size) =
            (add(low.map(|x| x / 2.0), high, 0.5), (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max));
        let query = query(&pose(centre, size, 0), size);
        let now = Adapter::new(Arc::new(file.hierarchy()?), &query, Coherence::default())?;
        Ok(Self { centre, size, later: now.clone(), now })
    }

    /// Where the camera is in a frame of the path.
    pub fn pose(&self, frame: u32) -> Pose {
        pose(self.centre, self.size, frame)
    }

    /// The cut that a camera wants: an error of one pixel, and what is out of sight at its coarsest.
    pub fn cut(&mut self, pose: &Pose) -> Result<Vec<Node>> {
        self.now.update(&query(pose, self.size))?;
        Ok(self.now.cut().nodes)
    }

    /// The cut that `motion` lets expect some time ahead; nothing where the camera stands.
    pub fn expect(&mut self, motion: &Motion, ahead: Duration) -> Result<Vec<Node>> {
        let Some(pose) = motion.predict(ahead) else { return Ok(Vec::new()) };
        self.later.update(&query(&pose, self.size))?;
        Ok(self.later.cut().nodes)
    }
}

/// Circles the model, comes close, looks aside and goes away again.
fn pose(centre: Vec3, size: f64, frame: u32) -> Pose {
    let t = f64::from(frame) / f64::from(FRAME_COUNT) * std::f64::consts::TAU;
    let (azimuth, height) = (2.0 * t + 0.6 * (3.0 * t).sin(), 0.5 * (2.0 * t).sin());
    let distance = size * (1.15 + 0.5 * (3.0 * t).cos());
    let level = (1.0 - height * height).sqrt();
    let out = [level * azimuth.cos(), level * azimuth.sin(), height];
    let aside = [-azimuth.sin(), azimuth.cos(), 0.0];
    let forward = add(out.map(|x| -x), aside, 0.25 * (5.0 * t).sin());
    Pose { position: add(centre, out, distance), forward, up: [0.0, 0.0, 1.0] }
}

/// What a camera sees of a model of this size.
pub fn view(pose: &Pose, size: f64) -> View {
    let &Pose { position, forward, up } = pose;
    View { position, forward, up, near: 1e-3 * size, ..View::default() }
}

fn query(pose: &Pose, size: f64) -> Query {
    Query { view: Some(view(pose, size)), outside: Outside::Coarsest, ..Query::default() }
}
