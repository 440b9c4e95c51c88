//! The device, pictures to draw into, and reading them back.

use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use wgpu::{
    Adapter, Buffer, BufferDescriptor, BufferUsages, Device, DeviceDescriptor, Extent3d, Instance, InstanceDescriptor,
    MapMode, PollType, Queue, RequestAdapterOptions, Surface, TexelCopyBufferInfo, TexelCopyBufferLayout, Texture,
    TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
};

use crate::picture::Picture;

/// Format of what is drawn: the numbers that are seen, without conversion.
pub const COLOUR: TextureFormat = TextureFormat::Rgba8Unorm;
/// Format of roots and depths.
pub const WHERE_FROM: TextureFormat = TextureFormat::Rg32Uint;
/// Format of the depth buffer; 1 is the near plane, 0 infinitely far.
pub const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// Format of the counter of the check for cracks.
pub const STENCIL: TextureFormat = TextureFormat::Stencil8;

/// A device to draw with.
pub struct Gpu {
    /// What the device was made from.
    pub adapter: Adapter,
    /// The device.
    pub device: Device,
    /// Its queue.
    pub queue: Queue,
    trouble: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// A device without a window.
    ///
    /// # Errors
    /// Where there is no adapter.
    pub fn headless() -> Result<Self> {
        Self::new(&Instance::new(InstanceDescriptor::new_without_display_handle_from_env()), None)
    }

    /// A device that can draw into a surface.
    ///
    /// # Errors
    /// Where there is no adapter.
    pub fn new(instance: &Instance, surface: Option<&Surface<'_>>) -> Result<Self> {
        let options = RequestAdapterOptions { compatible_surface: surface, ..Default::default() };
        let adapter = pollster::block_on(instance.request_adapter(&options)).context(
            "no graphics adapter: install a driver; without a GPU Mesa's lavapipe serves (Debian mesa-vulkan-drivers)",
        )?;
        let descriptor = DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).context("no graphics device")?;
        let trouble: Arc<Mutex<Option<String>>> = Arc::default();
        let note = |trouble: &Arc<Mutex<Option<String>>>, text: String| {
            trouble.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
        };
        let lost = trouble.clone();
        device.set_device_lost_callback(move |reason, text| note(&lost, format!("device lost ({reason:?}): {text}")));
        let wrong = trouble.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&wrong, format!("graphics: {error}"))));
        Ok(Self { adapter, device, queue, trouble })
    }

    /// What went wrong first, if anything did: the device is then of no use any more.
    pub fn trouble(&self) -> Option<String> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Name and driver, for reports.
    pub fn name(&self) -> String {
        let info = self.adapter.get_info();
        format!("{} ({:?}, {} {})", info.name, info.backend, info.driver, info.driver_info)
    }

    /// A buffer with contents; never empty, so that it can be bound.
    pub fn buffer<T: bytemuck::Pod>(&self, contents: &[T], usage: BufferUsages) -> Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let size = (bytes.len() as u64).max(64);
        let usage = usage | BufferUsages::COPY_DST;
        let buffer =
            self.device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// A texture to draw into and to read or to sample.
    pub fn texture(&self, size: [u32; 2], format: TextureFormat, usage: TextureUsages) -> Texture {
        self.device.create_texture(&TextureDescriptor {
            label: None,
            size: Extent3d { width: size[0].max(1), height: size[1].max(1), depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// Where the device is lost.
    pub fn wait(&self) -> Result<()> {
        self.device.poll(PollType::wait_indefinitely()).context("the graphics device does not answer")?;
        self.trouble().map_or(Ok(()), |text| bail!(text))
    }

    /// The bytes of a texture, row after row without padding.
    ///
    /// # Errors
    /// Where the device is lost.
    pub fn read(&self, texture: &Texture, texel_bytes: u32) -> Result<Vec<u8>> {
        let (width, height) = (texture.width(), texture.height());
        let row = width * texel_bytes;
        let padded = row.next_multiple_of(256);
        let buffer = self.device.create_buffer(&BufferDescriptor {
            label: None,
            size: u64::from(padded) * u64::from(height),
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
        let target = TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, texture.size());
        self.queue.submit([encoder.finish()]);
        buffer.slice(..).map_async(MapMode::Read, |_| ());
        self.wait()?;
        let mapped = buffer.slice(..).get_mapped_range().context("the picture cannot be read back")?;
        let rows = mapped.chunks(padded as usize).take(height as usize);
        Ok(rows.flat_map(|chunk| chunk[..row as usize].to_vec()).collect())
    }
}

/// Textures of one size that a picture is drawn into.
pub struct Targets {
    /// Width and height.
    pub size: [u32; 2],
    /// What is seen.
    pub colour: Texture,
    /// Root and depth.
    pub where_from: Texture,
    /// Front less back faces.
    pub stencil: Texture,
    /// Views of colour, roots, depth buffer and stencil.
    pub views: [TextureView; 4],
}

impl Targets {
    /// Targets of a size.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
        let colour = gpu.texture(size, COLOUR, usage | TextureUsages::TEXTURE_BINDING);
        let where_from = gpu.texture(size, WHERE_FROM, usage);
        let depth = gpu.texture(size, DEPTH, TextureUsages::RENDER_ATTACHMENT);
        let stencil = gpu.texture(size, STENCIL, usage);
        let views = [&colour, &where_from, &depth, &stencil].map(|texture| texture.create_view(&Default::default()));
        Self { size, colour, where_from, stencil, views }
    }

    /// Reads back what was drawn.
    ///
    /// # Errors
    /// Where the device is lost.
    pub fn read(&self, gpu: &Gpu) -> Result<Picture> {
        let colours = gpu.read(&self.colour, 4)?.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect();
        let words = |bytes: &[u8]| [0, 4].map(|at| u32::from_le_bytes([0, 1, 2, 3].map(|k| bytes[at + k])));
        let where_from: Vec<[u32; 2]> = gpu.read(&self.where_from, 8)?.chunks_exact(8).map(words).collect();
        Ok(Picture {
            size: self.size,
            colours,
            roots: where_from.iter().map(|[root, _]| root.checked_sub(1)).collect(),
            depths: where_from.iter().map(|[_, depth]| f32::from_bits(*depth)).collect(),
        })
    }
}
