//! What tiles look like: normals of all samples, from the tile and those across its sides, and colours by height.
//!
//! A tile is drawn with few triangles where these are near the surface, but its normals still change from sample to
//! sample. So light and colours have a resolution of their own, 65 x 65 samples a tile, and are images over its
//! triangles.

use std::sync::Arc;

use crate::heights::{
    Across, CELLS, Grid, HeightsIndex, LineName, Normal, ReadyTile, SIDE, SIDES, TileColours, TileId, axis_of,
    is_first, line_name, normals,
};

pub(super) use crate::heights::across;

/// The images of a tile of heights: row by row from the north-west, a texel a sample, or several.
#[derive(Clone, Debug, PartialEq)]
pub struct TileImages {
    /// Directions of length 1, in 32,767ths: 65 x 65.
    pub normals: Box<[Normal; SIDE * SIDE]>,
    /// Red, green and blue as screens show them (sRGB), if the file has an image or a ramp: [`Self::colour_side`] along
    /// each side.
    pub colours: Option<Arc<[[u8; 3]]>>,
    /// Texels of colours for each sample, along each direction: 1, or another power of two of an image. A sample lies
    /// in the middle of its texel.
    pub per_sample: u32,
}

impl TileImages {
    /// Texels of colours along each side.
    pub fn colour_side(&self) -> usize {
        CELLS * self.per_sample as usize + 1
    }

    /// The texel of colours in whose middle a sample lies, both by number.
    pub fn texel_of(&self, sample: usize) -> usize {
        let [column, row] = [sample % SIDE, sample / SIDE].map(|at| at * self.per_sample as usize);
        row * self.colour_side() + column
    }

    /// The normals as half floats, four for each: components from -1 to 1 become numbers from `low` to `high`, which
    /// lie from 0 to 1, and a 1 follows. Bytes would show steps on gentle slopes, where an angle of half a degree is
    /// seen.
    pub fn half_floats(&self, range: [f32; 2]) -> Vec<u16> {
        self.finer_half_floats(range, 1)
    }

    /// As [`Self::half_floats`], with several texels for each sample along each direction, as colours may have them.
    pub fn finer_half_floats(&self, [low, high]: [f32; 2], per_sample: u32) -> Vec<u16> {
        let [scale, middle] = [0.5 * (high - low) / 32767.0, 0.5 * (high + low)];
        let per_sample = per_sample.clamp(1, 64) as usize;
        let last = CELLS * per_sample;
        let texel = |x: usize, y: usize| {
            let [column, row] = [x, y].map(|at| at / per_sample);
            let [right, down] = [x, y].map(|at| (at % per_sample) as f32 / per_sample as f32);
            let at = |column: usize, row: usize| self.normals[row.min(CELLS) * SIDE + column.min(CELLS)].map(f32::from);
            let corners = [at(column, row), at(column + 1, row), at(column, row + 1), at(column + 1, row + 1)];
            let [x, y, z] = [0, 1, 2].map(|k| {
                let [above, below] =
                    [0, 2].map(|row| corners[row][k] + (corners[row + 1][k] - corners[row][k]) * right);
                half(middle + scale * (above + (below - above) * down))
            });
            [x, y, z, half(1.0)]
        };
        (0..=last).flat_map(|y| (0..=last).flat_map(move |x| texel(x, y))).collect()
    }
}

/// A number from 0 to 1 in half precision.
fn half(x: f32) -> u16 {
    // The exponent counts from 15 instead of 127, and 13 digits fewer follow it. Less than 2^-14 is nothing here.
    let rounded = (x.max(0.0).to_bits() + (1 << 12)) >> 13;
    rounded.saturating_sub(112 << 10) as u16
}

/// Looks a tile up that may be decoded.
pub(super) type Peek<'p> = &'p dyn Fn(TileId) -> Option<Arc<ReadyTile>>;

/// The images of a tile, and the tiles across its sides that they were made with.
#[derive(Debug)]
pub(super) struct Dressed {
    pub images: Arc<TileImages>,
    /// None before the first normals.
    across: Option<[Option<TileId>; SIDES]>,
}

impl Dressed {
    /// The images of a tile, still without normals.
    pub fn new(index: &HeightsIndex, data: &ReadyTile) -> Self {
        let info = index.info();
        let colour = |ramp: &crate::heights::Ramp| {
            data.values.steps.iter().map(|&steps| ramp.colour(info.height(steps))).collect::<Arc<[_]>>()
        };
        let (colours, per_sample) = match &data.colours {
            Some(TileColours { per_sample, texels }) => (Some(Arc::clone(texels)), *per_sample),
            None => (index.ramp().map(colour), 1),
        };
        let images = TileImages { normals: Box::new([[0; 3]; SIDE * SIDE]), colours, per_sample };
        Self { images: Arc::new(images), across: None }
    }

    /// Takes account of the tiles across the sides. Returns whether these are others than before.
    pub fn update(
        &mut self,
        (index, peek): (&HeightsIndex, Peek<'_>),
        (id, data): (TileId, &ReadyTile),
        across: [Option<TileId>; SIDES],
    ) -> bool {
        if self.across == Some(across) {
            return false;
        }
        let tiles = across.map(|id| Some((id?, peek(id?)?)));
        let beside = tiles.each_ref().map(|tile| {
            let (id, data) = tile.as_ref()?;
            Some(Across { id: *id, values: &data.values })
        });
        let normals = normals(index.info(), (id, &data.values), beside);
        let TileImages { colours, per_sample, .. } = &*self.images;
        self.images = Arc::new(TileImages { normals, colours: colours.clone(), per_sample: *per_sample });
        self.across = Some(across);
        true
    }
}

/// The line of samples along a side of a tile, and from where to where the side goes.
pub(super) fn side_line(grid: &Grid, id: TileId, side: usize) -> (LineName, [u64; 2]) {
    let (lines, axis) = (grid.lines(id), axis_of(side));
    let [across, along] = if axis == 0 { [&lines.columns, &lines.rows] } else { [&lines.rows, &lines.columns] };
    let line = if is_first(side) { across[0] } else { across[CELLS] };
    (line_name(grid, axis, line), [along[0], along[CELLS]])
}

#[cfg(test)]
mod tests {
    use super::half;

    #[test]
    fn half_floats_are_the_nearest_ones() {
        for (x, bits) in [(0.0, 0), (1.0, 0x3c00), (0.5, 0x3800), (0.25, 0x3400), (0.333_251_95, 0x3555), (0.1, 0x2e66)]
        {
            assert_eq!(half(x), bits, "{x}");
        }
        assert_eq!(half(-0.25), 0);
    }
}
