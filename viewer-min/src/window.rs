//! The window: events in, frames out. What keys do is in [`crate::controls`].

use std::{
    sync::{Arc, mpsc},
    time::{Duration, Instant},
};

use anyhow::{Context, Result};
use lodpack::{FrameTimes, session::Mode};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, EventLoop},
    window::{Window, WindowId},
};

use crate::{
    args::Args,
    camera::{Camera, Frame},
    controls::{Controls, Order, recent_camera, remember_camera},
    draw::Way,
    headless::{budget_of, first_camera, upload},
    overlay::{Canvas, Panel, draw_key_card, draw_messages},
    present::Present,
    scene::{Report, Scene, milliseconds},
    source::open_source,
};

/// How long a message stays.
const MESSAGE_TIME: Duration = Duration::from_secs(8);
/// Time between frames while nothing moves but pages may come.
const REST: Duration = Duration::from_millis(50);

/// Opens a window and shows what is typed.
///
/// # Errors
/// Where there is no display or no adapter.
pub fn run(args: &Args) -> Result<()> {
    let event_loop = EventLoop::new().context("no display; --screenshot draws without one")?;
    let mut app = App::new(args);
    event_loop.run_app(&mut app)?;
    app.fatal.map_or(Ok(()), Err)
}

struct App {
    args: Args,
    window: Option<Arc<Window>>,
    present: Option<Present>,
    /// What was written over the last picture.
    canvas: Canvas,
    scene: Option<Scene>,
    /// A file that is being opened.
    opening: Option<(String, mpsc::Receiver<Result<Scene>>)>,
    place: String,
    camera: Option<Camera>,
    controls: Controls,
    panel: Panel,
    report: Report,
    messages: Vec<(Instant, String)>,
    recording: Option<Vec<Camera>>,
    frames: u64,
    pictures: u32,
    last_frame: Instant,
    /// The device was lost and not made again so often since a frame went well.
    losses: u32,
    fatal: Option<anyhow::Error>,
}

impl App {
    fn new(args: &Args) -> Self {
        let mut app = Self {
            args: args.clone(),
            window: None,
            present: None,
            canvas: Canvas::new([0, 0]),
            scene: None,
            opening: None,
            place: String::new(),
            camera: None,
            controls: Controls::new(args, budget_of(args)),
            panel: Panel::default(),
            report: Report::default(),
            messages: Vec::new(),
            recording: None,
            frames: 0,
            pictures: 0,
            last_frame: Instant::now(),
            losses: 0,
            fatal: None,
        };
        match &args.file {
            Some(place) => app.open(place.clone()),
            None => app.say("drop a .lodpack file here".into()),
        }
        app
    }

    /// Says something on the screen and on stderr.
    fn say(&mut self, text: String) {
        eprintln!("lodpack-view: {text}");
        self.messages.retain(|(_, known)| *known != text);
        self.messages.push((Instant::now(), text));
    }

    /// Opens a file in the background; what is shown stays until that is there.
    fn open(&mut self, place: String) {
        let (sender, receiver) = mpsc::channel();
        let name = place.clone();
        std::thread::spawn(move || {
            let opened = open_source(&place).and_then(|source| Scene::open(source, Mode::AsynchronousWithPrefetch));
            // Nobody waits any more if the window is closed.
            let _ = sender.send(opened.with_context(|| place));
        });
        self.opening = Some((name, receiver));
    }

    fn take_opened(&mut self) {
        let Some((place, receiver)) = &self.opening else { return };
        match receiver.try_recv() {
            Ok(Ok(scene)) => {
                self.place.clone_from(place);
                match first_camera(&self.args, scene.bounds) {
                    Ok(camera) => self.camera = Some(camera),
                    Err(error) => self.fatal = Some(error),
                }
                self.controls.forget_view();
                self.scene = Some(scene);
                self.opening = None;
            }
            Ok(Err(error)) => {
                self.opening = None;
                self.say(format!("{error:#}"));
            }
            Err(mpsc::TryRecvError::Empty) => (),
            Err(mpsc::TryRecvError::Disconnected) => {
                self.opening = None;
                self.say("opening the file failed".into());
            }
        }
    }

    fn frame(&mut self, event_loop: &ActiveEventLoop) {
        self.take_opened();
        let Some(window) = self.window.clone() else { return };
        let size: [u32; 2] = window.inner_size().into();
        if size.contains(&0) {
            return;
        }
        let passed = self.last_frame.elapsed().min(Duration::from_millis(100));
        self.last_frame = Instant::now();
        if self.present.is_none() {
            match Present::new(event_loop, &window, self.args.way()) {
                Ok(present) => self.present = Some(present),
                Err(error) => {
                    self.losses += 1;
                    if self.losses > 3 {
                        self.fatal = Some(error);
                        event_loop.exit();
                    }
                    return;
                }
            }
        }
        if let (Some(scene), Some(camera)) = (&self.scene, &mut self.camera) {
            self.controls.advance(camera, scene.bounds, passed.as_secs_f64());
        }
        if let (Some(present), true) = (&self.present, self.args.lose_device == Some(self.frames)) {
            present.gpu.device.destroy();
        }
        let drawn = self.draw(size);
        let trouble = self.present.as_ref().and_then(|present| present.gpu.trouble());
        if let Some(trouble) = trouble {
            self.say(format!("{trouble}; starting again"));
            self.present = None;
            self.losses += 1;
        } else {
            self.losses = 0;
            if let Err(error) = drawn {
                self.say(format!("{error:#}"));
            }
        }
        let problems = self.scene.as_ref().map(Scene::take_problems).unwrap_or_default();
        problems.into_iter().for_each(|problem| self.say(format!("{problem}; Y reads it again")));
        self.frames += 1;
        if self.losses > 3 {
            self.fatal = Some(anyhow::anyhow!("the graphics device is lost again and again"));
        }
        if self.fatal.is_some() || self.args.frames.is_some_and(|frames| self.frames >= frames) {
            event_loop.exit();
        }
    }

    /// Adapts, sends and draws; then shows the picture, also if something failed.
    fn draw(&mut self, size: [u32; 2]) -> Result<()> {
        let (Some(window), Some(present)) = (&self.window, &mut self.present) else { return Ok(()) };
        if present.targets.size != size {
            present.resize(size);
        }
        let mut result = Ok(());
        if let (Some(scene), Some(camera)) = (&mut self.scene, self.camera) {
            let begun = Instant::now();
            scene.budget = self.controls.budget(scene.roots.len());
            match scene.follow(&self.controls.frozen.unwrap_or(camera), Frame::whole(size)) {
                Ok(report) => self.report = report,
                Err(error) => result = Err(error),
            }
            present.set_way(self.controls.way());
            let uploading = Instant::now();
            upload(&present.gpu, &mut present.renderer, scene);
            self.report.upload = milliseconds(uploading);
            let drawing = Instant::now();
            let scale = [scene.budget.tolerance_px as f32, scene.level_count() as f32];
            present.draw(&camera, self.controls.style, scale);
            let waited = present.gpu.wait();
            self.report.draw = milliseconds(drawing);
            self.panel.record(milliseconds(begun));
            self.controls.record(FrameTimes { frame: milliseconds(begun), adapt: self.report.select });
            if let Some(path) = &mut self.recording {
                path.push(camera);
            }
            result = result.and(waited);
        }
        let mut canvas = Canvas::new(size);
        let mut notes = Vec::new();
        notes.extend(self.controls.frozen.map(|_| "the cut is frozen".to_string()));
        notes.extend(self.recording.as_ref().map(|path| format!("recording: {} frames", path.len())));
        if let (Some(scene), true) = (&self.scene, self.controls.has_panel) {
            self.panel.draw(&mut canvas, scene, &self.report, &scene.budget, self.controls.way(), &notes);
        }
        if let Some((place, _)) = &self.opening {
            canvas.text([8, size[1].saturating_sub(24)], &[format!("opening {place} ...")], [24, 30, 42, 255]);
        }
        if self.controls.has_card {
            draw_key_card(&mut canvas);
        }
        self.messages.retain(|(since, _)| since.elapsed() < MESSAGE_TIME);
        let messages: Vec<String> = self.messages.iter().map(|(_, text)| text.clone()).collect();
        draw_messages(&mut canvas, &messages);
        present.show(window, &canvas);
        self.canvas = canvas;
        result
    }

    fn obey(&mut self, order: Order, event_loop: &ActiveEventLoop) -> Result<()> {
        match order {
            Order::Close => event_loop.exit(),
            Order::Screenshot => {
                let Some(present) = &self.present else { return Ok(()) };
                let path = format!("lodpack-view-{}-{}.png", std::process::id(), self.pictures);
                self.pictures += 1;
                let mut picture = present.targets.read(&present.gpu)?;
                self.canvas.put_over(&mut picture);
                picture.save(path.as_ref())?;
                let camera = self.camera.map(|camera| camera.text()).unwrap_or_default();
                self.say(format!("wrote {path}; --camera {camera}"));
            }
            Order::Record => match self.recording.take() {
                None => self.recording = Some(Vec::new()),
                Some(path) => {
                    let name = format!("lodpack-path-{}.json", std::process::id());
                    std::fs::write(&name, crate::camera::path_to_json(&path)).context("the path cannot be written")?;
                    self.say(format!("wrote {name}: {} frames; --path {name} draws them again", path.len()));
                }
            },
            Order::RecentCamera => match recent_camera(&self.place, self.camera.as_ref()) {
                Some(recent) => {
                    self.camera.iter().for_each(|camera| remember_camera(&self.place, camera));
                    self.camera = Some(recent);
                }
                None => self.say("no camera is remembered for this file; closing the window remembers one".into()),
            },
            Order::WholeModel => {
                let scene = self.scene.as_ref().context("no file is open")?;
                self.camera = Some(Camera::around(scene.bounds, self.args.up(), 0.5, 0.25));
            }
            Order::Retry => self.scene.iter_mut().for_each(Scene::retry),
            Order::Freeze => self.controls.frozen = if self.controls.frozen.is_some() { None } else { self.camera },
        }
        Ok(())
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.window.is_some() {
            return;
        }
        let title = format!("lodpack-view {}", self.args.file.as_deref().unwrap_or_default());
        let [width, height] = self.args.size;
        let attributes =
            Window::default_attributes().with_title(title).with_inner_size(PhysicalSize::new(width, height));
        match event_loop.create_window(attributes) {
            Ok(window) => {
                window.request_redraw();
                self.window = Some(Arc::new(window));
            }
            Err(error) => {
                self.fatal = Some(error.into());
                event_loop.exit();
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::DroppedFile(path) => self.open(path.to_string_lossy().into_owned()),
            WindowEvent::RedrawRequested => self.frame(event_loop),
            WindowEvent::KeyboardInput { event, .. } => {
                if let Some(order) = self.controls.key(&event)
                    && let Err(error) = self.obey(order, event_loop)
                {
                    self.say(format!("{error:#}"));
                }
            }
            WindowEvent::MouseInput { button, state, .. } => {
                self.controls.dragging = (state == ElementState::Pressed).then_some(button == MouseButton::Left);
            }
            WindowEvent::CursorMoved { position, .. } => {
                self.controls.pointer([position.x, position.y], self.camera.as_mut(), self.scene.as_ref());
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let steps = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / 40.0,
                };
                self.controls.wheel(steps, self.camera.as_mut(), self.scene.as_ref());
            }
            WindowEvent::PinchGesture { delta, .. } => {
                self.controls.wheel(delta * 8.0, self.camera.as_mut(), self.scene.as_ref());
            }
            _ => (),
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let is_busy = self.controls.is_moving() || !self.report.is_complete || self.args.frames.is_some();
        let rest = if is_busy { Duration::from_millis(2) } else { REST };
        event_loop.set_control_flow(ControlFlow::WaitUntil(Instant::now() + rest));
        self.window.iter().for_each(|window| window.request_redraw());
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.camera.iter().for_each(|camera| remember_camera(&self.place, camera));
        // The surface has to go before its window.
        self.present = None;
    }
}

/// Pulling, where lines are drawn: they need it.
pub fn way_for(style: crate::draw::Style, chosen: Way) -> Way {
    if style.wireframe || style.seams { Way::Pulled } else { chosen }
}
