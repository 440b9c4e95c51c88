//! From a mesh to an atlas: charts and their maps, from which the geometry images are written.

use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::{ArcKnot, AtlasChart, AtlasHeader, AtlasPatch, AtlasProduct, Looks, PatchBorder};
use lodpack_mesh::attributes::{RegionAttributes, Surface};
use lodpack_mesh::union_find::{find, unite};
use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_runtime::progress::Progress;
use lodpack_runtime::text::count;
use lodpack_stage::arc_samples::{SampledArc, sample_arcs};
use lodpack_stage::arcs::{ARC_UNITS, Arc, Atlas, LoopVertex, Seams, cut_chart, trace_arcs};
use lodpack_stage::chart::{BorderVertex, ChartMesh};
use lodpack_stage::embed::{EmbedError, EmbedOptions, EmbedReport, Embedding, embed_chart};
use lodpack_stage::repair::{RepairReport, repair, repair_with_origins};
use lodpack_stage::segment::{SegmentOptions, segment_charts};

/// The options of an atlas.
#[derive(Clone, Debug, PartialEq)]
pub struct AtlasOptions {
    /// Triangles per chart to aim for. Default 8192.
    pub chart_triangles: u32,
    /// How often charts without a map are cut into about four and tried again. Default 2: a handle or a hole that
    /// remains then costs a patch of some 500 triangles instead of 8192.
    pub retries: u32,
    /// How charts are mapped, and which maps are good enough.
    pub embed: EmbedOptions,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self { chart_triangles: 8192, retries: 2, embed: EmbedOptions::default() }
    }
}

/// An atlas and how it came about.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuiltAtlas {
    /// The atlas to write; empty where repair left no triangle.
    pub product: AtlasProduct,
    /// What repair did before.
    pub repairs: RepairReport,
    /// Vertices after repair.
    pub vertex_count: u64,
    /// Triangles after repair.
    pub triangle_count: u64,
    /// Charts that were cut further because they had no map.
    pub retried_charts: u64,
    /// How the charts were mapped.
    pub embedding: EmbedReport,
}

/// Cuts a mesh into charts and maps each to a polygon. Charts that have no map after some attempts become patches, with
/// a note.
///
/// A chart has triangles that are drawn alike. The result depends on the surface and the options alone.
pub fn build_atlas(input: impl Into<Surface>, options: &AtlasOptions, progress: &dyn Progress) -> BuiltAtlas {
    progress.begin("repair", 0);
    let (mesh, adjacency, repairs, looks) = repaired(input.into());
    let mut built = BuiltAtlas {
        repairs,
        vertex_count: mesh.positions.len() as u64,
        triangle_count: mesh.triangles.len() as u64,
        ..BuiltAtlas::default()
    };
    if mesh.triangles.is_empty() {
        return built;
    }
    let [low, high] = mesh.bounds();
    // Rounded to 32 bits, which are short to write.
    let origin = ((low + high) * 0.5).as_vec3().as_dvec3();

    progress.begin("segment", 0);
    let segment_options = SegmentOptions { target_triangles: options.chart_triangles, ..SegmentOptions::default() };
    let mut labels = segment_charts(&mesh, &adjacency, &segment_options);
    if looks.appearance.has_drawings {
        separate_drawings(&mut labels, &adjacency, |triangle| looks.drawing(triangle));
    }
    let mut charts = CutCharts::new(&mesh, &adjacency, &labels, origin);
    progress.begin("embed", charts.atlas.charts.len() as u64);
    let mut maps = charts.embed(&options.embed, &HashMap::new(), progress);
    for _ in 0..options.retries {
        let cut = cut_further(&charts, &maps, &mut labels);
        if cut == 0 {
            break;
        }
        built.retried_charts += cut;
        // Charts beside those that were cut have new corners; the others keep their maps.
        let known = charts.into_known(maps);
        charts = CutCharts::new(&mesh, &adjacency, &labels, origin);
        maps = charts.embed(&options.embed, &known, progress);
    }
    built.embedding = EmbedReport::of(&maps);
    built.product = AtlasProduct { looks, ..charts.into_product(&mesh, origin, maps, progress) };
    built
}

/// The mesh without what is wrong with it, and what is left of its attributes.
fn repaired(input: Surface) -> (Mesh, Adjacency, RepairReport, Looks) {
    let Surface { mesh, attributes, appearance } = input;
    if appearance.is_empty() {
        let (mesh, adjacency, repairs) = repair(mesh);
        return (mesh, adjacency, repairs, Looks::default());
    }
    let triangles = (0..mesh.triangles.len() as u32).zip(mesh.triangles.iter().copied());
    let mut kept = RegionAttributes::gather(&attributes, &appearance, &attributes, triangles);
    let (mesh, adjacency, repairs, origins) = repair_with_origins(mesh, &[]);
    kept.keep(origins.into_iter());
    (mesh, adjacency, repairs, Looks { appearance, attributes: kept })
}

/// Divides charts where one part of them is drawn in another way than the next.
fn separate_drawings(labels: &mut [u32], adjacency: &Adjacency, drawing: impl Fn(u32) -> u16) {
    let is_alike = |a: u32, b: u32| labels[a as usize] == labels[b as usize] && drawing(a) == drawing(b);
    let mut parent: Vec<u32> = (0..labels.len() as u32).collect();
    for (half_edge, &opposite) in adjacency.opposite.iter().enumerate() {
        let (a, b) = (half_edge as u32 / 3, opposite / 3);
        if opposite != NONE && is_alike(a, b) {
            unite(&mut parent, a, b);
        }
    }
    // Charts are numbered by their first triangle.
    let mut number_of = vec![NONE; labels.len()];
    let mut next = 0;
    for triangle in 0..labels.len() as u32 {
        let first = find(&mut parent, triangle) as usize;
        if number_of[first] == NONE {
            number_of[first] = next;
            next += 1;
        }
        labels[triangle as usize] = number_of[first];
    }
}

type Map = Result<Embedding, EmbedError>;

/// The charts of a mesh, cut out.
struct CutCharts {
    atlas: Atlas,
    sampled: Vec<SampledArc>,
    /// Relative to the origin.
    charts: Vec<ChartMesh>,
}

impl CutCharts {
    fn new(mesh: &Mesh, adjacency: &Adjacency, labels: &[u32], origin: DVec3) -> Self {
        let atlas = trace_arcs(mesh, adjacency, labels, &Seams::default());
        let sampled = sample_arcs(mesh, &atlas, &[]);
        let cut = |chart: u32| {
            let local = cut_chart(mesh, adjacency, &atlas, labels, chart);
            let sides = &atlas.charts[chart as usize].loops;
            let loops = local.loops.iter().zip(sides).map(|(border, half_arcs)| {
                let vertex = |v: &LoopVertex| {
                    let half = half_arcs[v.side as usize];
                    let (param, level) = (
                        sampled[half.arc as usize].params[v.path_index as usize],
                        sampled[half.arc as usize].levels[v.path_index as usize],
                    );
                    let along = if half.reversed { f64::from(ARC_UNITS) - param } else { param };
                    BorderVertex { vertex: v.local_vertex, side: v.side, param: along / f64::from(ARC_UNITS), level }
                };
                border.iter().map(vertex).collect()
            });
            let loops = loops.collect();
            let positions = local.mesh_vertex.iter().map(|&v| mesh.positions[v as usize] - origin).collect();
            ChartMesh { positions, triangles: local.triangles, loops }
        };
        let charts = (0..atlas.charts.len() as u32).into_par_iter().map(cut).collect();
        Self { atlas, sampled, charts }
    }

    /// Maps all charts, and copies the maps of those that are `known`.
    fn embed(
        &self,
        options: &EmbedOptions,
        known: &HashMap<u32, (ChartMesh, Map)>,
        progress: &dyn Progress,
    ) -> Vec<Map> {
        let embed = |(chart, mesh): (usize, &ChartMesh)| {
            let first_triangle = self.atlas.charts[chart].triangles[0];
            match known.get(&first_triangle).filter(|(before, _)| before == mesh) {
                Some((_, map)) => map.clone(),
                None => {
                    let map = embed_chart(mesh, options);
                    progress.advance(1);
                    map
                }
            }
        };
        self.charts.par_iter().enumerate().map(embed).collect()
    }

    /// Charts and their maps by the chart's first triangle.
    fn into_known(self, maps: Vec<Map>) -> HashMap<u32, (ChartMesh, Map)> {
        let first_triangles = self.atlas.charts.iter().map(|chart| chart.triangles[0]);
        first_triangles.zip(self.charts.into_iter().zip(maps)).collect()
    }

    fn into_product(self, mesh: &Mesh, origin: DVec3, maps: Vec<Map>, progress: &dyn Progress) -> AtlasProduct {
        let is_patch: Vec<bool> = maps.iter().map(Result::is_err).collect();
        let patches = patches_of(&self.atlas, mesh, origin, &is_patch);
        if !patches.is_empty() {
            progress.note(&patch_note(&maps, &patches, mesh.triangles.len()));
        }
        let knots = |(arc, sampled): (&Arc, &SampledArc)| {
            let knot = |(&v, &param): (&u32, &f64)| ArcKnot {
                param: param / f64::from(ARC_UNITS),
                position: mesh.positions[v as usize] - origin,
            };
            arc.path.iter().zip(&sampled.params).map(knot).collect()
        };
        let arcs = self.atlas.arcs.iter().zip(&self.sampled).map(knots).collect();
        let charts = self.charts.into_iter().zip(maps).zip(self.atlas.charts).filter_map(|((mesh, map), chart)| {
            // A chart with a map has one loop.
            let sides = chart.loops.into_iter().next()?;
            Some(AtlasChart { mesh, embedding: map.ok()?, sides, numbers: chart.triangles })
        });
        let charts = charts.collect();
        let header = AtlasHeader { origin, units: String::new() };
        AtlasProduct { header, arcs, charts, patches, looks: Looks::default() }
    }
}

/// Charts with fewer triangles are not worth cutting.
const LEAST_TRIANGLES: usize = 128;

/// Cuts the charts without a map into about four each; returns how many were cut.
fn cut_further(charts: &CutCharts, maps: &[Map], labels: &mut [u32]) -> u64 {
    let cut = |(chart, map): (usize, &Map)| {
        let mesh = &charts.charts[chart];
        if map.is_ok() || mesh.triangles.len() < LEAST_TRIANGLES {
            return None;
        }
        let target_triangles = (mesh.triangles.len() / 4) as u32;
        let mesh = Mesh { positions: mesh.positions.clone(), triangles: mesh.triangles.clone() };
        let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
        let options = SegmentOptions { target_triangles, ..SegmentOptions::default() };
        Some((chart, segment_charts(&mesh, &adjacency, &options)))
    };
    let pieces: Vec<(usize, Vec<u32>)> = maps.par_iter().enumerate().filter_map(cut).collect();
    let mut next = maps.len() as u32;
    let mut count = 0;
    for (chart, own) in pieces {
        let last = own.iter().copied().max().unwrap_or(0);
        count += u64::from(last > 0);
        for (&triangle, &piece) in charts.atlas.charts[chart].triangles.iter().zip(&own) {
            if piece > 0 {
                labels[triangle as usize] = next + piece - 1;
            }
        }
        next += last;
    }
    count
}

/// Charts without a map as patches. Those that border on each other form one patch, so a patch has only charts as
/// neighbours.
fn patches_of(atlas: &Atlas, mesh: &Mesh, origin: DVec3, is_patch: &[bool]) -> Vec<AtlasPatch> {
    // Union-find over the charts; the first chart of a patch stands for it.
    let mut parent: Vec<u32> = (0..is_patch.len() as u32).collect();
    let at = |chart: u32| chart != NONE && is_patch[chart as usize];
    for arc in &atlas.arcs {
        if arc.charts.into_iter().all(at) {
            unite(&mut parent, arc.charts[0], arc.charts[1]);
        }
    }
    let mut patches: Vec<AtlasPatch> = Vec::new();
    let mut vertices: Vec<HashMap<u32, u32>> = Vec::new();
    let mut patch_of = vec![NONE; is_patch.len()];
    for chart in (0..is_patch.len() as u32).filter(|&chart| at(chart)) {
        let first = find(&mut parent, chart);
        if first == chart {
            patch_of[chart as usize] = patches.len() as u32;
            patches.push(AtlasPatch::default());
            vertices.push(HashMap::new());
        }
        let index = patch_of[first as usize];
        patch_of[chart as usize] = index;
        let (patch, numbers) = (&mut patches[index as usize], &mut vertices[index as usize]);
        patch.numbers.extend(&atlas.charts[chart as usize].triangles);
        for &t in &atlas.charts[chart as usize].triangles {
            patch.triangles.push(mesh.triangles[t as usize].map(|v| {
                *numbers.entry(v).or_insert_with(|| {
                    patch.positions.push(mesh.positions[v as usize] - origin);
                    patch.positions.len() as u32 - 1
                })
            }));
        }
    }
    for (index, arc) in atlas.arcs.iter().enumerate() {
        let (inside, outside) = match arc.charts.map(at) {
            [true, false] => (arc.charts[0], arc.charts[1]),
            [false, true] => (arc.charts[1], arc.charts[0]),
            _ => continue,
        };
        if outside != NONE {
            let patch = patch_of[inside as usize] as usize;
            let own = arc.path.iter().map(|v| vertices[patch][v]).collect();
            patches[patch].borders.push(PatchBorder { arc: index as u32, vertices: own });
        }
    }
    patches
}

/// A note that says what became patches, and why.
fn patch_note(maps: &[Map], patches: &[AtlasPatch], triangle_count: usize) -> String {
    let mut reasons =
        [("are closed, or have holes or handles", 0), ("would be too uneven", 0), ("cannot be for other reasons", 0)];
    for error in maps.iter().filter_map(|map| map.as_ref().err()) {
        let reason = match error {
            EmbedError::NotADisk { .. } => 0,
            EmbedError::TooUneven { .. } => 1,
            _ => 2,
        };
        reasons[reason].1 += 1;
    }
    let charts: u64 = reasons.iter().map(|(_, count)| count).sum();
    let reasons: Vec<String> = reasons
        .iter()
        .filter(|(_, number)| *number > 0)
        .map(|(reason, number)| format!("{} {reason}", count(*number)))
        .collect();
    let patch_triangles: usize = patches.iter().map(|patch| patch.triangles.len()).sum();
    format!(
        "{} triangles ({:.2} %) become {} meshes (patch_*.ply) instead of images, because their {} charts cannot be laid out as squares \
         ({}); `lodpack build` reads them too",
        count(patch_triangles as u64),
        100.0 * patch_triangles as f64 / triangle_count as f64,
        count(patches.len() as u64),
        count(charts),
        reasons.join(", ")
    )
}
