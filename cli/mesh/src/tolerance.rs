//! Tolerances, as people type them.

use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// The largest certified error that a build may leave.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tolerance {
    /// Derived from the mean edge length, so that a scan keeps its shape with a fraction of its samples.
    Auto,
    /// In units of the input.
    InputUnits(f64),
    /// As a fraction of the bounding box's diagonal.
    OfDiagonal(f64),
    /// As a multiple of the input's mean edge length.
    OfMeanEdge(f64),
    /// As a multiple of the input's mean edge length times its mean bend: `auto` for grids of heights. Scans bend about
    /// equally much at all scales, but the coarser a grid of heights is, the flatter it is, and half an edge of a
    /// globe's grid is higher than its mountains.
    OfBend(f64),
    /// In metres; requires that the input's unit is known.
    Metres(f64),
}

/// The length of one unit of the input.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// In metres.
    pub metres: f64,
}

const UNITS: [(&str, f64); 9] = [
    ("um", 1e-6),
    ("mm", 1e-3),
    ("cm", 1e-2),
    ("dm", 1e-1),
    ("km", 1e3),
    ("in", 0.0254),
    ("ft", 0.3048),
    ("yd", 0.9144),
    ("m", 1.0),
];

impl FromStr for Unit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = UNITS.iter().find(|(name, _)| *name == text);
        found
            .map(|&(_, metres)| Self { metres })
            .ok_or_else(|| format!("unknown unit '{text}'; use one of {}", UNITS.map(|(name, _)| name).join(", ")))
    }
}

impl FromStr for Tolerance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let suffix_at = text.find(|c: char| c == '%' || c.is_ascii_alphabetic() && c != 'e' && c != 'E');
        let (number, suffix) = match text.strip_suffix("edges").or(text.strip_suffix("edge")) {
            Some(number) => (number, "edge"),
            None => text.split_at(suffix_at.unwrap_or(text.len())),
        };
        let value: f64 = number
            .trim()
            .parse()
            .map_err(|_| format!("'{text}' is not a tolerance; write auto, 0.05, 0.05mm, 0.01% or 0.4edge"))?;
        // 0 is refused where it has no meaning: everywhere but for heights that are integers.
        if !value.is_finite() || value < 0.0 {
            return Err(format!("a tolerance must not be less than 0, as '{text}' is"));
        }
        match suffix {
            "" => Ok(Self::InputUnits(value)),
            "%" => Ok(Self::OfDiagonal(value / 100.0)),
            "edge" => Ok(Self::OfMeanEdge(value)),
            unit => Ok(Self::Metres(value * unit.parse::<Unit>()?.metres)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_documented_spelling_is_read() {
        assert_eq!("auto".parse(), Ok(Tolerance::Auto));
        assert_eq!("1e-3".parse(), Ok(Tolerance::InputUnits(1e-3)));
        assert_eq!("0.5%".parse(), Ok(Tolerance::OfDiagonal(0.005)));
        assert_eq!("0.4edge".parse(), Ok(Tolerance::OfMeanEdge(0.4)));
        assert_eq!("2 mm".parse(), Ok(Tolerance::Metres(0.002)));
        for bad in ["", "mm", "-1", "nan", "inf", "1 parsec"] {
            assert!(bad.parse::<Tolerance>().is_err(), "{bad}");
        }
    }
}
