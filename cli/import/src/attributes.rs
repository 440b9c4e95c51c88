//! Where importers put what vertices, corners and triangles carry beside the shape.

use std::collections::{BTreeSet, HashMap};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;

use lodpack_mesh::appearance::{
    AlphaMode, Appearance, COLOUR, Channels, DRAWING, EMISSIVE, METALLIC, Material, MaterialMaps, NORMAL, OCCLUSION,
    ROUGHNESS, ScalarRange,
};
use lodpack_mesh::attributes::{AttributeLayout, Attributes, ChartRun, FileAttributes, MaterialRun};
use lodpack_mesh::images::ImageSource;

use super::ImportError;
use super::error::Parsed;
use super::one_colour::{UsedParts, fold_images};
use super::unseen::{self, AlphaOfColours};
use super::used_part::UvBounds;

/// The most materials of an input: triangles name them with 16 bits.
pub const MAX_MATERIALS: usize = u16::MAX as usize;

/// Collects the attributes of one file after the other.
#[derive(Default)]
pub struct AttributeSink {
    channels: Channels,
    /// What is not yet written to temporary files.
    collected: Attributes,
    appearance: Appearance,
    /// The numbers of its images by their hash: models can name tens of thousands, each of which is looked for among
    /// the others.
    image_numbers: HashMap<u64, Vec<u32>>,
    /// How many values were written, of vertices and of corners.
    written: [u64; 2],
    /// The current file, whose layout is complete only at its end.
    file: FileAttributes,
    vertex_layout: AttributeLayout,
    corner_layout: AttributeLayout,
    /// The alpha of its colours.
    alpha: AlphaOfColours,
    /// The ranges of the texture coordinates of the current file, of its vertices and its corners.
    uv_bounds: [Vec<UvBounds>; 2],
    /// The same of the files before it, with their materials.
    used_parts: Vec<UsedParts>,
    /// Whether normals of vertices are a channel although no material has a map of them.
    has_smooth_normals: bool,
    /// Which channels the input has, whether they are wanted or not, and what they come from.
    found: BTreeSet<(String, &'static str)>,
}

impl AttributeSink {
    pub(super) fn new(channels: &Channels) -> Self {
        let appearance = Appearance { materials: vec![Material::default()], ..Appearance::default() };
        Self { channels: channels.clone(), appearance, ..Self::default() }
    }

    /// Remembers that the input has a channel, and says whether it is wanted.
    pub fn finds(&mut self, channel: &str, source: &'static str) -> bool {
        if self.channels == Channels::None {
            return false;
        }
        self.found.insert((channel.to_owned(), source));
        self.channels.wants(channel)
    }

    /// Whether colours are wanted at all.
    pub(super) fn wants_colour(&self) -> bool {
        self.channels.wants(COLOUR)
    }

    /// Whether anything beside the shape is wanted.
    pub(super) fn wants_channels(&self) -> bool {
        self.channels != Channels::None
    }

    /// Whether something of materials is wanted, so that they are worth reading.
    pub fn wants_materials(&self) -> bool {
        self.channels.wants_materials()
    }

    /// Whether normals of vertices are wanted: `is_mapped` says that some material has a map of them.
    pub(super) fn wants_normals(&self, is_mapped: bool) -> bool {
        self.channels.wants_all_normals() || is_mapped && self.channels.wants(NORMAL)
    }

    /// Makes normals of vertices a channel, if it is wanted.
    pub(super) fn keep_smooth_normals(&mut self) {
        self.has_smooth_normals |= self.channels.wants(NORMAL);
    }

    /// Declares the record of every vertex of the current file, of which some are already there.
    pub(super) fn set_vertex_layout(&mut self, layout: AttributeLayout, vertices: u64) {
        self.file.vertex_stride = layout.stride;
        self.uv_bounds[0] = vec![UvBounds::default(); layout.uv.len()];
        self.vertex_layout = layout;
        self.fill_vertices(vertices);
    }

    /// Declares the record of every corner of the current file, of which some triangles are already there.
    pub(super) fn set_corner_layout(&mut self, layout: AttributeLayout, triangles: u64) {
        self.file.corner_stride = layout.stride;
        self.uv_bounds[1] = vec![UvBounds::default(); layout.uv.len()];
        self.corner_layout = layout;
        self.fill_corners(triangles);
    }

    /// Whether the vertices of the current file have a colour.
    pub(super) fn has_vertex_colour(&self) -> bool {
        self.vertex_layout.colour.is_some()
    }

    /// Numbers in the record of a corner.
    pub(super) fn corner_stride(&self) -> usize {
        self.file.corner_stride
    }

    /// Adds the record of a vertex.
    #[inline]
    pub(super) fn push_vertex(&mut self, record: &[f32]) {
        note_alpha(&mut self.alpha, &self.vertex_layout, record);
        note_values(&mut self.appearance, &mut self.uv_bounds[0], &self.vertex_layout, record);
        self.collected.vertex_values.extend_from_slice(record);
    }

    /// Adds the record of a corner.
    #[inline]
    pub fn push_corner(&mut self, record: &[f32]) {
        note_alpha(&mut self.alpha, &self.corner_layout, record);
        note_values(&mut self.appearance, &mut self.uv_bounds[1], &self.corner_layout, record);
        self.collected.corner_values.extend_from_slice(record);
    }

    /// How many materials there are; the next one has this number.
    pub(super) fn material_count(&self) -> usize {
        self.appearance.materials.len()
    }

    /// Adds materials of the current file. The number of the first one is returned.
    pub fn add_materials(&mut self, materials: Vec<Material>) -> Parsed<usize> {
        let first = self.appearance.materials.len();
        self.appearance.materials.extend(materials);
        match self.appearance.materials.len() {
            count if count > MAX_MATERIALS => Err(ImportError::Materials { count, limit: MAX_MATERIALS }.into()),
            _ => Ok(first),
        }
    }

    /// Adds an image, or finds it; returns its number.
    pub fn add_image(&mut self, image: ImageSource) -> u32 {
        // Images in memory are large: they are not kept a second time for being found.
        let mut hasher = DefaultHasher::new();
        image.hash(&mut hasher);
        let numbers = self.image_numbers.entry(hasher.finish()).or_default();
        let images = &mut self.appearance.images;
        if let Some(known) = numbers.iter().find(|&&number| images.get(number as usize) == Some(&image)) {
            return *known;
        }
        let number = images.len() as u32;
        images.push(image);
        numbers.push(number);
        number
    }

    /// Sets the material of the triangles from a number on.
    pub(super) fn set_material(&mut self, material: usize, first_triangle: u64) {
        let (first_triangle, material) = (first_triangle as u32, material as u16);
        let runs = &mut self.collected.materials;
        if runs.last().is_some_and(|run| run.first_triangle == first_triangle) {
            runs.pop();
        }
        if runs.last().map_or(0, |run| run.material) != material {
            runs.push(MaterialRun { first_triangle, material });
        }
    }

    /// Sets the chart of the triangles from a number on.
    pub(super) fn set_chart(&mut self, chart: u32, first_triangle: u64) {
        let first_triangle = first_triangle as u32;
        self.collected.charts.push(ChartRun { first_triangle, chart });
    }

    /// Makes factors of images that have one colour wherever they are shown, if decoding one does not take more than
    /// `memory`.
    pub(super) fn fold_images(&mut self, memory: u64) {
        let Appearance { materials, images, layout, .. } = &mut self.appearance;
        fold_images(materials, images, &self.used_parts, layout.colour.is_some(), memory);
    }

    /// Values and bytes that are in memory or in temporary files.
    pub(super) fn value_count(&self) -> u64 {
        let Attributes { vertex_values, corner_values, .. } = &self.collected;
        self.written[0] + self.written[1] + (vertex_values.len() + corner_values.len()) as u64
    }

    /// Ends a file, given its vertices and triangles; the next one begins after those of all files before it. Images
    /// whose decoding takes more than `memory` are not looked at. Returns what a user should know of the file.
    pub(super) fn end_file(
        &mut self,
        [vertices, triangles]: [u64; 2],
        [all_vertices, all_triangles]: [u64; 2],
        memory: u64,
    ) -> Vec<&'static str> {
        self.fill_vertices(vertices);
        self.fill_corners(triangles);
        self.set_material(0, all_triangles);
        let notes = self.show_unseen(all_triangles - triangles..all_triangles, memory);
        self.find_maps();
        let (of_vertex, of_corner) = (std::mem::take(&mut self.vertex_layout), std::mem::take(&mut self.corner_layout));
        let behind = of_vertex.stride;
        let mut layout = of_vertex;
        layout.colour = layout.colour.or(of_corner.colour.map(|place| place + behind));
        layout.normal = layout.normal.or(of_corner.normal.map(|place| place + behind));
        layout.tangent = layout.tangent.or(of_corner.tangent.map(|place| place + behind));
        layout.uv.extend(of_corner.uv.iter().map(|place| place + behind));
        layout.scalars.extend(of_corner.scalars.iter().map(|(name, place)| (name.clone(), place + behind)));
        layout.stride += of_corner.stride;
        self.appearance.layout.join(&layout);
        let first_material = self.used_parts.last().map_or(0, |(numbers, _)| numbers.end);
        let bounds = std::mem::take(&mut self.uv_bounds).concat();
        self.used_parts.push((first_material..self.appearance.materials.len(), bounds));
        let first_vertex_value = self.written[0] + self.collected.vertex_values.len() as u64;
        let first_corner_value = self.written[1] + self.collected.corner_values.len() as u64;
        let next = FileAttributes {
            first_vertex: all_vertices as u32,
            first_triangle: all_triangles as u32,
            first_vertex_value,
            first_corner_value,
            ..FileAttributes::default()
        };
        let file = std::mem::replace(&mut self.file, next);
        self.collected.files.push(FileAttributes { layout, ..file });
        notes
    }

    /// Makes the current file opaque, whose triangles these are, where all that it shows would be invisible. Says what
    /// was done.
    fn show_unseen(&mut self, triangles: Range<u64>, memory: u64) -> Vec<&'static str> {
        let (alpha, mut notes) = (std::mem::take(&mut self.alpha), vec![]);
        self.file.ignores_alpha = alpha.is_unmeant();
        self.appearance.has_alpha |= alpha.is_transparent();
        if self.file.ignores_alpha {
            notes.push("all its colours have alpha 0, so that nothing would be seen: they are opaque");
        }
        let runs = &self.collected.materials;
        let first = runs.partition_point(|run| u64::from(run.first_triangle) <= triangles.start);
        let before = first.checked_sub(1).map_or(0, |run| runs[run].material);
        let within = runs[first..].iter().take_while(|run| u64::from(run.first_triangle) < triangles.end);
        let used: BTreeSet<u16> = within.map(|run| run.material).chain([before]).collect();
        let Appearance { materials, images, .. } = &mut self.appearance;
        let material = |number: &u16| materials.get(usize::from(*number));
        // Images take long, so they come last.
        let is_seen = |number: &u16| material(number).is_none_or(|material| !unseen::may_be_unseen(material));
        let is_unseen = |number: &u16| material(number).is_some_and(|of| unseen::is_unseen(of, images, memory));
        if self.channels.wants_materials() && !used.iter().any(is_seen) && used.iter().all(is_unseen) {
            for number in used {
                materials.get_mut(usize::from(number)).into_iter().for_each(unseen::show);
            }
            notes.push("all its materials have opacity 0, so that nothing would be seen: they are opaque");
        }
        notes
    }

    /// Remembers which channels the materials have.
    fn find_maps(&mut self) {
        let all = maps(&self.used_materials(), &Channels::Auto);
        let found = [
            (all.normal, NORMAL, "images of materials"),
            (self.channels.wants_all_normals(), NORMAL, "triangles"),
            (all.emissive, EMISSIVE, "materials"),
            (all.occlusion, OCCLUSION, "materials"),
            (all.metallic, METALLIC, "materials"),
            (all.roughness, ROUGHNESS, "materials"),
            (self.used_materials().iter().any(|material| material.states_drawing()), DRAWING, "materials"),
        ];
        found.into_iter().filter(|(is_there, ..)| *is_there).for_each(|(_, name, source)| {
            self.finds(name, source);
        });
    }

    /// The materials that triangles name.
    fn used_materials(&self) -> Vec<&Material> {
        let used: BTreeSet<u16> = self.collected.materials.iter().map(|run| run.material).collect();
        used.iter().filter_map(|&number| self.appearance.materials.get(usize::from(number))).collect()
    }

    /// Takes the values that are not yet written.
    pub(super) fn take_values(&mut self) -> [Vec<f32>; 2] {
        let Attributes { vertex_values, corner_values, .. } = &mut self.collected;
        self.written[0] += vertex_values.len() as u64;
        self.written[1] += corner_values.len() as u64;
        [std::mem::take(vertex_values), std::mem::take(corner_values)]
    }

    /// Ends the input, and drops everything but its charts if there is no channel in it.
    pub(super) fn finish(mut self) -> (Attributes, Appearance) {
        let used = self.used_materials();
        let is_white = |material: &Material| {
            let has_image = material.base_texture.is_some() || material.opacity_texture.is_some();
            !has_image && material.base_colour == [1.0; 4]
        };
        let has_colour = self.appearance.layout.colour.is_some() || used.iter().any(|material| !is_white(material));
        let mut maps = maps(&used, &self.channels);
        maps.normal |= self.has_smooth_normals;
        let is_transparent = used.iter().any(|material| has_alpha(material));
        let has_drawings = self.channels.wants(DRAWING) && used.iter().any(|material| material.states_drawing());
        let appearance = &mut self.appearance;
        if has_drawings && !appearance.has_alpha {
            // Colours of vertices are opaque, and so is what has no other.
            let unstated = appearance.materials.iter_mut().filter(|material| material.alpha == AlphaMode::Unstated);
            unstated.filter(|material| !has_alpha(material)).for_each(|material| material.alpha = AlphaMode::Opaque);
        }
        appearance.has_drawings = has_drawings;
        appearance.has_colour = has_colour && self.channels.wants(COLOUR);
        appearance.has_alpha |= is_transparent;
        appearance.maps = maps;
        if appearance.is_even() {
            appearance.materials.iter_mut().for_each(Material::round);
        }
        if appearance.is_empty() {
            return (Attributes { charts: self.collected.charts, ..Attributes::default() }, Appearance::default());
        }
        (self.collected, self.appearance)
    }

    /// A sentence about the channels that the input has; none if it has none or they are not wanted.
    pub(super) fn found(&self) -> Option<String> {
        let of = |wanted: bool| -> Vec<String> {
            let mut found: Vec<(String, Vec<&str>)> = vec![];
            for (name, source) in self.found.iter().filter(|(name, _)| self.channels.wants(name) == wanted) {
                match found.last_mut() {
                    Some((known, sources)) if known == name => sources.push(source),
                    _ => found.push((name.clone(), vec![source])),
                }
            }
            found.into_iter().map(|(name, sources)| format!("{name} ({})", sources.join(", "))).collect()
        };
        let (kept, dropped) = (of(true), of(false));
        match (kept.is_empty(), dropped.is_empty()) {
            (true, true) => None,
            (false, true) => Some(format!("channels: {}", kept.join(", "))),
            (true, false) => Some(format!("channels that were not asked for: {}", dropped.join(", "))),
            (false, false) => Some(format!("channels: {}; not asked for: {}", kept.join(", "), dropped.join(", "))),
        }
    }

    /// Sentences about numbers that are not kept as they are.
    pub(super) fn about_numbers(&self) -> Vec<String> {
        let mut notes = vec![];
        for range in &self.appearance.scalars {
            let ScalarRange { name, missing, .. } = range;
            if *missing > 0 {
                notes.push(format!("{name} is no finite number at {missing} vertices, which get what is beside them"));
            }
            let (rounding, width) = (range.rounding(), f64::from(range.high) - f64::from(range.low));
            if range.is_whole && rounding >= 0.5 && rounding > SEEN_ROUNDING * width {
                notes.push(format!(
                    "{name} has numbers of more digits than are kept: they may be off by {rounding}; to keep them, subtract \
                     the smallest one from all"
                ));
            }
        }
        notes
    }

    /// Refuses names of channels that the input does not have.
    pub(super) fn check_names(&self) -> Parsed<()> {
        let Channels::Named(names) = &self.channels else { return Ok(()) };
        match names.iter().find(|name| !self.found.iter().any(|(found, _)| found == *name)) {
            None => Ok(()),
            Some(name) => {
                let found: BTreeSet<&str> = self.found.iter().map(|(name, _)| name.as_str()).collect();
                let found = found.into_iter().collect::<Vec<_>>().join(", ");
                Err(ImportError::Channel { name: name.clone(), found }.into())
            }
        }
    }

    /// Refuses more channels than a file holds.
    pub(super) fn check_count(&self) -> Parsed<()> {
        let wanted = self.found.iter().map(|(name, _)| name.as_str()).filter(|name| self.channels.wants(name));
        let count = wanted.collect::<BTreeSet<_>>().len();
        let most = MOST_CHANNELS;
        if count > most { Err(ImportError::ManyChannels { count, most }.into()) } else { Ok(()) }
    }

    fn fill_vertices(&mut self, vertices: u64) {
        let (all, first) = (self.written[0] + self.collected.vertex_values.len() as u64, self.file.first_vertex_value);
        let is_missing = fill(&mut self.collected.vertex_values, &self.vertex_layout, vertices, all - first);
        if is_missing {
            note_alpha(&mut self.alpha, &self.vertex_layout, &self.vertex_layout.blank());
        }
        self.forget_bounds(0, is_missing);
    }

    fn fill_corners(&mut self, triangles: u64) {
        let (all, first) = (self.written[1] + self.collected.corner_values.len() as u64, self.file.first_corner_value);
        let is_missing = fill(&mut self.collected.corner_values, &self.corner_layout, 3 * triangles, all - first);
        if is_missing {
            note_alpha(&mut self.alpha, &self.corner_layout, &self.corner_layout.blank());
        }
        self.forget_bounds(1, is_missing);
    }

    /// Texture coordinates that are missing may be anywhere.
    fn forget_bounds(&mut self, which: usize, is_missing: bool) {
        if is_missing {
            self.uv_bounds[which].fill(UvBounds::UNKNOWN);
        }
    }
}

/// Adds blank records until there are `records`, and says whether any was missing.
fn fill(values: &mut Vec<f32>, layout: &AttributeLayout, records: u64, there: u64) -> bool {
    if layout.stride == 0 {
        return false;
    }
    let blank = layout.blank();
    let missing = records.saturating_sub(there / layout.stride as u64);
    (0..missing).for_each(|_| values.extend_from_slice(&blank));
    missing > 0
}

/// A file holds one more, which may say how the surface is drawn.
const MOST_CHANNELS: usize = 63;
/// Of all that a scalar's values differ by, what rounding may take before it is said.
const SEEN_ROUNDING: f64 = 1e-6;

/// Keeps what has to be known of the alpha of all colours.
#[inline]
fn note_alpha(of_colours: &mut AlphaOfColours, layout: &AttributeLayout, record: &[f32]) {
    let alpha = layout.colour.and_then(|place| record.get(place + 3));
    alpha.into_iter().for_each(|&alpha| of_colours.add(alpha));
}

/// Keeps what has to be known of all values: the ranges of texture coordinates and of scalars.
#[inline]
fn note_values(appearance: &mut Appearance, uv: &mut [UvBounds], layout: &AttributeLayout, record: &[f32]) {
    for (bounds, &place) in uv.iter_mut().zip(&layout.uv) {
        bounds.add([record[place], record[place + 1]]);
    }
    for (name, place) in &layout.scalars {
        let range = match appearance.scalars.iter().position(|range| range.name == *name) {
            Some(known) => &mut appearance.scalars[known],
            None => {
                appearance.scalars.push(ScalarRange::new(name));
                let last = appearance.scalars.len() - 1;
                &mut appearance.scalars[last]
            }
        };
        record.get(*place).into_iter().for_each(|&value| range.add(value));
    }
}

/// The channels of materials that are not the same as without materials.
fn maps(used: &[&Material], channels: &Channels) -> MaterialMaps {
    let any = |name: &str, differs: &dyn Fn(&Material) -> bool| {
        channels.wants(name) && used.iter().any(|material| differs(material))
    };
    MaterialMaps {
        normal: channels.wants_all_normals() || any(NORMAL, &|material| material.normal_texture.is_some()),
        emissive: any(EMISSIVE, &|material| material.emissive != [0.0; 3]),
        occlusion: any(OCCLUSION, &|material| material.occlusion_texture.is_some()),
        metallic: any(METALLIC, &|material| material.metallic > 0.0),
        roughness: any(ROUGHNESS, &|material| {
            let textures = [&material.metallic_roughness_texture, &material.roughness_texture];
            material.roughness < 1.0 || textures.iter().any(|texture| texture.is_some())
        }),
    }
}

fn has_alpha(material: &Material) -> bool {
    let has_image = material.base_texture.is_some() || material.opacity_texture.is_some();
    material.alpha != AlphaMode::Opaque && (material.base_colour[3] < 1.0 || has_image)
}
