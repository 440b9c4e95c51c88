//! Drawing: the data of each root on the GPU, and a pass over all of them.

use std::{
    cell::{OnceCell, RefCell},
    sync::Arc,
};

use anyhow::Result;
use glam::DVec3;
use lodpack::{
    Index, Lattice, View,
    decode::Appearance,
    stream::{ByPiece, DrawnRoot, Lit, Picture as Surfaces},
};
use wgpu::{BufferUsages, Color, LoadOp, Operations, RenderPassDepthStencilAttachment as DepthStencil, StoreOp};

use crate::{
    args::{Overlay, Way},
    blocks::{RECORD, border_records, snap_table},
    camera::{Vertex, pair, vertices},
    gpu::{Gpu, Programs, Targets},
    kept::Kept,
    picture::{BACKGROUND, Picture},
    pool::{List, Place, Pool},
    root_data::{Batch, Block, Own, RootInfo},
    texels::{Texels, look_number, mean},
};

/// Camera and settings, as laid out in the shader.
type Globals = [[f32; 4]; 9];

/// How a renderer shows a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shown {
    /// Its number in the file.
    pub number: u8,
    pub appearance: Appearance,
    pub is_unlit: bool,
}

/// Overlays that give the surface another colour, in the order of the shader's numbers.
const COLOURINGS: [Overlay; 4] = [Overlay::Nodes, Overlay::Levels, Overlay::Errors, Overlay::Depths];

/// Stands for a mesh that is drawn instead of a root.
const MESH: u32 = u32::MAX;

/// Draws roots in either way, and meshes.
pub struct Renderer {
    pub way: Way,
    pub(crate) overlays: Vec<Overlay>,
    /// Number of levels, which scales their colours.
    pub(crate) level_count: usize,
    /// Of a mesh: how deep roots are in its tree.
    pub(crate) index: Option<Arc<Index>>,
    pub(crate) gpu: Arc<Gpu>,
    /// A planted fault: the border of this root is drawn shifted.
    pub shifted: Option<(u32, DVec3)>,
    /// The channel that is shown, if there is one.
    shown: Option<Shown>,
    pub(crate) lattice: Lattice,
    /// How many images are uploaded in a frame, so that none takes long (Niski 2007, section 6.1.2). The others follow.
    pub images_per_frame: usize,
    /// What could not be drawn as wanted.
    pub(crate) problems: Vec<String>,
    /// The roots that are drawn, where others are drawn elsewhere; ascending.
    pub(crate) share: Option<Vec<u32>>,
    pool: Pool,
    kept: Kept,
    /// Each in a slot, where it stays: a frame looks only at those that change.
    blocks: Vec<Option<Block>>,
    /// Slots without blocks.
    free: Vec<u32>,
    /// The roots, ascending, with their slots. Roots are drawn in this order.
    order: Vec<(u32, u32)>,
    /// Roots whose images wait for later frames.
    waiting: Vec<u32>,
    /// The stamp of the picture that these blocks show.
    stamp: Option<u64>,
    infos: Infos,
    made: Made,
    /// Draw what is beside the first file into the same picture.
    pub(crate) beside: Vec<Self>,
}

/// Which of the things in one picture a renderer draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// All there is.
    Only,
    /// What comes first: others are drawn over it, where they are nearer.
    First,
    /// What comes after it.
    Next,
    /// What comes last.
    Last,
}

impl Turn {
    fn is_after(self) -> bool {
        matches!(self, Self::Next | Self::Last)
    }
}

/// How deep a root that is drawn is in its tree. All above it is known, since cuts come down from the top.
fn depth(index: &Index, root: u32) -> u32 {
    std::iter::successors(Some(root), |&root| index.parent(root).ok().flatten()).skip(1).count() as u32
}

/// What the shader knows of the root in each slot.
struct Infos {
    /// As on the device.
    buffer: wgpu::Buffer,
    changed: Vec<u32>,
    /// As bound for the last pass, with its settings.
    bound: RefCell<Option<(Globals, wgpu::BindGroup)>>,
}

/// What frames need of all roots, until one of them changes.
#[derive(Default)]
struct Made {
    /// Roots in the pool: those that are drawn without images where others are drawn with theirs, and all.
    lists: [OnceCell<List>; 2],
    /// Whether all are there.
    is_pooled: OnceCell<bool>,
}

impl Renderer {
    pub fn new(gpu: &Arc<Gpu>, way: Way) -> Self {
        Self {
            way,
            overlays: Vec::new(),
            level_count: 1,
            index: None,
            gpu: Arc::clone(gpu),
            shifted: None,
            shown: None,
            lattice: Lattice::default(),
            images_per_frame: usize::MAX,
            problems: Vec::new(),
            share: None,
            pool: Pool::new(gpu),
            kept: Kept::default(),
            blocks: Vec::new(),
            free: Vec::new(),
            order: Vec::new(),
            waiting: Vec::new(),
            stamp: None,
            infos: Infos {
                buffer: gpu.buffer::<RootInfo>(&[], BufferUsages::STORAGE),
                changed: Vec::new(),
                bound: RefCell::default(),
            },
            made: Made::default(),
            beside: Vec::new(),
        }
    }

    /// What could not be drawn as wanted since the last call.
    pub fn take_problems(&mut self) -> Vec<String> {
        std::mem::take(&mut self.problems)
    }

    /// Shows a channel from now on, or none.
    pub(crate) fn show(&mut self, shown: Option<Shown>) {
        // The shader does the ramp.
        let number = |shown: Option<Shown>| shown.map(|shown| shown.number);
        if number(self.shown) != number(shown) {
            self.clear();
        }
        if self.shown != shown {
            // Means of images are shown in other colours.
            self.stamp = None;
            self.blocks.iter_mut().flatten().for_each(|block| block.stamp = 0);
        }
        self.shown = shown;
    }

    /// Draws nothing, and gives back what the blocks had in the pool.
    fn clear(&mut self) {
        let blocks = std::mem::take(&mut self.blocks).into_iter().flatten();
        blocks.flat_map(|block| [block.place, block.border]).flatten().for_each(|place| self.pool.free(place));
        self.kept.clear(&mut self.pool);
        (self.stamp, self.made) = (None, Made::default());
        self.free.clear();
        self.order.clear();
        self.waiting.clear();
    }

    /// The blocks in the order in which they are drawn, with their slots.
    fn drawn(&self) -> impl Iterator<Item = (u32, &Block)> {
        self.order.iter().filter_map(|&(_, slot)| Some((slot, self.blocks[slot as usize].as_ref()?)))
    }

    /// Draws these surfaces from now on. Looks only at what has changed, and uploads only what is new.
    pub fn update(&mut self, surfaces: &Surfaces) {
        if self.stamp == Some(surfaces.stamp()) && self.waiting.is_empty() && self.share.is_none() {
            return;
        }
        self.made = Made::default();
        let mut changed = std::mem::take(&mut self.waiting);
        // Whatever others draw may change without the picture.
        let known = self.stamp.filter(|_| self.share.is_none());
        match known.and_then(|stamp| surfaces.changed_since(stamp)) {
            Some(roots) => changed.extend(roots),
            None => {
                changed.extend(self.order.iter().map(|(root, _)| root));
                changed.extend(surfaces.roots().map(|drawn| drawn.surface.root));
            }
        }
        changed.sort_unstable();
        changed.dedup();
        let mut images_left = self.images_per_frame;
        let mut before = std::mem::take(&mut self.order).into_iter().peekable();
        let mut order = Vec::with_capacity(surfaces.roots().len());
        for root in changed {
            order.extend(std::iter::from_fn(|| before.next_if(|(other, _)| *other < root)));
            let slot = before.next_if(|(other, _)| *other == root).map(|(_, slot)| slot);
            let known = slot.and_then(|slot| self.blocks[slot as usize].take());
            let is_own = self.share.as_ref().is_none_or(|share| share.binary_search(&root).is_ok());
            let Some(drawn) = surfaces.root(root).filter(|_| is_own) else {
                known.into_iter().for_each(|block| self.retire(block));
                self.free.extend(slot);
                continue;
            };
            let block = match known {
                Some(same) if same.stamp == drawn.stamp() => same,
                known => self.updated(drawn, known, &mut images_left),
            };
            self.waiting.extend((block.stamp == 0).then_some(root));
            let slot = slot.unwrap_or_else(|| self.free_slot());
            self.set(slot, block);
            order.push((root, slot));
        }
        order.extend(before);
        self.order = order;
        self.stamp = Some(surfaces.stamp());
        self.upload_infos();
    }

    fn free_slot(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            self.blocks.push(None);
            self.blocks.len() as u32 - 1
        })
    }

    fn set(&mut self, slot: u32, block: Block) {
        self.blocks[slot as usize] = Some(block);
        self.infos.changed.push(slot);
    }

    /// Gives the device what the shader has to know of roots that have changed.
    fn upload_infos(&mut self) {
        let bytes = |count: usize| (count * size_of::<RootInfo>()) as u64;
        let info = |block: &Option<Block>| block.as_ref().map(|block| block.info).unwrap_or_default();
        let mut changed = std::mem::take(&mut self.infos.changed);
        let mut range = match (changed.iter().min(), changed.iter().max()) {
            (Some(&first), Some(&last)) => first as usize..last as usize + 1,
            _ => return,
        };
        if bytes(self.blocks.len()) > self.infos.buffer.size() {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
            self.infos.buffer = self.gpu.empty_buffer(2 * bytes(self.blocks.len()), usage);
            self.infos.bound = RefCell::default();
            range = 0..self.blocks.len();
        }
        let infos: Vec<RootInfo> = self.blocks[range.clone()].iter().map(info).collect();
        self.gpu.write(&self.infos.buffer, bytes(range.start), bytemuck::cast_slice(&infos));
        changed.clear();
        self.infos.changed = changed;
    }

    /// A root's data, of which perhaps some are there.
    fn updated(&mut self, drawn: &DrawnRoot, before: Option<Block>, images_left: &mut usize) -> Block {
        let root = drawn.surface.root;
        // Levels of heights are depths.
        let level = u32::from(drawn.surface.level);
        let depth = self.index.as_ref().map_or(level, |index| depth(index, root));
        let mean = self.shown.map_or(0, |shown| mean(&shown.appearance, drawn));
        let info = [root, level, (drawn.error() as f32).to_bits(), depth, mean];
        let has_image = before.as_ref().is_some_and(|before| before.has_image_of(drawn));
        let waits = drawn.texture().is_some() && !has_image && *images_left == 0;
        let is_uploaded = drawn.texture().is_some() && !has_image && !waits;
        *images_left -= usize::from(is_uploaded);
        // Those of tiles are small.
        let is_uploaded = is_uploaded || drawn.images().is_some() && !has_image;
        let stamp = if waits { 0 } else { drawn.stamp() };
        // The image that is drawn until a finer one is uploaded.
        let mut coarser = None;
        let mut surface = None;
        let known = match before {
            Some(before) if before.has_triangles_of(drawn) && (has_image || waits) => {
                return Block { info, stamp, ..before };
            }
            Some(mut before) => {
                let keeps_image = has_image || waits && before.info[1] == level;
                coarser = before.texture.take().filter(|_| keeps_image);
                let texels = before.own.take().and_then(|own| own.texels).filter(|_| keeps_image);
                if before.has_surface(&drawn.surface) {
                    surface = before.place.take().map(|place| (place, before.light));
                }
                self.retire(before);
                texels
            }
            None => None,
        };
        if surface.is_none() && self.shifted.is_none() {
            surface = self.kept.take(&drawn.surface, &mut self.pool).map(|place| (place, 0));
        }
        let texels = if is_uploaded { self.upload(drawn) } else { known };
        let texture = if waits { coarser } else { drawn.texture().cloned() };
        let images = drawn.images().cloned();
        Block {
            stamp,
            light: drawn.light_stamp(),
            texture,
            images,
            ..self.block(info, &self.planted(drawn), texels, surface)
        }
    }

    /// Gives back what a block has in the pool; its surface may stay there for a while.
    fn retire(&mut self, block: Block) {
        let is_divided = block.is_divided();
        self.pool.give_back(block.border);
        match block.place {
            Some(place) if is_divided => self.kept.keep(&block.surface, place, &mut self.pool),
            place => self.pool.give_back(place),
        }
    }

    /// Uploads a root's image, if it has one.
    fn upload(&mut self, drawn: &DrawnRoot) -> Option<Texels> {
        let appearance = &self.shown?.appearance;
        if let Some(images) = drawn.images() {
            return Some(Texels::of_tile(&self.gpu, images, appearance));
        }
        let texels = Texels::upload(&self.gpu, (drawn, &self.lattice), appearance);
        texels.unwrap_or_else(|problem| {
            self.problems.push(problem);
            None
        })
    }

    /// Uploads a root. Its surface may be there, with a stamp of its normals.
    fn block(
        &mut self,
        info: RootInfo,
        drawn: &DrawnRoot,
        texels: Option<Texels>,
        there: Option<(Place, u64)>,
    ) -> Block {
        let is_pooled = self.way == Way::Stitched && drawn.images().is_none();
        if is_pooled && let Some(by_piece) = texels.as_ref().and_then(|_| drawn.by_piece()) {
            self.pool.give_back(there.map(|(place, _)| place));
            let ByPiece { positions, triangles, pieces, normals } = by_piece;
            let pieces = Some(self.gpu.buffer(&pieces, BufferUsages::VERTEX));
            let triangles = Some(Batch::new(&self.gpu, &vertices(&positions, &normals), &triangles));
            return Block::new(info, drawn.strips.clone(), Some(Own { triangles, texels, pieces, pulled: None }));
        }
        if is_pooled {
            let [place, border] = self.pooled(drawn, there);
            let own = texels.map(|texels| Own { texels: Some(texels), ..Own::default() });
            let surface = Arc::downgrade(&drawn.surface);
            return Block { surface, place, border, ..Block::new(info, drawn.strips.clone(), own) };
        }
        self.pool.give_back(there.map(|(place, _)| place));
        let gpu = Arc::clone(&self.gpu);
        let (surface, strips) = (&drawn.surface, drawn.strips.clone());
        if let Some(images) = drawn.images() {
            let (positions, triangles) = drawn.joined();
            let per_sample = self.shown.map_or(1, |shown| Texels::per_sample(images, &shown.appearance)) as f32;
            let places: Vec<[f32; 2]> = drawn.places().map(|place| place.map(|x| x * per_sample)).collect();
            let pieces = Some(gpu.buffer(&places, BufferUsages::VERTEX));
            let triangles = Some(Batch::new(&gpu, &vertices(&positions, &[]), &triangles));
            return Block::new(info, strips, Some(Own { triangles, texels, pieces, pulled: None }));
        }
        let light = drawn.light();
        let records = border_records(surface, light.as_ref());
        let batch = match &light {
            Some(light) => {
                let further = light.further.iter().map(|&vertex| surface.positions[vertex as usize]);
                let positions: Vec<[f64; 3]> = surface.positions.iter().copied().chain(further).collect();
                let inner = &light.triangles[..surface.triangles.len()];
                Batch::new(&gpu, &vertices(&positions, &light.normals), inner)
            }
            None => Batch::new(&gpu, &vertices(&surface.positions, &[]), &surface.triangles),
        };
        let table = snap_table(drawn, light.as_ref(), &records);
        let border_count = 3 * table[0] * (records.len() / RECORD) as u32;
        let [records, table] = [records, table].map(|words| gpu.buffer(&words, BufferUsages::STORAGE));
        let group = gpu.bind(&gpu.pipelines.block_layout, &[&batch.vertices, &batch.indices, &records, &table]);
        let pulled = Some((group, border_count));
        Block::new(info, strips, Some(Own { triangles: Some(batch), pulled, texels, pieces: None }))
    }

    /// Uploads the surface of a root, unless it is there, and its border beside it. Both are one where the border has
    /// no room there, or there is none.
    fn pooled(&mut self, drawn: &DrawnRoot, there: Option<(Place, u64)>) -> [Option<Place>; 2] {
        let Lit { positions, triangles, normals } = drawn.lit().unwrap_or_else(|| {
            let (positions, triangles) = drawn.joined();
            Lit { positions, triangles, normals: Vec::new() }
        });
        let all = vertices(&positions, &normals);
        let (inner, outer) = triangles.split_at(drawn.surface.triangles.len());
        let own_count = drawn.surface.positions.len();
        let of_strips = own_count..own_count + drawn.strips.iter().map(|strip| strip.positions.len()).sum::<usize>();
        // What belongs to strips comes last: vertices at creases come before them.
        let further_count = all.len() - of_strips.end;
        let own = [&all[..own_count], &all[of_strips.end..]].concat();
        let moved = |index: u32| match index as usize {
            index if index < own_count => index as u32,
            index if index < of_strips.end => (index + further_count) as u32,
            index => (index - of_strips.len()) as u32,
        };
        let renumbered = |triangles: &[[u32; 3]]| -> Vec<[u32; 3]> {
            triangles.iter().map(|triangle| triangle.map(moved)).collect()
        };
        let place = match there {
            Some((place, light)) => {
                if light != drawn.light_stamp() {
                    self.pool.write(&place, 0, &own[..drawn.surface.keys.len()]);
                    self.pool.write(&place, own_count as u32, &own[own_count..]);
                }
                Some(place)
            }
            None => self.pool.place(&own, &renumbered(inner)),
        };
        let Some(place) = place else { return [self.pool.place(&all, &triangles), None] };
        if outer.is_empty() {
            return [Some(place), None];
        }
        match self.pool.place_beside(&place, &all[of_strips.clone()], &renumbered(outer)) {
            Some(border) => [Some(place), Some(border)],
            None => {
                self.pool.free(place);
                [self.pool.place(&all, &triangles), None]
            }
        }
    }

    fn planted(&self, drawn: &DrawnRoot) -> DrawnRoot {
        let mut drawn = drawn.clone();
        if let Some((_, by)) = self.shifted.filter(|(root, _)| *root == drawn.surface.root) {
            let surface = Arc::make_mut(&mut drawn.surface);
            let border = &mut surface.positions[..surface.keys.len()];
            border.iter_mut().for_each(|p| *p = (DVec3::from(*p) + by).into());
        }
        drawn
    }

    /// Draws a mesh instead, as root 0 of level 0, flat.
    pub fn set_mesh(&mut self, positions: &[[f64; 3]], triangles: &[[u32; 3]]) {
        self.set_vertices(&vertices(positions, &[]), triangles);
    }

    pub(crate) fn set_vertices(&mut self, vertices: &[Vertex], triangles: &[[u32; 3]]) {
        self.clear();
        let triangles = Some(Batch::new(&self.gpu, vertices, triangles));
        let slot = self.free_slot();
        self.set(slot, Block::new(RootInfo::default(), Vec::new(), Some(Own { triangles, ..Own::default() })));
        self.order.push((MESH, slot));
        self.upload_infos();
    }

    /// The shader's settings for one pass.
    fn globals(&self, view: &View) -> wgpu::BindGroup {
        let has = |overlay: Overlay| self.overlays.contains(&overlay);
        let colours = COLOURINGS.into_iter().position(has);
        let flag = |overlay: Overlay| f32::from(u8::from(has(overlay)));
        let [x, y, z, low_x, low_y, low_z] = pair(view.position);
        let pixels = view.pixels_per_tangent();
        let [across, along] = view.viewport.map(|side| (2.0 * pixels / f64::from(side)) as f32);
        let [right, up, forward] = view.axes().map(|[x, y, z]| [x as f32, y as f32, z as f32, 0.0]);
        let deepest = self.level_count.saturating_sub(1) as u32;
        let globals: Globals = [
            right,
            up,
            forward,
            [x, y, z, 0.0],
            [low_x, low_y, low_z, 0.0],
            [across, along, view.near as f32, pixels as f32],
            [view.pixel_tolerance as f32, self.level_count as f32, deepest as f32, 0.0],
            [colours.map_or(0.0, |number| number as f32 + 1.0), flag(Overlay::Wire), flag(Overlay::Borders), 0.0],
            self.shown.map_or([0.0; 4], |Shown { appearance, is_unlit, .. }| {
                let [low, high] = appearance.range.map(|number| number as f32);
                [look_number(appearance.look()), f32::from(u8::from(is_unlit)), low, high]
            }),
        ];
        let mut bound = self.infos.bound.borrow_mut();
        if let Some((_, group)) = bound.as_ref().filter(|(before, _)| *before == globals) {
            return group.clone();
        }
        let uniform = self.gpu.buffer(&globals, BufferUsages::UNIFORM);
        let group = self.gpu.bind(&self.gpu.pipelines.globals_layout, &[&uniform, &self.infos.buffer]);
        bound.insert((globals, group)).1.clone()
    }

    pub fn draw(&self, targets: &Targets, view: &View) {
        self.draw_in_turn(targets, view, Turn::Only);
    }

    /// Draws into a picture with others, which share its depth buffer.
    pub fn draw_in_turn(&self, targets: &Targets, view: &View, turn: Turn) {
        let [colour, where_from, depth, _] = &targets.views;
        let [r, g, b, a] = BACKGROUND.0.map(|x| f64::from(x) / 255.0);
        let attachment = |view, resolve_target, colour| {
            let load = if turn.is_after() { LoadOp::Load } else { LoadOp::Clear(colour) };
            let ops = Operations { load, store: StoreOp::Store };
            Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target, ops })
        };
        let background = Color { r, g, b, a };
        let exact = [attachment(colour, None, background), attachment(where_from, None, Color::TRANSPARENT)];
        let pipelines = &self.gpu.pipelines;
        let smooth = targets
            .smooth
            .as_ref()
            .map(|[samples, depth]| ([attachment(samples, Some(colour), background)], depth, pipelines.smooth()));
        let (colours, depth, programs) = match &smooth {
            Some((colours, depth, programs)) => (&colours[..], *depth, *programs),
            None => (&exact[..], depth, &pipelines.exact),
        };
        let load = if turn.is_after() { LoadOp::Load } else { LoadOp::Clear(0.0) };
        let store = if matches!(turn, Turn::First | Turn::Next) { StoreOp::Store } else { StoreOp::Discard };
        let depth_ops = Some(Operations { load, store });
        self.pass(colours, DepthStencil { view: depth, depth_ops, stencil_ops: None }, view, programs);
    }

    /// Counts front faces minus back faces of every pixel in the stencil; `is_first` starts from zero.
    pub fn count_faces(&self, targets: &Targets, view: &View, is_first: bool) {
        let load = if is_first { LoadOp::Clear(0) } else { LoadOp::Load };
        let stencil_ops = Some(Operations { load, store: StoreOp::Store });
        let depth = DepthStencil { view: &targets.views[3], depth_ops: None, stencil_ops };
        self.pass(&[], depth, view, &self.gpu.pipelines.counting);
    }

    fn pass(
        &self,
        colours: &[Option<wgpu::RenderPassColorAttachment<'_>>],
        depth: DepthStencil<'_>,
        view: &View,
        programs: &Programs,
    ) {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let descriptor = wgpu::RenderPassDescriptor {
            color_attachments: colours,
            depth_stencil_attachment: Some(depth),
            ..Default::default()
        };
        self.record(&mut encoder.begin_render_pass(&descriptor), view, programs);
        // Whoever draws next finds out if the device is lost.
        let _ = self.gpu.submit(encoder);
    }

    fn record(&self, pass: &mut wgpu::RenderPass<'_>, view: &View, programs: &Programs) {
        // A tile is a window onto the whole picture: its triangles cover the same points of the same pixels.
        let [width, height] = view.viewport.map(f64::from);
        let [x, y] = [view.window[0][0] * width, (1.0 - view.window[1][1]) * height].map(|at| -at.round() as f32);
        pass.set_viewport(x, y, width as f32, height as f32, 0.0, 1.0);
        pass.set_bind_group(0, &self.globals(view), &[]);
        // Where colours mean something else, images are not seen.
        let draws_images =
            programs.textured.is_some() && !self.overlays.iter().any(|overlay| COLOURINGS.contains(overlay));
        let is_pooled = *self.made.is_pooled.get_or_init(|| !self.drawn().any(|(_, block)| block.is_own()));
        // The programs for images belong to passes that draw images.
        let kinds = if draws_images { &[false, true][..] } else { &[false] };
        for &is_textured in kinds {
            let of_images = programs.textured.as_ref().filter(|_| is_textured);
            let program = |number: usize| &of_images.unwrap_or(&programs.plain)[number];
            let of_kind = || self.drawn().filter(move |(_, block)| is_textured == (draws_images && block.has_texels()));
            let own = || of_kind().filter_map(|(slot, block)| Some((slot, block.own.as_ref()?, &block.images)));
            pass.set_pipeline(program(0));
            if !is_textured {
                let list = || {
                    self.pool.list(of_kind().flat_map(|(slot, block)| block.places().map(move |place| (slot, place))))
                };
                self.pool.draw(pass, self.made.lists[usize::from(!draws_images)].get_or_init(list));
            }
            if is_pooled {
                continue;
            }
            let mut is_for_tiles = false;
            for (slot, own, images) in own().filter(|(_, own, _)| own.pulled.is_none()) {
                let Own { triangles: Some(batch), texels, pieces, .. } = &**own else { continue };
                // All roots of a picture are tiles of heights, or none is.
                if let (true, Some(_), Some(tile)) = (is_textured, images, &programs.tile)
                    && !std::mem::replace(&mut is_for_tiles, true)
                {
                    pass.set_pipeline(tile);
                }
                if let (true, Some(texels), Some(pieces)) = (is_textured, texels, pieces) {
                    pass.set_bind_group(2, &texels.group, &[]);
                    pass.set_vertex_buffer(1, pieces.slice(..));
                }
                pass.set_vertex_buffer(0, batch.vertices.slice(..));
                pass.set_index_buffer(batch.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..batch.index_count, 0, slot..slot + 1);
            }
            for (number, is_border) in [(1, false), (2, true)] {
                pass.set_pipeline(program(number));
                for (slot, own, _) in own() {
                    let Own { triangles: Some(batch), pulled: Some((group, border_count)), texels, .. } = &**own else {
                        continue;
                    };
                    pass.set_bind_group(1, group, &[]);
                    if let (true, Some(texels)) = (is_textured, texels) {
                        pass.set_bind_group(2, &texels.group, &[]);
                    }
                    pass.draw(0..if is_border { *border_count } else { batch.index_count }, slot..slot + 1);
                }
            }
        }
    }

    pub fn picture(&self, targets: &Targets, view: &View) -> Result<Picture> {
        self.draw(targets, view);
        targets.read(&self.gpu)
    }
}
