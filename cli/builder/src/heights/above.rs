//! Tiles above the units: their samples are gathered first, and every unit says how far they are from its samples.

use std::collections::HashMap;

use lodpack::heights::{CELLS, Lines, TileEncoder, TileId, TileValues};
use lodpack::write::SymbolBuffer;
use serde::{Deserialize, Serialize};

use rayon::prelude::*;

use super::HeightsError;
use super::facets::Judge;
use super::mask::{Drawn as DrawnCells, Mask};
use super::samples::Samples;
use super::spill::Spill;
use super::tile::{Drawn, Off, SeenFacets, Setting, Tile, distance_of_quarters, symbols_of};
use super::unit::{Below, Parent, Unit, finish_tile};

/// What has been seen of tiles: of each resolution.
pub type Seen = Vec<(TileId, Vec<SeenFacets>)>;

/// A tile above the units, as far as it follows from the samples of its own and of its quarters.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Top {
    pub id: TileId,
    /// Its samples, as in [`TileValues`].
    steps: Vec<i32>,
    cells: Option<Vec<u64>>,
    /// Bits of the cells that have all samples; none if all have.
    whole: Option<Vec<u64>>,
    /// How far its quarters are from it.
    off: Off,
    has_quarters: bool,
}

impl Top {
    /// Its samples.
    pub fn values(&self) -> TileValues {
        let steps = Box::new(std::array::from_fn(|at| self.steps.get(at).copied().unwrap_or(0)));
        let row = |cells: &Vec<u64>, row: usize| cells.get(row).copied().unwrap_or(0);
        let cells = self.cells.as_ref().map(|cells| Box::new(std::array::from_fn(|at| row(cells, at))));
        TileValues { steps, cells }
    }
}

/// The tiles above all units, coarse ones first.
pub fn tops(setting: &Setting<'_>, samples: &Samples, units: &[TileId]) -> Result<Vec<Top>, HeightsError> {
    let unit_depth = units.first().map_or(0, |unit| unit.depth);
    if unit_depth == 0 {
        return Ok(vec![]);
    }
    let masks = masks(setting, samples, units, unit_depth)?;
    let first_cell = |id: TileId| [id.column as usize * CELLS, id.row as usize * CELLS];
    let values = |id: TileId| -> Result<Option<TileValues>, HeightsError> {
        if !setting.grid.has(id) {
            return Ok(None);
        }
        let cells = match masks.get(id.depth as usize) {
            None => None,
            Some(mask) => match mask.tile(first_cell(id)) {
                DrawnCells::None => return Ok(None),
                DrawnCells::Some(bits) => Some(bits),
                DrawnCells::All => None,
            },
        };
        let Lines { columns, rows } = setting.grid.lines(id);
        let all = samples.at_lines(&columns, &rows)?;
        Ok(Some(TileValues { steps: Box::new(std::array::from_fn(|k| all[k] >> 1)), cells }))
    };
    let mut tops = vec![];
    let mut level: Vec<(TileId, TileValues)> = vec![];
    for root in setting.grid.root_tiles() {
        level.extend(values(root)?.map(|values| (root, values)));
    }
    for _ in 0..unit_depth {
        let mut next = vec![];
        for (id, own) in level {
            let mut quarters = vec![];
            if !setting.grid.lines(id).is_finest() {
                for quarter in id.children() {
                    quarters.extend(values(quarter)?.map(|values| (quarter, values)));
                }
            }
            let off = distance_of_quarters(setting, id, &own, quarters.iter().map(|(id, values)| (*id, values)));
            tops.push(Top {
                id,
                steps: own.steps.to_vec(),
                cells: own.cells.map(|cells| cells.to_vec()),
                whole: masks.get(id.depth as usize).map(|mask| mask.whole(first_cell(id))),
                off,
                has_quarters: !quarters.is_empty(),
            });
            next.extend(quarters);
        }
        level = next;
    }
    Ok(tops)
}

/// The symbols of all tiles above the units.
pub fn symbols_of_tops(
    setting: &Setting<'_>,
    values: &HashMap<TileId, TileValues>,
    tops: &[Top],
) -> Result<Vec<SymbolBuffer>, HeightsError> {
    let above = |id: TileId| values.get(&id.parent()?);
    let of = |top: &Top| Some(symbols_of(setting.grid, top.id, above(top.id), values.get(&top.id)?));
    tops.iter().filter_map(of).collect()
}

/// The tiles above some units.
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
    /// Lays out those tiles that lie above some units.
    pub fn new(setting: &Setting<'_>, tops: &[Top], units: &[TileId]) -> Result<Self, HeightsError> {
        let is_above = |id: TileId| units.iter().any(|unit| unit.depth > id.depth && unit.ancestor(id.depth) == id);
        let (mut tiles, mut order): (HashMap<TileId, Entry>, _) = (HashMap::new(), vec![]);
        for top in tops.iter().filter(|top| is_above(top.id)) {
            let coarser = top.id.parent().and_then(|parent| Some(tiles.get(&parent)?.off.most));
            let off = top.has_quarters.then_some(top.off);
            let mut tile = Tile::new(setting, (top.id, None), top.values(), off, coarser)?;
            if let Some(whole) = &top.whole {
                tile.note_partly(setting, |column, row| whole.get(row).is_some_and(|bits| bits >> column & 1 != 0));
            }
            order.push(top.id);
            tiles.insert(top.id, Entry { tile, off: top.off });
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

    /// What the samples of a unit say of the tiles above it.
    pub fn seen(&self, unit: TileId, judge: &Judge<'_>) -> Seen {
        let above = (0..unit.depth).filter_map(|depth| self.tiles.get(&unit.ancestor(depth)));
        above.map(|entry| (entry.tile.id, entry.tile.drawn.iter().map(|drawn| drawn.seen(judge)).collect())).collect()
    }

    /// What all units together have seen.
    pub fn all_seen(&self) -> Seen {
        let of = |id: &TileId| Some((*id, self.tiles.get(id)?.tile.drawn.iter().map(Drawn::all_seen).collect()));
        self.order.iter().filter_map(of).collect()
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
    if !samples.about.has_voids {
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
