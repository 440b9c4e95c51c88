use super::*;
use crate::areas::Jumps;
use lodpack::decode::texels::{Image, Map};
use lodpack_mesh::srgb::srgb_byte;

impl<S: Source> Source for &mut S {
    fn triangle_count(&self) -> usize {
        (**self).triangle_count()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        (**self).corners(triangle)
    }

    fn area(&self, triangle: usize) -> u32 {
        (**self).area(triangle)
    }

    fn areas_beyond(&self) -> Vec<u32> {
        (**self).areas_beyond()
    }

    fn ends_along(&self, start: LatticePoint) -> bool {
        (**self).ends_along(start)
    }

    fn has_sizes(&self) -> bool {
        (**self).has_sizes()
    }

    fn larger(&self, triangle: usize) -> u8 {
        (**self).larger(triangle)
    }

    fn has_long(&self) -> bool {
        (**self).has_long()
    }

    fn growth(&self, triangle: usize) -> Option<[DVec3; 2]> {
        (**self).growth(triangle)
    }

    fn shade(&mut self, triangle: usize, points: &[Points], footprint: f32, values: &mut Vec<f32>) {
        (**self).shade(triangle, points, footprint, values);
    }
}

pub(super) fn bake(
    baker: &mut Baker<'_>,
    patch: &BakedPatch<'_>,
    source: &mut impl Source,
    exponent: u32,
) -> Option<Baked> {
    baker.bake(patch, &mut Located::new(source), exponent)
}

const NO_SOURCE: Option<&mut Located<Sphere>> = None;

/// A sphere in lattice units, whose colour is a smooth function of the place.
fn sphere(rings: u32, radius: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (vec![], vec![]);
    for ring in 0..=rings {
        for step in 0..2 * rings {
            let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            let around = std::f64::consts::PI * f64::from(step) / f64::from(rings);
            positions.push(DVec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos()) * radius);
        }
    }
    for ring in 0..rings {
        for step in 0..2 * rings {
            let next = (step + 1) % (2 * rings);
            let [a, b] = [ring * 2 * rings + step, ring * 2 * rings + next];
            let [c, d] = [a + 2 * rings, b + 2 * rings];
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    (positions, triangles)
}

struct Sphere {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

fn colour(point: DVec3) -> [f32; 3] {
    let n = point.normalize_or_zero();
    [n.x, n.y, (n.z * 5.0).sin()].map(|x| (0.5 + 0.5 * x) as f32)
}

impl Source for Sphere {
    fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
        let corners = self.corners(triangle);
        for weights in points.iter().flat_map(|points| points.weights()) {
            let point: DVec3 = (0..3).map(|k| corners[k] * f64::from(weights[k])).sum();
            values.extend(colour(point));
            values.push(point.z as f32);
        }
    }
}

#[test]
fn a_coarse_sphere_shows_the_colours_of_a_fine_one() {
    let (positions, triangles) = sphere(60, 1000.0);
    let mut source = Sphere { positions, triangles };
    let (coarse, triangles) = sphere(8, 1000.0);
    let positions: Vec<LatticePoint> = coarse.iter().map(|p| p.to_array().map(|x| x.round() as i64)).collect();
    // Triangles at the poles have no area.
    let patch = BakedPatch {
        positions: &positions,
        triangles: &triangles,
        reach: 80.0,
        areas: None,
        finer: 0,
        is_sharp: false,
    };
    let storage =
        Storage::new(vec![Stored::Colour { components: 3, step: 4 }, Stored::Scalar { low: -1000.0, step: 0.5 }]);
    let baked = bake(&mut Baker::new(&storage), &patch, &mut source, 8).unwrap();
    let [map, colours, heights] = &baked.streams[..] else { panic!("a map, colours and heights") };
    let map = Map::decode(map, &positions, &triangles, MAX_TEXELS).unwrap();
    let image = Image::decode_colours(colours, map.size, 3).unwrap();
    let heights = Image::decode_values(heights, map.size, 1).unwrap();
    assert!(map.pieces.len() < 20, "{} pieces", map.pieces.len());
    let lengths: Vec<usize> = baked.streams.iter().map(Vec::len).collect();
    assert!(lengths.iter().zip([150, 12_000, 18_000]).all(|(&length, most)| length < most), "{lengths:?}");
    let (mut squares, mut count) = (0.0, 0);
    for (number, corners) in triangles.iter().enumerate() {
        let points = corners.map(|v| DVec3::from(positions[v as usize].map(|x| x as f64)));
        if (points[1] - points[0]).cross(points[2] - points[0]).length() < 1.0 {
            continue;
        }
        for weights in [[1.0, 0.0, 0.0], [0.2, 0.5, 0.3], [0.0, 0.5, 0.5], [0.4, 0.3, 0.3]] {
            let point: DVec3 = (0..3).map(|k| points[k] * weights[k]).sum();
            let shown = image.interpolated(map.piece(number).unbounded(point.to_array()));
            let wanted = colour(point);
            let [x, y] = map.piece(number).unbounded(point.to_array()).map(|x| x as u32);
            let height = f64::from(heights.texel(x, y)[0]) * 0.5 - 1000.0;
            assert!((height - point.z).abs() < 90.0, "{height} {}", point.z);
            for k in 0..3 {
                let difference = shown[k] - f64::from(srgb_byte(wanted[k]));
                squares += difference * difference;
                count += 1;
            }
        }
    }
    let error = (squares / f64::from(count)).sqrt();
    assert!(error < 2.0, "{error}");

    // Pieces show the same where they meet.
    let mut apart = vec![];
    for (number, (corners, beside)) in triangles.iter().zip(pieces::neighbours(&triangles)).enumerate() {
        for (edge, &other) in beside.iter().enumerate().filter(|(_, other)| **other != NONE) {
            if map.labels[number] == map.labels[other as usize] {
                continue;
            }
            let [a, b] = [edge, (edge + 1) % 3].map(|k| DVec3::from(positions[corners[k] as usize].map(|x| x as f64)));
            for point in [0.2, 0.5, 0.8].map(|share| a.lerp(b, share).to_array()) {
                let shown = [number, other as usize].map(|t| image.interpolated(map.piece(t).unbounded(point)));
                apart.push((0..3).map(|k| (shown[0][k] - shown[1][k]).abs()).fold(0.0, f64::max));
            }
        }
    }
    apart.sort_by(f64::total_cmp);
    let quantile = |share: f64| apart[(apart.len() as f64 * share) as usize];
    assert!(quantile(0.5) < 1.5 && quantile(0.95) < 4.0, "{} {}", quantile(0.5), quantile(0.95));
}

#[test]
fn patches_without_area_and_without_a_source_have_an_image_or_none() {
    struct Nothing;
    impl Source for Nothing {
        fn triangle_count(&self) -> usize {
            0
        }
        fn corners(&self, _: usize) -> [DVec3; 3] {
            [DVec3::ZERO; 3]
        }
        fn shade(&mut self, _: usize, _: &[Points], _: f32, _: &mut Vec<f32>) {}
    }
    let storage = Storage::new(vec![Stored::Colour { components: 4, step: 4 }]);
    for positions in [[[0, 0, 0]; 3], [[0, 0, 0], [5, 0, 0], [9, 0, 0]], [[0, 0, 0], [1 << 40, 0, 0], [0, 1 << 40, 0]]]
    {
        let patch = BakedPatch {
            positions: &positions,
            triangles: &[[0, 1, 2]],
            reach: 1.0,
            areas: None,
            finer: 0,
            is_sharp: false,
        };
        if let Some(baked) = bake(&mut Baker::new(&storage), &patch, &mut Nothing, 0) {
            let map = Map::decode(&baked.streams[0], &positions, &[[0, 1, 2]], MAX_TEXELS).unwrap();
            Image::decode_colours(&baked.streams[1], map.size, 4).unwrap();
        }
    }
}

/// Triangles with a number each.
struct Numbered(Vec<([[f64; 3]; 3], f32)>);

impl Source for Numbered {
    fn triangle_count(&self) -> usize {
        self.0.len()
    }
    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.0[triangle].0.map(DVec3::from)
    }
    fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
        values.extend(points.iter().flat_map(|points| points.weights()).map(|_| self.0[triangle].1));
    }
}

fn numbers() -> Storage {
    Storage::new(vec![Stored::Scalar { low: 0.0, step: 1.0 }])
}

/// The numbers with which a reader interpolates in each triangle: the smallest and the largest.
fn numbers_shown(positions: &[LatticePoint], triangles: &[[u32; 3]], baked: &Baked) -> Vec<[u16; 2]> {
    let map = Map::decode(&baked.streams[0], positions, triangles, MAX_TEXELS).unwrap();
    let image = Image::decode_values(&baked.streams[1], map.size, 1).unwrap();
    let shown = triangles.iter().enumerate().map(|(number, corners)| {
        let points = corners.map(|v| DVec3::from(positions[v as usize].map(|x| x as f64)));
        let mut range = [u16::MAX, 0];
        for (i, j) in (0..=40).flat_map(|i| (0..=40 - i).map(move |j| (i, j))) {
            let [b, c] = [i, j].map(|x| f64::from(x) / 40.0);
            let point = points[0] * (1.0 - b - c) + points[1] * b + points[2] * c;
            let place = map.piece(number).unbounded(point.to_array());
            for corner in [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]] {
                let [x, y] = [0, 1].map(|k| (place[k] + corner[k]) as u32);
                let number = image.texel(x, y)[0];
                range = [range[0].min(number), range[1].max(number)];
            }
        }
        range
    });
    shown.collect()
}

/// A ridge, whose sides are pieces of their own.
const RIDGE: ([LatticePoint; 4], [[u32; 3]; 2]) =
    ([[0, 0, 80], [0, 100, 80], [-60, 50, 0], [60, 50, 0]], [[0, 1, 2], [1, 0, 3]]);

#[test]
fn a_piece_shows_nothing_of_the_piece_that_lies_beside_it_in_the_image() {
    let (positions, triangles) = RIDGE;
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 5.0, areas: None, finer: 0, is_sharp: false };
    let scaled = |side: usize, factor: f64| {
        let corners = triangles[side].map(|v| DVec3::from(positions[v as usize].map(|x| x as f64)));
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        corners.map(|corner| (middle + (corner - middle) * factor).to_array())
    };
    // One side is known as far as it goes, the other one beyond its borders.
    for [left, right] in [[1.0, 1.5], [1.5, 1.0]] {
        let mut source = Numbered(vec![(scaled(0, left), 100.0), (scaled(1, right), 900.0)]);
        let baked = bake(&mut Baker::new(&numbers()), &patch, &mut source, 4).unwrap();
        assert_eq!(numbers_shown(&positions, &triangles, &baked), [[100; 2], [900; 2]]);
    }
}

#[test]
fn both_sides_of_a_border_show_the_mean_where_no_source_is_at_hand_unless_colours_jump() {
    /// Brighter by the distance from the ridge on the right, and darker on the left.
    struct Slopes;
    impl Source for Slopes {
        fn triangle_count(&self) -> usize {
            2
        }
        fn corners(&self, triangle: usize) -> [DVec3; 3] {
            RIDGE.1[triangle].map(|v| DVec3::from(RIDGE.0[v as usize].map(|x| x as f64)))
        }
        fn area(&self, triangle: usize) -> u32 {
            triangle as u32
        }
        fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
            let corners = self.corners(triangle);
            for weights in points.iter().flat_map(|points| points.weights()) {
                let x: f64 = (0..3).map(|k| corners[k].x * f64::from(weights[k])).sum();
                values.extend([(0.4 + x / 150.0) as f32; 3]);
            }
        }
    }
    let (positions, triangles) = RIDGE;
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let apart = |jumps: &Jumps| {
        let areas = Some(Areas { of_triangles: &[0, 1], jumps });
        let patch =
            BakedPatch { positions: &positions, triangles: &triangles, reach: 1.0, areas, finer: 0, is_sharp: false };
        let fine = bake(&mut Baker::new(&storage), &patch, &mut Slopes, 2).unwrap();
        let finer = std::iter::once(&fine.surfels);
        let streams = Baker::new(&storage).bake_coarser(&patch, finer, NO_SOURCE, Coarse::even(6)).unwrap().streams;
        let map = Map::decode(&streams[0], &positions, &triangles, MAX_TEXELS).unwrap();
        let image = Image::decode_colours(&streams[1], map.size, 3).unwrap();
        let shown = |side: usize, y: f64| image.interpolated(map.piece(side).unbounded([0.0, y, 80.0]))[0];
        (10..90).map(|y| (shown(0, f64::from(y)) - shown(1, f64::from(y))).abs()).fold(0.0, f64::max)
    };
    let [alike, jumping] = [apart(&Jumps::default()), apart(&Jumps::new(vec![[0, 1]]))];
    assert!(alike < 2.0 && jumping > 4.0, "{alike} {jumping}");
}

#[test]
fn a_piece_of_which_nothing_is_known_shows_what_lies_beside_it_on_the_surface() {
    let (positions, triangles) = RIDGE;
    for side in [0, 1] {
        let one = [triangles[side]];
        let corners = triangles[side].map(|v| positions[v as usize].map(|x| x as f64));
        let finer =
            BakedPatch { positions: &positions, triangles: &one, reach: 5.0, areas: None, finer: 0, is_sharp: false };
        let finer = bake(&mut Baker::new(&numbers()), &finer, &mut Numbered(vec![(corners, 700.0)]), 2).unwrap();
        let patch = BakedPatch {
            positions: &positions,
            triangles: &triangles,
            reach: 5.0,
            areas: None,
            finer: 0,
            is_sharp: false,
        };
        let baked = Baker::new(&numbers())
            .bake_coarser(&patch, std::iter::once(&finer.surfels), NO_SOURCE, Coarse::even(4))
            .unwrap();
        assert_eq!(numbers_shown(&positions, &triangles, &baked), [[700; 2]; 2]);
    }
}

#[test]
fn pieces_that_nothing_is_projected_to_show_what_is_closest_to_them() {
    // A square, a sliver that covers no texel's middle, and a triangle that faces the other way than its source.
    let positions: Vec<LatticePoint> =
        [[0, 0], [100, 0], [100, 100], [0, 100], [300, 0], [300, 60], [302, 30], [500, 0], [560, 0], [500, 60]]
            .map(|[x, y]| [x, y, 0])
            .into();
    let triangles = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [7, 9, 8]];
    let corners = |of: [u32; 3]| of.map(|v| positions[v as usize].map(|x| x as f64));
    let mut source: Vec<_> = triangles.map(corners).into_iter().zip([100.0, 100.0, 900.0, 500.0]).collect();
    source[3].0.swap(1, 2);
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 1.0, areas: None, finer: 0, is_sharp: false };
    let baked = bake(&mut Baker::new(&numbers()), &patch, &mut Numbered(source), 8).unwrap();
    assert_eq!(numbers_shown(&positions, &triangles, &baked), [[100; 2], [100; 2], [900; 2], [500; 2]]);
}

#[test]
fn a_piece_that_nothing_is_known_of_shows_what_the_patch_does_where_it_is_closest() {
    // Two squares, and one close above the second that shares no vertex with it, and that no point is closest to.
    let square = |x: i64, z: i64| [[x, 0, z], [x + 100, 0, z], [x + 100, 100, z], [x, 100, z]];
    let positions: Vec<LatticePoint> = [square(0, 0), square(400, 0), square(400, 10)].concat();
    let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [8, 9, 10], [8, 10, 11]];
    let corners = |of: [u32; 3]| of.map(|v| positions[v as usize].map(|x| x as f64));
    let of_triangles =
        |triangles| BakedPatch { positions: &positions, triangles, reach: 1.0, areas: None, finer: 0, is_sharp: false };
    let source = triangles.map(corners).into_iter().zip([100.0, 100.0, 900.0, 900.0]);
    let mut source = Numbered(source.collect());
    let fine = bake(&mut Baker::new(&numbers()), &of_triangles(&triangles[..4]), &mut source, 2).unwrap();
    let finer = std::iter::once(&fine.surfels);
    let baked =
        Baker::new(&numbers()).bake_coarser(&of_triangles(&triangles), finer, NO_SOURCE, Coarse::even(4)).unwrap();
    let shown = numbers_shown(&positions, &triangles, &baked);
    assert_eq!(shown, [[100; 2], [100; 2], [900; 2], [900; 2], [900; 2], [900; 2]]);
}

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
    let [scalars, labels] = [2, 3].map(|k| Image::decode_values(&baked.streams[k], map.size, 1).unwrap());
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
    // A plane whose left three quarters are of class 3, the others of class 900; texels of 2 lie across the border at 151.
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
    // A plane, half of which is 100 and half 900, but that the line of the source lies a third of a texel beside that of the patch.
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
        let image = Image::decode_colours(&streams[1], map.size, 3).expect("sound");
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
    let image = Image::decode_colours(&streams[1], map.size, 3).expect("sound");
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
    let image = Image::decode_colours(&streams[1], map.size, 3).expect("sound");
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
