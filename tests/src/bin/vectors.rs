//! Writes the test vectors of the format: `vectors [DIR]`
//!
//! DIR defaults to format-spec/vectors. Beside each file it writes the JSON that the reader decodes from it; `invalid`
//! gets the files that must be refused. Existing vectors are replaced; files under other names are left alone. The same
//! program writes the same bytes on every machine.

use glam::DVec3;
use lodpack::{
    File, Lattice, LatticePoint, Limits,
    decode::{
        AlphaMode, Drawing, RootPatch,
        texels::{Image, Map},
    },
    index::{ChannelInfo, ChannelKind, HalfArc},
    write::{ArcRecord, ArcTarget, BlockRecord, LevelInfo, ListSizes, Model, OverviewRecord, PatchTarget},
};
use lodpack::{
    index::SourceInfo,
    write::{
        LongTexels, PieceShape, Quantisation, RootRecord, Slide, SymbolBuffer, WantedSample, encode_exact_image,
        encode_exact_normals, encode_image, encode_map, encode_normals, encode_values, quantise_arcs, write_listed,
    },
};
use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::pipeline::{Fillings, ModelOptions};
use lodpack_cli::progress::Silent;
use lodpack_tests::boxes::boxes_of_objects;
use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, save_ply, torus};
use lodpack_tests::handmade::{
    Handmade, HandmadeObjects, HandmadeTexels, Section, TABLES, faults, flat_tables, grounded, placement,
};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec");
    let dir = std::env::args().nth(1).map_or(spec.join("vectors"), PathBuf::from);
    std::fs::create_dir_all(dir.join("invalid"))?;
    for (name, bytes) in vectors(&spec)? {
        let json = lodpack_tests::dump::dump(&File::open(bytes.as_slice(), Limits::default())?)?;
        println!("{name}: {} bytes, JSON {}", bytes.len(), json.len());
        std::fs::write(dir.join(format!("{name}.lodpack")), bytes)?;
        std::fs::write(dir.join(format!("{name}.json")), json)?;
    }
    for fault in faults() {
        println!("| `{}` | {} |", fault.name, fault.what);
        std::fs::write(dir.join(format!("invalid/{}.lodpack", fault.name)), fault.bytes)?;
    }
    Ok(())
}

/// The vectors, by name.
fn vectors(spec: &Path) -> Result<Vec<(&'static str, Vec<u8>)>, Failure> {
    let far = |mesh: Mesh| Mesh { positions: mesh.positions.iter().map(|&p| p + DVec3::splat(5e6)).collect(), ..mesh };
    let mut newer = Handmade::example().container();
    newer.version[1] = 7;
    newer.section(TABLES).content = flat_tables(300);
    newer.sections.insert(1, Section { kind: 0x8000_0001, flags: 0, content: b"private".to_vec(), reserved: 0 });
    let mut placed = Handmade::example().container();
    placed.sections.insert(0, placement());
    Ok(vec![
        ("example", worked_example(&std::fs::read_to_string(spec.join("SPEC.md"))?)?),
        ("flat_tables", Handmade::example().container().bytes()),
        ("newer_minor_version", newer.bytes()),
        ("placement", placed.bytes()),
        ("ground", grounded().bytes()),
        ("polygon_grid", Handmade::grid().container().bytes()),
        ("fan_grid", Handmade::fan().container().bytes()),
        ("long_polygon", Handmade::long_polygon().container().bytes()),
        ("coincident", Handmade::coincident().container().bytes()),
        ("refined_step", Handmade::refined().container().bytes()),
        ("nothing", Handmade::nothing().container().bytes()),
        ("only_child", Handmade::tree().container().bytes()),
        ("unknown_channel", HandmadeTexels::unknown().put_into(Handmade::example().container()).bytes()),
        ("channels_of_nothing", HandmadeTexels::nothing().put_into(Handmade::nothing().container()).bytes()),
        ("channels", cube_with_channels()?),
        ("drawings", drawn_cube()?),
        ("exact_colours", exact_cube()?),
        ("scales", scaled_cube()?),
        // As a builder of version 4.3 wrote it, which nobody does any more.
        ("one_scale", std::fs::read(spec.join("vectors/one_scale.lodpack"))?),
        ("objects", boxes_of_objects(60)?),
        ("object_by_hand", HandmadeObjects::example().put_into(Handmade::example().container()).bytes()),
        ("many_clusters", cube_of_squares(3)?),
        ("lists", listed_cube()?),
        ("tree", tree()?),
        ("triangle", built(&triangle(), "0.1edge", Fillings::IrregularOnly, 8192)?),
        ("tetrahedron", built(&tetrahedron(), "0.1edge", Fillings::IrregularOnly, 8192)?),
        ("part", built(&fan_part(8), "0.3edge", Fillings::IrregularOnly, 100)?),
        ("sheet", built(&punched_sheet(16), "0.2edge", Fillings::IrregularOnly, 8192)?),
        ("torus", built(&torus(24), "0.2edge", Fillings::IrregularOnly, 100)?),
        ("closed_torus", built(&torus(16), "0.2edge", Fillings::IrregularOnly, 8192)?),
        ("grids", built(&bumpy_sphere(12), "0.2edge", Fillings::GridWherePossible, 300)?),
        ("far_away", built(&far(torus(16)), "0.2edge", Fillings::IrregularOnly, 100)?),
    ])
}

/// The bytes of chapter 17 of SPEC.md.
fn worked_example(text: &str) -> Result<Vec<u8>, Failure> {
    let mut bytes = vec![];
    for line in text.lines() {
        if let Some((offset, numbers)) = line.split_once(": ")
            && offset.len() == 8
            && u32::from_str_radix(offset, 16).is_ok_and(|offset| offset as usize == bytes.len())
        {
            for number in numbers.split_whitespace() {
                bytes.push(u8::from_str_radix(number, 16)?);
            }
        }
    }
    Ok(bytes)
}

fn built(mesh: &Mesh, tolerance: &str, fillings: Fillings, chart_triangles: u32) -> Result<Vec<u8>, Failure> {
    let path = std::env::temp_dir().join(format!("lodpack-vectors-{}.ply", std::process::id()));
    save_ply(mesh, &path)?;
    let tolerance: Tolerance = tolerance.parse()?;
    let inputs = vec![path.clone()];
    let model = ModelOptions { tolerance, fillings, chart_triangles: Some(chart_triangles), ..ModelOptions::default() };
    let options = BuildOptions { inputs, model, ..BuildOptions::default() };
    let mut bytes = vec![];
    let result = build(&options, &mut bytes, &Silent);
    std::fs::remove_file(path)?;
    result?;
    Ok(bytes)
}

fn triangle() -> Mesh {
    let positions = vec![DVec3::ZERO, DVec3::new(3.0, 0.25, 0.0), DVec3::new(0.5, 2.0, 1.0)];
    Mesh { positions, triangles: vec![[0, 1, 2]] }
}

fn tetrahedron() -> Mesh {
    let positions = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.5, 0.5, 1.5]].map(DVec3::from_array);
    Mesh { positions: positions.to_vec(), triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]] }
}

/// Lets a vertex stay wherever on its tangent plane it is rounded to.
struct Stay;

impl Slide for Stay {
    fn offset(&self, _vertex: u32, _point: [f64; 3], _normal: [f64; 3]) -> f64 {
        0.0
    }
}

/// Corners and arcs, and the half-arcs around each face.
struct Net {
    corners: Vec<LatticePoint>,
    corner_levels: Vec<u8>,
    arcs: Vec<ArcRecord>,
    loops: Vec<Vec<HalfArc>>,
}

const LATTICE: Lattice = Lattice { origin: [0.0; 3], step_log2: -6 };
const QUANTISATION: Quantisation = Quantisation { normal_shift: 0, tangent_shift: 1 };

impl Net {
    /// An arc for each edge. It has samples at a quarter, in the middle and at three quarters, which are pushed
    /// outward; `levels` gives those of the middle and of the other two.
    fn new(
        corners: Vec<LatticePoint>,
        corner_levels: Vec<u8>,
        faces: &[[u32; 4]],
        levels: impl Fn([u32; 2]) -> [u8; 2],
    ) -> Result<Self, Failure> {
        let mut numbers = BTreeMap::new();
        let mut loops = vec![];
        for face in faces {
            let half_arc = |k: usize| {
                let (a, b) = (face[k], face[(k + 1) % 4]);
                let next = numbers.len() as u32;
                HalfArc { arc: *numbers.entry([a.min(b), a.max(b)]).or_insert(next), reversed: a > b }
            };
            loops.push((0..4).map(half_arc).collect::<Vec<_>>());
        }
        let mut targets = vec![ArcTarget::default(); numbers.len()];
        for (&ends, &arc) in &numbers {
            let [a, b] = ends.map(|end| corners[end as usize].map(|x| x as f64));
            let [middle, others] = levels(ends);
            let sample = |(param, level): (u32, u8)| {
                let t = f64::from(param) / 65536.0;
                let bulge = 1.0 + 0.2 * t * (1.0 - t);
                WantedSample { param, level, position: [0, 1, 2].map(|k| (a[k] + (b[k] - a[k]) * t) * bulge) }
            };
            let samples = [(16384, others), (32768, middle), (49152, others)].map(sample).to_vec();
            targets[arc as usize] = ArcTarget { ends, samples };
        }
        let samples = quantise_arcs(&corners, &targets, 2)?;
        let record = |(target, samples): (&ArcTarget, _)| ArcRecord { ends: target.ends, samples };
        let arcs = targets.iter().zip(samples).map(record).collect();
        Ok(Self { corners, corner_levels, arcs, loops })
    }

    fn start(&self, half_arc: HalfArc) -> u32 {
        self.arcs[half_arc.arc as usize].ends[usize::from(half_arc.reversed)]
    }

    /// The half-arcs around some faces that make up a disk, from the first face's first one on.
    fn outline(&self, faces: Range<usize>) -> Vec<HalfArc> {
        let all = self.loops[faces].concat();
        let is_outer = |half_arc: &&HalfArc| !all.contains(&HalfArc { reversed: !half_arc.reversed, ..**half_arc });
        let next: BTreeMap<u32, HalfArc> = all.iter().filter(is_outer).map(|&h| (self.start(h), h)).collect();
        let mut outline = vec![all[0]];
        while outline.len() < next.len() {
            let HalfArc { arc, reversed } = outline[outline.len() - 1];
            outline.push(next[&self.start(HalfArc { arc, reversed: !reversed })]);
        }
        outline
    }

    fn border(&self, half_arcs: &[HalfArc], level: u8) -> Vec<LatticePoint> {
        let mut border = vec![];
        for &half_arc in half_arcs {
            let corner = self.start(half_arc) as usize;
            if self.corner_levels[corner] <= level {
                border.push(self.corners[corner]);
            }
            let samples = self.arcs[half_arc.arc as usize].samples.iter().filter(|sample| sample.level <= level);
            let mut side: Vec<_> = samples.map(|sample| sample.position).collect();
            if half_arc.reversed {
                side.reverse();
            }
            border.extend(side);
        }
        border
    }

    /// A fan around its middle at each level that has an error.
    fn fan(&self, half_arcs: &[HalfArc], errors: &[Option<f64>]) -> Result<RootRecord, Failure> {
        let mut blocks = vec![];
        for (level, error) in (0..).zip(errors) {
            let Some(error) = *error else {
                blocks.push(None);
                continue;
            };
            let border = self.border(half_arcs, level);
            let count = border.len() as u32;
            let middle = [0, 1, 2].map(|k| border.iter().map(|p| p[k] as f64).sum::<f64>() / f64::from(count));
            let triangles: Vec<_> = (0..count).map(|i| [count, i, (i + 1) % count]).collect();
            let target = PatchTarget { loops: &[border], interior: &[middle], triangles: &triangles };
            let mut symbols = SymbolBuffer::default();
            lodpack::write::encode_patch(&target, QUANTISATION, &Stay, &mut symbols)?;
            let border_deviation = error / 2.0;
            blocks.push(Some(BlockRecord {
                error,
                border_deviation,
                triangle_count: count,
                symbols,
                ..BlockRecord::default()
            }));
        }
        let at = |pick: fn(f64, f64) -> f64| {
            let ends = half_arcs.iter().flat_map(|h| self.arcs[h.arc as usize].ends);
            let world: Vec<[f64; 3]> = ends.map(|end| LATTICE.world(self.corners[end as usize])).collect();
            [0, 1, 2].map(|k| world.iter().map(|p| p[k]).reduce(pick).unwrap_or(0.0))
        };
        let (low, high) = (at(f64::min).map(|x| x - 1.5), at(f64::max).map(|x| x + 1.5));
        Ok(RootRecord { loops: vec![half_arcs.to_vec()], bounds: [low, high], blocks, ..RootRecord::default() })
    }

    fn file(
        self,
        tolerances: &[f64],
        roots: Vec<RootRecord>,
        overview: Option<OverviewRecord>,
        list_sizes: ListSizes,
    ) -> Result<Vec<u8>, Failure> {
        let mut bytes = vec![];
        write_listed(&self.model(tolerances, roots, overview), list_sizes, &mut bytes)?;
        Ok(bytes)
    }

    fn model(self, tolerances: &[f64], roots: Vec<RootRecord>, overview: Option<OverviewRecord>) -> Model {
        let level = |&tolerance: &f64| LevelInfo { tolerance, steps: QUANTISATION.into() };
        Model {
            lattice: LATTICE,
            arc_tangent_shift: 2,
            levels: tolerances.iter().map(level).collect(),
            source: SourceInfo { generator: "by hand".into(), ..SourceInfo::default() },
            corners: self.corners,
            corner_levels: self.corner_levels,
            arcs: self.arcs,
            roots,
            channels: vec![],
            overview,
            ..Model::default()
        }
    }
}

/// The same squares at one level; the topmost list has one of their five clusters, and a list of two lists of two.
fn listed_cube() -> Result<Vec<u8>, Failure> {
    let (corners, squares) = squares(3);
    let levels = vec![0; corners.len()];
    let net = Net::new(corners, levels, &squares, |_| [0, 0])?;
    let mut roots = vec![];
    for half_arcs in &net.loops {
        roots.push(net.fan(half_arcs, &[Some(0.5)])?);
    }
    net.file(&[0.5], roots, None, ListSizes { entries: 2, top_clusters: 1, ..ListSizes::default() })
}

/// The cube of squares with two channels. Blocks have bytes that mean nothing, or none; those of the first two clusters
/// have none.
fn cube_with_channels() -> Result<Vec<u8>, Failure> {
    let (corners, squares) = squares(3);
    let levels = vec![0; corners.len()];
    let net = Net::new(corners, levels, &squares, |_| [0, 1])?;
    let mut roots = vec![];
    for half_arcs in &net.loops {
        roots.push(net.fan(half_arcs, &[Some(0.5), Some(0.125)])?);
    }
    let channel = |name: &str, kind, components, step| channel(name, kind, components, step, 2.0 * step);
    let mut model = net.model(&[0.5, 0.125], roots, None);
    let colour = channel("colour", ChannelKind::Colour, 4, 1.0 / 255.0);
    model.channels = vec![colour, channel("\u{b0}C \"outside\"", ChannelKind::Scalar, 1, 0.125)];
    // Texels do not change the order.
    let order = write_listed(&model, ListSizes::default(), &mut vec![])?.root_order;
    for (number, &root) in order.iter().enumerate().skip(order.len() / 2) {
        for (level, block) in model.roots[root as usize].blocks.iter_mut().flatten().enumerate() {
            let stream = |length: usize| (0..length).map(|k| (37 * number + 11 * level + 5 * k) as u8).collect();
            block.texels = vec![stream(4), stream(number % 3 * 5), stream(number % 4 * 2 * level)];
        }
    }
    let mut bytes = vec![];
    write_listed(&model, ListSizes::default(), &mut bytes)?;
    Ok(bytes)
}

/// A cube of six roots with a channel that says how each is drawn: the first in the usual way, and by one number. The
/// last has two numbers, and its coarser block none.
fn drawn_cube() -> Result<Vec<u8>, Failure> {
    let masked = |cutoff: f64| Drawing { alpha: AlphaMode::Mask(cutoff), ..Drawing::default() };
    let of_roots = [
        Drawing::default(),
        Drawing { is_double_sided: true, is_unlit: true, ..Drawing::default() },
        masked(0.5),
        Drawing { is_double_sided: true, ..masked(0.25) },
        Drawing { alpha: AlphaMode::Blend, ..Drawing::default() },
        masked(1e9),
    ];
    painted_cube(vec![channel("drawing", ChannelKind::Drawing, 1, 1.0, 0.0)], |number, level, map| {
        let [width, height] = map.size;
        let is_second = |texel: u32| number == 5 && texel % width > width / 2;
        let data = (0..width * height).map(|texel| if is_second(texel) { 0 } else { of_roots[number].number() });
        let image = Image { size: map.size, components: 1, data: data.collect() };
        let stream = encode_values(&image, &vec![true; (width * height) as usize]);
        vec![if number == 5 && level == 0 { vec![] } else { stream }]
    })
}

/// The same cube with exact channels: a colour with alpha, light, a normal and a factor. The first root has images of
/// one colour, the others have gradients with edges and what looks like noise; every seventh texel is not used, and the
/// last root's coarser block has no images.
fn exact_cube() -> Result<Vec<u8>, Failure> {
    let exact = |name, kind, components, step: f64| ChannelInfo {
        is_exact: true,
        is_scaled: false,
        ..channel(name, kind, components, step, step / 2.0)
    };
    let channels = vec![
        exact("colour", ChannelKind::Colour, 4, 1.0),
        exact("emissive", ChannelKind::Colour, 3, 1.0),
        ChannelInfo { low: -128.0 / 127.0, ..exact("normal", ChannelKind::Normal, 2, 1.0 / 127.0) },
        exact("roughness", ChannelKind::Factor, 1, 1.0 / 255.0),
    ];
    painted_cube(channels, |number, level, map| {
        if number == 5 && level == 0 {
            return vec![vec![]; 4];
        }
        let [width, height] = map.size;
        let texels = || (0..width * height).map(|texel| [texel % width, texel / width]);
        let is_used: Vec<bool> = (0..width * height).map(|texel| texel % 7 != 3).collect();
        let image = |components: u8, seed: u32| {
            let of_texel = |[x, y]: [u32; 2], k: u32| match (number, (x / 9 + y / 5 + seed) % 3) {
                (0, _) => 40 * k + seed,
                (_, 0) => (200 + k).wrapping_sub(3 * x),
                (_, 1) => (x * 31 + y * 17 + k * 5).pow(2) / 7,
                _ => 2 * y + 60 * k,
            };
            let data = texels().flat_map(|at| (0..u32::from(components)).map(move |k| of_texel(at, k) as u8));
            encode_exact_image(&Image { size: map.size, components, data: data.collect() }, &is_used)
        };
        let direction = |[x, y]: [u32; 2]| match number {
            0 => [0.0, 0.0, 1.0],
            _ => [x as f32 - 8.0, 5.0 - y as f32, (x * y % 11) as f32],
        };
        let directions: Vec<[f32; 3]> = texels().map(direction).collect();
        vec![image(4, 1), image(3, 2), encode_exact_normals(map, &directions, &is_used), image(1, 3)]
    })
}

/// The same cube with images in scales, a colour with alpha, a normal and a factor, and beside them numbers and an
/// exact colour. The first root has images of one colour, the second means alone; every ninth texel is not used, nor
/// any of some blocks of texels, and the last root's coarser block has no images.
fn scaled_cube() -> Result<Vec<u8>, Failure> {
    let scaled = |name, kind, components, step: f64| ChannelInfo {
        is_scaled: true,
        ..channel(name, kind, components, step, 0.0)
    };
    let channels = vec![
        scaled("colour", ChannelKind::Colour, 4, 1.0),
        channel("depth", ChannelKind::Scalar, 1, 0.25, 0.0),
        ChannelInfo { low: -128.0 / 127.0, ..scaled("normal", ChannelKind::Normal, 2, 1.0 / 127.0) },
        ChannelInfo { is_exact: true, ..channel("emissive", ChannelKind::Colour, 3, 1.0, 0.5) },
        scaled("roughness", ChannelKind::Factor, 1, 1.0 / 255.0),
    ];
    painted_cube(channels, |number, level, map| {
        if number == 5 && level == 0 {
            return vec![vec![]; 14];
        }
        let [width, height] = map.size;
        let texels = || (0..width * height).map(|texel| [texel % width, texel / width]);
        let is_used: Vec<bool> = texels().map(|[x, y]| (x + y) % 9 != 4 && (x / 8 + y / 8) % 3 != 2).collect();
        let image = |components: u8, seed: u32| {
            let of_texel = |[x, y]: [u32; 2], k: u32| match (number, (x / 9 + y / 5 + seed) % 3) {
                (0, _) => 40 * k + seed,
                (1, _) => 20 * (x / 8) + 30 * (y / 8) + 10 * k,
                (_, 0) => (200 + k).wrapping_sub(3 * x),
                (_, 1) => (x * 31 + y * 17 + k * 5).pow(2) / 7,
                _ => 2 * y + 60 * k,
            };
            let data = texels().flat_map(|at| (0..u32::from(components)).map(move |k| of_texel(at, k) as u8));
            Image { size: map.size, components, data: data.collect() }
        };
        let direction = |[x, y]: [u32; 2]| match number {
            0 => [0.0, 0.0, 1.0],
            _ => [x as f32 - 8.0, 5.0 - y as f32, (x * y % 11) as f32],
        };
        let directions: Vec<[f32; 3]> = texels().map(direction).collect();
        let numbers = Image { size: map.size, components: 1, data: texels().map(|[x, y]| (x * y) as u16).collect() };
        let step = 2 + 7 * number as u8;
        let mut streams = encode_image(&image(4, 1), &is_used, step).to_vec();
        streams.push(encode_values(&numbers, &is_used));
        streams.extend(encode_normals(map, &directions, &is_used, step));
        streams.push(encode_exact_image(&image(3, 2), &is_used));
        streams.extend(encode_image(&image(1, 3), &is_used, step));
        streams
    })
}

fn channel(name: &str, kind: ChannelKind, components: u8, step: f64, bound: f64) -> ChannelInfo {
    ChannelInfo { name: name.to_owned(), kind, is_exact: false, is_scaled: false, components, low: 0.0, step, bound }
}

/// A cube of six roots at two levels with these channels. `images` gives the streams of a block, of which the root, the
/// level and the map are given.
fn painted_cube(
    channels: Vec<ChannelInfo>,
    images: impl Fn(usize, u8, &Map) -> Vec<Vec<u8>>,
) -> Result<Vec<u8>, Failure> {
    let (corners, squares) = squares(1);
    let levels = vec![0; corners.len()];
    let net = Net::new(corners, levels, &squares, |_| [0, 1])?;
    let mut roots = vec![];
    for half_arcs in &net.loops {
        roots.push(net.fan(half_arcs, &[Some(0.5), Some(0.125)])?);
    }
    let mut model = net.model(&[0.5, 0.125], roots, None);
    model.channels = channels;
    let mut bytes = vec![];
    let order = write_listed(&model, ListSizes::default(), &mut bytes)?.root_order;
    // Maps project what decodes.
    let file = File::open(bytes.as_slice(), Limits::default())?;
    let mut texels = vec![];
    for number in 0..6 {
        for level in 0..2 {
            let RootPatch { patch, loops, .. } = file.decode_root(number as u32, level)?;
            let border = loops.iter().flatten().map(|vertex| vertex.position);
            let positions: Vec<LatticePoint> = border.chain(patch.interior.iter().copied()).collect();
            // One root has texels of another size, and one such as are longer than wide and lie aslant.
            let axis = axis_of(&positions);
            let long = LongTexels {
                across: [0, 1, 2].map(|k| axis[(k + 1) % 3] + 2 * axis[(k + 2) % 3]),
                finer: 2,
                coarser: 3,
            };
            let shape = PieceShape { axis, ..PieceShape::default() };
            let shapes = [match number {
                3 => PieceShape { larger: 1, long: Some(long), ..shape },
                4 => PieceShape { larger: 3, ..shape },
                _ => shape,
            }];
            let labels = vec![0; patch.triangles.len()];
            let (map, bytes) = encode_map(&positions, &patch.triangles, 10, &shapes, &labels, 1 << 20)?;
            let streams = [vec![bytes], images(number, level, &map)].concat();
            texels.push((order[number], level, streams));
        }
    }
    for (root, level, streams) in texels {
        if let Some(Some(block)) = model.roots[root as usize].blocks.get_mut(usize::from(level)) {
            block.texels = streams;
        }
    }
    let mut bytes = vec![];
    write_listed(&model, ListSizes::default(), &mut bytes)?;
    Ok(bytes)
}

/// The axis of a side of a cube around the origin that has these points.
fn axis_of(points: &[LatticePoint]) -> [i8; 3] {
    let sum = |k: usize| points.iter().map(|point| point[k]).sum::<i64>();
    let largest = (0..3).max_by_key(|&k| sum(k).abs()).unwrap_or(0);
    [0, 1, 2].map(|k| if k == largest { sum(k).signum() as i8 } else { 0 })
}

/// A cube with `n` by `n` roots per side, each a bulging square: more roots than a cluster can hold.
fn cube_of_squares(n: i64) -> Result<Vec<u8>, Failure> {
    let (corners, squares) = squares(n);
    let levels = vec![0; corners.len()];
    let net = Net::new(corners, levels, &squares, |_| [0, 1])?;
    let mut roots = vec![];
    for half_arcs in &net.loops {
        roots.push(net.fan(half_arcs, &[Some(0.5), Some(0.125)])?);
    }
    net.file(&[0.5, 0.125], roots, Some(overview(QUANTISATION)?), ListSizes::default())
}

/// Four by two squares. Over the four on the left lies a group, over that and the two beside it another one; the two on
/// the right have nothing above them. Where no more than two roots meet, corners are missing at coarse levels.
fn tree() -> Result<Vec<u8>, Failure> {
    // Three rows, seen from above.
    let corners = (0..15).map(|k| [k % 5 * 200 - 400, k / 5 * 200 - 200, 300 - k % 4 * 25]).collect();
    let corner_levels = [[0, 2, 1, 0, 2], [1, 2, 1, 0, 0], [0, 2, 0, 0, 0]].concat();
    let squares = [0, 1, 5, 6, 2, 7, 3, 8].map(|k| [k, k + 1, k + 6, k + 5]);
    let net = Net::new(corners, corner_levels, &squares, |[a, b]| if b < 5 { [2, 3] } else { [a as u8 % 3, 3] })?;
    let mut roots = vec![net.fan(&net.outline(0..6), &[Some(2.0), None, None, None])?];
    roots.push(RootRecord { parent: Some(0), ..net.fan(&net.outline(0..4), &[None, Some(1.0), None, None])? });
    for (square, half_arcs) in net.loops.iter().enumerate() {
        let (parent, errors) = match square {
            0..4 => (Some(1), [None, None, Some(0.5), Some(0.125)]),
            4 => (Some(0), [None, Some(0.75), None, Some(0.25)]),
            5 => (Some(0), [None, Some(0.75), None, None]),
            6 => (None, [Some(1.5), None, Some(0.5), None]),
            _ => (None, [Some(1.5), None, None, None]),
        };
        roots.push(RootRecord { parent, ..net.fan(half_arcs, &errors)? });
    }
    net.file(&[2.0, 1.0, 0.5, 0.125], roots, None, ListSizes::default())
}

/// A fan of six triangles with a border, and a tetrahedron without one.
fn overview(quantisation: Quantisation) -> Result<OverviewRecord, Failure> {
    let quantisation = Quantisation { normal_shift: 3, ..quantisation };
    let ring = [[320, 0, 8], [160, 272, 0], [-160, 272, 16], [-320, 0, 0], [-160, -272, -8], [160, -272, 0]];
    let loops = vec![ring.to_vec()];
    let interior =
        [[3.0, -5.0, 61.0], [0.0, 0.0, 200.0], [90.0, 0.0, 120.0], [-50.0, 80.0, 120.0], [-40.0, -80.0, 112.0]];
    let mut triangles: Vec<[u32; 3]> = (0..6).map(|k| [k, (k + 1) % 6, 6]).collect();
    triangles.extend([[7, 8, 9], [7, 9, 10], [7, 10, 8], [8, 10, 9]]);
    let target = PatchTarget { loops: &loops, interior: &interior, triangles: &triangles };
    let mut symbols = SymbolBuffer::default();
    lodpack::write::encode_patch(&target, quantisation, &Stay, &mut symbols)?;
    Ok(OverviewRecord { error: 6.5, quantisation, loops, triangle_count: triangles.len() as u32, symbols })
}

/// Corners and squares of a cube's surface, in lattice units.
fn squares(n: i64) -> (Vec<LatticePoint>, Vec<[u32; 4]>) {
    let (mut corners, mut squares, mut numbers) = (vec![], vec![], BTreeMap::new());
    for axis in 0..3 {
        // The second side is turned, so that all squares are counter-clockwise seen from outside.
        for (side, u, v) in [(0, (axis + 2) % 3, (axis + 1) % 3), (n, (axis + 1) % 3, (axis + 2) % 3)] {
            for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
                squares.push([(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(a, b)| {
                    let mut cell = [0; 3];
                    (cell[axis], cell[u], cell[v]) = (side, a, b);
                    *numbers.entry(cell).or_insert_with(|| {
                        corners.push(cell.map(|x| (2 * x - n) * 300 / n));
                        corners.len() as u32 - 1
                    })
                }));
            }
        }
    }
    (corners, squares)
}
