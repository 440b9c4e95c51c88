//! What vertices of a mesh look like: the image over the heights, over the ramp.

use super::{cut::HeightsCut, file::Heights, mesh::HeightsMesh};
use crate::{error::Result, source::ReadAt};

/// What is seen where an image over heights is transparent and there is no ramp, as screens show it (sRGB).
pub const BARE: [u8; 3] = [204; 3];

impl<S: ReadAt> Heights<S> {
    /// The colour of each vertex of a mesh that [`Heights::mesh`] made of a cut, as screens show it: that of the image
    /// over the heights with about a texel a sample, and where there is none that of the ramp. None if the file has
    /// neither.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Format`], [`crate::Error::Limit`].
    pub fn colours(&self, cut: &HeightsCut, mesh: &HeightsMesh) -> Result<Option<Vec<[u8; 3]>>> {
        let of_ramp = self.ramp().map(|ramp| mesh.heights.iter().map(|&height| ramp.colour(height)).collect());
        let Some(drape) = self.drape() else { return Ok(of_ramp) };
        let mut colours: Vec<[u8; 3]> = of_ramp.unwrap_or_else(|| vec![BARE; mesh.positions.len()]);
        let mut is_painted = vec![false; colours.len()];
        // Triangles of a tile come together, but for those along borders.
        let mut of_tiles = vec![vec![]; cut.tiles.len()];
        for (triangle, &tile) in mesh.triangles.iter().zip(&mesh.triangle_tiles) {
            for &vertex in triangle {
                if let Some(is_painted) = is_painted.get_mut(vertex as usize)
                    && !std::mem::replace(is_painted, true)
                    && let Some(vertices) = of_tiles.get_mut(tile as usize)
                {
                    vertices.push(vertex as usize);
                }
            }
        }
        for (tile, vertices) in cut.tiles.iter().zip(of_tiles).filter(|(_, vertices)| !vertices.is_empty()) {
            let [columns, rows] = self.grid().ends(tile.id);
            let distance = 1_u64 << (self.grid().depth() - tile.id.depth.min(self.grid().depth()));
            let window = drape.window(columns, rows, drape.halvings_for(distance as f64));
            let Some(window) = window else { continue };
            let image = self.drape_image(&window)?;
            for vertex in vertices {
                let Some(&[column, row]) = mesh.samples.get(vertex) else { continue };
                // The last column of a grid that wraps is its first one.
                let column = if column == 0 && columns[0] > 0.0 { columns[1] } else { column as f64 };
                if let Some(colour) = colours.get_mut(vertex) {
                    *colour = image.over([column, row as f64], *colour);
                }
            }
        }
        Ok(Some(colours))
    }
}
