//! Synthetic files whose blocks have texels that decode.

use super::synthetic::{Faces, Options, Random, add_channels, cube, model};
use crate::{
    File, Limits,
    decode::texels::Image,
    index::Scale,
    lattice::LatticePoint,
    write::{PieceShape, encode_image, encode_map, encode_values, write_file},
};

/// Axes of pieces: one for each direction along an axis of the world.
const SHAPES: [[i8; 3]; 6] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

/// A file in which each block has a map of up to six pieces, colours in scales and numbers. One of nine has only
/// numbers, and one of eleven nothing.
pub(crate) fn painted_file(faces: &Faces, options: Options) -> Vec<u8> {
    let (mut model, _) = model(faces, options);
    add_channels(&mut model, options.seed);
    model.channels[0].is_scaled = true;
    model.roots.iter_mut().flat_map(|root| root.blocks.iter_mut().flatten()).for_each(|block| block.texels.clear());
    let mut bytes = Vec::new();
    let order = write_file(&model, &mut bytes).unwrap().root_order;
    let file = File::open(bytes, Limits::default()).unwrap();
    let mut random = Random::new(options.seed);
    for root in 0..file.root_count() {
        for block in file.root_contents(root).unwrap().blocks {
            let found = file.decode_root(root, block.level).unwrap();
            let border = found.loops.iter().flatten().map(|vertex| vertex.position);
            let positions: Vec<LatticePoint> = border.chain(found.patch.interior.iter().copied()).collect();
            let record = model.roots[order[root as usize] as usize].blocks[usize::from(block.level)].as_mut().unwrap();
            record.texels = texels(&positions, &found.patch.triangles, random.below(1 << 30));
        }
    }
    let mut bytes = Vec::new();
    write_file(&model, &mut bytes).unwrap();
    bytes
}

fn texels(positions: &[LatticePoint], triangles: &[[u32; 3]], seed: u64) -> Vec<Vec<u8>> {
    if seed.is_multiple_of(11) {
        return vec![];
    }
    let label = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|corner| positions[corner as usize].map(|x| x as f64));
        let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let along = |shape: &[i8; 3]| (0..3).map(|k| f64::from(shape[k]) * normal[k]).sum::<f64>();
        (0..6).max_by(|&a, &b| along(&SHAPES[a]).total_cmp(&along(&SHAPES[b]))).unwrap()
    };
    let labels: Vec<usize> = triangles.iter().map(label).collect();
    let used: Vec<usize> = (0..6).filter(|number| labels.contains(number)).collect();
    let labels: Vec<u16> = labels.iter().map(|label| used.binary_search(label).unwrap() as u16).collect();
    let shapes: Vec<PieceShape> =
        used.iter().map(|&number| PieceShape { axis: SHAPES[number], ..PieceShape::default() }).collect();
    let (map, bytes) = encode_map(positions, triangles, 16, &shapes, &labels, 1 << 20).unwrap();
    let [width, height] = map.size;
    let texels = || (0..height).flat_map(|y| (0..width).map(move |x| (u64::from(x), u64::from(y))));
    let colour =
        |(x, y): (u64, u64)| [x * 3 + seed, y * 5 + seed / 7, x + y + seed / 11].map(|value| (value % 200) as u8);
    let colours = Image { size: map.size, components: 3, data: texels().flat_map(colour).collect() };
    let number = |(x, y): (u64, u64)| ((x * 70 + y * 130 + seed) % 60000) as u16;
    let numbers = Image { size: map.size, components: 1, data: texels().map(number).collect() };
    let is_used = vec![true; (width * height) as usize];
    let colours = if seed.is_multiple_of(9) { Default::default() } else { encode_image(&colours, &is_used, 3) };
    [bytes].into_iter().chain(colours).chain([encode_values(&numbers, &is_used)]).collect()
}

#[test]
fn a_cut_at_a_scale_has_the_same_triangles_at_places_of_smaller_images() {
    let options = Options { levels: 3, seed: 8, grids_of_four: 1, heights: 0 };
    let bytes = painted_file(&cube(4), options);
    let file = File::open(bytes, Limits::default()).unwrap();
    let cut = file.uniform_cut(2).unwrap();
    let whole = file.extract_textured(&cut, &[0, 1]).unwrap();
    let full = file.extract_textured_scaled(&cut, &[0, 1], Scale::Full).unwrap();
    // Places of nodes without texels are no numbers.
    assert!(full.mesh == whole.mesh && full.textures == whole.textures);
    for scale in [Scale::Half, Scale::Quarter, Scale::Eighth] {
        let smaller = file.extract_textured_scaled(&cut, &[0, 1], scale).unwrap();
        assert_eq!(smaller.mesh, whole.mesh);
        let side = 1_u32 << scale.halvings();
        let (mut count, mut worst) = (0, 0.0_f32);
        for (places, expected) in smaller.places.iter().flatten().zip(whole.places.iter().flatten()) {
            if expected[0].is_nan() {
                assert!(places[0].is_nan());
                continue;
            }
            (0..2).for_each(|k| worst = worst.max((places[k] - expected[k] / side as f32).abs()));
            count += 1;
        }
        assert!(count > 100 && worst < 1e-3, "{scale:?}: {worst} of {count}");
        for (texture, expected) in smaller.textures.iter().zip(&whole.textures) {
            for (image, expected) in texture.images.iter().zip(&expected.images) {
                let (Some(image), Some(expected)) = (image, expected) else {
                    assert_eq!(image, expected);
                    continue;
                };
                assert_eq!(image.size(), expected.size().map(|length| length.div_ceil(side)));
            }
        }
    }
}
