//! The views and the cuts of checks.

use glam::DVec3;
use lodpack::{Node, View};

use crate::{
    camera::{Bounds, middle_of},
    surface::{MeshContent, Surface},
};

/// `count` views in directions spread evenly over the sphere. Of every four, one shows the whole model, one a part, and
/// two look closely, with pixels of half a lattice step or of a few steps, so that a shift by one step is visible. All
/// cameras are outside the model's bounding sphere. The close ones look at a point on the border of a root, as it is
/// drawn now, if there is one.
pub fn views(surface: &Surface, bounds: Bounds, count: usize, size_px: u32) -> Vec<View> {
    const TOLERANCES: [f64; 7] = [0.5, 8.0, 1.0, 16.0, 2.0, 32.0, 4.0];
    let (middle, radius) = middle_of(bounds);
    let step = surface.finest_step();
    let with_border = surface.picture().roots().filter(|drawn| !drawn.surface.keys.is_empty());
    let aims: Vec<DVec3> =
        with_border.map(|drawn| drawn.surface.positions[drawn.surface.keys.len() / 2].into()).collect();
    let view = |number: usize| {
        // The golden angle spreads points evenly.
        let height = 1.0 - (2.0 * number as f64 + 1.0) / count as f64;
        let angle = number as f64 * 2.399_963_229_728_653;
        let flat = (1.0 - height * height).sqrt();
        let out = DVec3::new(flat * angle.cos(), height, flat * angle.sin());
        let up = if height.abs() > 0.9 { DVec3::X } else { DVec3::Y };
        let aim = aims.get((number / 4 + number) % aims.len().max(1)).copied().unwrap_or(middle);
        let distance = 2.5 * radius;
        let (target, half_width) = match number % 4 {
            0 => (middle, 1.1 * radius),
            1 => (aim, 0.2 * radius),
            2 => (aim, step * f64::from(size_px) * 4.0),
            _ => (aim, step * f64::from(size_px) / 4.0),
        };
        View {
            position: (target + out * distance).into(),
            forward: (-out).into(),
            up: up.into(),
            viewport: [size_px; 2],
            vertical_fov: 2.0 * (half_width.min(1.1 * radius) / distance).atan(),
            near: radius * 0.01,
            pixel_tolerance: TOLERANCES[(number / 4) % TOLERANCES.len()],
            ..View::default()
        }
    };
    (0..count).map(view).collect()
}

/// A cut in which each root has a level of its own, so neighbours differ by any number of levels. In a tree its roots
/// are of any height.
///
/// # Errors
/// If the index cannot be read.
pub fn mixed_levels(scene: &MeshContent, seed: u64) -> lodpack::Result<Vec<Node>> {
    let hash = |root: u32| {
        let mut hash =
            (u64::from(root) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ seed.wrapping_mul(0xd1b5_4a32_d192_ed03);
        hash ^= hash >> 29;
        hash = hash.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash >> 33
    };
    let level = |root: u32| (hash(root) % scene.file.level_count().max(1) as u64) as u8;
    let mut nodes = Vec::new();
    let mut pending: Vec<u32> = (0..scene.file.top_count()).collect();
    while let Some(root) = pending.pop() {
        let children = scene.file.children(root)?;
        if children.is_empty() || hash(root) >> 20 & 3 == 0 {
            nodes.push(Node { root, level: level(root) });
        } else {
            pending.extend(children);
        }
    }
    nodes.sort_unstable_by_key(|node| node.root);
    Ok(nodes)
}
