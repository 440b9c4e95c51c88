//! The overview: one small mesh of everything, for the first picture.
//!
//! A file of many roots has an index that does not fit into the first request. The overview does: it is complete,
//! watertight where the surface is, needs no index, and has a certified error of its own.

use super::check_patch;
use crate::{
    codec::{
        entropy::{Decoder, Tables},
        filling::irregular::{PatchLimits, decode_patch},
        patch::Patch,
    },
    decode::Mesh,
    error::Result,
    format::overview::OverviewSection,
    index::Index,
    lattice::{Lattice, LatticePoint},
    limits::Limits,
};

/// The whole surface as one coarse mesh.
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
    /// The mesh to draw. It belongs to no node of a cut, so `triangle_nodes` is all zero.
    pub fn mesh(&self, lattice: &Lattice) -> Mesh {
        let points = self.loops.iter().flatten().chain(&self.patch.interior);
        Mesh {
            positions: points.map(|&point| lattice.world(point)).collect(),
            triangles: self.patch.triangles.clone(),
            triangle_nodes: vec![0; self.patch.triangles.len()],
        }
    }
}

/// Decodes the overview. Files whose coarsest cut takes more than the first request have one.
///
/// # Errors
/// [`crate::Error::Format`], [`crate::Error::Limit`].
pub fn overview(index: &Index) -> Result<Option<Overview>> {
    let Some(section) = index.overview() else { return Ok(None) };
    let overview = decode_section(section, index.tables(), index.limits(), &index.lattice());
    overview.map(Some).map_err(|error| error.at(|| "section overview".to_string()))
}

fn decode_section(section: &OverviewSection, tables: &Tables, limits: &Limits, lattice: &Lattice) -> Result<Overview> {
    let OverviewSection { error, quantisation, triangle_count, ref loops, ref stream } = *section;
    let limits = PatchLimits { vertices: limits.root_vertex_count, triangles: u64::from(triangle_count) };
    let mut symbols = Decoder::new(tables, stream)?;
    let patch = decode_patch(&mut symbols, loops, quantisation, limits)?;
    symbols.finish()?;
    check_patch(&patch, loops.iter().map(Vec::len).sum(), triangle_count)?;
    Ok(Overview { error: error.bound(lattice), loops: loops.clone(), patch })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{
        entropy::{SymbolBuffer, encode},
        filling::{
            Quantisation, Slide,
            irregular::{PatchTarget, encode_patch},
        },
    };
    use crate::format::error_code::ErrorCode;

    struct Stay;

    impl Slide for Stay {
        fn offset(&self, _: u32, _: [f64; 3], _: [f64; 3]) -> f64 {
            0.0
        }
    }

    /// A fan of six triangles around one vertex, and its tables.
    fn fan(lattice: &Lattice) -> (OverviewSection, Tables) {
        let ring = [[8, 0, 0], [4, 8, 0], [-4, 8, 4], [-8, 0, 0], [-4, -8, 0], [4, -8, 0]];
        let loops = vec![ring.to_vec()];
        let triangles: Vec<[u32; 3]> = (0..6).map(|k| [k, (k + 1) % 6, 6]).collect();
        let quantisation = Quantisation { normal_shift: 2, tangent_shift: 0 };
        let mut symbols = SymbolBuffer::default();
        let target = PatchTarget { loops: &loops, interior: &[[0.0; 3]], triangles: &triangles };
        encode_patch(&target, quantisation, &Stay, &mut symbols).unwrap();
        let tables = Tables::from_buffers([&symbols]);
        let stream = encode(&tables.codes(), [symbols.iter()]).unwrap();
        let error = ErrorCode::at_least(0.25, lattice).unwrap();
        (OverviewSection { error, quantisation, loops, triangle_count: 6, stream }, tables)
    }

    #[test]
    fn overviews_round_trip_with_their_border() {
        let lattice = Lattice { origin: [1.0, 2.0, 3.0], step_log2: -3 };
        let (written, tables) = fan(&lattice);
        let section = OverviewSection::parse(&written.write().unwrap(), &Limits::default()).unwrap();
        assert_eq!(section, written);
        let overview = decode_section(&section, &tables, &Limits::default(), &lattice).unwrap();
        let mesh = overview.mesh(&lattice);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (7, 6));
        assert_eq!(mesh.positions[0], [2.0, 2.0, 3.0]);
        assert!(overview.error >= 0.25 && overview.error < 0.252);
    }

    #[test]
    fn damaged_overviews_are_refused_or_small() {
        let lattice = Lattice::default();
        let (section, tables) = fan(&lattice);
        let bytes = section.write().unwrap();
        let draw = |bytes: &[u8]| {
            let section = OverviewSection::parse(bytes, &Limits::default())?;
            decode_section(&section, &tables, &Limits::default(), &lattice)
        };
        assert!((0..bytes.len()).all(|end| draw(&bytes[..end]).is_err()));
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            let _ = draw(&changed);
        }
    }
}
