//! Drawing: what each root has on the GPU, and one pass over all of it.

use std::{collections::BTreeMap, sync::Arc, time::Instant};

use anyhow::Result;
use glam::DVec3;
use lodpack::session::{Picture as Surfaces, Strip, Surface};
use wgpu::{
    BindGroup, Buffer, BufferUsages, Color, IndexFormat, LoadOp, Operations, RenderPass, RenderPassColorAttachment,
    RenderPassDepthStencilAttachment, RenderPassDescriptor, StoreOp, TextureView,
};

use crate::{
    args::{Overlay, Way},
    blocks::{RECORD, Triangles, border_records, snap_table},
    camera::{Camera, Frame, pair},
    gpu::{Gpu, Targets},
    picture::{BACKGROUND, Picture},
    pipelines::Program,
    scene::{Report, Scene, milliseconds},
};

/// From where something is drawn, and how.
pub struct Look<'o> {
    pub camera: Camera,
    pub frame: Frame,
    pub overlays: &'o [Overlay],
    /// What colours of errors mean.
    pub tolerance_px: f64,
    /// What colours of levels mean.
    pub level_count: usize,
}

impl Look<'_> {
    /// A whole picture of the surface alone.
    pub fn plain(camera: Camera, size: [u32; 2]) -> Self {
        Self { camera, frame: Frame::whole(size), overlays: &[], tolerance_px: 1.0, level_count: 1 }
    }
}

/// From where and how, as the shader has it.
type Globals = [[f32; 4]; 8];
/// What the shader knows of a root: number, level, bits of the error.
type RootInfo = [u32; 4];

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
    info: RootInfo,
    strips: Vec<Arc<Strip>>,
    /// All of it, or what is inside where the border is pulled.
    batch: Batch,
    /// For pulling: everything bound, and how many vertices the border has.
    pulled: Option<(BindGroup, u32)>,
}

/// No root: a mesh that is drawn instead.
const MESH: u32 = u32::MAX;

/// Draws roots in one of the two ways, and meshes.
pub struct Renderer {
    pub way: Way,
    gpu: Arc<Gpu>,
    /// A planted fault: the border of this root is drawn elsewhere.
    pub shifted: Option<(u32, DVec3)>,
    globals: Buffer,
    globals_group: BindGroup,
    blocks: BTreeMap<u32, Block>,
}

impl Renderer {
    /// Nothing to draw yet.
    pub fn new(gpu: &Arc<Gpu>, way: Way) -> Self {
        let globals = gpu.buffer(&Globals::default(), BufferUsages::UNIFORM);
        let roots = gpu.buffer(&[RootInfo::default()], BufferUsages::STORAGE);
        let globals_group = gpu.bind(&gpu.pipelines.globals_layout, &[&globals, &roots]);
        Self { way, gpu: gpu.clone(), shifted: None, globals, globals_group, blocks: BTreeMap::new() }
    }

    /// Draws these surfaces from now on. Only what is new is sent.
    pub fn update(&mut self, surfaces: &Surfaces) {
        self.blocks.retain(|root, _| surfaces.root(*root).is_some());
        for drawn in surfaces.roots() {
            let surface = self.planted(&drawn.surface);
            let info = [surface.root, u32::from(surface.level), (drawn.error() as f32).to_bits(), 0];
            let is_same = |strips: &[Arc<Strip>]| {
                strips.len() == drawn.strips.len() && strips.iter().zip(&drawn.strips).all(|(a, b)| Arc::ptr_eq(a, b))
            };
            let before = self.blocks.remove(&surface.root).filter(|before| before.info[1] == info[1]);
            let block = match before.filter(|before| is_same(&before.strips)) {
                Some(before) => Block { info, ..before },
                None => self.block(info, &surface, &drawn.strips),
            };
            self.blocks.insert(surface.root, block);
        }
        self.send_infos();
    }

    fn block(&self, info: RootInfo, surface: &Surface, strips: &[Arc<Strip>]) -> Block {
        let gpu = &self.gpu;
        let strips = strips.to_vec();
        if self.way == Way::Stitched {
            let batch = Batch::new(gpu, &Triangles::of_root(surface, &strips));
            return Block { info, strips, batch, pulled: None };
        }
        let batch = Batch::new(gpu, &Triangles::of_mesh(&surface.positions, &surface.triangles));
        let records = border_records(surface);
        let table = snap_table(surface, &strips, &records);
        let border_count = 3 * table[0] * (records.len() / RECORD) as u32;
        let [records, table] = [records, table].map(|words| gpu.buffer(&words, BufferUsages::STORAGE));
        let buffers = [&batch.vertices, &batch.indices, &records, &table];
        let group = gpu.bind(&gpu.pipelines.block_layout, &buffers);
        Block { info, strips, batch, pulled: Some((group, border_count)) }
    }

    fn planted(&self, surface: &Arc<Surface>) -> Arc<Surface> {
        let Some((_, by)) = self.shifted.filter(|(root, _)| *root == surface.root) else { return surface.clone() };
        let mut moved = Surface::clone(surface);
        let border_count = moved.keys.len();
        moved.positions[..border_count].iter_mut().for_each(|p| *p = (DVec3::from(*p) + by).into());
        Arc::new(moved)
    }

    /// Draws a mesh, as root 0 of level 0, instead.
    pub fn set_mesh(&mut self, triangles: &Triangles) {
        let batch = Batch::new(&self.gpu, triangles);
        let block = Block { info: RootInfo::default(), strips: Vec::new(), batch, pulled: None };
        self.blocks = BTreeMap::from([(MESH, block)]);
        self.send_infos();
    }

    fn send_infos(&mut self) {
        let infos: Vec<RootInfo> = self.blocks.values().map(|block| block.info).collect();
        let roots = self.gpu.buffer(&infos, BufferUsages::STORAGE);
        self.globals_group = self.gpu.bind(&self.gpu.pipelines.globals_layout, &[&self.globals, &roots]);
    }

    /// Says where from the next pass looks.
    fn look(&self, Look { camera, frame, overlays, tolerance_px, level_count }: &Look<'_>) {
        let has = |overlay: Overlay| overlays.contains(&overlay);
        let colours = [Overlay::Nodes, Overlay::Levels, Overlay::Errors].into_iter().position(has);
        let flag = |overlay: Overlay| f32::from(u8::from(has(overlay)));
        let [x, y, z, low_x, low_y, low_z] = pair(camera.position.into());
        let pixels = camera.pixels_per_tangent(frame.whole[1]);
        let [across, along] = frame.whole.map(|side| (2.0 * pixels / f64::from(side)) as f32);
        let [right, up, forward] = camera.axes().map(|axis| axis.as_vec3().extend(0.0).into());
        let globals: Globals = [
            right,
            up,
            forward,
            [x, y, z, 0.0],
            [low_x, low_y, low_z, 0.0],
            [across, along, camera.near as f32, pixels as f32],
            [*tolerance_px as f32, *level_count as f32, 0.0, 0.0],
            [colours.map_or(0.0, |number| number as f32 + 1.0), flag(Overlay::Wire), flag(Overlay::Seams), 0.0],
        ];
        self.gpu.queue.write_buffer(&self.globals, 0, bytemuck::cast_slice(&globals));
    }

    /// Draws a picture.
    pub fn draw(&self, targets: &Targets, look: &Look<'_>) {
        let [colour, where_from, depth, _] = &targets.views;
        let [r, g, b] = BACKGROUND.map(|x| f64::from(x) / 255.0);
        let depth_ops = Operations { load: LoadOp::Clear(0.0), store: StoreOp::Discard };
        let descriptor = RenderPassDescriptor {
            color_attachments: &[clear(colour, Color { r, g, b, a: 1.0 }), clear(where_from, Color::TRANSPARENT)],
            depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(depth_ops),
                stencil_ops: None,
            }),
            ..Default::default()
        };
        self.pass(&descriptor, look, false);
    }

    /// Counts front faces less back faces in every pixel, into the stencil; `is_first` begins with zero.
    pub fn count_faces(&self, targets: &Targets, look: &Look<'_>, is_first: bool) {
        let load = if is_first { LoadOp::Clear(0) } else { LoadOp::Load };
        let descriptor = RenderPassDescriptor {
            depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                view: &targets.views[3],
                depth_ops: None,
                stencil_ops: Some(Operations { load, store: StoreOp::Store }),
            }),
            ..Default::default()
        };
        self.pass(&descriptor, look, true);
    }

    fn pass(&self, descriptor: &RenderPassDescriptor<'_>, look: &Look<'_>, counts: bool) {
        self.look(look);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder.begin_render_pass(descriptor), look.frame, counts);
        self.gpu.queue.submit([encoder.finish()]);
    }

    fn record(&self, pass: &mut RenderPass<'_>, frame: Frame, counts: bool) {
        // A tile is a window onto the whole picture: its triangles fall onto the same places of the same pixels.
        let [x, y] = frame.origin.map(|at| -(at as f32));
        pass.set_viewport(x, y, frame.whole[0] as f32, frame.whole[1] as f32, 0.0, 1.0);
        pass.set_bind_group(0, &self.globals_group, &[]);
        for program in Program::ALL {
            pass.set_pipeline(&self.gpu.pipelines.programs[program as usize][usize::from(counts)]);
            for (slot, Block { batch, pulled, .. }) in (0..).zip(self.blocks.values()) {
                let instances = slot..slot + 1;
                match (program, pulled) {
                    (Program::Stitched, None) => {
                        pass.set_vertex_buffer(0, batch.vertices.slice(..));
                        pass.set_index_buffer(batch.indices.slice(..), IndexFormat::Uint32);
                        pass.draw_indexed(0..batch.index_count, 0, instances);
                    }
                    (Program::Pulled, Some((group, _))) => {
                        pass.set_bind_group(1, group, &[]);
                        pass.draw(0..batch.index_count, instances);
                    }
                    (Program::PulledBorder, Some((group, border_count))) => {
                        pass.set_bind_group(1, group, &[]);
                        pass.draw(0..*border_count, instances);
                    }
                    _ => (),
                }
            }
        }
    }

    /// Sends what a scene shows, and draws it; notes how long that took.
    pub fn draw_scene(&mut self, targets: &Targets, scene: &Scene, look: &Look<'_>, report: &mut Report) -> Result<()> {
        let begun = Instant::now();
        match scene.overview() {
            Some(mesh) => self.set_mesh(&Triangles::of_mesh(&mesh.positions, &mesh.triangles)),
            None => self.update(scene.surfaces()),
        }
        self.gpu.wait()?;
        report.upload_ms = milliseconds(begun);
        let begun = Instant::now();
        self.draw(targets, look);
        self.gpu.wait()?;
        report.draw_ms = milliseconds(begun);
        Ok(())
    }

    /// Draws a picture and reads it back.
    pub fn picture(&self, targets: &Targets, camera: &Camera) -> Result<Picture> {
        self.draw(targets, &Look::plain(*camera, targets.size));
        targets.read(&self.gpu)
    }
}

fn clear(view: &TextureView, colour: Color) -> Option<RenderPassColorAttachment<'_>> {
    let ops = Operations { load: LoadOp::Clear(colour), store: StoreOp::Store };
    Some(RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
}
