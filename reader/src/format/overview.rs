//! Section OVERVIEW: one small mesh of everything, for the first picture (SPEC.md, "Section OVERVIEW").
//!
//! The bytes are: error code (u16), normal and tangent shift (u8 each), triangle count (u32); the number of loops, and
//! for each loop the number of its vertices and their coordinates in normal steps, each as the difference from the
//! previous vertex; then a stream with the patch. The overview's border belongs to no arc, so the section itself holds
//! it.

use crate::{
    codec::{
        bytes::{Cursor, put_varint},
        entropy::{unzigzag, zigzag},
        filling::Quantisation,
        local_frame::COORDINATE_LIMIT,
    },
    error::{Error, Result},
    format::error_code::ErrorCode,
    lattice::LatticePoint,
    limits::{Limits, within},
};

/// The section with its border decoded and its patch still coded.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OverviewSection {
    pub error: ErrorCode,
    pub quantisation: Quantisation,
    pub triangle_count: u32,
    /// The border; its coordinates are multiples of the normal step.
    pub loops: Vec<Vec<LatticePoint>>,
    /// The patch, an irregular filling.
    pub stream: Vec<u8>,
}

impl OverviewSection {
    /// The section's bytes.
    ///
    /// # Errors
    /// [`Error::Model`] if the border does not lie on multiples of the normal step.
    pub(crate) fn write(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        bytes.extend(self.error.0.to_le_bytes());
        let Quantisation { normal_shift, tangent_shift } = self.quantisation;
        bytes.extend([normal_shift, tangent_shift]);
        bytes.extend(self.triangle_count.to_le_bytes());
        put_varint(&mut bytes, self.loops.len() as u64);
        let mut before = [0; 3];
        for points in &self.loops {
            put_varint(&mut bytes, points.len() as u64);
            for point in points {
                for axis in 0..3 {
                    if point[axis] & ((1 << normal_shift) - 1) != 0 {
                        return Err(Error::model("the overview's border is finer than its step"));
                    }
                    put_varint(&mut bytes, zigzag((point[axis] - before[axis]) >> normal_shift));
                }
                before = *point;
            }
        }
        bytes.extend(&self.stream);
        Ok(bytes)
    }

    /// Reads the section.
    pub(crate) fn parse(bytes: &[u8], limits: &Limits) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let error = ErrorCode(cursor.u16()?);
        let quantisation = Quantisation { normal_shift: cursor.u8()?, tangent_shift: cursor.u8()? };
        if !quantisation.is_valid() {
            return Err(Error::format("a shift is above 40"));
        }
        let triangle_count = cursor.u32()?;
        // Every vertex takes three bytes and every loop one, so no count outgrows the section.
        let loop_count = cursor.varint_up_to(cursor.left() as u64, "number of loops")?;
        let (mut loops, mut before, mut vertex_count) = (Vec::new(), [0_i64; 3], 0);
        for _ in 0..loop_count {
            let count = cursor.varint_up_to(cursor.left() as u64 / 3, "number of border vertices")?;
            if count < 3 {
                return Err(Error::format("a loop has fewer than three vertices"));
            }
            vertex_count += count;
            within(limits.root_vertex_count, vertex_count, "number of border vertices of a root")?;
            let mut points = Vec::new();
            for _ in 0..count {
                for x in &mut before {
                    let steps = unzigzag(cursor.varint()?);
                    let moved = steps.checked_mul(1 << quantisation.normal_shift).and_then(|d| x.checked_add(d));
                    let moved = moved.filter(|x| x.unsigned_abs() <= COORDINATE_LIMIT as u64);
                    *x = moved.ok_or_else(|| Error::format("a coordinate exceeds 2^40"))?;
                }
                points.push(before);
            }
            loops.push(points);
        }
        let stream = cursor.bytes(cursor.left())?.to_vec();
        Ok(Self { error, quantisation, triangle_count, loops, stream })
    }
}
