#!/usr/bin/env bash
# What one would guess: an OBJ reader ignores the fourth number of `v x y z w`, which is the weight of rational curves
# and surfaces and means nothing for polygons, and keeps polylines (`l`) apart from faces.
# What is so (crate tobj 4.0.5): positions are divided by the weight, and `l 1 2 3 4` becomes a polygon of four corners,
# or two triangles with `triangulate`.
# Consequence: tobj judges lodpack's reader of OBJ in its tests, except for texts with either of them.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
mkdir src
cat > Cargo.toml <<'TOML'
[package]
name = "lines"
version = "0.0.0"
edition = "2021"
[dependencies]
tobj = { version = "=4.0.5", default-features = false }
TOML
cat > src/main.rs <<'RS'
fn read(text: &str, triangulate: bool) -> tobj::Mesh {
    let options = tobj::LoadOptions { triangulate, ..Default::default() };
    let no_materials = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials).unwrap();
    let mesh = models.into_iter().next().unwrap().mesh;
    println!("{text:?}: positions {:?}, indices {:?}, corners {:?}", mesh.positions, mesh.indices, mesh.face_arities);
    mesh
}

fn main() {
    const SQUARE: &str = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\n";
    let weighted = read("v 0 0 0 1\nv 2 0 0 1\nv 2 2 0 2\nf 1 2 3\n", false);
    assert_eq!(weighted.positions[6..], [1.0, 1.0, 0.0], "this has changed");
    let face = read(&format!("{SQUARE}f 1 2 3 4\n"), false);
    let line = read(&format!("{SQUARE}l 1 2 3 4\n"), false);
    assert_eq!((&line.indices, &line.face_arities), (&face.indices, &face.face_arities), "this has changed");
    assert_eq!(read(&format!("{SQUARE}l 1 2 3 4\n"), true).indices, [0, 1, 2, 0, 2, 3], "this has changed");
    assert_eq!(read(&format!("{SQUARE}l 1 2\n"), false).face_arities, [2], "this has changed");
}
RS
cargo run --quiet
