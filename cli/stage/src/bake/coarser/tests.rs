//! Texels of patches from those of finer ones.

use lodpack::LatticePoint;
use lodpack::decode::texels::Image;

use super::super::{Baker, Coarse, Located, MAX_TEXELS, Points, Source, Storage, Stored};
use super::*;
use lodpack_mesh::srgb::srgb_byte;

/// Two floors, one 12 above the other: dark below, bright above.
struct Floors(Vec<[DVec3; 3]>);

const TRIANGLES: [[u32; 3]; 4] = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];

fn corners() -> [LatticePoint; 8] {
    let floor = |z: i64| [[0, 0, z], [64, 0, z], [64, 64, z], [0, 64, z]];
    let [low, high] = [0, 12].map(floor);
    std::array::from_fn(|k| if k < 4 { low[k] } else { high[k - 4] })
}

fn light(triangle: usize) -> f32 {
    if triangle < 2 { 0.1 } else { 0.8 }
}

impl Source for Floors {
    fn triangle_count(&self) -> usize {
        self.0.len()
    }
    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.0[triangle]
    }
    fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
        points.iter().for_each(|points| values.extend(vec![light(triangle); 3 * points.count as usize]));
    }
}

#[test]
fn floors_show_nothing_of_one_another_however_far_the_patch_may_be() {
    let positions = corners();
    let point = |vertex: u32| DVec3::from(positions[vertex as usize].map(|x| x as f64));
    let mut source = Located::new(Floors(TRIANGLES.iter().map(|corners| corners.map(point)).collect()));
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let mut baker = Baker::new(&storage);
    let patch =
        BakedPatch { positions: &positions, triangles: &TRIANGLES, reach: 0.0, areas: None, finer: 0, is_sharp: false };
    let fine = baker.bake(&patch, &mut source, 4).expect("it has an image").surfels;
    // As large, or twice as large; and finer than what they are made of.
    for exponent in [4, 6, 3] {
        let coarse = BakedPatch { reach: 40.0, ..patch };
        const NO_SOURCE: Option<&mut Located<Floors>> = None;
        let streams = baker
            .bake_coarser(&coarse, std::iter::once(&fine), NO_SOURCE, Coarse::even(exponent))
            .expect("it has an image")
            .streams;
        let map = Map::decode(&streams[0], &positions, &TRIANGLES, MAX_TEXELS).expect("sound");
        let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
        for (triangle, corners) in TRIANGLES.iter().enumerate() {
            let [a, b, c] = corners.map(point);
            let wanted = f64::from(srgb_byte(light(triangle)));
            for weights in (1..20).flat_map(|i| (1..20 - i).map(move |j| [i, j].map(|x| f64::from(x) / 20.0))) {
                let point = a + (b - a) * weights[0] + (c - a) * weights[1];
                let shown = image.interpolated(map.piece(triangle).unbounded(point.to_array()))[0];
                assert!((shown - wanted).abs() < 3.0, "{shown} {wanted} {exponent}");
            }
        }
    }
}

#[test]
fn what_lies_beyond_the_border_of_a_piece_is_not_seen_in_the_piece_beside_it() {
    // A floor that ends earlier in the coarse patch, and a wall, which lies beside it in the image.
    let corners = |end: i64| {
        let wall = [[300, 0, 0], [300, 64, 0], [300, 64, 64], [300, 0, 64]];
        let floor = [[0, 0, 0], [end, 0, 0], [end, end, 0], [0, end, 0]];
        std::array::from_fn::<LatticePoint, 8, _>(|k| if k < 4 { floor[k] } else { wall[k - 4] })
    };
    let (fine, coarse) = (corners(128), corners(64));
    let point = |vertex: u32| DVec3::from(fine[vertex as usize].map(|x| x as f64));
    let mut source = Located::new(Floors(TRIANGLES.iter().map(|corners| corners.map(point)).collect()));
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let mut baker = Baker::new(&storage);
    let patch =
        BakedPatch { positions: &fine, triangles: &TRIANGLES, reach: 0.0, areas: None, finer: 0, is_sharp: false };
    let surfels = baker.bake(&patch, &mut source, 2).expect("it has an image").surfels;
    const NO_SOURCE: Option<&mut Located<Floors>> = None;
    let patch = BakedPatch { positions: &coarse, reach: 64.0, ..patch };
    let streams = baker
        .bake_coarser(&patch, std::iter::once(&surfels), NO_SOURCE, Coarse::even(4))
        .expect("it has an image")
        .streams;
    let map = Map::decode(&streams[0], &coarse, &TRIANGLES, MAX_TEXELS).expect("sound");
    let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
    for (y, z) in (4..61).step_by(4).flat_map(|y| (4..61).step_by(4).map(move |z| (y, z))) {
        let triangle = if y > z { 2 } else { 3 };
        let place = map.piece(triangle).unbounded([300.0, f64::from(y), f64::from(z)]);
        let (shown, wanted) = (image.interpolated(place)[0], f64::from(srgb_byte(light(triangle))));
        assert!((shown - wanted).abs() < 3.0, "{shown} {wanted} at {y} {z}");
    }
}

#[test]
fn blocks_of_a_run_have_each_point_once_and_lie_around_them() {
    let positions = [[0, 0, 0], [80, 0, 40], [0, 80, 10]];
    let patch = BakedPatch {
        positions: &positions,
        triangles: &[[0, 1, 2]],
        reach: 1.0,
        areas: None,
        finer: 0,
        is_sharp: false,
    };
    let point = |k: usize| DVec3::from(positions[k].map(|x| x as f64));
    let mut source = Located::new(Floors(vec![[point(0), point(1), point(2)]]));
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let surfels = Baker::new(&storage).bake(&patch, &mut source, 2).expect("it has an image").surfels;
    assert!(surfels.runs.len() > 4, "{}", surfels.runs.len());
    for fineness in [1, 2] {
        let mut found = vec![0; surfels.count()];
        for run in &surfels.runs {
            let points = Lattice::new(&surfels, run, DVec3::ZERO, fineness);
            let mut open = vec![points.whole()];
            while let Some(block) = open.pop() {
                let mut places = vec![];
                points.for_each(&block, |some| {
                    let at = |k: usize| points.place(some.at.map(|at| f64::from(at[k])));
                    places.extend((0..some.count).map(|k| (some.numbers[k] as usize, at(k))));
                });
                let (count, around) = points.bounds(&block);
                assert!(places.len() <= count);
                if places.is_empty() {
                    continue;
                }
                let middle = around.iter().sum::<DVec3>() / 8.0;
                let radius = around.iter().map(|corner| corner.distance(middle)).fold(0.0, f64::max);
                assert!(places.iter().all(|(_, place)| place.distance(middle) <= radius + 1e-3));
                match count {
                    1..=4 => places.iter().for_each(|&(number, _)| found[number] += 1),
                    _ => open.extend(points.halves(block)),
                }
            }
        }
        assert!(found.iter().all(|&times| times == fineness * fineness), "{fineness} {found:?}");
    }
}
