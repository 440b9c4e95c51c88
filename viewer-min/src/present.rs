//! The window's side of drawing: a surface, the picture in it, and text over that.

use std::sync::Arc;

use anyhow::{Context, Result};
use winit::{event_loop::ActiveEventLoop, window::Window};

use crate::{
    camera::{Camera, Frame},
    draw::{Renderer, Style, Way},
    gpu::{Gpu, Targets},
    overlay::Canvas,
    pipelines::Pipelines,
};

/// Everything that is lost with the device.
pub struct Present {
    /// The device.
    pub gpu: Gpu,
    /// What draws roots.
    pub renderer: Renderer,
    /// What is drawn into; the last picture stays there.
    pub targets: Targets,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    pipelines: Arc<Pipelines>,
    overlay: (wgpu::RenderPipeline, wgpu::BindGroupLayout),
}

impl Present {
    /// Makes a device for a window.
    ///
    /// # Errors
    /// Where there is none.
    pub fn new(event_loop: &ActiveEventLoop, window: &Arc<Window>, way: Way) -> Result<Self> {
        let handle = Box::new(event_loop.owned_display_handle());
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_with_display_handle_from_env(handle));
        let surface = instance.create_surface(window.clone()).context("the window cannot be drawn into")?;
        let gpu = Gpu::new(&instance, Some(&surface))?;
        let size: [u32; 2] = window.inner_size().into();
        let mut config = surface
            .get_default_config(&gpu.adapter, size[0].max(1), size[1].max(1))
            .context("the graphics adapter cannot draw into this window")?;
        // Colours are stored as they are seen.
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        config.format = formats.iter().copied().find(|format| !format.is_srgb()).unwrap_or(config.format);
        surface.configure(&gpu.device, &config);
        let pipelines = Arc::new(Pipelines::new(&gpu));
        let overlay = pipelines.overlay(&gpu, config.format);
        let renderer = Renderer::new(&gpu, &pipelines, way);
        let targets = Targets::new(&gpu, size);
        Ok(Self { gpu, renderer, targets, surface, config, pipelines, overlay })
    }

    /// The window has another size; not zero.
    pub fn resize(&mut self, size: [u32; 2]) {
        [self.config.width, self.config.height] = size;
        self.surface.configure(&self.gpu.device, &self.config);
        self.targets = Targets::new(&self.gpu, size);
    }

    /// Draws roots in another way.
    pub fn set_way(&mut self, way: Way) {
        if self.renderer.way != way {
            self.renderer = Renderer::new(&self.gpu, &self.pipelines, way);
        }
    }

    /// Draws the roots anew.
    pub fn draw(&self, camera: &Camera, style: Style, scale: [f32; 2]) {
        let frame = Frame::whole(self.targets.size);
        self.renderer.look(&self.gpu, camera, frame, style, scale);
        self.renderer.draw(&self.gpu, &self.targets, frame);
    }

    /// Shows the last picture and what is written over it.
    pub fn show(&mut self, window: &Window, canvas: &Canvas) {
        use wgpu::CurrentSurfaceTexture as Current;
        let texture = match self.surface.get_current_texture() {
            Current::Success(texture) | Current::Suboptimal(texture) => texture,
            Current::Timeout | Current::Occluded => return,
            _ => {
                self.surface.configure(&self.gpu.device, &self.config);
                window.request_redraw();
                return;
            }
        };
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let text = self.gpu.texture(canvas.size, crate::gpu::COLOUR, usage);
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * text.width()), rows_per_image: None };
        let pixels: &[u8] = bytemuck::cast_slice(&canvas.pixels);
        self.gpu.queue.write_texture(text.as_image_copy(), pixels, layout, text.size());
        let (pipeline, group_layout) = &self.overlay;
        let groups = [&self.targets.colour, &text].map(|texture| {
            let view = texture.create_view(&Default::default());
            let entries = [wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) }];
            let descriptor = wgpu::BindGroupDescriptor { label: None, layout: group_layout, entries: &entries };
            self.gpu.device.create_bind_group(&descriptor)
        });
        let view = texture.texture.create_view(&Default::default());
        let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::WHITE), store: wgpu::StoreOp::Store };
        let attachment = wgpu::RenderPassColorAttachment { view: &view, depth_slice: None, resolve_target: None, ops };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let attachments = [Some(attachment)];
        let mut pass = encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor { color_attachments: &attachments, ..Default::default() });
        pass.set_pipeline(pipeline);
        for group in &groups {
            pass.set_bind_group(0, group, &[]);
            pass.draw(0..3, 0..1);
        }
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
        window.pre_present_notify();
        self.gpu.queue.present(texture);
    }
}
