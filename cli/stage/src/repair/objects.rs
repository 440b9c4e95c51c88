//! Gives each object vertices of its own.

use std::collections::HashMap;

use glam::DVec3;

use lodpack_mesh::NONE;

/// Gives an object a copy of each vertex that it shares with an earlier one. `objects` are those of the triangles.
/// Returns the object of each vertex, [`NONE`] for those that no triangle uses.
pub(super) fn part_objects(positions: &mut Vec<DVec3>, triangles: &mut [[u32; 3]], objects: &[u32]) -> Vec<u32> {
    let mut of_vertices = vec![NONE; positions.len()];
    let mut copies: HashMap<(u32, u32), u32> = HashMap::new();
    for (triangle, &object) in triangles.iter_mut().zip(objects) {
        for vertex in triangle {
            let owner = &mut of_vertices[*vertex as usize];
            if *owner == NONE {
                *owner = object;
            }
            if *owner != object {
                let position = positions[*vertex as usize];
                *vertex = *copies.entry((*vertex, object)).or_insert_with(|| {
                    positions.push(position);
                    of_vertices.push(object);
                    positions.len() as u32 - 1
                });
            }
        }
    }
    of_vertices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shared_vertex_is_copied_once_for_each_further_object() {
        let mut positions: Vec<DVec3> = (0..5).map(|x| DVec3::splat(f64::from(x))).collect();
        let mut triangles = [[0, 1, 2], [0, 2, 3], [2, 1, 3], [3, 2, 0]];
        let owners = part_objects(&mut positions, &mut triangles, &[4, 6, 4, 6]);
        assert_eq!(triangles, [[0, 1, 2], [5, 6, 3], [2, 1, 7], [3, 6, 5]]);
        assert_eq!(owners, [4, 4, 4, 6, NONE, 6, 6, 4]);
        assert_eq!(positions[5..], [0.0, 2.0, 3.0].map(DVec3::splat));
    }
}
