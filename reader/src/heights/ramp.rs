//! Section RAMP: colours by height (SPEC.md, "Section RAMP").

use crate::{
    codec::bytes::Cursor,
    error::{Error, Result},
};

/// A ramp has at most this many stops.
const MOST_STOPS: usize = 1024;

/// A colour at a height.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RampStop {
    /// In units of heights.
    pub height: f64,
    /// Red, green and blue as screens show them (sRGB).
    pub colour: [u8; 3],
}

/// Colours by height. Between two stops, the three numbers of a colour change evenly; beyond the first and the last one
/// they do not change.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Ramp {
    stops: Vec<RampStop>,
}

impl Ramp {
    /// A ramp with these stops, 1 to 1,024, whose heights do not fall. Of two at one height, the first one ends what is
    /// below, and the second one begins what is from there up.
    ///
    /// # Errors
    /// [`Error::Model`] if a file cannot have it.
    pub fn new(stops: Vec<RampStop>) -> Result<Self> {
        match fault(&stops) {
            Some(fault) => Err(Error::model(fault)),
            None => Ok(Self { stops }),
        }
    }

    /// Its stops.
    pub fn stops(&self) -> &[RampStop] {
        &self.stops
    }

    /// The colour of a height, as screens show it.
    pub fn colour(&self, height: f64) -> [u8; 3] {
        let above = self.stops.partition_point(|stop| stop.height <= height);
        let (before, after) = (above.checked_sub(1).and_then(|k| self.stops.get(k)), self.stops.get(above));
        match (before, after) {
            (Some(before), Some(after)) => {
                let share = (height - before.height) / (after.height - before.height);
                let mix = |k: usize| {
                    let [from, to] = [before, after].map(|stop| f64::from(stop.colour[k]));
                    (from + share * (to - from)).round() as u8
                };
                [mix(0), mix(1), mix(2)]
            }
            (one, other) => one.or(other).map_or([0; 3], |stop| stop.colour),
        }
    }

    /// The section's bytes.
    #[cfg(feature = "write")]
    pub(super) fn write(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        crate::codec::bytes::put_varint(&mut bytes, self.stops.len() as u64);
        for RampStop { height, colour } in &self.stops {
            bytes.extend(height.to_le_bytes());
            bytes.extend(colour);
        }
        bytes
    }

    /// Reads what [`Ramp::write`] wrote.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut cursor = Cursor::new(bytes);
        let count = cursor.varint_up_to(MOST_STOPS as u64, "a ramp has more than 1,024 stops")?;
        let stop = |_| -> Result<RampStop> {
            let height = cursor.f64()?;
            Ok(RampStop { height, colour: [cursor.u8()?, cursor.u8()?, cursor.u8()?] })
        };
        let stops: Vec<RampStop> = (0..count).map(stop).collect::<Result<_>>()?;
        cursor.finish()?;
        match fault(&stops) {
            Some(fault) => Err(Error::format(fault)),
            None => Ok(Self { stops }),
        }
    }
}

/// Why a file cannot have these stops, if it cannot.
fn fault(stops: &[RampStop]) -> Option<&'static str> {
    let is_height = |x: f64| x.abs() < 1e15;
    if stops.is_empty() || stops.len() > MOST_STOPS {
        Some("a ramp does not have 1 to 1,024 stops")
    } else if stops.iter().any(|stop| !is_height(stop.height)) {
        Some("the height of a stop of the ramp is out of range")
    } else if stops.windows(2).any(|pair| pair[1].height < pair[0].height) {
        Some("the heights of a ramp's stops fall")
    } else {
        None
    }
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::*;

    fn stop(height: f64, shade: u8) -> RampStop {
        RampStop { height, colour: [shade, 2, 255 - shade] }
    }

    #[test]
    fn colours_lie_between_stops_and_stay_beyond_them() {
        let ramp = Ramp::new(vec![stop(0.0, 0), stop(10.0, 100), stop(10.0, 200), stop(20.0, 210)]).unwrap();
        let reds = [-5.0, 0.0, 5.0, 9.999, 10.0, 15.0, 20.0, 1e9, f64::NAN].map(|height| ramp.colour(height)[0]);
        assert_eq!(reds, [0, 0, 50, 100, 200, 205, 210, 210, 0]);
        assert_eq!(ramp.colour(5.0), [50, 2, 205]);
    }

    #[test]
    fn sections_come_back_and_nonsense_is_refused() {
        let ramp = Ramp::new(vec![stop(-3.5, 1), stop(2.0, 9)]).unwrap();
        let bytes = ramp.write();
        assert_eq!(Ramp::parse(&bytes).unwrap(), ramp);
        assert!((0..bytes.len()).all(|end| Ramp::parse(&bytes[..end]).is_err()));
        assert!(Ramp::parse(&[&bytes[..], &[0]].concat()).is_err());
        assert!(Ramp::parse(&[0]).is_err());
        for bad in [vec![], vec![stop(f64::NAN, 0)], vec![stop(1e15, 0)], vec![stop(2.0, 0), stop(1.0, 0)]] {
            assert!(Ramp::new(bad).is_err());
        }
        assert!(Ramp::new(vec![stop(0.0, 0); 1025]).is_err());
        // NaN in place of the second height.
        let mut bad = bytes;
        bad[12..20].fill(0xff);
        assert!(Ramp::parse(&bad).is_err());
    }
}
