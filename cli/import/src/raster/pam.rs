//! The file of metadata that GDAL puts beside a raster (`a.png.aux.xml`): what the raster's own format has no room for.
//!
//! It says where the raster is, in which system, which number stands for no data, how numbers become heights, and in
//! which unit. Statistics, histograms and tables, which most of these files have and nothing else, say nothing here.

use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};

use super::affine::Affine;
use super::crs::{Crs, unit_named};
use super::header::Header;
use super::sidecar::with_suffix;
use super::{ImportError, Parsed, grid_error, wkt};
use crate::error::Location;

/// Its extension, behind that of the raster.
pub(super) const EXTENSION: &str = "aux.xml";
/// The largest file that is read. Tables of classes and histograms can be long.
const MAX_BYTES: u64 = 1 << 22;
/// The longest tag with the text behind it, which has room for any WKT. Reading a tag takes time with the square of its
/// attributes.
const MAX_TAG_BYTES: usize = wkt::MAX_BYTES + (1 << 12);

/// What such a file says.
#[derive(Default)]
pub(super) struct Pam {
    pub place: Option<Affine>,
    pub crs: Crs,
    pub nodata: Option<f64>,
    /// Metres in a unit of the heights.
    vertical: Option<f64>,
    scale: Option<f64>,
    offset: Option<f64>,
    /// What users have to know about it.
    remarks: Vec<String>,
}

impl Pam {
    /// Reads the file beside a raster or an image; where there is none, it says nothing.
    pub fn beside(path: &Path) -> Parsed<Self> {
        let Some(sidecar) = with_suffix(path, EXTENSION) else { return Ok(Self::default()) };
        let io = |source| ImportError::Io { path: sidecar.clone(), source };
        let length = std::fs::metadata(&sidecar).map_err(io)?.len();
        if length > MAX_BYTES {
            let problem = format!(
                "has {length} bytes, and at most {MAX_BYTES} can be read; move it away, and pass --nodata and --crs if the raster lacks them"
            );
            return Err(grid_error(&sidecar, &problem));
        }
        let bytes = std::fs::read(&sidecar).map_err(io)?;
        Self::of_text(&String::from_utf8_lossy(&bytes), &sidecar)
    }

    fn of_text(text: &str, sidecar: &Path) -> Parsed<Self> {
        let text = text.trim_start_matches('\u{feff}').trim_end_matches('\0');
        if let Some(long) = text.split('<').map(str::len).find(|length| *length > MAX_TAG_BYTES) {
            let problem = format!("has a tag of {long} bytes, and at most {MAX_TAG_BYTES} can be read; move it away");
            return Err(grid_error(sidecar, &problem));
        }
        // One element needs four bytes.
        let options = ParsingOptions { nodes_limit: MAX_BYTES as u32, ..ParsingOptions::default() };
        let document = Document::parse_with_options(text, options).map_err(|error| {
            let location = Location::Line(error.pos().row.into());
            let problem = format!("is no XML: {error}; correct it, or move it away");
            ImportError::Syntax { path: sidecar.to_owned(), location, problem }
        })?;
        let root = document.root_element();
        let mut pam = Self::default();
        if let Some(text) = text_of(root, "GeoTransform") {
            pam.place = Some(place_of(text).ok_or_else(|| {
                let problem = "has a GeoTransform that is not six numbers with commas between them; correct it, or move the file away";
                grid_error(sidecar, problem)
            })?);
        }
        // What ArcGIS writes.
        let of_esri = || text_of(child(child(root, "GeodataXform")?, "SpatialReference")?, "WKT");
        if let Some(text) = text_of(root, "SRS").or_else(of_esri) {
            pam.crs = Crs::named(text).map_err(|error| {
                let problem = format!("has no CRS for a grid: {error}; correct it, or move it away and pass --crs");
                grid_error(sidecar, &problem)
            })?;
        }
        let is_first =
            |node: &Node| node.has_tag_name("PAMRasterBand") && matches!(node.attribute("band"), None | Some("1"));
        let Some(band) = root.children().find(is_first) else { return Ok(pam) };
        if let Some(node) = child(band, "NoDataValue") {
            let exact = node.attribute("le_hex_equiv").and_then(number_of_hex);
            let text = node.text().unwrap_or_default().trim();
            pam.nodata = exact.or_else(|| text.parse().ok());
            if pam.nodata.is_none() {
                let text: String = text.chars().take(40).collect();
                let remark = format!(
                    "the .{EXTENSION} beside it has '{text}' for no data, which is no number; --nodata says it"
                );
                pam.remarks.push(remark);
            }
        }
        match unit_named(text_of(band, "UnitType").unwrap_or_default()) {
            Ok(metres) => pam.vertical = metres,
            Err(remark) => pam.remarks.push(remark),
        }
        let number = |name: &str| text_of(band, name)?.parse::<f64>().ok().filter(|value| value.is_finite());
        (pam.scale, pam.offset) = (number("Scale").filter(|scale| *scale != 0.0), number("Offset"));
        Ok(pam)
    }

    /// Adds what it says about samples and heights to what a raster says itself. `wins` says which of both counts.
    pub fn add_to(&self, header: &mut Header, wins: bool) {
        let of = |own: Option<f64>, said: Option<f64>| if wins { said.or(own) } else { own.or(said) };
        header.nodata = of(header.nodata, self.nodata);
        header.vertical = of(header.vertical, self.vertical);
        let [scale, offset] = header.scale;
        header.scale = [self.scale.unwrap_or(scale), self.offset.unwrap_or(offset)];
        header.crs.remarks.extend(self.remarks.iter().cloned());
    }
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// The text of a part, if there is any.
fn text_of<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    child(node, name)?.text().map(str::trim).filter(|text| !text.is_empty())
}

/// Where samples are. The six numbers count from the corner of the first pixel.
fn place_of(text: &str) -> Option<Affine> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let [x, across, down, y, along, below] = numbers?[..] else { return None };
    let first = [x + 0.5 * (across + down), y + 0.5 * (along + below)];
    Some(Affine { first, column: [across, along], row: [down, below] })
}

/// A number as the digits of its eight bytes, the lowest first.
fn number_of_hex(digits: &str) -> Option<f64> {
    let bits = u64::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 16)?;
    Some(f64::from_bits(bits.swap_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = "<PAMDataset>\n  <SRS dataAxisToSRSAxisMapping=\"1,2\">EPSG:32632</SRS>\n  <GeoTransform> 5e5, 10, 0, 5.2e6, 0, -20</GeoTransform>\n  \
        <PAMRasterBand band=\"2\"><NoDataValue>1</NoDataValue></PAMRasterBand>\n  <PAMRasterBand band=\"1\">\n    \
        <NoDataValue le_hex_equiv=\"000000007E5AEFC7\">-3.4e+38</NoDataValue>\n    <UnitType>ft</UnitType>\n    <Offset>7</Offset>\n    \
        <Scale>0.5</Scale>\n    <Metadata><MDI key=\"STATISTICS_MEAN\">3</MDI></Metadata>\n  </PAMRasterBand>\n</PAMDataset>\n";

    fn read(text: &str) -> Result<Pam, String> {
        Pam::of_text(text, Path::new("a.png.aux.xml")).map_err(|error| error.to_string())
    }

    #[test]
    fn place_system_no_data_unit_and_scale_of_the_first_band_are_read() {
        let pam = read(WHOLE).expect("sound");
        let place = pam.place.expect("said");
        assert_eq!((place.first, place.column, place.row), ([500_005.0, 5_199_990.0], [10.0, 0.0], [0.0, -20.0]));
        assert_eq!((pam.crs.name.as_str(), pam.vertical), ("EPSG:32632", Some(0.3048)));
        assert_eq!((pam.scale, pam.offset), (Some(0.5), Some(7.0)));
        // Its bytes have all digits.
        let nodata = pam.nodata.expect("said");
        assert!(nodata != -3.4e38 && (nodata / -3.4e38 - 1.0).abs() < 0.1, "{nodata}");
        let texts = [("-9999", -9999.0), ("0", 0.0), (" 1.5e3 ", 1500.0)];
        for (text, value) in texts {
            let band =
                format!("<a><PAMRasterBand><NoDataValue le_hex_equiv=\"zz\">{text}</NoDataValue></PAMRasterBand></a>");
            assert_eq!(read(&band).expect("sound").nodata, Some(value), "{text}");
        }
    }

    #[test]
    fn statistics_and_other_words_say_nothing() {
        for text in [
            "<PAMDataset><PAMRasterBand band=\"1\"><Histograms><HistItem><HistMin>1</HistMin></HistItem></Histograms></PAMRasterBand></PAMDataset>",
            "<?xml version=\"1.0\"?><other/>",
            "<PAMDataset><SRS/><PAMRasterBand band=\"1\"><UnitType></UnitType></PAMRasterBand></PAMDataset>",
            "\u{feff}<PAMDataset/>\0",
        ] {
            let pam = read(text).expect("sound");
            assert!(pam.crs.says_nothing() && pam.place.is_none() && pam.remarks.is_empty(), "{text}");
            let mut header = Header::new([2, 2]);
            pam.add_to(&mut header, true);
            assert_eq!(header, Header::new([2, 2]), "{text}");
        }
        // A namespace of ESRI's.
        let esri = "<PAMDataset><GeodataXform xmlns:t=\"u\" t:type=\"t:IdentityXform\"><SpatialReference t:type=\"t:P\"><WKT>GEOGCS[\"g\",\
            UNIT[\"Degree\",0.0174532925199433]]</WKT></SpatialReference></GeodataXform></PAMDataset>";
        assert_eq!(read(esri).expect("sound").crs.kind, super::super::CrsKind::Geographic);
    }

    #[test]
    fn what_cannot_be_read_is_one_error_that_names_it_or_a_remark() {
        let band = |inner: &str| format!("<a><PAMRasterBand>{inner}</PAMRasterBand></a>");
        for (text, says) in [
            ("no words".to_owned(), "is no XML"),
            (String::new(), "is no XML"),
            ("<a><b></a>".into(), "is no XML"),
            ("<!DOCTYPE a [<!ENTITY b \"bb\"><!ENTITY c \"&b;&b;\">]><a>&c;</a>".into(), "is no XML"),
            ("<a>".repeat(300_000), "is no XML"),
            ("<a><GeoTransform>1,2,3</GeoTransform></a>".into(), "six numbers"),
            ("<a><GeoTransform>1,2,3,4,5,six</GeoTransform></a>".into(), "six numbers"),
            ("<a><SRS>EPSG:99999</SRS></a>".into(), "pass --crs"),
            ("<a><SRS>GEOGCS[\"g\"</SRS></a>".into(), "pass --crs"),
        ] {
            let error = read(&text).err().unwrap_or_default();
            assert!(error.contains("a.png.aux.xml") && error.contains(says) && !error.contains('\n'), "{error}");
        }
        for (text, says) in
            [("<NoDataValue>none</NoDataValue>", "--nodata"), ("<UnitType>cubits</UnitType>", "--vertical-unit")]
        {
            let remarks = read(&band(text)).expect("sound").remarks;
            assert!(remarks.iter().any(|remark| remark.contains(says)), "{remarks:?}");
        }
        for number in ["0", "nan", "inf", "x", ""] {
            let pam = read(&band(&format!("<Scale>{number}</Scale>"))).expect("sound");
            assert_eq!(pam.scale, None, "{number}");
        }
    }

    #[test]
    fn a_file_that_is_damaged_anywhere_never_panics() {
        for at in 0..WHOLE.len() {
            let _ = read(&WHOLE[..at]);
            for byte in [0, b'<', b'>', b'&', b'"', b'9', 0xFF] {
                let mut bytes = WHOLE.as_bytes().to_vec();
                bytes[at] = byte;
                let _ = read(&String::from_utf8_lossy(&bytes));
            }
        }
        // A tag of very many attributes, also with a sign in the first one that could be its end.
        let tag = |count: u32| format!("<a x=\">\"{}/>", (0..count).map(|k| format!(" a{k}=\"\"")).collect::<String>());
        assert!(read(&tag(1000)).is_ok());
        assert!(read(&tag(70_000)).is_err_and(|error| error.contains("has a tag of")));
    }
}
