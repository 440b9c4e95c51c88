//! Render pipelines: each program once for pictures and once for counting faces.

use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType, BufferBindingType, CompareFunction,
    DepthStencilState, Device, FragmentState, PipelineLayoutDescriptor, RenderPipeline, RenderPipelineDescriptor,
    ShaderStages, StencilFaceState, StencilOperation, StencilState, VertexBufferLayout, VertexState, VertexStepMode,
};

use crate::gpu::{COLOUR, DEPTH, STENCIL, WHERE_FROM};

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

impl Program {
    pub const ALL: [Self; 3] = [Self::Stitched, Self::Pulled, Self::PulledBorder];
}

pub struct Pipelines {
    /// By [`Program`]: for pictures, for counting.
    pub programs: [[RenderPipeline; 2]; 3],
    /// Group 0.
    pub globals_layout: BindGroupLayout,
    /// Group 1 of the pulled way.
    pub block_layout: BindGroupLayout,
}

impl Pipelines {
    /// Compiles everything.
    pub fn new(device: &Device) -> Self {
        let module = device.create_shader_module(wgpu::include_wgsl!("shader.wgsl"));
        let storage = BufferBindingType::Storage { read_only: true };
        let globals_layout = layout_of(device, &[BufferBindingType::Uniform, storage]);
        let block_layout = layout_of(device, &[storage; 4]);
        let groups = [Some(&globals_layout), Some(&block_layout)];
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3];
        let step_mode = VertexStepMode::Vertex;
        let vertices = [Some(VertexBufferLayout { array_stride: 24, step_mode, attributes: &attributes })];
        let depth_stencil = |format, depth_compare: Option<CompareFunction>, stencil| DepthStencilState {
            format,
            depth_write_enabled: depth_compare.map(|_| true),
            depth_compare,
            stencil,
            bias: Default::default(),
        };
        // Larger depths are nearer.
        let nearest = depth_stencil(DEPTH, Some(CompareFunction::Greater), Default::default());
        // Front faces count up, back faces down: zero everywhere where a closed surface is drawn without cracks.
        let face = |pass_op| StencilFaceState { compare: CompareFunction::Always, pass_op, ..Default::default() };
        let (front, back) = (face(StencilOperation::IncrementWrap), face(StencilOperation::DecrementWrap));
        let counting = depth_stencil(STENCIL, None, StencilState { front, back, read_mask: 0xff, write_mask: 0xff });
        let pipeline = |program: Program, counts: bool| {
            let (entry, group_count, buffers) = match program {
                Program::Stitched => ("stitched", 1, vertices.as_slice()),
                Program::Pulled => ("pulled", 2, [].as_slice()),
                Program::PulledBorder => ("pulled_border", 2, [].as_slice()),
            };
            let bind_group_layouts = &groups[..group_count];
            let layout =
                device.create_pipeline_layout(&PipelineLayoutDescriptor { bind_group_layouts, ..Default::default() });
            let fragment = FragmentState {
                module: &module,
                entry_point: Some("shade"),
                compilation_options: Default::default(),
                targets: &[Some(COLOUR.into()), Some(WHERE_FROM.into())],
            };
            device.create_render_pipeline(&RenderPipelineDescriptor {
                label: None,
                layout: Some(&layout),
                vertex: VertexState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    buffers,
                },
                primitive: Default::default(),
                depth_stencil: Some(if counts { counting.clone() } else { nearest.clone() }),
                multisample: Default::default(),
                fragment: (!counts).then_some(fragment),
                multiview_mask: None,
                cache: None,
            })
        };
        let programs = Program::ALL.map(|program| [false, true].map(|counts| pipeline(program, counts)));
        Self { programs, globals_layout, block_layout }
    }
}

/// A group of buffers.
fn layout_of(device: &Device, types: &[BufferBindingType]) -> BindGroupLayout {
    let entry = |(binding, &ty): (u32, &BufferBindingType)| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX_FRAGMENT,
        ty: BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let entries: Vec<BindGroupLayoutEntry> = (0..).zip(types).map(entry).collect();
    device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: None, entries: &entries })
}
