//! Tests of what pictures are compared with.

use glam::DVec3;
use lodpack::View;
use lodpack_view::check::{
    mesh_file::read_mesh,
    reference::{Tree, depth_map, point},
};

use crate::folder;

#[test]
fn a_pixel_shows_what_lies_there() {
    let positions = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 1.0]];
    let whole = View::around([[-1.0; 3], [1.0; 3]], [0.0, 1.0, 0.0], 0.0, 0.0);
    let view = View { position: [0.1, 0.0, 5.0], viewport: [64, 48], ..whole };
    let depths = depth_map(&positions, &[[0, 1, 2]], &view);
    let tree = Tree::new(&positions, &[[0, 1, 2]], |_| 7);
    let seen: Vec<usize> = (0..depths.len()).filter(|&i| depths[i].is_finite()).collect();
    assert!(seen.len() > 100 && seen.len() < 64 * 48 / 2);
    for pixel in seen {
        let seen_point = point(&view, pixel, depths[pixel]);
        assert!(tree.is_near(seen_point, 1e-9, |label| if label == 7 { 1e-9 } else { 0.0 }));
        assert!(!tree.is_near(seen_point + DVec3::Z, 0.5, |_| 0.5));
    }
}

#[test]
fn the_tree_agrees_with_a_search_of_every_triangle() {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let positions: Vec<[f64; 3]> = (0..60).map(|_| [next(), next(), next()]).collect();
    let triangles: Vec<[u32; 3]> = (0..39).map(|k| [k, (k * 7 + 3) % 60, (k * 13 + 5) % 60]).collect();
    let tree = Tree::new(&positions, &triangles, |_| 0);
    for _ in 0..300 {
        let point = DVec3::new(next(), next(), next());
        // Every point of a triangle is within this distance of a point that is tried.
        const STEP: f64 = 0.03;
        let tries = (0..=64).flat_map(|i| (0..=64 - i).map(move |k| [i, k, 64 - i - k].map(|x| f64::from(x) / 64.0)));
        let distance = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| DVec3::from(positions[v as usize]));
            tries.clone().map(|[u, v, w]| (a * u + b * v + c * w).distance(point)).fold(f64::INFINITY, f64::min)
        };
        let least = triangles.iter().map(distance).fold(f64::INFINITY, f64::min);
        assert!(tree.is_near(point, least * 1.001, |_| least * 1.001));
        assert!(!tree.is_near(point, 1.0, |_| (least - STEP).max(0.0)));
    }
}

#[test]
fn ascii_and_binary_files_give_the_same_mesh() {
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let ascii = head("ascii") + "0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n4 0 1 2 3\n";
    let mut binary = head("binary_big_endian").into_bytes();
    for [x, y, z] in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]] {
        binary.extend((x as f32).to_be_bytes());
        binary.extend(f64::to_be_bytes(y));
        binary.extend((z as f32).to_be_bytes());
    }
    binary.push(4);
    (0..4_i32).for_each(|k| binary.extend(k.to_be_bytes()));
    let folder = folder("ply");
    let read = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.join(name), bytes).unwrap();
        read_mesh(&folder.join(name))
    };
    let mesh = read("ascii.ply", ascii.as_bytes()).unwrap();
    assert_eq!(mesh, read("binary.ply", &binary).unwrap());
    assert_eq!((mesh.positions[3], &mesh.triangles[..]), ([0.0, 1.0, 0.5], &[[0, 1, 2], [0, 2, 3]][..]));
    assert!(read("cut.ply", &binary[..binary.len() - 1]).is_err() && read("empty.ply", b"ply\n").is_err());
    assert!(read("missing.ply", ascii.replace("4 0 1 2 3", "4 0 1 2 4").as_bytes()).is_err());
}
