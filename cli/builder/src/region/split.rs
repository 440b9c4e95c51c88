//! Dividing a mesh in memory.

use glam::DVec3;

use super::decompose::{Decomposition, Division};
use lodpack_mesh::attributes::{RegionAttributes, Surface};
use lodpack_mesh::{Mesh, NONE};

/// The regions of a mesh, each with its triangles in the order of the input and its vertices in the order in which
/// these first use them.
pub fn split_mesh(surface: Surface, division: Division) -> Vec<(Mesh, RegionAttributes)> {
    let Surface { mesh, attributes, appearance } = surface;
    if mesh.triangles.len() as u64 <= division.triangles {
        let all = (0..mesh.triangles.len() as u32).zip(mesh.triangles.iter().copied());
        let own = RegionAttributes::gather(&attributes, &appearance, &attributes, all);
        return vec![(mesh, own)];
    }
    let centroid = |triangle: &[u32; 3]| centroid(triangle.map(|v| mesh.positions[v as usize]));
    let visit = &mut |f: &mut dyn FnMut(DVec3)| -> Result<(), std::convert::Infallible> {
        mesh.triangles.iter().for_each(|triangle| f(centroid(triangle)));
        Ok(())
    };
    let tree = match Decomposition::new(mesh.bounds(), division, visit) {
        Ok(tree) => tree,
        Err(never) => match never {},
    };
    let mut regions: Vec<Vec<[u32; 3]>> = vec![vec![]; tree.region_count() as usize];
    let has_attributes = !attributes.are_empty(&appearance);
    let mut numbers: Vec<Vec<u32>> = vec![vec![]; regions.len()];
    for (number, triangle) in (0..).zip(&mesh.triangles) {
        let region = tree.region_of(centroid(triangle)) as usize;
        regions[region].push(*triangle);
        if has_attributes {
            numbers[region].push(number);
        }
    }
    let Mesh { positions, triangles } = mesh;
    drop(triangles);
    let mut number = vec![NONE; positions.len()];
    let region = |(triangles, numbers): (Vec<[u32; 3]>, Vec<u32>)| {
        let numbered = numbers.into_iter().zip(triangles.iter().copied());
        let own = RegionAttributes::gather(&attributes, &appearance, &attributes, numbered);
        (renumbered(triangles, &positions, &mut number), own)
    };
    regions.into_iter().zip(numbers).map(region).collect()
}

/// The point that decides to which region a triangle belongs.
pub(crate) fn centroid([a, b, c]: [DVec3; 3]) -> DVec3 {
    // Thirds first, so that nothing overflows.
    a / 3.0 + b / 3.0 + c / 3.0
}

/// The mesh of some triangles. `number` holds [`NONE`] everywhere, before and after.
fn renumbered(mut triangles: Vec<[u32; 3]>, all: &[DVec3], number: &mut [u32]) -> Mesh {
    let mut used = vec![];
    for vertex in triangles.iter_mut().flatten() {
        let own = &mut number[*vertex as usize];
        if *own == NONE {
            *own = used.len() as u32;
            used.push(*vertex);
        }
        *vertex = *own;
    }
    used.iter().for_each(|&vertex| number[vertex as usize] = NONE);
    Mesh { positions: used.iter().map(|&vertex| all[vertex as usize]).collect(), triangles }
}
