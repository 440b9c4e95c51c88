//! What both examples need: a recorded camera path, and the cut that a view wants.

use lodpack::{
    BlockContents, File, Node, ReadAt, Result,
    session::{Motion, Pose},
};

/// Frames of the path, and how many of them a second has.
pub const FRAME_COUNT: u32 = 750;
pub const FRAMES_PER_SECOND: u32 = 30;

const VIEWPORT_HEIGHT: f64 = 1080.0;
/// Tangents of half the fields of view.
const TANGENTS: [f64; 2] = [1.026, 0.577];
const PIXEL_TOLERANCE: f64 = 1.0;

type Vec3 = [f64; 3];

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Vec3) -> Vec3 {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

/// A root as views see it.
struct Root {
    centre: Vec3,
    radius: f64,
    blocks: Vec<BlockContents>,
}

/// A model to be looked at.
pub struct Scene {
    roots: Vec<Root>,
    centre: Vec3,
    size: f64,
}

impl Scene {
    pub fn new<S: ReadAt>(file: &File<S>) -> Result<Self> {
        let mut roots = Vec::new();
        for root in 0..file.root_count() {
            let [low, high] = file.root_bounds(root)?;
            let half = [0, 1, 2].map(|k| (high[k] - low[k]) / 2.0);
            let centre = [0, 1, 2].map(|k| (high[k] + low[k]) / 2.0);
            roots.push(Root { centre, radius: dot(half, half).sqrt(), blocks: file.root_contents(root)?.blocks });
        }
        let [low, high] = file.bounds().unwrap_or_default();
        let size = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        Ok(Self { roots, centre: [0, 1, 2].map(|k| (high[k] + low[k]) / 2.0), size })
    }

    /// Frame `frame` of a path that circles the model, comes close, looks aside and goes away again.
    pub fn pose(&self, frame: u32) -> Pose {
        let t = f64::from(frame) / f64::from(FRAME_COUNT) * std::f64::consts::TAU;
        let (azimuth, height) = (2.0 * t + 0.6 * (3.0 * t).sin(), 0.5 * (2.0 * t).sin());
        let distance = self.size * (1.15 + 0.5 * (3.0 * t).cos());
        let level = (1.0 - height * height).sqrt();
        let out = [level * azimuth.cos(), level * azimuth.sin(), height];
        let aside = unit(cross(out, [0.0, 0.0, 1.0]));
        let swing = 0.25 * (5.0 * t).sin();
        Pose {
            position: [0, 1, 2].map(|k| self.centre[k] + distance * out[k]),
            forward: unit([0, 1, 2].map(|k| swing * aside[k] - out[k])),
            up: [0.0, 0.0, 1.0],
        }
    }

    /// Pixels per world unit of error at a root; none where it is out of sight.
    fn pixels_per_error(&self, pose: &Pose, root: &Root) -> Option<f64> {
        let offset = [0, 1, 2].map(|k| root.centre[k] - pose.position[k]);
        let forward = unit(pose.forward);
        let right = unit(cross(forward, pose.up));
        let up = cross(right, forward);
        let depth = dot(offset, forward);
        let is_beside = |axis: Vec3, tangent: f64| {
            dot(offset, axis).abs() - depth * tangent > root.radius * (1.0 + tangent * tangent).sqrt()
        };
        if depth < -root.radius || is_beside(right, TANGENTS[0]) || is_beside(up, TANGENTS[1]) {
            return None;
        }
        Some(VIEWPORT_HEIGHT / (2.0 * TANGENTS[1]) / (depth - root.radius).max(1e-3 * self.size))
    }

    /// The coarsest cut whose errors look no larger than a pixel; what is out of sight at its coarsest.
    pub fn cut(&self, pose: &Pose) -> Vec<Node> {
        let level = |root: &Root| {
            let Some(pixels) = self.pixels_per_error(pose, root) else { return 0 };
            let is_fine = |block: &&BlockContents| (block.error + block.border_deviation) * pixels <= PIXEL_TOLERANCE;
            root.blocks.iter().find(is_fine).or(root.blocks.last()).map_or(0, |block| block.level)
        };
        (0..).zip(&self.roots).map(|(number, root)| Node { root: number, level: level(root) }).collect()
    }

    /// Mean error in pixels of the roots in sight, as they are drawn.
    pub fn error(&self, pose: &Pose, drawn: &[Node]) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for node in drawn {
            let Some(root) = self.roots.get(node.root as usize) else { continue };
            let block = root.blocks.iter().rev().find(|block| block.level <= node.level);
            if let Some((block, pixels)) = block.zip(self.pixels_per_error(pose, root)) {
                sum += block.error * pixels;
                count += 1;
            }
        }
        if count == 0 { 0.0 } else { sum / f64::from(count) }
    }

    /// What `motion` lets expect some time ahead; nothing where the camera stands.
    pub fn expect(&self, motion: &Motion, ahead: std::time::Duration) -> Vec<Node> {
        motion.predict(ahead).map_or(Vec::new(), |pose| self.cut(&pose))
    }
}
