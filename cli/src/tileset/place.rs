//! Where a file's coordinates are on the globe, as the transform of a tileset.

use super::Frame;
use super::geodesy::{Crs, east_north_up};
use lodpack::index::{Placement, UpAxis};

/// Why a file cannot be put on the globe.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum PlaceError {
    /// A system without formulas here.
    #[error(
        "the file's CRS, {name}, has no formulas here: known are EPSG:4978, 4979, 4326, and UTM on WGS 84 (EPSG:32601 to 32660 and 32701 to \
         32760); --local writes a tileset without a place, whose transform another program can set"
    )]
    UnknownCrs {
        /// Its name, shortened.
        name: String,
    },
    /// An up axis in earth-centred coordinates.
    #[error("coordinates of EPSG:4978 have no axis that is up, but this file has y up: omit --up, or pass --up z")]
    NoUp,
    /// A longitude, latitude or projected coordinate that is on no globe.
    #[error(
        "the file's origin and coordinates lead to no place on the globe in {name}: {place:?}; check --origin and --unit of `lodpack build`"
    )]
    NoPlace {
        /// The system.
        name: String,
        /// Its coordinates of the middle.
        place: [f64; 3],
    },
}

/// A frame, and by how much it is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// The transform.
    pub frame: Frame,
    /// By how many metres the corners of the file's box are at most off, because a transform does not bend with the
    /// globe.
    pub deviation: f64,
}

/// Puts a file with this box at its place; `up` replaces what the file says. A file without a CRS gets a local frame.
///
/// # Errors
/// [`PlaceError`].
pub fn place(placement: &Placement, up: Option<UpAxis>, bounds: [[f64; 3]; 2]) -> Result<Placed, PlaceError> {
    let unit = placement.unit.unwrap_or(1.0);
    let up = match up.unwrap_or(placement.up) {
        // Maps have z up, other models mostly y.
        UpAxis::Unknown if placement.crs.is_empty() => UpAxis::Y,
        UpAxis::Unknown => UpAxis::Z,
        known => known,
    };
    // Metres, z up, relative to the placement's origin.
    let axes = Frame::local(up == UpAxis::Y).axes.map(|axis| axis.map(|c| c * unit));
    let [x, y, z] = axes;
    let metres = |p: [f64; 3]| [0, 1, 2].map(|k| x[k] * p[0] + y[k] * p[1] + z[k] * p[2]);
    let add = |p: [f64; 3]| [0, 1, 2].map(|k| placement.origin[k] + p[k]);
    let exact = |frame| Ok(Placed { frame, deviation: 0.0 });
    if placement.crs.is_empty() {
        return exact(Frame { axes, origin: placement.origin });
    }
    let name = || placement.crs.chars().take(60).filter(|c| !c.is_control()).collect();
    let crs = Crs::of(&placement.crs).ok_or_else(|| PlaceError::UnknownCrs { name: name() })?;
    let middle = [0, 1, 2].map(|k| 0.5 * (bounds[0][k] + bounds[1][k]));
    let no_place = |place| Err(PlaceError::NoPlace { name: name(), place });
    match crs {
        Crs::Geocentric if up == UpAxis::Y => Err(PlaceError::NoUp),
        Crs::Geocentric => exact(Frame { axes, origin: placement.origin }),
        Crs::Geographic => {
            let [longitude, latitude, _] = placement.origin;
            if longitude.abs() > 360.0 || latitude.abs() > 90.0 {
                return no_place(placement.origin);
            }
            let to = east_north_up(longitude, latitude);
            exact(Frame { axes: axes.map(|axis| combine(to, axis)), origin: crs.ecef(placement.origin) })
        }
        Crs::Utm { .. } => {
            let at = add(metres(middle));
            // Far from a zone its series lead anywhere.
            if !(-2e6..3e6).contains(&at[0]) || !(-1e7..2e7).contains(&at[1]) || at[2].abs() > 1e7 {
                return no_place(at);
            }
            // How a place moves with each coordinate: within 20 m of it the third derivative is below rounding.
            const STEP: f64 = 10.0;
            let slope = |k: usize| {
                let moved = |by: f64| crs.ecef([0, 1, 2].map(|j| at[j] + if j == k { by } else { 0.0 }));
                let (ahead, behind) = (moved(STEP), moved(-STEP));
                [0, 1, 2].map(|j| (ahead[j] - behind[j]) / (2.0 * STEP))
            };
            let axes = axes.map(|axis| combine([slope(0), slope(1), slope(2)], axis));
            let (here, away) = (crs.ecef(at), combine(axes, middle));
            let frame = Frame { axes, origin: [0, 1, 2].map(|k| here[k] - away[k]) };
            let deviation = |corner: [f64; 3]| {
                let (drawn, true_place) = (combine(axes, corner), crs.ecef(add(metres(corner))));
                (0..3).map(|k| drawn[k] + frame.origin[k] - true_place[k]).map(|c| c * c).sum::<f64>().sqrt()
            };
            let corners = (0..8).map(|n| [0, 1, 2].map(|k| bounds[(n >> k) & 1][k]));
            Ok(Placed { frame, deviation: corners.map(deviation).fold(0.0, f64::max) })
        }
    }
}

/// A projected system, whose coordinates can be put on the globe one by one: heights of a whole country do not stay
/// flat.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    crs: Crs,
    origin: [f64; 3],
    /// Metres in a unit of the file.
    pub unit: f64,
}

impl Projection {
    /// That of a file with z up, if it has one that is known here.
    pub fn of(placement: &Placement) -> Option<Self> {
        let crs = Crs::of(&placement.crs).filter(|crs| matches!(crs, Crs::Utm { .. }))?;
        Some(Self { crs, origin: placement.origin, unit: placement.unit.unwrap_or(1.0) })
    }

    /// Earth-centred coordinates of a position of the file.
    pub fn ecef(&self, position: [f64; 3]) -> [f64; 3] {
        self.crs.ecef([0, 1, 2].map(|k| self.origin[k] + self.unit * position[k]))
    }
}

/// A vector of so much of each axis.
fn combine(axes: [[f64; 3]; 3], amounts: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| axes[0][k] * amounts[0] + axes[1][k] * amounts[1] + axes[2][k] * amounts[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply(frame: &Frame, point: [f64; 3]) -> [f64; 3] {
        let moved = combine(frame.axes, point);
        [0, 1, 2].map(|k| frame.origin[k] + moved[k])
    }

    fn near(a: [f64; 3], b: [f64; 3], within: f64) -> bool {
        (0..3).all(|k| (a[k] - b[k]).abs() <= within)
    }

    #[test]
    fn a_town_in_utm_is_where_it_is() {
        let crs = "EPSG:32632".to_owned();
        // Millimetres, y up: 200 m to the east, 50 m up, 100 m to the south.
        let origin = [712_345.678, 5_634_567.891, 55.5];
        let placement = Placement { up: UpAxis::Y, unit: Some(0.001), origin, crs };
        let bounds = [[0.0, 0.0, 0.0], [4e5, 1e5, 2e5]];
        let placed = place(&placement, None, bounds).expect("it is known");
        let there =
            Crs::of("EPSG:32632").expect("known").ecef([origin[0] + 200.0, origin[1] - 100.0, origin[2] + 50.0]);
        assert!(near(apply(&placed.frame, [2e5, 5e4, 1e5]), there, 1e-6));
        // Two hundred metres away, the globe has fallen by 4 mm.
        assert!((1e-3..2e-2).contains(&placed.deviation), "{}", placed.deviation);
        let corner = Crs::of("EPSG:32632").expect("known").ecef([origin[0] + 400.0, origin[1], origin[2]]);
        assert!(near(apply(&placed.frame, [4e5, 0.0, 0.0]), corner, placed.deviation * 1.001));
    }

    #[test]
    fn a_model_at_a_longitude_and_latitude_stands_upright() {
        let placement = Placement { crs: "EPSG:4979".into(), origin: [7.5, 46.95, 560.25], ..Placement::default() };
        let placed = place(&placement, None, [[0.0; 3], [1.0; 3]]).expect("it is known");
        assert!(near(apply(&placed.frame, [0.0; 3]), [4324815.085280, 569372.707581, 4638381.522877], 2e-6));
        // z is up.
        let above = Crs::Geographic.ecef([7.5, 46.95, 570.25]);
        assert!(near(apply(&placed.frame, [0.0, 0.0, 10.0]), above, 1e-6) && placed.deviation == 0.0);
    }

    #[test]
    fn files_without_a_system_are_local_and_unknown_systems_are_named() {
        let bounds = [[0.0; 3], [1.0; 3]];
        let local = place(&Placement { unit: Some(0.01), ..Placement::default() }, None, bounds).expect("it is local");
        assert_eq!(apply(&local.frame, [0.0, 100.0, 0.0]), [0.0, 0.0, 1.0]);
        let local = place(&Placement::default(), Some(UpAxis::Z), bounds).expect("it is local");
        assert_eq!(local.frame, Frame::local(false));
        let of = |crs: &str, up, origin| place(&Placement { crs: crs.into(), up, origin, unit: None }, None, bounds);
        let exact = of("EPSG:4978", UpAxis::Z, [4e6, 5e5, 4.6e6]).expect("it is known");
        assert_eq!(apply(&exact.frame, [1.0, 2.0, 3.0]), [4e6 + 1.0, 5e5 + 2.0, 4.6e6 + 3.0]);
        assert_eq!(of("EPSG:4978", UpAxis::Y, [0.0; 3]), Err(PlaceError::NoUp));
        let unknown = of("EPSG:25832", UpAxis::Z, [0.0; 3]).expect_err("it is unknown").to_string();
        assert!(
            unknown.contains("EPSG:25832") && unknown.contains("32760") && unknown.contains("--local"),
            "{unknown}"
        );
        assert!(matches!(of("EPSG:4326", UpAxis::Z, [0.0, 95.0, 0.0]), Err(PlaceError::NoPlace { .. })));
        assert!(matches!(of("EPSG:32632", UpAxis::Z, [5e8, 0.0, 0.0]), Err(PlaceError::NoPlace { .. })));
    }
}
