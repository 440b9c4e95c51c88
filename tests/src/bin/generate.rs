//! Writes generated meshes: generate sphere|rough|torus|sheet|part|pipes|boxes|sponge N OUT.ply [--single]. N is the resolution
//! (spheres and the part have 12 N^2 triangles), the number of pipes or boxes, or the depth of the sponge; --single writes
//! single-precision coordinates.

use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, rough_sphere, save_ply, save_single_ply, torus};
use lodpack_tests::parts::{boxes, pipes, sponge};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (flags, args): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|arg| arg.starts_with("--"));
    let [kind, n, out] = args.as_slice() else {
        return Err("usage: generate sphere|rough|torus|sheet|part|pipes|boxes|sponge N OUT.ply [--single]".into());
    };
    let n: u32 = n.parse()?;
    let mesh = match kind.as_str() {
        "sphere" => bumpy_sphere(n),
        "rough" => rough_sphere(n),
        "torus" => torus(n),
        "sheet" => punched_sheet(n),
        "part" => fan_part(n),
        "pipes" => pipes(n),
        "boxes" => boxes(n),
        "sponge" => sponge(n),
        _ => return Err(format!("unknown kind '{kind}'").into()),
    };
    println!("{} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len());
    match flags.iter().any(|flag| flag == "--single") {
        true => save_single_ply(&mesh, out.as_ref())?,
        false => save_ply(&mesh, out.as_ref())?,
    }
    Ok(())
}
