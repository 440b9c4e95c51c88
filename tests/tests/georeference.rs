//! Rasters say where they are and in which units, in many ways; what is built from them, and a window taken out again,
//! says the same.

use crate::heights::built;
use crate::terrain::read;
use lodpack::Limits;
use lodpack::heights::Heights;
use lodpack_cli::heights::{raster_window_of, write_geotiff};
use lodpack_cli::import::raster::{HeightSource, RasterOptions, SurfaceKind};
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::progress::Silent;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use tiff::decoder::Decoder;
use tiff::encoder::TiffEncoder;
use tiff::tags::Tag;

const US_FOOT: f64 = 1200.0 / 3937.0;
const SIZE: [u32; 2] = [36, 18];
/// Grids of heights from 100 to 645.
const HEIGHTS: std::ops::RangeInclusive<f64> = 100.0..=645.0;

/// A GeoTIFF of whole numbers, as far as it says something.
#[derive(Clone, Debug, Default)]
struct Tiff {
    /// The first sample, and the distances of columns and rows.
    place: [f64; 4],
    /// Keys with short values, or with places of numbers (34736) and texts (34737).
    keys: Vec<[u16; 4]>,
    doubles: Vec<f64>,
    texts: String,
    metadata: String,
}

fn height(sample: u32) -> i16 {
    (100 + sample % SIZE[0] + 30 * (sample / SIZE[0])) as i16
}

impl Tiff {
    fn new(place: [f64; 4], keys: &[(u16, u16)]) -> Self {
        // Pixels are points.
        let keys = [(1025, 2)].iter().chain(keys).map(|&(key, value)| [key, 0, 1, value]);
        Self { place, keys: keys.collect(), ..Self::default() }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut out = Cursor::new(vec![]);
        let mut tiff = TiffEncoder::new(&mut out).expect("memory");
        let mut directory = tiff.image_directory().expect("memory");
        let samples: Vec<u8> = (0..SIZE[0] * SIZE[1]).flat_map(|sample| height(sample).to_ne_bytes()).collect();
        let at = directory.write_data(&samples[..]).expect("memory") as u32;
        let shorts = [(258, 16), (259, 1), (262, 1), (277, 1), (339, 2)];
        for (tag, value) in shorts {
            directory.write_tag(Tag::from_u16_exhaustive(tag), value as u16).expect("memory");
        }
        for (tag, value) in [(256, SIZE[0]), (257, SIZE[1]), (273, at), (278, SIZE[1]), (279, samples.len() as u32)] {
            directory.write_tag(Tag::from_u16_exhaustive(tag), value).expect("memory");
        }
        let [x, y, dx, dy] = self.place;
        let mut keys = self.keys.clone();
        keys.sort_unstable();
        let mut numbers = vec![1, 1, 0, keys.len() as u16];
        numbers.extend(keys.as_flattened());
        directory.write_tag(Tag::ModelPixelScaleTag, &[dx, dy, 0.0][..]).expect("memory");
        directory.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, x, y, 0.0][..]).expect("memory");
        directory.write_tag(Tag::GeoKeyDirectoryTag, &numbers[..]).expect("memory");
        if !self.doubles.is_empty() {
            directory.write_tag(Tag::GeoDoubleParamsTag, &self.doubles[..]).expect("memory");
        }
        for (tag, text) in [(34737, &self.texts), (42112, &self.metadata)] {
            if !text.is_empty() {
                directory.write_tag(Tag::from_u16_exhaustive(tag), &text[..]).expect("memory");
            }
        }
        directory.finish().expect("memory");
        out.into_inner()
    }

    fn write(&self, path: &Path) -> PathBuf {
        std::fs::write(path, self.bytes()).expect("writable");
        path.to_owned()
    }
}

/// The same samples as a `.bil` with a `.prj`.
fn bil(folder: &Path, [x, y, dx, dy]: [f64; 4], prj: &str) -> PathBuf {
    let samples: Vec<u8> = (0..SIZE[0] * SIZE[1]).flat_map(|sample| height(sample).to_le_bytes()).collect();
    let hdr = format!(
        "NCOLS {}\nNROWS {}\nNBITS 16\nPIXELTYPE SIGNEDINT\nBYTEORDER I\nULXMAP {x:?}\nULYMAP {y:?}\nXDIM {dx:?}\nYDIM {dy:?}\n",
        SIZE[0], SIZE[1]
    );
    for (name, bytes) in [("a.bil", &samples[..]), ("a.hdr", hdr.as_bytes()), ("a.prj", prj.as_bytes())] {
        std::fs::write(folder.join(name), bytes).expect("writable");
    }
    folder.join("a.bil")
}

/// Whole numbers stay as they are. A pole has the mean of its row, which is none.
fn tolerance(options: &RasterOptions) -> Tolerance {
    Tolerance::InputUnits(if options.surface == SurfaceKind::Plane { 0.0 } else { 0.01 })
}

/// Builds a file of heights, and writes all of it as GeoTIFF.
fn window(path: &Path, options: &RasterOptions, out: &Path) -> PathBuf {
    let (bytes, _) = built(path, options, tolerance(options), 1 << 30);
    let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
    let window = raster_window_of(&file, None, None).expect("all of it");
    let mut tiff = Cursor::new(vec![]);
    write_geotiff(&file, &window, &mut tiff, &Silent).expect("memory");
    std::fs::write(out, tiff.into_inner()).expect("writable");
    out.to_owned()
}

/// Samples in metres, the name of the system, and metres in a unit of coordinates.
fn said(path: &Path, options: &RasterOptions) -> (Vec<f64>, String, Option<f64>) {
    let source = HeightSource::open(&[path.to_owned()], options, &Silent).expect("sound").expect("a raster");
    let metres = source.surface.height_scale * source.unit.map_or(1.0, |unit| unit.metres);
    let mut samples = vec![];
    let add = |_, row: &[f64]| {
        samples.extend(row.iter().map(|height| (height - source.zero) * metres));
        Ok::<_, lodpack_cli::import::ImportError>(())
    };
    source.for_each_row(add).expect("sound");
    (samples, source.placement.crs.clone(), source.unit.map(|unit| unit.metres))
}

/// The first sample and the distances, as another reader of TIFF finds them.
fn place(path: &Path) -> [f64; 4] {
    let mut decoder = Decoder::new(Cursor::new(std::fs::read(path).expect("readable"))).expect("a TIFF");
    let scale = decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).expect("there");
    let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).expect("there");
    assert_eq!(tie[..2], [0.0; 2]);
    [tie[3], tie[4], scale[0], scale[1]]
}

fn keys(path: &Path) -> Vec<[u16; 4]> {
    let mut decoder = Decoder::new(Cursor::new(std::fs::read(path).expect("readable"))).expect("a TIFF");
    decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).expect("there").as_chunks::<4>().0[1..].to_vec()
}

fn key(path: &Path, wanted: u16) -> Option<u16> {
    keys(path).into_iter().find(|[key, ..]| *key == wanted).map(|[.., value]| value)
}

const METRES: [f64; 4] = [500_012.5, 5_200_007.25, 10.0, 12.5];
const DEGREES: [f64; 4] = [-105.001, 40.0005, 0.001, 0.0015];
const GEOGCS: &str = "GEOGCS[\"GCS_North_American_1983\",DATUM[\"D_North_American_1983\",SPHEROID[\"GRS_1980\",6378137.0,298.257222101]],\
    PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]]";
const MOON: &str = "GEOGCS[\"Moon 2000\",DATUM[\"D_Moon_2000\",SPHEROID[\"Moon_2000_IAU_IAG\",1737400.0,0.0]],PRIMEM[\"Reference_Meridian\",0.0],\
    UNIT[\"Degree\",0.0174532925199433]]";
const VERTCS: &str = "VERTCS[\"NAVD88_height_(ftUS)\",VDATUM[\"North_American_Vertical_Datum_1988\"],PARAMETER[\"Vertical_Shift\",0.0],\
    PARAMETER[\"Direction\",1.0],UNIT[\"Foot_US\",0.3048006096012192]]";

fn projcs(base: &str, unit: &str) -> String {
    format!(
        "PROJCS[\"Mine\",{base},PROJECTION[\"Albers\"],PARAMETER[\"False_Easting\",10.0],PARAMETER[\"Central_Meridian\",-97.0],\
         PARAMETER[\"Standard_Parallel_1\",29.5],PARAMETER[\"Standard_Parallel_2\",45.5],UNIT[{unit}]]"
    )
}

#[test]
fn a_window_built_again_has_the_same_samples_at_the_same_places() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| dir.path().join(name);
    let plane = RasterOptions::default();
    let on = |surface, radius| RasterOptions { surface, radius, ..RasterOptions::default() };
    let mut cases: Vec<(String, PathBuf, [f64; 4], RasterOptions)> = vec![];
    let mut add =
        |name: String, path: PathBuf, place, options: &RasterOptions| cases.push((name, path, place, options.clone()));
    // Keys of heights: none, metres, feet, US survey feet; NAVD88 in each.
    let heights: [&[(u16, u16)]; 6] =
        [&[], &[(4099, 9001)], &[(4099, 9002)], &[(4096, 6360)], &[(4096, 8228)], &[(4096, 5703), (4099, 9001)]];
    for code in [32632, 2230, 2222, 28992, 27700, 2056, 3031, 5070, 3857, 4839] {
        for (number, own) in heights.iter().enumerate() {
            let keys = [&[(1024, 1), (3072, code)], *own].concat();
            let name = format!("{code} {number}");
            add(name.clone(), Tiff::new(METRES, &keys).write(&at(&format!("{name}.tif"))), METRES, &plane);
        }
    }
    for code in [4326, 4269, 6318, 4171, 4979] {
        for (number, own) in heights.iter().enumerate() {
            let keys = [&[(1024, 2), (2048, code)], *own].concat();
            let name = format!("{code} {number}");
            add(name.clone(), Tiff::new(DEGREES, &keys).write(&at(&format!("{name}.tif"))), DEGREES, &plane);
        }
    }
    // An origin of one's own, also of heights; a unit that is not that of the system.
    let moved = RasterOptions { origin: Some([499_000.0, 5_000_000.0, 61.0]), ..plane.clone() };
    let feet = [(1024, 1), (3072, 32632), (3076, 9002), (4099, 9003)];
    add("feet of UTM".into(), Tiff::new(METRES, &feet).write(&at("f.tif")), METRES, &plane);
    add("moved".into(), Tiff::new(METRES, &feet[..2]).write(&at("m.tif")), METRES, &moved);
    let moved = RasterOptions { origin: Some([-105.0, 40.0, 50.0]), ..plane.clone() };
    add("moved degrees".into(), Tiff::new(DEGREES, &[(1024, 2), (2048, 4326)]).write(&at("d.tif")), DEGREES, &moved);
    let none = Tiff::new([0.0, 170.0, 10.0, 10.0], &[]).write(&at("n.tif"));
    add("no system".into(), none, [0.0, 170.0, 10.0, 10.0], &plane);
    // WKT beside them.
    let compound = format!(
        "COMPD_CS[\"both\",{},VERT_CS[\"h\",VERT_DATUM[\"d\",2005],UNIT[\"foot\",0.3048]]]",
        projcs(GEOGCS, "\"metre\",1")
    );
    let texts = [
        (projcs(GEOGCS, "\"Foot_US\",0.3048006096012192"), METRES),
        (format!("{},{VERTCS}", projcs(GEOGCS, "\"Meter\",1.0")), METRES),
        (compound, METRES),
        (projcs(MOON, "\"Meter\",1.0"), METRES),
        (GEOGCS.to_owned(), DEGREES),
        (format!("{GEOGCS},{VERTCS}"), DEGREES),
        (MOON.to_owned(), DEGREES),
    ];
    for (number, (text, place)) in texts.iter().enumerate() {
        let folder = at(&number.to_string());
        std::fs::create_dir(&folder).expect("writable");
        add(format!("text {number}"), bil(&folder, *place, text), *place, &plane);
    }
    // Globes: half a row from the poles, with samples at them, and a part of one beyond the date line.
    let globe = [-175.0, 85.0, 10.0, 10.0];
    let part = [170.0, 40.0, 1.0, 1.0];
    for (name, place) in [("globe", globe), ("part", part)] {
        let path = Tiff::new(place, &[(1024, 2), (2048, 4326)]).write(&at(&format!("{name}.tif")));
        for (number, options) in [on(SurfaceKind::Wgs84, None), on(SurfaceKind::Sphere, None)].iter().enumerate() {
            add(format!("{name} {number}"), path.clone(), place, options);
        }
        let folder = at(&format!("moon {name}"));
        std::fs::create_dir(&folder).expect("writable");
        add(format!("moon {name}"), bil(&folder, place, MOON), place, &on(SurfaceKind::Sphere, None));
    }
    for (name, path, expected, options) in &cases {
        let first = window(path, options, &at("first.tif"));
        let again = RasterOptions { surface: options.surface, ..RasterOptions::default() };
        let second = window(&first, &again, &at("second.tif"));
        let (samples, crs, unit) = said(path, options);
        for (number, written) in [first, second].iter().enumerate() {
            let (own, own_crs, own_unit) = said(written, &again);
            assert_eq!(own.len(), samples.len(), "{name}");
            let off = own.iter().zip(&samples).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let most = if options.surface == SurfaceKind::Plane { 1e-9 } else { 0.0201 };
            assert!(off < most, "{name}: samples of window {number} are off by {off} m");
            assert_eq!((&own_crs, own_unit), (&crs, unit), "{name}");
            let found = place(written);
            for k in 0..4 {
                let off = (found[k] - expected[k]).abs() / expected[2 + k % 2];
                assert!(off < 1e-6, "{name}: {found:?} for {expected:?}");
            }
        }
    }
    assert!(cases.len() > 100);
}

#[test]
fn heights_in_feet_become_metres_wherever_a_file_says_so() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let utm = [(1024, 1), (3072, 32610)];
    let unit = |name: &str| {
        format!(
            "<GDALMetadata>\n  <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">{name}</Item>\n</GDALMetadata>"
        )
    };
    let tiff = |own: &[(u16, u16)], metadata: &str| Tiff {
        metadata: metadata.into(),
        ..Tiff::new(METRES, &[&utm, own].concat())
    };
    let bounds = |path: &Path| read(&[path.to_owned()], &RasterOptions::default()).bounds().map(|p| p.z);
    let is_in = |path: &Path, metres: f64, what: &str| {
        let found = bounds(path);
        let expected = [HEIGHTS.start() * metres, HEIGHTS.end() * metres];
        assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-9), "{what}: {found:?} for {expected:?}");
    };
    let path = dir.path().join("a.tif");
    for (own, metadata, metres) in [
        (&[][..], String::new(), 1.0),
        (&[(4099, 9002)], String::new(), 0.3048),
        (&[(4099, 9003)], String::new(), US_FOOT),
        (&[(4096, 8228)], String::new(), 0.3048),
        (&[(4096, 6360)], String::new(), US_FOOT),
        (&[(4096, 5703)], String::new(), 1.0),
        (&[(4096, 5103)], String::new(), 1.0),
        (&[(4096, 32767), (4099, 9002)], String::new(), 0.3048),
        // As GDAL has it: the unit of a system that is known counts, and that of the band above all.
        (&[(4096, 6360), (4099, 9001)], String::new(), US_FOOT),
        (&[(4096, 5703)], unit("ft"), 0.3048),
        (&[], unit("foot"), 0.3048),
        (&[], unit("US survey foot"), US_FOOT),
        (&[], unit("metre"), 1.0),
        (&[], unit("parsec"), 1.0),
    ] {
        is_in(&tiff(own, &metadata).write(&path), metres, &format!("{own:?} {metadata}"));
    }
    // State plane: heights that say nothing are in the unit of the coordinates.
    let stateplane = Tiff::new(METRES, &[(1024, 1), (3072, 2230)]).write(&path);
    is_in(&stateplane, 1.0, "in feet like the coordinates");
    let degrees = Tiff::new(DEGREES, &[(1024, 2), (2048, 4269), (4096, 6360)]).write(&path);
    is_in(&degrees, US_FOOT, "beside degrees");
    let utm = projcs(GEOGCS, "\"Meter\",1.0");
    for (text, metres) in [
        (format!("{utm},{VERTCS}"), US_FOOT),
        (format!("{utm},{}", VERTCS.replace("0.3048006096012192", "0.3048")), 0.3048),
        (format!("COMPD_CS[\"c\",{utm},VERT_CS[\"v\",UNIT[\"foot\",0.3048],AXIS[\"Up\",UP]]]"), 0.3048),
        (
            format!(
                "COMPOUNDCRS[\"c\",{utm},VERTCRS[\"v\",CS[vertical,1],AXIS[\"h\",up,LENGTHUNIT[\"foot\",0.3048]]]]"
            ),
            0.3048,
        ),
        (utm.clone(), 1.0),
    ] {
        let path = bil(dir.path(), METRES, &text);
        is_in(&path, metres, &text);
        let mesh = read(&[path], &RasterOptions::default());
        let [low, high] = mesh.bounds();
        assert_eq!(((high - low).x, (high - low).y), (350.0, 17.0 * 12.5), "coordinates stay metres: {text}");
    }
}

#[test]
fn degrees_are_degrees_by_any_number() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("a.tif");
    let extent = |path: &Path, crs: Option<&str>| {
        let options = RasterOptions { crs: crs.map(str::to_owned), ..RasterOptions::default() };
        let [low, high] = read(&[path.to_owned()], &options).bounds();
        [(high - low).x, (high - low).y]
    };
    let expected = extent(&Tiff::new(DEGREES, &[(1024, 2), (2048, 4269)]).write(&path), None);
    assert!(expected[0] > 2900.0 && expected[0] < 3000.0, "{expected:?}");
    for code in [6318, 4171, 4230, 4314, 9989, 4979, 7844] {
        assert_eq!(extent(&Tiff::new(DEGREES, &[(1024, 2), (2048, code)]).write(&path), None), expected, "{code}");
    }
    let none = Tiff::new(DEGREES, &[]).write(&path);
    for crs in ["EPSG:6318", "EPSG:4171", "EPSG:4171+5720", "EPSG:6349", GEOGCS] {
        assert_eq!(extent(&none, Some(crs)), expected, "{crs}");
    }
    // A smaller globe has shorter degrees.
    let moon = extent(&none, Some("IAU_2015:30100"));
    assert!((moon[0] / expected[0] - 1_737_400.0 / 6_378_137.0).abs() < 0.01, "{moon:?}");
    assert_eq!(extent(&none, Some(MOON)), moon);
}

#[test]
fn windows_of_globes_have_no_row_beyond_a_pole_and_say_which_globe_it_is() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| dir.path().join(name);
    let path = Tiff::new([-175.0, 85.0, 10.0, 10.0], &[(1024, 2), (2048, 4326)]).write(&at("a.tif"));
    for (surface, radius, code) in [
        (SurfaceKind::Wgs84, None, 4326),
        (SurfaceKind::Sphere, None, 4326),
        (SurfaceKind::Sphere, Some(1_737_400.0), 32767),
    ] {
        let options = RasterOptions { surface, radius, ..RasterOptions::default() };
        let (bytes, _) = built(&path, &options, tolerance(&options), 1 << 30);
        let file = Heights::open(bytes.as_slice(), Limits::default()).expect("it was just written");
        for bounds in [None, Some([[-180.0, -90.0], [180.0, 90.0]]), Some([[0.0, -90.0], [360.0, 90.0]])] {
            let window = raster_window_of(&file, bounds, None).expect("all of it");
            assert_eq!(window.size, [36, 18], "{bounds:?}");
        }
        let east = raster_window_of(&file, Some([[172.0, -20.0], [-172.0, 20.0]]), None).expect("a part");
        assert!(east.size[0] < 5 && east.size[1] < 8, "{east:?}");
        let tiff = window(&path, &options, &at("w.tif"));
        assert_eq!(key(&tiff, 2048), Some(code));
        // Built again it is a globe of the same size.
        let again = HeightSource::open(&[tiff], &RasterOptions { surface, ..RasterOptions::default() }, &Silent);
        let again = again.expect("sound").expect("a raster");
        let source =
            HeightSource::open(std::slice::from_ref(&path), &options, &Silent).expect("sound").expect("a raster");
        assert_eq!((again.surface, again.grid), (source.surface, source.grid));
    }
    // The ellipsoid of WGS 84 is no place for the moon.
    let moon = RasterOptions { crs: Some(MOON.into()), surface: SurfaceKind::Wgs84, ..RasterOptions::default() };
    let refused = HeightSource::open(&[Tiff::new(DEGREES, &[]).write(&at("m.tif"))], &moon, &Silent);
    assert!(refused.err().is_some_and(|error| error.to_string().contains("--surface sphere")));
}

#[test]
fn the_ramp_of_the_earth_counts_in_metres() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let ramp = |path: PathBuf| {
        let options = RasterOptions { ramp: "earth".parse().ok(), ..RasterOptions::default() };
        let source = HeightSource::open(&[path], &options, &Silent).expect("sound").expect("a raster");
        let (ramp, _) = source.ramp([100.0, 645.0]).expect("fits").expect("typed");
        ramp.stops().last().map(|stop| stop.height)
    };
    let path = dir.path().join("a.tif");
    for (keys, metres) in [
        (&[(1024, 1), (3072, 32632)][..], 1.0),
        (&[(1024, 1), (3072, 32632), (4099, 9002)], 0.3048),
        (&[(1024, 1), (3072, 2230)], US_FOOT),
    ] {
        assert_eq!(ramp(Tiff::new(METRES, keys).write(&path)), Some(5500.0 / metres), "{keys:?}");
    }
    assert_eq!(ramp(Tiff::new(DEGREES, &[(1024, 2), (2048, 4326), (4096, 8228)]).write(&path)), Some(5500.0 / 0.3048));
}

#[test]
fn keys_that_lie_are_refused_or_say_nothing() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("a.tif");
    let sound = [(1024, 1), (3072, 32632)];
    let open = |tiff: &Tiff| HeightSource::open(&[tiff.write(&path)], &RasterOptions::default(), &Silent);
    for (keys, doubles, says) in [
        (vec![[1024, 0, 1, 2], [2048, 0, 1, 60_000]], vec![], "EPSG:60000"),
        (vec![[1024, 0, 1, 2], [2048, 0, 1, 4807]], vec![], "degrees"),
        (vec![[1024, 0, 1, 3]], vec![], "geocentric"),
        (vec![[1024, 0, 1, 1], [3076, 0, 1, 9999]], vec![], "9999"),
        (vec![[1024, 0, 1, 1], [3076, 0, 1, 32767], [3077, 34736, 1, 0]], vec![0.0], "unit"),
        (vec![[1024, 0, 1, 1], [3076, 0, 1, 32767], [3077, 34736, 1, 0]], vec![f64::NAN], "unit"),
        (vec![[1024, 0, 1, 1], [3076, 0, 1, 32767], [3077, 34736, 1, 0]], vec![1e300], "unit"),
        (vec![[1024, 0, 1, 2], [2048, 0, 1, 32767], [2057, 34736, 1, 0]], vec![-1.0], "half axis"),
    ] {
        let tiff = Tiff { doubles, ..Tiff { keys: keys.clone(), ..Tiff::new(DEGREES, &[]) } };
        let error = open(&tiff).err().unwrap_or_else(|| panic!("{keys:?} is refused")).to_string();
        assert!(error.contains(says) && error.contains("a.tif"), "{error}");
    }
    // Places outside of their tags, and counts that do not fit.
    for entry in [
        [3073, 34737, 9, 60_000],
        [3073, 34737, 65_535, 1],
        [3077, 34736, 1, 7],
        [4099, 34736, 1, 0],
        [4096, 0, 2, 6360],
    ] {
        let mut tiff = Tiff { texts: "ESRI PE String = [|".into(), ..Tiff::new(METRES, &sound) };
        tiff.keys.push(entry);
        let source = open(&tiff).expect("sound").expect("a raster");
        assert_eq!((source.placement.crs.as_str(), source.unit.map(|unit| unit.metres)), ("EPSG:32632", Some(1.0)));
    }
    // A number that nobody knows is kept where coordinates are lengths.
    let source = open(&Tiff::new(METRES, &[(1024, 1), (3072, 32001), (3076, 9002)])).expect("sound").expect("a raster");
    assert_eq!(source.unit.map(|unit| unit.metres), Some(0.3048));
    // Every byte of the keys' part of a file, changed.
    let bytes = Tiff {
        texts: format!("ESRI PE String = {}|", projcs(GEOGCS, "\"Meter\",1")),
        ..Tiff::new(METRES, &[(1024, 32767)])
    };
    let mut bytes =
        Tiff { keys: [bytes.keys.clone(), vec![[3073, 34737, bytes.texts.len() as u16, 0]]].concat(), ..bytes }.bytes();
    let from = bytes.len() - 1200;
    for at in from..bytes.len() {
        let kept = bytes[at];
        for changed in [kept ^ 1, kept ^ 0x80, b'[', b'"'] {
            bytes[at] = changed;
            std::fs::write(&path, &bytes).expect("writable");
            // Whatever it says, it is a grid or an error.
            let _ = HeightSource::open(std::slice::from_ref(&path), &RasterOptions::default(), &Silent);
        }
        bytes[at] = kept;
    }
}
