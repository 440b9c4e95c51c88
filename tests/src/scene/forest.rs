//! A forest: trees of few shapes, each turned and scaled in its own way.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use lodpack_cli::measure::selftest::shapes::Random;

use super::{Node, Scene, Shape, Transform};

/// Different trees, and leaves of each: with branches a tree has about 100,000 triangles.
const SHAPES: u32 = 12;
const LEAVES: u32 = 42_000;
/// Space for a tree along each side, in metres.
const SPACE: f64 = 9.0;

/// Trees of some 100,000 triangles each, on level ground. Wood is one object and leaves are another one, in an
/// assembly for each tree.
pub fn forest(trees: u32) -> Scene {
    let mut random = Random(23);
    let mut scene = Scene::default();
    let shapes: Vec<[u32; 2]> = (0..SHAPES.min(trees)).map(|_| tree(&mut random).map(|s| scene.add_shape(s))).collect();
    let columns = (1..).find(|columns| columns * columns >= trees).unwrap_or(1);
    for number in 0..trees {
        let [x, y] = [number % columns, number / columns].map(|k| (f64::from(k) + 0.6 * random.unit()) * SPACE);
        let transform = Transform {
            translation: DVec3::new(x, y, 0.0),
            rotation: DQuat::from_rotation_z(TAU * random.unit()),
            scale: DVec3::splat(0.7 + 0.6 * random.unit()),
        };
        let name = Some(format!("TREE-{number:04}"));
        let tree = scene.add(Node { name, id: None, parent: None, shape: None, transform });
        for (name, shape) in ["wood", "leaves"].into_iter().zip(shapes[number as usize % shapes.len()]) {
            let (name, id) = (Some(name.to_owned()), Some(format!("{number}/{name}")));
            let transform = Transform::IDENTITY;
            scene.add(Node { name, id, parent: Some(tree), shape: Some(shape), transform });
        }
    }
    scene
}

/// The wood and the leaves of a tree.
fn tree(random: &mut Random) -> [Shape; 2] {
    let (mut wood, mut leaves) = (Shape::new(7), Shape::new(8));
    let mut twigs = vec![];
    grow(&mut wood, &mut twigs, random, DVec3::ZERO, DVec3::Z, 3.2, 0.22, 0);
    for _ in 0..LEAVES {
        let [from, to] = twigs[(random.unit() * twigs.len() as f64) as usize];
        let at = from.lerp(to, random.unit()) + random.point() * 0.25;
        let (along, across) = (random.point().normalize() * 0.07, random.point().normalize() * 0.04);
        let first = leaves.positions.len() as u32;
        leaves.positions.extend([at, at + along + across, at + 2.0 * along, at + along - across]);
        leaves.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    [wood, leaves]
}

#[expect(clippy::too_many_arguments, reason = "what a branch is, by a recursion of its own")]
fn grow(
    wood: &mut Shape,
    twigs: &mut Vec<[DVec3; 2]>,
    random: &mut Random,
    from: DVec3,
    direction: DVec3,
    length: f64,
    radius: f64,
    depth: u32,
) {
    const DEEPEST: u32 = 5;
    let bent = (direction + random.point() * 0.25).normalize();
    let [middle, to] = [from + direction * length / 2.0, from + (direction + bent) * (length / 2.0)];
    wood.tube(&[from, middle, to], |k| radius * [1.0, 0.9, 0.75][k], if depth < 3 { 12 } else { 6 });
    if depth == DEEPEST {
        twigs.push([from, to]);
        return;
    }
    for _ in 0..3 {
        let direction = (bent + random.point() * 0.9).normalize();
        grow(wood, twigs, random, to, direction, length * 0.72, radius * 0.55, depth + 1);
    }
}
