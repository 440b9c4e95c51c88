//! A file of boxes with names, written by the library: for test vectors.

use lodpack::{
    Lattice, islands,
    write::{
        BlockRecord, LevelInfo, Model, ObjectNode, PatchTarget, Quantisation, RootRecord, Slide, SymbolBuffer,
        encode_patch, write_file,
    },
};
use std::error::Error;

const QUANTISATION: Quantisation = Quantisation { normal_shift: 0, tangent_shift: 0 };
/// Boxes of a leaf.
const OF_LEAF: u32 = 2;
/// Assemblies above an object, beside that above all.
const DEPTH: u32 = 18;

/// Vertices go to the planes of these points.
struct To<'p>(&'p [[f64; 3]]);

impl Slide for To<'_> {
    fn offset(&self, vertex: u32, point: [f64; 3], normal: [f64; 3]) -> f64 {
        self.0.get(vertex as usize).map_or(0.0, |wanted| (0..3).map(|k| (wanted[k] - point[k]) * normal[k]).sum())
    }
}

/// A box by its middle and half of its side.
type Cube = ([f64; 3], f64);

/// A block of boxes, and the node that owns each of them.
fn block(boxes: &[Cube], owners: &[u32], error: f64) -> Result<BlockRecord, Box<dyn Error>> {
    let (mut points, mut triangles) = (vec![], vec![]);
    for &(middle, half) in boxes {
        let first = points.len() as u32;
        for corner in 0..8_u32 {
            points.push([0, 1, 2].map(|k| middle[k] + if corner >> k & 1 == 1 { half } else { -half }));
        }
        for quad in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let [a, b, c, d] = quad.map(|corner| first + corner);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut symbols = SymbolBuffer::default();
    let target = PatchTarget { loops: &[], interior: &points, triangles: &triangles };
    let (patch, order) = encode_patch(&target, QUANTISATION, &To(&points), &mut symbols)?;
    let (labels, count) = islands(&patch.triangles);
    let mut of_islands = vec![0; if owners.is_empty() { 0 } else { count as usize }];
    for (triangle, label) in patch.triangles.iter().zip(labels) {
        if let Some(owner) = of_islands.get_mut(label as usize) {
            *owner = owners[order[triangle[0] as usize] as usize / 8];
        }
    }
    let triangle_count = patch.triangles.len() as u32;
    Ok(BlockRecord { error, triangle_count, symbols, owners: of_islands, ..BlockRecord::default() })
}

/// Boxes in leaves of two, below a group of each eight leaves: each of `count` objects has one box, and each fifth one
/// another in a later leaf. Names repeat, are empty, none, or of letters beyond ASCII. Each object lies in assemblies
/// of its own, one in another, and some lie in other objects; node `count` is above all.
///
/// # Errors
/// Any of the writer.
pub fn boxes_of_objects(count: u32) -> Result<Vec<u8>, Box<dyn Error>> {
    let node = |number: u32| {
        let name = match (number < count, number % 11) {
            (false, kind) => Some(format!("AREA-{:02}/LINE-{}/SPOOL-{kind}", number % 7, number / DEPTH)),
            (true, 0) => None,
            (true, 1) => Some("BOLT".to_owned()),
            (true, 2) => Some("\u{87ba}\u{6813} \"M12\"".to_owned()),
            (true, 3) => Some(String::new()),
            (true, kind) => Some(format!("FLANGE-{kind}")),
        };
        let id =
            (!number.is_multiple_of(3)).then(|| format!("{:08x}-{}", number.wrapping_mul(0x9e37_79b1), number % 40));
        let above = number.wrapping_sub(count + 1);
        let parent = match number {
            _ if number < count && number % 13 == 5 => Some(number - 1),
            _ if number < count => Some(count + DEPTH * (number + 1)),
            _ if number == count => None,
            _ if above.is_multiple_of(DEPTH) => Some(count),
            _ => Some(number - 1),
        };
        ObjectNode { name, id: if number % 100 == 7 { Some("twice".into()) } else { id }, parent }
    };
    let lattice = Lattice { origin: [-1.0, 2.0, 0.5], step_log2: -8 };
    let world = |point: [f64; 3]| [0, 1, 2].map(|k| lattice.origin[k] + point[k] / 256.0);
    let owners: Vec<u32> =
        (0..count).flat_map(|node| [Some(node), (node % 5 == 4).then_some(node / 2)]).flatten().collect();
    let (mut roots, mut groups): (Vec<RootRecord>, Vec<[[f64; 3]; 2]>) = (vec![], vec![]);
    let leaf_count = owners.chunks(OF_LEAF as usize).count() as u32;
    for (leaf, owners) in (0..).zip(owners.chunks(OF_LEAF as usize)) {
        let corner = [leaf % 4, leaf / 4 % 4, leaf / 16].map(|x| f64::from(x) * 400.0);
        let cube = |(number, _): (usize, &u32)| -> Cube {
            let at = [number % 4, number / 4 % 4, number / 16].map(|x| x as f64 * 90.0 + 45.0);
            ([0, 1, 2].map(|k| corner[k] + at[k]), 10.0 + (number * 7 % 23) as f64)
        };
        let cubes: Vec<Cube> = owners.iter().enumerate().map(cube).collect();
        // At the coarser level the small ones are gone.
        let is_kept = |number: &usize| *number == 0 || cubes[*number].1 > 16.0;
        let kept: Vec<usize> = (0..cubes.len()).filter(is_kept).collect();
        let coarse: Vec<Cube> = kept.iter().map(|&number| cubes[number]).collect();
        let of_coarse: Vec<u32> = kept.iter().map(|&number| owners[number]).collect();
        let bounds = [[-1.0; 3], [360.0; 3]].map(|end| world([0, 1, 2].map(|k| corner[k] + end[k])));
        match groups.get_mut((leaf / 8) as usize) {
            Some([low, high]) => {
                *low = [0, 1, 2].map(|k| low[k].min(bounds[0][k]));
                *high = [0, 1, 2].map(|k| high[k].max(bounds[1][k]));
            }
            None => groups.push(bounds),
        }
        let blocks = vec![None, Some(block(&coarse, &of_coarse, 0.25)?), Some(block(&cubes, owners, 0.0625)?)];
        roots.push(RootRecord { bounds, parent: Some(leaf_count + leaf / 8), blocks, ..RootRecord::default() });
    }
    for bounds in groups {
        let middle = [0, 1, 2].map(|k| ((bounds[0][k] + bounds[1][k]) / 2.0 - lattice.origin[k]) * 256.0);
        let blocks = vec![Some(block(&[(middle, 100.0)], &[], 1.0)?), None, None];
        roots.push(RootRecord { bounds, blocks, ..RootRecord::default() });
    }
    let level = |tolerance: f64| LevelInfo { tolerance, steps: QUANTISATION.into() };
    let levels = [1.0, 0.25, 0.0625].map(level).to_vec();
    let nodes = (0..count + 1 + DEPTH * count).map(node).collect();
    let mut bytes = vec![];
    write_file(&Model { lattice, levels, roots, nodes, ..Model::default() }, &mut bytes)?;
    Ok(bytes)
}
