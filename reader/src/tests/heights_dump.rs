//! The vectors of files of heights: the reader, the JSON and `format-spec/decode.py` agree.

use std::{fmt::Write as _, fs, path::PathBuf, process::Command};

use super::terrain::Terrain;
use crate::{
    heights::{Base, CELLS, Drape, DrapeWindow, Heights, Ramp, RampStop, SIDE, TileId},
    limits::Limits,
};

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors/heights")
}

/// The vectors, by name.
fn vectors() -> Vec<(&'static str, Vec<u8>)> {
    let island = |column: u64, row: u64| {
        column.abs_diff(40).pow(2) + row.abs_diff(20).pow(2) < 250 || column > 70 && column + row < 99
    };
    let stop = |height: f64, colour: [u8; 3]| RampStop { height, colour };
    let ramp =
        vec![stop(10.0, [0, 40, 160]), stop(20.5, [250, 240, 200]), stop(20.5, [30, 120, 40]), stop(60.0, [255; 3])];
    let ramp = Ramp::new(ramp).unwrap();
    vec![
        ("painted", Terrain::plane([20, 12]).with_ramp(ramp).file(5.0)),
        ("draped", Terrain::plane([20, 12]).with_drape(hole()).file(5.0)),
        ("photo", Terrain::plane([20, 12]).with_drape(photo()).file(5.0)),
        ("cell", Terrain::plane([1, 1]).file(1.0)),
        ("hills", Terrain::plane([100, 70]).file(30.0)),
        ("islands", Terrain::plane([100, 70]).with_cells(island).file(30.0)),
        ("globe", Terrain::globe([90, 45]).file(60.0)),
        ("sea", Terrain::globe([300, 5]).level_but(|column, row| column > 270 && row > 0 && row < 5).file(60.0)),
        ("ridge", Terrain::plane([1100, 2]).file(9.0)),
    ]
}

/// An image with a hole and three levels of tiles, which covers a part of 20 x 12 cells.
pub(super) fn hole() -> Drape {
    Drape { size: [140, 90], first: [-0.5, 2.25], spacing: [0.125, 0.125], components: 4, side_log2: 4 }
}

/// An image without opacity in one tile, whose texels are samples.
fn photo() -> Drape {
    Drape { size: [21, 13], first: [0.0, 0.0], spacing: [1.0, 1.0], components: 3, side_log2: 5 }
}

/// What the image over heights shows: of each tile checksums of its texels at all scales.
fn drape_text(heights: &Heights<&[u8]>, drape: &Drape) -> String {
    let list_of = |numbers: [u64; 2]| list(numbers.map(|x| x.to_string()));
    let numbers = list(drape.first.into_iter().chain(drape.spacing).map(bits));
    let (size, components, side) = (list_of(drape.size), drape.components, drape.side_log2);
    let mut text = format!(
        "\"drape\":{{\"size\":{size},\"numbers\":{numbers},\"components\":{components},\"side\":{side},\"images\":["
    );
    for halvings in (0..=drape.most_halvings()).rev() {
        let size = drape.size_at(halvings).map(|size| size as u32);
        let window = DrapeWindow { halvings, first: [0, 0], size };
        let image = heights.drape_image(&window).unwrap().image;
        let _ = write!(text, "{}", if halvings < drape.most_halvings() { "," } else { "" });
        let _ = write!(text, "\n[{},{},{}]", size[0], size[1], crc32fast::hash(&image.data));
    }
    text + "\n]},\n"
}

fn bits(number: f64) -> String {
    format!("\"{:016x}\"", number.to_bits())
}

fn list(items: impl IntoIterator<Item = String>) -> String {
    format!("[{}]", items.into_iter().collect::<Vec<_>>().join(","))
}

fn dump(bytes: &[u8]) -> String {
    let heights = Heights::open(bytes, Limits::default()).unwrap();
    let (info, grid) = (heights.info(), heights.grid());
    let ([columns, rows], [first, last]) = (grid.cells(), grid.poles());
    let (wraps, depth) = (grid.wraps(), grid.depth());
    let mut text = format!(
        "{{\n\"grid\":{{\"columns\":{columns},\"rows\":{rows},\"wraps\":{wraps},\"poles\":[{first},{last}],\"depth\":{depth}}},\n"
    );
    let (axis, eccentricity) = match info.surface.base {
        Base::Plane => (0.0, 0.0),
        Base::Ellipsoid { axis, eccentricity } => (axis, eccentricity),
    };
    let numbers = [axis, eccentricity].into_iter().chain(info.surface.first).chain(info.surface.spacing);
    let numbers = numbers.chain([info.surface.height_scale, info.zero, info.step, info.sample_error]);
    let numbers = list(numbers.chain([info.unit.unwrap_or(0.0)]).map(bits));
    let is_globe = info.surface.is_globe();
    let _ = write!(text, "\"surface\":{{\"is_globe\":{is_globe},\"numbers\":{numbers}}},\n\"ramp\":{:?},\n", info.ramp);
    if let Some(ramp) = heights.ramp() {
        let stop = |stop: &RampStop| format!("[{},{}]", bits(stop.height), list(stop.colour.map(|x| x.to_string())));
        let _ = writeln!(text, "\"stops\":{},", list(ramp.stops().iter().map(stop)));
    }
    if let Some(drape) = heights.drape() {
        text += &drape_text(&heights, drape);
    }
    text += "\"tiles\":[";
    let mut ids: Vec<TileId> = heights.roots().to_vec();
    let mut next = 0;
    while let Some(&id) = ids.get(next) {
        ids.extend(heights.record(id).unwrap().unwrap().child_tiles());
        next += 1;
    }
    ids.sort_unstable_by_key(|id| id.order(grid));
    let tiles = ids.into_iter().map(|id| tile(&heights, id));
    text + "\n" + &tiles.collect::<Vec<_>>().join(",\n") + "\n]\n}\n"
}

fn tile(heights: &Heights<&[u8]>, id: TileId) -> String {
    let record = heights.record(id).unwrap().unwrap();
    let values = heights.tile(id).unwrap().unwrap();
    let drawn = heights.draw(id, &values, f64::INFINITY);
    let lines = heights.grid().lines(id);
    let known = crate::heights::known_samples(&values, &lines);
    let cells = values.cells.as_ref().filter(|_| record.is_partial);
    let cells = cells.map_or("null".into(), |cells| list(cells.iter().map(|row| format!("\"{row:016x}\""))));
    let count = |lines: &[u64; SIDE]| 1 + lines.partition_point(|&line| line < lines[CELLS]);
    let sample = |at: usize| match known.as_ref().is_none_or(|known| known[at]) {
        true => values.steps[at].to_string(),
        false => "null".into(),
    };
    let rows =
        (0..count(&lines.rows)).map(|row| list((0..count(&lines.columns)).map(|column| sample(row * SIDE + column))));
    let resolutions = record.resolutions.iter().map(|resolution| {
        let triangles = drawn.triangles(resolution.tolerance);
        assert_eq!(triangles.len() as u32, resolution.triangle_count);
        let triangles = list(triangles.iter().map(|triangle| list(triangle.map(|at| at.to_string()))));
        format!(
            "{{\"tolerance\":{},\"error\":{},\"triangles\":{triangles}}}",
            bits(resolution.tolerance),
            bits(resolution.error)
        )
    });
    format!(
        "{{\"tile\":[{},{},{}],\"children\":{},\"partial\":{},\"lowest\":{},\"highest\":{},\"cells\":{cells},\"samples\":{},\"middle\":{},\"resolutions\":{}}}",
        id.depth,
        id.column,
        id.row,
        record.children,
        record.is_partial,
        record.lowest,
        record.highest,
        list(rows),
        list(drawn.position(SIDE * SIDE / 2).map(bits)),
        list(resolutions),
    )
}

#[test]
fn vectors_decode_to_their_json_in_both_decoders() {
    let mut count = 0;
    for entry in fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "lodpack") {
            let expected = fs::read_to_string(path.with_extension("json")).unwrap();
            assert!(dump(&fs::read(&path).unwrap()) == expected, "{}", path.display());
            let decoder = folder().join("../../decode.py");
            let output = Command::new("python3").arg(decoder).arg(&path).output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            assert!(output.stdout == expected.as_bytes(), "decode.py and {}", path.display());
            count += 1;
        }
    }
    assert_eq!(count, vectors().len());
}

/// Run it with `--ignored` when the format changes.
#[test]
#[ignore = "writes the vectors anew"]
fn write_vectors() {
    fs::create_dir_all(folder()).unwrap();
    for (name, bytes) in vectors() {
        fs::write(folder().join(format!("{name}.json")), dump(&bytes)).unwrap();
        fs::write(folder().join(format!("{name}.lodpack")), bytes).unwrap();
    }
}
