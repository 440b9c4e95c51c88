//! A page of owners: the objects of a cluster's leaves, and of each island the one that it belongs to (SPEC.md, "Pages
//! of owners").

use super::bits::Bits;
#[cfg(feature = "write")]
use crate::codec::texels::binary::BitEncoder;
use crate::{
    codec::texels::binary::{BitDecoder, Chance, NumberChances},
    error::{Error, Result},
    limits::{Limits, within},
};

/// A leaf as the index describes it: level and triangles of each block.
pub(crate) type LeafShape = Vec<(u8, u32)>;

/// Who owns a leaf.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct LeafOwners {
    /// Its objects, each once.
    pub objects: Vec<u32>,
    /// For each block its islands.
    pub blocks: Vec<Islands>,
}

/// Who owns the islands of a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Islands {
    /// All belong to the leaf's only object.
    All(u32),
    /// For each its object, by number within the leaf.
    Each(Vec<u32>),
}

impl LeafOwners {
    /// The object of each island of a block.
    pub fn of_block(&self, block: usize) -> Vec<u32> {
        let object = |&local: &u32| self.objects.get(local as usize).copied().unwrap_or(0);
        match self.blocks.get(block) {
            Some(Islands::All(count)) => vec![object(&0); *count as usize],
            Some(Islands::Each(locals)) => locals.iter().map(object).collect(),
            None => vec![],
        }
    }
}

/// The chances of a page.
#[derive(Default)]
struct Chances {
    count: NumberChances,
    is_new: [Chance; 2],
    back: NumberChances,
    islands: [NumberChances; 2],
    is_next: [Chance; 3],
    is_same: [Chance; 3],
    other: NumberChances,
}

/// Writes a page of leaves whose objects have their numbers; `next` is the first number that no leaf before has.
#[cfg(feature = "write")]
pub(super) fn write(leaves: &[LeafOwners], next: u32) -> Result<Vec<u8>> {
    let mut bits = BitEncoder::new();
    let (mut chances, mut next) = (Chances::default(), next);
    for leaf in leaves {
        let blocks: Vec<u32> = vec![u32::MAX; leaf.blocks.len()];
        code(&mut bits, leaf, &blocks, &mut chances, &mut next, &mut u64::MAX.clone())?;
    }
    Ok(bits.finish())
}

/// Reads a page of leaves. Returns what they own, and the first object number after theirs.
pub(super) fn parse(
    bytes: &[u8],
    shapes: &[LeafShape],
    first: u32,
    count: u32,
    limits: &Limits,
) -> Result<(Vec<LeafOwners>, u32)> {
    let mut bits = BitDecoder::new(bytes);
    let (mut chances, mut next, mut room) = (Chances::default(), first, limits.cluster_record_count);
    let mut leaves = Vec::new();
    for shape in shapes {
        let triangles: Vec<u32> = shape.iter().map(|&(_, triangles)| triangles).collect();
        leaves.push(code(&mut bits, &LeafOwners::default(), &triangles, &mut chances, &mut next, &mut room)?);
        if next > count {
            return Err(beyond());
        }
    }
    bits.finish()?;
    Ok((leaves, next))
}

fn code(
    bits: &mut impl Bits,
    given: &LeafOwners,
    triangles: &[u32],
    chances: &mut Chances,
    next: &mut u32,
    room: &mut u64,
) -> Result<LeafOwners> {
    let mut take = |count: u32| {
        within(*room, count.into(), "number of objects and islands of a cluster")?;
        *room -= u64::from(count);
        Ok::<_, Error>(())
    };
    let mut leaf = LeafOwners::default();
    let count = bits.number(&mut chances.count, given.objects.len() as u32)?;
    take(count)?;
    let mut was_new = true;
    for number in 0..count as usize {
        let object = given.objects.get(number).copied().unwrap_or(0);
        was_new = bits.bit(&mut chances.is_new[usize::from(was_new)], object == *next);
        let object = if was_new {
            *next = next.checked_add(1).ok_or_else(beyond)?;
            *next - 1
        } else {
            let back = bits.number(&mut chances.back, next.wrapping_sub(object).wrapping_sub(1))?;
            next.checked_sub(back).and_then(|next| next.checked_sub(1)).ok_or_else(beyond)?
        };
        bits.check()?;
        leaf.objects.push(object);
    }
    let mut before = count;
    for (block, &triangles) in triangles.iter().enumerate() {
        let islands = given.blocks.get(block);
        let found = islands.map_or(0, |islands| match islands {
            Islands::All(count) => *count,
            Islands::Each(locals) => locals.len() as u32,
        });
        let step = bits.signed(&mut chances.islands[usize::from(block > 0)], found.wrapping_sub(before) as i32)?;
        let found = u32::try_from(i64::from(before) + i64::from(step)).ok().filter(|&found| found <= triangles);
        let found =
            found.ok_or_else(|| Error::format("a block has more islands than triangles, or fewer than none"))?;
        if count == 0 && found > 0 {
            return Err(Error::format("an island has no owner"));
        }
        before = found;
        if count < 2 {
            leaf.blocks.push(Islands::All(found));
            continue;
        }
        take(found)?;
        let mut locals = Vec::new();
        let (mut last, mut way) = (-1_i64, 0);
        for island in 0..found as usize {
            let wanted = match islands {
                Some(Islands::Each(locals)) => locals.get(island).copied().map_or(0, i64::from),
                _ => 0,
            };
            if bits.bit(&mut chances.is_next[way], wanted == last + 1) {
                (last, way) = (last + 1, 0);
            } else if bits.bit(&mut chances.is_same[way], wanted == last) {
                way = 1;
            } else {
                (last, way) = (last + i64::from(bits.signed(&mut chances.other, (wanted - last) as i32)?), 2);
            }
            bits.check()?;
            if !(0..i64::from(count)).contains(&last) {
                return Err(Error::format("an island belongs to an object that its leaf does not have"));
            }
            locals.push(last as u32);
        }
        leaf.blocks.push(Islands::Each(locals));
    }
    Ok(leaf)
}

fn beyond() -> Error {
    Error::format("an owner is beyond the number of objects")
}
