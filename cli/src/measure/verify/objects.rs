//! Objects one by one: each must be there, under the names that the input has for it, and as near to its own triangles
//! as its leaves say. The check of errors would not notice if two bolts had changed their names.

use super::distance::{Goal, largest_distance};
use super::tree::BoxTree;
use super::{Problem, VerifyReport};
use crate::mesh::Mesh;
use crate::mesh::attributes::ObjectNode;
use crate::progress::Progress;
use glam::DVec3;
use lodpack::{File, Query, ReadAt};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Coordinates are rounded: distances may be larger by this share of the largest coordinate.
const ROUNDING: f64 = 1e-12;
/// Problems that are listed.
const MOST_PROBLEMS: usize = 100;

/// A repaired input with its objects.
pub struct NamedMesh<'a> {
    /// Its surface.
    pub mesh: &'a Mesh,
    /// The node of each triangle.
    pub objects: &'a [u32],
    /// Objects and assemblies.
    pub nodes: &'a [ObjectNode],
    /// How many of the names above objects, from the top on, need not be alike.
    pub skipped: usize,
}

/// Names of all above and its own, joined by line ends, and its id.
type Key = (String, Option<String>);

/// Triangles of all objects of a key, and what they may be off by.
#[derive(Default)]
struct Part {
    triangles: Vec<[u32; 3]>,
    error: f64,
}

/// Compares the objects of a file's finest cut with those of its input, and adds what differs to the report.
///
/// # Errors
///
/// [`lodpack::Error`] if the file cannot be read.
pub fn verify_objects<R: ReadAt>(
    file: &File<R>,
    against: &NamedMesh<'_>,
    report: &mut VerifyReport,
    progress: &dyn Progress,
) -> lodpack::Result<()> {
    let Some(objects) = file.objects() else { return Ok(()) };
    progress.begin("objects", 0);
    let nodes = objects.nodes()?;
    let cut = file.select(&Query::default())?;
    let (mesh, of_triangles) = file.extract_objects(&cut)?;
    let positions: Vec<DVec3> = mesh.positions.iter().map(|&position| DVec3::from(position)).collect();
    let mut stored: BTreeMap<Key, Part> = BTreeMap::new();
    let mut keys: BTreeMap<u32, Key> = BTreeMap::new();
    for ((&triangle, &object), &node) in mesh.triangles.iter().zip(&of_triangles).zip(&mesh.triangle_nodes) {
        let key = keys.entry(object).or_insert_with(|| key_of(object, &nodes, against.skipped));
        let part = stored.entry(key.clone()).or_default();
        part.triangles.push(triangle);
        part.error = part.error.max(cut.node_errors.get(node as usize).copied().unwrap_or(cut.error));
    }
    let mut expected: BTreeMap<Key, Part> = BTreeMap::new();
    let mut of_input: BTreeMap<u32, Key> = BTreeMap::new();
    for (&triangle, &object) in against.mesh.triangles.iter().zip(against.objects) {
        let key = of_input.entry(object).or_insert_with(|| key_of(object, against.nodes, against.skipped));
        expected.entry(key.clone()).or_default().triangles.push(triangle);
    }
    report.objects = keys.len() as u64;
    let missing = expected.keys().filter(|key| !stored.contains_key(*key)).map(|key| (key, "the file lacks it"));
    let unknown = stored.keys().filter(|key| !expected.contains_key(*key)).map(|key| (key, "the input lacks it"));
    let problem = |(key, what): (&Key, &str)| Problem { location: shown(key), what: what.into() };
    let mut problems: Vec<Problem> = missing.chain(unknown).map(problem).collect();
    let rounding = ROUNDING * file.bounds().into_iter().flatten().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
    let compared: Vec<Option<Problem>> = expected
        .par_iter()
        .filter_map(|(key, input)| Some((key, input, stored.get(key)?)))
        .map(|(key, input, part)| {
            let claim = part.error + rounding;
            let goal = Goal { floor: claim, claim, ..Goal::default() };
            let of_input = BoxTree::new(&against.mesh.positions, &input.triangles);
            let of_file = BoxTree::new(&positions, &part.triangles);
            let there = largest_distance(&positions, &part.triangles, &of_input, &goal).lower;
            let back = largest_distance(&against.mesh.positions, &input.triangles, &of_file, &goal).lower;
            let far = there.max(back);
            let what = format!("it is {far:.4e} off its triangles in the input, and {:.4e} is stored", part.error);
            (far > claim).then(|| Problem { location: shown(key), what })
        })
        .collect();
    problems.extend(compared.into_iter().flatten());
    problems.truncate(MOST_PROBLEMS);
    report.problems.extend(problems);
    Ok(())
}

fn key_of(object: u32, nodes: &[ObjectNode], skipped: usize) -> Key {
    let mut names = vec![];
    let mut next = nodes.get(object as usize);
    let id = next.and_then(|node| node.id.clone());
    // A file may lie about its tree.
    while let Some(node) = next.filter(|_| names.len() <= nodes.len()) {
        names.push(node.name.as_deref().unwrap_or_default());
        next = node.parent.and_then(|parent| nodes.get(parent as usize));
    }
    names.reverse();
    (names.get(skipped..).unwrap_or_default().join("\n"), id)
}

fn shown((names, id): &Key) -> String {
    let names = names.replace('\n', "/");
    match id {
        Some(id) => format!("object {names:?}, id {id:?}"),
        None => format!("object {names:?}"),
    }
}
