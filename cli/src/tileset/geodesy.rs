//! Places on the globe: from WGS 84 longitudes and latitudes, and from its UTM zones, to earth-centred coordinates
//! (ECEF, EPSG:4978).
//!
//! UTM by the series of Krüger to the sixth order (Karney 2011, "Transverse Mercator with an accuracy of a few
//! nanometers"): within a zone it is better than a micrometre. Heights are above the ellipsoid.
#![expect(
    clippy::disallowed_methods,
    reason = "a place on the globe may differ in its last bit; no byte of a .lodpack file depends on it"
)]

use glam::DVec3;

/// Half axis of the ellipsoid at the equator, metres, and its flattening.
pub(super) const A: f64 = 6_378_137.0;
const F: f64 = 1.0 / 298.257_223_563;
/// Square of its eccentricity.
const E2: f64 = F * (2.0 - F);

/// Scale of UTM on its central meridian, and what is added to its coordinates.
const SCALE: f64 = 0.9996;
const FALSE_EASTING: f64 = 500_000.0;
const FALSE_NORTHING: f64 = 10_000_000.0;

/// Coordinate reference systems that are known here; all are WGS 84.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crs {
    /// EPSG:4978: metres from the middle of the earth.
    Geocentric,
    /// EPSG:4326 and EPSG:4979: degrees, the longitude first, and metres of height.
    Geographic,
    /// EPSG:32601 to 32660 and 32701 to 32760: metres east, north and up.
    Utm {
        /// 1 to 60.
        zone: u8,
        /// Whether northings count from 10,000 km south of the equator.
        is_south: bool,
    },
}

impl Crs {
    /// The system with a name as `EPSG:32632`, if it is known.
    pub fn of(name: &str) -> Option<Self> {
        match name.strip_prefix("EPSG:")?.parse::<u32>().ok()? {
            4978 => Some(Self::Geocentric),
            4326 | 4979 => Some(Self::Geographic),
            number @ 32601..=32660 => Some(Self::Utm { zone: (number - 32600) as u8, is_south: false }),
            number @ 32701..=32760 => Some(Self::Utm { zone: (number - 32700) as u8, is_south: true }),
            _ => None,
        }
    }

    /// Earth-centred coordinates of a point.
    pub fn ecef(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Geocentric => [x, y, z],
            Self::Geographic => from_geographic(x.to_radians(), y.to_radians(), z),
            Self::Utm { zone, is_south } => {
                let north = if is_south { y - FALSE_NORTHING } else { y };
                let (longitude, latitude) = from_transverse_mercator(x - FALSE_EASTING, north);
                from_geographic(longitude + (f64::from(zone) * 6.0 - 183.0).to_radians(), latitude, z)
            }
        }
    }
}

/// The directions east, north and up at a longitude and latitude in degrees.
pub fn east_north_up(longitude: f64, latitude: f64) -> [[f64; 3]; 3] {
    let (sin_l, cos_l) = longitude.to_radians().sin_cos();
    let (sin_b, cos_b) = latitude.to_radians().sin_cos();
    [[-sin_l, cos_l, 0.0], [-sin_b * cos_l, -sin_b * sin_l, cos_b], [cos_b * cos_l, cos_b * sin_l, sin_b]]
}

/// The directions up, east and north at a place in earth-centred coordinates: up is the normal of the ellipsoid through
/// it.
pub(super) fn up_east_north_at(place: DVec3) -> [DVec3; 3] {
    let flattened = 1.0 - F;
    let squared = DVec3::new(A, A, A * flattened).powf(2.0);
    let up = (place / squared).normalize_or(DVec3::Z);
    let east = DVec3::Z.cross(up).normalize_or(DVec3::Y);
    [up, east, up.cross(east)]
}

fn from_geographic(longitude: f64, latitude: f64, height: f64) -> [f64; 3] {
    let ((sin_l, cos_l), (sin_b, cos_b)) = (longitude.sin_cos(), latitude.sin_cos());
    // Radius of curvature across the meridian.
    let n = A / (1.0 - E2 * sin_b * sin_b).sqrt();
    [(n + height) * cos_b * cos_l, (n + height) * cos_b * sin_l, (n * (1.0 - E2) + height) * sin_b]
}

/// Longitude from the central meridian and latitude, in radians, of metres east and north in a projection like UTM's.
fn from_transverse_mercator(east: f64, north: f64) -> (f64, f64) {
    let n = F / (2.0 - F);
    let powers: [f64; 6] = std::array::from_fn(|k| (0..=k).map(|_| n).product());
    // Karney's beta: rows by multiple of the angle, columns by power of n from that on.
    const BETA: [[f64; 6]; 6] = [
        [1.0 / 2.0, -2.0 / 3.0, 37.0 / 96.0, -1.0 / 360.0, -81.0 / 512.0, 96_199.0 / 604_800.0],
        [0.0, 1.0 / 48.0, 1.0 / 15.0, -437.0 / 1440.0, 46.0 / 105.0, -1_118_711.0 / 3_870_720.0],
        [0.0, 0.0, 17.0 / 480.0, -37.0 / 840.0, -209.0 / 4480.0, 5569.0 / 90_720.0],
        [0.0, 0.0, 0.0, 4397.0 / 161_280.0, -11.0 / 504.0, -830_251.0 / 7_257_600.0],
        [0.0, 0.0, 0.0, 0.0, 4583.0 / 161_280.0, -108_847.0 / 3_991_680.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 20_648_693.0 / 638_668_800.0],
    ];
    let radius = A / (1.0 + n) * (1.0 + n * n / 4.0 + n.powi(4) / 64.0 + n.powi(6) / 256.0);
    let (xi, eta) = (north / (SCALE * radius), east / (SCALE * radius));
    let (mut xi_sphere, mut eta_sphere) = (xi, eta);
    for (k, row) in BETA.iter().enumerate() {
        let beta: f64 = row.iter().zip(powers).map(|(coefficient, power)| coefficient * power).sum();
        let angle = 2.0 * (k + 1) as f64;
        xi_sphere -= beta * (angle * xi).sin() * (angle * eta).cosh();
        eta_sphere -= beta * (angle * xi).cos() * (angle * eta).sinh();
    }
    let conformal = xi_sphere.sin() / (eta_sphere.sinh().powi(2) + xi_sphere.cos().powi(2)).sqrt();
    let longitude = eta_sphere.sinh().atan2(xi_sphere.cos());
    // Newton's method from the conformal to the geographic latitude, both as tangents; the third step is below
    // rounding.
    let (e, mut tangent) = (E2.sqrt(), conformal / (1.0 - E2));
    for _ in 0..5 {
        let secant = (1.0 + tangent * tangent).sqrt();
        let sigma = (e * (e * tangent / secant).atanh()).sinh();
        let found = tangent * (1.0 + sigma * sigma).sqrt() - sigma * secant;
        let slope = (1.0 + (1.0 - E2) * tangent * tangent) / ((1.0 - E2) * secant);
        tangent += (conformal - found) / (1.0 + found * found).sqrt() * slope;
    }
    (longitude, tangent.atan())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Made with pyproj 3.7.2 (PROJ 9.5.1): `Transformer.from_crs(CRS.from_epsg(code).to_3d(), 4978, always_xy=True)`.
    #[test]
    fn places_are_those_of_proj() {
        for (name, place, expected) in [
            ("EPSG:4979", [7.5, 46.95, 560.25], [4324815.085280, 569372.707581, 4638381.522877]),
            ("EPSG:4326", [-122.4, 37.8, -12.5], [-2703811.962362, -4260525.913449, 3887919.503932]),
            ("EPSG:4979", [151.2, -33.85, 1234.5], [-4647553.343608, 2555014.071963, -3533328.387163]),
            ("EPSG:4979", [0.0, 90.0, 0.0], [0.0, 0.0, 6356752.314245]),
            ("EPSG:4979", [180.0, -89.5, 8848.0], [-55923.479005, 0.0, -6365356.300518]),
            ("EPSG:32632", [500000.0, 5200000.0, 400.0], [4308037.390985, 682326.091068, 4638532.253119]),
            ("EPSG:32632", [712345.678, 5634567.891, 55.5], [3948832.188880, 840434.788740, 4921230.954595]),
            ("EPSG:32632", [166021.443, 0.0, 0.0], [6343196.898167, 666696.859041, 0.0]),
            ("EPSG:32756", [334567.8, 6250123.4, 10.0], [-4645742.932291, 2552826.057797, -3535065.715548]),
            ("EPSG:32756", [500000.0, 9999000.0, 0.0], [-5682961.608792, 2895613.568179, -1000.400156]),
            ("EPSG:32601", [800000.0, 9300000.0, 1000.0], [-679550.604117, -335972.429539, 6312701.040534]),
            ("EPSG:32733", [261000.0, 6243000.0, 100.0], [5174029.063533, 1138958.923817, -3539726.087136]),
            ("EPSG:4978", [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
        ] {
            let found = Crs::of(name).expect("it is known").ecef(place);
            for k in 0..3 {
                assert!((found[k] - expected[k]).abs() < 2e-6, "{name} {place:?}: {found:?} instead of {expected:?}");
            }
        }
        for name in ["EPSG:25832", "EPSG:32600", "EPSG:32661", "EPSG:32700", "EPSG:", "WGS84", ""] {
            assert_eq!(Crs::of(name), None, "{name}");
        }
    }

    #[test]
    fn east_north_and_up_are_where_a_place_moves() {
        let place = [12.0, -40.0, 100.0];
        let axes = east_north_up(place[0], place[1]);
        let from = Crs::Geographic.ecef(place);
        for (axis, step) in axes.iter().zip([[1e-6, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0, 0.0, 0.1]]) {
            let to = Crs::Geographic.ecef([0, 1, 2].map(|k| place[k] + step[k]));
            let moved = [0, 1, 2].map(|k| to[k] - from[k]);
            let length = moved.iter().map(|c| c * c).sum::<f64>().sqrt();
            assert!((0..3).all(|k| (moved[k] / length - axis[k]).abs() < 1e-6), "{moved:?} {axis:?}");
        }
    }
}
