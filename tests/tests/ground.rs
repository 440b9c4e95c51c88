//! A mesh on its ground of heights: built, joined, taken apart, verified and exported; and every way in which the two
//! do not fit.

use crate::commands::lodpack;
use glam::DVec3;
use lodpack::heights::HeightsQuery;
use lodpack::stream::{Mode, Options, StreamerOptions};
use lodpack::{File, Ground, Limits, Query, ReadAt, View};
use lodpack_cli::mesh::Mesh;
use lodpack_tests::generate::save_ply;
use lodpack_tests::parts::{add_box, boxes};
use lodpack_tests::terrain::Grid;
use serde_json::Value;
use std::path::PathBuf;
use std::sync::Arc;

/// A folder with `boxes.ply`, and with `dem.tif` under it.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().expect("a temporary directory"));
        save_ply(&boxes(40), &folder.path("boxes.ply")).expect("writable");
        folder.dem("dem.tif", Some(32632));
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).expect("it was written")
    }

    /// Gentle hills of 2 m squares below the boxes.
    fn dem(&self, name: &str, epsg: Option<u16>) {
        let grid = Grid { place: Some([0.0, 140.0, 2.0, 2.0]), epsg, ..Grid::utm([70, 70]) };
        let height = |sample: u32| 40.0 + 3.0 * (0.2 * f64::from(sample % 70)).sin() + 0.1 * f64::from(sample / 70);
        let heights: Vec<f32> = (0..70 * 70).map(|sample| height(sample) as f32).collect();
        std::fs::write(self.path(name), grid.bytes(&heights)).expect("writable");
    }

    /// What a command prints.
    fn run(&self, words: &str) -> String {
        let ran = lodpack().current_dir(self.0.path()).args(words.split_whitespace()).assert().success();
        String::from_utf8(ran.get_output().stdout.clone()).expect("UTF-8")
    }

    fn json(&self, words: &str) -> Value {
        serde_json::from_str(&self.run(&format!("{words} --json"))).expect("--json prints JSON")
    }

    /// What a command that must fail says.
    fn refused(&self, words: &str) -> String {
        let ran = lodpack().current_dir(self.0.path()).args(words.split_whitespace()).assert().code(2);
        String::from_utf8_lossy(&ran.get_output().stderr).into_owned()
    }

    /// A town with y up, in feet and around an origin, on coloured hills that say nothing of that: for pictures.
    fn with_turned_town() -> Self {
        let folder = Self::new();
        let mut town = Mesh::default();
        let origin = DVec3::new(70.0, 70.0, 40.0);
        for house in 0..9 {
            let [column, row] = [house % 3, house / 3].map(f64::from);
            add_box(&mut town, DVec3::new(20.0 + 40.0 * column, 20.0 + 40.0 * row, 25.0), DVec3::new(16.0, 12.0, 30.0));
        }
        for position in &mut town.positions {
            let DVec3 { x, y, z } = (*position - origin) / 0.3048;
            *position = DVec3::new(x, z, -y);
        }
        save_ply(&town, &folder.path("town.ply")).expect("writable");
        folder.run("build dem.tif --heights --tolerance 0.01 --ramp viridis -o terrain.lodpack");
        folder.run(
            "build town.ply --up y --unit ft --origin 70,70,40 --tolerance 1mm --ground terrain.lodpack -o town.lodpack",
        );
        folder
    }

    /// With `town.lodpack`, which holds both.
    fn with_town() -> Self {
        let folder = Self::new();
        folder.run("build boxes.ply --ground dem.tif --tolerance 0.01 -o town.lodpack");
        folder
    }
}

/// The file of [`Folder::with_turned_town`], for tests in a browser.
pub fn turned_town() -> Vec<u8> {
    Folder::with_turned_town().read("town.lodpack")
}

#[test]
fn one_build_and_a_later_merge_give_the_same_bytes_and_each_part_stays_as_it_was() {
    let folder = Folder::with_town();
    folder.run("build boxes.ply --tolerance 0.01 -o alone.lodpack");
    folder.run("build dem.tif --heights --tolerance 0.01 -o terrain.lodpack");
    folder.run("merge alone.lodpack --ground terrain.lodpack -o merged.lodpack");
    let (town, alone, terrain) =
        (folder.read("town.lodpack"), folder.read("alone.lodpack"), folder.read("terrain.lodpack"));
    assert_eq!(town, folder.read("merged.lodpack"));
    folder.run("build boxes.ply --ground terrain.lodpack --tolerance 0.01 -o again.lodpack");
    assert_eq!(town, folder.read("again.lodpack"));
    // An entry of the directory is all that comes on top.
    assert_eq!(town.len(), alone.len() + terrain.len() + 32);
    let file = File::open(town.as_slice(), Limits::default()).expect("sound");
    let range = file.index().ground_range().expect("a ground");
    assert_eq!(town[range.start as usize..range.end as usize], terrain);
    // A job's parts get a ground, too, and a ground is replaced by another one.
    folder.run("plan boxes.ply --tolerance 0.01 -o job");
    folder.run("build --job job --part 0");
    folder.run("merge job --ground terrain.lodpack -o of-job.lodpack");
    assert_eq!(town, folder.read("of-job.lodpack"));
    folder.run("merge town.lodpack --ground terrain.lodpack -o replaced.lodpack");
    assert_eq!(town, folder.read("replaced.lodpack"));
}

#[test]
fn both_are_extracted_together_and_each_alone() {
    let folder = Folder::with_town();
    let sum =
        |words: &str| folder.json(&format!("extract town.lodpack {words}"))["triangles"].as_u64().expect("a count");
    let [both, mesh, ground] = ["-o both.glb", "-o mesh.ply --ground none", "-o ground.ply --ground only"].map(sum);
    assert_eq!(both, mesh + ground);
    assert!(mesh == 40 * 12 && ground > 1000, "{mesh} {ground}");
    assert_eq!(sum("-o both.ply"), both);
    let glb = String::from_utf8_lossy(&folder.read("both.glb")).into_owned();
    assert!(glb.contains(r#""name":"surface""#) && glb.contains(r#""name":"ground""#), "two nodes");
    // One budget for both, one tolerance for each.
    let budget = folder.json("extract town.lodpack -o few.ply --triangles 2000");
    assert!(budget["triangles"].as_u64().is_some_and(|count| (900..=2000).contains(&count)), "{budget}");
    let coarse = folder.json("extract town.lodpack -o coarse.ply --tolerance 0.5");
    assert!(coarse["certified_error"].as_f64().is_some_and(|error| error <= 0.5), "{coarse}");
    // A box beside all houses has the ground alone.
    let [beside, ground] = ["-o beside.ply", "-o beside-ground.ply --ground only"]
        .map(|words| sum(&format!("{words} --bbox 112,0,0,138,30,99")));
    assert_eq!(beside, ground);
    folder.run("extract town.lodpack -o samples.tif");
    assert!(folder.refused("extract town.lodpack -o no.ply --nodes 3").contains("--ground none"));
    folder.run("build boxes.ply -o alone.lodpack");
    assert!(folder.refused("extract alone.lodpack -o no.ply --ground only").contains("stands on no ground"));
}

#[test]
fn info_says_both_and_verify_checks_each_against_what_belongs_to_it() {
    let folder = Folder::with_town();
    let info = folder.json("info town.lodpack");
    assert_eq!((&info["version"], &info["ground"]["samples"]), (&Value::from("4.3"), &Value::from(4900)));
    assert!(folder.run("info town.lodpack").contains("ground     4,900 samples"));
    let against = folder.json("verify town.lodpack --cuts 5 --against boxes.ply dem.tif");
    assert!(against["ratio_median"].is_number() && against["ground"]["sample_distance"].is_number(), "{against}");
    let mut damaged = folder.read("town.lodpack");
    let range =
        File::open(damaged.as_slice(), Limits::default()).expect("sound").index().ground_range().expect("there");
    damaged[(range.end - 3) as usize] ^= 1;
    std::fs::write(folder.path("damaged.lodpack"), damaged).expect("writable");
    lodpack().arg("verify").arg(folder.path("damaged.lodpack")).assert().code(1);
}

#[test]
fn a_ground_streams_from_the_file_of_its_mesh() {
    let folder = Folder::with_town();
    let bytes: Arc<dyn ReadAt + Send + Sync> = Arc::new(folder.read("town.lodpack"));
    let file = File::open(Arc::clone(&bytes), Limits::default()).expect("sound");
    let Ground { heights, frame } = Ground::open(file.index(), bytes).expect("sound").expect("a ground");
    let whole = heights.mesh(&heights.cut(&HeightsQuery::default()).expect("sound")).expect("sound");
    let session = Options { mode: Mode::Synchronous, ..Options::default() };
    let options = StreamerOptions { session, ..StreamerOptions::default() };
    let mut streamer = heights.streamer(options).expect("sound");
    let bounds = frame.bounds(heights.index().bounds().expect("tiles"));
    let view = View { pixel_tolerance: 1e-6, ..View::around(bounds, [0.0, 0.0, 1.0], 0.5, 1.0) };
    let query = Query { view: Some(frame.view_of_ground(&view)), ..Query::default() };
    for _ in 0..8 {
        streamer.frame(&query).expect("sound");
        streamer.settle();
    }
    assert_eq!(streamer.picture().triangle_count(), whole.triangles.len() as u64);
}

#[test]
fn both_become_one_tileset() {
    let folder = Folder::with_town();
    let summary = folder.json("export town.lodpack --as 3dtiles -o tiles --local");
    let of = |name: &str| -> Value { serde_json::from_slice(&folder.read(name)).expect("JSON") };
    let root = of("tiles/tileset.json");
    let children = root["root"]["children"].as_array().expect("two children");
    let names: Vec<&str> = children.iter().filter_map(|child| child["content"]["uri"].as_str()).collect();
    assert_eq!(names, ["0/tileset.json", "1/tileset.json"]);
    assert_eq!(root["root"]["refine"], "ADD");
    let alone = folder.json("export town.lodpack --as 3dtiles -o mesh --local --ground none");
    let ground = folder.json("export town.lodpack --as 3dtiles -o ground --local --ground only");
    let triangles = |value: &Value| value["triangles"].as_u64().expect("a count");
    assert_eq!(triangles(&summary), triangles(&alone) + triangles(&ground));
    assert!(folder.refused("export town.lodpack --as 3dtiles -o no --up y").contains("--ground none"));
}

#[test]
fn a_ground_elsewhere_on_a_globe_or_of_another_kind_is_refused_in_words() {
    let folder = Folder::new();
    folder.run("build dem.tif --heights -o terrain.lodpack");
    folder.run("build boxes.ply --crs EPSG:32633 --up z -o boxes.lodpack");
    let said = folder.refused("merge boxes.lodpack --ground terrain.lodpack -o b.lodpack");
    assert!(said.contains("another coordinate reference system"), "{said}");
    // What is typed is known before anything is built.
    let said = folder.refused("build boxes.ply --ground terrain.lodpack --crs EPSG:32633 -o a.lodpack");
    assert!(said.contains("--crs") && said.contains("another coordinate reference system"), "{said}");
    std::fs::write(folder.path("globe.tif"), Grid::globe([36, 18]).bytes(&[0.0; 36 * 18])).expect("writable");
    folder.run("build globe.tif --heights --surface wgs84 -o globe.lodpack");
    assert!(folder.refused("build boxes.ply --ground globe.lodpack -o a.lodpack").contains("--surface plane"));
    folder.run("build boxes.ply -o plain.lodpack");
    assert!(folder.refused("merge plain.lodpack --ground globe.lodpack -o c.lodpack").contains("globe"));
    assert!(folder.refused("merge plain.lodpack --ground plain.lodpack -o d.lodpack").contains("holds a mesh"));
    assert!(folder.refused("build boxes.ply --ground boxes.ply -o e.lodpack").contains("raster of heights"));
    assert!(folder.refused("build boxes.ply dem.tif -o f.lodpack").contains("--ground"));
    assert!(!folder.path("b.lodpack").exists() && !folder.path("c.lodpack").exists());
}

#[test]
fn every_truncation_of_a_file_with_a_ground_is_refused() {
    let bytes = Folder::with_town().read("town.lodpack");
    for length in (0..bytes.len()).step_by(97) {
        let opened = File::open(&bytes[..length], Limits::default());
        assert!(opened.and_then(|file| file.verify()).is_err(), "{length} bytes of {}", bytes.len());
    }
}

#[test]
fn a_job_keeps_the_ground_for_its_merge_and_workers_build_the_same_bytes() {
    let folder = Folder::with_town();
    let town = folder.read("town.lodpack");
    for (job, how) in [("job", "--parts 2"), ("staged", "--stages")] {
        folder.run(&format!("plan boxes.ply --ground dem.tif --tolerance 0.01 {how} -o {job}"));
        match how {
            "--stages" => folder.run("work staged"),
            _ => folder.run("build --job job --part 0") + &folder.run("build --job job --part 1"),
        };
        let merged = folder.json(&format!("merge {job} -o {job}.lodpack"));
        assert_eq!(merged["ground"]["samples"], 4900, "{merged}");
        assert!(town == folder.read(&format!("{job}.lodpack")), "{job}");
    }
    // The ground is that of the plan; a merge of parts elsewhere knows of none, and another one may be named.
    folder.dem("dem.tif", None);
    folder.run("merge job -o later.lodpack");
    assert!(town == folder.read("later.lodpack"));
    assert!(folder.json("status job")["changed_inputs"].to_string().contains("dem.tif"));
    folder.run("build boxes.ply --tolerance 0.01 -o alone.lodpack");
    std::fs::create_dir(folder.path("elsewhere")).expect("writable");
    for part in ["part-0.lodpart", "part-1.lodpart"] {
        std::fs::copy(folder.path("job/parts").join(part), folder.path("elsewhere").join(part)).expect("a part");
    }
    folder.run("merge elsewhere -o bare.lodpack");
    assert!(folder.read("alone.lodpack") == folder.read("bare.lodpack"));
    // A plan that was stopped before the ground was there says so.
    std::fs::remove_file(folder.path("staged/ground.lodpack")).expect("it was kept");
    assert!(folder.refused("merge staged -o no.lodpack").contains("--resume"));
    assert!(folder.refused("plan dem.tif --heights --ground dem.tif -o no.job").contains("--heights"));

    folder.dem("dem.tif", Some(32632));
    folder.run("build boxes.ply --ground dem.tif --tolerance 0.01 --workers 2 -o workers.lodpack");
    assert!(town == folder.read("workers.lodpack"));
    assert!(!folder.path("workers.lodpack.building").exists());
}

#[test]
fn a_crs_that_the_inputs_name_is_compared_before_anything_is_built() {
    let folder = Folder::new();
    folder.run("build boxes.ply --crs EPSG:32633 --up z -o boxes.lodpack");
    for words in ["build boxes.lodpack", "build boxes.lodpack --workers 2", "plan boxes.lodpack"] {
        let said = folder.refused(&format!("{words} --ground dem.tif --progress json -o no"));
        assert!(said.contains("another coordinate reference system") && said.contains("dem.tif"), "{said}");
        // The ground has been read by then, and nothing of the mesh.
        assert!(!said.contains("\"repair\"") && !said.contains("\"scan\""), "{said}");
        assert!(!folder.path("no").exists() && !folder.path("no.building").exists());
    }
}
