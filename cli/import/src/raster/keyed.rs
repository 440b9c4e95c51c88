//! Projected systems without a number that a GeoTIFF defines by keys (OGC 19-008r4, 7.4 and 7.5), as WKT of GDAL.

use std::fmt::Write;

use super::crs::{globe_of, globe_wkt, text_of};
use super::geokeys::{
    ANGULAR_UNITS, CITATION, GEODETIC_CITATION, GEODETIC_CRS, GeoTags, METHOD, PROJECTED_CITATION, PROJECTION,
};

const PRIME_MERIDIAN: u16 = 2061;
const PARALLELS: [u16; 2] = [3078, 3079];
// Programs differ in which of these they write for a method.
const LONGITUDES: &[u16] = &[3080, 3084, 3088, 3095];
const LATITUDES: &[u16] = &[3081, 3085, 3089];
const EASTINGS: &[u16] = &[3082, 3086, 3090];
const NORTHINGS: &[u16] = &[3083, 3087, 3091];
const SCALES: &[u16] = &[3092, 3093];

/// A method of projection in the words of WKT 1.
struct Method {
    code: u16,
    name: &'static str,
    /// Empty where it has none.
    latitude: &'static str,
    longitude: &'static str,
    has_scale: bool,
    parallels: usize,
}

const fn method(
    code: u16,
    name: &'static str,
    [latitude, longitude]: [&'static str; 2],
    has_scale: bool,
    parallels: usize,
) -> Method {
    Method { code, name, latitude, longitude, has_scale, parallels }
}

const ORIGIN: [&str; 2] = ["latitude_of_origin", "central_meridian"];
const CENTER: [&str; 2] = ["latitude_of_center", "longitude_of_center"];
const TRANSVERSE_MERCATOR: Method = method(1, "Transverse_Mercator", ORIGIN, true, 0);
const METHODS: [Method; 13] = [
    TRANSVERSE_MERCATOR,
    method(7, "Mercator_1SP", ["", "central_meridian"], true, 0),
    method(8, "Lambert_Conformal_Conic_2SP", ORIGIN, false, 2),
    method(9, "Lambert_Conformal_Conic_1SP", ORIGIN, true, 0),
    method(10, "Lambert_Azimuthal_Equal_Area", CENTER, false, 0),
    method(11, "Albers_Conic_Equal_Area", CENTER, false, 2),
    method(12, "Azimuthal_Equidistant", CENTER, false, 0),
    method(15, "Polar_Stereographic", ORIGIN, true, 0),
    method(16, "Oblique_Stereographic", ORIGIN, true, 0),
    method(18, "Cassini_Soldner", ORIGIN, false, 0),
    method(21, "Orthographic", ORIGIN, false, 0),
    method(24, "Sinusoidal", ["", "longitude_of_center"], false, 0),
    method(28, "Cylindrical_Equal_Area", ["", "central_meridian"], false, 1),
];

impl GeoTags {
    /// WKT of the projected system that keys define; none where they say too little, or what is not known here.
    pub(super) fn projected_wkt(&self) -> Option<String> {
        if ![None, Some(0), Some(9102)].contains(&self.key(ANGULAR_UNITS)) {
            return None;
        }
        let metres = self.linear_unit().ok()?.unwrap_or(1.0);
        let title = self.text(PROJECTED_CITATION).or(self.text(CITATION)).unwrap_or_default();
        let title = plain(if title.is_empty() { "unnamed" } else { title });
        let globe = self.base_wkt()?;
        let (method, parameters) = self.conversion(metres)?;
        let mut wkt = format!("PROJCS[\"{title}\",{globe},PROJECTION[\"{method}\"]");
        for (name, value) in parameters {
            let _ = write!(wkt, ",PARAMETER[\"{name}\",{value}]");
        }
        let unit = if metres == 1.0 { "metre" } else { "unit" };
        let _ = write!(wkt, ",UNIT[\"{unit}\",{metres}]]");
        Some(wkt)
    }

    /// The method and its parameters; lengths in the units of the system.
    fn conversion(&self, metres: f64) -> Option<(&'static str, Vec<(&'static str, f64)>)> {
        if let Some(code) = self.code(PROJECTION) {
            return utm(code, metres);
        }
        let code = self.key(METHOD)?;
        let method = METHODS.iter().find(|method| method.code == code)?;
        let first = |keys: &[u16]| keys.iter().find_map(|&key| self.number(key));
        let mut parameters = vec![];
        for (name, key) in
            ["standard_parallel_1", "standard_parallel_2"].into_iter().zip(PARALLELS).take(method.parallels)
        {
            parameters.push((name, self.number(key)?));
        }
        if !method.latitude.is_empty() {
            parameters.push((method.latitude, first(LATITUDES)?));
        }
        parameters.push((method.longitude, first(LONGITUDES)?));
        if method.has_scale {
            // Mercator by a parallel, or polar by a latitude, is another method.
            if self.number(PARALLELS[0]).is_some() && first(SCALES).is_none() {
                return None;
            }
            parameters.push(("scale_factor", first(SCALES).unwrap_or(1.0)));
        }
        parameters.push(("false_easting", first(EASTINGS).unwrap_or(0.0)));
        parameters.push(("false_northing", first(NORTHINGS).unwrap_or(0.0)));
        parameters.iter().all(|(_, value)| value.is_finite()).then_some((method.name, parameters))
    }

    /// The geographic system beneath.
    fn base_wkt(&self) -> Option<String> {
        if let Some(code) = self.code(GEODETIC_CRS) {
            return globe_of(text_of(code.into())?);
        }
        let body = self.body().ok()??;
        // `GCS Name = a|Datum = b|Ellipsoid = c|Primem = d`, where there are more names than one.
        let said = self.text(GEODETIC_CITATION).unwrap_or_default();
        let named = |wanted: &str| {
            let found = said.split('|').find_map(|part| part.trim().strip_prefix(wanted)?.trim().strip_prefix('='));
            plain(found.map_or("unknown", str::trim))
        };
        let name = if said.is_empty() || said.contains('=') { named("GCS Name") } else { plain(said) };
        let meridian = self.number(PRIME_MERIDIAN).unwrap_or(0.0);
        let prime = if meridian == 0.0 { "Greenwich".to_owned() } else { named("Primem") };
        Some(globe_wkt([&name, &named("Datum"), &named("Ellipsoid")], body, (&prime, meridian)))
    }
}

/// Zones of UTM are numbered by 16000 and the zone, in the south by 16100.
fn utm(code: u16, metres: f64) -> Option<(&'static str, Vec<(&'static str, f64)>)> {
    let zone @ 1..=60 = code.checked_sub(16000)? % 100 else { return None };
    let northing = match code / 100 {
        160 => 0.0,
        161 => 10_000_000.0 / metres,
        _ => return None,
    };
    let values = [0.0, f64::from(zone) * 6.0 - 183.0, 0.9996, 500_000.0 / metres, northing];
    let names = [ORIGIN[0], ORIGIN[1], "scale_factor", "false_easting", "false_northing"];
    Some((TRANSVERSE_MERCATOR.name, names.into_iter().zip(values).collect()))
}

/// A name that can stand in quotes.
fn plain(name: &str) -> String {
    name.chars().filter(|c| !c.is_control() && !['"', '|'].contains(c)).take(80).collect()
}

#[cfg(test)]
mod tests {
    use super::super::crs::{Crs, CrsKind};
    use super::super::geokeys::{
        GEO_DOUBLES, GEO_TEXTS, INVERSE_FLATTENING, LINEAR_UNITS, PROJECTED_CRS, SEMI_MAJOR_AXIS, USER_DEFINED,
    };
    use super::*;

    /// Tags with short keys, and keys with numbers.
    fn tags(shorts: &[(u16, u16)], numbers: &[(u16, f64)], citation: &str) -> GeoTags {
        let mut keys = vec![1, 1, 0, 0, 1024, 0, 1, 1, PROJECTED_CRS, 0, 1, USER_DEFINED];
        keys.extend(shorts.iter().flat_map(|&(key, value)| [key, 0, 1, value]));
        keys.extend(numbers.iter().enumerate().flat_map(|(at, &(key, _))| [key, GEO_DOUBLES, 1, at as u16]));
        keys.extend([GEODETIC_CITATION, GEO_TEXTS, citation.len() as u16, 0]);
        GeoTags {
            keys,
            doubles: numbers.iter().map(|&(_, value)| value).collect(),
            texts: citation.into(),
            ..GeoTags::default()
        }
    }

    #[test]
    fn systems_of_keys_have_the_wkt_that_gdal_makes_of_them() {
        let path = std::path::Path::new("a.tif");
        let albers = tags(
            &[(GEODETIC_CRS, USER_DEFINED), (METHOD, 11), (LINEAR_UNITS, 9001)],
            &[
                (SEMI_MAJOR_AXIS, 6_378_137.0),
                (INVERSE_FLATTENING, 298.257_222_101),
                (3078, 43.0),
                (3079, 48.0),
                (3080, -120.0),
                (3081, 34.0),
                (3082, 600_000.0),
            ],
            "GCS Name = a \"b\"|Datum = d|Ellipsoid = e|",
        );
        let crs = albers.crs(path).expect("sound");
        assert_eq!((crs.kind, crs.unit, crs.remarks.len()), (CrsKind::Projected, Some(1.0), 0));
        let expected = "PROJCS[\"unnamed\",GEOGCS[\"a b\",DATUM[\"d\",SPHEROID[\"e\",6378137,298.257222101]],\
            PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Albers_Conic_Equal_Area\"],\
            PARAMETER[\"standard_parallel_1\",43],PARAMETER[\"standard_parallel_2\",48],PARAMETER[\"latitude_of_center\",34],\
            PARAMETER[\"longitude_of_center\",-120],PARAMETER[\"false_easting\",600000],PARAMETER[\"false_northing\",0],\
            UNIT[\"metre\",1]]";
        assert_eq!(crs.name, expected);
        // A zone of UTM in feet on a datum with a number.
        let zone = tags(&[(GEODETIC_CRS, 4267), (PROJECTION, 16125), (LINEAR_UNITS, 9002)], &[], "");
        let crs = zone.crs(path).expect("sound");
        assert_eq!(crs.unit, Some(0.3048));
        for part in
            ["DATUM[\"North American Datum 1927\"", "\"central_meridian\",-33]", "\"false_northing\",32808398.95"]
        {
            assert!(crs.name.contains(part), "{}", crs.name);
        }
        assert_eq!(Crs::named(&crs.name).expect("sound").unit, Some(0.3048));
        // What is not known stays unknown, and is remarked.
        for shorts in [
            &[(GEODETIC_CRS, 4326), (METHOD, 27)][..],
            &[(GEODETIC_CRS, 4326), (METHOD, 11)],
            &[(GEODETIC_CRS, 60000), (PROJECTION, 16001)],
            &[(GEODETIC_CRS, 4326), (PROJECTION, 16061)],
            &[(GEODETIC_CRS, 4326), (PROJECTION, 1)],
            &[(GEODETIC_CRS, 4326), (PROJECTION, 16001), (ANGULAR_UNITS, 9105)],
        ] {
            let crs = tags(shorts, &[], "").crs(path).expect("lengths are lengths");
            assert_eq!((crs.name.as_str(), crs.remarks.len()), ("", 1), "{shorts:?}");
        }
    }
}
