//! Writes a file of two triangles that bend where they meet, and reads it back: write FILE
//!
//! ```sh
//! cargo run -p lodpack --features write --example write -- bent.lodpack
//! ```
//!
//! A square is cut along its diagonal into two roots. At level 0 it is flat. Level 1 has a sample in the middle of the
//! diagonal that lifts it, so that each root has two triangles.

use std::error::Error;

use lodpack::{
    Cut, File, Lattice, LatticePoint, Limits, Node, Query,
    index::{Filling, HalfArc},
    write::{
        ArcRecord, ArcTarget, BlockRecord, LevelInfo, Model, PARAM_END, PatchTarget, Quantisation, RootRecord, Slide,
        SymbolBuffer, WantedSample, encode_patch, quantise_arcs, write_file,
    },
};

/// Lattice steps per world unit.
const STEPS: i64 = 1 << 10;
/// How far the middle is lifted, in lattice steps.
const LIFT: i64 = 100;
/// The corners of the square.
const CORNERS: [LatticePoint; 4] = [[0, 0, 0], [STEPS, 0, 0], [STEPS, STEPS, 0], [0, STEPS, 0]];
/// The corners at both ends of each arc: four sides and, number 2, the diagonal.
const ENDS: [[u32; 2]; 5] = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 0]];

/// The vertices of these patches lie on arcs, so there is none whose place could be improved.
struct Stay;

impl Slide for Stay {
    fn offset(&self, _vertex: u32, _point: [f64; 3], _normal: [f64; 3]) -> f64 {
        0.0
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: write FILE")?;
    let model = model()?;
    let report = write_file(&model, &mut std::fs::File::create(&path)?)?;
    println!("{path}: {} bytes", report.total_bytes);

    // One root fine, one coarse: the coarse one takes the sample in the middle of the diagonal, so there is no crack.
    let file = File::open(std::fs::read(&path)?, Limits::default())?;
    let nodes = vec![Node { root: 0, level: 0 }, Node { root: 1, level: 1 }];
    let mixed = file.extract(&Cut { nodes, ..Cut::default() })?;
    println!("coarse beside fine: {} vertices, {} triangles", mixed.positions.len(), mixed.triangles.len());
    let coarsest = file.select(&Query { tolerance: Some(0.2), ..Query::default() })?;
    println!("within 0.2: {} triangles, at most {} off", coarsest.triangle_count, coarsest.error);
    Ok(())
}

fn model() -> Result<Model, Box<dyn Error>> {
    let quantisation = Quantisation { normal_shift: 0, tangent_shift: 2 };
    let arc_tangent_shift = 0;
    let middle = [STEPS as f64 / 2.0, STEPS as f64 / 2.0, LIFT as f64];
    let diagonal = vec![WantedSample { param: PARAM_END / 2, level: 1, position: middle }];
    let target = |(arc, &ends): (usize, &[u32; 2])| ArcTarget {
        ends,
        samples: if arc == 2 { diagonal.clone() } else { Vec::new() },
    };
    let targets: Vec<ArcTarget> = ENDS.iter().enumerate().map(target).collect();
    // Everything else is fitted to the positions at which a decoder will place the samples.
    let samples = quantise_arcs(&CORNERS, &targets, arc_tangent_shift)?;
    let lifted = samples[2][0].position;
    let arcs: Vec<ArcRecord> =
        ENDS.into_iter().zip(samples).map(|(ends, samples)| ArcRecord { ends, samples }).collect();

    let half_arc = |arc, reversed| HalfArc { arc, reversed };
    let [a, b, c, d] = CORNERS;
    let roots = [
        // Level 1 lists the border as the loop runs: corners, and the lifted sample where the diagonal has it.
        (vec![half_arc(0, false), half_arc(1, false), half_arc(2, false)], [vec![a, b, c], vec![a, b, c, lifted]]),
        (vec![half_arc(2, true), half_arc(3, false), half_arc(4, false)], [vec![a, c, d], vec![a, lifted, c, d]]),
    ];
    let root = |(half_arcs, borders): (Vec<HalfArc>, [Vec<LatticePoint>; 2])| {
        let mut blocks = Vec::new();
        for (level, border) in borders.into_iter().enumerate() {
            let triangles: &[[u32; 3]] = if level == 0 { &[[0, 1, 2]] } else { &[[0, 1, 3], [1, 2, 3]] };
            let mut symbols = SymbolBuffer::default();
            let target = PatchTarget { loops: &[border], interior: &[], triangles };
            encode_patch(&target, quantisation, &Stay, &mut symbols)?;
            blocks.push(Some(BlockRecord {
                // A builder certifies these. Here the finest level is the input.
                error: if level == 0 { LIFT as f64 / STEPS as f64 } else { 0.0 },
                border_deviation: 0.0,
                triangle_count: triangles.len() as u32,
                symbols,
                texels: vec![],
                owners: vec![],
            }));
        }
        let bounds = [[0.0; 3], [1.0, 1.0, 0.1]];
        Ok::<_, Box<dyn Error>>(RootRecord {
            loops: vec![half_arcs],
            bounds,
            filling: Filling::Irregular,
            parent: None,
            blocks,
        })
    };
    let level = |tolerance| LevelInfo { tolerance, steps: quantisation.into() };
    Ok(Model {
        lattice: Lattice { origin: [0.0; 3], step_log2: -10 },
        arc_tangent_shift,
        levels: vec![level(0.1), level(0.0)],
        corners: CORNERS.to_vec(),
        arcs,
        roots: roots.into_iter().map(root).collect::<Result<_, _>>()?,
        ..Model::default()
    })
}
