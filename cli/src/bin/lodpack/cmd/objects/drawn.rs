//! Objects that `lodpack extract` writes apart: those of a cut, or some that are named, each leaf at a level of its
//! own.

use super::super::open::{Source, in_file};
use super::Nodes;
use crate::output::count;
use anyhow::{Result, bail};
use lodpack::decode::TexturedMesh;
use lodpack::{Cut, Mesh, Node};
use lodpack_cli::mesh::objects::{ObjectPart, picked};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// What is asked for.
pub struct Wanted<'a> {
    pub path: &'a Path,
    pub patterns: &'a [String],
    /// In units of the file.
    pub tolerance: Option<f64>,
    pub triangles: Option<u64>,
    /// Channels of the look that is written.
    pub channels: &'a [u8],
}

/// The triangles of some objects, object after object.
pub struct DrawnObjects {
    pub mesh: Mesh,
    pub textured: Option<TexturedMesh>,
    pub cut: Cut,
    /// The objects, and what lies above them.
    pub parts: Vec<ObjectPart>,
}

/// Finds and draws what is wanted.
pub fn drawn_of(file: &lodpack::File<Source>, wanted: &Wanted<'_>) -> Result<DrawnObjects> {
    let path = wanted.path;
    let Some(((nodes, found), objects)) = Nodes::found(path, file, wanted.patterns)?.zip(file.objects()) else {
        bail!("{}: it has no objects; build it with --objects keep, or omit --object", path.display());
    };
    let mut leaves = BTreeSet::new();
    for &object in &found {
        leaves.extend(in_file(path, objects.leaves(object))?);
    }
    let levels = file.level_count() as u8;
    // The finest that the budget allows, if there is one.
    for finest in (0..levels).rev() {
        let cut = cut_of(file, wanted, &leaves, finest)?;
        let (mesh, of_triangles) = in_file(path, file.extract_objects(&cut))?;
        let kept = of_triangles.iter().filter(|object| found.contains(object)).count() as u64;
        if wanted.triangles.is_some_and(|most| kept > most) && finest > 0 {
            continue;
        }
        if let Some(most) = wanted.triangles.filter(|&most| kept > most) {
            bail!(
                "{}: the leaves of these objects have {} triangles at their coarsest level; ask for more than {} with \
                 --triangles",
                path.display(),
                count(kept),
                count(most)
            );
        }
        let textured = match wanted.channels {
            [] => None,
            channels => Some(in_file(path, file.extract_textured(&cut, channels))?),
        };
        return Ok(arranged(&mesh, textured, cut, &of_triangles, &found, &nodes));
    }
    bail!("{}: it has no level", path.display())
}

/// Whether no group is drawn: these show several objects as one.
pub fn is_of_leaves(path: &Path, file: &lodpack::File<Source>, cut: &Cut) -> Result<bool> {
    for node in &cut.nodes {
        if !in_file(path, file.children(node.root))?.is_empty() {
            return Ok(false);
        }
    }
    Ok(true)
}

/// All objects of a cut of leaves, with its look if they have one.
pub fn of_cut(
    path: &Path,
    file: &lodpack::File<Source>,
    cut: &Cut,
    textured: Option<TexturedMesh>,
) -> Result<DrawnObjects> {
    let Some(nodes) = Nodes::read(path, file)? else { bail!("{}: it has no objects", path.display()) };
    let (mesh, of_triangles) = in_file(path, file.extract_objects(cut))?;
    let found = of_triangles.iter().copied().collect();
    Ok(arranged(&mesh, textured, cut.clone(), &of_triangles, &found, &nodes))
}

/// A filter that hides what patterns name, if there are any.
pub fn hiding(
    file: &lodpack::File<Source>,
    path: &Path,
    patterns: &[String],
) -> Result<Option<Arc<lodpack::objects::ObjectFilter>>> {
    if patterns.is_empty() {
        return Ok(None);
    }
    let Some((_, found)) = Nodes::found(path, file, patterns)? else {
        bail!("{}: it has no objects; build it with --objects keep, or omit --hide", path.display());
    };
    let found: Vec<u32> = found.into_iter().collect();
    Ok(Some(in_file(path, file.hide(&found))?))
}

/// The level of each leaf: the coarsest within the tolerance, and none finer than `finest` unless it has no other.
fn cut_of(file: &lodpack::File<Source>, wanted: &Wanted<'_>, leaves: &BTreeSet<u32>, finest: u8) -> Result<Cut> {
    let mut cut = Cut { file: Some(file.index().id()), ..Cut::default() };
    for &root in leaves {
        let blocks = in_file(wanted.path, file.root_contents(root))?.blocks;
        let error = |block: &lodpack::index::BlockContents| block.error + block.border_deviation;
        let is_near = |block: &&lodpack::index::BlockContents| {
            block.level <= finest && wanted.tolerance.is_some_and(|tolerance| error(block) <= tolerance)
        };
        let finest = blocks.iter().rev().find(|block| block.level <= finest).or(blocks.first());
        let Some(block) = blocks.iter().find(is_near).or(finest) else { continue };
        cut.nodes.push(Node { root, level: block.level });
        cut.node_errors.push(error(block));
        cut.error = cut.error.max(error(block));
    }
    Ok(cut)
}

/// Keeps the triangles of what was found, object after object.
fn arranged(
    mesh: &Mesh,
    textured: Option<TexturedMesh>,
    cut: Cut,
    of_triangles: &[u32],
    found: &BTreeSet<u32>,
    nodes: &Nodes,
) -> DrawnObjects {
    let mut order: Vec<(u32, usize)> =
        of_triangles.iter().enumerate().filter(|(_, object)| found.contains(object)).map(|(at, &o)| (o, at)).collect();
    order.sort_unstable();
    let kept = picked(mesh, order.iter().map(|&(_, at)| at));
    let textured = textured.map(|whole| TexturedMesh {
        places: order.iter().map(|&(_, at)| whole.places[at]).collect(),
        mesh: kept.clone(),
        ..whole
    });
    // All that lies above an object comes before it.
    let mut parts: Vec<ObjectPart> = vec![];
    let mut numbers: BTreeMap<u32, usize> = BTreeMap::new();
    for &object in found {
        for number in nodes.above(object).into_iter().chain([object]) {
            if numbers.contains_key(&number) {
                continue;
            }
            let Some(node) = nodes.known.get(&number) else { continue };
            numbers.insert(number, parts.len());
            let first = order.partition_point(|&(other, _)| other < number);
            let end = order.partition_point(|&(other, _)| other <= number);
            parts.push(ObjectPart {
                name: node.name.clone(),
                id: node.id.clone(),
                parent: node.parent.and_then(|parent| numbers.get(&parent).copied()),
                triangles: first..end,
            });
        }
    }
    DrawnObjects { mesh: kept, textured, cut, parts }
}
