//! Checks the certified error pixel by pixel against a mesh that is rasterised and searched without the GPU.
//!
//! A drawn point passes if the reference lies in the same pixel within the error; most do. Where it does not (at
//! silhouettes, where the surface is seen at a grazing angle, or where only one of both is background), the distance to
//! the mesh decides. So a pixel fails only if the certificate is broken, and every broken certificate that a pixel
//! shows is found. The same holds from the reference to the drawing.

use std::{cell::OnceCell, collections::BTreeMap};

use lodpack::{Mesh, View, stream::DrawnRoot};

use super::{
    Fault,
    reference::{Tree, depth_map, point},
};
use crate::{picture::Picture, surface::Surface};

/// Tolerated deviation of a pixel's point for reasons of its own, in pixels: the GPU snaps vertices to parts of a
/// pixel.
const PIXEL_SLACK: f64 = 0.02;
/// The same as a share of the distance, for single precision.
const DEPTH_SLACK: f64 = 1e-6;

/// Compares pictures with a mesh.
pub struct ErrorCheck<'m> {
    mesh: &'m Mesh,
    tree: Tree,
    slack: f64,
    fault: Option<Fault>,
    /// Pixels compared, and how many of them distance decided.
    pixels: [u64; 2],
}

impl<'m> ErrorCheck<'m> {
    /// Errors may be larger by `slack`, in world units: the error of the mesh itself.
    pub fn new(mesh: &'m Mesh, slack: f64, fault: Option<Fault>) -> Self {
        let tree = Tree::new(&mesh.positions, &mesh.triangles, |_| 0);
        Self { mesh, tree, slack, fault, pixels: [0, 0] }
    }

    /// Pixels at which the drawing and the mesh are farther apart than certified.
    pub fn check(&mut self, surface: &Surface, drawn: &Picture, view: &View) -> Vec<usize> {
        let map = depth_map(&self.mesh.positions, &self.mesh.triangles, view);
        let part = |root: u32| match self.fault {
            Some(Fault::LessError(which, part)) if which == root => part,
            _ => 1.0,
        };
        // Certified error of each drawn root.
        let certified = |drawn: &DrawnRoot| (drawn.surface.root, drawn.error() * part(drawn.surface.root));
        let errors: BTreeMap<u32, f64> = surface.picture().roots().map(certified).collect();
        let largest = errors.values().copied().fold(0.0, f64::max);
        let error_of = |root: u32| errors.get(&root).copied().unwrap_or_default();
        let surfaces = OnceCell::new();
        let pixel_size = 1.0 / view.pixels_per_tangent();
        let mut wrong = Vec::new();
        for pixel in 0..drawn.roots.len() {
            let (root, depth) = (drawn.roots[pixel], f64::from(drawn.depths[pixel]));
            let reference = map[pixel];
            if root.is_none() && reference.is_infinite() {
                continue;
            }
            self.pixels[0] += 1;
            let own = point(view, pixel, depth);
            let other = point(view, pixel, if reference.is_finite() { reference } else { 1.0 });
            let slack_at = |depth: f64| self.slack + depth * (PIXEL_SLACK * pixel_size + 4.0 * DEPTH_SLACK);
            let error = root.map_or(0.0, error_of);
            if root.is_some() && reference.is_finite() && (own - other).length() <= error + slack_at(depth) {
                continue;
            }
            self.pixels[1] += 1;
            let reach = error + slack_at(depth);
            let is_drawn_right = root.is_none() || self.tree.is_near(own, reach, |_| reach);
            let is_shown = || {
                let slack = slack_at(reference);
                let (tree, labels): &(Tree, Vec<f64>) = surfaces.get_or_init(|| drawn_tree(surface, &error_of));
                tree.is_near(other, largest + slack, |label| labels[label as usize] + slack)
            };
            if !is_drawn_right || (reference.is_finite() && !is_shown()) {
                wrong.push(pixel);
            }
        }
        wrong
    }

    pub fn summary(&self) -> String {
        let [compared, silhouettes] = self.pixels;
        let share = 100.0 * silhouettes as f64 / compared.max(1) as f64;
        format!(
            "{compared} pixels, {silhouettes} ({share:.2} %) at silhouettes and grazing angles, decided by distance"
        )
    }
}

/// A tree over everything that is drawn. The label of each triangle leads to its error.
fn drawn_tree(surface: &Surface, error_of: &dyn Fn(u32) -> f64) -> (Tree, Vec<f64>) {
    let mesh = surface.picture().mesh();
    let errors = surface.picture().roots().map(|drawn| error_of(drawn.surface.root)).collect();
    (Tree::new(&mesh.positions, &mesh.triangles, |triangle| mesh.triangle_nodes[triangle]), errors)
}
