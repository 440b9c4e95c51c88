//! The device, pictures to draw into, and reading them back.

use std::sync::{Arc, OnceLock};

use anyhow::{Context, Result, bail};
use wgpu::{
    Adapter, BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, Buffer, BufferDescriptor, BufferUsages,
    Device, DeviceDescriptor, Extent3d, Instance, InstanceDescriptor, MapMode, PollType, Queue, RequestAdapterOptions,
    Surface, TexelCopyBufferInfo, TexelCopyBufferLayout, Texture, TextureDescriptor, TextureDimension, TextureFormat,
    TextureUsages, TextureView,
};

use crate::{picture::Picture, pipelines::Pipelines};

/// What is drawn: the numbers that are seen, without conversion.
pub(crate) const COLOUR: TextureFormat = TextureFormat::Rgba8Unorm;
/// Roots and depths.
pub(crate) const WHERE_FROM: TextureFormat = TextureFormat::Rg32Uint;
/// The depth buffer; 1 is the near plane, 0 infinitely far.
pub(crate) const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// The counter of the check for cracks.
pub(crate) const STENCIL: TextureFormat = TextureFormat::Stencil8;

/// A device to draw with.
pub struct Gpu {
    pub(crate) adapter: Adapter,
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    pub(crate) pipelines: Pipelines,
    trouble: Arc<OnceLock<String>>,
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
    pub(crate) fn new(instance: &Instance, surface: Option<&Surface<'_>>) -> Result<Self> {
        let options = RequestAdapterOptions { compatible_surface: surface, ..Default::default() };
        let adapter = pollster::block_on(instance.request_adapter(&options)).context(
            "no graphics adapter: install a driver; without a GPU Mesa's lavapipe serves (Debian mesa-vulkan-drivers)",
        )?;
        let descriptor = DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).context("no graphics device")?;
        // Only the first is kept: others follow from it.
        let trouble: Arc<OnceLock<String>> = Arc::default();
        let (lost, wrong) = (trouble.clone(), trouble.clone());
        device.set_device_lost_callback(move |reason, text| {
            let _ = lost.set(format!("device lost ({reason:?}): {text}"));
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = wrong.set(format!("graphics: {error}"));
        }));
        let pipelines = Pipelines::new(&device);
        Ok(Self { adapter, device, queue, pipelines, trouble })
    }

    /// What went wrong first, if anything did: the device is then of no use any more.
    pub(crate) fn trouble(&self) -> Option<String> {
        self.trouble.get().cloned()
    }

    /// Name and driver, for reports.
    pub(crate) fn name(&self) -> String {
        let info = self.adapter.get_info();
        format!("{} ({:?}, {} {})", info.name, info.backend, info.driver, info.driver_info)
    }

    /// A buffer with contents; never empty, so that it can be bound.
    pub(crate) fn buffer<T: bytemuck::Pod>(&self, contents: &[T], usage: BufferUsages) -> Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let (size, usage) = ((bytes.len() as u64).max(64), usage | BufferUsages::COPY_DST);
        let descriptor = BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
        let buffer = self.device.create_buffer(&descriptor);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    pub(crate) fn bind(&self, layout: &BindGroupLayout, buffers: &[&Buffer]) -> BindGroup {
        let numbered = (0..).zip(buffers);
        let entries: Vec<BindGroupEntry<'_>> = numbered
            .map(|(binding, buffer)| BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        self.device.create_bind_group(&BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    pub(crate) fn texture(&self, [width, height]: [u32; 2], format: TextureFormat, usage: TextureUsages) -> Texture {
        self.device.create_texture(&TextureDescriptor {
            label: None,
            size: Extent3d { width: width.max(1), height: height.max(1), depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// Waits until everything submitted is done; an error where the device is lost.
    pub(crate) fn wait(&self) -> Result<()> {
        self.device.poll(PollType::wait_indefinitely()).context("the graphics device does not answer")?;
        self.trouble().map_or(Ok(()), |text| bail!(text))
    }

    /// The texels of a texture, row after row without padding.
    pub(crate) fn read<T: bytemuck::Pod>(&self, texture: &Texture) -> Result<Vec<T>> {
        let row = texture.width() * size_of::<T>() as u32;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&BufferDescriptor {
            label: None,
            size: u64::from(padded) * u64::from(texture.height()),
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
        let rows = mapped.chunks(padded as usize).map(|padded| &padded[..row as usize]);
        Ok(rows.flat_map(bytemuck::pod_collect_to_vec::<u8, T>).collect())
    }
}

/// Textures of one size that a picture is drawn into.
pub(crate) struct Targets {
    pub size: [u32; 2],
    /// Colour, roots and depths, depth buffer, stencil.
    pub textures: [Texture; 4],
    pub views: [TextureView; 4],
}

impl Targets {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING;
        let textures = [COLOUR, WHERE_FROM, DEPTH, STENCIL].map(|format| gpu.texture(size, format, usage));
        let views = textures.each_ref().map(|texture| texture.create_view(&Default::default()));
        Self { size, textures, views }
    }

    /// Reads back what was drawn.
    pub fn read(&self, gpu: &Gpu) -> Result<Picture> {
        let [colours, where_from, ..] = &self.textures;
        let colours: Vec<[u8; 4]> = gpu.read(colours)?;
        let where_from: Vec<[u32; 2]> = gpu.read(where_from)?;
        Ok(Picture {
            size: self.size,
            colours: colours.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            roots: where_from.iter().map(|[root, _]| root.checked_sub(1)).collect(),
            depths: where_from.iter().map(|[_, depth]| f32::from_bits(*depth)).collect(),
        })
    }
}
