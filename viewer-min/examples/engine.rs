//! How an engine draws a streamed file: a streamer says what changes, a pool says where it goes, and each buffer is
//! drawn by one call. Everything here but the shader is what a program with an engine of its own has to write.
//!
//! ```sh
//! cargo run --release -p lodpack-view --example engine -- model.lodpack
//! ```

#![allow(clippy::disallowed_methods, reason = "cameras; no file depends on them")]

use std::{collections::HashMap, error::Error, sync::Arc, time::Instant};

use glam::{DVec3, DVec4};
use lodpack::{
    File, Limits, Query, View,
    stream::{Options, Pool, PoolOptions, Streamer, StreamerOptions, VERTEX_BYTES},
};
use wgpu::{BufferUsages, CurrentSurfaceTexture::Success, TextureFormat, util::DeviceExt};
use winit::{
    application::ApplicationHandler,
    event::WindowEvent,
    event_loop::{ActiveEventLoop, EventLoop},
    window::{Window, WindowId},
};

const DEPTH: TextureFormat = TextureFormat::Depth32Float;

/// The device, the window, and the buffers of the pool.
struct Engine {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipeline: wgpu::RenderPipeline,
    depth: wgpu::TextureView,
    buffers: HashMap<u64, [wgpu::Buffer; 2]>,
}

impl Engine {
    fn new(event_loop: &ActiveEventLoop) -> Result<Self, Box<dyn Error>> {
        let window = Arc::new(event_loop.create_window(Window::default_attributes().with_title("engine"))?);
        let handle = Box::new(event_loop.owned_display_handle());
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_with_display_handle_from_env(handle));
        let surface = instance.create_surface(window.clone())?;
        let options = wgpu::RequestAdapterOptions { compatible_surface: Some(&surface), ..Default::default() };
        let adapter = pollster::block_on(instance.request_adapter(&options))?;
        let (device, queue) = pollster::block_on(adapter.request_device(&Default::default()))?;
        let (width, height) = window.inner_size().into();
        let config = surface.get_default_config(&adapter, width, height).ok_or("no format for the window")?;
        surface.configure(&device, &config);
        let module = &device.create_shader_module(wgpu::include_wgsl!("engine.wgsl"));
        let compilation_options = wgpu::PipelineCompilationOptions::default();
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Snorm16x2];
        let (array_stride, step_mode) = (VERTEX_BYTES as u64, Default::default());
        let vertices = wgpu::VertexBufferLayout { array_stride, step_mode, attributes: &attributes };
        let targets = &[Some(config.format.into())];
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module,
                entry_point: None,
                compilation_options: compilation_options.clone(),
                buffers: &[Some(vertices)],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState { module, entry_point: None, compilation_options, targets }),
            multiview_mask: None,
            cache: None,
        });
        let depth = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: DEPTH,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        let depth = depth.create_view(&Default::default());
        Ok(Self { window, surface, config, device, queue, pipeline, depth, buffers: HashMap::new() })
    }

    /// Makes and drops buffers, and copies what is new.
    fn copy(&mut self, pool: &Pool, uploads: &[lodpack::stream::PoolUpload]) {
        self.buffers.retain(|id, _| pool.buffers().any(|buffer| buffer.id == *id));
        for buffer in pool.buffers() {
            let new = |size: u64, usage| {
                let usage = usage | BufferUsages::COPY_DST;
                self.device.create_buffer(&wgpu::BufferDescriptor {
                    label: None,
                    size,
                    usage,
                    mapped_at_creation: false,
                })
            };
            let vertex_bytes = u64::from(buffer.vertex_count) * VERTEX_BYTES as u64;
            self.buffers.entry(buffer.id).or_insert_with(|| {
                [new(vertex_bytes, BufferUsages::VERTEX), new(u64::from(buffer.index_count) * 4, BufferUsages::INDEX)]
            });
        }
        for upload in uploads {
            let [vertices, indices] = &self.buffers[&upload.place.buffer];
            let at = u64::from(upload.place.first_vertex) * VERTEX_BYTES as u64;
            self.queue.write_buffer(vertices, at, &upload.vertices);
            self.queue.write_buffer(indices, u64::from(upload.place.first_index) * 4, &upload.indices);
        }
    }

    fn draw(&self, pool: &Pool, camera: &[[f32; 4]; 4]) {
        let Success(frame) = self.surface.get_current_texture() else { return };
        let buffer = |contents: &[u8], usage| {
            self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
        };
        let uniform = buffer(bytemuck::cast_slice(camera), BufferUsages::UNIFORM);
        let entries = [wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() }];
        let layout = &self.pipeline.get_bind_group_layout(0);
        let group =
            self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries });
        // One list of calls for each buffer, which the device reads by itself.
        let mut calls: HashMap<u64, Vec<[u32; 5]>> = HashMap::new();
        pool.places().for_each(|(_, place)| calls.entry(place.buffer).or_default().push(place.indirect(0)));
        let view = frame.texture.create_view(&Default::default());
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::WHITE), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        for (id, calls) in calls {
            let [vertices, indices] = &self.buffers[&id];
            let list = buffer(bytemuck::cast_slice(&calls), BufferUsages::INDIRECT);
            pass.set_vertex_buffer(0, vertices.slice(..));
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.multi_draw_indexed_indirect(&list, 0, calls.len() as u32);
        }
        drop(pass);
        self.queue.submit([encoder.finish()]);
        self.queue.present(frame);
    }
}

struct App {
    streamer: Streamer,
    bounds: [[f64; 3]; 2],
    pool: Pool,
    engine: Option<Engine>,
    begun: Instant,
}

impl App {
    fn frame(&mut self) -> Result<(), Box<dyn Error>> {
        let Some(engine) = &mut self.engine else { return Ok(()) };
        let viewport = [engine.config.width, engine.config.height];
        let whole = View::around(self.bounds, [0.0, 1.0, 0.0], 0.1 * self.begun.elapsed().as_secs_f64(), 0.3);
        let view = View { viewport, pixel_tolerance: 1.0, ..whole };
        let streamed = self.streamer.frame(&Query { view: Some(view), ..Query::default() })?;
        let uploads = self.pool.update(self.streamer.picture(), &streamed.frame.changes);
        engine.copy(&self.pool, &uploads);
        // Rows of the matrix from the pool's space to the picture: 1 is the near plane, 0 infinitely far.
        let from = DVec3::from(view.position) - DVec3::from(self.pool.origin());
        let scale = 1.0 / (0.5 * view.vertical_fov).tan();
        let [right, up, forward] = view.axes().map(|axis| DVec3::from(axis).extend(-DVec3::from(axis).dot(from)));
        let across = scale * f64::from(viewport[1]) / f64::from(viewport[0]);
        let rows = [right * across, up * scale, DVec4::W * view.near, forward];
        engine.draw(&self.pool, &rows.map(|row| row.as_vec4().to_array()));
        engine.window.request_redraw();
        Ok(())
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        self.engine = Engine::new(event_loop).inspect_err(|error| eprintln!("{error}")).ok();
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let is_over = event == WindowEvent::RedrawRequested && self.frame().is_err();
        if event == WindowEvent::CloseRequested || self.engine.is_none() || is_over {
            event_loop.exit();
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: engine model.lodpack")?;
    let file = File::open(Arc::new(std::fs::File::open(path)?), Limits::default())?;
    let bounds = file.bounds().ok_or("the file is empty")?;
    let session = Options { light: true, ..Options::default() };
    let streamer = file.streamer(StreamerOptions { session, ..StreamerOptions::default() })?;
    let pool = Pool::new(bounds[0], PoolOptions::default());
    Ok(EventLoop::new()?.run_app(&mut App { streamer, bounds, pool, engine: None, begun: Instant::now() })?)
}
