//! The window's side of drawing: a window surface, the picture in it, and text over the picture.

use std::sync::Arc;

use anyhow::{Context, Result};
use image::RgbaImage;
use wgpu::CurrentSurfaceTexture;
use winit::{event_loop::ActiveEventLoop, window::Window};

use crate::{
    args::Way,
    draw::Renderer,
    frames::{Frames, IN_FLIGHT},
    gpu::{self, COLOUR, Gpu, Targets},
};

/// Everything that is lost with the device.
pub struct Present {
    pub gpu: Arc<Gpu>,
    pub renderer: Renderer,
    pub frames: Frames,
    /// The textures that are drawn into. The last picture stays there.
    pub targets: Targets,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    blitter: wgpu::util::TextureBlitter,
}

/// The most images that a frame uploads: some milliseconds.
const IMAGES_PER_FRAME: usize = 8;

fn renderer(gpu: &Arc<Gpu>, way: Way) -> Renderer {
    let mut renderer = Renderer::new(gpu, way);
    renderer.images_per_frame = IMAGES_PER_FRAME;
    renderer
}

impl Present {
    pub fn new(event_loop: &ActiveEventLoop, window: &Arc<Window>, way: Way) -> Result<Self> {
        let handle = Box::new(event_loop.owned_display_handle());
        let instance = gpu::instance(wgpu::InstanceDescriptor::new_with_display_handle_from_env(handle));
        let surface = instance.create_surface(window.clone()).context("the window cannot be drawn into")?;
        let gpu = Arc::new(Gpu::new(&instance, Some(&surface))?);
        let size: [u32; 2] = window.inner_size().into();
        let [width, height] = size.map(|side| side.max(1));
        let config = surface.get_default_config(&gpu.adapter, width, height);
        let mut config = config.context("the graphics adapter cannot draw into this window")?;
        // Colours are stored as seen.
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        config.format = formats.iter().copied().find(|format| !format.is_srgb()).unwrap_or(config.format);
        surface.configure(&gpu.device, &config);
        let blitter = wgpu::util::TextureBlitterBuilder::new(&gpu.device, config.format);
        let blitter = blitter.blend_state(wgpu::BlendState::ALPHA_BLENDING).build();
        let (renderer, targets) = (renderer(&gpu, way), Targets::smooth(&gpu, size));
        let frames = Frames::new(&gpu, IN_FLIGHT);
        Ok(Self { gpu, renderer, frames, targets, surface, config, blitter })
    }

    /// Adapts to the sizes of the window, which is not zero, and of the picture, and to the way of drawing.
    pub fn adjust(&mut self, window: [u32; 2], picture: [u32; 2], way: Way) {
        if [self.config.width, self.config.height] != window {
            [self.config.width, self.config.height] = window;
            self.surface.configure(&self.gpu.device, &self.config);
        }
        if self.targets.size != picture {
            self.targets = Targets::smooth(&self.gpu, picture);
        }
        if self.renderer.way != way {
            self.renderer = renderer(&self.gpu, way);
        }
    }

    /// Shows the last picture with text over it.
    pub fn show(&mut self, window: &Window, canvas: &RgbaImage) {
        let frame = match self.surface.get_current_texture() {
            CurrentSurfaceTexture::Success(frame) | CurrentSurfaceTexture::Suboptimal(frame) => frame,
            CurrentSurfaceTexture::Timeout | CurrentSurfaceTexture::Occluded => return,
            _ => {
                self.surface.configure(&self.gpu.device, &self.config);
                window.request_redraw();
                return;
            }
        };
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let text = self.gpu.texture(canvas.dimensions().into(), COLOUR, usage);
        let bytes_per_row = Some(4 * text.width());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
        self.gpu.queue.write_texture(text.as_image_copy(), canvas, layout, text.size());
        let target = frame.texture.create_view(&Default::default());
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        for source in [&self.targets.views[0], &text.create_view(&Default::default())] {
            self.blitter.copy(&self.gpu.device, &mut encoder, source, &target);
        }
        self.gpu.queue.submit([encoder.finish()]);
        window.pre_present_notify();
        self.gpu.queue.present(frame);
    }
}
