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
//!
//! generate plant N OUT.glb|OUT.obj [--baked] writes a plant of N named objects, and generate forest N OUT.glb|OUT.obj
//! a forest of N trees. Nodes of a GLB share meshes, or with --baked each has its own in the space of the world.

use lodpack_tests::city::{TEXTURE_SIDE, write_city};
use lodpack_tests::extremes::{EXTREMES, crossing_polygon, extreme, save_polygon, wandering_polygon};
use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, rough_sphere, save_ply, save_single_ply, torus};
use lodpack_tests::parts::{boxes, pipes, sponge};
use lodpack_tests::scene::{Sharing, forest, plant, write_glb, write_obj};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (flags, args): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|arg| arg.starts_with("--"));
    let [kind, n, out, more @ ..] = args.as_slice() else {
        return Err(format!(
            "usage: generate sphere|rough|torus|sheet|part|pipes|boxes|sponge|{} N OUT.ply [--single], generate crossing|wandering N \
             OUT.obj, generate city N FOLDER [--texture SIDE], or generate plant|forest N OUT.glb|OUT.obj [--baked]",
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
    if let "plant" | "forest" = kind.as_str() {
        let scene = if kind == "plant" { plant(n) } else { forest(n) };
        println!(
            "{} objects of {} shapes, {} triangles",
            scene.object_count(),
            scene.shapes.len(),
            scene.triangle_count()
        );
        let sharing = if flags.iter().any(|flag| flag == "--baked") { Sharing::Nothing } else { Sharing::Meshes };
        match out.ends_with(".obj") {
            true => write_obj(&scene, out.as_ref())?,
            false => write_glb(&scene, sharing, out.as_ref())?,
        }
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
