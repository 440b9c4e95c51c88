//! Owners on their way into a file: numbers of nodes of the model, which the output numbers anew.

use crate::{
    codec::bytes::{Cursor, put_varint},
    error::{Error, Result},
    format::index_block::RootEntry,
};

/// Who owns the islands of a block, and its triangles.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct BlockOwners {
    pub triangles: u32,
    pub owners: Vec<u32>,
}

/// Owners as bytes.
pub(super) fn to_bytes(owners: &[u32]) -> Vec<u8> {
    let mut bytes = vec![];
    owners.iter().for_each(|&owner| put_varint(&mut bytes, owner.into()));
    bytes
}

/// The owners of each block of each leaf of a cluster, from those of each block as bytes.
pub(super) fn of_leaves<'b>(
    entries: &[RootEntry],
    owners_of: impl Fn(usize) -> &'b [u8],
) -> Result<Vec<Vec<BlockOwners>>> {
    let (mut leaves, mut next) = (vec![], 0);
    for entry in entries {
        let first = next;
        next += entry.blocks.len();
        if entry.child_count > 0 {
            if (first..next).any(|block| !owners_of(block).is_empty()) {
                return Err(Error::model("a group has owners; only its leaves have"));
            }
            continue;
        }
        let of_block = |(block, entry): (usize, &crate::format::index_block::BlockEntry)| {
            let mut cursor = Cursor::new(owners_of(block));
            let mut owners = vec![];
            while cursor.left() > 0 {
                owners.push(cursor.varint_up_to(u32::MAX.into(), "an owner exceeds 32 bits")? as u32);
            }
            Ok(BlockOwners { triangles: entry.triangle_count, owners })
        };
        leaves.push((first..next).zip(&entry.blocks).map(of_block).collect::<Result<_>>()?);
    }
    Ok(leaves)
}

/// Checks that each island of a file with objects has an owner, as far as triangles tell.
pub(super) fn check(leaves: &[Vec<BlockOwners>]) -> Result<()> {
    for block in leaves.iter().flatten() {
        if block.owners.is_empty() != (block.triangles == 0) || block.owners.len() > block.triangles as usize {
            let (owners, triangles) = (block.owners.len(), block.triangles);
            return Err(Error::model(format!("a block of {triangles} triangles has {owners} owners of islands")));
        }
    }
    Ok(())
}
