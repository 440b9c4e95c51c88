//! The border of a root: its half-arcs, loop after loop.

use std::{collections::HashMap, ops::Range};

use super::Decoded;
use crate::{
    codec::{
        arc::{HalfPath, Knot, Path},
        filling::RootBorder,
        patch::Patch,
    },
    error::{Error, Result},
    format::{
        index_block::RootEntry,
        records::{HalfArc, is_loop},
    },
    lattice::LatticePoint,
};

/// The identity of a border vertex within the whole surface, which is the same for all roots that touch it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum BorderKey {
    /// A corner.
    Corner(u32),
    /// A sample of an arc.
    Sample {
        /// The arc.
        arc: u32,
        /// The sample's parameter in 1/65536.
        param: u32,
    },
}

/// A border vertex of a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BorderVertex {
    /// Its identity.
    pub key: BorderKey,
    /// Its position.
    pub position: LatticePoint,
}

/// A half-arc of a root's border at a level.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BorderSide {
    pub half_arc: HalfArc,
    /// Its border vertices, counted over all loops: the corner where it begins, if that is one, and its samples.
    pub vertices: Range<u32>,
    /// The corner where it begins.
    pub corner: BorderVertex,
    /// The coarsest level at which that is a vertex.
    pub corner_level: u8,
}

/// A half-arc of a loop: a corner, then samples, in the direction of the loop.
pub(super) struct Side<'p> {
    pub half_arc: HalfArc,
    /// The arc, in its own direction.
    pub path: &'p Path,
    /// The corner where it begins.
    pub corner: u32,
    pub corner_position: LatticePoint,
    /// The coarsest level at which that is a vertex.
    pub corner_level: u8,
}

impl Side<'_> {
    /// Visits its samples up to a level.
    #[inline]
    pub fn visit_samples(&self, level: u8, visit: impl FnMut(&Knot)) {
        let samples = self.path.samples().iter().filter(|knot| knot.level <= level);
        if self.half_arc.reversed { samples.rev().for_each(visit) } else { samples.for_each(visit) }
    }
}

impl Decoded<'_> {
    /// Visits the half-arcs of a loop, and checks that each ends where the next one begins.
    pub(super) fn walk_loop<'d>(
        &'d self,
        half_arcs: &[HalfArc],
        mut visit: impl FnMut(Side<'d>) -> Result<()>,
    ) -> Result<()> {
        let mut corners = Vec::with_capacity(half_arcs.len());
        for &half_arc in half_arcs {
            let (path, ends) = self.arc(half_arc.arc)?;
            let ends = half_arc.directed(ends);
            let [corner_position, _] = half_arc.directed(path.end_positions());
            let [corner_level, _] = half_arc.directed(path.end_levels());
            corners.push(ends);
            visit(Side { half_arc, path, corner: ends[0], corner_position, corner_level })?;
        }
        if is_loop(&corners) { Ok(()) } else { Err(Error::format("a half-arc does not end where the next one begins")) }
    }

    /// The border vertices of a root at a level, loop after loop.
    pub(crate) fn border(&self, root: &RootEntry, level: u8) -> Result<Vec<Vec<BorderVertex>>> {
        Ok(self.border_with_sides(root, level)?.0)
    }

    /// The border vertices of a root at a level, loop after loop, and its half-arcs in the same order.
    pub(crate) fn border_with_sides(
        &self,
        root: &RootEntry,
        level: u8,
    ) -> Result<(Vec<Vec<BorderVertex>>, Vec<BorderSide>)> {
        let (mut loops, mut sides) = (Vec::with_capacity(root.loops.len()), Vec::new());
        let mut first = 0;
        for half_arcs in &root.loops {
            let mut border = Vec::new();
            self.walk_loop(half_arcs, |side| {
                let start = first + border.len() as u32;
                let corner = BorderVertex { key: BorderKey::Corner(side.corner), position: side.corner_position };
                if side.corner_level <= level {
                    border.push(corner);
                } else if border.is_empty() {
                    return Err(first_is_none());
                }
                let arc = side.half_arc.arc;
                side.visit_samples(level, |&Knot { param, position, .. }| {
                    border.push(BorderVertex { key: BorderKey::Sample { arc, param }, position });
                });
                let vertices = start..first + border.len() as u32;
                sides.push(BorderSide { half_arc: side.half_arc, vertices, corner, corner_level: side.corner_level });
                Ok(())
            })?;
            first += border.len() as u32;
            loops.push(border);
        }
        Ok((loops, sides))
    }

    /// For each corner of these roots that is no vertex at level 0 the finest level at which one of them is drawn.
    pub(super) fn corner_levels<'r>(
        &self,
        roots: impl Iterator<Item = (&'r RootEntry, u8)>,
    ) -> Result<HashMap<u32, u8>> {
        let mut levels = HashMap::new();
        for (root, level) in roots {
            for half_arc in root.half_arcs() {
                let (path, ends) = self.arc(half_arc.arc)?;
                for (corner, coarsest) in ends.into_iter().zip(path.end_levels()) {
                    if coarsest > 0 {
                        let finest = levels.entry(corner).or_insert(level);
                        *finest = level.max(*finest);
                    }
                }
            }
        }
        Ok(levels)
    }

    /// The half-arcs around a root, from which its filling takes the border.
    pub(super) fn root_border(&self, root: &RootEntry, level: u8) -> Result<RootBorder<'_>> {
        let of_loop = |half_arcs: &Vec<HalfArc>| {
            let mut sides = Vec::with_capacity(half_arcs.len());
            self.walk_loop(half_arcs, |Side { half_arc, path, .. }| {
                sides.push(HalfPath { path, reversed: half_arc.reversed });
                Ok(())
            })?;
            Ok(sides)
        };
        Ok(RootBorder { loops: root.loops.iter().map(of_loop).collect::<Result<_>>()?, level })
    }
}

/// A loop begins with a corner that is no vertex.
pub(super) fn first_is_none() -> Error {
    Error::format("a loop begins with a corner that is no vertex at the root's level")
}

/// The border edges of a patch, each of which has exactly one triangle.
pub(crate) struct BorderEdges {
    /// Per border vertex the one that follows in its loop.
    next: Vec<u32>,
    /// Whether the edge from a border vertex to the next one has its triangle.
    has_triangle: Vec<bool>,
}

impl BorderEdges {
    /// The edges of loops of these lengths, none with a triangle yet.
    ///
    /// # Errors
    /// [`Error::Format`] if the patch has another number of border vertices.
    pub fn new(loop_lengths: impl IntoIterator<Item = usize>, patch: &Patch) -> Result<Self> {
        let mut next = Vec::with_capacity(patch.border_count as usize);
        for length in loop_lengths {
            let start = next.len() as u32;
            let end = start + length as u32;
            next.extend((start + 1..end).chain((start < end).then_some(start)));
        }
        if next.len() != patch.border_count as usize {
            return Err(Error::format("a patch has another border than its root"));
        }
        Ok(Self { has_triangle: vec![false; next.len()], next })
    }

    /// The border vertex that follows another in its loop.
    #[inline]
    pub fn next(&self, vertex: usize) -> u32 {
        self.next[vertex]
    }

    /// Notes the triangle of the edge that begins at a border vertex.
    #[inline]
    pub fn add_triangle(&mut self, vertex: usize) -> Result<()> {
        if std::mem::replace(&mut self.has_triangle[vertex], true) {
            return Err(Error::format("a border edge has two triangles"));
        }
        Ok(())
    }

    /// Checks that every edge has its triangle.
    pub fn finish(&self) -> Result<()> {
        if self.has_triangle.contains(&false) { Err(Error::format("a border edge has no triangle")) } else { Ok(()) }
    }
}
