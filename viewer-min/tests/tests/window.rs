//! The window under Xvfb.

use std::{
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use image::RgbaImage;
use lodpack_view::picture::{different_colours, load};

use crate::{Model, folder, has_gpu, skip};

/// Servers that start while others stop get in each other's way.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// A display without a screen; stops when dropped.
struct Display {
    server: Child,
    name: String,
    _turn: MutexGuard<'static, ()>,
}

impl Display {
    /// Without -noreset it would restart whenever xdotool, for a moment its only client, exits.
    fn new() -> Option<Self> {
        let turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut line = String::new();
        std::io::BufRead::read_line(&mut std::io::BufReader::new(server.stdout.take()?), &mut line).ok()?;
        Some(Self { server, name: format!(":{}", line.trim()), _turn: turn })
    }

    fn xdotool(&self, arguments: &[&str]) -> Option<String> {
        let output = Command::new("xdotool").args(arguments).env("DISPLAY", &self.name).output().ok()?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string())
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // When asked to exit, it removes its lock.
        let _ = Command::new("kill").arg(self.server.id().to_string()).status();
        let _ = self.server.wait();
    }
}

fn wait_for(what: &str, mut is_there: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_there() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no {what} after a minute");
        std::thread::sleep(Duration::from_millis(100));
    }
}

fn pictures(folder: &Path) -> Vec<std::path::PathBuf> {
    let files = std::fs::read_dir(folder).unwrap().filter_map(|entry| Some(entry.ok()?.path()));
    let mut found: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "png")).collect();
    found.sort();
    found
}

/// A window on its own display.
struct Viewer {
    display: Display,
    process: Child,
    folder: PathBuf,
    window: String,
}

impl Viewer {
    /// None if there is no adapter or no display.
    fn open(name: &str, file: &str, arguments: &[&str]) -> Option<Self> {
        if !has_gpu() {
            return None;
        }
        let display = Display::new().filter(|display| display.xdotool(&["version"]).is_some());
        let Some(display) = display else {
            skip("Xvfb and xdotool");
            return None;
        };
        let folder = folder(name);
        let process = Command::new(env!("CARGO_BIN_EXE_lodpack-view"))
            .args([file, "--size", "320x240"])
            .args(arguments)
            .current_dir(&folder)
            .env("DISPLAY", &display.name)
            .env("XDG_STATE_HOME", &folder)
            .env_remove("WAYLAND_DISPLAY")
            .stderr(std::fs::File::create(folder.join("stderr")).unwrap())
            .spawn()
            .unwrap();
        let mut viewer = Self { display, process, folder, window: String::new() };
        wait_for("window", || {
            let found = viewer.display.xdotool(&["search", "--name", "lodpack-view"]).unwrap_or_default();
            viewer.window = found.lines().last().unwrap_or_default().to_string();
            !viewer.window.is_empty()
        });
        viewer.display.xdotool(&["windowfocus", &viewer.window]);
        Some(viewer)
    }

    fn key(&self, key: &str) {
        self.display.xdotool(&["key", key]);
    }

    /// Presses keys, then takes a picture with a key. The first keys may come before the window accepts any.
    fn picture(&self, keys: &[&str]) -> RgbaImage {
        keys.iter().for_each(|key| self.key(key));
        std::thread::sleep(Duration::from_millis(500));
        let count = pictures(&self.folder).len();
        wait_for("picture", || {
            self.key("x");
            std::thread::sleep(Duration::from_millis(1500));
            pictures(&self.folder).len() > count
        });
        load(pictures(&self.folder).last().unwrap()).unwrap()
    }

    fn says(&self) -> String {
        std::fs::read_to_string(self.folder.join("stderr")).unwrap()
    }

    fn close(mut self) {
        self.key("Escape");
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.process.try_wait().unwrap() {
                break status;
            }
            assert!(begun.elapsed() < Duration::from_secs(30), "the window does not close: {}", self.says());
            std::thread::sleep(Duration::from_millis(50));
        };
        assert!(status.success(), "{status}: {}", self.says());
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn colour_count(picture: &RgbaImage) -> usize {
    picture.pixels().collect::<std::collections::HashSet<_>>().len()
}

#[test]
fn the_window_opens_takes_keys_draws_and_closes() {
    let Some(viewer) = Viewer::open("window", Model::sphere_path().to_str().unwrap(), &[]) else { return };
    let plain = viewer.picture(&["o"]);
    assert!(colour_count(&plain) > 30, "something is drawn");
    let nodes = viewer.picture(&["2"]);
    assert!(different_colours(&plain, &nodes, 0).len() > plain.pixels().len() / 20, "a key changes the colours");
    viewer.display.xdotool(&["windowsize", &viewer.window, "200", "280"]);
    wait_for("new size", || viewer.picture(&["1", "v"]).dimensions() == (200, 280));
    viewer.display.xdotool(&["windowsize", &viewer.window, "1", "1"]);
    std::thread::sleep(Duration::from_millis(500));
    viewer.display.xdotool(&["windowsize", &viewer.window, "240", "160"]);
    wait_for("picture after it was almost nothing", || viewer.picture(&[]).dimensions() == (240, 160));
    let remembered = viewer.folder.join("lodpack-view");
    viewer.close();
    assert_eq!(std::fs::read_dir(remembered).unwrap().count(), 1, "the camera is remembered");
}

#[test]
fn a_lost_device_is_recreated() {
    let Some(viewer) = Viewer::open("lost", Model::sphere_path().to_str().unwrap(), &["--lose-device", "3"]) else {
        return;
    };
    assert!(colour_count(&viewer.picture(&["o"])) > 30, "something is drawn");
    assert!(viewer.says().contains("starting again"), "{}", viewer.says());
    viewer.close();
}

#[test]
fn a_file_that_cannot_be_opened_is_reported_and_the_window_stays() {
    let Some(viewer) = Viewer::open("unopened", "/nowhere/x.lodpack", &[]) else { return };
    let ink = image::Rgba([24, 30, 42, 255]);
    wait_for("key card", || viewer.picture(&["h"]).pixels().any(|&pixel| pixel == ink));
    assert!(viewer.says().contains("/nowhere/x.lodpack"), "{}", viewer.says());
    viewer.close();
}

#[test]
fn damage_is_reported_and_the_sound_part_is_drawn() {
    let path = folder("damaged-file").join("damaged.lodpack");
    let mut bytes = Model::sphere().bytes.to_vec();
    let last = bytes.len() - 8;
    bytes[last] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let Some(viewer) = Viewer::open("damaged", path.to_str().unwrap(), &["--tolerance", "0.01"]) else { return };
    wait_for("message", || viewer.says().contains("Y reads it again"));
    let picture = viewer.picture(&["o"]);
    assert!(colour_count(&picture) > 30, "the surface is drawn");
    assert!(
        picture.pixels().any(|image::Rgba([r, g, b, _])| *r > 150 && *g < 60 && *b < 60),
        "the message is on the screen"
    );
    viewer.close();
}

#[test]
fn a_missing_file_is_reported_before_a_missing_display() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodpack-view"));
    let output = command.arg("nowhere.lodpack").env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(told.contains("nowhere.lodpack cannot be opened") && !told.contains("display"), "{told}");
}
