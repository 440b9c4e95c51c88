//! From the numbers of pieces to those of the file.

use std::collections::BTreeMap;

use super::{
    order::Place,
    piece::{PieceCluster, PieceIndex},
};
use crate::{
    error::{Error, Result},
    index::RootEntry,
    model::HalfArc,
    sections::Cluster,
};

/// What the numbers of a piece are in the file.
#[derive(Clone, Debug, Default)]
pub(super) struct Numbering {
    /// First root, arc and corner of each piece, and of the next one.
    firsts: Vec<[u32; 3]>,
    next: [u32; 3],
    /// By number among all that are shared.
    shared_arcs: BTreeMap<u32, u32>,
    shared_corners: BTreeMap<u32, u32>,
}

/// A cluster without what is known of its pages; the rest in the numbers of the file.
pub(super) type Placed = (Cluster, Vec<RootEntry>, Vec<[u32; 2]>);

impl Numbering {
    /// Gives the next piece its numbers, and returns how many there were before.
    pub fn add(&mut self, piece: &PieceIndex) -> Result<usize> {
        let (number, first) = (self.firsts.len(), self.next);
        let sum = |count: fn(&PieceCluster) -> usize| piece.clusters.iter().map(count).sum::<usize>() as u64;
        let counts = [
            sum(|cluster| cluster.roots.len()),
            sum(|cluster| cluster.arc_ends.len()),
            sum(|cluster| cluster.corner_count as usize),
        ];
        let mut next = [0; 3];
        for k in 0..3 {
            let end = u64::from(first[k]) + counts[k];
            next[k] = u32::try_from(end)
                .ok()
                .filter(|&end| end < u32::MAX)
                .ok_or_else(|| Error::model("2^32 - 1 or more corners, arcs or roots"))?;
        }
        self.firsts.push(first);
        self.next = next;
        for (shared, known, k) in
            [(&piece.shared_arcs, &mut self.shared_arcs, 1), (&piece.shared_corners, &mut self.shared_corners, 2)]
        {
            for &[number, own] in shared {
                if u64::from(own) >= counts[k] || known.insert(number, first[k] + own).is_some() {
                    return Err(Error::model(format!("shared arc or corner {number} comes first twice")));
                }
            }
        }
        Ok(number)
    }

    /// The first root, arc and corner of a piece.
    pub fn first(&self, number: usize) -> [u32; 3] {
        self.firsts.get(number).copied().unwrap_or_default()
    }

    /// A cluster of a piece that begins with `first`. `next` are the first root, arc and corner of the cluster, moved on to the
    /// next cluster's.
    pub fn placed(&self, piece: &PieceCluster, first: [u32; 3], next: &mut [u32; 3]) -> Result<Placed> {
        let find = |place: u32, first: u32, shared: &BTreeMap<u32, u32>| {
            let place = Place(place);
            let own = place.own().and_then(|own| first.checked_add(own));
            let number = own.or_else(|| shared.get(&place.shared()?).copied());
            number.ok_or_else(|| Error::model("a piece shares an arc or corner that no piece before it has"))
        };
        let mut roots = piece.roots.clone();
        for HalfArc { arc, .. } in roots.iter_mut().flat_map(|root| root.loops.iter_mut().flatten()) {
            *arc = find(*arc, first[1], &self.shared_arcs)?;
        }
        let mut ends = piece.arc_ends.clone();
        for corner in ends.iter_mut().flatten() {
            *corner = find(*corner, first[2], &self.shared_corners)?;
        }
        if ends.iter().any(|[first, second]| first == second) {
            return Err(Error::model("both ends of an arc are one corner"));
        }
        let cluster = Cluster {
            first_root: next[0],
            root_count: roots.len() as u32,
            first_arc: next[1],
            arc_count: ends.len() as u32,
            first_corner: next[2],
            corner_count: piece.corner_count,
            bounds: piece.bounds,
            ..Cluster::default()
        };
        *next = [next[0] + cluster.root_count, next[1] + cluster.arc_count, next[2] + cluster.corner_count];
        Ok((cluster, roots, ends))
    }
}
