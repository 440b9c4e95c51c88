//! The small section PLACEMENT: where a surface is in the world (SPEC.md, "Section PLACEMENT").

use crate::{
    codec::bytes::Cursor,
    error::{Error, Result},
};

/// Longest text of a coordinate reference system. Those of national grids with their transformations take some
/// kilobytes.
const MOST_CRS_BYTES: usize = 1 << 16;

/// Which axis of a file points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum UpAxis {
    /// Nobody has said.
    #[default]
    Unknown,
    /// y, as in glTF.
    Y,
    /// z, as in maps.
    Z,
}

/// Where a surface is in the world, as far as it is known.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Placement {
    /// The axis that points up.
    pub up: UpAxis,
    /// Metres in a world unit; none if unknown.
    pub unit: Option<f64>,
    /// What has to be added to coordinates, once they are in metres and have z up: see the specification.
    pub origin: [f64; 3],
    /// The coordinate reference system, as `EPSG:` and a number or as WKT; empty if there is none.
    pub crs: String,
}

impl Placement {
    /// Why a file cannot have this placement, if it cannot.
    pub fn fault(&self) -> Option<&'static str> {
        if self.unit.is_some_and(|unit| !(unit > 0.0 && unit.is_finite())) {
            Some("the unit is no length")
        } else if !self.origin.iter().all(|x| x.is_finite()) {
            Some("the origin is not finite")
        } else if self.crs.len() > MOST_CRS_BYTES {
            Some("the coordinate reference system takes more than 65,536 bytes")
        } else {
            None
        }
    }

    /// The bytes of the section: up axis, reserved bytes, unit, origin, then the CRS in UTF-8.
    pub(crate) fn write(&self) -> Result<Vec<u8>> {
        if let Some(fault) = self.fault() {
            return Err(Error::model(fault));
        }
        let mut bytes = vec![self.up as u8, 0, 0, 0, 0, 0, 0, 0];
        [self.unit.unwrap_or(0.0)].iter().chain(&self.origin).for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend(self.crs.as_bytes());
        Ok(bytes)
    }

    /// Reads what [`Placement::write`] wrote.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let up = match cursor.bytes(8)? {
            [0, 0, 0, 0, 0, 0, 0, 0] => UpAxis::Unknown,
            [1, 0, 0, 0, 0, 0, 0, 0] => UpAxis::Y,
            [2, 0, 0, 0, 0, 0, 0, 0] => UpAxis::Z,
            _ => return Err(Error::format("the up axis is unknown, or reserved bytes are not zero")),
        };
        let unit = Some(cursor.f64()?).filter(|&unit| unit != 0.0);
        let origin = [cursor.f64()?, cursor.f64()?, cursor.f64()?];
        let crs = std::str::from_utf8(cursor.bytes(cursor.left())?)
            .map_err(|_| Error::format("the coordinate reference system is not UTF-8"))?;
        let placement = Self { up, unit, origin, crs: crs.to_owned() };
        placement.fault().map_or(Ok(placement), |fault| Err(Error::format(fault)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_placement_survives_and_nonsense_is_refused() {
        let crs = "EPSG:32632".to_owned();
        let placement = Placement { up: UpAxis::Y, unit: Some(0.001), origin: [1.0, -2.0, 3e6], crs };
        let bytes = placement.write().unwrap();
        assert_eq!((bytes.len(), Placement::parse(&bytes).unwrap()), (50, placement.clone()));
        let none = Placement::default();
        assert_eq!(Placement::parse(&none.write().unwrap()).unwrap(), none);
        assert!((0..40).all(|end| Placement::parse(&bytes[..end]).is_err()));
        for (at, byte) in [(0, 3), (1, 1), (7, 1), (15, 0xBF), (40, 0xFF)] {
            let mut bad = bytes.clone();
            bad[at] = byte;
            assert!(Placement::parse(&bad).is_err(), "{at}");
        }
        assert!(Placement { unit: Some(f64::NAN), ..placement.clone() }.write().is_err());
        assert!(Placement { origin: [0.0, f64::INFINITY, 0.0], ..placement }.write().is_err());
    }
}
