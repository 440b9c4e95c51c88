//! A scene without a feature has no byte for it; `info --why` accounts for every byte of a file and names what is left
//! out.

use crate::commands::lodpack;
use crate::open;
use glam::DVec3;
use lodpack::{
    File,
    index::{FileSummary, Filling, Placement, UpAxis},
};
use lodpack_cli::job::{BuildOptions, build_mesh};
use lodpack_cli::measure::selftest::shapes::{append, moved, rolling, sheet, tetrahedron};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::pipeline::{Fillings, ModelOptions};
use lodpack_cli::progress::Silent;
use lodpack_tests::generate::{bumpy_sphere, punched_sheet};
use lodpack_tests::handmade::{Handmade, HandmadeTexels};
use lodpack_tests::server::serve;
use serde_json::Value;
use std::path::Path;

/// A feature that a file may have.
struct Case {
    what: &'static str,
    /// A file of a scene that does not need the feature, and one of a scene that does.
    without: Vec<u8>,
    with: Vec<u8>,
    /// How much of the feature a file has: its bytes, or its tables, blocks and so on where other features share their
    /// bytes.
    amount: fn(&File<&[u8]>, &FileSummary) -> u64,
    /// What `info --why` calls it when it is left out.
    name: &'static str,
    /// Whether the scene that needs the feature leaves out none of it.
    is_whole: bool,
}

/// Bytes of a section.
fn section(summary: &FileSummary, name: &str) -> u64 {
    summary.sections.iter().filter(|section| section.0 == name).map(|section| section.1).sum()
}

/// Number of kinds of symbols with a table.
fn tables(summary: &FileSummary, name: &str) -> u64 {
    let named = summary.contexts.iter().filter(|context| context.name.contains(name));
    assert!(named.clone().count() > 0, "{name}");
    named.map(|context| context.used_count).sum()
}

/// The smallest number of blocks beyond level 0 that any root has.
fn fewest_finer_blocks(file: &File<&[u8]>, _: &FileSummary) -> u64 {
    let blocks = |root| file.root_contents(root).expect("sound").blocks.len() as u64 - 1;
    (0..file.root_count()).map(blocks).min().unwrap_or(0)
}

fn one_triangle() -> Mesh {
    Mesh { positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] }
}

fn built(mesh: &Mesh, fillings: Fillings, chart_triangles: u32) -> Vec<u8> {
    built_with(mesh, ModelOptions { fillings, chart_triangles: Some(chart_triangles), ..ModelOptions::default() })
}

fn built_with(mesh: &Mesh, model: ModelOptions) -> Vec<u8> {
    let options = BuildOptions { model, ..BuildOptions::default() };
    let mut bytes = vec![];
    build_mesh(mesh.clone(), &options, &mut bytes, &Silent).expect("a sound mesh builds");
    bytes
}

fn cases() -> Vec<Case> {
    let case = |what, without, with, name, amount| Case { what, without, with, amount, name, is_whole: true };
    let plain = |mesh: &Mesh| built(mesh, Fillings::IrregularOnly, 8192);
    let (triangle, tetrahedron) = (plain(&one_triangle()), plain(&tetrahedron(DVec3::ZERO, 1.0)));
    let sphere = bumpy_sphere(24);
    let irregular = built(&sphere, Fillings::IrregularOnly, 1024);
    // Two charts, both disks.
    let disks = |fillings| built(&bumpy_sphere(40), fillings, 8192);
    let (filled_irregularly, grids) = (disks(Fillings::IrregularOnly), disks(Fillings::GridWherePossible));
    let hills = plain(&sheet([16, 16], |x, y| DVec3::new(x, y, rolling(x, y))));
    let mut with_flat_piece = sphere.clone();
    append(&mut with_flat_piece, &moved(one_triangle(), |p| p + DVec3::X * 3.0));
    let placement = Placement { up: UpAxis::Z, crs: "EPSG:32632".into(), ..Placement::default() };
    let placed = built_with(&one_triangle(), ModelOptions { placement: Some(placement), ..ModelOptions::default() });
    vec![
        case("the source", Handmade::example().container().bytes(), triangle.clone(), "source", |_, summary| {
            section(summary, "source")
        }),
        case("a placement", triangle.clone(), placed, "placement", |_, summary| section(summary, "placement")),
        case(
            "channels",
            Handmade::example().container().bytes(),
            HandmadeTexels::example().put_into(Handmade::example().container()).bytes(),
            "channels: colours",
            |_, summary| section(summary, "channels") + section(summary, "texels"),
        ),
        case(
            "an overview",
            irregular.clone(),
            built(&bumpy_sphere(48), Fillings::IrregularOnly, 64),
            "overview",
            |_, summary| section(summary, "overview"),
        ),
        Case {
            is_whole: false,
            ..case("grids", filled_irregularly.clone(), grids.clone(), "118 of 118 for grids", |_, summary| {
                let blocks: u64 = summary.levels.iter().map(|level| level.blocks.of(Filling::Grid)).sum();
                summary.roots.of(Filling::Grid) + blocks + tables(summary, "grids")
            })
        },
        case("grid fillings", filled_irregularly.clone(), grids.clone(), "grid fillings", |_, summary| {
            summary.roots.of(Filling::Grid)
        }),
        case("irregular fillings", grids, filled_irregularly, "irregular fillings", |_, summary| {
            let blocks: u64 =
                summary.levels.iter().map(|level| level.block_count - level.blocks.of(Filling::Grid)).sum();
            summary.roots.of(Filling::Irregular) + blocks + tables(summary, "irregular")
        }),
        Case {
            is_whole: false,
            ..case("arc samples", triangle.clone(), irregular.clone(), "samples of 3 arcs among 3", |_, summary| {
                let in_pages: u64 = summary.levels.iter().map(|level| level.arc_bytes + level.arc_stream_count).sum();
                summary.sample_count + in_pages + tables(summary, "arc samples")
            })
        },
        case("arcs and corners", tetrahedron.clone(), triangle.clone(), "arcs and corners", |file, summary| {
            let tables = tables(summary, "corners") + tables(summary, "arcs of the index");
            u64::from(file.index().arc_count() + file.index().corner_count()) + summary.index_arc_bytes + tables
        }),
        Case {
            is_whole: false,
            ..case("more levels than one", triangle.clone(), irregular.clone(), "levels coarser", |_, summary| {
                // A level of 40 bytes, and a filling of 4 with the steps of a level in 2.
                section(summary, "levels") - (8 + 40 + 4 + 2)
            })
        },
        Case {
            is_whole: false,
            ..case(
                "levels of as many triangles",
                tetrahedron.clone(),
                irregular.clone(),
                "levels coarser",
                |_, summary| // A level of 40 bytes, and a filling of 4 with the steps of a level in 2.
                section(summary, "levels") - (8 + 40 + 4 + 2),
            )
        },
        Case {
            is_whole: false,
            ..case(
                "blocks beyond a coarser one that is as good",
                // Where parts do not share roots.
                built(&with_flat_piece, Fillings::Smaller, 1 << 20),
                // One chart has all levels by itself.
                built(&sphere, Fillings::IrregularOnly, 1 << 20),
                "1 block of level",
                fewest_finer_blocks,
            )
        },
        case("closed pieces", hills.clone(), tetrahedron, "1 of 1 for closed pieces", |_, summary| {
            summary.closed_roots + tables(summary, "closed pieces")
        }),
        case("holes", hills, plain(&punched_sheet(32)), "2 of 2 for holes and handles", |_, summary| {
            tables(summary, "holes and handles")
        }),
    ]
}

/// The output of `info --why --json` for a file.
fn why(path: &str) -> Value {
    let out = lodpack().args(["info", "--why", "--json", path]).assert().success();
    serde_json::from_slice(&out.get_output().stdout).expect("JSON")
}

fn saved_as(bytes: &[u8], dir: &Path) -> String {
    let path = dir.join("scene.lodpack");
    std::fs::write(&path, bytes).expect("writable");
    path.to_str().expect("test paths are UTF-8").into()
}

/// The names of everything left out, and its reasons with their counts.
fn left_out(info: &Value) -> Vec<String> {
    let mut names = vec![];
    for item in info["left_out"].as_array().expect("a list") {
        names.push(item["what"].as_str().expect("a name").to_string());
        assert!(item["why"].as_str().is_some_and(|why| why.len() > 10), "{item} has no reason");
        assert!(item["saved"]["how"].is_string() && item["saved"]["known"].is_string(), "{item}");
        for reason in item["reasons"].as_array().into_iter().flatten() {
            names.push(format!("{} {}", reason["count"], reason["why"].as_str().expect("a reason")));
        }
    }
    names
}

#[test]
fn a_scene_without_a_feature_has_no_byte_for_it_and_info_says_so() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    for Case { what, without, with, amount, name, is_whole } in cases() {
        let measured = |bytes: &[u8]| {
            let file = open(bytes);
            file.verify().expect("sound");
            amount(&File::open(bytes, Default::default()).expect("sound"), &file.summary().expect("sound"))
        };
        assert_eq!(measured(&without), 0, "{what}: the scene needs none");
        assert!(measured(&with) > 0, "{what}: the scene needs some");
        let names = |bytes: &[u8]| left_out(&why(&saved_as(bytes, dir.path())));
        let is_named = |names: &[String]| names.iter().any(|found| found.starts_with(name));
        assert!(is_named(&names(&without)), "{what}: {:#?}", names(&without));
        assert!(!is_whole || !is_named(&names(&with)), "{what}: {:#?}", names(&with));
        for bytes in [&without, &with] {
            let info = why(&saved_as(bytes, dir.path()));
            let there = info["there"].as_array().expect("a list");
            let sum: u64 = there.iter().map(|item| item["bytes"].as_u64().expect("a number")).sum();
            assert_eq!(sum, bytes.len() as u64, "{what}: {there:#?}");
            // Except for the pages of a scene without any, everything listed takes bytes.
            assert!(there.iter().all(|item| item["bytes"] != 0 && item["why"].is_string()), "{what}: {there:#?}");
        }
    }
}

#[test]
fn normals_and_texture_coordinates_of_the_input_leave_no_byte() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let [plain, rich] = ["plain", "rich"].map(|name| dir.path().join(name).with_extension("obj"));
    let positions = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let faces = [[1, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]];
    let face = |write: fn(i32) -> String| faces.map(|f| format!("f {}\n", f.map(write).join(" "))).concat();
    std::fs::write(&plain, format!("{positions}{}", face(|v| v.to_string()))).expect("writable");
    let attributes = "vn 0 0 1\nvn 1 0 0\nvn 0 1 0\nvn 0 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n";
    std::fs::write(&rich, format!("{positions}{attributes}{}", face(|v| format!("{v}/{v}/{v}")))).expect("writable");
    let [plain, rich] = [plain, rich].map(|mesh| {
        let file = mesh.with_extension("lodpack");
        lodpack().arg("build").arg(&mesh).arg("-o").arg(&file).assert().success();
        std::fs::read(file).expect("written")
    });
    assert!(plain == rich);
    let names = left_out(&why(&saved_as(&rich, dir.path())));
    assert!(names.iter().any(|name| name.contains("normals")), "{names:?}");
}

#[test]
fn the_account_is_the_same_over_http_and_reads_no_page() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let bytes = built(&bumpy_sphere(40), Fillings::IrregularOnly, 512);
    let pages = section(&open(&bytes).summary().expect("sound"), "pages");
    let path = saved_as(&bytes, dir.path());
    let here = why(&path);
    assert_eq!(here, why(&format!("{}/scene.lodpack", serve(bytes.clone()).expect("a free port"))));
    // The first request reads 12 KiB, whatever is there.
    assert!(
        here["bytes_read"].as_u64().is_some_and(|read| read <= (bytes.len() as u64 - pages).max(12 << 10)),
        "{here}"
    );
    let plain = lodpack().args(["info", "--json", &path]).assert().success();
    let plain: Value = serde_json::from_slice(&plain.get_output().stdout).expect("JSON");
    assert!(plain["there"].is_null() && plain["left_out"] == here["left_out"]);
    assert_eq!(plain["requests"], here["requests"]);

    let out = lodpack().args(["info", "--why", &path]).assert().success();
    let text = String::from_utf8_lossy(&out.get_output().stdout).into_owned();
    assert!(text.contains("exactly the size of the file") && !text.contains("defect"), "{text}");
}
