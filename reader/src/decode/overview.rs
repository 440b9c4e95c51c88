//! The overview: one small mesh of everything, for the first picture (SPEC.md, "Section OVERVIEW").
//!
//! A file of many roots has an index that does not fit into the first request. The overview does: it is complete and
//! watertight where the surface is, needs no index, and has a certified error of its own. It is one irregular patch, whose
//! border is written out, since it belongs to no arc.

use crate::{
    codec::{
        bytes::{Cursor, put_varint},
        entropy::{Codes, Decoder, Tables, encode, unzigzag, zigzag},
        filling::{
            Quantisation,
            irregular::{PatchLimits, decode_patch},
        },
        local_frame::COORDINATE_LIMIT,
        patch::{LatticePoint, Patch},
    },
    decode::{check_patch, stitch::Mesh},
    error::{Error, Result},
    format::{
        error_code::ErrorCode,
        model::{Lattice, OverviewRecord},
    },
    index::resident::Index,
    limits::{Limits, within},
};

/// The whole surface, coarsely.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overview {
    /// Bound of the two-sided distance to the input, world units.
    pub error: f64,
    /// Its border.
    pub loops: Vec<Vec<LatticePoint>>,
    /// Its triangles; the border vertices are those of `loops`, in order.
    pub patch: Patch,
}

impl Overview {
    /// What is drawn. It belongs to no node of a cut: `triangle_nodes` is all zero.
    pub fn mesh(&self, lattice: &Lattice) -> Mesh {
        let points = self.loops.iter().flatten().chain(&self.patch.interior);
        Mesh {
            positions: points.map(|&point| lattice.world(point)).collect(),
            triangles: self.patch.triangles.clone(),
            triangle_nodes: vec![0; self.patch.triangles.len()],
        }
    }
}

impl Index {
    /// The overview, for files that have one: those whose coarsest cut takes more than the first request.
    ///
    /// # Errors
    /// [`Error::Format`], [`Error::Limit`].
    pub fn overview(&self) -> Result<Option<Overview>> {
        let Some(section) = &self.overview else { return Ok(None) };
        let overview = section.decode(&self.tables, &self.limits, &self.lattice());
        overview.map(Some).map_err(|error| error.at(|| "section overview".to_string()))
    }

    /// Bound of the overview's error, world units, and its number of triangles.
    pub fn overview_summary(&self) -> Option<(f64, u64)> {
        let section = self.overview.as_ref()?;
        Some((section.error.bound(&self.lattice()), u64::from(section.triangle_count)))
    }
}

/// The section's bytes: error code (u16), normal and tangent shift (u8 each), triangle count (u32); the number of loops, and
/// for each the number of its vertices and their coordinates in normal steps, each the difference to the vertex before; then
/// a stream with the patch.
pub(crate) fn write_overview(overview: &OverviewRecord, codes: &Codes, lattice: &Lattice) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    bytes.extend(ErrorCode::at_least(overview.error, lattice)?.0.to_le_bytes());
    let Quantisation { normal_shift, tangent_shift } = overview.quantisation;
    bytes.extend([normal_shift, tangent_shift]);
    bytes.extend(overview.triangle_count.to_le_bytes());
    put_varint(&mut bytes, overview.loops.len() as u64);
    let mut before = [0; 3];
    for points in &overview.loops {
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
    bytes.extend(encode(codes, [overview.symbols.iter()])?);
    Ok(bytes)
}

/// The section with its border decoded.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OverviewSection {
    error: ErrorCode,
    quantisation: Quantisation,
    triangle_count: u32,
    loops: Vec<Vec<LatticePoint>>,
    stream: Vec<u8>,
}

impl OverviewSection {
    /// Reads what [`write_overview`] wrote.
    pub(crate) fn parse(bytes: &[u8], limits: &Limits) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let error = ErrorCode(cursor.u16()?);
        let quantisation = Quantisation { normal_shift: cursor.u8()?, tangent_shift: cursor.u8()? };
        if !quantisation.is_valid() {
            return Err(Error::format("a shift is above 40"));
        }
        let triangle_count = cursor.u32()?;
        // Every vertex takes three bytes and every loop one, so that no count outgrows the section.
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

    fn decode(&self, tables: &Tables, limits: &Limits, lattice: &Lattice) -> Result<Overview> {
        let limits = PatchLimits { vertices: limits.root_vertex_count, triangles: u64::from(self.triangle_count) };
        let mut symbols = Decoder::new(tables, &self.stream)?;
        let patch = decode_patch(&mut symbols, &self.loops, self.quantisation, limits)?;
        symbols.finish()?;
        check_patch(&patch, self.loops.iter().map(Vec::len).sum(), self.triangle_count)?;
        Ok(Overview { error: self.error.bound(lattice), loops: self.loops.clone(), patch })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SymbolBuffer;
    use crate::codec::filling::{
        Slide,
        irregular::{PatchTarget, encode_patch},
    };

    struct Stay;

    impl Slide for Stay {
        fn offset(&self, _: u32, _: [f64; 3], _: [f64; 3]) -> f64 {
            0.0
        }
    }

    /// A fan of six triangles around one vertex, and its tables.
    fn fan() -> (OverviewRecord, Tables) {
        let ring = [[8, 0, 0], [4, 8, 0], [-4, 8, 4], [-8, 0, 0], [-4, -8, 0], [4, -8, 0]];
        let loops = vec![ring.to_vec()];
        let triangles: Vec<[u32; 3]> = (0..6).map(|k| [k, (k + 1) % 6, 6]).collect();
        let quantisation = Quantisation { normal_shift: 2, tangent_shift: 0 };
        let mut symbols = SymbolBuffer::default();
        let target = PatchTarget { loops: &loops, interior: &[[0.0; 3]], triangles: &triangles };
        encode_patch(&target, quantisation, &Stay, &mut symbols).unwrap();
        let tables = Tables::from_buffers([&symbols]);
        (OverviewRecord { error: 0.25, quantisation, loops, triangle_count: 6, symbols }, tables)
    }

    #[test]
    fn overviews_round_trip_with_their_border() {
        let (record, tables) = fan();
        let lattice = Lattice { origin: [1.0, 2.0, 3.0], step_log2: -3 };
        let bytes = write_overview(&record, &tables.codes(), &lattice).unwrap();
        let section = OverviewSection::parse(&bytes, &Limits::default()).unwrap();
        assert_eq!(section.loops, record.loops);
        let overview = section.decode(&tables, &Limits::default(), &lattice).unwrap();
        let mesh = overview.mesh(&lattice);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (7, 6));
        assert_eq!(mesh.positions[0], [2.0, 2.0, 3.0]);
        assert!(overview.error >= 0.25 && overview.error < 0.252);
    }

    #[test]
    fn damaged_overviews_are_refused_or_small() {
        let (record, tables) = fan();
        let bytes = write_overview(&record, &tables.codes(), &Lattice::default()).unwrap();
        for end in 0..bytes.len() {
            let section = OverviewSection::parse(&bytes[..end], &Limits::default());
            assert!(section.and_then(|s| s.decode(&tables, &Limits::default(), &Lattice::default())).is_err());
        }
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            if let Ok(section) = OverviewSection::parse(&changed, &Limits::default()) {
                let _ = section.decode(&tables, &Limits::default(), &Lattice::default());
            }
        }
    }
}
