//! Random cuts of mixed levels and depths of all vectors: the reader and `format-spec/decode.py` draw the same mesh.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::cuts::open_edges;
use super::synthetic::Random;
use super::trees::random_cut;
use crate::heights::{CutTile, Heights, HeightsCut};
use crate::{File, Limits, Mesh, Node};

/// Cuts of each vector, of which [`COMMITTED`] are vectors themselves.
const CUTS: usize = 40;
const COMMITTED: usize = 4;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors")
}

/// The files of a folder of vectors, by name.
fn vectors(folder: &Path) -> Vec<PathBuf> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = paths.filter(|path| path.extension().is_some_and(|end| end == "lodpack")).collect();
    paths.sort();
    paths
}

/// Tiles of which none lies above another, each at one of its resolutions. Implied tiles are drawn by the one above
/// them.
///
/// With the number of each tile's resolution.
fn random_tiles(heights: &Heights<Vec<u8>>, number: usize, random: &mut Random) -> Vec<(CutTile, usize)> {
    let mut tiles = Vec::new();
    let mut pending = heights.roots().to_vec();
    while let Some(id) = pending.pop() {
        let record = heights.record(id).unwrap().unwrap();
        let below: Vec<_> = record.child_tiles().collect();
        if !below.is_empty() && random.below(4) > 0 {
            // Where it lacks a quarter, this is a cut that lacks a part.
            pending.extend(below);
            continue;
        }
        let chosen = random.below(record.resolutions.len() as u64) as usize;
        tiles.push((CutTile { id, resolution: record.resolutions[chosen] }, chosen));
    }
    if number % 4 == 3 {
        tiles.retain(|_| random.below(3) > 0);
    }
    tiles
}

/// The line that `decode.py --cuts` prints of a mesh.
fn line(mesh: &Mesh) -> String {
    // All columns of a pole are one point, up to the sign of zeros.
    let mut bytes: Vec<u8> = mesh.positions.iter().flatten().flat_map(|x| (x + 0.0).to_le_bytes()).collect();
    bytes.extend(mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
    let sum = crc32fast::hash(&bytes);
    format!("{} {} {} {sum:08x}\n", mesh.positions.len(), mesh.triangles.len(), open_edges(mesh))
}

/// The mesh of a cut of heights with its vertices by row and column, and its triangles in ascending order.
fn in_order(heights: &Heights<Vec<u8>>, tiles: Vec<CutTile>) -> Mesh {
    let cut = HeightsCut { tiles, limiter: crate::Limiter::Finest, ..HeightsCut::default() };
    let mesh = heights.mesh(&cut).unwrap();
    let mut order: Vec<usize> = (0..mesh.positions.len()).collect();
    order.sort_by_key(|&vertex| [mesh.samples[vertex][1], mesh.samples[vertex][0]]);
    let mut numbers = vec![0; order.len()];
    (0..).zip(&order).for_each(|(number, &vertex)| numbers[vertex] = number);
    let mut triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| numbers[v as usize])).collect();
    for triangle in &mut triangles {
        let least = (0..3).min_by_key(|&k| triangle[k]).unwrap();
        triangle.rotate_left(least);
    }
    triangles.sort_unstable();
    Mesh { positions: order.iter().map(|&vertex| mesh.positions[vertex]).collect(), triangles, ..Mesh::default() }
}

/// The cuts of a file as JSON, one a line, and what the reader draws of them. Every fourth one lacks parts.
fn drawn(path: &Path) -> (Vec<String>, Vec<String>) {
    let bytes = fs::read(path).unwrap();
    let mut random = Random::new(path.file_name().unwrap().len() as u64);
    let text = |items: Vec<String>| format!("[{}]", items.join(","));
    if path.parent().unwrap().ends_with("heights") {
        let heights = Heights::open(bytes, Limits::default()).unwrap();
        let cut = |number: usize| {
            let tiles = random_tiles(&heights, number, &mut random);
            let of_tile = |(tile, chosen): &(CutTile, usize)| {
                format!("[{},{},{},{chosen}]", tile.id.depth, tile.id.column, tile.id.row)
            };
            let drawn = tiles.iter().map(|&(tile, _)| tile).collect();
            (text(tiles.iter().map(of_tile).collect()), line(&in_order(&heights, drawn)))
        };
        return (0..CUTS).map(cut).unzip();
    }
    let file = File::open(bytes, Limits::default()).unwrap();
    let cut = |number: usize| {
        let mut cut = random_cut(&file, &mut random);
        if number % 4 == 3 {
            cut.nodes.retain(|_| random.below(3) > 0);
        }
        let mesh = file.extract(&cut).unwrap();
        assert_eq!(file.boundary_edge_count(&cut).unwrap(), open_edges(&mesh) as u64, "{}", path.display());
        let of_node = |node: &Node| format!("[{},{}]", node.root, node.level);
        (text(cut.nodes.iter().map(of_node).collect()), line(&mesh))
    };
    (0..CUTS).map(cut).unzip()
}

fn json(cuts: &[String]) -> String {
    format!("[\n{}\n]\n", cuts.join(",\n"))
}

/// Where the committed cuts of a vector are, and what is drawn of them.
fn committed(path: &Path) -> [PathBuf; 2] {
    ["json", "txt"].map(|end| folder().join("cuts").join(path.strip_prefix(folder()).unwrap()).with_extension(end))
}

#[test]
fn both_decoders_draw_random_cuts_of_all_vectors_alike() {
    let temporary = std::env::temp_dir().join(format!("lodpack-mixed-cuts-{}", std::process::id()));
    let mut count = 0;
    for path in [vectors(&folder()), vectors(&folder().join("heights"))].concat() {
        let (cuts, expected) = drawn(&path);
        let [of_cuts, of_meshes] = committed(&path);
        assert_eq!(fs::read_to_string(&of_cuts).unwrap(), json(&cuts[..COMMITTED]), "{}", of_cuts.display());
        assert_eq!(fs::read_to_string(&of_meshes).unwrap(), expected[..COMMITTED].concat(), "{}", of_meshes.display());
        fs::write(&temporary, json(&cuts)).unwrap();
        let decoder = folder().join("../decode.py");
        let output = Command::new("python3").arg(decoder).arg("--cuts").arg(&temporary).arg(&path).output().unwrap();
        assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
        let mut differing = String::new();
        for ((cut, own), other) in cuts.iter().zip(&expected).zip(String::from_utf8_lossy(&output.stdout).lines()) {
            if own.trim_end() != other {
                let _ = writeln!(differing, "{cut}: {}, and decode.py {other}", own.trim_end());
            }
        }
        assert!(differing.is_empty(), "{}:\n{differing}", path.display());
        assert_eq!(String::from_utf8_lossy(&output.stdout).lines().count(), CUTS, "{}", path.display());
        count += CUTS;
    }
    fs::remove_file(&temporary).unwrap();
    assert!(count >= 1_000, "only {count} cuts");
}

/// Run it with `--ignored` when the format changes.
#[test]
#[ignore = "writes the vectors anew"]
fn write_cuts() {
    for path in [vectors(&folder()), vectors(&folder().join("heights"))].concat() {
        let (cuts, expected) = drawn(&path);
        let [of_cuts, of_meshes] = committed(&path);
        fs::create_dir_all(of_cuts.parent().unwrap()).unwrap();
        fs::write(of_cuts, json(&cuts[..COMMITTED])).unwrap();
        fs::write(of_meshes, expected[..COMMITTED].concat()).unwrap();
    }
}
