//! Generated scenes of many closed parts, and a solid of many handles.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::DVec3;
use lodpack_cli::measure::selftest::shapes::Random;
use lodpack_cli::mesh::Mesh;

/// Sides of a pipe.
const SIDES: u32 = 24;

/// Pipes with closed ends, in a cube of 50 units: radii of 0.02 to 0.3, lengths of 0.5 to 8, 96 triangles each.
pub fn pipes(count: u32) -> Mesh {
    let mut random = Random(5);
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let centre = random.point() * 25.0 + 25.0;
        let axis = random.point().normalize();
        let (length, radius) = (0.5 + 7.5 * random.unit(), 0.02 + 0.28 * random.unit());
        let first = mesh.positions.len() as u32;
        let (a, b) = axis.any_orthonormal_pair();
        for end in [-0.5, 0.5] {
            let angles = (0..SIDES).map(|i| f64::from(i) / f64::from(SIDES) * TAU);
            let around = angles.map(|angle| (a * angle.cos() + b * angle.sin()) * radius);
            mesh.positions.extend(around.map(|offset| centre + axis * (length * end) + offset));
        }
        mesh.positions.extend([-0.5, 0.5].map(|end| centre + axis * (length * end)));
        for i in 0..SIDES {
            let j = (i + 1) % SIDES;
            let sides = [[i, j, j + SIDES], [i, j + SIDES, i + SIDES]];
            let ends = [[j, i, 2 * SIDES], [i + SIDES, j + SIDES, 2 * SIDES + 1]];
            mesh.triangles.extend(sides.iter().chain(&ends).map(|corners| corners.map(|v| v + first)));
        }
    }
    mesh
}

/// Boxes with sides of 0.05 to 0.5 in a cube of 100 units, 12 triangles each.
pub fn boxes(count: u32) -> Mesh {
    let mut random = Random(3);
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let low = random.point() * 50.0 + 50.0;
        add_box(&mut mesh, low, DVec3::new(random.unit(), random.unit(), random.unit()) * 0.45 + 0.05);
    }
    mesh
}

/// Adds a box to a mesh.
pub fn add_box(mesh: &mut Mesh, low: DVec3, size: DVec3) {
    add_box_to(&mut mesh.positions, &mut mesh.triangles, low, size);
}

/// Adds a box to positions and triangles.
pub fn add_box_to(positions: &mut Vec<DVec3>, triangles: &mut Vec<[u32; 3]>, low: DVec3, size: DVec3) {
    let first = positions.len() as u32;
    let corner = |bits: u32| low + size * DVec3::from_array([0, 1, 2].map(|axis| f64::from(bits >> axis & 1)));
    positions.extend((0..8).map(corner));
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let of_faces = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    triangles.extend(of_faces.map(|corners: [u32; 3]| corners.map(|v| v + first)));
}

/// A Menger sponge: the boundary of what is left of a cube of 3^depth cells a side. At depth 3 it has 36,096 triangles.
pub fn sponge(depth: u32) -> Mesh {
    let cells = 3_i32.pow(depth.min(5));
    let is_solid = |cell: [i32; 3]| {
        let mut at = cell;
        (0..depth).all(|_| {
            let middles = at.iter().filter(|&&x| x % 3 == 1).count();
            at = at.map(|x| x / 3);
            middles < 2
        }) && cell.iter().all(|x| (0..cells).contains(x))
    };
    let mut mesh = Mesh::default();
    let mut numbers: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    let mut vertex = |place: [i32; 3]| {
        *numbers.entry(place).or_insert_with(|| {
            mesh.positions.push(DVec3::from_array(place.map(f64::from)));
            mesh.positions.len() as u32 - 1
        })
    };
    let all = (0..cells).flat_map(|x| (0..cells).flat_map(move |y| (0..cells).map(move |z| [x, y, z])));
    for cell in all.filter(|&cell| is_solid(cell)) {
        for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
            let mut beside = cell;
            beside[axis] += 2 * side - 1;
            if is_solid(beside) {
                continue;
            }
            let corner = |u: i32, v: i32| {
                let mut place = cell;
                place[axis] += side;
                place[(axis + 1) % 3] += u;
                place[(axis + 2) % 3] += v;
                place
            };
            let mut quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)].map(&mut vertex);
            if side == 0 {
                quad.reverse();
            }
            let [a, b, c, d] = quad;
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_cli::stage::repair::repair;

    #[test]
    fn parts_are_closed_and_face_outward() {
        for (mesh, parts) in [(pipes(7), 7), (boxes(9), 9), (sponge(2), 1)] {
            let (_, _, report) = repair(mesh.clone());
            // Four cells of a sponge may meet in an edge, which repair cuts.
            assert_eq!((report.boundary_edges, report.flipped_faces, report.degenerate_faces), (0, 0, 0));
            assert!(report.components >= parts);
            let volume: f64 =
                (0..mesh.triangles.len() as u32).map(|t| mesh.corners(t)[0].dot(mesh.doubled_area(t)) / 6.0).sum();
            assert!(volume > 0.0);
        }
        assert_eq!(sponge(3).triangles.len(), 36_096);
    }
}
