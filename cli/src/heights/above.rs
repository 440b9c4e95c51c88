//! Tiles above the units: their samples are gathered first, and every unit says how far they are from its samples.

use std::collections::HashMap;

use lodpack::heights::{CELLS, Lines, TileEncoder, TileId, TileValues};
use lodpack::write::SymbolBuffer;

use rayon::prelude::*;

use super::HeightsError;
use super::coding::{Spill, symbols_of};
use super::facets::Judge;
use super::mask::{Drawn as DrawnCells, Mask};
use super::samples::Samples;
use super::tile::{Off, Setting, Tile, distance_of_quarters};
use super::unit::{Below, Parent, Unit, finish_tile};

/// What a unit has seen of a tile: of each resolution, of each triangle.
pub type Seen = Vec<(TileId, Vec<Vec<[f64; 2]>>)>;

/// The tiles above all units.
pub struct Above {
    tiles: HashMap<TileId, Entry>,
    /// From the deepest on.
    order: Vec<TileId>,
}

struct Entry {
    tile: Tile,
    off: Off,
}

impl Above {
    /// Gathers the samples of all tiles above some units.
    pub fn new(setting: &Setting<'_>, samples: &Samples, units: &[TileId]) -> Result<Self, HeightsError> {
        let Some(unit_depth) = units.first().map(|unit| unit.depth) else {
            return Ok(Self { tiles: HashMap::new(), order: vec![] });
        };
        if unit_depth == 0 {
            return Ok(Self { tiles: HashMap::new(), order: vec![] });
        }
        let masks = masks(setting, samples, units, unit_depth)?;
        let values = |id: TileId| -> Result<Option<TileValues>, HeightsError> {
            if !setting.grid.has(id) {
                return Ok(None);
            }
            let cells = match masks.get(id.depth as usize) {
                None => None,
                Some(mask) => match mask.tile([id.column as usize * CELLS, id.row as usize * CELLS]) {
                    DrawnCells::None => return Ok(None),
                    DrawnCells::Some(bits) => Some(bits),
                    DrawnCells::All => None,
                },
            };
            let Lines { columns, rows } = setting.grid.lines(id);
            let all = samples.at_lines(&columns, &rows)?;
            Ok(Some(TileValues { steps: Box::new(std::array::from_fn(|k| all[k] >> 1)), cells }))
        };
        let (mut tiles, mut order): (HashMap<TileId, Entry>, _) = (HashMap::new(), vec![]);
        let mut level: Vec<(TileId, TileValues)> = vec![];
        for root in setting.grid.root_tiles() {
            level.extend(values(root)?.map(|values| (root, values)));
        }
        for _ in 0..unit_depth {
            let mut next = vec![];
            for (id, own) in level {
                let coarser = id.parent().and_then(|parent| Some(tiles.get(&parent)?.off.most));
                let mut quarters = vec![];
                if !setting.grid.lines(id).is_finest() {
                    for quarter in id.children() {
                        quarters.extend(values(quarter)?.map(|values| (quarter, values)));
                    }
                }
                let off = distance_of_quarters(setting, id, &own, quarters.iter().map(|(id, values)| (*id, values)));
                let mut tile = Tile::new(setting, (id, None), own, (!quarters.is_empty()).then_some(off), coarser)?;
                if let Some(mask) = masks.get(id.depth as usize) {
                    let [x, y] = [id.column as usize * CELLS, id.row as usize * CELLS];
                    tile.note_partly(setting, |column, row| mask.is_whole([x + column, y + row]));
                }
                order.push(id);
                tiles.insert(id, Entry { tile, off });
                next.extend(quarters);
            }
            level = next;
        }
        order.reverse();
        Ok(Self { tiles, order })
    }

    /// The samples of a tile.
    pub fn values(&self, id: Option<TileId>) -> Option<&TileValues> {
        self.tiles.get(&id?).map(|entry| &entry.tile.values)
    }

    /// The tile above a unit.
    pub fn parent(&self, unit: TileId) -> Option<Parent<'_>> {
        let entry = self.tiles.get(&unit.parent()?)?;
        Some(Parent { values: &entry.tile.values, off: entry.off.most })
    }

    /// The symbols of all tiles.
    pub fn symbols(&self, setting: &Setting<'_>) -> Result<Vec<SymbolBuffer>, HeightsError> {
        let of = |&id: &TileId| {
            let entry = self.tiles.get(&id)?;
            Some(symbols_of(setting.grid, id, self.values(id.parent()), &entry.tile.values))
        };
        self.order.iter().rev().filter_map(of).collect()
    }

    /// What the samples of a unit say of the tiles above it.
    pub fn seen(&self, unit: TileId, judge: &Judge<'_>) -> Seen {
        let above = (0..unit.depth).filter_map(|depth| self.tiles.get(&unit.ancestor(depth)));
        above.map(|entry| (entry.tile.id, entry.tile.drawn.iter().map(|drawn| drawn.seen(judge)).collect())).collect()
    }

    /// Keeps what a unit has seen.
    pub fn join(&mut self, seen: Seen) {
        for (id, distances) in seen {
            if let Some(entry) = self.tiles.get_mut(&id) {
                entry.tile.drawn.iter_mut().zip(&distances).for_each(|(drawn, seen)| drawn.join(seen));
            }
        }
    }

    /// Finishes all tiles, once every unit has said what it saw.
    pub fn finish(
        &self,
        setting: &Setting<'_>,
        encoder: &TileEncoder,
        units: Vec<Below>,
        spill: &Spill,
    ) -> Result<(), HeightsError> {
        let mut below: HashMap<TileId, Vec<Below>> = HashMap::new();
        let say = |below: &mut HashMap<TileId, Vec<Below>>, said: Below| {
            if let Some(parent) = said.id.parent() {
                below.entry(parent).or_default().push(said);
            }
        };
        units.into_iter().for_each(|said| say(&mut below, said));
        let mut finished = vec![];
        for id in &self.order {
            let Some(entry) = self.tiles.get(id) else { continue };
            let quarters = below.remove(id).unwrap_or_default();
            let off = (!quarters.is_empty()).then_some(entry.off.most);
            let (said, done) = finish_tile(setting, encoder, &entry.tile, off, self.values(id.parent()), &quarters)?;
            finished.push(done);
            say(&mut below, said);
        }
        spill.put(finished)
    }
}

/// Which cells are drawn at each depth from 0 to that of the units; none if all are.
fn masks(setting: &Setting<'_>, samples: &Samples, units: &[TileId], depth: u32) -> Result<Vec<Mask>, HeightsError> {
    if !samples.has_voids {
        return Ok(vec![]);
    }
    let [columns, rows] = setting.grid.roots();
    let size = [columns, rows].map(|count| (count << depth) as usize * CELLS);
    let mut whole = Mask::empty(size);
    let masks = units.par_iter().map(|&root| -> Result<_, HeightsError> {
        let unit = Unit::read(setting, samples, root)?;
        Ok((root, unit.root_mask().cloned().unwrap_or_else(|| Mask::new([CELLS; 2], |_, _| true))))
    });
    for (root, mask) in masks.collect::<Result<Vec<_>, _>>()? {
        whole.put([root.column as usize * CELLS, root.row as usize * CELLS], &mask);
    }
    let mut masks = vec![whole];
    for _ in 0..depth {
        let above = masks.last().map(Mask::halved);
        masks.extend(above);
    }
    masks.reverse();
    Ok(masks)
}
