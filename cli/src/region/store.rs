//! Where regions are between the stages: in memory, or on disk.

use rayon::prelude::*;

use super::Border;
use super::border::{components, reverse_components};
use crate::mesh::{Adjacency, Mesh};
use crate::temporary::{Record, RecordReader, RecordWriter, TemporaryDirectory, TemporaryError};

/// A region after repair.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// Its triangles.
    pub mesh: Mesh,
    /// Who meets whom within the region.
    pub adjacency: Adjacency,
    /// The chart of each triangle; empty until it is cut into charts.
    pub labels: Vec<u32>,
}

/// All regions.
#[derive(Debug)]
pub enum RegionStore {
    /// In memory.
    Memory(Vec<Region>),
    /// On disk.
    Directory(RegionDirectory),
}

/// Regions in temporary files.
#[derive(Debug)]
pub struct RegionDirectory {
    directory: TemporaryDirectory,
    count: usize,
    /// Regions that are in memory together at most, at least one.
    at_once: usize,
}

impl RegionStore {
    /// How many regions there are.
    pub fn count(&self) -> usize {
        match self {
            Self::Memory(regions) => regions.len(),
            Self::Directory(regions) => regions.count,
        }
    }

    /// The most that temporary files have taken so far.
    pub fn temporary_bytes(&self) -> u64 {
        match self {
            Self::Memory(_) => 0,
            Self::Directory(regions) => regions.directory.most_bytes(),
        }
    }

    /// Takes a region out, for good.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn take(&mut self, region: usize) -> Result<Region, TemporaryError> {
        match self {
            Self::Memory(regions) => Ok(std::mem::take(&mut regions[region])),
            Self::Directory(regions) => {
                let taken = regions.load(region)?;
                regions.remove(region);
                Ok(taken)
            }
        }
    }

    /// Cuts all regions into charts by a function that also returns what else is to be known of them.
    ///
    /// # Errors
    /// Where they cannot be read or written.
    pub fn set_labels<T: Send>(
        &mut self,
        borders: &[Border],
        charts: impl Fn(&Region, &Border) -> (Vec<u32>, T) + Sync,
    ) -> Result<Vec<T>, TemporaryError> {
        let set = |(region, border): (&mut Region, &Border)| {
            let (labels, known) = charts(region, border);
            region.labels = labels;
            known
        };
        match self {
            Self::Memory(regions) => Ok(regions.par_iter_mut().zip(borders).map(set).collect()),
            Self::Directory(regions) => {
                let mut all = vec![];
                for first in (0..regions.count).step_by(regions.at_once) {
                    let end = regions.count.min(first + regions.at_once);
                    let mut held = (first..end).map(|region| regions.load(region)).collect::<Result<Vec<_>, _>>()?;
                    all.par_extend(held.par_iter_mut().zip(&borders[first..end]).map(set));
                    held.iter()
                        .zip(first..)
                        .try_for_each(|(r, index)| regions.save_part(index, "labels", &r.labels))?;
                }
                Ok(all)
            }
        }
    }

    /// Reverses connected pieces of regions, and what borders say of them.
    pub(super) fn reverse(&mut self, borders: &mut [Border], reversed: &[Vec<bool>]) -> Result<(), TemporaryError> {
        let turn = |region: &mut Region, border: &mut Border, reversed: &[bool]| {
            let pieces = components(&region.adjacency);
            reverse_components(&mut region.mesh, &mut region.adjacency, border, &pieces, reversed);
        };
        match self {
            Self::Memory(regions) => {
                let all = regions.par_iter_mut().zip(borders).zip(reversed);
                all.filter(|(_, reversed)| reversed.contains(&true))
                    .for_each(|((region, border), reversed)| turn(region, border, reversed));
            }
            Self::Directory(regions) => {
                let all = borders.iter_mut().zip(reversed).enumerate();
                for (index, (border, reversed)) in all.filter(|(_, (_, reversed))| reversed.contains(&true)) {
                    let mut region = regions.load(index)?;
                    turn(&mut region, border, reversed);
                    regions.save(index, &region)?;
                }
            }
        }
        Ok(())
    }
}

impl RegionDirectory {
    pub(super) fn new(directory: TemporaryDirectory, count: usize, at_once: usize) -> Self {
        Self { directory, count, at_once: at_once.max(1) }
    }

    /// Writes a region without its charts.
    pub(super) fn save(&self, region: usize, Region { mesh, adjacency, .. }: &Region) -> Result<(), TemporaryError> {
        self.save_part(region, "positions", &mesh.positions)?;
        self.save_part(region, "triangles", &mesh.triangles)?;
        self.save_part(region, "opposite", &adjacency.opposite)?;
        self.save_part::<u32>(region, "labels", &[])
    }

    fn save_part<R: Record>(&self, region: usize, part: &str, records: &[R]) -> Result<(), TemporaryError> {
        let mut writer = RecordWriter::create(&self.directory, &format!("region-{region}.{part}"))?;
        writer.push_all(records)?;
        writer.finish().map(drop)
    }

    fn load(&self, region: usize) -> Result<Region, TemporaryError> {
        Ok(Region {
            mesh: Mesh {
                positions: self.load_part(region, "positions")?,
                triangles: self.load_part(region, "triangles")?,
            },
            adjacency: Adjacency { opposite: self.load_part(region, "opposite")? },
            labels: self.load_part(region, "labels")?,
        })
    }

    fn load_part<R: Record>(&self, region: usize, part: &str) -> Result<Vec<R>, TemporaryError> {
        RecordReader::open(&self.directory.path(&format!("region-{region}.{part}")))?.read_all()
    }

    fn remove(&self, region: usize) {
        for part in ["positions", "triangles", "opposite", "labels"] {
            self.directory.remove(&self.directory.path(&format!("region-{region}.{part}")));
        }
    }
}
