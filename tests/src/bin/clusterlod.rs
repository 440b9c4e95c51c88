//! The peer clusterlod: the cluster hierarchy of the crate `meshopt` over one mesh, single-threaded, in memory.
//!
//! clusterlod MESH [OUT_PREFIX]
//!
//! Prints triangles and CPU seconds (import, exact weld and hierarchy) as JSON. With OUT_PREFIX it also writes the
//! levels nearest to 50, 10 and 2 % of the triangles as OUT_PREFIX_50.ply and so on. A level consists of the clusters
//! of one depth and the clusters that ended above it.
#![allow(clippy::disallowed_methods, reason = "a peer's figures; no file of ours depends on them")]

use lodpack_cli::import::import_meshes;
use lodpack_cli::machine::process_cpu_time;
use lodpack_cli::mesh::Mesh;
use lodpack_cli::mesh::export::{MeshFormat, write_mesh};
use lodpack_cli::progress::Silent;
use lodpack_cli::stage::repair::repair;
use std::collections::BTreeMap;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut args = std::env::args().skip(1);
    let input = args.next().ok_or("usage: clusterlod MESH [OUT_PREFIX]")?;
    let prefix = args.next();
    let start = process_cpu_time();
    let (mesh, _, _) = repair(import_meshes(&[input.into()], &Silent)?);
    let levels = hierarchy(&mesh)?;
    let cpu_seconds = (process_cpu_time() - start).as_secs_f64();
    if let Some(prefix) = prefix {
        for percent in [50, 10, 2] {
            let wanted = mesh.triangles.len() as f64 * f64::from(percent) / 100.0;
            let off = |t: &[[u32; 3]]| (t.len() as f64 / wanted).ln().abs();
            if let Some(level) = levels.iter().min_by(|a, b| off(a).total_cmp(&off(b))) {
                let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
                let file = std::fs::File::create(format!("{prefix}_{percent}.ply"))?;
                write_mesh(file, MeshFormat::Ply, &positions, level)?;
            }
        }
    }
    let counts: Vec<usize> = levels.iter().map(Vec::len).collect();
    println!(
        "{}",
        serde_json::json!({ "triangles": mesh.triangles.len(), "cpu_seconds": cpu_seconds, "levels": counts })
    );
    Ok(())
}

fn hierarchy(mesh: &Mesh) -> Result<Vec<Vec<[u32; 3]>>, Failure> {
    let positions: Vec<f32> = mesh.positions.iter().flat_map(|p| p.as_vec3().to_array()).collect();
    let bytes: Vec<u8> = positions.iter().flat_map(|c| c.to_ne_bytes()).collect();
    let adapter = meshopt::VertexDataAdapter::new(&bytes, 12, 0)?;
    let indices: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    let clod = meshopt::ClodMesh::new(&indices, &adapter);
    let mut by_depth: BTreeMap<i32, Vec<u32>> = BTreeMap::new();
    let mut ended: Vec<(i32, Vec<u32>)> = vec![];
    let mut groups = 0;
    meshopt::clod_build(meshopt::clod_default_config(128), &clod, |group, clusters| {
        for cluster in clusters {
            by_depth.entry(group.depth).or_default().extend(cluster.indices);
            if group.simplified.error >= f32::MAX {
                ended.push((group.depth, cluster.indices.to_vec()));
            }
        }
        groups += 1;
        groups - 1
    });
    Ok(by_depth
        .into_iter()
        .map(|(depth, mut level)| {
            level.extend(ended.iter().filter(|(d, _)| *d < depth).flat_map(|(_, c)| c));
            level.as_chunks::<3>().0.to_vec()
        })
        .collect())
}
