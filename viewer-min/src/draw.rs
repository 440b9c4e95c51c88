//! Drawing: pipelines, what each root has on the GPU, and one pass over all of it.

use std::collections::{BTreeMap, HashMap};

use anyhow::Result;
use glam::DVec3;
use lodpack::session::{DrawnRoot, Picture as Surfaces, Strip, Surface};
use std::sync::Arc;
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, Buffer, BufferUsages, Color, IndexFormat, LoadOp,
    Operations, RenderPass, RenderPassColorAttachment, RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp,
    TextureView,
};

use crate::{
    blocks::{Triangles, border_records, pair, snap_table},
    camera::{Camera, Frame},
    gpu::{Gpu, Targets},
    picture::{BACKGROUND, Picture},
    pipelines::{Pipelines, Program},
};

/// How roots become triangles on the screen (Niski 2007, sections 5.1.1 and 5.1.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Way {
    /// Index lists stitched on the CPU, with cached borders.
    #[default]
    Stitched,
    /// The vertex shader pulls block data and snaps borders.
    Pulled,
}

/// What colours mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Colouring {
    /// Light and shadow only.
    #[default]
    Plain,
    /// A colour for each root.
    Nodes,
    /// Blue is coarse, red fine.
    Levels,
    /// Green is below the tolerance, yellow at it, red above.
    Errors,
}

/// What is drawn beside the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Style {
    /// What colours mean.
    pub colouring: Colouring,
    /// Edges of triangles; drawn by pulling.
    pub wireframe: bool,
    /// Arcs; drawn by pulling.
    pub seams: bool,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Globals {
    axes: [[f32; 4]; 3],
    camera: [[f32; 4]; 2],
    projection: [f32; 4],
    scale: [f32; 4],
    mode: [u32; 4],
}

/// What the shader knows of a root.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct RootInfo {
    id: u32,
    level: u32,
    error: f32,
    padding: u32,
}

/// Indexed triangles on the GPU.
struct Batch {
    vertices: Buffer,
    indices: Buffer,
    index_count: u32,
}

impl Batch {
    fn new(gpu: &Gpu, triangles: &Triangles) -> Self {
        Self {
            vertices: gpu.buffer(&triangles.vertices, BufferUsages::VERTEX | BufferUsages::STORAGE),
            indices: gpu.buffer(&triangles.indices, BufferUsages::INDEX | BufferUsages::STORAGE),
            index_count: 3 * triangles.indices.len() as u32,
        }
    }
}

/// What there is of a root on the GPU.
struct Block {
    level: u32,
    strips: Vec<Arc<Strip>>,
    inside: Batch,
    /// The border of the stitched way.
    border: Option<Batch>,
    /// The border of the pulled way: its records, how many vertices are drawn, and everything bound.
    records: Vec<u32>,
    record_buffer: Option<Buffer>,
    pulled: Option<(BindGroup, u32)>,
}

/// Draws roots in one of the two ways, and meshes.
pub struct Renderer {
    /// How.
    pub way: Way,
    /// A planted fault: the border of this root is drawn elsewhere.
    pub shifted: Option<(u32, DVec3)>,
    pipelines: Arc<Pipelines>,
    globals: Buffer,
    roots: Buffer,
    infos: Vec<RootInfo>,
    globals_group: BindGroup,
    blocks: BTreeMap<u32, Block>,
    mesh: Option<Batch>,
}

impl Renderer {
    /// Nothing to draw yet.
    pub fn new(gpu: &Gpu, pipelines: &Arc<Pipelines>, way: Way) -> Self {
        let globals = gpu.buffer(&[0_u8; size_of::<Globals>()], BufferUsages::UNIFORM);
        let roots = gpu.buffer(&[0_u32; 4], BufferUsages::STORAGE);
        let globals_group = bind(gpu, &pipelines.globals_layout, &[&globals, &roots]);
        let (infos, blocks) = (Vec::new(), BTreeMap::new());
        Self {
            way,
            shifted: None,
            pipelines: pipelines.clone(),
            globals,
            roots,
            infos,
            globals_group,
            blocks,
            mesh: None,
        }
    }

    /// Draws these surfaces from now on. `error_of` says a root's certified error. Only what is new is sent.
    pub fn update(&mut self, gpu: &Gpu, surfaces: &Surfaces, error_of: impl Fn(&DrawnRoot) -> f64) {
        self.mesh = None;
        self.blocks.retain(|root, _| surfaces.root(*root).is_some());
        let mut arcs: Option<HashMap<u32, Vec<&Arc<Surface>>>> = None;
        for drawn in surfaces.roots() {
            let surface = &self.planted(&drawn.surface);
            let before = self.blocks.get(&surface.root).filter(|block| block.level == u32::from(surface.level));
            let same = |block: &Block| {
                let pairs = block.strips.iter().zip(&drawn.strips);
                block.strips.len() == drawn.strips.len() && pairs.into_iter().all(|(a, b)| Arc::ptr_eq(a, b))
            };
            if before.is_some_and(same) {
                continue;
            }
            if before.is_none() {
                self.blocks.insert(surface.root, self.block(gpu, surface));
            }
            let arcs = arcs.get_or_insert_with(|| arcs_of(surfaces));
            if let Some(block) = self.blocks.get_mut(&surface.root) {
                block.strips = drawn.strips.clone();
                match self.way {
                    Way::Stitched => {
                        let triangles = Triangles::of_strips(surface, drawn.strips.iter().map(|strip| &**strip));
                        block.border = Some(Batch::new(gpu, &triangles));
                    }
                    Way::Pulled => {
                        let finer = |arc: u32| {
                            let others = arcs.get(&arc).into_iter().flatten();
                            others.filter(|other| other.level > surface.level).map(|other| &***other).next()
                        };
                        let table = snap_table(surface, &block.records, finer);
                        block.snap(gpu, &self.pipelines.block_layout, &table);
                    }
                }
            }
        }
        self.infos = surfaces.roots().map(|drawn| RootInfo::new(&drawn.surface, error_of(drawn))).collect();
        self.send_infos(gpu);
    }

    fn planted(&self, surface: &Arc<Surface>) -> Arc<Surface> {
        let Some((_, by)) = self.shifted.filter(|(root, _)| *root == surface.root) else { return surface.clone() };
        let mut moved = Surface::clone(surface);
        let border_count = moved.keys.len();
        moved.positions[..border_count].iter_mut().for_each(|p| *p = (DVec3::from(*p) + by).into());
        Arc::new(moved)
    }

    /// Draws a mesh, as root 0 of level 0, instead.
    pub fn set_mesh(&mut self, gpu: &Gpu, triangles: &Triangles) {
        self.blocks.clear();
        self.mesh = Some(Batch::new(gpu, triangles));
        self.infos = vec![RootInfo { id: 0, level: 0, error: 0.0, padding: 0 }];
        self.send_infos(gpu);
    }

    fn block(&self, gpu: &Gpu, surface: &Surface) -> Block {
        let triangles = Triangles::of_mesh(&surface.positions, &surface.triangles);
        let records = if self.way == Way::Pulled { border_records(surface) } else { Vec::new() };
        let record_buffer = (self.way == Way::Pulled).then(|| gpu.buffer(&records, BufferUsages::STORAGE));
        let level = u32::from(surface.level);
        let inside = Batch::new(gpu, &triangles);
        Block { level, strips: Vec::new(), inside, border: None, records, record_buffer, pulled: None }
    }

    fn send_infos(&mut self, gpu: &Gpu) {
        let bytes = (self.infos.len() * size_of::<RootInfo>()) as u64;
        if bytes > self.roots.size() {
            let spare = RootInfo { id: 0, level: 0, error: 0.0, padding: 0 };
            let contents: Vec<RootInfo> =
                self.infos.iter().copied().chain(std::iter::repeat_n(spare, self.infos.len())).collect();
            self.roots = gpu.buffer(&contents, BufferUsages::STORAGE);
            self.globals_group = bind(gpu, &self.pipelines.globals_layout, &[&self.globals, &self.roots]);
        } else {
            gpu.queue.write_buffer(&self.roots, 0, bytemuck::cast_slice(&self.infos));
        }
    }

    /// Says where from the next passes look. `scale` is the tolerance in pixels and the number of levels.
    pub fn look(&self, gpu: &Gpu, camera: &Camera, frame: Frame, style: Style, scale: [f32; 2]) {
        let [right, up, forward] = camera.axes().map(|axis| wide(axis.as_vec3().into()));
        let p = pair(camera.position.into());
        let pixels = camera.pixels_per_tangent(frame.whole[1]);
        let [width, height] = frame.whole.map(f64::from);
        let globals = Globals {
            axes: [right, up, forward],
            camera: [wide([p[0], p[1], p[2]]), wide([p[3], p[4], p[5]])],
            projection: [
                (2.0 * pixels / width) as f32,
                (2.0 * pixels / height) as f32,
                camera.near as f32,
                pixels as f32,
            ],
            scale: [scale[0], scale[1], 0.0, 0.0],
            mode: [style.colouring as u32, u32::from(style.wireframe), u32::from(style.seams), 0],
        };
        gpu.queue.write_buffer(&self.globals, 0, bytemuck::bytes_of(&globals));
    }

    /// Draws a picture.
    pub fn draw(&self, gpu: &Gpu, targets: &Targets, frame: Frame) {
        let [colour, where_from, depth, _] = &targets.views;
        let [r, g, b] = BACKGROUND.map(|x| f64::from(x) / 255.0);
        let colours = [clear(colour, Color { r, g, b, a: 1.0 }), clear(where_from, Color::TRANSPARENT)];
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
            color_attachments: &colours,
            depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(Operations { load: LoadOp::Clear(0.0), store: StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        self.record(&mut pass, frame, false);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Counts front faces less back faces in every pixel, into the stencil; `is_first` begins with zero.
    pub fn count_faces(&self, gpu: &Gpu, targets: &Targets, frame: Frame, is_first: bool) {
        let load = if is_first { LoadOp::Clear(0) } else { LoadOp::Load };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
            depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                view: &targets.views[3],
                depth_ops: None,
                stencil_ops: Some(Operations { load, store: StoreOp::Store }),
            }),
            ..Default::default()
        });
        self.record(&mut pass, frame, true);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }

    fn record(&self, pass: &mut RenderPass<'_>, frame: Frame, counts: bool) {
        // A tile is a window onto the whole picture: its triangles fall onto the same places of the same pixels.
        let [x, y] = frame.origin.map(|at| -(at as f32));
        pass.set_viewport(x, y, frame.whole[0] as f32, frame.whole[1] as f32, 0.0, 1.0);
        pass.set_bind_group(0, &self.globals_group, &[]);
        let pipeline = |program: Program| &self.pipelines.programs[program as usize][usize::from(counts)];
        let indexed = |pass: &mut RenderPass<'_>, batch: &Batch, slot: u32| {
            pass.set_vertex_buffer(0, batch.vertices.slice(..));
            pass.set_index_buffer(batch.indices.slice(..), IndexFormat::Uint32);
            pass.draw_indexed(0..batch.index_count, 0, slot..slot + 1);
        };
        if self.way == Way::Stitched || self.mesh.is_some() {
            pass.set_pipeline(pipeline(Program::Stitched));
            for (slot, batch) in self.blocks.values().enumerate().flat_map(|(slot, block)| {
                [Some((slot as u32, &block.inside)), block.border.as_ref().map(|border| (slot as u32, border))]
                    .into_iter()
                    .flatten()
            }) {
                indexed(pass, batch, slot);
            }
            if let Some(mesh) = &self.mesh {
                indexed(pass, mesh, 0);
            }
            return;
        }
        for program in [Program::Pulled, Program::PulledBorder] {
            pass.set_pipeline(pipeline(program));
            for (slot, block) in (0..).zip(self.blocks.values()) {
                let Some((group, border_count)) = &block.pulled else { continue };
                pass.set_bind_group(1, group, &[]);
                let count = if program == Program::Pulled { block.inside.index_count } else { *border_count };
                pass.draw(0..count, slot..slot + 1);
            }
        }
    }

    /// Draws a picture and reads it back.
    ///
    /// # Errors
    /// Where the device is lost.
    pub fn picture(&self, gpu: &Gpu, targets: &Targets, camera: &Camera, style: Style) -> Result<Picture> {
        let frame = Frame::whole(targets.size);
        self.look(gpu, camera, frame, style, [1.0, 1.0]);
        self.draw(gpu, targets, frame);
        targets.read(gpu)
    }
}

impl Block {
    /// Binds a new table of what neighbours have.
    fn snap(&mut self, gpu: &Gpu, layout: &BindGroupLayout, table: &[u32]) {
        let Some(records) = &self.record_buffer else { return };
        let snap = gpu.buffer(table, BufferUsages::STORAGE);
        let places = table.first().copied().unwrap_or(1);
        let vertex_count = 3 * places * (self.records.len() / 12) as u32;
        let group = bind(gpu, layout, &[&self.inside.vertices, &self.inside.indices, records, &snap]);
        self.pulled = Some((group, vertex_count));
    }
}

impl RootInfo {
    fn new(surface: &Surface, error: f64) -> Self {
        Self { id: surface.root, level: u32::from(surface.level), error: error as f32, padding: 0 }
    }
}

/// The surfaces on both sides of each arc.
fn arcs_of(surfaces: &Surfaces) -> HashMap<u32, Vec<&Arc<Surface>>> {
    let mut arcs: HashMap<u32, Vec<&Arc<Surface>>> = HashMap::new();
    for drawn in surfaces.roots() {
        drawn.surface.half_arcs().for_each(|half_arc| arcs.entry(half_arc.arc).or_default().push(&drawn.surface));
    }
    arcs
}

fn wide([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 0.0]
}

fn clear(view: &TextureView, colour: Color) -> Option<RenderPassColorAttachment<'_>> {
    let ops = Operations { load: LoadOp::Clear(colour), store: StoreOp::Store };
    Some(RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
}

fn bind(gpu: &Gpu, layout: &BindGroupLayout, buffers: &[&Buffer]) -> BindGroup {
    let numbered = (0..).zip(buffers);
    let entries: Vec<BindGroupEntry<'_>> =
        numbered.map(|(binding, buffer)| BindGroupEntry { binding, resource: buffer.as_entire_binding() }).collect();
    gpu.device.create_bind_group(&BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// Middle of a box, and half its diagonal.
pub fn middle_of([low, high]: [[f64; 3]; 2]) -> (DVec3, f64) {
    let (low, high) = (DVec3::from(low), DVec3::from(high));
    ((low + high) / 2.0, (high - low).length() / 2.0)
}
