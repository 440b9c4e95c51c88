//! Adding to a job: a new job of all inputs takes over whatever the new inputs do not touch.
//!
//! Correa 2004 (section 3.1) adds to a tree by rebuilding the leaves into which triangles fall. The same is done here
//! with regions: those that get triangles, and those that share a seam with a region whose charts have changed, are
//! built again. What a region is built from is compared, not guessed, so the result is the file of a fresh build.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Serialize;

use super::part::PartReader;
use super::plan::read_plan;
use super::planned::PartFiles;
use super::{BuildError, BuildOptions, Job, JobError, Manifest, PartEntry, PartOptions};
use crate::pipeline::{Plan, RegionProduct};
use crate::region::{Earlier, RegionDirectory};
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::{WorkDirectory, WorkError};
use lodpack_stage::arcs::Seams;

/// A job to which something was added.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Added {
    /// The new job.
    pub manifest: Manifest,
    /// The number of its regions.
    pub regions: u32,
    /// How many of them need not be built, because the earlier job has built the same.
    pub taken_over: u32,
}

/// The job to which something is added.
#[derive(Debug)]
pub(super) struct EarlierJob {
    manifest: Manifest,
    plan: Plan,
    regions: Earlier,
    directory: WorkDirectory,
}

impl Job {
    /// Plans a job in `path` of the inputs of the job `earlier` and of those in `options`, of which only the memory and
    /// `resume` count besides. The new job takes over what the earlier one knows of regions that do not change: their
    /// charts, and their products where its parts are built. Its parts, and the file that they become, are those of
    /// [`Self::plan`] with all inputs.
    ///
    /// # Errors
    /// As for plans, and [`JobError::Extend`] if the earlier job was not planned for this or its inputs have changed.
    pub fn add(
        earlier: &Path,
        path: &Path,
        parts: PartOptions,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Added, BuildError> {
        let earlier = EarlierJob::open(earlier)?;
        let all = earlier.manifest.inputs.iter().map(|file| &file.path).chain(&options.inputs).cloned().collect();
        let options = BuildOptions { inputs: all, model: earlier.manifest.options.clone(), ..options.clone() };
        earlier.check_inputs()?;
        let manifest = Self::plan_after(Some(earlier), path, parts, &options, progress)?;
        let directory = WorkDirectory::visit(path)?;
        let (plan, _) = read_plan(path, manifest.id())?;
        let regions = RegionDirectory::charted(directory, manifest.id(), plan.regions as usize);
        let taken_over = (0..plan.regions).filter(|&region| regions.has_product(region as usize)).count() as u32;
        Ok(Added { manifest, regions: plan.regions, taken_over })
    }
}

impl EarlierJob {
    fn open(path: &Path) -> Result<Self, JobError> {
        if path.is_file() {
            let what = "a file holds what is drawn, not what it was made from; name the job from which it was merged";
            return Err(JobError::Extend { path: path.to_owned(), what: what.into() });
        }
        let manifest = Manifest::read(path)?;
        if manifest.parts.is_empty() {
            return Err(JobError::NotPlanned { path: path.to_owned() });
        }
        if !manifest.options.extensible {
            let what = "its regions would move if something were added; plan all inputs with --extensible, then more can be added";
            return Err(JobError::Extend { path: path.to_owned(), what: what.into() });
        }
        let directory = WorkDirectory::visit(path)?;
        let (plan, _) = read_plan(path, manifest.id())?;
        let store = RegionDirectory::charted(directory.clone(), manifest.id(), plan.regions as usize);
        let regions = Earlier::new(store, plan.scale.chart_triangles);
        Ok(Self { manifest, plan, regions, directory })
    }

    /// Checks that all its inputs exist unchanged, because they are read again.
    fn check_inputs(&self) -> Result<(), JobError> {
        let refused = |path: &Path, what: &str| Err(JobError::Extend { path: path.to_owned(), what: what.into() });
        if let Some(changed) = self.manifest.changed_inputs(self.directory.folder()).first() {
            return refused(
                changed,
                "it has changed since the job was planned; plan all inputs again with --extensible",
            );
        }
        match self.manifest.inputs.iter().find(|file| !file.path.exists()) {
            Some(gone) => refused(&gone.path, "the job was planned from it, and it is no longer there; bring it back"),
            None => Ok(()),
        }
    }

    /// Its regions.
    pub fn regions(&self) -> &Earlier {
        &self.regions
    }

    /// Gives the products of its regions to those regions of a later job that are the same.
    pub fn hand_over(&self, plan: &Plan, regions: &RegionDirectory) -> Result<(), BuildError> {
        if !self.plan.builds_like(plan) {
            return Ok(());
        }
        let stats = (0..regions.count()).map(|region| (region, regions.stats(region)));
        let later: BTreeMap<usize, usize> =
            stats.filter_map(|(region, stats)| Some((self.regions.region_of(stats?.input)?, region))).collect();
        for (part, entry) in (0..).zip(&self.manifest.parts) {
            let own = || regions_of(entry).filter_map(|region| later.get(&region));
            if own().any(|&region| !regions.has_product(region)) {
                self.hand_over_part(part, entry, plan, regions, &later)?;
            }
        }
        Ok(())
    }

    fn hand_over_part(
        &self,
        part: u32,
        entry: &PartEntry,
        plan: &Plan,
        regions: &RegionDirectory,
        later: &BTreeMap<usize, usize>,
    ) -> Result<(), BuildError> {
        let path = PartFiles::new(self.directory.folder(), part).path;
        let own: Vec<usize> = regions_of(entry).collect();
        // The regions of a part that is missing, damaged or of another job are built again.
        let is_sound = PartReader::open(&path).is_ok_and(|part| {
            let fits = part.job == self.manifest.part_id() && part.head.plan == self.plan;
            fits && part.head.regions.clone().map(|region| region as usize).eq(own.iter().copied())
                && part.finish().is_ok()
        });
        if !is_sound {
            return Ok(());
        }
        let mut part = PartReader::open(&path)?;
        for region in own {
            let mut product: RegionProduct = part.product()?;
            let Some(&now) = later.get(&region) else { continue };
            if let Some([corners, arcs]) = self.same(region, regions, now)? {
                product.renumber(&corners, &arcs)?;
                product.move_levels(&self.plan.scale, &plan.scale)?;
                regions.put_product(now, &product)?;
            }
        }
        Ok(())
    }

    /// The numbers that the corners and seams of a region have in a later job, where everything that it is built from
    /// is the same there.
    fn same(
        &self,
        region: usize,
        regions: &RegionDirectory,
        now: usize,
    ) -> Result<Option<[BTreeMap<u32, u32>; 2]>, WorkError> {
        let (now, now_seams) = regions.load_charted(now)?;
        Ok(match self.regions.store().load_charted(region) {
            Ok((then, then_seams)) if then == now => numbers(&then_seams, &now_seams),
            _ => None,
        })
    }
}

fn regions_of(entry: &PartEntry) -> std::ops::Range<usize> {
    let first = entry.first_region as usize;
    first..first + entry.regions as usize
}

/// Maps the numbers of corners and of seams to those in other seams that differ in nothing but the numbers.
fn numbers(from: &Seams, to: &Seams) -> Option<[BTreeMap<u32, u32>; 2]> {
    let corners = |seams: &Seams| -> Vec<_> {
        seams.corners.iter().map(|corner| (corner.number, (corner.vertex, corner.is_first))).collect()
    };
    let starts = |seams: &Seams| -> Vec<_> {
        seams.starts.iter().map(|start| (start.seam, (start.half_edge, start.reversed))).collect()
    };
    let corners = paired(&corners(from), &corners(to))?;
    let starts = paired(&starts(from), &starts(to))?;
    (from.half_edges == to.half_edges).then_some([corners, starts])
}

/// Pairs numbers one to one. None if anything else differs, or a number would get two partners.
fn paired<T: PartialEq>(from: &[(u32, T)], to: &[(u32, T)]) -> Option<BTreeMap<u32, u32>> {
    let mut numbers = BTreeMap::new();
    let fits = from.len() == to.len()
        && from.iter().zip(to).all(|(from, to)| from.1 == to.1 && *numbers.entry(from.0).or_insert(to.0) == to.0);
    let distinct: BTreeSet<u32> = numbers.values().copied().collect();
    (fits && distinct.len() == numbers.len()).then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_paired_one_to_one_or_not_at_all() {
        let of = |numbers: [u32; 4]| numbers.into_iter().zip([10, 20, 30, 40]).collect::<Vec<_>>();
        let pairs = paired(&of([3, 5, 3, 9]), &of([0, 7, 0, 1]));
        assert_eq!(pairs, Some(BTreeMap::from([(3, 0), (5, 7), (9, 1)])));
        assert_eq!(paired(&of([3, 5, 3, 9]), &of([0, 7, 2, 1])), None);
        assert_eq!(paired(&of([3, 5, 4, 9]), &of([0, 7, 0, 1])), None);
        assert_eq!(paired(&of([3, 5, 3, 9]), &of([0, 7, 0, 1])[..3]), None);
        assert_eq!(paired(&[(0, 1)], &[(0, 2)]), None);
    }
}
