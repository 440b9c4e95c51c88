//! The image over a tile, with a whole number of texels for each of its samples: for sessions, which draw images of
//! tiles.

use std::sync::Arc;

use super::{
    colours::BARE,
    drape::{DrapeImage, DrapeWindow},
    drawn::TileValues,
    grid::{CELLS, Lines, SIDE},
    index::HeightsIndex,
    page::TileRecord,
};

/// Tiles below which there are none have up to this many texels for each sample: nothing finer is drawn of them.
const OF_LAST: u32 = 8;

/// Colours of a tile, as screens show them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TileColours {
    /// Texels for each sample, along each direction.
    pub per_sample: u32,
    /// Red, green and blue, row by row from the north-west: 64 times as many and one along each side.
    pub texels: Arc<[[u8; 3]]>,
}

/// How the image covers a tile.
#[derive(Clone, Debug)]
pub(crate) struct Covering {
    window: DrapeWindow,
    lines: Lines,
    per_sample: u32,
}

impl Covering {
    /// None where the image does not cover the tile. It gets as many texels as there are, up to `most` for each sample.
    pub fn of(index: &HeightsIndex, tile: &TileRecord, most: u32) -> Option<Self> {
        let (drape, grid) = (index.drape()?, index.grid());
        let most = if tile.children == 0 { most.max(OF_LAST) } else { most };
        let distance = grid.distance(tile.id) as f64;
        let there = (distance / drape.spacing[0].min(drape.spacing[1])).ceil().clamp(1.0, f64::from(most.max(1)));
        let per_sample = (there as u32).next_power_of_two();
        let [columns, rows] = grid.ends(tile.id);
        let window = drape.window(columns, rows, drape.halvings_for(distance / f64::from(per_sample)))?;
        Some(Self { window, lines: grid.lines(tile.id), per_sample })
    }

    /// The texels that it takes.
    pub fn window(&self) -> &DrapeWindow {
        &self.window
    }

    /// The colours of the tile: what the image shows, over the ramp where it is transparent.
    pub fn colours(&self, index: &HeightsIndex, values: &TileValues, image: &DrapeImage) -> TileColours {
        let per_sample = self.per_sample as usize;
        let side = CELLS * per_sample + 1;
        // The place of each column of texels, and of each row.
        let along = |lines: &[u64; SIDE]| -> Vec<f64> {
            let at = |k: usize| {
                let (line, rest) = (k / per_sample, k % per_sample);
                let next = lines[(line + 1).min(CELLS)];
                lines[line] as f64 + (next - lines[line]) as f64 * (rest as f64 / per_sample as f64)
            };
            (0..side).map(at).collect()
        };
        let (columns, rows) = (along(&self.lines.columns), along(&self.lines.rows));
        let below = |x: usize, y: usize| match index.ramp() {
            Some(ramp) => {
                let sample = (y + per_sample / 2) / per_sample * SIDE + (x + per_sample / 2) / per_sample;
                ramp.colour(index.info().height(values.steps[sample]))
            }
            None => BARE,
        };
        let mut texels = Vec::with_capacity(side * side);
        for (y, &row) in rows.iter().enumerate() {
            for (x, &column) in columns.iter().enumerate() {
                let under = if image.image.components == 4 { below(x, y) } else { BARE };
                texels.push(image.over([column, row], under));
            }
        }
        TileColours { per_sample: self.per_sample, texels: texels.into() }
    }
}
