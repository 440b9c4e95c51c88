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

pub(super) const NO_SOURCE: Option<&mut Located<Sphere>> = None;

/// A sphere in lattice units, whose colour is a smooth function of the place.
pub(super) fn sphere(rings: u32, radius: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
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

pub(super) struct Sphere {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

pub(super) fn colour(point: DVec3) -> [f32; 3] {
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
    let [map, colours @ .., heights] = &baked.streams[..] else { panic!("a map, colours and heights") };
    let map = Map::decode(map, &positions, &triangles, MAX_TEXELS).unwrap();
    let image = Image::decode_scaled(colours, map.size, 3).unwrap();
    let heights = Image::decode_values(heights, map.size, 1).unwrap();
    assert!(map.pieces.len() < 20, "{} pieces", map.pieces.len());
    let lengths = [baked.streams[0].len(), colours.concat().len(), baked.streams[5].len()];
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
    for (number, (corners, beside)) in triangles.iter().zip(triangles::neighbours(&triangles)).enumerate() {
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
            Image::decode_scaled(&baked.streams[1..5], map.size, 4).unwrap();
        }
    }
}

/// Triangles with a number each.
pub(super) struct Numbered(pub Vec<([[f64; 3]; 3], f32)>);

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

pub(super) fn numbers() -> Storage {
    Storage::new(vec![Stored::Scalar { low: 0.0, step: 1.0 }])
}

/// The numbers with which a reader interpolates in each triangle: the smallest and the largest.
pub(super) fn numbers_shown(positions: &[LatticePoint], triangles: &[[u32; 3]], baked: &Baked) -> Vec<[u16; 2]> {
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
pub(super) const RIDGE: ([LatticePoint; 4], [[u32; 3]; 2]) =
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
        let image = Image::decode_scaled(&streams[1..5], map.size, 3).unwrap();
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
