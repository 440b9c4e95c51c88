//! The window: events in, frames out. [`crate::controls`] decides what keys do to the picture.

use std::{
    sync::Arc,
    thread::JoinHandle,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow};
use image::{RgbaImage, imageops};
use lodpack::{Query, View, stream::Mode};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, EventLoop},
    window::{Fullscreen, Window, WindowId},
};

use crate::{
    args::{Args, KEY_CARD, Overlay},
    camera::{path_to_json, text},
    controls::{Controls, approach, recent_camera, remember_camera},
    headless::open_at,
    overlay::{INK, Panel, WARNING, write_above},
    picture::save,
    present::Present,
    report::{Report, milliseconds},
    scene::{Scene, open_source},
    wall::{Role, Wanted},
};

/// How long a message is shown.
const MESSAGE_TIME: Duration = Duration::from_secs(8);
/// Time between frames while nothing moves but pages may arrive.
const REST: Duration = Duration::from_millis(50);
/// How often in a row a lost device is recreated.
const MOST_LOSSES: u32 = 3;

/// Opens a window and shows the file of the command line.
pub fn show_window(args: &Args) -> Result<()> {
    let event_loop = EventLoop::new().or_else(|error| {
        // A file that is not there is worth more words than a display that is not there.
        args.files.first().map(|address| open_source(address)).transpose()?;
        Err(error).context("no display; --screenshot works without one")
    })?;
    let mut app = App::default();
    app.controls.args = args.clone();
    if args.files.is_empty() {
        app.say("drop a .lodpack file here".into());
    } else {
        app.open(args.files.clone());
    }
    event_loop.run_app(&mut app)?;
    app.fatal.map_or(Ok(()), Err)
}

/// What is being viewed.
struct Looked {
    /// The first file.
    address: String,
    scene: Scene,
    camera: View,
}

#[derive(Default)]
struct App {
    window: Option<Arc<Window>>,
    present: Option<Present>,
    /// The text drawn over the last picture.
    canvas: RgbaImage,
    looked: Option<Looked>,
    role: Option<Role>,
    /// The files that are being opened.
    opening: Option<(String, JoinHandle<Result<Looked>>)>,
    controls: Controls,
    panel: Panel,
    report: Report,
    messages: Vec<(Instant, String)>,
    recording: Option<Vec<View>>,
    frames: u64,
    last_frame: Option<Instant>,
    /// How often the device was lost and recreated since the last successful frame.
    losses: u32,
    fatal: Option<anyhow::Error>,
}

impl App {
    /// Shows a message on the screen and on stderr.
    fn say(&mut self, text: String) {
        eprintln!("lodpack-view: {text}");
        self.messages.retain(|(_, known)| *known != text);
        self.messages.push((Instant::now(), text));
    }

    /// Opens files in the background. The current ones stay until the new ones are ready.
    fn open(&mut self, addresses: Vec<String>) {
        let (args, named) = (self.controls.args.clone(), addresses.join(" "));
        let address = addresses.first().cloned().unwrap_or_default();
        let open = move || -> Result<Looked> {
            let scene = open_at(&addresses, &args, Mode::AsynchronousWithPrefetch)?;
            let camera = scene.first_extent().and_then(|extent| args.first_view(extent));
            Ok(Looked { camera: camera.with_context(|| address.clone())?, address, scene })
        };
        let thread = std::thread::spawn(open);
        self.opening = Some((named, thread));
    }

    fn take_opened(&mut self) {
        let Some((_, thread)) = self.opening.take_if(|(_, thread)| thread.is_finished()) else { return };
        match thread.join().unwrap_or_else(|_| Err(anyhow!("opening the file failed"))) {
            Ok(looked) => {
                self.remember();
                if self.role.is_none() {
                    match Role::of(&self.controls.args, &looked.scene) {
                        Ok(role) => self.role = role,
                        Err(error) => self.fatal = Some(error),
                    }
                }
                self.looked = Some(looked);
                self.controls.forget_view();
            }
            Err(error) => self.say(format!("{error:#}")),
        }
    }

    fn remember(&self) {
        self.looked.iter().for_each(|looked| remember_camera(&looked.address, &looked.camera));
    }

    fn frame(&mut self, event_loop: &ActiveEventLoop) {
        self.take_opened();
        let Some(window) = self.window.clone() else { return };
        let size: [u32; 2] = window.inner_size().into();
        if size.contains(&0) {
            return;
        }
        let passed = self.last_frame.replace(Instant::now()).map_or(Duration::ZERO, |last| last.elapsed());
        if let Some(looked) = &mut self.looked {
            self.controls.advance(&mut looked.camera, looked.scene.bounds, passed.as_secs_f64().min(0.1));
        }
        let drawn = match &self.role {
            Some(Role::Shows(_)) => self.show_wall(event_loop, &window, size),
            _ => self.draw(event_loop, &window, size),
        };
        let is_lost = self.present.as_ref().is_none_or(|present| present.gpu.check().is_err());
        self.losses = if is_lost { self.losses + 1 } else { 0 };
        match drawn {
            Err(error) if self.losses > MOST_LOSSES => self.fatal = Some(error),
            Err(error) if is_lost => {
                self.say(format!("{error:#}; starting again"));
                self.present = None;
            }
            Err(error) => self.say(format!("{error:#}")),
            Ok(()) => (),
        }
        let problems = self.looked.as_ref().map(|looked| looked.scene.take_problems()).unwrap_or_default();
        problems.into_iter().for_each(|problem| self.say(format!("{problem}; Y reads it again")));
        let problems = self.present.as_mut().map(|present| present.renderer.take_problems()).unwrap_or_default();
        problems.into_iter().for_each(|problem| self.say(problem));
        self.frames += 1;
    }

    /// Adapts, uploads and draws; then shows the picture, even if something failed.
    fn draw(&mut self, event_loop: &ActiveEventLoop, window: &Arc<Window>, size: [u32; 2]) -> Result<()> {
        let way = self.controls.args.way();
        let present = match &mut self.present {
            Some(present) => present,
            none => none.insert(Present::new(event_loop, window, way)?),
        };
        if self.controls.args.lose_device == Some(self.frames) {
            present.gpu.device.destroy();
        }
        present.adjust(size, size, way);
        let exceeded_before = self.report.exceeded;
        let mut result = Ok(());
        let mut canvas = RgbaImage::new(size[0], size[1]);
        // The device may still draw the frame before.
        let wait_ms = present.frames.begin()?;
        if let Some(Looked { scene, camera, .. }) = &mut self.looked {
            let begun = Instant::now();
            let pixel_tolerance = self.controls.limit(scene);
            let [view, chosen] = [*camera, self.controls.frozen.unwrap_or(*camera)].map(|from| View {
                viewport: size,
                pixel_tolerance,
                ..from
            });
            match scene.follow(&chosen) {
                Ok(report) => self.report = Report { wait_ms, draw_ms: self.report.draw_ms, ..report },
                Err(error) => result = Err(error),
            }
            if let Some(Role::Controls(wall)) = &mut self.role {
                let query = Query { view: Some(chosen), ..scene.first.query.clone() };
                result = wall.follow(&query).and(result);
            }
            let look = (&view, &*self.controls.args.overlay, self.controls.args.unlit);
            let drawn = present.renderer.draw_scene(&present.targets, scene, look, &mut self.report);
            self.report.frame_ms = wait_ms + milliseconds(begun.elapsed());
            for drawn in present.frames.take_drawn() {
                self.panel.record(drawn.times().frame);
                self.controls.record(&drawn);
                self.report.draw_ms = drawn.draw_ms;
            }
            self.recording.iter_mut().for_each(|path| path.push(*camera));
            // A lost device says more than its consequences.
            result = drawn.and(result);
            if self.controls.args.has(Overlay::Text) {
                let mut notes = if self.controls.frozen.is_some() { "the cut is frozen\n" } else { "" }.to_string();
                notes.extend(self.recording.as_ref().map(|path| format!("recording: {} frames", path.len())));
                notes.extend(self.controls.costs().map(|costs| format!("\n{costs}")));
                self.panel.draw(&mut canvas, scene, (&view, way), &self.report, &notes);
            }
        }
        // Messages are stacked from the bottom up.
        self.messages.retain(|(since, _)| since.elapsed() < MESSAGE_TIME);
        let mut texts: Vec<(&str, _)> = self.messages.iter().rev().map(|(_, text)| (text.as_str(), WARNING)).collect();
        let opening = self.opening.as_ref().map(|(address, _)| format!("opening {address} ..."));
        texts.extend(opening.as_deref().map(|text| (text, INK)));
        let selected = self.looked.as_ref().and_then(|looked| looked.scene.selected());
        texts.extend(selected.map(|selected| (selected.text.as_str(), INK)));
        texts.extend(self.controls.args.has(Overlay::Keys).then_some((KEY_CARD, INK)));
        texts.iter().fold(size[1], |bottom, &(text, ink)| write_above(&mut canvas, bottom, text, ink));
        present.show(window, &canvas);
        let ended = present.frames.end(self.report);
        self.canvas = canvas;
        let result = result.and(ended).and(present.gpu.check());
        // Performance mode takes what it gets. Budgets that were asked for are worth a message, when they begin to be
        // too small.
        let begins = self.report.exceeded != exceeded_before && !self.controls.wants_speed();
        if let Some(complaint) = self.report.complaint().filter(|_| begins) {
            self.say(complaint);
        }
        result
    }

    /// Draws and shows what the controller of the wall wants.
    fn show_wall(&mut self, event_loop: &ActiveEventLoop, window: &Arc<Window>, size: [u32; 2]) -> Result<()> {
        let way = self.controls.args.way();
        let present = match &mut self.present {
            Some(present) => present,
            none => none.insert(Present::new(event_loop, window, way)?),
        };
        let (Some(Role::Shows(display)), Some(Looked { scene, .. })) = (&mut self.role, &mut self.looked) else {
            return Ok(());
        };
        present.adjust(size, display.size, way);
        loop {
            match display.poll(scene) {
                Ok(Some(Wanted::Frame(mut frame))) => {
                    let look = (&frame.view, &*self.controls.args.overlay, self.controls.args.unlit);
                    present.renderer.draw_scene(&present.targets, scene, look, &mut frame.report)?;
                    present.gpu.wait()?;
                    self.fatal = display.answer(&frame).err();
                }
                Ok(Some(Wanted::Show(_))) => present.show(window, &RgbaImage::new(size[0], size[1])),
                Ok(Some(Wanted::End)) => event_loop.exit(),
                Ok(None) => return Ok(()),
                Err(error) => self.fatal = Some(error),
            }
            if self.fatal.is_some() || event_loop.exiting() {
                return Ok(());
            }
        }
    }

    /// Selects what lies at a pixel.
    fn click(&mut self, at: [f64; 2]) {
        let (Some(window), Some(Looked { scene, camera, .. })) = (&self.window, &mut self.looked) else { return };
        let viewport: [u32; 2] = window.inner_size().into();
        let view = View { viewport, ..*camera };
        let picked = scene.pick_object(&view, [0, 1].map(|k| at[k] / f64::from(viewport[k].max(1))));
        if let Err(error) = picked {
            self.say(format!("{error:#}"));
        }
    }

    /// Carries out what a key asks of the window.
    fn obey(&mut self, letter: &str, event_loop: &ActiveEventLoop) -> Result<()> {
        let has_selected = self.looked.as_ref().is_some_and(|looked| looked.scene.selected().is_some());
        if letter == "escape" && !has_selected {
            event_loop.exit();
        }
        if let ("x", Some(present)) = (letter, &self.present) {
            let path = format!("lodpack-view-{}-{:08}.png", std::process::id(), self.frames);
            let mut picture = present.targets.colours(&present.gpu)?;
            imageops::overlay(&mut picture, &self.canvas, 0, 0);
            save(picture, path.as_ref())?;
            let camera = self.looked.as_ref().map(|looked| text(&looked.camera)).unwrap_or_default();
            self.say(format!("wrote {path}; --camera {camera}"));
        }
        let Some(looked) = &mut self.looked else { return Ok(()) };
        match letter {
            "r" => match self.recording.take() {
                None => self.recording = Some(Vec::new()),
                Some(path) => {
                    let name = format!("lodpack-path-{}.json", std::process::id());
                    std::fs::write(&name, path_to_json(&path)).context("the path cannot be written")?;
                    self.say(format!("wrote {name}: {} frames; --path {name} draws them again", path.len()));
                }
            },
            "c" => match recent_camera(&looked.address, &looked.camera) {
                Some(recent) => {
                    remember_camera(&looked.address, &looked.camera);
                    looked.camera = recent;
                }
                None => self.say("no camera is remembered for this file; closing the window remembers one".into()),
            },
            "o" => looked.camera = self.controls.args.whole_model(looked.scene.extent()),
            "g" => {
                looked.scene.first.next_channel()?;
                let name = looked.scene.first.channel.as_ref().map(|channel| channel.info.name.clone());
                self.say(name.map_or("no channel".into(), |name| format!("channel {name}")));
            }
            "h" | "i" | "j" => looked.scene.obey_objects(letter)?,
            "escape" => looked.scene.deselect(),
            "y" => looked.scene.retry_failed(),
            "f" => self.controls.frozen = self.controls.frozen.xor(Some(looked.camera)),
            _ => (),
        }
        Ok(())
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.window.is_some() {
            return;
        }
        let title = format!("lodpack-view {}", self.controls.args.files.join(" "));
        let [width, height] = self.controls.args.size;
        let attributes = Window::default_attributes().with_title(title);
        let is_full = self.controls.args.full_screen;
        let attributes = attributes.with_fullscreen(is_full.then_some(Fullscreen::Borderless(None)));
        match event_loop.create_window(attributes.with_inner_size(PhysicalSize::new(width, height))) {
            Ok(window) => self.window = Some(Arc::new(window)),
            Err(error) => self.fatal = Some(error.into()),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::DroppedFile(path) => self.open(vec![path.to_string_lossy().into_owned()]),
            WindowEvent::RedrawRequested => self.frame(event_loop),
            WindowEvent::KeyboardInput { event, .. } => {
                let has_selected = self.looked.as_ref().is_some_and(|looked| looked.scene.selected().is_some());
                if let Some(letter) = self.controls.key(&event, has_selected)
                    && let Err(error) = self.obey(&letter, event_loop)
                {
                    self.say(format!("{error:#}"));
                }
            }
            WindowEvent::MouseInput { button, state, .. } => {
                let is_pressed = state == ElementState::Pressed;
                self.controls.dragging = is_pressed.then_some(button == MouseButton::Left);
                let clicked = self.controls.clicked(is_pressed);
                if let Some(at) = clicked.filter(|_| button == MouseButton::Left) {
                    self.click(at);
                }
            }
            event => {
                let Some(Looked { scene, camera, .. }) = &mut self.looked else { return };
                let steps = match event {
                    WindowEvent::CursorMoved { position, .. } => {
                        return self.controls.pointer([position.x, position.y], camera, scene.bounds);
                    }
                    WindowEvent::MouseWheel { delta: MouseScrollDelta::LineDelta(_, lines), .. } => f64::from(lines),
                    WindowEvent::MouseWheel { delta: MouseScrollDelta::PixelDelta(pixels), .. } => pixels.y / 40.0,
                    WindowEvent::PinchGesture { delta, .. } => delta * 8.0,
                    _ => return,
                };
                approach(steps, camera, scene.bounds);
            }
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let shows = matches!(self.role, Some(Role::Shows(_)));
        let is_busy = self.controls.is_moving() || !self.report.is_complete || shows;
        let rest = if is_busy { Duration::from_millis(2) } else { REST };
        event_loop.set_control_flow(ControlFlow::WaitUntil(Instant::now() + rest));
        self.window.iter().for_each(|window| window.request_redraw());
        if self.fatal.is_some() {
            event_loop.exit();
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.remember();
        // The surface must be dropped before its window.
        self.present = None;
    }
}
