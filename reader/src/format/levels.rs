//! Section LEVELS: the levels of a file, and the steps of its fillings (SPEC.md, "Section LEVELS").

use crate::{
    codec::{
        arc::MAX_TANGENT_SHIFT,
        bytes::Cursor,
        filling::{Filling, Quantisation},
    },
    error::{Error, Result},
    format::records::MAX_LEVELS,
};

/// What the section says about one level, in 40 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct LevelRecord {
    /// f64: the error that the builder aimed at.
    pub tolerance: f64,
    /// f64: bound of the error when every root is drawn at this level.
    pub max_error: f64,
    /// u64: triangles when every root is drawn at this level, before stitching adds any.
    pub triangle_count: u64,
    /// u64: start of the level's pages in PAGES.
    pub page_offset: u64,
    /// u64: their size.
    pub page_bytes: u64,
}

/// A filling in the file's list: its code and the size of its parameters (u16 each), then the parameters, which are two
/// shifts per level (u8 each).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct FillingSteps {
    /// Which filling.
    pub filling: Filling,
    /// The steps of its vertices, level by level.
    pub levels: Vec<Quantisation>,
}

/// The whole section: level count, arc tangent shift, index arc levels, filling count (u8 each), arc run samples (u16),
/// two zero bytes; then the levels, then the fillings.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Levels {
    pub arc_tangent_shift: u8,
    /// The number of levels whose arc samples lie in the index blocks, next to the corners, instead of in pages; at
    /// least 1.
    pub index_arc_levels: u8,
    /// An arc run ends once it has this many samples in pages; at least 1.
    pub arc_run_samples: u16,
    /// Coarse to fine.
    pub levels: Vec<LevelRecord>,
    /// By code. A root names its filling by its place in this list.
    pub fillings: Vec<FillingSteps>,
}

impl Levels {
    /// The steps of a filling at a level.
    pub(crate) fn quantisation(&self, filling: Filling, level: u8) -> Quantisation {
        let steps = self.fillings.iter().find(|steps| steps.filling == filling);
        steps.and_then(|steps| steps.levels.get(usize::from(level))).copied().unwrap_or_default()
    }

    /// The section's bytes.
    pub(crate) fn write(&self) -> Vec<u8> {
        let counts =
            [self.levels.len() as u8, self.arc_tangent_shift, self.index_arc_levels, self.fillings.len() as u8];
        let mut bytes = Vec::from(counts);
        bytes.extend(self.arc_run_samples.to_le_bytes());
        bytes.extend([0; 2]);
        for level in &self.levels {
            bytes.extend(level.tolerance.to_le_bytes());
            bytes.extend(level.max_error.to_le_bytes());
            bytes.extend(level.triangle_count.to_le_bytes());
            bytes.extend(level.page_offset.to_le_bytes());
            bytes.extend(level.page_bytes.to_le_bytes());
        }
        for FillingSteps { filling, levels } in &self.fillings {
            bytes.extend(filling.descriptor().code.to_le_bytes());
            bytes.extend((2 * levels.len() as u16).to_le_bytes());
            levels.iter().for_each(|steps| bytes.extend([steps.normal_shift, steps.tangent_shift]));
        }
        bytes
    }

    /// Reads the section; `pages_bytes` is the size of the section PAGES, which the levels' pages must fill.
    ///
    /// # Errors
    /// [`Error::Format`] if a rule is broken, [`Error::Unsupported`] if the file uses an unknown filling.
    pub(crate) fn parse(bytes: &[u8], pages_bytes: u64) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let level_count = cursor.u8()?;
        if level_count == 0 || usize::from(level_count) > MAX_LEVELS {
            return Err(Error::format("there is no level, or more than 24"));
        }
        let (arc_tangent_shift, index_arc_levels, filling_count) = (cursor.u8()?, cursor.u8()?, cursor.u8()?);
        if arc_tangent_shift > MAX_TANGENT_SHIFT {
            return Err(Error::format("a shift is above 40"));
        }
        let arc_run_samples = cursor.u16()?;
        cursor.reserved(2)?;
        if index_arc_levels == 0 || index_arc_levels > level_count || arc_run_samples == 0 {
            return Err(Error::format("index blocks hold the arc samples of no level, or arc runs have no size"));
        }
        let mut levels: Vec<LevelRecord> = Vec::new();
        let mut next_offset = 0_u64;
        for _ in 0..level_count {
            let (tolerance, max_error) = (cursor.f64()?, cursor.f64()?);
            let (triangle_count, page_offset, page_bytes) = (cursor.u64()?, cursor.u64()?, cursor.u64()?);
            let coarser = levels.last().map_or(f64::INFINITY, |coarser| coarser.tolerance);
            if !(0.0..=coarser).contains(&tolerance) || max_error < 0.0 {
                return Err(Error::format("tolerances grow, or an error is negative"));
            }
            if page_offset != next_offset {
                return Err(Error::format("a level's pages do not follow the coarser level's"));
            }
            next_offset = page_offset.checked_add(page_bytes).ok_or_else(|| Error::format("pages end beyond 2^64"))?;
            levels.push(LevelRecord { tolerance, max_error, triangle_count, page_offset, page_bytes });
        }
        let mut fillings: Vec<FillingSteps> = Vec::new();
        for _ in 0..filling_count {
            let steps = parse_filling(&mut cursor, level_count)?;
            if fillings.last().is_some_and(|last| last.filling >= steps.filling) {
                return Err(Error::format("fillings are not listed by ascending code"));
            }
            fillings.push(steps);
        }
        cursor.finish()?;
        if next_offset != pages_bytes {
            return Err(Error::format("the levels' pages do not fill the section PAGES"));
        }
        Ok(Self { arc_tangent_shift, index_arc_levels, arc_run_samples, levels, fillings })
    }
}

fn parse_filling(cursor: &mut Cursor<'_>, level_count: u8) -> Result<FillingSteps> {
    let (code, size) = (cursor.u16()?, cursor.u16()?);
    let filling = Filling::from_code(code)
        .ok_or_else(|| Error::Unsupported { what: format!("filling {code}, which roots of this file have") })?;
    if size != 2 * u16::from(level_count) {
        return Err(Error::format("a filling's parameters are not two shifts per level"));
    }
    let mut levels = Vec::new();
    for _ in 0..level_count {
        let steps = Quantisation { normal_shift: cursor.u8()?, tangent_shift: cursor.u8()? };
        if !steps.is_valid() {
            return Err(Error::format("a shift is above 40"));
        }
        levels.push(steps);
    }
    Ok(FillingSteps { filling, levels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_section_survives_and_its_prefixes_are_refused() {
        let record =
            |tolerance, page_offset| LevelRecord { tolerance, page_offset, page_bytes: 300, ..LevelRecord::default() };
        let steps = |filling| FillingSteps {
            filling,
            levels: vec![Quantisation { normal_shift: 2, tangent_shift: 3 }, Quantisation::default()],
        };
        let levels = Levels {
            arc_tangent_shift: 3,
            index_arc_levels: 1,
            arc_run_samples: 700,
            levels: vec![record(4.0, 0), record(1.0, 300)],
            fillings: Filling::all().map(steps).collect(),
        };
        let bytes = levels.write();
        assert_eq!(Levels::parse(&bytes, 600).unwrap(), levels);
        assert_eq!(levels.quantisation(Filling::Grid, 0).tangent_shift, 3);
        assert!(Levels::parse(&bytes, 601).is_err());
        assert!((0..bytes.len()).all(|end| Levels::parse(&bytes[..end], 600).is_err()));
        let swapped = Levels { fillings: levels.fillings.iter().rev().cloned().collect(), ..levels };
        assert!(Levels::parse(&swapped.write(), 600).is_err());
    }
}
