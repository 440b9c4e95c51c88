//! `lodpack info --objects`

use super::super::open::{Source, in_file};
use super::Nodes;
use crate::output::{count, say};
use anyhow::Result;
use lodpack::islands;
use lodpack_cli::text::line;
use serde::Serialize;
use std::path::Path;

/// Characters of a name, an id or a path that are shown.
const SHOWN: usize = 120;

/// An object or an assembly.
#[derive(Serialize)]
pub struct Listed {
    number: u32,
    name: Option<String>,
    id: Option<String>,
    /// The number of what it is a part of.
    parent: Option<u32>,
    /// The names of all above it, from the top down, joined by slashes.
    path: String,
    /// How many leaves hold it; none for assemblies.
    leaves: Option<u64>,
    /// Its triangles at the finest level; none for assemblies.
    triangles: Option<u64>,
}

/// Everything that the input named, with what each object has at the finest level.
pub fn collect(path: &Path, file: &lodpack::File<Source>) -> Result<Option<Vec<Listed>>> {
    let Some((nodes, objects)) = Nodes::read(path, file)?.zip(file.objects()) else { return Ok(None) };
    let mut sums = vec![[0_u64; 2]; nodes.objects as usize];
    for root in 0..file.root_count() {
        if !in_file(path, file.children(root))?.is_empty() {
            continue;
        }
        let of_leaf = in_file(path, objects.of_leaf(root))?;
        let blocks = in_file(path, file.root_contents(root))?.blocks;
        let Some(finest) = blocks.last() else { continue };
        for &object in &of_leaf {
            sums.get_mut(object as usize).into_iter().for_each(|sum| sum[0] += 1);
        }
        if let [only] = of_leaf[..] {
            sums.get_mut(only as usize).into_iter().for_each(|sum| sum[1] += u64::from(finest.triangle_count));
            continue;
        }
        let owners = in_file(path, objects.owners(root, finest.level))?;
        let patch = in_file(path, file.decode_root(root, finest.level))?.patch;
        for island in islands(&patch.triangles).0 {
            let owner = owners.get(island as usize).and_then(|&owner| sums.get_mut(owner as usize));
            owner.into_iter().for_each(|sum| sum[1] += 1);
        }
    }
    let listed = |(number, node): (u32, &lodpack::objects::ObjectNode)| {
        let sum = sums.get(number as usize);
        Listed {
            number,
            name: node.name.clone(),
            id: node.id.clone(),
            parent: node.parent,
            path: nodes.path_above(number),
            leaves: sum.map(|sum| sum[0]),
            triangles: sum.map(|sum| sum[1]),
        }
    };
    Ok(Some(nodes.known.iter().map(|(&number, node)| (number, node)).map(listed).collect()))
}

/// Prints a line for each.
pub fn print(listed: &[Listed]) -> Result<()> {
    say!("  number     leaves  triangles  name, id, where");
    for Listed { number, name, id, path, leaves, triangles, .. } in listed {
        let shown = |text: &Option<String>| text.as_ref().map_or("-".into(), |text| line(text, SHOWN));
        let number_of = |sum: &Option<u64>| sum.map_or("-".to_string(), count);
        let (leaves, triangles) = (number_of(leaves), number_of(triangles));
        let place = if path.is_empty() { String::new() } else { format!("  in {}", line(path, SHOWN)) };
        say!("  #{number:<9} {leaves:>6} {triangles:>10}  {}  {}{place}", shown(name), shown(id));
    }
    Ok(())
}
