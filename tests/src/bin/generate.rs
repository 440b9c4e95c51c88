//! Writes generated meshes: generate sphere|rough|torus|sheet|part|pipes|boxes|sponge N OUT.ply [--single]. N is the
//! resolution (spheres and the part have 12 N^2 triangles), the number of pipes or boxes, or the depth of the sponge;
//! --single writes single-precision coordinates.
//!
//! generate fan|cone|star|comb|needles|flat|stairs|spiral|screw|shells|sheets|stack|soup N OUT.ply [--single] writes
//! meshes of about N triangles that are extreme in one way, and generate crossing|wandering N OUT.obj one polygon of N
//! corners that crosses itself.
//!
//! generate city N FOLDER [--texture SIDE] writes N tiles of a city, each an OBJ file with a texture of SIDE x SIDE
//! texels (2,048 by default).

use lodpack_tests::city::{TEXTURE_SIDE, write_city};
use lodpack_tests::extremes::{EXTREMES, crossing_polygon, extreme, save_polygon, wandering_polygon};
use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, rough_sphere, save_ply, save_single_ply, torus};
use lodpack_tests::parts::{boxes, pipes, sponge};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (flags, args): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|arg| arg.starts_with("--"));
    let [kind, n, out, more @ ..] = args.as_slice() else {
        return Err(format!(
            "usage: generate sphere|rough|torus|sheet|part|pipes|boxes|sponge|{} N OUT.ply [--single], generate crossing|wandering N \
             OUT.obj, or generate city N FOLDER [--texture SIDE]",
            EXTREMES.join("|")
        )
        .into());
    };
    let n: u32 = n.parse()?;
    if kind == "city" {
        let side = more.first().map_or(Ok(TEXTURE_SIDE), |side| side.parse())?;
        println!("{} triangles, {} texels", write_city(n, side, out.as_ref())?, u64::from(n) * u64::from(side).pow(2));
        return Ok(());
    }
    if let Some(corners) = match kind.as_str() {
        "crossing" => Some(crossing_polygon(n)),
        "wandering" => Some(wandering_polygon(n)),
        _ => None,
    } {
        println!("{} corners", corners.len());
        return Ok(save_polygon(&corners, out.as_ref())?);
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
        _ => extreme(kind, n).ok_or_else(|| format!("unknown kind '{kind}'"))?,
    };
    println!("{} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len());
    match flags.iter().any(|flag| flag == "--single") {
        true => save_single_ply(&mesh, out.as_ref())?,
        false => save_ply(&mesh, out.as_ref())?,
    }
    Ok(())
}
