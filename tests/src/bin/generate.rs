//! Writes generated meshes: generate sphere|rough|torus|sheet|part|pipes|boxes|sponge N OUT.ply [--single]. N is the
//! resolution (spheres and the part have 12 N^2 triangles), the number of pipes or boxes, or the depth of the sponge;
//! --single writes single-precision coordinates.
//!
//! generate city N FOLDER [--texture SIDE] writes N tiles of a city, each an OBJ file with a texture of SIDE x SIDE
//! texels (2,048 by default).

use lodpack_tests::city::{TEXTURE_SIDE, write_city};
use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, rough_sphere, save_ply, save_single_ply, torus};
use lodpack_tests::parts::{boxes, pipes, sponge};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (flags, args): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|arg| arg.starts_with("--"));
    let [kind, n, out, more @ ..] = args.as_slice() else {
        return Err("usage: generate sphere|rough|torus|sheet|part|pipes|boxes|sponge N OUT.ply [--single], or generate city N FOLDER \
                    [--texture SIDE]"
            .into());
    };
    let n: u32 = n.parse()?;
    if kind == "city" {
        let side = more.first().map_or(Ok(TEXTURE_SIDE), |side| side.parse())?;
        println!("{} triangles, {} texels", write_city(n, side, out.as_ref())?, u64::from(n) * u64::from(side).pow(2));
        return Ok(());
    }
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
