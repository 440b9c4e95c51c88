//! Integration tests, one line a theme:
//!
//! - [`commands`]: the program as people run it: build, info, verify, extract, exit codes, temporary files
//! - [`queries`]: one table of queries, which the program and the packages for Python, C and JavaScript answer alike
//! - [`typed`]: commands as people type them: default names, the viewer, shell completions, man pages
//! - [`remote`]: files on web servers
//! - [`serve`]: files on the program's own web server, and what it says of other servers
//! - [`tileset`]: files as 3D Tiles: valid, rendered, without cracks between tiles of any levels
//! - [`quantized`]: files of heights as terrain tiles for Cesium, read by another decoder
//! - [`levels`]: all levels in one GLB
//! - [`compare`]: distances of any two surfaces, and that every accuracy which is printed holds for the file that is
//!   written
//! - [`report`]: error against run time, over sweeps of settings and queries
//! - [`soundness`]: certified errors hold, cuts are watertight, budgets are kept
//! - [`determinism`]: the same bytes on any number of threads
//! - [`jobs`]: builds in parts, and builds that are stopped and resumed
//! - [`stages`]: jobs whose planning is divided into tasks: workers, kills in every stage
//! - [`slurm`]: parts on a compute cluster whose tasks fail and whose nodes die
//! - [`channels`]: colours and numbers of the input come through builds of every kind, and out again
//! - [`reduced_images`]: images of simplified meshes have fewer texels and bytes the fewer triangles there are
//! - [`lossless`]: texels that come back as they were made, and what else holds of files with them
//! - [`objects`]: what inputs name comes back, with the parts of the surface that it names
//! - [`drawings`]: alpha modes, double-sided and unlit materials come through builds of every kind, and out again
//! - [`normals`]: what stores no normals is shaded by computed ones, up to creases and alike on both sides of arcs
//! - [`images`]: images of the input that are larger than memory, on full disks, of opacity alone, or of one colour
//! - [`atlas`]: a mesh becomes geometry images, and they become the same surface again
//! - [`atlas_charts`]: the charts of an atlas become the roots of a file, whole or in parts
//! - [`inputs`]: folders, patterns and lodpack files as inputs, and meshes that say where they are
//! - [`bad_input`]: every kind of bad mesh gives a correct file or one clear error
//! - [`georeference`]: places, systems and units of rasters, read and written again
//! - [`terrain`]: rasters of heights become the surface that they describe, on planes and globes
//! - [`rasters`]: rasters as their writers lay them out: masks, no data, bits, places, sidecars, images over them
//! - [`heights`]: files of heights keep their promises on planes and globes, and commands work with them
//! - [`draped_heights`]: images over files of heights: where they are, how good, what is transparent, and commands
//! - [`heights_jobs`]: files of heights in parts: kills, changed files, the bytes of one build
//! - [`object_jobs`]: files of objects have the same bytes on any number of threads, in parts, in stages, after kills
//! - [`objects_out`]: objects through commands: listed, taken out, picked, and back again
//! - [`ground`]: a mesh on its ground of heights in one file: joined, taken apart, verified, exported, refused
//! - [`tin`]: few triangles of any shape out of files of heights, within a tolerance
//! - [`bad_terrain`]: every kind of bad raster gives a correct file or one clear error
//! - [`ragged`]: coarse levels of surfaces with ragged borders keep their outline, and no level says what another one
//!   does
//! - [`stability`]: generated meshes, from easy to impossible, give sound files or clear errors
//! - [`damage`]: truncated and flipped files are never trusted and never panic
//! - [`nothing_unneeded`]: a scene without a feature has no byte for it, and `info --why` accounts for every byte
//! - [`compiled`]: each program stays within its budget of compiled crates
//! - [`house`]: rooms import in one direction, links in documents lead somewhere, the README is one page
//! - [`browser`]: WebAssembly reads what the native reader reads, and the viewer page draws it in Chromium
//! - [`python`]: the package for Python, installed from its wheel
//! - [`vectors`]: the independent decoder of format-spec agrees with the reader
#![allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter")]

mod atlas;
mod atlas_channels;
mod atlas_charts;
mod bad_input;
mod bad_terrain;
mod browser;
mod channels;
mod coarsest;
mod commands;
mod compare;
mod compiled;
mod damage;
mod determinism;
mod draped_heights;
mod drawings;
mod georeference;
mod ground;
mod heights;
mod heights_jobs;
mod house;
mod images;
mod inputs;
mod jobs;
mod levels;
mod lossless;
mod many_texels;
mod normals;
mod nothing_unneeded;
mod object_jobs;
mod objects;
mod objects_out;
mod python;
mod quantized;
mod queries;
mod ragged;
mod rasters;
mod reduced_images;
mod remote;
mod report;
mod serve;
mod slurm;
mod soundness;
mod stability;
mod stages;
mod terrain;
mod tileset;
mod tin;
mod typed;
mod vectors;

use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::pipeline::ModelOptions;
use lodpack_cli::pipeline::summary::BuildSummary;
use lodpack_cli::progress::Silent;
use std::path::{Path, PathBuf};

/// A real scan of 109,259 triangles.
fn scan() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/snowden.ply")
}

/// Builds a mesh in memory.
fn build_mesh(mesh: &Mesh, tolerance: &str) -> (Vec<u8>, BuildSummary) {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("mesh.ply");
    lodpack_tests::generate::save_ply(mesh, &path).expect("a writable temporary directory");
    build_file(&path, tolerance)
}

/// Builds a file in memory.
fn build_file(path: &Path, tolerance: &str) -> (Vec<u8>, BuildSummary) {
    let tolerance = tolerance.parse::<Tolerance>().expect("a tolerance");
    let model = ModelOptions { tolerance, ..ModelOptions::default() };
    let options = BuildOptions { inputs: vec![path.to_owned()], model, ..BuildOptions::default() };
    let mut bytes = vec![];
    let summary = build(&options, &mut bytes, &Silent).expect("a sound mesh builds");
    (bytes, summary)
}

/// Opens a file in memory.
fn open(bytes: &[u8]) -> lodpack::File<&[u8]> {
    lodpack::File::open(bytes, lodpack::Limits::default()).expect("a sound file opens")
}
