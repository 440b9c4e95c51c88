//! Welding: which samples and patch vertices are the same point.

use std::path::Path;

use super::image::GeometryImage;
use super::manifest::{Border, ImageEdge, Manifest};
use super::{AtlasError, MANIFEST_NAME};
use lodpack_mesh::Mesh;
use lodpack_mesh::union_find::{find, unite};

/// All points of an atlas: the samples of one image after the other, then the vertices of one patch after the other.
pub(super) struct Points {
    /// For each point the first one that is the same.
    pub representative: Vec<u32>,
    /// The index of the first point of each image, then of each patch.
    pub first: Vec<u32>,
    /// Vertices of patches between two samples of an image.
    pub inserted: Vec<Inserted>,
}

/// Vertices of a patch that lie between two neighbouring samples on an image's edge.
pub(super) struct Inserted {
    pub from: u32,
    pub to: u32,
    pub between: Vec<u32>,
}

impl Points {
    /// Welds the edges that `atlas.json` declares common.
    pub fn new(
        dir: &Path,
        manifest: &Manifest,
        images: &[GeometryImage],
        patches: &[Mesh],
    ) -> Result<Self, AtlasError> {
        let mut first = Vec::with_capacity(images.len() + patches.len());
        let mut count = 0u64;
        let counts =
            images.iter().map(|image| image.samples.len()).chain(patches.iter().map(|mesh| mesh.positions.len()));
        for own in counts {
            first.push(count as u32);
            count += own as u64;
        }
        let manifest_error = |what| AtlasError::Format { path: dir.join(MANIFEST_NAME), what };
        if count * 6 >= u64::from(u32::MAX) {
            return Err(manifest_error(format!("{count} samples and vertices are more than a mesh can hold")));
        }
        let mut points = Self { representative: (0..count as u32).collect(), first, inserted: vec![] };
        for index in 0..images.len() {
            for edge in ImageEdge::ALL {
                points.weld_edge(manifest, images, index, edge)?;
            }
        }
        for (patch, mesh) in patches.iter().enumerate() {
            let name = &manifest.patches[patch].file;
            for border in &manifest.patches[patch].borders {
                if let Some(v) = border.vertices.iter().find(|&&v| v as usize >= mesh.positions.len()) {
                    let what = format!("patch {name}: there is no vertex {v}, the file has {}", mesh.positions.len());
                    return Err(manifest_error(what));
                }
                let mut sorted = border.vertices.clone();
                sorted.sort_unstable();
                if let Some(twice) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
                    let edge = border.edge;
                    return Err(manifest_error(format!("patch {name}: vertex {} is on the {edge} twice", twice[0])));
                }
                let root = border.root as usize;
                points.weld_border(&images[root], border, mesh, images.len() + patch).map_err(|what| {
                    AtlasError::EdgesDisagree {
                        first: location(&manifest.roots[root].file, border.edge),
                        second: format!("patch {name}"),
                        what,
                    }
                })?;
            }
        }
        for v in 0..count as u32 {
            points.representative[v as usize] = find(&mut points.representative, v);
        }
        Ok(points)
    }

    /// Welds an edge of an image to that of its neighbour, which must have the same samples.
    fn weld_edge(
        &mut self,
        manifest: &Manifest,
        images: &[GeometryImage],
        index: usize,
        edge: ImageEdge,
    ) -> Result<(), AtlasError> {
        let (root, image) = (&manifest.roots[index], &images[index]);
        let Some(neighbour) = root.neighbours.across(edge) else { return Ok(()) };
        let (other_root, other) = (neighbour.root as usize, &images[neighbour.root as usize]);
        let disagree = |what| AtlasError::EdgesDisagree {
            first: location(&root.file, edge),
            second: location(&manifest.roots[other_root].file, neighbour.edge),
            what,
        };
        if image.last != other.last {
            return Err(disagree(format!("{} and {} samples", image.last + 1, other.last + 1)));
        }
        for k in 0..=image.last {
            let here = edge.pixel(k, image.last);
            let there = neighbour.edge.pixel(if neighbour.reversed { image.last - k } else { k }, image.last);
            let (a, b) = (image.at(here), other.at(there));
            if a != b {
                return Err(disagree(format!("sample {k} is {a:?} and {b:?}")));
            }
            let [a, b] = [self.sample(index, image, here), self.sample(other_root, other, there)];
            unite(&mut self.representative, a, b);
        }
        Ok(())
    }

    /// Welds a patch's border to an image's edge, whose samples must be among the border's vertices, in order.
    fn weld_border(&mut self, image: &GeometryImage, border: &Border, mesh: &Mesh, patch: usize) -> Result<(), String> {
        let root = border.root as usize;
        let sample_at = |k| border.edge.pixel(k, image.last);
        let mut next = 0;
        let mut between = Vec::new();
        for &v in &border.vertices {
            let vertex = self.first[patch] + v;
            let position = mesh.positions[v as usize].as_vec3().to_array();
            if next <= image.last && image.at(sample_at(next)) == position {
                let sample = self.sample(root, image, sample_at(next));
                if !between.is_empty() {
                    let from = self.sample(root, image, sample_at(next - 1));
                    self.inserted.push(Inserted { from, to: sample, between: std::mem::take(&mut between) });
                }
                unite(&mut self.representative, sample, vertex);
                next += 1;
            } else if next == 0 {
                break;
            } else {
                between.push(vertex);
            }
        }
        if next <= image.last {
            return Err(format!(
                "sample {next}, {:?}, is missing among the patch's {} vertices there, or out of order",
                image.at(sample_at(next)),
                border.vertices.len()
            ));
        }
        match between.len() {
            0 => Ok(()),
            count => Err(format!("the patch has {count} vertices after the last sample")),
        }
    }

    fn sample(&self, root: usize, image: &GeometryImage, (column, row): (usize, usize)) -> u32 {
        self.first[root] + (row * (image.last + 1) + column) as u32
    }
}

fn location(file: &str, edge: ImageEdge) -> String {
    format!("root {file} ({edge})")
}
