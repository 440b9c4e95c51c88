//! What keys and the mouse do.

use std::{collections::HashSet, path::PathBuf};

use glam::DVec3;
use lodpack::{Controls as Held, FrameTimes, PerformanceMode, PerformanceTarget};
use winit::{
    event::{ElementState, KeyEvent},
    keyboard::{Key, KeyCode, NamedKey, PhysicalKey},
};

use crate::{
    args::Args,
    camera::Camera,
    draw::{Colouring, Style, Way, middle_of},
    scene::{Budget, Scene},
    window::way_for,
};

/// What a key asks of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Close it.
    Close,
    /// Write a picture.
    Screenshot,
    /// Begin or end recording a path.
    Record,
    /// Go where the camera was the last time, and remember where it is.
    RecentCamera,
    /// See everything.
    WholeModel,
    /// Read again what could not be read.
    Retry,
    /// Keep the cut while the camera moves, or let it go.
    Freeze,
}

/// What keys have set.
pub struct Controls {
    /// How it is drawn.
    pub style: Style,
    /// Whether counters are shown.
    pub has_panel: bool,
    /// Whether the key card is shown.
    pub has_card: bool,
    /// The camera that the cut is for, if that is frozen.
    pub frozen: Option<Camera>,
    /// While a button is down: whether it orbits or looks around.
    pub dragging: Option<bool>,
    chosen: Way,
    budget: Budget,
    performance: Option<PerformanceMode>,
    wants_speed: bool,
    held: HashSet<KeyCode>,
    pointer: Option<[f64; 2]>,
}

const FLYING: [KeyCode; 6] = [KeyCode::KeyW, KeyCode::KeyA, KeyCode::KeyS, KeyCode::KeyD, KeyCode::KeyQ, KeyCode::KeyE];
/// Radians per pixel of a drag.
const TURN: f64 = 0.006;

impl Controls {
    /// As typed.
    pub fn new(args: &Args, budget: Budget) -> Self {
        let (style, has_text) = args.style();
        Self {
            style,
            has_panel: has_text,
            has_card: false,
            frozen: None,
            dragging: None,
            chosen: args.draw,
            budget,
            performance: None,
            wants_speed: false,
            held: HashSet::new(),
            pointer: None,
        }
    }

    /// A new file is there.
    pub fn forget_view(&mut self) {
        (self.frozen, self.performance) = (None, None);
    }

    /// How roots are drawn.
    pub fn way(&self) -> Way {
        way_for(self.style, self.chosen)
    }

    /// Whether the camera moves by itself.
    pub fn is_moving(&self) -> bool {
        !self.held.is_empty() || self.dragging.is_some()
    }

    /// The budgets for the next frame.
    pub fn budget(&mut self, root_count: usize) -> Budget {
        if !self.wants_speed {
            self.performance = None;
            return self.budget;
        }
        let most = root_count.max(1) as u64;
        let target = PerformanceTarget { frame_time: 1000.0 / 30.0, adapt_time: 1000.0 / 120.0, ..Default::default() };
        let start = Held { tolerance: self.budget.tolerance_px.clamp(0.1, 64.0), max_nodes: most };
        if self.performance.is_none() {
            self.performance = PerformanceMode::new(target, start, [0.1, 64.0], [1, most]).ok();
        }
        let held = self.performance.as_ref().map_or(start, PerformanceMode::controls);
        Budget { tolerance_px: held.tolerance, max_nodes: Some(held.max_nodes), ..self.budget }
    }

    /// Notes what a frame took, milliseconds.
    pub fn record(&mut self, times: FrameTimes) {
        self.performance.iter_mut().for_each(|mode| {
            mode.record(times);
        });
    }

    /// A key goes down or up.
    pub fn key(&mut self, event: &KeyEvent) -> Option<Order> {
        if let PhysicalKey::Code(code) = event.physical_key
            && FLYING.contains(&code)
        {
            match event.state {
                ElementState::Pressed => self.held.insert(code),
                ElementState::Released => self.held.remove(&code),
            };
            return None;
        }
        if event.state == ElementState::Released || event.repeat {
            return None;
        }
        match &event.logical_key {
            Key::Named(NamedKey::Escape) => Some(Order::Close),
            Key::Character(text) => self.letter(&text.to_lowercase()),
            _ => None,
        }
    }

    fn letter(&mut self, text: &str) -> Option<Order> {
        let budget = &mut self.budget;
        let scaled = |limit: Option<u64>, start: u64, up: bool| {
            let limit = limit.unwrap_or(start);
            // A budget that is doubled often enough is none.
            if up { limit.checked_mul(2).filter(|&limit| limit < 1 << 40) } else { Some((limit / 2).max(1)) }
        };
        match text {
            "+" | "=" => budget.tolerance_px = (budget.tolerance_px / 2.0).max(1.0 / 64.0),
            "-" => budget.tolerance_px = (budget.tolerance_px * 2.0).min(512.0),
            "t" | "u" => budget.max_triangles = scaled(budget.max_triangles, 1 << 20, text == "t"),
            "n" | "m" => budget.max_nodes = scaled(budget.max_nodes, 1 << 12, text == "n"),
            "p" => self.wants_speed = !self.wants_speed,
            "1" => self.style.colouring = Colouring::Plain,
            "2" => self.style.colouring = Colouring::Nodes,
            "3" => self.style.colouring = Colouring::Levels,
            "4" => self.style.colouring = Colouring::Errors,
            "l" => self.style.wireframe = !self.style.wireframe,
            "b" => self.style.seams = !self.style.seams,
            "v" => self.chosen = if self.chosen == Way::Pulled { Way::Stitched } else { Way::Pulled },
            "i" => self.has_panel = !self.has_panel,
            "h" => self.has_card = !self.has_card,
            "f" => return Some(Order::Freeze),
            "x" => return Some(Order::Screenshot),
            "r" => return Some(Order::Record),
            "c" => return Some(Order::RecentCamera),
            "o" => return Some(Order::WholeModel),
            "y" => return Some(Order::Retry),
            _ => (),
        }
        None
    }

    /// Flies, as long as keys are held: a second for the distance to the middle.
    pub fn advance(&self, camera: &mut Camera, bounds: [[f64; 3]; 2], seconds: f64) {
        let (middle, radius) = middle_of(bounds);
        let speed = (camera.position - middle).length().max(radius * 0.05) * seconds;
        let axis = |plus: KeyCode, minus: KeyCode| {
            f64::from(u8::from(self.held.contains(&plus))) - f64::from(u8::from(self.held.contains(&minus)))
        };
        let by = DVec3::new(
            axis(KeyCode::KeyD, KeyCode::KeyA),
            axis(KeyCode::KeyE, KeyCode::KeyQ),
            axis(KeyCode::KeyW, KeyCode::KeyS),
        );
        camera.shift(by * speed);
    }

    /// The pointer is at a place.
    pub fn pointer(&mut self, at: [f64; 2], camera: Option<&mut Camera>, scene: Option<&Scene>) {
        let before = self.pointer.replace(at);
        let (Some(before), Some(orbits), Some(camera), Some(scene)) = (before, self.dragging, camera, scene) else {
            return;
        };
        let turn = [0, 1].map(|k| (before[k] - at[k]) * TURN);
        if orbits {
            camera.orbit(middle_of(scene.bounds).0, turn[0], turn[1]);
        } else {
            let position = camera.position;
            camera.orbit(position, turn[0], turn[1]);
        }
    }

    /// The wheel turns: an eighth nearer to the middle per step.
    pub fn wheel(&mut self, steps: f64, camera: Option<&mut Camera>, scene: Option<&Scene>) {
        if let (Some(camera), Some(scene)) = (camera, scene) {
            let (middle, radius) = middle_of(scene.bounds);
            let away = (camera.position - middle).length().max(radius * 0.02);
            camera.shift(DVec3::Z * away * (1.0 - 0.875_f64.powf(steps.clamp(-8.0, 8.0))));
        }
    }
}

/// Where cameras are remembered, by file.
fn cameras_path() -> Option<PathBuf> {
    let state = std::env::var_os("XDG_STATE_HOME").map(PathBuf::from);
    let state = state.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".local/state")))?;
    Some(state.join("lodpack-view/cameras.json"))
}

fn cameras() -> serde_json::Value {
    let text = cameras_path().and_then(|path| std::fs::read_to_string(path).ok());
    text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_else(|| serde_json::json!({}))
}

/// The camera that a file was last looked at with.
pub fn recent_camera(place: &str, now: Option<&Camera>) -> Option<Camera> {
    Camera::parse(cameras()[place].as_str()?, now?).ok()
}

/// Remembers a camera. A convenience: if it cannot be written nothing is said.
pub fn remember_camera(place: &str, camera: &Camera) {
    let (mut cameras, Some(path)) = (cameras(), cameras_path()) else { return };
    if place.is_empty() || !cameras.is_object() {
        return;
    }
    cameras[place] = camera.text().into();
    let _ = path.parent().map(std::fs::create_dir_all);
    let _ = std::fs::write(path, cameras.to_string());
}
