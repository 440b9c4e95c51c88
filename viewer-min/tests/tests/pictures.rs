//! The program without a window.

use lodpack_view::picture::{BACKGROUND, different_colours, load};

use crate::{Model, folder, has_gpu, program};

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn both_ways_draw_the_same_picture_in_the_middle_of_the_background() {
    if !has_gpu() {
        return;
    }
    let (path, folder) = (Model::sphere_path(), folder("ways"));
    let picture_of = |way: &str, more: &[&str]| {
        let out = folder.join(format!("{way}.png"));
        let arguments =
            [path.to_str().unwrap(), "--screenshot", out.to_str().unwrap(), "--size", "321x200", "--draw", way];
        let output = program(&[&arguments, more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        load(&out).unwrap()
    };
    let [smooth, flat] = [&[][..], &["--flat"]].map(|more| {
        let pictures = ["stitched", "pulled"].map(|way| picture_of(way, more));
        assert_eq!(pictures[0], pictures[1]);
        let [picture, _] = pictures;
        picture
    });
    // Squares of steps from pixel to pixel within the sphere: edges of triangles are seen where these are flat.
    let roughness = |picture: &image::RgbaImage| {
        let steps = (130..190).flat_map(|x| (70..130).map(move |y| (x, y)));
        steps
            .map(|(x, y)| i32::from(picture[(x, y)][0]) - i32::from(picture[(x + 1, y)][0]))
            .map(|d| d * d)
            .sum::<i32>()
    };
    assert!(2 * roughness(&smooth) < roughness(&flat), "{} and {}", roughness(&smooth), roughness(&flat));
    let picture = &smooth;
    let covered = picture.pixels().filter(|&&colour| colour != BACKGROUND).count();
    assert!((0.1..0.9).contains(&(covered as f64 / picture.pixels().len() as f64)), "{covered}");
    assert_eq!((picture.dimensions(), picture[(0, 0)]), ((321, 200), BACKGROUND));
    assert_ne!(picture[(160, 100)], BACKGROUND);
}

#[test]
fn tiles_join_to_the_picture() {
    if !has_gpu() {
        return;
    }
    let (path, folder) = (Model::sphere_path(), folder("tiles"));
    let out = folder.join("joined.png");
    // A tile may split a group that it sees a part of, so that at coarser tolerances tiles are finer than the whole
    // picture.
    for (tiles, tolerance) in [("2x2", "1"), ("4x2", "0.5")] {
        let arguments = [
            path.to_str().unwrap(),
            "--screenshot",
            out.to_str().unwrap(),
            "--size",
            "400x320",
            "--tiles",
            tiles,
            "--tolerance",
            tolerance,
        ];
        let output = program(&arguments);
        println!("{tiles}: {}", text(&output.stdout));
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    let output = program(&[path.to_str().unwrap(), "--tile", "0,0/3x2", "--screenshot", out.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
}

#[test]
fn every_frame_of_a_path_has_a_surface() {
    if !has_gpu() {
        return;
    }
    let path = Model::sphere_path();
    for wait in [None, Some("--wait")] {
        let mut arguments = vec![path.to_str().unwrap(), "--path", "circle:40", "--csv", "-", "--size", "160x120"];
        arguments.extend(wait);
        let output = program(&arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let table = text(&output.stdout);
        let rows: Vec<Vec<f64>> =
            table.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), 40);
        let column = |name: &str| table.lines().next().unwrap().split(',').position(|head| head == name).unwrap();
        for row in rows {
            assert_eq!(row[column("surface")], 1.0, "{row:?}");
            if wait.is_some() {
                assert_eq!(row[column("late")], 0.0, "{row:?}");
            }
        }
    }
}

#[test]
fn two_devices_draw_what_one_does_and_a_model_holds_a_frame_rate() {
    if !has_gpu() {
        return;
    }
    let (path, folder) = (Model::sphere_path(), folder("devices"));
    // The model is in the left half.
    let camera = "0,0,4:1.5,0,0:0,1,0:50";
    let picture_of = |name: &str, more: &[&str]| {
        let out = folder.join(name);
        let arguments = [path.to_str().unwrap(), "--size", "320x200", "--camera", camera, "--screenshot"];
        let output = program(&[&arguments[..], &[out.to_str().unwrap()], more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        load(&out).unwrap()
    };
    let one = picture_of("one.png", &[]);
    for more in [&["--devices", "2"][..], &["--devices", "3"], &["--devices", "2", "--cuts", "equal"]] {
        let several = picture_of("several.png", more);
        let different = different_colours(&one, &several, 2).len();
        assert!(different <= 64, "{more:?}: {different} pixels");
    }
    let held = ["--path", "circle:60", "--frame-rate", "20", "--csv", "-", "--size", "160x120"];
    let output = program(&[&[path.to_str().unwrap()][..], &held].concat());
    assert!(output.status.success() && text(&output.stderr).contains("frames take"), "{}", text(&output.stderr));
}

#[test]
fn a_picture_that_stays_uploads_nothing_and_what_comes_back_little() {
    if !has_gpu() {
        return;
    }
    let (path, folder) = (Model::sphere_path(), folder("uploads"));
    let (near, far) = ("0,0,3:0,0,0", "0,0,60:0,0,0");
    let cameras = folder.join("cameras.json");
    std::fs::write(&cameras, format!("{:?}", [near, near, far, near])).unwrap();
    let (path, cameras) = (path.to_str().unwrap(), cameras.to_str().unwrap());
    let output = program(&[path, "--path", cameras, "--wait", "--csv", "-", "--size", "320x240"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    let column = table.lines().next().unwrap().split(',').position(|name| name == "uploaded").unwrap();
    let uploaded: Vec<u64> =
        table.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
    assert!(uploaded[1] == 0 && uploaded[3] * 2 < uploaded[0], "{uploaded:?}");
}

#[test]
fn failures_exit_with_2_and_one_sentence() {
    let folder = folder("wrong");
    let broken = folder.join("broken.lodpack");
    std::fs::write(&broken, b"this is not a lodpack file, though it has some bytes to look at").unwrap();
    let (broken, out) = (broken.to_str().unwrap(), folder.join("x.png"));
    let out = out.to_str().unwrap();
    let cases: [&[&str]; 6] = [
        &["/nowhere/x.lodpack", "--screenshot", out],
        &[broken, "--screenshot", out],
        &["--screenshot", out],
        &["--check"],
        &["/nowhere/x.lodpack", "--check"],
        &[broken, "--check", "--against", "/nowhere/x.ply"],
    ];
    for arguments in cases {
        let output = program(arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(error.contains("lodpack-view: "), "{error}");
    }
    assert_eq!(program(&["--size", "0x3"]).status.code(), Some(2));
}

#[test]
fn the_program_checks_a_file_against_a_mesh() {
    if !has_gpu() {
        return;
    }
    let (path, folder) = (Model::sphere_path(), folder("check"));
    let mesh = folder.join("mesh.ply");
    lodpack_tests::generate::save_ply(&lodpack_tests::generate::bumpy_sphere(58), &mesh).unwrap();
    let difference = folder.to_str().unwrap();
    let arguments = |mesh: &str| {
        let typed = [path.to_str().unwrap(), "--check", "--against", mesh, "--views", "4", "--difference", difference];
        program(&typed)
    };
    let output = arguments(mesh.to_str().unwrap());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
    // Against another mesh it fails and says where.
    lodpack_tests::generate::save_ply(&lodpack_tests::generate::bumpy_sphere(4), &mesh).unwrap();
    let output = arguments(mesh.to_str().unwrap());
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(folder.join("difference-error.png").exists());
}

#[test]
fn a_file_on_a_server_looks_like_the_file_on_disk() {
    if !has_gpu() {
        return;
    }
    let folder = folder("server");
    let address = lodpack_tests::server::serve(Model::sphere().bytes.to_vec()).unwrap();
    let places = [Model::sphere_path().to_str().unwrap().to_string(), format!("{address}/sphere.lodpack")];
    let pictures = places.map(|place| {
        let out = folder.join("picture.png");
        let output = program(&[&place, "--screenshot", out.to_str().unwrap(), "--size", "200x160"]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        load(&out).unwrap()
    });
    assert_eq!(pictures[0], pictures[1]);
    let output = program(&["http://127.0.0.1:9/x.lodpack", "--screenshot", folder.join("x.png").to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
}
