//! Coordinate reference systems, as far as a grid needs them: whether they are in degrees, their units, and whose globe
//! they are on.
//!
//! What a code of EPSG means stands in the EPSG dataset, which the crate `epsg-utils` has as WKT 2. Codes of other
//! planets follow a rule of the IAU. Everything else is WKT.

use std::path::Path;

use super::lengths::{self, of_factor};
use super::sidecar::with_extension;
use super::wkt::{self, Node};
use super::{Parsed, grid_error};

/// A coordinate reference system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Crs {
    /// `EPSG:` and a number, or WKT; empty if unknown.
    pub name: String,
    /// The number of EPSG of its part without heights, if it has one.
    pub code: Option<u16>,
    /// What its coordinates are.
    pub kind: CrsKind,
    /// Metres in a unit of projected coordinates, where it is known.
    pub unit: Option<f64>,
    /// What it says about heights.
    pub vertical: Option<Vertical>,
    /// Its ellipsoid, where that is known.
    pub ellipsoid: Option<Body>,
    /// The longitude of its prime meridian, in degrees.
    pub meridian: f64,
    /// What users have to know about it.
    pub remarks: Vec<String>,
}

impl Crs {
    /// The same without remarks.
    pub fn bare(&self) -> Self {
        Self { remarks: vec![], ..self.clone() }
    }

    /// Whether it has nothing but remarks.
    pub fn says_nothing(&self) -> bool {
        self.bare() == Self::default()
    }

    /// This one or, if it says nothing, another one with the remarks about both.
    pub fn or(mut self, mut other: Self) -> Self {
        if !self.says_nothing() {
            return self;
        }
        self.remarks.append(&mut other.remarks);
        Self { remarks: self.remarks, ..other }
    }
}

/// What the coordinates of a system are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CrsKind {
    /// Nobody knows.
    #[default]
    Unknown,
    /// Lengths to the east and to the north.
    Projected,
    /// Longitudes and latitudes in degrees.
    Geographic,
}

/// A system of heights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vertical {
    /// Its name, for messages.
    pub name: String,
    /// Its number among those of EPSG, if it has one.
    pub code: Option<u16>,
    /// Metres in its unit.
    pub metres: Option<f64>,
    /// Whether it counts downwards.
    pub is_depth: bool,
}

/// An ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Half axis at the equator, in metres.
    pub axis: f64,
    /// The inverse of its flattening; 0 for a sphere.
    pub inverse_flattening: f64,
}

/// Half axes of what are taken as ellipsoids of the earth, in metres.
const EARTH: std::ops::Range<f64> = 6.3e6..6.4e6;
/// Half axes of what can be a planet or a moon.
const BODIES: std::ops::Range<f64> = 1.0..1e9;
/// Radians in a degree, and by which share texts round it.
const DEGREE: f64 = std::f64::consts::PI / 180.0;
const SAME_ANGLE: f64 = 1e-6;

/// Bodies with the numbers that NAIF gives them, half axis at the equator, and the inverse flattening of their
/// ellipsoid (IAU, 2015).
const IAU_BODIES: [(u32, &str, f64, f64); 5] = [
    (199, "Mercury", 2_440_530.0, 1_075.123_348_017_621),
    (299, "Venus", 6_051_800.0, 0.0),
    (301, "Moon", 1_737_400.0, 0.0),
    (499, "Mars", 3_396_190.0, 169.894_447_223_611_8),
    (606, "Titan", 2_575_000.0, 0.0),
];

const GEOGRAPHIC: [&str; 9] = [
    "GEOGCS",
    "GEOGCRS",
    "GEOGRAPHICCRS",
    "GEODCRS",
    "GEODETICCRS",
    "BASEGEOGCRS",
    "BASEGEODCRS",
    "BASEGEOGRAPHICCRS",
    "BASEGEODETICCRS",
];
const PROJECTED: [&str; 5] = ["PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS", "BASEPROJCRS"];
const VERTICAL: [&str; 4] = ["VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"];
const DATUMS: [&str; 4] = ["DATUM", "ENSEMBLE", "GEODETICDATUM", "TRF"];
const LENGTH_UNITS: [&str; 2] = ["LENGTHUNIT", "UNIT"];
const ANGLE_UNITS: [&str; 2] = ["ANGLEUNIT", "UNIT"];

impl Body {
    /// The square of its eccentricity.
    pub fn eccentricity(&self) -> f64 {
        if self.inverse_flattening == 0.0 {
            return 0.0;
        }
        let flattening = 1.0 / self.inverse_flattening;
        flattening * (2.0 - flattening)
    }

    /// The mean radius, (2 a + b) / 3.
    pub fn mean_radius(&self) -> f64 {
        match self.inverse_flattening {
            0.0 => self.axis,
            inverse => self.axis * (1.0 - 1.0 / (3.0 * inverse)),
        }
    }

    /// Refuses what no planet has.
    pub fn checked(self) -> Result<Self, String> {
        let Self { axis, inverse_flattening } = self;
        let is_possible = BODIES.contains(&axis) && (inverse_flattening == 0.0 || inverse_flattening > 1.0);
        is_possible.then_some(self).ok_or_else(|| {
            format!("its ellipsoid has a half axis of {axis} m and an inverse flattening of {inverse_flattening}")
        })
    }
}

impl Crs {
    /// The system of longitudes and latitudes on WGS 84.
    pub fn wgs84() -> Self {
        Self { name: "EPSG:4326".into(), code: Some(4326), kind: CrsKind::Geographic, ..Self::default() }
    }

    /// The system that somebody has typed, or that a file has kept: `EPSG:` and a number, two of them joined by `+`
    /// (the second one is that of heights), the number of a body by the IAU, or WKT.
    ///
    /// # Errors
    /// What is wrong with it, and what to do.
    pub fn named(name: &str) -> Result<Self, String> {
        let name = name.trim();
        if let Some(codes) = strip_word(name, "EPSG:") {
            let (place, heights) = codes.split_once('+').map_or((codes, None), |(place, own)| (place, Some(own)));
            let number = |digits: &str| {
                let digits = strip_word(digits, "EPSG:").unwrap_or(digits);
                let unknown = || format!("'{name}' is no CRS; write EPSG: and a number, or WKT");
                digits.trim_start_matches(':').parse::<u32>().map_err(|_| unknown())
            };
            let code = number(place)?;
            let mut crs = Self::of_code(code)?.ok_or_else(|| unknown(code))?;
            if let Some(heights) = heights {
                let code = number(heights)?;
                crs.vertical = Some(Vertical::of_code(code).ok_or_else(|| {
                    format!("EPSG:{code} is no system of heights that is known; omit it, and pass --vertical-unit")
                })?);
            }
            return crs.placed();
        }
        if let Some((authority, code)) = name.split_once(':')
            && authority.to_ascii_uppercase().starts_with("IAU")
        {
            return Self::of_iau(name, code);
        }
        match name.contains(['[', '(']) {
            true => Self::of_wkt(name).map_err(|error| format!("its WKT cannot be read: {error}"))?.placed(),
            false => Err(format!("'{name}' is no CRS that is known; write EPSG: and a number, or WKT")),
        }
    }

    /// Refuses systems without a place.
    fn placed(self) -> Result<Self, String> {
        match &self.vertical {
            Some(Vertical { name, .. }) if self.kind == CrsKind::Unknown && self.unit.is_none() => Err(format!(
                "{name} is a system of heights alone; write it behind that of the place, as EPSG:32632+5773"
            )),
            _ => Ok(self),
        }
    }

    /// The system with a number of EPSG; none where the dataset lacks it.
    ///
    /// # Errors
    /// If it is no system for grids.
    pub fn of_code(code: u32) -> Result<Option<Self>, String> {
        let Some(text) = text_of(code) else { return Ok(None) };
        let crs = Self::of_tree(&wkt::parse(text)?).map_err(|error| format!("EPSG:{code}: {error}"))?;
        Ok(Some(Self { name: format!("EPSG:{code}"), ..crs }))
    }

    /// A system of the IAU, which numbers bodies by hundreds: the first three of each are in degrees.
    fn of_iau(name: &str, code: &str) -> Result<Self, String> {
        let wkt = "pass its WKT, as `projinfo -o WKT2:2019` or spatialreference.org writes it";
        let code: u32 = code.rsplit(':').next().and_then(|code| code.parse().ok()).unwrap_or(0);
        let found = IAU_BODIES.iter().find(|(body, ..)| *body == code / 100);
        let (Some(&(_, body, axis, inverse)), 0..=2) = (found, code % 100) else {
            return Err(format!("what {name} means is not known here; {wkt}"));
        };
        let inverse_flattening = if code.is_multiple_of(100) { 0.0 } else { inverse };
        Ok(Self::of_degrees(&format!("{body} (2015)"), Body { axis, inverse_flattening }))
    }

    /// The system of degrees on an ellipsoid, which then has WKT for a name.
    pub fn of_degrees(name: &str, body: Body) -> Self {
        let name: String = name.chars().filter(|c| !c.is_control() && *c != '"').take(80).collect();
        let wkt = globe_wkt([&name; 3], body, ("Reference meridian", 0.0));
        Self { name: wkt, kind: CrsKind::Geographic, ellipsoid: Some(body), ..Self::default() }
    }

    /// The name in its text.
    pub fn title(&self) -> &str {
        self.name.split('"').nth(1).unwrap_or("Unnamed")
    }

    /// Its ellipsoid, if that is not the earth's: those of the earth count as that of WGS 84.
    pub fn body(&self) -> Option<Body> {
        self.ellipsoid.filter(|body| !EARTH.contains(&body.axis))
    }

    /// The system of a text.
    ///
    /// # Errors
    /// What is wrong with the text, or why the system is none for grids.
    pub fn of_wkt(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let tree = wkt::parse(text)?;
        let crs = Self::of_tree(&tree)?;
        // The number is shorter. It has to mean the same.
        let metres = |crs: &Self| crs.vertical.as_ref().map(|vertical| vertical.metres);
        let same = |known: &Self| known.kind == crs.kind && known.unit == crs.unit && metres(known) == metres(&crs);
        let code = if let [root] = &tree[..] { code_of(root) } else { None };
        let known = code.and_then(|code| Self::of_code(code).ok().flatten()).filter(same);
        Ok(Self { name: known.map_or_else(|| text.to_owned(), |known| known.name), ..crs })
    }

    fn of_tree(roots: &[Node<'_>]) -> Result<Self, String> {
        let mut crs = Self::default();
        roots.iter().try_for_each(|root| crs.take(root))?;
        Ok(crs)
    }

    /// Takes over what a word says. The tree is not deep.
    fn take(&mut self, node: &Node<'_>) -> Result<(), String> {
        match node.word.as_str() {
            word if VERTICAL.contains(&word) => {
                let is_down =
                    |axis: &Node<'_>| axis.word == "AXIS" && axis.values.iter().any(|value| is_word(value, "down"));
                let is_negative = |part: &Node<'_>| is_word(part.name(), "Direction") && part.number(1) == Some(-1.0);
                self.vertical = Some(Vertical {
                    name: node.name().to_owned(),
                    code: short_code_of(node),
                    metres: factor(node, &LENGTH_UNITS)?.map(length).transpose()?,
                    is_depth: node.nodes.iter().any(|part| is_down(part) || is_negative(part)),
                });
            }
            word if GEOGRAPHIC.contains(&word) => {
                let system = node.part(&["CS"]).map_or("", |part| part.name());
                if is_word(system, "Cartesian") {
                    return Err(GEOCENTRIC.into());
                }
                (self.kind, self.code) = (CrsKind::Geographic, short_code_of(node));
                self.take_globe(node, true)?;
                // Heights of a system of three dimensions.
                let up =
                    node.nodes.iter().filter(|part| part.word == "AXIS").find_map(|axis| axis.part(&["LENGTHUNIT"]));
                if let Some(unit) = up {
                    let metres = Some(length(unit.number(1).unwrap_or(f64::NAN))?);
                    self.vertical = Some(Vertical { name: node.name().to_owned(), metres, ..Vertical::default() });
                }
            }
            word if PROJECTED.contains(&word) => {
                (self.kind, self.code) = (CrsKind::Projected, short_code_of(node));
                self.unit = factor(node, &LENGTH_UNITS)?.map(length).transpose()?;
                let base = node.nodes.iter().find(|part| GEOGRAPHIC.contains(&part.word.as_str()));
                if let Some(base) = base {
                    self.take_globe(base, false)?;
                }
            }
            "COMPD_CS" | "COMPOUNDCRS" | "BOUNDCRS" | "SOURCECRS" => {
                node.nodes.iter().filter(|part| part.word != "TARGETCRS").try_for_each(|part| self.take(part))?;
            }
            "GEOCCS" => return Err(GEOCENTRIC.into()),
            "LOCAL_CS" | "ENGCRS" | "ENGINEERINGCRS" => {
                self.unit = factor(node, &LENGTH_UNITS)?.map(length).transpose()?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes over ellipsoid and meridian, and refuses coordinates in other angles than degrees.
    fn take_globe(&mut self, node: &Node<'_>, is_in_degrees: bool) -> Result<(), String> {
        let angle = factor(node, &ANGLE_UNITS)?.unwrap_or(DEGREE);
        let is_degree = (angle / DEGREE - 1.0).abs() < SAME_ANGLE;
        if is_in_degrees && !is_degree {
            return Err(format!(
                "{} counts angles in units of {angle} radians; only degrees can be read: warp it first, with `gdalwarp`",
                node.name()
            ));
        }
        if let Some(meridian) = node.part(&["PRIMEM", "PRIMEMERIDIAN"]) {
            let own = factor(meridian, &ANGLE_UNITS)?;
            self.meridian = meridian.number(1).unwrap_or(0.0) * own.unwrap_or(angle) / DEGREE;
        }
        let datum = node.part(&DATUMS);
        if let Some(ellipsoid) = datum.and_then(|datum| datum.part(&["SPHEROID", "ELLIPSOID"])) {
            let metres = factor(ellipsoid, &LENGTH_UNITS)?.unwrap_or(1.0);
            let axis = ellipsoid.number(1).unwrap_or(f64::NAN) * metres;
            let inverse_flattening = ellipsoid.number(2).unwrap_or(f64::NAN);
            self.ellipsoid = Some(Body { axis, inverse_flattening }.checked()?);
        }
        Ok(())
    }

    /// The system in the `.prj` beside a file. What is not there says nothing.
    pub fn beside(path: &Path) -> Parsed<Self> {
        with_extension(path, "prj").map_or_else(|| Ok(Self::default()), |prj| Self::in_prj(&prj))
    }

    /// The system in a `.prj`. What is not there says nothing; what is no WKT is remarked.
    pub fn in_prj(prj: &Path) -> Parsed<Self> {
        let Ok(file) = std::fs::metadata(prj) else { return Ok(Self::default()) };
        if !file.is_file() {
            return Ok(Self::default());
        }
        if file.len() > wkt::MAX_BYTES as u64 {
            let problem =
                format!("has {} bytes, and at most {} can be read; no CRS takes more", file.len(), wkt::MAX_BYTES);
            return Err(grid_error(prj, &problem));
        }
        let text = std::fs::read(prj).unwrap_or_default();
        let text = String::from_utf8_lossy(&text);
        let text = text.trim_start_matches('\u{feff}').trim_end_matches('\0').trim();
        if !text.contains(['[', '(']) {
            let remark = "the .prj beside it is no WKT, so its CRS is not known; --crs and --vertical-unit say it";
            return Ok(Self { remarks: vec![remark.into()], ..Self::default() });
        }
        let broken = |error| {
            grid_error(prj, &format!("is no CRS for a grid: {error}; correct it, or move it away and pass --crs"))
        };
        Self::of_wkt(text).map_err(broken)
    }
}

const GEOCENTRIC: &str = "it has geocentric coordinates, which are no grid; warp it first, with `gdalwarp`";

impl Vertical {
    /// The system of heights with a number of EPSG, if the dataset has it.
    pub fn of_code(code: u32) -> Option<Self> {
        let crs = Crs::of_tree(&wkt::parse(text_of(code)?).ok()?).ok()?;
        crs.vertical.filter(|_| crs.kind == CrsKind::Unknown)
    }
}

/// The geographic system of a text in WKT 1; none if it is another one, or in other angles than degrees.
pub(super) fn globe_of(text: &str) -> Option<String> {
    let tree = wkt::parse(text).ok()?;
    let node = tree.first().filter(|node| GEOGRAPHIC.contains(&node.word.as_str()))?;
    let crs = Crs::of_tree(&tree).ok()?;
    let datum = node.part(&DATUMS)?;
    let ellipsoid = datum.part(&["SPHEROID", "ELLIPSOID"])?;
    let meridian = node.part(&["PRIMEM", "PRIMEMERIDIAN"]).map_or("Greenwich", |part| part.name());
    Some(globe_wkt([node.name(), datum.name(), ellipsoid.name()], crs.ellipsoid?, (meridian, crs.meridian)))
}

/// WKT 1 of a system of degrees: names of the system, its datum and its ellipsoid, and the prime meridian.
pub(super) fn globe_wkt([name, datum, ellipsoid]: [&str; 3], body: Body, meridian: (&str, f64)) -> String {
    let Body { axis, inverse_flattening } = body;
    format!(
        "GEOGCS[\"{name}\",DATUM[\"{datum}\",SPHEROID[\"{ellipsoid}\",{axis},{inverse_flattening}]],\
         PRIMEM[\"{}\",{}],UNIT[\"degree\",0.0174532925199433]]",
        meridian.0, meridian.1
    )
}

/// What the EPSG dataset says about a code.
pub(super) fn text_of(code: u32) -> Option<&'static str> {
    epsg_utils::epsg_to_wkt2(i32::try_from(code).ok()?).ok()
}

/// Whether the EPSG dataset has a system of this number.
pub fn is_known_epsg(code: u32) -> bool {
    text_of(code).is_some()
}

/// What to say about a code that the dataset lacks.
pub(super) fn unknown(code: u32) -> String {
    format!("EPSG:{code} is not among the systems that are known here; check the number, or pass its WKT with --crs")
}

/// A unit of length, or why it is none.
pub(super) fn length(metres: f64) -> Result<f64, String> {
    of_factor(metres).ok_or_else(|| format!("its unit of length has {metres} metres"))
}

/// The factor of the unit of a word, or of one of its axes, but for that of heights in degrees.
fn factor(node: &Node<'_>, words: &[&str]) -> Result<Option<f64>, String> {
    let axes = || node.nodes.iter().filter(|part| part.word == "AXIS").find_map(|axis| axis.part(words));
    let Some(unit) = node.part(words).or_else(axes) else { return Ok(None) };
    let number = unit.number(1).filter(|factor| *factor > 0.0 && factor.is_finite());
    let absurd = || format!("its unit {} has the factor {:?}", unit.name(), unit.values.get(1).unwrap_or(&""));
    number.map(Some).ok_or_else(absurd)
}

/// The number of EPSG of a word.
fn code_of(node: &Node<'_>) -> Option<u32> {
    let id = node.part(&["ID", "AUTHORITY"]).filter(|id| is_word(id.name(), "EPSG"))?;
    id.values.get(1)?.parse().ok()
}

/// The same, if GeoTIFF has room for it.
fn short_code_of(node: &Node<'_>) -> Option<u16> {
    code_of(node).and_then(|code| u16::try_from(code).ok())
}

fn is_word(text: &str, word: &str) -> bool {
    text.eq_ignore_ascii_case(word)
}

fn strip_word<'a>(text: &'a str, word: &str) -> Option<&'a str> {
    let (start, rest) = text.split_at_checked(word.len())?;
    is_word(start, word).then_some(rest)
}

/// Metres in a unit of heights that a file names, and otherwise what to say.
pub(super) fn unit_named(name: &str) -> Result<Option<f64>, String> {
    match lengths::of_name(name) {
        Some(metres) => Ok(Some(metres)),
        None if name.trim().is_empty() => Ok(None),
        None => {
            let name: String = name.chars().take(40).collect();
            Err(format!("its heights are in '{name}', which is no unit that is known; --vertical-unit says it"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::lengths::US_FOOT;
    use super::*;

    /// Made with pyproj 3.7.2 (EPSG 11.022): kind, metres in a unit of coordinates, and of heights.
    #[test]
    fn systems_mean_what_pyproj_says_that_they_mean() {
        const DEGREES: CrsKind = CrsKind::Geographic;
        const LENGTHS: CrsKind = CrsKind::Projected;
        for code in [4326, 4269, 6318, 4171, 4230, 4314, 4258, 7844, 4674] {
            let crs = Crs::of_code(code).expect("for grids").expect("known");
            assert_eq!((crs.kind, crs.unit, &crs.vertical, crs.body()), (DEGREES, None, &None, None), "{code}");
        }
        for code in [32632, 32733, 25832, 3857, 27700, 28992, 2056, 2193, 6423, 3031, 5070, 4839, 26910, 2949, 3395] {
            let crs = Crs::of_code(code).expect("for grids").expect("known");
            assert_eq!((crs.kind, crs.unit, &crs.vertical), (LENGTHS, Some(1.0), &None), "{code}");
        }
        for (code, unit) in [(2230, US_FOOT), (2263, US_FOOT), (2222, 0.3048)] {
            let crs = Crs::of_code(code).expect("for grids").expect("known");
            assert_eq!((crs.kind, crs.unit), (LENGTHS, Some(unit)), "{code}");
        }
        for code in [4979, 9989, 6349, 5498, 9518, 8360, 6697, 7415] {
            let crs = Crs::of_code(code).expect("for grids").expect("known");
            let kind = if code == 7415 { LENGTHS } else { DEGREES };
            assert_eq!((crs.kind, crs.vertical.and_then(|own| own.metres)), (kind, Some(1.0)), "{code}");
        }
        for (code, metres, is_depth) in
            [(5703, 1.0, false), (6360, US_FOOT, false), (8228, 0.3048, false), (5715, 1.0, true)]
        {
            let own = Vertical::of_code(code).expect("known");
            assert_eq!((own.metres, own.is_depth, own.code), (Some(metres), is_depth, Some(code as u16)));
        }
        for code in [7789, 4978, 4807] {
            assert!(Crs::of_code(code).is_err(), "{code} is geocentric, or in grads");
        }
        assert_eq!((Crs::of_code(32767), Crs::of_code(u32::MAX)), (Ok(None), Ok(None)));
    }

    #[test]
    fn texts_of_all_dialects_say_unit_and_kind() {
        let gdal = "PROJCS[\"a\",GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"s\",6378137,298.25]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],\
            PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"false_easting\",5],UNIT[\"US survey foot\",0.304800609601219]]";
        let vertical =
            "VERT_CS[\"h\",VERT_DATUM[\"d\",2005],UNIT[\"foot\",0.3048,AUTHORITY[\"EPSG\",\"9002\"]],AXIS[\"Up\",UP]]";
        let crs = Crs::named(&format!("COMPD_CS[\"c\",{gdal},{vertical}]")).expect("sound");
        let heights = |crs: &Crs| crs.vertical.as_ref().and_then(|own| own.metres);
        assert_eq!((crs.kind, crs.unit, heights(&crs)), (CrsKind::Projected, Some(US_FOOT), Some(0.3048)));
        let esri = format!(
            "{gdal},VERTCS[\"v\",VDATUM[\"d\"],PARAMETER[\"Vertical_Shift\",0.0],PARAMETER[\"Direction\",-1.0],UNIT[\"Foot\",0.3048]]"
        );
        let crs = Crs::named(&esri).expect("sound");
        assert_eq!(
            (crs.unit, heights(&crs), crs.vertical.is_some_and(|own| own.is_depth)),
            (Some(US_FOOT), Some(0.3048), true)
        );
        assert_eq!(crs.name, esri);
        // Units of axes, a system within bounds, and another planet.
        let moon = "GEOGCRS[\"Moon\",DATUM[\"Moon\",ELLIPSOID[\"Moon\",1737.4,0,LENGTHUNIT[\"km\",1000]]],CS[ellipsoidal,3],\
            AXIS[\"lat\",north,ANGLEUNIT[\"degree\",0.0174532925199433]],AXIS[\"lon\",east,ANGLEUNIT[\"degree\",0.0174532925199433]],\
            AXIS[\"h\",up,LENGTHUNIT[\"km\",1000]]]";
        let crs = Crs::named(&format!(
            "BOUNDCRS[SOURCECRS[{moon}],TARGETCRS[GEOGCRS[\"x\",DATUM[\"d\",ELLIPSOID[\"e\",1e300,0]]]]]"
        ))
        .expect("sound");
        let body = crs.body().expect("not the earth");
        assert_eq!(
            (crs.kind, heights(&crs), body.axis, body.mean_radius()),
            (CrsKind::Geographic, Some(1000.0), 1_737_400.0, 1_737_400.0)
        );
        let mars = Crs::named("IAU_2015:49901").expect("known").body().expect("not the earth");
        assert!((mars.mean_radius() - 3_389_526.7).abs() < 1.0 && mars.eccentricity() > 0.01, "{mars:?}");
        assert_eq!(Crs::named("IAU:30100").map(|crs| crs.body().map(|body| body.axis)), Ok(Some(1_737_400.0)));
        // A number at the end is that of the whole, and what it is not counts as text.
        let named = |code: u32| {
            Crs::named(&format!("{},AUTHORITY[\"EPSG\",\"{code}\"]]", &gdal[..gdal.len() - 1])).expect("sound").name
        };
        assert_eq!((named(2230).as_str(), named(32632).starts_with("PROJCS")), ("EPSG:2230", true));
        let joined = Crs::named("epsg:28992+5709").expect("known");
        assert_eq!(
            (joined.name.as_str(), heights(&joined), joined.vertical.and_then(|own| own.code)),
            ("EPSG:28992", Some(1.0), Some(5709))
        );
    }

    #[test]
    fn what_is_no_system_for_a_grid_says_what_to_do() {
        for (name, says) in [
            ("EPSG:99999", "not among"),
            ("EPSG:", "write EPSG"),
            ("EPSG:-1", "write EPSG"),
            ("EPSG:99999999999999999999", "write EPSG"),
            ("EPSG:5703", "heights alone"),
            ("EPSG:4978", "geocentric"),
            ("EPSG:4807", "only degrees"),
            ("EPSG:32632+4326", "no system of heights"),
            ("IAU_2015:30110", "pass its WKT"),
            ("IAU_2015:99900", "pass its WKT"),
            ("WGS 84", "write EPSG"),
            ("GEOGCS[\"g\",UNIT[\"degree\",0]]", "factor"),
            ("GEOGCS[\"g\",UNIT[\"degree\",NaN]]", "factor"),
            ("PROJCS[\"g\",UNIT[\"m\"]]", "factor"),
            ("PROJCS[\"g\",UNIT[\"m\",-1]]", "factor"),
            ("PROJCS[\"g\",UNIT[\"m\",1e300]]", "metres"),
            ("PROJCS[\"g\",UNIT[\"m\",1e-300]]", "metres"),
            ("GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"s\",0,0]]]", "half axis"),
            ("GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"s\",6378137,-1]]]", "half axis"),
            ("GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"s\"]]]", "half axis"),
            ("GEOGCS[\"g\",UNIT[\"degree\",0.0174532925199433]", "open"),
        ] {
            let problem = Crs::named(name).expect_err(name);
            assert!(problem.contains(says), "{name}: {problem}");
        }
    }

    #[test]
    fn a_broken_prj_is_refused_by_name_and_one_in_other_words_is_remarked() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let prj = dir.path().join("a.prj");
        let read = |bytes: &[u8]| {
            std::fs::write(&prj, bytes).expect("writable");
            Crs::in_prj(&prj)
        };
        assert_eq!(Crs::in_prj(&dir.path().join("none.prj")).expect("says nothing"), Crs::default());
        assert!(!read(b"Projection UTM\nZone 10\nUnits METERS\n").expect("says nothing").remarks.is_empty());
        let texts = ["A[".repeat(100_000), "PROJCS[\"x\"]]".into(), format!("GEOGCS[\"{}\"]", "x".repeat(1 << 20))];
        for text in texts {
            let error = read(text.as_bytes()).expect_err("broken").to_string();
            assert!(error.contains("a.prj"), "{error}");
        }
        assert_eq!(
            read(b"\xef\xbb\xbfGEOGCS[\"\xff\",UNIT[\"Degree\",0.0174532925199433]]\0").expect("sound").kind,
            CrsKind::Geographic
        );
    }
}
