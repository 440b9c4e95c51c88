//! The graphics device, its pipelines, the textures that it draws into, and reading them back.

use std::{
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};
use image::RgbaImage;
use wgpu::{
    BufferUsages, CompareFunction, StencilFaceState, StencilOperation, SubmissionIndex, TextureFormat,
    TextureFormatFeatureFlags, TextureUsages,
};

use crate::picture::Picture;

/// Colours as seen, without conversion.
pub(crate) const COLOUR: TextureFormat = TextureFormat::Rgba8Unorm;
/// Root numbers and depths.
pub(crate) const WHERE_FROM: TextureFormat = TextureFormat::Rg32Uint;
/// The depth buffer; 1 is the near plane, 0 infinitely far.
pub(crate) const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// The counter for the check for cracks.
pub(crate) const STENCIL: TextureFormat = TextureFormat::Stencil8;
/// Samples of a pixel where edges are smooth: what every device has.
const SAMPLES: u32 = 4;

/// What gives out devices. Lists of draws are not checked on the device: the pool writes them, and knows where its
/// roots lie.
pub(crate) fn instance(mut descriptor: wgpu::InstanceDescriptor) -> wgpu::Instance {
    descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
    wgpu::Instance::new(descriptor)
}

const NO_ADAPTER: &str =
    "no graphics adapter: install a driver; without a GPU, Mesa's lavapipe works too (Debian: mesa-vulkan-drivers)";

/// Which of several adapters are taken together: those of the best kind.
fn worth(info: &wgpu::AdapterInfo) -> u8 {
    match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 3,
        wgpu::DeviceType::IntegratedGpu | wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Cpu => 1,
        wgpu::DeviceType::Other => 0,
    }
}

/// A device for drawing.
pub struct Gpu {
    pub(crate) adapter: wgpu::Adapter,
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) pipelines: Pipelines,
    /// Whether edges can be smoothed: pixels of four samples, which become one.
    can_smooth: bool,
    /// Whether one call draws a list of roots. Otherwise each is a call of its own.
    pub draws_lists: bool,
    /// Whether it says when it begins and ends.
    pub(crate) has_clock: bool,
    uploaded: AtomicU64,
    last: Mutex<Option<SubmissionIndex>>,
    /// Nanoseconds.
    waited: AtomicU64,
    trouble: Arc<OnceLock<String>>,
}

impl Gpu {
    /// A device without a window; an error if there is no adapter.
    pub fn headless() -> Result<Self> {
        Self::new(&instance(wgpu::InstanceDescriptor::new_without_display_handle_from_env()), None)
    }

    /// One of several devices without a window: of adapter after adapter, the best kind first, and of each again where
    /// there are fewer.
    pub(crate) fn numbered(number: usize) -> Result<Self> {
        // Devices of one instance may share what draws; those of two do not.
        let instance = instance(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        adapters.sort_by_key(|adapter| std::cmp::Reverse(worth(&adapter.get_info())));
        let best = adapters.first().map(|adapter| worth(&adapter.get_info()));
        adapters.retain(|adapter| Some(worth(&adapter.get_info())) == best);
        let count = adapters.len().max(1);
        Self::of(adapters.into_iter().nth(number % count).context(NO_ADAPTER)?)
    }

    /// A device that can draw into a window surface.
    pub(crate) fn new(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Result<Self> {
        let options = wgpu::RequestAdapterOptions { compatible_surface: surface, ..Default::default() };
        Self::of(pollster::block_on(instance.request_adapter(&options)).context(NO_ADAPTER)?)
    }

    fn of(adapter: wgpu::Adapter) -> Result<Self> {
        let clock = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
        let required_features = adapter.features() & (wgpu::Features::INDIRECT_FIRST_INSTANCE | clock);
        let reads_lists = adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::INDIRECT_EXECUTION);
        let draws_lists = reads_lists && required_features.contains(wgpu::Features::INDIRECT_FIRST_INSTANCE);
        // With lavapipe each submission waits for the one before, so none is spent on times.
        let is_cpu = adapter.get_info().device_type == wgpu::DeviceType::Cpu;
        let has_clock = required_features.contains(clock) && !is_cpu;
        let descriptor =
            wgpu::DeviceDescriptor { required_features, required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).context("no graphics device")?;
        // Keep only the first error: others follow from it.
        let trouble: Arc<OnceLock<String>> = Arc::default();
        let (lost, wrong) = (trouble.clone(), trouble.clone());
        device.set_device_lost_callback(move |reason, text| {
            let _ = lost.set(format!("device lost ({reason:?}): {text}"));
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = wrong.set(format!("graphics: {error}"));
        }));
        let pipelines = Pipelines::new(&device);
        let has = |format, flags| adapter.get_texture_format_features(format).flags.contains(flags);
        let four = TextureFormatFeatureFlags::MULTISAMPLE_X4;
        let can_smooth = has(COLOUR, four | TextureFormatFeatureFlags::MULTISAMPLE_RESOLVE) && has(DEPTH, four);
        let (uploaded, last, waited) = (AtomicU64::new(0), Mutex::default(), AtomicU64::new(0));
        Ok(Self {
            adapter,
            device,
            queue,
            pipelines,
            can_smooth,
            draws_lists,
            has_clock,
            uploaded,
            last,
            waited,
            trouble,
        })
    }

    /// An error if anything has gone wrong so far. The device cannot be used any more then.
    pub(crate) fn check(&self) -> Result<()> {
        self.trouble.get().map_or(Ok(()), |text| bail!(text.clone()))
    }

    /// Name and driver, for reports.
    pub(crate) fn name(&self) -> String {
        let info = self.adapter.get_info();
        format!("{} ({:?}, {} {})", info.name, info.backend, info.driver, info.driver_info)
    }

    /// A buffer with contents. It is never empty, because empty buffers cannot be bound.
    pub(crate) fn buffer<T: bytemuck::Pod>(&self, contents: &[T], usage: BufferUsages) -> wgpu::Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let buffer = self.empty_buffer((bytes.len() as u64).max(64), usage | BufferUsages::COPY_DST);
        self.write(&buffer, 0, bytes);
        buffer
    }

    /// Uploads bytes to a place in a buffer.
    pub(crate) fn write(&self, buffer: &wgpu::Buffer, at: u64, bytes: &[u8]) {
        self.uploaded.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        self.queue.write_buffer(buffer, at, bytes);
    }

    /// Uploads all texels of a texture, row after row.
    pub(crate) fn write_texels(&self, texture: &wgpu::Texture, texels: &[u8]) {
        self.uploaded.fetch_add(texels.len() as u64, Ordering::Relaxed);
        let bytes_per_row = Some(texels.len() as u32 / texture.height().max(1));
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
        self.queue.write_texture(texture.as_image_copy(), texels, layout, texture.size());
    }

    /// The bytes that were uploaded so far.
    pub(crate) fn uploaded(&self) -> u64 {
        self.uploaded.load(Ordering::Relaxed)
    }

    pub(crate) fn empty_buffer(&self, size: u64, usage: BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    }

    pub(crate) fn bind(&self, layout: &wgpu::BindGroupLayout, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let numbered = (0..).zip(buffers);
        let entries: Vec<_> = numbered
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    /// A bind group of resources of any kind.
    pub(crate) fn bind_all<'r>(
        &'r self,
        layout: &wgpu::BindGroupLayout,
        resources: &[Resource<'r>],
    ) -> wgpu::BindGroup {
        let resource = |resource: &Resource<'r>| match *resource {
            Resource::Buffer(buffer) => buffer.as_entire_binding(),
            Resource::Texture(view) => wgpu::BindingResource::TextureView(view),
            Resource::Sampler => wgpu::BindingResource::Sampler(&self.pipelines.sampler),
        };
        let numbered = (0..).zip(resources);
        let entries: Vec<wgpu::BindGroupEntry<'_>> =
            numbered.map(|(binding, of)| wgpu::BindGroupEntry { binding, resource: resource(of) }).collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    pub(crate) fn texture(&self, size: [u32; 2], format: TextureFormat, usage: TextureUsages) -> wgpu::Texture {
        self.sampled(size, format, usage, 1)
    }

    /// A texture whose texels have several samples.
    fn sampled(&self, size: [u32; 2], format: TextureFormat, usage: TextureUsages, sample_count: u32) -> wgpu::Texture {
        let [width, height] = size.map(|side| side.max(1));
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// Hands over what draws a picture.
    ///
    /// # Errors
    /// If the device is lost.
    pub(crate) fn submit(&self, encoder: wgpu::CommandEncoder) -> Result<()> {
        let buffer = encoder.finish();
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if !self.has_clock
            && let Some(before) = last.take()
        {
            // Lavapipe would do that, too, and it would count as work of the processor.
            let begun = Instant::now();
            self.wait_for(before)?;
            self.waited.fetch_add(begun.elapsed().as_nanos() as u64, Ordering::Relaxed);
        }
        *last = Some(self.queue.submit([buffer]));
        Ok(())
    }

    /// What was handed over last.
    pub(crate) fn last_submission(&self) -> Option<SubmissionIndex> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// How long pictures waited for those before them since the last call.
    pub(crate) fn take_waited(&self) -> Duration {
        Duration::from_nanos(self.waited.swap(0, Ordering::Relaxed))
    }

    /// Waits until something is done that was handed over; an error if the device is lost.
    pub(crate) fn wait_for(&self, submission: SubmissionIndex) -> Result<()> {
        self.wait_until(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None })
    }

    /// Waits until all submitted work is done; an error if the device is lost.
    pub(crate) fn wait(&self) -> Result<()> {
        self.wait_until(wgpu::PollType::wait_indefinitely())
    }

    fn wait_until(&self, until: wgpu::PollType) -> Result<()> {
        self.device.poll(until).context("the graphics device does not answer")?;
        self.check()
    }

    /// The texels of a texture, row after row, without padding.
    pub(crate) fn read<T: bytemuck::Pod>(&self, texture: &wgpu::Texture) -> Result<Vec<T>> {
        let row = texture.width() * size_of::<T>() as u32;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let size = u64::from(padded) * u64::from(texture.height());
        let buffer = self.empty_buffer(size, BufferUsages::COPY_DST | BufferUsages::MAP_READ);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
        let target = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, texture.size());
        self.queue.submit([encoder.finish()]);
        buffer.slice(..).map_async(wgpu::MapMode::Read, |_| ());
        self.wait()?;
        let mapped = buffer.slice(..).get_mapped_range().context("the picture cannot be read back")?;
        let rows = mapped.chunks(padded as usize).map(|padded| &padded[..row as usize]);
        Ok(rows.flat_map(bytemuck::pod_collect_to_vec::<u8, T>).collect())
    }
}

/// What a shader reads.
pub(crate) enum Resource<'r> {
    Buffer(&'r wgpu::Buffer),
    Texture(&'r wgpu::TextureView),
    /// The one that interpolates.
    Sampler,
}

/// Textures of equal size, into which a picture is drawn.
pub(crate) struct Targets {
    pub size: [u32; 2],
    /// Colours, roots and depths, depth buffer, stencil.
    pub textures: [wgpu::Texture; 4],
    pub views: [wgpu::TextureView; 4],
    /// Colours and depth buffer of four samples a pixel: what is drawn first, where edges are smooth. Then no roots and
    /// depths are drawn.
    pub smooth: Option<[wgpu::TextureView; 2]>,
}

impl Targets {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING;
        let textures = [COLOUR, WHERE_FROM, DEPTH, STENCIL].map(|format| gpu.texture(size, format, usage));
        let views = textures.each_ref().map(|texture| texture.create_view(&Default::default()));
        Self { size, textures, views, smooth: None }
    }

    /// With smooth edges, if the device can do that.
    pub fn smooth(gpu: &Gpu, size: [u32; 2]) -> Self {
        let sampled = |format| {
            let texture = gpu.sampled(size, format, TextureUsages::RENDER_ATTACHMENT, SAMPLES);
            texture.create_view(&Default::default())
        };
        let smooth = gpu.can_smooth.then(|| [COLOUR, DEPTH].map(sampled));
        Self { smooth, ..Self::new(gpu, size) }
    }

    /// The current picture.
    pub fn colours(&self, gpu: &Gpu) -> Result<RgbaImage> {
        let [width, height] = self.size;
        let pixels = gpu.read::<[u8; 4]>(&self.textures[0])?.into_flattened();
        RgbaImage::from_raw(width, height, pixels).context("the picture has another size")
    }

    pub fn read(&self, gpu: &Gpu) -> Result<Picture> {
        let where_from: Vec<[u32; 2]> = gpu.read(&self.textures[1])?;
        Ok(Picture {
            colours: self.colours(gpu)?,
            roots: where_from.iter().map(|[root, _]| root.checked_sub(1)).collect(),
            depths: where_from.iter().map(|[_, depth]| f32::from_bits(*depth)).collect(),
        })
    }
}

/// What a pass draws into.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Drawing {
    /// Colours, roots and depths.
    Exact,
    /// Colours of several samples.
    Smooth,
    /// The counter of faces.
    Counting,
}

/// Render pipelines for one drawing.
pub(crate) struct Programs {
    /// From vertex and index buffers; inner triangles, pulled; border triangles, pulled and snapped.
    pub plain: [wgpu::RenderPipeline; 3],
    /// The same for roots with images, and one for tiles of heights with images; none where faces are counted.
    pub textured: Option<[wgpu::RenderPipeline; 3]>,
    pub tile: Option<wgpu::RenderPipeline>,
}

/// Render pipelines, and what they have in common.
pub(crate) struct Pipelines {
    pub exact: Programs,
    pub counting: Programs,
    /// Made when something is drawn with smooth edges.
    smooth: OnceLock<Programs>,
    device: wgpu::Device,
    module: wgpu::ShaderModule,
    /// Bind group 0.
    pub globals_layout: wgpu::BindGroupLayout,
    /// Bind group 1 of pulling.
    pub block_layout: wgpu::BindGroupLayout,
    /// Bind group 2 of roots with images.
    pub texels_layout: wgpu::BindGroupLayout,
    pub sampler: wgpu::Sampler,
}

impl Pipelines {
    pub fn new(device: &wgpu::Device) -> Self {
        let module = device.create_shader_module(wgpu::include_wgsl!("shader.wgsl"));
        let storage = wgpu::BufferBindingType::Storage { read_only: true };
        let globals_layout = layout_of(device, &[wgpu::BufferBindingType::Uniform, storage]);
        let block_layout = layout_of(device, &[storage; 4]);
        let texels_layout = texels_layout(device);
        let interpolated = wgpu::FilterMode::Linear;
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: interpolated,
            min_filter: interpolated,
            ..Default::default()
        });
        let layouts = [&globals_layout, &block_layout, &texels_layout];
        let [exact, counting] =
            [Drawing::Exact, Drawing::Counting].map(|drawing| Programs::new(device, &module, layouts, drawing));
        let (device, smooth) = (device.clone(), OnceLock::new());
        Self { exact, counting, smooth, device, module, globals_layout, block_layout, texels_layout, sampler }
    }

    /// Those for smooth edges.
    pub fn smooth(&self) -> &Programs {
        let layouts = [&self.globals_layout, &self.block_layout, &self.texels_layout];
        self.smooth.get_or_init(|| Programs::new(&self.device, &self.module, layouts, Drawing::Smooth))
    }
}

impl Programs {
    fn new(
        device: &wgpu::Device,
        module: &wgpu::ShaderModule,
        layouts: [&wgpu::BindGroupLayout; 3],
        drawing: Drawing,
    ) -> Self {
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 3 => Uint32];
        let step_mode = wgpu::VertexStepMode::Vertex;
        let positions = wgpu::VertexBufferLayout { array_stride: 28, step_mode, attributes: &attributes };
        let attributes = wgpu::vertex_attr_array![2 => Uint32];
        let pieces = wgpu::VertexBufferLayout { array_stride: 4, step_mode, attributes: &attributes };
        let attributes = wgpu::vertex_attr_array![2 => Float32x2];
        let places = wgpu::VertexBufferLayout { array_stride: 8, step_mode, attributes: &attributes };
        let vertices = [Some(positions), Some(pieces)];
        let of_tiles = [vertices[0].clone(), Some(places)];
        let depth_stencil = drawing.depth_stencil();
        let targets = [Some(COLOUR.into()), Some(WHERE_FROM.into())];
        let count = if drawing == Drawing::Smooth { SAMPLES } else { 1 };
        let pipeline = |entry: &str| {
            let is_tile = entry.ends_with("_tile");
            let (is_pulled, is_textured) = (entry.starts_with("pulled"), is_tile || entry.ends_with("_textured"));
            let vertices = if is_tile { &of_tiles } else { &vertices };
            let [globals, block, texels] = layouts;
            let groups = [Some(globals), is_pulled.then_some(block), is_textured.then_some(texels)];
            let bind_group_layouts = &groups[..1 + usize::from(is_pulled).max(2 * usize::from(is_textured))];
            let layout = device
                .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor { bind_group_layouts, ..Default::default() });
            let fragment = wgpu::FragmentState {
                module,
                entry_point: Some(if is_textured { "shade_textured" } else { "shade" }),
                compilation_options: Default::default(),
                targets: if drawing == Drawing::Smooth { &targets[..1] } else { &targets },
            };
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: None,
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    buffers: if is_pulled { &[] } else { &vertices[..1 + usize::from(is_textured)] },
                },
                primitive: Default::default(),
                depth_stencil: Some(depth_stencil.clone()),
                multisample: wgpu::MultisampleState { count, ..Default::default() },
                fragment: (drawing != Drawing::Counting).then_some(fragment),
                multiview_mask: None,
                cache: None,
            })
        };
        let plain = ["stitched", "pulled", "pulled_border"].map(pipeline);
        let draws_images = drawing != Drawing::Counting;
        let textured = ["stitched_textured", "pulled_textured", "pulled_border_textured"];
        let textured = draws_images.then(|| textured.map(pipeline));
        Self { plain, textured, tile: draws_images.then(|| pipeline("stitched_tile")) }
    }
}

impl Drawing {
    fn depth_stencil(self) -> wgpu::DepthStencilState {
        let state = |format, depth_compare: Option<CompareFunction>, stencil| wgpu::DepthStencilState {
            format,
            depth_write_enabled: depth_compare.map(|_| true),
            depth_compare,
            stencil,
            bias: Default::default(),
        };
        if self != Self::Counting {
            // Larger depths are nearer.
            return state(DEPTH, Some(CompareFunction::Greater), Default::default());
        }
        // Front faces count up, back faces down. Where a closed surface is drawn without cracks, the result is zero
        // everywhere.
        let face = |pass_op| StencilFaceState { compare: CompareFunction::Always, pass_op, ..Default::default() };
        let (front, back) = (face(StencilOperation::IncrementWrap), face(StencilOperation::DecrementWrap));
        state(STENCIL, None, wgpu::StencilState { front, back, read_mask: 0xff, write_mask: 0xff })
    }
}

/// The layout of a bind group of buffers.
fn layout_of(device: &wgpu::Device, types: &[wgpu::BufferBindingType]) -> wgpu::BindGroupLayout {
    let entry = |(binding, &ty): (u32, &wgpu::BufferBindingType)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let entries: Vec<wgpu::BindGroupLayoutEntry> = (0..).zip(types).map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}

/// The layout of a root's pieces, image, labels and normals.
fn texels_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let storage = wgpu::BufferBindingType::Storage { read_only: true };
    let buffer = wgpu::BindingType::Buffer { ty: storage, has_dynamic_offset: false, min_binding_size: None };
    let sample_type = wgpu::TextureSampleType::Float { filterable: true };
    let view_dimension = wgpu::TextureViewDimension::D2;
    let types = [
        buffer,
        wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false },
        wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
        buffer,
        wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false },
    ];
    let visibility = wgpu::ShaderStages::VERTEX_FRAGMENT;
    let entry = |(binding, ty)| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let entries: Vec<_> = (0..).zip(types).map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}
