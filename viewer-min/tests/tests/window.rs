//! The window under Xvfb.

use std::{
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use lodpack_view::picture::Picture;

use crate::{Model, folder, has_gpu, skip};

/// A display without a screen; ends when dropped.
struct Display {
    server: Child,
    name: String,
}

impl Display {
    fn new() -> Option<Self> {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut line = String::new();
        std::io::BufRead::read_line(&mut std::io::BufReader::new(server.stdout.take()?), &mut line).ok()?;
        Some(Self { server, name: format!(":{}", line.trim()) })
    }

    fn xdotool(&self, arguments: &[&str]) -> Option<String> {
        let output = Command::new("xdotool").args(arguments).env("DISPLAY", &self.name).output().ok()?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string())
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
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

#[test]
fn the_window_opens_takes_keys_draws_and_closes() {
    if !has_gpu() {
        return;
    }
    let Some(display) = Display::new() else {
        skip("Xvfb");
        return;
    };
    if display.xdotool(&["version"]).is_none() {
        skip("xdotool");
        return;
    }
    let folder = folder("window");
    let log = folder.join("stderr");
    let mut viewer = Command::new(env!("CARGO_BIN_EXE_lodpack-view"))
        .arg(Model::sphere_path())
        .args(["--size", "320x240"])
        .current_dir(&folder)
        .env("DISPLAY", &display.name)
        .env("XDG_STATE_HOME", &folder)
        .env_remove("WAYLAND_DISPLAY")
        .stderr(std::fs::File::create(&log).unwrap())
        .spawn()
        .unwrap();
    let mut window = String::new();
    wait_for("window", || {
        window = display.xdotool(&["search", "--name", "lodpack-view"]).unwrap_or_default();
        !window.is_empty()
    });
    let window = window.lines().last().unwrap().to_string();
    display.xdotool(&["windowfocus", &window]);
    let key = |key: &str| display.xdotool(&["key", key]);
    // The first keys may come before the file is open.
    let mut count = 0;
    let mut next_picture = |keys: &[&str]| {
        keys.iter().for_each(|k| {
            key(k);
        });
        std::thread::sleep(Duration::from_millis(500));
        key("x");
        wait_for("picture", || {
            if pictures(&folder).len() <= count {
                std::thread::sleep(Duration::from_secs(1));
                key("x");
            }
            pictures(&folder).len() > count
        });
        std::thread::sleep(Duration::from_millis(1500));
        count = pictures(&folder).len();
        Picture::load(&pictures(&folder)[count - 1]).unwrap()
    };
    let plain = next_picture(&["o"]);
    let colours: std::collections::HashSet<[u8; 3]> = plain.colours.iter().copied().collect();
    assert!(colours.len() > 30, "something is drawn: {} colours", colours.len());
    let nodes = next_picture(&["2"]);
    assert!(plain.different_colours(&nodes, 0).len() > plain.colours.len() / 20, "a key changes the colours");
    display.xdotool(&["windowsize", &window, "200", "280"]);
    wait_for("new size", || next_picture(&["1", "v"]).size == [200, 280]);
    key("Escape");
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = viewer.try_wait().unwrap() {
            break status;
        }
        if begun.elapsed() > Duration::from_secs(30) {
            viewer.kill().unwrap();
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(status.success(), "{status}: {}", std::fs::read_to_string(&log).unwrap());
    assert!(folder.join("lodpack-view/cameras.json").exists(), "the camera is remembered");
}
