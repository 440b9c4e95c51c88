//! The images of tiles of heights: normals that agree along borders, colours, and where vertices lie in them.

use std::{collections::HashMap, sync::Arc};

use super::heights::{Worker, frame, open, options, random_view, settled, terrains};
use crate::{
    heights::{CELLS, Drape, DrapeImage, DrapeWindow, Heights, Normal, Ramp, RampStop, SIDE, TileId, tile_box},
    limits::Limits,
    select::{Projection, View},
    stream::{DrawnRoot, HeightsSession, Mode, Options},
    tests::{synthetic::Random, terrain::Terrain},
};

/// Of all tiles that are drawn, by tile.
fn drawn(session: &HeightsSession) -> HashMap<TileId, DrawnRoot> {
    session.picture().roots().map(|root| (session.tile(root.surface.root).unwrap(), root.clone())).collect()
}

fn furthest(a: Normal, b: Normal) -> i32 {
    (0..3).map(|k| (i32::from(a[k]) - i32::from(b[k])).abs()).max().unwrap()
}

/// Samples on the border of a tile, without its corners: numbers and names.
fn on_border(file: &Heights<&[u8]>, id: TileId) -> Vec<(usize, [u64; 2])> {
    let lines = file.grid().lines(id);
    let last = [&lines.columns, &lines.rows].map(|lines| lines.partition_point(|&line| line < lines[CELLS]));
    let mut all = Vec::new();
    for row in 0..=last[1] {
        for column in 0..=last[0] {
            let [on_column, on_row] = [column == 0 || column == last[0], row == 0 || row == last[1]];
            if on_column != on_row {
                all.push((row * SIDE + column, file.grid().vertex(lines.columns[column], lines.rows[row])));
            }
        }
    }
    all
}

#[test]
fn both_sides_of_a_border_have_the_same_normals() {
    for (name, terrain) in terrains().into_iter().filter(|(name, _)| !name.contains("islands")) {
        let bytes = terrain.file(12.0);
        let file = open(&bytes);
        let mut random = Random::new(5);
        let mut session = HeightsSession::new(Arc::clone(file.index()), options(Mode::Asynchronous)).unwrap();
        let mut compared = [0; 2];
        for _ in 0..40 {
            let view = random_view(file.index(), &mut random);
            settled(&mut session, &view, &bytes);
            let tiles = drawn(&session);
            let mut known: HashMap<[u64; 2], Vec<(TileId, Normal)>> = HashMap::new();
            for (&id, root) in &tiles {
                for (at, sample) in on_border(&file, id) {
                    known.entry(sample).or_default().push((id, root.images().unwrap().normals[at]));
                }
            }
            for (sample, sides) in known {
                // Elsewhere tiles meet at a corner of one of them.
                let [(id, a), (other, b)] = sides[..] else { continue };
                assert!(furthest(a, b) <= 1, "{name}: {sample:?} of {id:?} and {other:?}: {a:?} {b:?}");
                compared[usize::from(id.depth != other.depth)] += 1;
            }
        }
        assert!(compared.iter().all(|&count| count > 500) || name.contains("within"), "{name}: {compared:?}");
    }
}

#[test]
fn normals_of_meshes_are_those_of_the_finest_images() {
    let bytes = Terrain::globe([600, 300]).file(12.0);
    let file = open(&bytes);
    let cut = file.cut(&Default::default()).unwrap();
    let mesh = file.mesh(&cut).unwrap();
    assert_eq!((mesh.normals.len(), mesh.heights.len()), (mesh.positions.len(), mesh.positions.len()));
    let mut compared = 0;
    for (k, &[column, row]) in mesh.samples.iter().enumerate() {
        let id = TileId { depth: file.grid().depth(), column: column / CELLS as u64, row: row / CELLS as u64 };
        let at = [column, row].map(|line| (line % CELLS as u64) as usize);
        if at.iter().all(|&at| at > 0) {
            let values = file.tile(id).unwrap().unwrap();
            let normals = crate::heights::normals(file.info(), (id, &values), [None; 4]);
            assert!(furthest(normals[at[1] * SIDE + at[0]], mesh.normals[k]) <= 1, "{column} {row}");
            compared += 1;
        }
    }
    assert!(compared > 1000);
}

#[test]
fn a_ball_is_shaded_as_a_ball_at_every_depth() {
    let mut terrain = Terrain::globe([600, 300]);
    terrain.info.step = 1e-9;
    let bytes = terrain.file(1e9);
    let file = open(&bytes);
    for depth in 0..=file.grid().depth() {
        for id in (0..2).map(|column| TileId { depth, column, row: 0 }) {
            let values = file.tile(id).unwrap().unwrap();
            let normals = crate::heights::normals(file.info(), (id, &values), [None; 4]);
            let lines = file.grid().lines(id);
            for at in 0..SIDE * SIDE {
                let [longitude, latitude] =
                    [(0, lines.columns[at % SIDE]), (1, lines.rows[at / SIDE])].map(|(axis, line)| {
                        (file.surface().first[axis] + file.surface().spacing[axis] * line as f64).to_radians()
                    });
                let up = [latitude.cos() * longitude.cos(), latitude.cos() * longitude.sin(), latitude.sin()];
                let expected = up.map(|x| (x * 32767.0).round() as i16);
                assert!(furthest(normals[at], expected) <= 1, "{id:?} {at}: {:?} {expected:?}", normals[at]);
            }
        }
    }
}

#[test]
fn vertices_lie_in_the_images_where_their_samples_are() {
    for (name, terrain) in terrains() {
        let bytes = terrain.file(12.0);
        let file = open(&bytes);
        let mut random = Random::new(3);
        let mut session = HeightsSession::new(Arc::clone(file.index()), options(Mode::Asynchronous)).unwrap();
        let mut worker = Worker::default();
        for _ in 0..30 {
            let view = random_view(file.index(), &mut random);
            frame(&mut session, &view);
            for (id, root) in drawn(&session) {
                let lines = file.grid().lines(id);
                let (positions, _) = root.joined();
                let places: Vec<[f32; 2]> = root.places().collect();
                assert_eq!(places.len(), positions.len());
                let surface = file.surface();
                for (place, position) in places.iter().zip(&positions) {
                    let line = |axis: usize| {
                        let lines = if axis == 0 { &lines.columns } else { &lines.rows };
                        let before = (place[axis] as usize).min(CELLS);
                        let share = f64::from(place[axis]) - before as f64;
                        let next = lines[(before + 1).min(CELLS)];
                        lines[before] + (share * (next - lines[before]) as f64).round() as u64
                    };
                    let [column, row] = [line(0), line(1)];
                    let lines = [surface.line(0, column), surface.line(1, row)];
                    let ground = surface.position(lines[0], lines[1], 0.0);
                    // Heights go up from there.
                    let up = surface.position(lines[0], lines[1], 1.0);
                    let off = |k: usize| position[k] - ground[k];
                    let along: f64 = (0..3).map(|k| off(k) * (up[k] - ground[k])).sum();
                    let scale: f64 = (0..3).map(|k| (up[k] - ground[k]).powi(2)).sum();
                    let beside: f64 = (0..3).map(|k| (off(k) - along / scale * (up[k] - ground[k])).powi(2)).sum();
                    assert!(
                        beside < 1e-6 || name.contains("within"),
                        "{name} {id:?} {place:?}: {position:?} {ground:?}"
                    );
                }
            }
            worker.work(&session, &bytes, random.below(40), &mut random);
        }
    }
}

#[test]
fn a_ramp_colours_every_sample() {
    let stop = |height: f64, shade: u8| RampStop { height, colour: [shade, 255 - shade, 7] };
    let ramp = Ramp::new(vec![stop(10.0, 0), stop(70.0, 240)]).unwrap();
    let bytes = Terrain::plane([300, 173]).with_ramp(ramp.clone()).file(12.0);
    let file = Heights::open(bytes.as_slice(), Limits::default()).unwrap();
    assert_eq!(file.ramp(), Some(&ramp));
    let mut session = HeightsSession::new(Arc::clone(file.index()), options(Mode::Asynchronous)).unwrap();
    let view = random_view(file.index(), &mut Random::new(2));
    frame(&mut session, &view);
    let mut shades = std::collections::HashSet::new();
    for (id, root) in drawn(&session) {
        let values = file.tile(id).unwrap().unwrap();
        let images = root.images().unwrap();
        for (colour, &steps) in images.colours.as_ref().unwrap().iter().zip(values.steps.iter()) {
            assert_eq!(*colour, ramp.colour(file.info().height(steps)));
            shades.insert(colour[0]);
        }
    }
    assert!(shades.len() > 20);
}

#[test]
fn tiles_are_as_fine_as_their_images_have_to_be() {
    for (name, terrain) in terrains().into_iter().filter(|(name, _)| !name.contains("within")) {
        let bytes = terrain.file(12.0);
        let file = open(&bytes);
        let mut random = Random::new(9);
        let with = |sample_px: f64| {
            let options = Options { sample_px, ..options(Mode::Asynchronous) };
            HeightsSession::new(Arc::clone(file.index()), options).unwrap()
        };
        let (mut coarse, mut fine) = (with(f64::INFINITY), with(3.0));
        let mut deeper = 0;
        for _ in 0..20 {
            let view = View { pixel_tolerance: 50.0, ..random_view(file.index(), &mut random) };
            settled(&mut coarse, &view, &bytes);
            settled(&mut fine, &view, &bytes);
            let projection = Projection::new(&view).unwrap();
            for id in drawn(&fine).into_keys() {
                let record = file.record(id).unwrap().unwrap();
                let [column, row] = file.surface().spacing.map(f64::abs);
                let on_globe = if file.surface().is_globe() { 1000.0 * std::f64::consts::PI / 180.0 } else { 1.0 };
                let spacing = column.max(row) * on_globe * (1_u64 << (file.grid().depth() - id.depth)) as f64;
                let px = spacing * projection.look_at(&tile_box(file.index(), &record)).factor;
                let is_finest = record.children == 0 || record.lowest == record.highest;
                assert!(px <= 3.0 * (1.0 + 1e-9) || is_finest, "{name} {id:?}: {px}");
            }
            let depth = |session: &HeightsSession| drawn(session).into_keys().map(|id| id.depth).max();
            assert!(depth(&fine) >= depth(&coarse));
            deeper += u32::from(depth(&fine) > depth(&coarse));
        }
        assert!(deeper > 0, "{name}");
    }
}

#[test]
fn tiles_under_an_image_show_it_at_a_scale_of_their_own() {
    // Half a texel of it lies beyond the grid on each side.
    let drape = Drape { size: [1201, 693], first: [0.0; 2], spacing: [0.25; 2], components: 3, side_log2: 6 };
    let bytes = Terrain::plane([300, 173]).with_drape(drape).file(12.0);
    let file = open(&bytes);
    let whole = |halvings: u8| {
        let size = drape.size_at(halvings).map(|size| size as u32);
        file.drape_image(&DrapeWindow { halvings, first: [0, 0], size }).unwrap()
    };
    let scales: Vec<DrapeImage> = (0..=drape.most_halvings()).map(whole).collect();
    let mut random = Random::new(8);
    let mut session = HeightsSession::new(Arc::clone(file.index()), options(Mode::Asynchronous)).unwrap();
    let mut worker = Worker::default();
    let mut compared = HashMap::new();
    for step in 0..80 {
        let view = random_view(file.index(), &mut random);
        // Whatever has come until now is drawn with its image.
        match step % 3 {
            0 => drop(settled(&mut session, &view, &bytes)),
            _ => drop(frame(&mut session, &view)),
        }
        for (id, root) in drawn(&session) {
            let images = root.images().unwrap();
            let distance = f64::from(1_u32 << (file.grid().depth() - id.depth)) / f64::from(images.per_sample);
            let halvings = drape.halvings_for(distance);
            let lines = file.grid().lines(id);
            for at in 0..SIDE * SIDE {
                let place = [lines.columns[at % SIDE] as f64, lines.rows[at / SIDE] as f64];
                let wanted = scales[usize::from(halvings)].over(place, [0; 3]);
                let shown = images.colours.as_ref().unwrap()[images.texel_of(at)];
                assert!((0..3).all(|k| wanted[k].abs_diff(shown[k]) <= 1), "{id:?} {at}: {wanted:?} {shown:?}");
            }
            *compared.entry(halvings).or_insert(0) += 1;
        }
        worker.work(&session, &bytes, random.below(40), &mut random);
    }
    assert!(compared.len() > 2 && compared.contains_key(&0), "{compared:?}");
    assert!(session.take_problems().is_empty());
}
