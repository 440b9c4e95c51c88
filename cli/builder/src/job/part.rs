//! Parts: the products of some regions, in one file.

use std::ops::Range;
use std::path::Path;

use lodpack::write::{Piece, PieceIndex};
use serde::{Deserialize, Serialize};

use super::merge::FoundPart;
use crate::pipeline::{Plan, ProductStats, RegionProduct};
use crate::region::Nodes;
use lodpack_runtime::storage::{DAMAGED, JobId, SealedReader, SealedWriter, WorkError};

const KIND: [u8; 4] = *b"part";

/// The beginning of a part's file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PartHead {
    /// Number of the part, from 0.
    pub part: u32,
    /// The number of parts in the job.
    pub parts: u32,
    /// Its regions.
    pub regions: Range<u32>,
    /// The plan of the whole job without what the input names, so that parts can be merged without the job's directory.
    pub plan: Plan,
    /// What the input names, in the part of the first region alone: there may be a million objects, and many parts.
    pub nodes: Nodes,
}

impl PartHead {
    /// The beginning of a part, given its number and the number of parts.
    pub fn new([part, parts]: [u32; 2], regions: Range<u32>, plan: &Plan) -> Self {
        let mut plan = plan.clone();
        let nodes = std::mem::take(&mut plan.nodes);
        let nodes = if regions.contains(&0) { nodes } else { Nodes::default() };
        Self { part, parts, regions, plan, nodes }
    }
}

/// The file name of a part.
pub fn part_name(part: u32) -> String {
    format!("part-{part}.{PART_EXTENSION}")
}

/// The extension of a part's file.
pub const PART_EXTENSION: &str = "lodpart";

/// Writes a part, product after product.
pub(crate) struct PartWriter(SealedWriter);

impl PartWriter {
    /// Begins a file.
    pub fn create(path: &Path, job: JobId, head: &PartHead) -> Result<Self, WorkError> {
        let mut writer = SealedWriter::create(path, KIND, job)?;
        writer.put(head)?;
        Ok(Self(writer))
    }

    /// Appends the product of the next region.
    pub fn put(&mut self, product: &RegionProduct) -> Result<(), WorkError> {
        self.0.put(&product.stats)?;
        self.0.put(&product.piece.index)?;
        self.0.put(&product.piece.symbols)
    }

    /// Gives the file its name; returns its size.
    pub fn finish(self, sync: bool) -> Result<u64, WorkError> {
        self.0.finish(sync)
    }
}

/// Reads a part, product after product.
pub(crate) struct PartReader {
    reader: SealedReader,
    pub job: JobId,
    pub head: PartHead,
}

impl PartReader {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Self, WorkError> {
        let mut reader = SealedReader::open(path, KIND)?;
        let head: PartHead = reader.get()?;
        let regions = &head.regions;
        if head.part >= head.parts || regions.start > regions.end || regions.end > head.plan.regions {
            return Err(WorkError::damaged(path, DAMAGED));
        }
        Ok(Self { job: reader.job, reader, head })
    }

    /// What checking all of a file says about it.
    pub(super) fn check(path: &Path) -> Result<FoundPart<Plan>, WorkError> {
        let part = Self::open(path)?;
        let (job, PartHead { part: number, parts, regions, plan, .. }) = (part.job, part.head.clone());
        part.finish()?;
        Ok(FoundPart { job, part: number, parts, regions: regions.len() as u32, all_regions: Some(plan.regions), plan })
    }

    /// What the file as a whole has to know of the next region. Its symbols are skipped, so the file can no longer be
    /// checked.
    pub fn head(&mut self) -> Result<(ProductStats, PieceIndex), WorkError> {
        let head = (self.reader.get()?, self.reader.get()?);
        self.reader.skip()?;
        Ok(head)
    }

    /// Reads past the next region.
    pub fn pass(&mut self) -> Result<(), WorkError> {
        (0..3).try_for_each(|_| self.reader.get_bytes().map(drop))
    }

    /// The piece of the next region.
    pub fn piece(&mut self) -> Result<Piece, WorkError> {
        Ok(self.product()?.piece)
    }

    /// The product of the next region.
    pub fn product(&mut self) -> Result<RegionProduct, WorkError> {
        let stats = self.reader.get()?;
        Ok(RegionProduct { stats, piece: Piece { index: self.reader.get()?, symbols: self.reader.get()? } })
    }

    /// Reads the rest and checks everything.
    pub fn finish(self) -> Result<(), WorkError> {
        self.reader.finish()
    }
}
