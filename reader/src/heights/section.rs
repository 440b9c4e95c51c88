//! Section HEIGHTS: what is stored, where, and the beginning of the tree of tiles (SPEC.md, "Section HEIGHTS").

use super::{
    grid::Grid,
    surface::{Base, Surface},
};
use crate::{
    codec::bytes::{Cursor, put_varint},
    error::{Error, Result},
    format::sections::Part,
    limits::Limits,
};

/// The longest name of a ramp.
const MOST_RAMP_BYTES: usize = 255;

/// What a file of heights says about all of it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HeightsInfo {
    /// The samples.
    pub grid: Grid,
    /// Where they are.
    pub surface: Surface,
    /// The height of step 0.
    pub zero: f64,
    /// What a step adds to a height.
    pub step: f64,
    /// No stored sample is further from the sample that it was made from, vertically and in units of heights.
    pub sample_error: f64,
    /// Metres in a unit of heights; none if unknown.
    pub unit: Option<f64>,
    /// The name of the colour ramp to draw with; empty if there is none.
    pub ramp: String,
}

impl HeightsInfo {
    /// Why a file cannot say this, if it cannot.
    pub fn fault(&self) -> Option<&'static str> {
        let is_height = |x: f64| x.abs() < 1e15;
        let is_around = self.grid.wraps() || self.grid.poles() != [false; 2];
        // Half a column is more than any rounding of spacings.
        let spacing = self.surface.spacing[0];
        let is_closed = (self.grid.cells()[0] as f64 * spacing - 360.0).abs() < 0.5 * spacing;
        if is_around && !self.surface.is_globe() || self.grid.wraps() && !is_closed {
            Some("a grid wraps that does not go around a globe, or a plane has a pole")
        } else if self.surface.check().is_err() {
            Some("the place of a grid of heights is not finite, or has a wrong sign")
        } else if !(is_height(self.zero) && is_height(self.step) && self.step > 0.0) {
            Some("the height of step 0, or what a step adds, is out of range")
        } else if !(self.sample_error >= 0.0 && is_height(self.sample_error)) {
            Some("the error of samples is negative or out of range")
        } else if self.unit.is_some_and(|unit| !(unit > 0.0 && is_height(unit))) {
            Some("the unit of heights is no length")
        } else if self.ramp.len() > MOST_RAMP_BYTES {
            Some("the name of the ramp takes more than 255 bytes")
        } else {
            None
        }
    }

    /// The height of a sample.
    pub fn height(&self, steps: i32) -> f64 {
        self.zero + f64::from(steps) * self.step
    }
}

/// The section.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct HeightsSection {
    pub info: HeightsInfo,
    /// The index page of each tile at depth 0; one without bytes if there is no such tile.
    pub pages: Vec<Part>,
    /// The blocks of these tiles.
    pub blocks: Vec<u8>,
}

impl HeightsSection {
    /// The section's bytes.
    pub fn write(&self) -> Vec<u8> {
        let HeightsInfo { grid, surface, zero, step, sample_error, unit, ramp } = &self.info;
        let mut bytes = Vec::new();
        grid.cells().iter().for_each(|count| bytes.extend(count.to_le_bytes()));
        let [first, last] = grid.poles();
        bytes.push(u8::from(grid.wraps()) | u8::from(first) << 1 | u8::from(last) << 2);
        let (base, axis, eccentricity) = match surface.base {
            Base::Plane => (0, 0.0, 0.0),
            Base::Ellipsoid { axis, eccentricity } => (1, axis, eccentricity),
        };
        bytes.extend([base, 0, 0, 0, 0, 0, 0]);
        let numbers = [axis, eccentricity].into_iter().chain(surface.first).chain(surface.spacing);
        let numbers = numbers.chain([surface.height_scale, *zero, *step, *sample_error, unit.unwrap_or(0.0)]);
        numbers.for_each(|number| bytes.extend(number.to_le_bytes()));
        put_varint(&mut bytes, ramp.len() as u64);
        bytes.extend(ramp.as_bytes());
        self.pages.iter().for_each(|page| page.write(&mut bytes));
        bytes.extend(&self.blocks);
        bytes
    }

    /// Reads what [`HeightsSection::write`] wrote.
    pub fn parse(bytes: &[u8], limits: &Limits) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let cells = [cursor.u64()?, cursor.u64()?];
        let (flags, base) = (cursor.u8()?, cursor.u8()?);
        cursor.reserved(6)?;
        let (axis, eccentricity) = (cursor.f64()?, cursor.f64()?);
        let base = match base {
            0 if axis == 0.0 && eccentricity == 0.0 => Base::Plane,
            1 => Base::Ellipsoid { axis, eccentricity },
            _ => return Err(Error::format("heights stand on something unknown")),
        };
        if flags > 7 {
            return Err(Error::format("a reserved flag is set"));
        }
        let grid = Grid::new(cells, flags & 1 != 0, [flags & 2 != 0, flags & 4 != 0])?;
        let (first, spacing) = ([cursor.f64()?, cursor.f64()?], [cursor.f64()?, cursor.f64()?]);
        let surface = Surface { base, first, spacing, height_scale: cursor.f64()? };
        let (zero, step, sample_error) = (cursor.f64()?, cursor.f64()?, cursor.f64()?);
        let unit = Some(cursor.f64()?).filter(|&unit| unit != 0.0);
        let ramp_bytes =
            cursor.varint_up_to(MOST_RAMP_BYTES as u64, "the name of the ramp takes more than 255 bytes")?;
        let ramp = std::str::from_utf8(cursor.bytes(ramp_bytes as usize)?);
        let ramp = ramp.map_err(|_| Error::format("the name of the ramp is not UTF-8"))?.to_owned();
        let info = HeightsInfo { grid, surface, zero, step, sample_error, unit, ramp };
        if let Some(fault) = info.fault() {
            return Err(Error::format(fault));
        }
        let mut next = 0;
        let pages: Vec<Part> =
            info.grid.root_tiles().map(|_| Part::parse(&mut cursor, &mut next, limits)).collect::<Result<_>>()?;
        Ok(Self { info, pages, blocks: cursor.bytes(cursor.left())?.to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_section_survives_and_nonsense_is_refused() {
        let base = Base::Ellipsoid { axis: 6_378_137.0, eccentricity: 0.006 };
        let surface = Surface { base, first: [-180.0, 90.0], spacing: [0.1, -0.1], height_scale: 1.0 };
        let grid = Grid::new([3600, 1800], true, [true, true]).unwrap();
        let (zero, step, unit, ramp) = (-500.0, 0.5, Some(1.0), "earth".to_owned());
        let info = HeightsInfo { grid, surface, zero, step, sample_error: 0.25, unit, ramp };
        assert_eq!(info.height(3), -498.5);
        let pages = vec![Part { offset: 0, length: 70, checksum: 3 }, Part { offset: 70, length: 9, checksum: 4 }];
        let section = HeightsSection { info, pages, blocks: vec![1, 2, 3] };
        let (bytes, limits) = (section.write(), Limits::default());
        assert_eq!(HeightsSection::parse(&bytes, &limits).unwrap(), section);
        assert!((0..bytes.len() - 3).all(|end| HeightsSection::parse(&bytes[..end], &limits).is_err()));
        for (at, byte) in [(7, 1), (16, 8), (17, 2), (17, 0), (18, 1), (63, 0x7f), (71, 0x40), (95, 0xbf), (103, 0xc0)]
        {
            let mut bad = bytes.clone();
            bad[at] = byte;
            assert!(HeightsSection::parse(&bad, &limits).is_err(), "{at}");
        }
        let bad = HeightsInfo { ramp: "x".repeat(256), ..section.info.clone() };
        assert!(bad.fault().is_some());
        let bad = HeightsInfo { unit: Some(-1.0), ..section.info };
        assert!(bad.fault().is_some());
    }
}
