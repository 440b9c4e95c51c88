//! Integration tests, one line a theme:
//!
//! - [`cameras`]: cameras and paths, as text and in motion
//! - [`channels`]: files with channels: colours of the input, no lines along arcs, ramps
//! - [`drawings`]: files that say how they are drawn: masks, blended and unlit surfaces
//! - [`checks`]: checks pass on every kind of mesh and find planted faults
//! - [`heights`]: files of heights: checked, drawn
//! - [`pictures`]: the program without a window: pictures, tiles, paths, exit codes
//! - [`references`]: what pictures are compared with: PLY files, the rasteriser without a GPU, distances
//! - [`scenes`]: several files in one picture, with one budget
//! - [`sources`]: servers that fail while a file is being viewed
//! - [`walls`]: displays in processes of their own show one picture, come, go, and are refused
//! - [`window`]: the window under Xvfb: opens, takes keys, draws, closes
//!
//! [`channels`], [`checks`], [`drawings`], [`heights`], [`pictures`], [`scenes`], [`walls`] and [`window`] need a
//! graphics adapter (Mesa's lavapipe is enough). Without one they report that they were skipped, and fail only if
//! LODPACK_REQUIRE_GPU=1 is set.
#![allow(clippy::disallowed_methods, reason = "cameras and pictures; no file depends on them")]

mod cameras;
mod channels;
mod checks;
mod drawings;
mod heights;
mod pictures;
mod references;
mod scenes;
mod sources;
mod walls;
mod window;

use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};

use lodpack_cli::{
    job::{BuildOptions, build},
    mesh::Mesh,
    mesh::tolerance::Tolerance,
    pipeline::ModelOptions,
    progress::Silent,
};
use lodpack_view::gpu::Gpu;

/// Whether there is an adapter; reports it if not.
fn has_gpu() -> bool {
    static FOUND: OnceLock<bool> = OnceLock::new();
    let found = *FOUND.get_or_init(|| Gpu::headless().map_err(|error| eprintln!("{error:#}")).is_ok());
    found || skip("a graphics adapter")
}

/// Reports that a test is skipped; fails if none may be.
fn skip(what: &str) -> bool {
    assert!(std::env::var_os("LODPACK_REQUIRE_GPU").is_none_or(|value| value != "1"), "this test needs {what}");
    eprintln!("skipped: this test needs {what}");
    false
}

/// A new, empty folder for a test.
fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// A mesh, and the file built from it.
struct Model {
    mesh: lodpack::Mesh,
    bytes: Arc<Vec<u8>>,
}

impl Model {
    fn new(name: &str, mesh: &Mesh, tolerance: &str) -> Self {
        let path = folder(&format!("model-{name}")).join("mesh.ply");
        lodpack_tests::generate::save_ply(mesh, &path).unwrap();
        let tolerance = tolerance.parse::<Tolerance>().unwrap();
        let model = ModelOptions { tolerance, chart_triangles: Some(2048), ..ModelOptions::default() };
        let options = BuildOptions { inputs: vec![path], model, ..BuildOptions::default() };
        let mut bytes = vec![];
        build(&options, &mut bytes, &Silent).unwrap();
        let positions = mesh.positions.iter().map(|p| p.to_array()).collect();
        let mesh = lodpack::Mesh { positions, triangles: mesh.triangles.clone(), ..Default::default() };
        Self { mesh, bytes: Arc::new(bytes) }
    }

    /// A closed mesh of 40,368 triangles, with grids.
    fn sphere() -> &'static Self {
        static MODEL: OnceLock<Model> = OnceLock::new();
        MODEL.get_or_init(|| Self::new("sphere", &lodpack_tests::generate::bumpy_sphere(58), "0.1%"))
    }

    /// The sphere as a file on disk.
    fn sphere_path() -> PathBuf {
        static PATH: OnceLock<PathBuf> = OnceLock::new();
        let save = || {
            let path = folder("sphere-file").join("sphere.lodpack");
            std::fs::write(&path, &*Self::sphere().bytes).unwrap();
            path
        };
        PATH.get_or_init(save).clone()
    }
}

/// Runs the program and keeps its standard output and error.
fn program(arguments: &[&str]) -> std::process::Output {
    std::process::Command::new(env!("CARGO_BIN_EXE_lodpack-view")).args(arguments).output().unwrap()
}
