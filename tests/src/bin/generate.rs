//! Writes generated meshes: generate sphere|torus|sheet|part N OUT.ply (N: resolution; the sphere and the part have 12 N^2 triangles)

use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, save_ply, torus};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [kind, n, out] = args.as_slice() else {
        return Err("usage: generate sphere|torus|sheet|part N OUT.ply".into());
    };
    let n: u32 = n.parse()?;
    let mesh = match kind.as_str() {
        "sphere" => bumpy_sphere(n),
        "torus" => torus(n),
        "sheet" => punched_sheet(n),
        "part" => fan_part(n),
        _ => return Err(format!("unknown kind '{kind}'").into()),
    };
    println!("{} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len());
    save_ply(&mesh, out.as_ref())?;
    Ok(())
}
