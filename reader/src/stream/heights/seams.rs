//! The tiles that are drawn, and the triangles along their borders, which take the samples of finer neighbours.
//!
//! A side along a border gets all samples that any tile draws between its ends (SPEC.md 22.6). So a tile's border
//! depends on the tiles that have a part of a line in common with it, and is made anew where one of these comes or
//! goes. The rest of a tile never changes.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
};

use super::images::{self, Dressed, Peek};
use crate::{
    decode::BorderKey,
    heights::{Grid, HeightsIndex, LineName, Lines, ReadyTile, SIDES, TileFaces, TileId, TileRecord, fan},
    stream::{
        drawn_surface::{DrawnSurface, Strip},
        picture::{Changes, DrawnRoot, Picture},
    },
};

/// No tile gets this number: programs use it for something else that they draw.
const RESERVED: u32 = u32::MAX;

/// A tile at a resolution, to be drawn.
pub(super) struct ToDraw<'a> {
    pub record: &'a TileRecord,
    pub resolution: usize,
    pub data: Arc<ReadyTile>,
}

/// A tile that is drawn.
#[derive(Debug)]
struct Shown {
    number: u32,
    resolution: usize,
    faces: TileFaces,
    data: Arc<ReadyTile>,
    dressed: Dressed,
}

/// A tile on a line of samples, and the part of the line that it has.
#[derive(Clone, Copy, Debug)]
struct User {
    range: [u64; 2],
    tile: TileId,
}

/// All tiles that are drawn.
#[derive(Debug, Default)]
pub(super) struct Seams {
    shown: BTreeMap<TileId, Shown>,
    tiles: HashMap<u32, TileId>,
    users: HashMap<LineName, Vec<User>>,
    /// Tiles whose normals still lack what lies across a side.
    incomplete: BTreeSet<TileId>,
    next_number: u32,
}

/// A sample on a line, as the triangles of a tile see it.
#[derive(Clone, Copy, Debug)]
struct OnLine {
    at: u64,
    /// The tile's own vertex, or one of its strip once it has one.
    vertex: Option<u32>,
    position: [f64; 3],
    name: [u64; 2],
}

/// A side of a triangle along a border: its line, from where to where, and where its ends lie in the tile's images.
struct OpenSide {
    line: LineName,
    ends: [u64; 2],
    places: [[u8; 2]; 2],
}

impl OpenSide {
    /// Where a sample on it lies in the tile's images.
    fn place(&self, grid: &Grid, lines: &Lines, at: u64) -> [f32; 2] {
        let axis = self.line.0;
        let along = if axis == 0 { &lines.rows } else { &lines.columns };
        let above = along.partition_point(|&line| line <= at);
        let before = above.saturating_sub(1);
        let width = along.get(above).map_or(0, |line| line - along[before]);
        let share = if width > 0 { (at - along[before]) as f32 / width as f32 } else { 0.0 };
        // A side that ends at a pole runs along the column of its other end.
        let is_pole =
            |row: u64| axis == 0 && (grid.poles()[0] && row == 0 || grid.poles()[1] && row == grid.cells()[1]);
        let across = f32::from(self.places[usize::from(is_pole(self.ends[0]))][axis]);
        let along = before as f32 + share;
        if axis == 0 { [across, along] } else { [along, across] }
    }
}

fn key([column, row]: [u64; 2]) -> BorderKey {
    // A grid has fewer than 2^31 columns and rows.
    BorderKey::Sample { arc: column as u32, param: row as u32 }
}

impl Seams {
    /// The tile with a number.
    pub fn tile(&self, number: u32) -> Option<TileId> {
        self.tiles.get(&number).copied()
    }

    /// The tiles that are drawn, and the numbers of their resolutions.
    pub fn tiles(&self) -> impl Iterator<Item = (TileId, usize)> + '_ {
        self.shown.iter().map(|(&id, shown)| (id, shown.resolution))
    }

    /// Draws these tiles from now on.
    pub fn update(
        &mut self,
        (index, peek): (&HeightsIndex, Peek<'_>),
        tiles: &[ToDraw<'_>],
        picture: &mut Picture,
    ) -> Changes {
        let mut changes = Changes::default();
        let wanted: BTreeMap<TileId, &ToDraw<'_>> = tiles.iter().map(|tile| (tile.record.id, tile)).collect();
        let mut affected = BTreeSet::new();
        let is_gone = |(id, shown): (&TileId, &Shown)| {
            wanted.get(id).is_none_or(|tile| tile.resolution != shown.resolution).then_some(*id)
        };
        let gone: Vec<TileId> = self.shown.iter().filter_map(is_gone).collect();
        let mut numbers = HashMap::new();
        for id in gone {
            let Some(shown) = self.shown.remove(&id) else { continue };
            self.leave(id, &shown.faces, &mut affected);
            if wanted.contains_key(&id) {
                numbers.insert(id, (shown.number, shown.dressed));
            } else {
                self.incomplete.remove(&id);
                self.tiles.remove(&shown.number);
                picture.hide(shown.number);
                changes.removed.push(shown.number);
            }
        }
        let new: Vec<&ToDraw<'_>> = tiles.iter().filter(|tile| !self.shown.contains_key(&tile.record.id)).collect();
        for ToDraw { record, resolution, data } in &new {
            let faces = data.faces(index, record.id, *resolution);
            let before = numbers.remove(&record.id);
            let (number, dressed) = before.unwrap_or_else(|| (self.new_number(), Dressed::new(index, data)));
            self.tiles.insert(number, record.id);
            for border in &faces.lines {
                self.users.entry(border.line).or_default().push(User { range: border.range, tile: record.id });
                self.add_users(border.line, border.range, &mut affected);
            }
            let (resolution, data) = (*resolution, Arc::clone(data));
            self.shown.insert(record.id, Shown { number, resolution, faces, data, dressed });
        }
        affected.extend(new.iter().map(|tile| tile.record.id));
        let dressed = self.dress((index, peek), &affected);
        let mut surfaces: BTreeMap<TileId, Arc<DrawnSurface>> = BTreeMap::new();
        for ToDraw { record, resolution, .. } in &new {
            let Some(shown) = self.shown.get_mut(&record.id) else { continue };
            let error = record.resolutions.get(*resolution).map_or(0.0, |resolution| resolution.error);
            let (faces, depth) = (&mut shown.faces, record.id.depth.min(u8::MAX.into()) as u8);
            let keys = faces.border_samples.iter().copied().map(key).collect();
            // The picture has them from now on; of those on the border, the seams need the positions, too.
            let border_positions = faces.positions[..faces.border_samples.len()].to_vec();
            let positions = std::mem::replace(&mut faces.positions, border_positions);
            let places = faces.places.iter().map(|place| place.map(f32::from)).collect();
            faces.places.truncate(faces.border_samples.len());
            let triangles = std::mem::take(&mut faces.inside);
            let surface = DrawnSurface::of_tile((shown.number, depth), (positions, places), keys, triangles, error);
            surfaces.insert(record.id, Arc::new(surface));
        }
        for id in affected {
            let Some(shown) = self.shown.get(&id) else { continue };
            let number = shown.number;
            let surface = surfaces.remove(&id);
            let drawn = picture.root(number);
            let Some(count) =
                surface.as_ref().or(drawn.map(|drawn| &drawn.surface)).map(|surface| surface.positions.len())
            else {
                continue;
            };
            let strip = self.strip(index.grid(), id, shown, count as u32);
            match surface {
                Some(surface) => {
                    changes.surfaces.push(number);
                    picture.show(DrawnRoot::of_tile(surface, strip, Arc::clone(&shown.dressed.images)));
                }
                None if drawn.and_then(|drawn| drawn.strips.first()).is_none_or(|before| **before != strip) => {
                    changes.strips.push((number, 0));
                    picture.set_strip(number, strip);
                }
                None => {}
            }
        }
        for list in [&mut changes.surfaces, &mut changes.removed] {
            list.sort_unstable();
        }
        for shown in dressed.iter().filter_map(|id| self.shown.get(id)) {
            if changes.surfaces.binary_search(&shown.number).is_err() {
                picture.set_images(shown.number, Arc::clone(&shown.dressed.images));
                changes.textures.push(shown.number);
            }
        }
        changes.textures.sort_unstable();
        changes.strips.sort_unstable();
        changes
    }

    /// Gives tiles their normals where other tiles lie across their sides than before. Returns which have new ones.
    fn dress(&mut self, (index, peek): (&HeightsIndex, Peek<'_>), affected: &BTreeSet<TileId>) -> Vec<TileId> {
        let mut dressed = Vec::new();
        for id in affected.iter().copied().chain(self.incomplete.iter().copied()).collect::<BTreeSet<_>>() {
            let mut across = [None; SIDES];
            for (side, across) in across.iter_mut().enumerate() {
                *across = self.across(index.grid(), id, side);
            }
            // Tiles above those that are drawn are there, unless the cache is too small.
            let is_there = |tile: Option<TileId>| tile.filter(|&tile| peek(tile).is_some());
            let is_complete = across.iter().all(|&tile| is_there(tile) == tile);
            let across = across.map(is_there);
            let Some(shown) = self.shown.get_mut(&id) else {
                self.incomplete.remove(&id);
                continue;
            };
            match is_complete {
                true => self.incomplete.remove(&id),
                false => self.incomplete.insert(id),
            };
            if shown.dressed.update((index, peek), (id, &shown.data), across) {
                dressed.push(id);
            }
        }
        dressed
    }

    /// The coarser tile that is drawn across a side; that of the same depth, if this one or finer ones are drawn there.
    fn across(&self, grid: &Grid, id: TileId, side: usize) -> Option<TileId> {
        let beside = images::across(grid, id, side)?;
        let (line, range) = images::side_line(grid, id, side);
        let mut users = self.users.get(&line)?.iter().filter(|user| overlap(user.range, range));
        users.find_map(|user| match user.tile.depth < id.depth {
            true => Some(user.tile),
            false => Some(beside).filter(|&beside| user.tile.ancestor(id.depth) == beside),
        })
    }

    /// A number that no tile has that is drawn.
    fn new_number(&mut self) -> u32 {
        while self.next_number == RESERVED || self.tiles.contains_key(&self.next_number) {
            self.next_number = self.next_number.wrapping_add(1);
        }
        self.next_number = self.next_number.wrapping_add(1);
        self.next_number.wrapping_sub(1)
    }

    /// Takes a tile from its lines. Tiles beside it are affected.
    fn leave(&mut self, id: TileId, faces: &TileFaces, affected: &mut BTreeSet<TileId>) {
        for border in &faces.lines {
            if let Some(users) = self.users.get_mut(&border.line) {
                users.retain(|user| user.tile != id);
                if users.is_empty() {
                    self.users.remove(&border.line);
                }
            }
            self.add_users(border.line, border.range, affected);
        }
    }

    /// Adds the tiles that have more than an end of a part of a line in common.
    fn add_users(&self, line: LineName, range: [u64; 2], tiles: &mut BTreeSet<TileId>) {
        let users = self.users.get(&line).into_iter().flatten();
        tiles.extend(users.filter(|user| overlap(user.range, range)).map(|user| user.tile));
    }

    /// The triangles along a tile's border; given the number of vertices of its surface.
    fn strip(&self, grid: &Grid, id: TileId, shown: &Shown, vertex_count: u32) -> Strip {
        let own_lines = grid.lines(id);
        let mut lines: BTreeMap<LineName, Vec<OnLine>> =
            shown.faces.lines.iter().map(|border| (border.line, self.samples(id, shown, border.line))).collect();
        let mut strip = Strip::default();
        for open in &shown.faces.open {
            let mut on_sides = open.own.clone();
            for (k, (side, vertices)) in open.sides.iter().zip(&mut on_sides).enumerate() {
                let Some((line, [from, to])) = *side else { continue };
                let corners = [k, (k + 1) % 3].map(|k| open.corners[k] as usize);
                let Some(places) = place_of(shown, corners) else { continue };
                let on_side = OpenSide { line, ends: [from, to], places };
                let Some(samples) = lines.get_mut(&line) else { continue };
                let (start, end) = (from.min(to), from.max(to));
                let between = samples.partition_point(|sample| sample.at <= start)
                    ..samples.partition_point(|sample| sample.at < end);
                let Some(between) = samples.get_mut(between) else { continue };
                let strip = &mut strip;
                let number = |sample: &mut OnLine| {
                    *sample.vertex.get_or_insert_with(|| {
                        strip.positions.push(sample.position);
                        strip.places.push(on_side.place(grid, &own_lines, sample.at));
                        strip.keys.push(key(sample.name));
                        vertex_count + strip.positions.len() as u32 - 1
                    })
                };
                *vertices = between.iter_mut().map(number).collect();
                if from > to {
                    vertices.reverse();
                }
            }
            let [a, b, c] = &on_sides;
            fan(open.corners, [a, b, c], &mut strip.triangles);
        }
        strip
    }

    /// All samples on a line of a tile that are drawn, by any tile.
    fn samples(&self, id: TileId, shown: &Shown, line: LineName) -> Vec<OnLine> {
        let mut samples = Vec::new();
        for own in shown.faces.lines.iter().filter(|border| border.line == line) {
            for user in self.users.get(&line).into_iter().flatten().filter(|user| overlap(user.range, own.range)) {
                let Some(other) = self.shown.get(&user.tile) else { continue };
                let borders = other.faces.lines.iter().filter(|border| border.line == line);
                samples.extend(borders.flat_map(|border| &border.vertices).map(|&(at, vertex)| OnLine {
                    at,
                    vertex: (user.tile == id).then_some(vertex),
                    position: other.faces.positions[vertex as usize],
                    name: other.faces.border_samples[vertex as usize],
                }));
            }
        }
        // A tile's own vertex comes first.
        samples.sort_unstable_by_key(|sample| (sample.at, sample.vertex.is_none()));
        samples.dedup_by_key(|sample| sample.at);
        samples
    }
}

/// Where vertices on a tile's border lie in its images.
fn place_of(shown: &Shown, vertices: [usize; 2]) -> Option<[[u8; 2]; 2]> {
    let place = |vertex: usize| shown.faces.places.get(vertex).copied();
    Some([place(vertices[0])?, place(vertices[1])?])
}

/// Whether parts of a line have more than an end in common.
fn overlap([start, end]: [u64; 2], [from, to]: [u64; 2]) -> bool {
    start.max(from) < end.min(to)
}
