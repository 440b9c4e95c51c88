//! What texels show of small surfaces, where little is known, far away and at edges.

use super::tests::*;
use super::*;
use crate::areas::Jumps;
use lodpack::decode::texels::{Image, Map};
use lodpack_mesh::srgb::srgb_byte;

#[test]
fn where_nothing_was_measured_texels_have_the_number_beside_it() {
    // Four strips of a square, the third without a number; and colours all over.
    let positions: [LatticePoint; 4] = [[0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]];
    let triangles = [[0, 1, 2], [0, 2, 3]];
    let strip = |k: u32| {
        let [left, right] = [k, k + 1].map(|x| f64::from(x) * 25.0);
        let [a, b, c, d] = [[left, 0.0, 0.0], [right, 0.0, 0.0], [right, 100.0, 0.0], [left, 100.0, 0.0]];
        [([a, b, c], k), ([a, c, d], k)]
    };
    let numbers = [10.0, 20.0, f32::NAN, 40.0];
    struct Strips(Vec<([[f64; 3]; 3], f32)>);
    impl Source for Strips {
        fn triangle_count(&self) -> usize {
            self.0.len()
        }
        fn corners(&self, triangle: usize) -> [DVec3; 3] {
            self.0[triangle].0.map(DVec3::from)
        }
        fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
            let number = self.0[triangle].1;
            points
                .iter()
                .flat_map(|points| points.weights())
                .for_each(|_| values.extend([0.5, 0.5, 0.5, number, number]));
        }
    }
    let mut source = Strips((0..4).flat_map(strip).map(|(corners, k)| (corners, numbers[k as usize])).collect());
    let channels = vec![
        Stored::Colour { components: 3, step: 1 },
        Stored::Scalar { low: 0.0, step: 1.0 },
        Stored::Label { low: 0.0 },
    ];
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 1.0, areas: None, finer: 0, is_sharp: false };
    let baked = bake(&mut Baker::new(&Storage::new(channels)), &patch, &mut source, 4).unwrap();
    let map = Map::decode(&baked.streams[0], &positions, &triangles, MAX_TEXELS).unwrap();
    let [scalars, labels] = [5, 6].map(|k| Image::decode_values(&baked.streams[k], map.size, 1).unwrap());
    for x in 1..100 {
        let [x, y] = map.piece(0).unbounded([f64::from(x), 50.0, 0.0]).map(|x| x as u32);
        let (scalar, label) = (scalars.texel(x, y)[0], labels.texel(x, y)[0]);
        assert!((10..=40).contains(&scalar), "{scalar} at {x}");
        assert!([10, 20, 40].contains(&label), "{label} at {x}");
    }
}

#[test]
fn points_of_the_source_are_shown_where_the_patch_is_closest_to_them() {
    // Two slopes in one piece. Strips of the source, with a number each, lie above one of them, along its normal.
    let positions = [[0, 0, 58], [0, 60, 58], [-100, 0, 0], [-100, 60, 0], [100, 0, 0], [100, 60, 0]];
    let triangles = [[0, 1, 2], [1, 3, 2], [1, 0, 4], [1, 4, 5]];
    let above = DVec3::new(58.0, 0.0, 100.0).normalize() * 2.4;
    let strips = (0..10).flat_map(|strip| {
        let [left, right] = [strip, strip + 1].map(|x| f64::from(x) * 10.0);
        let point = |x: f64, y: f64| (DVec3::new(x, y, 58.0 - 0.58 * x) + above).to_array();
        let [a, b, c, d] = [point(left, 0.0), point(right, 0.0), point(right, 60.0), point(left, 60.0)];
        [[a, b, c], [a, c, d]].map(|corners| (corners, (strip + 1) as f32))
    });
    let mut source = Numbered(strips.collect());
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 5.0, areas: None, finer: 0, is_sharp: false };
    let baked = bake(&mut Baker::new(&numbers()), &patch, &mut source, 0).unwrap();
    let map = Map::decode(&baked.streams[0], &positions, &triangles, MAX_TEXELS).unwrap();
    let image = Image::decode_values(&baked.streams[1], map.size, 1).unwrap();
    for (border, y) in (1..10_u16).flat_map(|border| (5..55).map(move |y| (border, y))) {
        for (beside, number) in [(-0.9, border), (0.9, border + 1)] {
            let x = f64::from(border) * 10.0 + beside;
            let place = map.piece(2).unbounded([x, f64::from(y), 58.0 - 0.58 * x]).map(|x| x as u32);
            assert_eq!(image.texel(place[0], place[1])[0], number, "at {x}, {y}");
        }
    }
}

#[test]
fn a_texel_has_the_label_of_most_of_it_and_none_between() {
    // A plane whose left three quarters are of class 3, the others of class 900; texels of 2 lie across the border
    // at 151.
    let class = |x: f64| if x < 151.0 { 3.0 } else { 900.0 };
    let quad = |[left, right]: [f64; 2]| {
        let [a, b, c, d] = [[left, 0.0, 0.0], [right, 0.0, 0.0], [right, 100.0, 0.0], [left, 100.0, 0.0]];
        [[a, b, c], [a, c, d]].map(|corners| (corners, class(0.5 * (left + right)) as f32))
    };
    // Strips of 3, but that the border divides one.
    let mut bounds: Vec<f64> = (0..=67).map(|x| f64::from(x) * 3.0).chain([151.0]).collect();
    bounds.sort_by(f64::total_cmp);
    let source = bounds.windows(2).flat_map(|pair| quad([pair[0], pair[1]])).collect();
    let positions = [[0, 0, 0], [201, 0, 0], [201, 100, 0], [0, 100, 0]];
    let triangles = [[0, 1, 2], [0, 2, 3]];
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 1.0, areas: None, finer: 0, is_sharp: false };
    let storage = Storage::new(vec![Stored::Label { low: 3.0 }]);
    let fine = bake(&mut Baker::new(&storage), &patch, &mut Numbered(source), 2).unwrap();
    let coarse =
        Baker::new(&storage).bake_coarser(&patch, std::iter::once(&fine.surfels), NO_SOURCE, Coarse::even(7)).unwrap();
    for (baked, size) in [(&fine, 2.0), (&coarse, 11.4)] {
        let map = Map::decode(&baked.streams[0], &positions, &triangles, MAX_TEXELS).unwrap();
        let image = Image::decode_values(&baked.streams[1], map.size, 1).unwrap();
        for x in 0..=200 {
            let place = map.piece(0).unbounded([f64::from(x), 50.0, 0.0]).map(|x| x as u32);
            let label = f64::from(image.texel(place[0], place[1])[0]) + 3.0;
            let x = f64::from(x);
            assert!(label == class(x) || (x - 151.0).abs() <= size && [3.0, 900.0].contains(&label), "{label} at {x}");
        }
    }
}

/// A source whose triangles have areas.
struct Coloured(Numbered, Vec<u32>);

impl Source for Coloured {
    fn triangle_count(&self) -> usize {
        self.0.triangle_count()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.0.corners(triangle)
    }

    fn area(&self, triangle: usize) -> u32 {
        self.1[triangle]
    }

    fn shade(&mut self, triangle: usize, points: &[Points], footprint: f32, values: &mut Vec<f32>) {
        self.0.shade(triangle, points, footprint, values);
    }
}

#[test]
fn nothing_is_blurred_over_a_line_at_which_colours_jump() {
    // A plane, half of which is 100 and half 900, but that the line of the source lies a third of a texel beside that
    // of the patch.
    let at = |x: f64| [[x, 0.0, 0.0], [x, 200.0, 0.0]];
    let quad = |left: f64, right: f64, number: f32| {
        let ([a, d], [b, c]) = (at(left), at(right));
        [([a, b, c], number), ([a, c, d], number)]
    };
    let line = 102.7;
    let mut source = Coloured(Numbered([quad(0.0, line, 100.0), quad(line, 200.0, 900.0)].concat()), vec![1, 1, 2, 2]);
    let positions = [[0, 0, 0], [100, 0, 0], [200, 0, 0], [0, 200, 0], [100, 200, 0], [200, 200, 0]];
    let triangles = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]];
    let jumps = Jumps::new(vec![[1, 2]]);
    let areas = Areas::of(&[1, 1, 2, 2], Some(&jumps));
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 5.0, areas, finer: 0, is_sharp: false };
    let fine = bake(&mut Baker::new(&numbers()), &patch, &mut source, 6).unwrap();
    let coarse = Baker::new(&numbers())
        .bake_coarser(&patch, std::iter::once(&fine.surfels), NO_SOURCE, Coarse::even(8))
        .unwrap();
    for baked in [fine, coarse] {
        let map = Map::decode(&baked.streams[0], &positions, &triangles, MAX_TEXELS).unwrap();
        let image = Image::decode_values(&baked.streams[1], map.size, 1).unwrap();
        assert_eq!(map.pieces.len(), 2);
        for (triangle, number) in [(0, 100.0), (1, 100.0), (2, 900.0), (3, 900.0)] {
            for point in triangles[triangle].map(|v| positions[v as usize].map(|x| x as f64)) {
                assert_eq!(image.interpolated(map.piece(triangle).unbounded(point))[0], number, "{triangle} {point:?}");
            }
        }
    }
}

#[test]
fn texels_show_what_lies_closest_however_far_it_is() {
    /// A roof that lies 24 beyond another one, brighter away from its ridge.
    struct Roof(Vec<[DVec3; 3]>);
    impl Source for Roof {
        fn triangle_count(&self) -> usize {
            self.0.len()
        }
        fn corners(&self, triangle: usize) -> [DVec3; 3] {
            self.0[triangle]
        }
        fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
            for weights in points.iter().flat_map(|points| points.weights()) {
                let point: DVec3 = (0..3).map(|k| self.0[triangle][k] * f64::from(weights[k])).sum();
                values.extend([(point.y.abs() / 130.0) as f32, 0.5, 0.5]);
            }
        }
    }
    // Slopes of 5 to 12 on both sides of the x axis, which one piece shows.
    let positions = [[0, -96, -40], [100, -96, -40], [0, 0, 0], [100, 0, 0], [0, 96, -40], [100, 96, -40]];
    let triangles = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]];
    let normal = |side: f64| DVec3::new(0.0, 5.0 * side, 12.0) / 13.0;
    let below = |side: f64, [x, down]: [f64; 2]| DVec3::new(x, 12.0 / 13.0 * side * down, -5.0 / 13.0 * down);
    let above = |side: f64, at: [f64; 2]| below(side, at) + normal(side) * 24.0;
    let slope = |side: f64| {
        let [a, b, c, d] = [[0.0, 0.0], [100.0, 0.0], [0.0, 104.0], [100.0, 104.0]].map(|at| above(side, at));
        if side < 0.0 { [[c, d, a], [a, d, b]] } else { [[a, b, c], [c, b, d]] }
    };
    let mut source = Roof([slope(-1.0), slope(1.0)].concat());
    let patch = BakedPatch {
        positions: &positions,
        triangles: &triangles,
        reach: 24.0,
        areas: None,
        finer: 0,
        is_sharp: false,
    };
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let mut baker = Baker::new(&storage);
    let mut error = |is_closest: bool| {
        let baked = match is_closest {
            true => baker.bake_cut(&patch, &mut Located::new(&mut source), 2, 0),
            false => bake(&mut baker, &patch, &mut source, 2),
        };
        let streams = baked.expect("it has an image").streams;
        let map = Map::decode(&streams[0], &positions, &triangles, MAX_TEXELS).expect("sound");
        let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
        let mut largest = 0.0_f64;
        for (triangle, side) in [(0, -1.0), (3, 1.0)] {
            for down in [40.0, 60.0, 80.0, 95.0] {
                let shown = below(side, [if side < 0.0 { 40.0 } else { 60.0 }, down]);
                let wanted = (shown + normal(side) * 24.0).y.abs() / 130.0;
                let found = image.interpolated(map.piece(triangle).unbounded(shown.to_array()))[0];
                largest = largest.max((found - f64::from(srgb_byte(wanted as f32))).abs());
            }
        }
        largest
    };
    let errors = [error(false), error(true)];
    assert!(errors[1] < 4.0 && errors[0] > 2.0 * errors[1], "{errors:?}");
}

#[test]
fn the_far_side_of_a_sheet_counts_a_little() {
    /// Both sides of a square: white above, and black below.
    struct Sheet;
    impl Source for Sheet {
        fn triangle_count(&self) -> usize {
            4
        }
        fn corners(&self, triangle: usize) -> [DVec3; 3] {
            let [a, b, c, d] = [[0.0, 0.0], [64.0, 0.0], [64.0, 64.0], [0.0, 64.0]].map(|[x, y]| DVec3::new(x, y, 4.0));
            let low = DVec3::new(0.0, 0.0, -6.0);
            [[a, b, c], [a, c, d], [a + low, c + low, b + low], [a + low, d + low, c + low]][triangle]
        }
        fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
            let white = if triangle < 2 { 1.0 } else { 0.0 };
            points.iter().flat_map(|points| points.weights()).for_each(|_| values.extend([white; 3]));
        }
    }
    let positions = [[0, 0, 0], [64, 0, 0], [64, 64, 0], [0, 64, 0]];
    let triangles = [[0, 1, 2], [0, 2, 3]];
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 6.0, areas: None, finer: 0, is_sharp: false };
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let streams =
        Baker::new(&storage).bake_cut(&patch, &mut Located::new(Sheet), 2, 0).expect("it has an image").streams;
    let map = Map::decode(&streams[0], &positions, &triangles, MAX_TEXELS).expect("sound");
    let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
    let shown = image.interpolated(map.piece(0).unbounded([40.0, 24.0, 0.0]))[0];
    let wanted = f64::from(srgb_byte(1.0 / (1.3 * 1.3)));
    assert!((shown - wanted).abs() < 3.0, "{shown} {wanted}");
}

/// Squares of one grey each, which faces up or down.
struct Squares(Vec<(DVec3, f64, f32, bool)>);

impl Squares {
    fn add(&mut self, [x, y, z]: [f64; 3], side: f64, light: f32, is_up: bool) {
        self.0.push((DVec3::new(x, y, z), side, light, is_up));
    }
}

impl Source for Squares {
    fn triangle_count(&self) -> usize {
        2 * self.0.len()
    }
    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        let (at, side, _, is_up) = self.0[triangle / 2];
        let [b, c, d] = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| at + DVec3::new(x, y, 0.0) * side);
        let [one, other] = [[b, c], [c, d]][triangle % 2];
        if is_up { [at, one, other] } else { [at, other, one] }
    }
    fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
        let (_, _, light, _) = self.0[triangle / 2];
        points.iter().flat_map(|points| points.weights()).for_each(|_| values.extend([light; 3]));
    }
}

/// What a cut with this source shows at points of triangles.
fn shown_of_cut(
    positions: &[[i64; 3]],
    triangles: &[[u32; 3]],
    source: &mut Squares,
    at: &[(usize, [f64; 3])],
) -> Vec<f64> {
    let patch = BakedPatch { positions, triangles, reach: 6.0, areas: None, finer: 0, is_sharp: false };
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let streams =
        Baker::new(&storage).bake_cut(&patch, &mut Located::new(source), 2, 0).expect("it has an image").streams;
    let map = Map::decode(&streams[0], positions, triangles, MAX_TEXELS).expect("sound");
    let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
    at.iter().map(|&(triangle, point)| image.interpolated(map.piece(triangle).unbounded(point))[0]).collect()
}

#[test]
fn what_is_closest_to_nothing_but_a_far_side_is_shown_there() {
    // A black square on the upper sheet, and a white one below the lower sheet, which faces down.
    let mut source = Squares(vec![]);
    source.add([0.0, 0.0, 5.0], 64.0, 0.0, true);
    source.add([0.0, 0.0, -2.0], 64.0, 1.0, false);
    let sheet = |z: i64| [[0, 0, z], [64, 0, z], [64, 64, z], [0, 64, z]];
    let positions = [sheet(0), sheet(5)].concat();
    let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let at = [(0, [40.0, 24.0, 0.0]), (2, [40.0, 24.0, 5.0])];
    let shown = shown_of_cut(&positions, &triangles, &mut source, &at);
    assert!(shown[0] > 250.0 && shown[1] < 5.0, "{shown:?}");
}

#[test]
fn what_lies_beyond_an_edge_is_shown_at_it_on_all_sides() {
    // Black squares around a white one, which alone is left of them.
    let mut source = Squares(vec![]);
    for (x, y) in (-1..2).flat_map(|x| (-1..2).map(move |y| (x, y))) {
        let light = if (x, y) == (0, 0) { 1.0 } else { 0.0 };
        source.add([f64::from(64 * x), f64::from(64 * y), 0.0], 64.0, light, true);
    }
    let positions = [[0, 0, 0], [64, 0, 0], [64, 64, 0], [0, 64, 0]];
    let edges = [(0, [32.0, 0.0, 0.0]), (0, [64.0, 32.0, 0.0]), (1, [32.0, 64.0, 0.0]), (1, [0.0, 32.0, 0.0])];
    let shown = shown_of_cut(&positions, &[[0, 1, 2], [0, 2, 3]], &mut source, &edges);
    assert!(shown.iter().all(|&shown| shown < 200.0), "{shown:?}");
}
