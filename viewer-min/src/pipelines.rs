//! Render pipelines: each program once for pictures and once for counting faces.

use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType, BlendState, BufferBindingType,
    ColorTargetState, CompareFunction, DepthStencilState, FragmentState, PipelineLayout, PipelineLayoutDescriptor,
    RenderPipeline, RenderPipelineDescriptor, ShaderModule, ShaderModuleDescriptor, ShaderSource, ShaderStages,
    StencilFaceState, StencilOperation, StencilState, TextureFormat, TextureSampleType, TextureViewDimension,
    VertexBufferLayout, VertexState, VertexStepMode,
};

use crate::gpu::{COLOUR, DEPTH, Gpu, STENCIL, WHERE_FROM};

/// Which vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// From vertex and index buffers.
    Stitched,
    /// Triangles inside, pulled.
    Pulled,
    /// Triangles at the border, pulled and snapped.
    PulledBorder,
}

/// All pipelines.
pub struct Pipelines {
    /// By [`Program`]: for pictures, for counting.
    pub programs: [[RenderPipeline; 2]; 3],
    /// Group 0.
    pub globals_layout: BindGroupLayout,
    /// Group 1 of the pulled way.
    pub block_layout: BindGroupLayout,
    module: ShaderModule,
}

impl Pipelines {
    /// Compiles everything.
    pub fn new(gpu: &Gpu) -> Self {
        let device = &gpu.device;
        let module = device.create_shader_module(ShaderModuleDescriptor {
            label: None,
            source: ShaderSource::Wgsl(include_str!("shader.wgsl").into()),
        });
        let storage = BufferBindingType::Storage { read_only: true };
        let globals_layout = buffers(gpu, &[BufferBindingType::Uniform, storage]);
        let block_layout = buffers(gpu, &[storage; 4]);
        let [plain, with_block] =
            [vec![Some(&globals_layout)], vec![Some(&globals_layout), Some(&block_layout)]].map(|bind_group_layouts| {
                let bind_group_layouts = bind_group_layouts.as_slice();
                device.create_pipeline_layout(&PipelineLayoutDescriptor { bind_group_layouts, ..Default::default() })
            });
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3];
        let vertices =
            [Some(VertexBufferLayout { array_stride: 24, step_mode: VertexStepMode::Vertex, attributes: &attributes })];
        let pipeline = |program: Program, counts: bool| {
            let (entry, layout, buffers) = match program {
                Program::Stitched => ("stitched", &plain, vertices.as_slice()),
                Program::Pulled => ("pulled", &with_block, [].as_slice()),
                Program::PulledBorder => ("pulled_border", &with_block, [].as_slice()),
            };
            let targets = [Some(ColorTargetState::from(COLOUR)), Some(ColorTargetState::from(WHERE_FROM))];
            let (targets, depth) = if counts { ([].as_slice(), counting()) } else { (targets.as_slice(), nearest()) };
            pipeline(gpu, layout, (&module, entry, buffers), Some(depth), ("shade", targets))
        };
        let programs = [Program::Stitched, Program::Pulled, Program::PulledBorder];
        let programs = programs.map(|program| [pipeline(program, false), pipeline(program, true)]);
        Self { programs, globals_layout, block_layout, module }
    }

    /// Puts one texture, pixel by pixel, over what is in a target of a format.
    pub fn overlay(&self, gpu: &Gpu, format: TextureFormat) -> (RenderPipeline, BindGroupLayout) {
        let entry = BindGroupLayoutEntry {
            binding: 0,
            visibility: ShaderStages::FRAGMENT,
            ty: BindingType::Texture {
                sample_type: TextureSampleType::Float { filterable: false },
                view_dimension: TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        };
        let descriptor = BindGroupLayoutDescriptor { label: None, entries: &[entry] };
        let layout = gpu.device.create_bind_group_layout(&descriptor);
        let bind_group_layouts = [Some(&layout)];
        let pipeline_layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
            bind_group_layouts: &bind_group_layouts,
            ..Default::default()
        });
        let target = ColorTargetState { blend: Some(BlendState::ALPHA_BLENDING), ..format.into() };
        let pipeline =
            pipeline(gpu, &pipeline_layout, (&self.module, "whole", &[]), None, ("overlay", &[Some(target)]));
        (pipeline, layout)
    }
}

/// A pipeline of vertices (module, entry, buffers), and of fragments (entry, targets) if it has targets.
fn pipeline(
    gpu: &Gpu,
    layout: &PipelineLayout,
    (module, vertex_entry, buffers): (&ShaderModule, &str, &[Option<VertexBufferLayout<'_>>]),
    depth_stencil: Option<DepthStencilState>,
    (fragment_entry, targets): (&str, &[Option<ColorTargetState>]),
) -> RenderPipeline {
    let compilation_options = wgpu::PipelineCompilationOptions::default;
    let fragment = FragmentState {
        module,
        entry_point: Some(fragment_entry),
        compilation_options: compilation_options(),
        targets,
    };
    gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
        label: None,
        layout: Some(layout),
        vertex: VertexState {
            module,
            entry_point: Some(vertex_entry),
            compilation_options: compilation_options(),
            buffers,
        },
        primitive: Default::default(),
        depth_stencil,
        multisample: Default::default(),
        fragment: (!targets.is_empty()).then_some(fragment),
        multiview_mask: None,
        cache: None,
    })
}

fn buffers(gpu: &Gpu, types: &[BufferBindingType]) -> BindGroupLayout {
    let entry = |(binding, &ty): (u32, &BufferBindingType)| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX_FRAGMENT,
        ty: BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let entries: Vec<BindGroupLayoutEntry> = (0..).zip(types).map(entry).collect();
    gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: None, entries: &entries })
}

/// Larger depths are nearer.
fn nearest() -> DepthStencilState {
    DepthStencilState {
        format: DEPTH,
        depth_write_enabled: Some(true),
        depth_compare: Some(CompareFunction::Greater),
        stencil: Default::default(),
        bias: Default::default(),
    }
}

/// Front faces count up, back faces down: zero everywhere where a closed surface is drawn without cracks.
fn counting() -> DepthStencilState {
    let face = |pass_op| StencilFaceState { compare: CompareFunction::Always, pass_op, ..Default::default() };
    DepthStencilState {
        format: STENCIL,
        depth_write_enabled: None,
        depth_compare: None,
        stencil: StencilState {
            front: face(StencilOperation::IncrementWrap),
            back: face(StencilOperation::DecrementWrap),
            read_mask: 0xff,
            write_mask: 0xff,
        },
        bias: Default::default(),
    }
}
