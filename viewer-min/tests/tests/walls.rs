//! Walls of displays, each a process of its own.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, ChildStderr, Command, Output, Stdio},
};

use lodpack_view::picture::{different_colours, load};

use crate::{Model, folder, has_gpu, program};

const PATH: &str = "circle:24";
const SIZE: &str = "256x192";
/// Where a display splits a group that it sees a part of, the wall is finer than the whole picture: not at this one.
const TOLERANCE: &str = "0.25";
/// Share of the pixels that may differ, by more than so many of 255 levels.
const DIFFERENCE: f64 = 0.001;
const ROUNDING: u8 = 2;

fn start(arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodpack-view"));
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// A controller, and the address at which it listens.
struct Wall {
    controller: Child,
    said: BufReader<ChildStderr>,
    address: String,
}

impl Wall {
    fn new(file: &str, arguments: &[&str]) -> Self {
        let wall = [
            "--wall",
            "2x2",
            "--listen",
            "127.0.0.1:0",
            "--wait",
            "--size",
            SIZE,
            "--tolerance",
            TOLERANCE,
            "--csv",
            "-",
        ];
        let mut controller = start(&[&[file][..], &wall, arguments].concat());
        let mut said = BufReader::new(controller.stderr.take().unwrap());
        let mut line = String::new();
        said.read_line(&mut line).unwrap();
        let address = line.rsplit(' ').next().unwrap().trim().to_string();
        Self { controller, said, address }
    }

    fn join(&self, file: &str, place: [u32; 2], pictures: &Path) -> Child {
        let name = pictures.join(format!("{}-{}-{{n}}.png", place[0], place[1]));
        let place = format!("{},{}", place[0], place[1]);
        let name = name.to_str().unwrap();
        start(&[file, "--join", &self.address, "--place", &place, "--wait", "--screenshot", name])
    }

    /// What it says next.
    fn line(&mut self) -> String {
        let mut line = String::new();
        assert!(self.said.read_line(&mut line).unwrap() > 0, "the controller has ended");
        line
    }

    /// The rest of what it says, and its table.
    fn finish(mut self) -> (Output, String) {
        let mut rest = String::new();
        self.said.read_to_string(&mut rest).unwrap();
        (self.controller.wait_with_output().unwrap(), rest)
    }
}

const PLACES: [[u32; 2]; 4] = [[0, 0], [1, 0], [0, 1], [1, 1]];

/// Compares what a display has shown with its part of the whole pictures. Returns how many frames it has shown.
fn check(folder: &Path, place: [u32; 2]) -> usize {
    let mut shown = 0;
    for frame in 1..=24 {
        let Ok(part) = load(&folder.join(format!("{}-{}-{frame:05}.png", place[0], place[1]))) else { continue };
        let whole = load(&folder.join(format!("whole-{frame:05}.png"))).unwrap();
        let (width, height) = part.dimensions();
        let at = [place[0] * width, place[1] * height];
        let own = image::imageops::crop_imm(&whole, at[0], at[1], width, height).to_image();
        let different = different_colours(&part, &own, ROUNDING).len() as f64;
        assert!(different <= DIFFERENCE * f64::from(width * height), "{place:?}, frame {frame}: {different} pixels");
        shown += 1;
    }
    shown
}

fn draw_whole(file: &str, folder: &Path) {
    let name = folder.join("whole-{n}.png");
    let name = name.to_str().unwrap();
    let whole =
        program(&[file, "--path", PATH, "--wait", "--size", SIZE, "--tolerance", TOLERANCE, "--screenshot", name]);
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
}

#[test]
fn four_displays_show_the_whole_picture() {
    if !has_gpu() {
        return;
    }
    let (folder, file) = (folder("wall"), Model::sphere_path());
    let file = file.to_str().unwrap();
    draw_whole(file, &folder);
    let wall = Wall::new(file, &["--path", PATH]);
    let displays = PLACES.map(|place| wall.join(file, place, &folder));
    for display in displays {
        let output = display.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let (output, _) = wall.finish();
    assert!(output.status.success());
    PLACES.iter().for_each(|&place| assert_eq!(check(&folder, place), 24));
    let table = String::from_utf8(output.stdout).unwrap();
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let frames: Vec<_> = lines.collect();
    let column = |name: &str| names.iter().position(|other| *other == name).unwrap();
    assert!(frames.len() == 24 && frames.iter().all(|frame| frame[column("displays")] == "4"), "{table}");
}

#[test]
fn a_display_that_dies_leaves_the_others_and_comes_back() {
    if !has_gpu() {
        return;
    }
    let (folder, file) = (folder("wall-killed"), Model::sphere_path());
    let file = file.to_str().unwrap();
    draw_whole(file, &folder);
    let mut wall = Wall::new(file, &["--path", PATH]);
    let mut displays = PLACES.map(|place| wall.join(file, place, &folder));
    while !folder.join("1-1-00003.png").exists() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    displays[3].kill().unwrap();
    while !wall.line().contains("has left") {}
    displays[3].wait().unwrap();
    // It may be too late to see much.
    displays[3] = wall.join(file, PLACES[3], &folder);
    let (output, _) = wall.finish();
    assert!(output.status.success());
    for mut display in displays {
        display.wait().unwrap();
    }
    PLACES[..3].iter().for_each(|&place| assert_eq!(check(&folder, place), 24));
    assert!((3..24).contains(&check(&folder, PLACES[3])));
}

/// What a program says that cannot join a wall.
fn refusal(child: Child) -> String {
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn walls_refuse_what_does_not_belong_to_them() {
    if !has_gpu() {
        return;
    }
    let (folder, file) = (folder("wall-refuses"), Model::sphere_path());
    let file = file.to_str().unwrap();
    let mut wall = Wall::new(file, &["--path", "circle:2"]);
    let first = wall.join(file, [0, 0], &folder);
    assert!(wall.line().contains("0,0 has joined"));
    // Half-open connections keep nobody from joining.
    let _silent: Vec<TcpStream> = (0..8).map(|_| TcpStream::connect(&wall.address).unwrap()).collect();
    assert!(refusal(wall.join(file, [0, 0], &folder)).contains("there is a display 0,0 already"));
    assert!(refusal(wall.join(file, [2, 0], &folder)).contains("there is no display 2,0"));
    let other = concat!(env!("CARGO_MANIFEST_DIR"), "/../format-spec/vectors/tree.lodpack");
    assert!(refusal(wall.join(other, [1, 0], &folder)).contains("another file"));
    let hello = |text: &str| {
        let mut stream = TcpStream::connect(&wall.address).unwrap();
        stream.write_all(text.as_bytes()).unwrap();
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer
    };
    let old = r#"{"hello":{"protocol":1,"version":"0.0.1","file":[0,0],"place":null}}"#;
    assert!(hello(&format!("{old}\n")).contains("the display 0.0.1"));
    assert_eq!(hello("GET / HTTP/1.1\r\n\r\n"), "");
    let others = [1, 2, 3].map(|k| wall.join(file, PLACES[k], &folder));
    assert!(wall.finish().0.status.success());
    [first].into_iter().chain(others).for_each(|mut display| assert!(display.wait().unwrap().success()));
    let nowhere = start(&[file, "--join", "127.0.0.1:9", "--wait", "--screenshot", "nowhere.png"]);
    assert!(refusal(nowhere).contains("there is no wall at 127.0.0.1:9"));
}

/// Controllers that say what makes no sense.
#[test]
fn displays_of_a_controller_that_lies_end_with_an_error() {
    if !has_gpu() {
        return;
    }
    let file = Model::sphere_path();
    let camera = r#""camera":{"position":[9,0,0],"forward":[-1,0,0],"up":[0,0,1],"vertical_fov":1.0,"near":0.1,
        "viewport":[64,64],"window":[[0,0],[1,1]],"pixel_tolerance":1.0}"#;
    let camera = camera.replace('\n', "");
    let draw = |nodes: &str| format!(r#"{{"draw":{{"number":1,{camera},"is_first":true,"nodes":{nodes}}}}}"#);
    let (beyond, whole) = (draw("[[4000000,0]]"), draw("[]"));
    let flat = whole.replace("[-1,0,0]", "[0,0,0]");
    for (lie, said) in [
        (beyond.as_str(), "4000000"),
        (flat.as_str(), "view"),
        ("{}", "no message of a wall"),
        (r#"{"welcome":{"place":[0,0],"size":[1,1]}}"#, "says the same twice"),
        ("", "the controller has gone"),
    ] {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let display = start(&[file.to_str().unwrap(), "--join", &address, "--wait", "--screenshot", "nowhere.png"]);
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"{\"welcome\":{\"place\":[0,0],\"size\":[64,64]}}\n").unwrap();
        if lie.is_empty() {
            BufReader::new(&stream).read_line(&mut String::new()).unwrap();
        } else {
            stream.write_all(format!("{lie}\n").as_bytes()).unwrap();
        }
        let _ = stream.shutdown(std::net::Shutdown::Write);
        let text = refusal(display);
        assert!(text.contains(said) && !text.contains("panicked"), "{lie}: {text}");
    }
}
