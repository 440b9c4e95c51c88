use lodpack::decode::texels::{Image, Map};

use super::tests::bake;
use super::*;
use lodpack_mesh::srgb::srgb_byte;

/// A floor of squares with brightness along it, of which one has finer texels.
struct Label(Vec<[DVec3; 3]>);

/// The side of a square of the floor.
const SQUARE: i64 = 256;

impl Source for Label {
    fn triangle_count(&self) -> usize {
        self.0.len()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.0[triangle]
    }

    fn has_sizes(&self) -> bool {
        true
    }

    fn larger(&self, triangle: usize) -> u8 {
        if triangle / 2 == 4 { 0 } else { 6 }
    }

    fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
        let corners = self.corners(triangle);
        for weights in points.iter().flat_map(|points| points.weights()) {
            let x: f64 = (0..3).map(|k| corners[k].x * f64::from(weights[k])).sum();
            values.extend([0.2 + 0.6 * (x / (3 * SQUARE) as f64) as f32; 3]);
        }
    }
}

/// A floor of three by three squares.
fn floor() -> (Vec<LatticePoint>, Vec<[u32; 3]>) {
    let positions = (0..16).map(|k| [k % 4 * SQUARE, k / 4 * SQUARE, 0]).collect();
    let squares = (0..9).map(|k| k / 3 * 4 + k % 3);
    (positions, squares.flat_map(|a| [[a, a + 1, a + 4], [a + 1, a + 5, a + 4]]).collect())
}

/// The size of texels of each triangle, and how far brightness is off at most.
fn sizes_and_error(streams: &[Vec<u8>], positions: &[LatticePoint], triangles: &[[u32; 3]]) -> (Vec<f64>, f64) {
    let map = Map::decode(&streams[0], positions, triangles, MAX_TEXELS).expect("sound");
    let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
    let mut largest = 0.0_f64;
    for (number, corners) in triangles.iter().enumerate() {
        let piece = map.piece(number);
        let middle: DVec3 = corners.iter().map(|&corner| to_f64(positions[corner as usize])).sum::<DVec3>() / 3.0;
        let places = corners.iter().map(|&corner| to_f64(positions[corner as usize])).chain([middle]);
        for point in places {
            let wanted = srgb_byte(0.2 + 0.6 * (point.x / (3 * SQUARE) as f64) as f32);
            let shown = image.interpolated(piece.unbounded(point.to_array()))[0];
            largest = largest.max((shown - f64::from(wanted)).abs());
        }
    }
    ((0..triangles.len()).map(|number| map.piece(number).texel_size()).collect(), largest)
}

#[test]
fn a_label_keeps_finer_texels_at_all_levels() {
    let (positions, triangles) = floor();
    let corners = |corners: &[u32; 3]| corners.map(|corner| to_f64(positions[corner as usize]));
    let mut source = Label(triangles.iter().map(corners).collect());
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 0.0, areas: None, finer: 0, is_sharp: false };
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    let mut baker = Baker::new(&storage);
    let is_label = |number: usize| number / 2 == 4;
    let Baked { streams, surfels, .. } = bake(&mut baker, &patch, &mut source, 4).expect("it has an image");
    let (sizes, error) = sizes_and_error(&streams, &positions, &triangles);
    assert!(error < 3.0, "{error}");
    let [label, around] = [sizes[8], sizes[0]];
    assert!((around / label - 8.0).abs() < 1e-9, "{sizes:?}");
    assert!((0..18).all(|number| sizes[number] == if is_label(number) { label } else { around }), "{sizes:?}");
    // As many as there would be of one size.
    let texels = (SQUARE * SQUARE) as f64 * (1.0 / (label * label) + 8.0 / (around * around));
    let even = (9 * SQUARE * SQUARE) as f64 / 16.0;
    assert!((0.7..1.45).contains(&(texels / even)), "{texels} {even}");

    let coarse = Coarse { exponent: 6, texels: surfels.count() as f64 / 4.0 };
    const NO_LABEL: Option<&mut Located<Label>> = None;
    let baked = baker.bake_coarser(&patch, std::iter::once(&surfels), NO_LABEL, coarse).expect("it has an image");
    let (coarser, error) = sizes_and_error(&baked.streams, &positions, &triangles);
    assert!(error < 6.0, "{error}");
    assert!((0..18).all(|number| (coarser[number] / sizes[number] - 2.0).abs() < 1e-9), "{coarser:?}");

    let streams = baker.bake_cut(&patch, &mut Located::new(source), 4, 0).expect("it has an image").streams;
    let (sizes, error) = sizes_and_error(&streams, &positions, &triangles);
    assert!(error < 6.0, "{error}");
    assert_eq!([sizes[8], sizes[0]], [4.0, 32.0]);
}

/// A floor of squares with stripes, and how fast its image grows along both axes.
struct Stripes(Vec<[DVec3; 3]>, Option<[f64; 2]>);

/// From stripe to stripe.
const PERIOD: f64 = 24.0;

fn stripe(x: f64) -> f32 {
    (0.5 + 0.4 * (x / PERIOD * std::f64::consts::TAU).sin()) as f32
}

impl Source for Stripes {
    fn triangle_count(&self) -> usize {
        self.0.len()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.0[triangle]
    }

    fn has_long(&self) -> bool {
        self.1.is_some()
    }

    fn growth(&self, _: usize) -> Option<[DVec3; 2]> {
        self.1.map(|[x, y]| [DVec3::X * x, DVec3::Y * y])
    }

    fn shade(&mut self, triangle: usize, points: &[Points], _: f32, values: &mut Vec<f32>) {
        let corners = self.corners(triangle);
        for weights in points.iter().flat_map(|points| points.weights()) {
            let x: f64 = (0..3).map(|k| corners[k].x * f64::from(weights[k])).sum();
            values.extend([stripe(x); 3]);
        }
    }
}

#[test]
fn texels_are_long_where_images_are_stretched() {
    let (positions, triangles) = floor();
    let corners = |corners: &[u32; 3]| corners.map(|corner| to_f64(positions[corner as usize]));
    let corners: Vec<[DVec3; 3]> = triangles.iter().map(corners).collect();
    let patch =
        BakedPatch { positions: &positions, triangles: &triangles, reach: 0.0, areas: None, finer: 0, is_sharp: false };
    let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
    // Width and length of texels, how many there are, and how far brightness is off in the mean.
    let measured = |streams: &[Vec<u8>]| {
        let map = Map::decode(&streams[0], &positions, &triangles, MAX_TEXELS).expect("sound");
        let image = Image::decode_scaled(&streams[1..5], map.size, 3).expect("sound");
        let piece = &map.pieces[0];
        let ([length, width], [u, v, _]) = (piece.texel(), piece.frame());
        let across = if length < width { u } else { v };
        let points = (0..500).map(|k| DVec3::new(1.5 * f64::from(k) + 3.0, 1.4 * f64::from(k) + 5.0, 0.0));
        let off = |point: DVec3| {
            let shown = image.interpolated(piece.unbounded(point.to_array()))[0];
            (shown - f64::from(srgb_byte(stripe(point.x)))).abs()
        };
        let error = points.map(off).sum::<f64>() / 500.0;
        ([length.min(width), length.max(width)], across[0].abs(), map.size[0] * map.size[1], error)
    };
    let are_long = |[width, length]: [f64; 2], wanted: f64| {
        assert!((width / wanted - 1.0).abs() < 1e-9 && (length / width - 16.0).abs() < 1e-6, "{length} {width}");
    };
    let mut baker = Baker::new(&storage);
    let mut baked = |growth| {
        let mut source = Stripes(corners.clone(), growth);
        bake(&mut baker, &patch, &mut source, 8).expect("it has an image")
    };
    let (sides, _, even_count, even_error) = measured(&baked(None).streams);
    assert_eq!(sides, [16.0; 2]);
    let Baked { streams, surfels, .. } = baked(Some([8.0, 0.0]));
    let (sides, across, count, error) = measured(&streams);
    are_long(sides, 4.0);
    assert!(across > 0.9999, "{across}");
    assert!(count.abs_diff(even_count) < even_count / 5, "{count} {even_count}");
    // Six texels from stripe to stripe, between which colours are interpolated.
    assert!(error < 6.0 && even_error > 8.0 * error, "{error} {even_error}");
    // What shows no more than it did takes fewer.
    let (sides, _, fewer, _) = measured(&baked(Some([1.0, 0.0])).streams);
    assert_eq!(sides, [16.0, 32.0]);
    assert!(fewer < even_count * 3 / 5, "{fewer} {even_count}");

    assert!((surfels.usual_count() / surfels.count() as f64 - 1.0).abs() < 1e-6);
    const NO_STRIPES: Option<&mut Located<Stripes>> = None;
    let coarse = baker.bake_coarser(&patch, std::iter::once(&surfels), NO_STRIPES, Coarse::even(10));
    are_long(measured(&coarse.expect("it has an image").streams).0, 8.0);
    let mut source = Located::new(Stripes(corners.clone(), Some([8.0, 0.0])));
    let (sides, _, _, error) = measured(&baker.bake_cut(&patch, &mut source, 8, 0).expect("it has an image").streams);
    are_long(sides, 4.0);
    assert!(even_error > 4.0 * error, "{error} {even_error}");
}
