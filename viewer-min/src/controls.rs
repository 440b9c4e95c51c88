//! Keys and the mouse.

use std::{collections::HashSet, path::PathBuf};

use glam::DVec3;
use lodpack::{
    View,
    select::{PerformanceGoal, PerformanceMode, PerformanceTarget},
};
use winit::{
    event::{ElementState, KeyEvent},
    keyboard::{Key, KeyCode, NamedKey, PhysicalKey},
};

use crate::{
    args::{Args, Overlay, Way},
    camera::{Bounds, middle_of, parse, text},
    report::Report,
    scene::Scene,
};

#[derive(Default)]
pub struct Controls {
    /// The command line, as changed by keys.
    pub args: Args,
    /// The camera for which the cut was made, if the cut is frozen.
    pub frozen: Option<View>,
    /// While a button is down: whether dragging orbits or looks around.
    pub dragging: Option<bool>,
    performance: Option<PerformanceMode>,
    held: HashSet<KeyCode>,
    pointer: Option<[f64; 2]>,
    /// Where the pointer was when a button went down.
    pressed: Option<[f64; 2]>,
}

/// The direction in which each key flies: right, up, forward.
const FLYING: [(KeyCode, DVec3); 6] = [
    (KeyCode::KeyW, DVec3::Z),
    (KeyCode::KeyS, DVec3::NEG_Z),
    (KeyCode::KeyD, DVec3::X),
    (KeyCode::KeyA, DVec3::NEG_X),
    (KeyCode::KeyE, DVec3::Y),
    (KeyCode::KeyQ, DVec3::NEG_Y),
];
/// The layers that keys show and hide. Of the first three, only one is shown at a time.
const TOGGLES: [(&str, Overlay); 8] = [
    ("2", Overlay::Nodes),
    ("3", Overlay::Levels),
    ("4", Overlay::Errors),
    ("5", Overlay::Depths),
    ("l", Overlay::Wire),
    ("b", Overlay::Borders),
    ("i", Overlay::Text),
    ("h", Overlay::Keys),
];
/// Keys that concern an object while one is selected.
const OF_OBJECTS: [&str; 2] = ["h", "i"];
/// Frames a second that performance mode holds.
const FRAME_RATE: f64 = 30.0;
/// Performance mode draws nothing finer than this, in pixels.
const FINEST: f64 = 0.5;
/// What choosing may take in a frame, in milliseconds.
const ADAPT_TIME: f64 = 8.0;
/// Pixels that the pointer may move in a click.
const CLICK: f64 = 3.0;
/// Radians per pixel of a drag.
const TURN: f64 = 0.006;

impl Controls {
    /// As the command line says.
    pub fn of(args: &Args) -> Self {
        Self { args: args.clone(), ..Self::default() }
    }

    /// Forgets the view after a new file has been opened.
    pub fn forget_view(&mut self) {
        (self.frozen, self.performance) = (None, None);
    }

    /// Whether the camera moves on its own.
    pub fn is_moving(&self) -> bool {
        !self.held.is_empty() || self.dragging.is_some()
    }

    /// Whether performance mode chooses the budgets.
    pub fn wants_speed(&self) -> bool {
        self.args.frame_rate.is_some()
    }

    /// Sets the budgets of the next frame. Returns its tolerance in pixels.
    pub fn limit(&mut self, scene: &mut Scene) -> f64 {
        scene.limit(&self.args);
        let Some(rate) = self.args.frame_rate else {
            self.performance = None;
            return self.args.tolerance;
        };
        let goal = PerformanceGoal::FrameTime(1000.0 / rate);
        let target = PerformanceTarget { goal, tolerance: FINEST, adapt_time: ADAPT_TIME, ..Default::default() };
        if self.performance.is_none() {
            self.performance = PerformanceMode::new(target).ok();
        }
        let Some(held) = self.performance.as_ref().map(PerformanceMode::controls) else { return self.args.tolerance };
        scene.first.query.max_nodes = Some(held.max_nodes);
        scene.first.query.max_triangles = Some(held.max_triangles);
        held.tolerance
    }

    /// Records a frame that was drawn.
    pub fn record(&mut self, report: &Report) {
        let _ = self.performance.as_mut().map(|mode| mode.record(report.times()));
    }

    /// What performance mode has found out about frames.
    pub fn costs(&self) -> Option<String> {
        let model = self.performance.as_ref()?.model();
        let [fixed, node, triangle, byte] = model.costs();
        let explained = model.r_squared().map_or(String::new(), |share| format!(", R2 {share:.3}"));
        let [node, triangle, byte] = [node * 1e3, triangle * 1e6, byte * 1e6];
        Some(format!(
            "frames take {fixed:.2} ms, {node:.2} us a node, {triangle:.2} ns a triangle, {byte:.2} ns a byte{explained}"
        ))
    }

    /// Handles a button that goes down or up. Returns where it was clicked, if the pointer has not moved meanwhile.
    pub fn clicked(&mut self, is_pressed: bool) -> Option<[f64; 2]> {
        if is_pressed {
            self.pressed = self.pointer;
            return None;
        }
        let (from, to) = (self.pressed.take()?, self.pointer?);
        let moved = (0..2).map(|k| (to[k] - from[k]).powi(2)).sum::<f64>();
        (moved <= CLICK * CLICK).then_some(to)
    }

    /// Handles a key that goes down or up. Returns its letter if the window must handle it: more letters where an
    /// object is selected.
    pub fn key(&mut self, event: &KeyEvent, has_selected: bool) -> Option<String> {
        let is_down = event.state == ElementState::Pressed;
        if let PhysicalKey::Code(code) = event.physical_key
            && FLYING.iter().any(|(key, _)| *key == code)
        {
            let _ = if is_down { self.held.insert(code) } else { self.held.remove(&code) };
            return None;
        }
        let letter = match &event.logical_key {
            Key::Named(NamedKey::Escape) => "escape".to_string(),
            Key::Character(text) => text.to_lowercase(),
            _ => return None,
        };
        let is_of_objects = has_selected && OF_OBJECTS.contains(&letter.as_str());
        if is_down && !event.repeat && (is_of_objects || !self.takes(&letter)) { Some(letter) } else { None }
    }

    /// Handles a letter that concerns how the model is drawn. Returns whether it did.
    fn takes(&mut self, letter: &str) -> bool {
        let args = &mut self.args;
        let is_colouring = |overlay: Overlay| TOGGLES[..4].iter().any(|&(_, other)| other == overlay);
        if let Some(&(_, overlay)) = TOGGLES.iter().find(|(key, _)| *key == letter) {
            let was_there = args.has(overlay);
            args.overlay.retain(|&other| other != overlay && !(is_colouring(other) && is_colouring(overlay)));
            args.overlay.extend((!was_there).then_some(overlay));
            return true;
        }
        // A budget that has been doubled often enough is no budget.
        let double = |limit: u64| limit.checked_mul(2).filter(|&limit| limit < 1 << 40);
        let half = |limit: u64| Some((limit / 2).max(1));
        let [triangles, nodes] = [args.max_triangles.unwrap_or(1 << 20), args.max_nodes.unwrap_or(1 << 12)];
        match letter {
            "+" | "=" => args.tolerance = (args.tolerance / 2.0).max(1.0 / 64.0),
            "-" => args.tolerance = (args.tolerance * 2.0).min(512.0),
            "t" => args.max_triangles = double(triangles),
            "u" => args.max_triangles = half(triangles),
            "n" => args.max_nodes = double(nodes),
            "m" => args.max_nodes = half(nodes),
            "p" => args.frame_rate = if args.frame_rate.is_none() { Some(FRAME_RATE) } else { None },
            "1" => args.overlay.retain(|&overlay| !is_colouring(overlay)),
            "k" => args.unlit = !args.unlit,
            "v" => args.draw = if args.draw == Way::Pulled { Way::Stitched } else { Way::Pulled },
            _ => return false,
        }
        true
    }

    /// Flies while keys are held: the distance to the middle takes a second.
    pub fn advance(&self, camera: &mut View, bounds: Bounds, seconds: f64) {
        let held = FLYING.iter().filter(|(key, _)| self.held.contains(key));
        let along = held.map(|(_, along)| *along).sum::<DVec3>();
        camera.shift((along * distance(camera, bounds, 0.05) * seconds).into());
    }

    /// Handles a new position of the pointer.
    pub fn pointer(&mut self, at: [f64; 2], camera: &mut View, bounds: Bounds) {
        let (Some(before), Some(orbits)) = (self.pointer.replace(at), self.dragging) else { return };
        let pivot = if orbits { middle_of(bounds).0.into() } else { camera.position };
        camera.orbit(pivot, (before[0] - at[0]) * TURN, (before[1] - at[1]) * TURN);
    }
}

/// Distance from the middle; at least a share of the model's radius, so that one can get away from there.
fn distance(camera: &View, bounds: Bounds, least: f64) -> f64 {
    let (middle, radius) = middle_of(bounds);
    middle.distance(camera.position.into()).max(radius * least)
}

/// Handles the wheel: each step moves an eighth closer to the middle.
pub fn approach(steps: f64, camera: &mut View, bounds: Bounds) {
    let nearer = 1.0 - 0.875_f64.powf(steps.clamp(-8.0, 8.0));
    camera.shift([0.0, 0.0, distance(camera, bounds, 0.02) * nearer]);
}

/// Where the camera of a file is remembered.
fn camera_path(address: &str) -> Option<PathBuf> {
    let state = std::env::var_os("XDG_STATE_HOME").map(PathBuf::from);
    let state = state.or_else(|| Some(std::env::home_dir()?.join(".local/state")))?;
    let name = address.replace(|c: char| !c.is_alphanumeric() && c != '.', "_");
    Some(state.join("lodpack-view").join(name + ".camera"))
}

/// The camera with which a file was last viewed.
pub fn recent_camera(address: &str, now: &View) -> Option<View> {
    parse(&std::fs::read_to_string(camera_path(address)?).ok()?, now).ok()
}

/// Remembers a camera. This is a convenience, so a failure to write is not reported.
pub fn remember_camera(address: &str, camera: &View) {
    let Some(path) = camera_path(address) else { return };
    let _ = path.parent().map(std::fs::create_dir_all);
    let _ = std::fs::write(path, text(camera));
}
