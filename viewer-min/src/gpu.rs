//! The graphics device, its pipelines, the textures that it draws into, and reading them back.

use std::sync::{Arc, OnceLock};

use anyhow::{Context, Result, bail};
use image::RgbaImage;
use wgpu::{BufferUsages, CompareFunction, StencilFaceState, StencilOperation, TextureFormat, TextureUsages};

use crate::picture::Picture;

/// Colours as seen, without conversion.
pub(crate) const COLOUR: TextureFormat = TextureFormat::Rgba8Unorm;
/// Root numbers and depths.
pub(crate) const WHERE_FROM: TextureFormat = TextureFormat::Rg32Uint;
/// The depth buffer; 1 is the near plane, 0 infinitely far.
pub(crate) const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// The counter for the check for cracks.
pub(crate) const STENCIL: TextureFormat = TextureFormat::Stencil8;

/// What gives out devices. Lists of draws are not checked on the device: the pool writes them, and knows where its
/// roots lie.
pub(crate) fn instance(mut descriptor: wgpu::InstanceDescriptor) -> wgpu::Instance {
    descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
    wgpu::Instance::new(descriptor)
}

/// A device for drawing.
pub struct Gpu {
    pub(crate) adapter: wgpu::Adapter,
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) pipelines: Pipelines,
    /// Whether one call draws a list of roots. Otherwise each is a call of its own.
    pub draws_lists: bool,
    trouble: Arc<OnceLock<String>>,
}

impl Gpu {
    /// A device without a window; an error if there is no adapter.
    pub fn headless() -> Result<Self> {
        Self::new(&instance(wgpu::InstanceDescriptor::new_without_display_handle_from_env()), None)
    }

    /// A device that can draw into a window surface.
    pub(crate) fn new(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Result<Self> {
        let options = wgpu::RequestAdapterOptions { compatible_surface: surface, ..Default::default() };
        let adapter = pollster::block_on(instance.request_adapter(&options)).context(
            "no graphics adapter: install a driver; without a GPU, Mesa's lavapipe works too (Debian: mesa-vulkan-drivers)",
        )?;
        let required_features = adapter.features() & wgpu::Features::INDIRECT_FIRST_INSTANCE;
        let reads_lists = adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::INDIRECT_EXECUTION);
        let draws_lists = reads_lists && !required_features.is_empty();
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
        Ok(Self { adapter, device, queue, pipelines, draws_lists, trouble })
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
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
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
        let [width, height] = size.map(|side| side.max(1));
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// Waits until all submitted work is done; an error if the device is lost.
    pub(crate) fn wait(&self) -> Result<()> {
        self.device.poll(wgpu::PollType::wait_indefinitely()).context("the graphics device does not answer")?;
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
}

impl Targets {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC | TextureUsages::TEXTURE_BINDING;
        let textures = [COLOUR, WHERE_FROM, DEPTH, STENCIL].map(|format| gpu.texture(size, format, usage));
        let views = textures.each_ref().map(|texture| texture.create_view(&Default::default()));
        Self { size, textures, views }
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

/// Render pipelines: each program once for pictures and once for counting faces.
pub(crate) struct Pipelines {
    /// From vertex and index buffers; inner triangles, pulled; border triangles, pulled and snapped. Each for pictures
    /// and for counting.
    pub programs: [[wgpu::RenderPipeline; 2]; 3],
    /// The same for roots with images; only for pictures.
    pub textured: [wgpu::RenderPipeline; 3],
    /// For tiles of heights with images.
    pub tile: wgpu::RenderPipeline,
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
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 3 => Uint32];
        let step_mode = wgpu::VertexStepMode::Vertex;
        let positions = wgpu::VertexBufferLayout { array_stride: 28, step_mode, attributes: &attributes };
        let attributes = wgpu::vertex_attr_array![2 => Uint32];
        let pieces = wgpu::VertexBufferLayout { array_stride: 4, step_mode, attributes: &attributes };
        let attributes = wgpu::vertex_attr_array![2 => Float32x2];
        let places = wgpu::VertexBufferLayout { array_stride: 8, step_mode, attributes: &attributes };
        let vertices = [Some(positions), Some(pieces)];
        let of_tiles = [vertices[0].clone(), Some(places)];
        let depth_stencil = |format, depth_compare: Option<CompareFunction>, stencil| wgpu::DepthStencilState {
            format,
            depth_write_enabled: depth_compare.map(|_| true),
            depth_compare,
            stencil,
            bias: Default::default(),
        };
        // Larger depths are nearer.
        let nearest = depth_stencil(DEPTH, Some(CompareFunction::Greater), Default::default());
        // Front faces count up, back faces down. Where a closed surface is drawn without cracks, the result is zero
        // everywhere.
        let face = |pass_op| StencilFaceState { compare: CompareFunction::Always, pass_op, ..Default::default() };
        let (front, back) = (face(StencilOperation::IncrementWrap), face(StencilOperation::DecrementWrap));
        let counting =
            depth_stencil(STENCIL, None, wgpu::StencilState { front, back, read_mask: 0xff, write_mask: 0xff });
        let pipeline = |entry: &str, counts: bool| {
            let is_tile = entry.ends_with("_tile");
            let (is_pulled, is_textured) = (entry.starts_with("pulled"), is_tile || entry.ends_with("_textured"));
            let vertices = if is_tile { &of_tiles } else { &vertices };
            let groups =
                [Some(&globals_layout), is_pulled.then_some(&block_layout), is_textured.then_some(&texels_layout)];
            let bind_group_layouts = &groups[..1 + usize::from(is_pulled).max(2 * usize::from(is_textured))];
            let layout = device
                .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor { bind_group_layouts, ..Default::default() });
            let fragment = wgpu::FragmentState {
                module: &module,
                entry_point: Some(if is_textured { "shade_textured" } else { "shade" }),
                compilation_options: Default::default(),
                targets: &[Some(COLOUR.into()), Some(WHERE_FROM.into())],
            };
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: None,
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    buffers: if is_pulled { &[] } else { &vertices[..1 + usize::from(is_textured)] },
                },
                primitive: Default::default(),
                depth_stencil: Some(if counts { counting.clone() } else { nearest.clone() }),
                multisample: Default::default(),
                fragment: (!counts).then_some(fragment),
                multiview_mask: None,
                cache: None,
            })
        };
        let programs =
            ["stitched", "pulled", "pulled_border"].map(|entry| [false, true].map(|counts| pipeline(entry, counts)));
        let textured = ["stitched_textured", "pulled_textured", "pulled_border_textured"];
        let textured = textured.map(|entry| pipeline(entry, false));
        let tile = pipeline("stitched_tile", false);
        Self { programs, textured, tile, globals_layout, block_layout, texels_layout, sampler }
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
