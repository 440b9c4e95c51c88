//! What an index block says of roots and arcs, as symbols. Each pair of parentheses is one symbol:
//!
//! - per root (loops * fillings of the file + place of the root's filling among them), per loop (its number of
//!   half-arcs), per half-arc (2 d + reversed), where d = 0 names the cluster's next new arc and d > 0 the arc d below
//!   it;
//! - the root's box in 1/255 of the cluster's, rounded outward: per axis (low), then per axis (high - low);
//! - (its number of children);
//! - (its levels: bit k stands for level k);
//! - per level that it has (error), (border deviation), (triangle count), (whether the block begins a stream);
//! - per arc two corners (d, as for arcs), each followed by (the coarsest level at which it is a vertex) where it is
//!   new, then per level (new samples).
//!
//! An error is an [`ErrorCode`], stored as 0 if it is 0, otherwise as 1 + zigzag(code - code of the level's tolerance).
//! A deviation is stored likewise, relative to the block's error.

use super::{BlockEntry, ClusterIndex, RootEntry, contexts};
use crate::{
    codec::{
        arc::PARAM_END,
        entropy::{SymbolBuffer, SymbolSource, context::Context, unzigzag, zigzag},
    },
    error::{Error, Result},
    format::{clusters::Cluster, error_code::ErrorCode, levels::FillingSteps, records::HalfArc},
    lattice::LatticePoint,
    limits::{Limits, within},
};

impl ClusterIndex {
    /// The records as symbols.
    ///
    /// # Errors
    /// [`Error::Model`] if arcs or corners are not numbered as they are used.
    pub(crate) fn records(
        &self,
        cluster: &Cluster,
        fillings: &[FillingSteps],
        tolerances: &[ErrorCode],
    ) -> Result<SymbolBuffer> {
        let mut symbols = SymbolBuffer::default();
        let mut next_arc = cluster.first_arc;
        for root in &self.roots {
            let filling = fillings.iter().position(|steps| steps.filling == root.filling);
            let filling = filling.ok_or_else(|| Error::model("a root has a filling that the file does not list"))?;
            symbols.put(contexts::ROOT, (fillings.len() * root.loops.len() + filling) as u64);
            for half_arcs in &root.loops {
                symbols.put(contexts::LOOP, half_arcs.len() as u64);
                for half_arc in half_arcs {
                    let distance = reference(&mut next_arc, half_arc.arc)?;
                    symbols.put(contexts::HALF_ARC, 2 * distance + u64::from(half_arc.reversed));
                }
            }
            let [low, high] = box_codes(root.bounds, cluster.bounds);
            low.iter().for_each(|&x| symbols.put(contexts::BOX, x));
            (0..3).for_each(|axis| symbols.put(contexts::BOX, high[axis] - low[axis]));
            symbols.put(contexts::CHILDREN, u64::from(root.child_count));
            symbols.put(contexts::LEVELS, root.blocks.iter().fold(0, |set, block| set | 1_u64 << block.level));
            for block in &root.blocks {
                put_code(&mut symbols, contexts::ERROR, block.error, tolerances[usize::from(block.level)]);
                put_code(&mut symbols, contexts::DEVIATION, block.border_deviation, block.error);
                symbols.put(contexts::TRIANGLES, u64::from(block.triangle_count));
                symbols.put(contexts::STREAM, u64::from(block.begins_stream));
            }
        }
        let mut next_corner = cluster.first_corner;
        let (mut corner_levels, mut before) = (self.corner_levels.iter(), 0);
        for (arc, ends) in (0..).zip(&self.arc_ends) {
            for &end in ends {
                let distance = reference(&mut next_corner, end)?;
                symbols.put(contexts::ARC_END, distance);
                if distance == 0 {
                    let level = corner_levels.next().copied().unwrap_or(0);
                    symbols.put(contexts::CORNER_LEVEL[usize::from(before == 0)], u64::from(level));
                    before = level;
                }
            }
            for level in 0..self.level_count as u8 {
                let context = self.sample_context(arc, level);
                symbols.put(context, u64::from(self.new_sample_count(arc, level)));
            }
        }
        Ok(symbols)
    }

    fn sample_context(&self, arc: u32, level: u8) -> Context {
        match level {
            0 => contexts::FIRST_SAMPLES,
            _ => contexts::SAMPLES[usize::from(self.new_sample_count(arc, level - 1) > 0)],
        }
    }

    pub(super) fn parse_records(
        symbols: &mut impl SymbolSource,
        cluster: &Cluster,
        fillings: &[FillingSteps],
        tolerances: &[ErrorCode],
        limits: &Limits,
    ) -> Result<Self> {
        let mut budget = Budget { left: limits.cluster_record_count, limits };
        let mut next_arc = cluster.first_arc;
        let mut roots = Vec::with_capacity(cluster.root_count as usize);
        let mut child_count = 0_u32;
        for number in cluster.first_root..cluster.first_root.saturating_add(cluster.root_count) {
            let root = parse_root(symbols, cluster, &mut next_arc, (fillings, tolerances), &mut budget)?;
            if root.child_count > 0 && cluster.first_child.saturating_add(child_count) <= number {
                return Err(Error::format("a root is its own child, or comes after it"));
            }
            child_count = child_count.saturating_add(root.child_count);
            roots.push(root);
        }
        if child_count != cluster.child_count {
            return Err(Error::format("a cluster's roots have more or fewer children than it says"));
        }
        if Some(next_arc) != cluster.first_arc.checked_add(cluster.arc_count) {
            return Err(Error::format("a cluster's roots use more or fewer new arcs than it has"));
        }
        let level_count = tolerances.len();
        let mut next_corner = cluster.first_corner;
        let mut arc_ends = Vec::new();
        let mut new_samples = Vec::new();
        let (mut corner_levels, mut before) = (Vec::new(), 0);
        for _ in 0..cluster.arc_count {
            budget.spend(1)?;
            let mut ends = [0; 2];
            for end in &mut ends {
                let distance = symbols.get(contexts::ARC_END)?;
                *end = resolve(&mut next_corner, distance)?;
                if distance == 0 {
                    before = symbols.get(contexts::CORNER_LEVEL[usize::from(before == 0)])?;
                    if before >= level_count as u64 {
                        return Err(Error::format("a corner has a level that the file does not have"));
                    }
                    corner_levels.push(before as u8);
                }
            }
            if ends[0] == ends[1] {
                return Err(Error::format("both ends of an arc are the same corner"));
            }
            arc_ends.push(ends);
            let (mut total, mut coarser) = (0_u64, 0);
            for level in 0..level_count {
                let context =
                    if level == 0 { contexts::FIRST_SAMPLES } else { contexts::SAMPLES[usize::from(coarser > 0)] };
                coarser = symbols.get(context)?;
                total = total.saturating_add(coarser);
                if total >= u64::from(PARAM_END) {
                    return Err(Error::format("an arc has more than 65535 samples"));
                }
                new_samples.push(coarser as u32);
            }
            budget.spend(total)?;
        }
        if Some(next_corner) != cluster.first_corner.checked_add(cluster.corner_count) {
            return Err(Error::format("a cluster's arcs use more or fewer new corners than it has"));
        }
        Ok(Self { corner_levels, ..Self::new(roots, arc_ends, &new_samples, level_count) })
    }
}

/// The number of records that a cluster may still have.
struct Budget<'a> {
    left: u64,
    limits: &'a Limits,
}

impl Budget<'_> {
    fn spend(&mut self, count: u64) -> Result<()> {
        let limit = self.limits.cluster_record_count;
        within(self.left, count, "number of records of a cluster").map_err(|error| match error {
            Error::Limit { what, .. } => Error::Limit { what, found: (limit - self.left).saturating_add(count), limit },
            other => other,
        })?;
        self.left -= count;
        Ok(())
    }
}

fn parse_root(
    symbols: &mut impl SymbolSource,
    cluster: &Cluster,
    next_arc: &mut u32,
    (fillings, tolerances): (&[FillingSteps], &[ErrorCode]),
    budget: &mut Budget<'_>,
) -> Result<RootEntry> {
    let head = symbols.get(contexts::ROOT)?;
    let filling_count = fillings.len() as u64;
    let place = head.checked_rem(filling_count).ok_or_else(|| Error::format("a root has no filling"))?;
    let filling = fillings[place as usize].filling;
    let mut loops = Vec::new();
    for _ in 0..head / filling_count {
        let length = symbols.get(contexts::LOOP)?;
        if length < 2 {
            return Err(Error::format("a loop has fewer than two half-arcs"));
        }
        budget.spend(length)?;
        let mut half_arcs = Vec::new();
        for _ in 0..length {
            let value = symbols.get(contexts::HALF_ARC)?;
            half_arcs.push(HalfArc { arc: resolve(next_arc, value / 2)?, reversed: value % 2 == 1 });
        }
        loops.push(half_arcs);
    }
    let mut codes = [[0; 3]; 2];
    for axis in 0..3 {
        codes[0][axis] = symbols.get(contexts::BOX)?;
    }
    for axis in 0..3 {
        codes[1][axis] = codes[0][axis].saturating_add(symbols.get(contexts::BOX)?);
    }
    if codes[1].iter().any(|&code| code > 255) {
        return Err(Error::format("a root's box leaves its cluster's"));
    }
    let child_count = u32::try_from(symbols.get(contexts::CHILDREN)?)
        .map_err(|_| Error::format("a root has more than 2^32 children"))?;
    let levels = symbols.get(contexts::LEVELS)?;
    if levels >> tolerances.len() != 0 {
        return Err(Error::format("a root has a level that the file does not have"));
    }
    if levels == 0 {
        return Err(Error::format("a root has no level"));
    }
    let mut blocks = Vec::new();
    for (level, &tolerance) in (0..).zip(tolerances) {
        if levels >> level & 1 == 0 {
            continue;
        }
        let error = get_code(symbols, contexts::ERROR, tolerance)?;
        let border_deviation = get_code(symbols, contexts::DEVIATION, error)?;
        let triangle_count = u32::try_from(symbols.get(contexts::TRIANGLES)?)
            .map_err(|_| Error::format("a block has more than 2^32 triangles"))?;
        let begins_stream = match symbols.get(contexts::STREAM)? {
            flag @ 0..=1 => flag == 1,
            _ => return Err(Error::format("a stream flag is above 1")),
        };
        blocks.push(BlockEntry { level, error, border_deviation, triangle_count, begins_stream });
    }
    Ok(RootEntry { filling, loops, bounds: box_of_codes(codes, cluster.bounds), child_count, blocks })
}

/// How far an arc or corner lies below the next new one; 0 for the next new one itself.
fn reference(next: &mut u32, id: u32) -> Result<u64> {
    let distance =
        next.checked_sub(id).ok_or_else(|| Error::model("an arc or corner is used before it has a number"))?;
    *next += u32::from(distance == 0);
    Ok(u64::from(distance))
}

/// The inverse of [`reference`].
fn resolve(next: &mut u32, distance: u64) -> Result<u32> {
    let id = u64::from(*next).checked_sub(distance).ok_or_else(|| Error::format("a reference leaves the file"))?;
    if distance == 0 {
        *next = next.checked_add(1).ok_or_else(|| Error::format("there are too many arcs or corners"))?;
    }
    Ok(id as u32)
}

fn put_code(symbols: &mut SymbolBuffer, context: Context, code: ErrorCode, expected: ErrorCode) {
    let difference = i64::from(code.0) - i64::from(expected.0);
    symbols.put(context, if code.0 == 0 { 0 } else { 1 + zigzag(difference) });
}

fn get_code(symbols: &mut impl SymbolSource, context: Context, expected: ErrorCode) -> Result<ErrorCode> {
    let Some(value) = symbols.get(context)?.checked_sub(1) else { return Ok(ErrorCode(0)) };
    let code = i64::from(expected.0).checked_add(unzigzag(value)).and_then(|code| u16::try_from(code).ok());
    code.filter(|&code| code > 0).map(ErrorCode).ok_or_else(|| Error::format("an error code leaves its range"))
}

/// A box within an outer one, in 1/255 of the outer extents, rounded outward.
fn box_codes([low, high]: [LatticePoint; 2], [outer_low, outer_high]: [LatticePoint; 2]) -> [[u64; 3]; 2] {
    let mut codes = [[0; 3]; 2];
    for axis in 0..3 {
        let extent = outer_high[axis] - outer_low[axis];
        if extent > 0 {
            let ceiling = |x: i64| (x * 255 + extent - 1) / extent;
            codes[0][axis] = ((low[axis] - outer_low[axis]) * 255 / extent) as u64;
            codes[1][axis] = ceiling(high[axis] - outer_low[axis]) as u64;
        }
    }
    codes
}

/// The box of codes up to 255: low = outer low + floor(extent code / 255), high likewise rounded up.
fn box_of_codes(codes: [[u64; 3]; 2], [outer_low, outer_high]: [LatticePoint; 2]) -> [LatticePoint; 2] {
    let mut bounds = [outer_low; 2];
    for axis in 0..3 {
        let extent = outer_high[axis] - outer_low[axis];
        bounds[0][axis] += extent * codes[0][axis] as i64 / 255;
        bounds[1][axis] += (extent * codes[1][axis] as i64 + 254) / 255;
    }
    bounds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{entropy::Replay, filling::Filling};

    #[test]
    fn boxes_are_rounded_outward_and_stable() {
        let outer = [[-1000, 5, 1 << 30], [123_456, 5, 1 << 40]];
        let inner = [[-999, 5, (1 << 30) + 12345], [70_000, 5, (1 << 39) + 1]];
        let decoded = box_of_codes(box_codes(inner, outer), outer);
        for axis in 0..3 {
            assert!(decoded[0][axis] <= inner[0][axis] && inner[1][axis] <= decoded[1][axis]);
            assert!(outer[0][axis] <= decoded[0][axis] && decoded[1][axis] <= outer[1][axis]);
            assert!(inner[0][axis] - decoded[0][axis] <= (outer[1][axis] - outer[0][axis]) / 255 + 1);
        }
    }

    #[test]
    fn records_round_trip_and_the_wrong_cluster_is_refused() {
        let half_arc = |arc, reversed| HalfArc { arc, reversed };
        let block = |level, begins_stream| BlockEntry {
            level,
            error: ErrorCode(1000 + u16::from(level)),
            border_deviation: ErrorCode(u16::from(level) * 40),
            triangle_count: 12,
            begins_stream,
        };
        let bounds = [[0, 0, 0], [255, 510, 0]];
        let root = |loops, blocks| RootEntry { filling: Filling::Grid, loops, bounds, child_count: 0, blocks };
        let roots = vec![
            root(vec![vec![half_arc(7, false), half_arc(2, true), half_arc(8, false)]], vec![block(0, true)]),
            RootEntry { child_count: 3, ..root(vec![], vec![block(0, false), block(2, true)]) },
        ];
        let cluster = Cluster {
            first_arc: 7,
            arc_count: 2,
            first_corner: 4,
            corner_count: 1,
            root_count: 2,
            child_count: 3,
            first_child: 2,
            bounds,
            ..Cluster::default()
        };
        let mut index = ClusterIndex::new(roots, vec![[4, 1], [0, 4]], &[0, 3, 0, 1, 0, 2], 3);
        index.corner_levels = vec![2];
        index.find_streams().unwrap();
        assert_eq!(index.sample_count(0, 2), 3);
        assert_eq!(index.new_sample_count(1, 2), 2);
        let tolerances = [ErrorCode(1100), ErrorCode(900), ErrorCode(0)];
        let fillings: Vec<_> = Filling::all().map(|filling| FillingSteps { filling, levels: Vec::new() }).collect();
        let records = index.records(&cluster, &fillings, &tolerances).unwrap();
        let parse = |cluster: &Cluster| {
            ClusterIndex::parse_records(&mut Replay::new(&records), cluster, &fillings, &tolerances, &Limits::default())
        };
        let mut parsed = parse(&cluster).unwrap();
        parsed.find_streams().unwrap();
        assert_eq!(parsed, index);
        assert_eq!(index.level_streams(0).len(), 1);
        assert!(index.level_streams(1).is_empty());
        for wrong in [
            Cluster { arc_count: 1, ..cluster.clone() },
            Cluster { corner_count: 2, ..cluster.clone() },
            Cluster { root_count: 3, ..cluster.clone() },
            Cluster { first_arc: 1, ..cluster.clone() },
            Cluster { child_count: 2, ..cluster.clone() },
            Cluster { first_child: 1, ..cluster.clone() },
        ] {
            assert!(parse(&wrong).is_err());
        }
        let few = Limits { cluster_record_count: 8, ..Limits::default() };
        let limited = ClusterIndex::parse_records(&mut Replay::new(&records), &cluster, &fillings, &tolerances, &few);
        assert!(matches!(limited, Err(Error::Limit { .. })));
    }
}
