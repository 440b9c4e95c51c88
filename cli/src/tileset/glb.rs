//! The content of a tile: binary glTF with compressed triangles (EXT_meshopt_compression).
//!
//! Positions are lattice points as single-precision numbers: steps from the middle of the file times a power of two,
//! with 24 bits, which the compression stores as integers (its filter EXPONENTIAL). So nothing is rounded in a file of
//! up to 2^24 steps, and what tiles share is the same in all of them to the bit. No tile has a transform of its own:
//! with 16-bit integers (KHR_mesh_quantization) each would need one, in which renderers round, and pixels of the
//! background show between tiles.

use super::features::{FEATURES, Features, METADATA, Property, metadata};
use super::material::{Paint, plain};
use crate::mesh::encoded::Encoded;
use crate::mesh::material::UNLIT;
use crate::mesh::shaded::{Shading, linear};
use lodpack::{Lattice, LatticePoint};
use serde_json::{Value, json};
use std::io;

/// glTF's numbers for types of components and targets of buffers.
const BYTE: u32 = 5120;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Directions of maps count in 2 to this power.
const FINE: i32 = -15;
/// Bits of each of the two numbers of a normal without a map: it is up to .7 degrees off.
const NORMAL_BITS: i32 = 8;
/// Bits of a coordinate, with its sign; a byte of exponent follows.
const MANTISSA_BITS: u32 = 24;

/// What a tile draws.
pub struct Content {
    /// None without triangles.
    pub glb: Option<Vec<u8>>,
    /// Box around the triangles.
    pub bounds: Option<[LatticePoint; 2]>,
}

/// A stream of a primitive: compressed bytes and what they become.
struct Stream {
    compressed: Vec<u8>,
    stride: usize,
    count: usize,
    mode: &'static str,
    filter: Option<&'static str>,
    target: u32,
}

impl Content {
    /// Triangles between some of these points, what they look like, by images or by what each point has, and the
    /// objects that they belong to.
    ///
    /// # Errors
    /// If an image is too large for its format.
    pub fn new(
        points: &[LatticePoint],
        triangles: &[[u32; 3]],
        (paint, shading, features): (Option<&Paint>, Option<&Shading>, Option<&Features>),
        positions: &Positions,
    ) -> io::Result<Self> {
        let (used, indices) = in_order_of_use(points.len(), triangles.as_flattened());
        // What one material draws is a primitive.
        let counts = paint.map_or(vec![triangles.len()], |paint| paint.parts.iter().map(|(_, count)| *count).collect());
        let mut rest = indices.as_slice();
        let parts = counts.iter().map(|count| rest.split_off(..3 * count).unwrap_or_default());
        // Strips compress best.
        let indices: Vec<u32> = parts.flat_map(|part| meshopt::optimize_vertex_cache_strip(part, used.len())).collect();
        let (order, indices) = in_order_of_use(used.len(), &indices);
        let order: Vec<usize> = order.iter().map(|&number| used[number as usize] as usize).collect();
        let points: Vec<LatticePoint> = order.iter().map(|&number| points[number]).collect();
        let Some(&first) = points.first() else { return Ok(Self { glb: None, bounds: None }) };
        let bounds = points.iter().fold([first; 2], |[low, high], p| {
            [[0, 1, 2].map(|k| low[k].min(p[k])), [0, 1, 2].map(|k| high[k].max(p[k]))]
        });
        let corners = bounds.map(|point| positions.world(point));
        // glTF has y up, and the tileset's z is its -z.
        let low: [f64; 3] = [0, 1, 2].map(|k| corners[0][k].min(corners[1][k]));
        let high: [f64; 3] = [0, 1, 2].map(|k| corners[0][k].max(corners[1][k]));
        let vertices = positions.stream(&points);
        let (index_type, stride) = if points.len() <= 1 << 16 { (UNSIGNED_SHORT, 2) } else { (UNSIGNED_INT, 4) };
        let translation = positions.translation;
        let mut content = Glb { streams: vec![vertices], translation, ..Glb::default() };
        content.accessors = vec![
            json!({"bufferView": 0, "componentType": FLOAT, "count": points.len(), "type": "VEC3", "min": low, "max": high}),
        ];
        let mut rest = indices.as_slice();
        for count in counts {
            let part = rest.split_off(..3 * count).unwrap_or_default();
            // Both encoders fail only without memory.
            let compressed = meshopt::encode_index_buffer(part, points.len()).unwrap_or_default();
            let (mode, target) = ("TRIANGLES", ELEMENT_ARRAY_BUFFER);
            content.accessors.push(
                json!({"bufferView": content.streams.len(), "componentType": index_type, "count": part.len(), "type": "SCALAR"}),
            );
            content.streams.push(Stream { compressed, stride, count: part.len(), mode, filter: None, target });
            content.primitive_count += 1;
        }
        content.attributes = json!({"POSITION": 0});
        content.materials = vec![plain()];
        if let Some(paint) = paint {
            content.add(paint, &order)?;
        }
        if let Some(shading) = shading {
            content.add_shading(shading, &order);
        }
        if let Some(features) = features {
            content.add_features(features, &order);
        }
        Ok(Self { glb: Some(content.bytes()), bounds: Some(bounds) })
    }
}

/// Numbers of vertices in the order in which triangles use them, and the triangles with their new numbers; others are
/// dropped.
pub fn in_order_of_use(count: usize, indices: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut new = vec![u32::MAX; count];
    let mut used = Vec::with_capacity(count);
    let rename = |&old: &u32| {
        let slot = &mut new[old as usize];
        if *slot == u32::MAX {
            *slot = used.len() as u32;
            used.push(old);
        }
        *slot
    };
    let indices = indices.iter().map(rename).collect();
    (used, indices)
}

/// How lattice points become numbers of 24 bits and an exponent.
#[derive(Clone, Copy, Debug)]
pub struct Positions {
    lattice: Lattice,
    origin: LatticePoint,
    /// Bits of a lattice coordinate that are lost; 0 unless the file has more than 2^24 steps.
    shift: u32,
    exponent: i32,
    /// Where the origin is in the tileset, in glTF's axes.
    translation: [f64; 3],
}

impl Positions {
    /// For a file whose lattice points are at most `extent` steps from the origin.
    pub fn new(lattice: &Lattice, origin: LatticePoint, extent: u64) -> Self {
        let shift = (u64::BITS - extent.leading_zeros()).saturating_sub(MANTISSA_BITS - 1);
        let exponent = lattice.step_log2.saturating_add(shift as i32);
        Self { lattice: *lattice, origin, shift, exponent, translation: [0.0; 3] }
    }

    /// For a tile with an origin of its own, in a tileset whose origin is elsewhere.
    pub fn around(lattice: &Lattice, tileset_origin: LatticePoint, origin: LatticePoint, extent: u64) -> Self {
        let [x, y, z] = [0, 1, 2].map(|k| (origin[k] - tileset_origin[k]) as f64 * lattice.step());
        Self { translation: [x, z, -y], ..Self::new(lattice, origin, extent) }
    }

    /// Whether single precision can hold such numbers.
    pub fn fits(&self) -> bool {
        (-100..=100).contains(&self.exponent)
    }

    /// How far a point is moved at most, in lattice steps.
    pub fn rounding(&self) -> f64 {
        if self.shift == 0 { 0.0 } else { 0.5 * (1_u64 << self.shift) as f64 * 3_f64.sqrt() }
    }

    /// The lattice point at a position of the file.
    pub fn on_lattice(&self, position: [f64; 3]) -> LatticePoint {
        self.lattice.units(position).map(|units| units.round() as i64)
    }

    /// A lattice point as integers in glTF's axes: y is up, and the tileset's y is its -z.
    fn steps(&self, point: LatticePoint) -> [i64; 3] {
        let half = (1_i64 << self.shift) >> 1;
        let [x, y, z] = [0, 1, 2].map(|k| (point[k] - self.origin[k] + half) >> self.shift);
        let most = (1 << (MANTISSA_BITS - 1)) - 1;
        [x, z, -y].map(|steps| steps.clamp(-most, most))
    }

    /// A lattice point as a decoder finds it.
    fn world(&self, point: LatticePoint) -> [f64; 3] {
        let unit = Lattice { step_log2: self.exponent, ..Lattice::default() }.step();
        self.steps(point).map(|steps| steps as f64 * unit)
    }

    fn stream(&self, points: &[LatticePoint]) -> Stream {
        let word = |steps: i64| (self.exponent as u32) << MANTISSA_BITS | (steps as u32 & ((1 << MANTISSA_BITS) - 1));
        let words: Vec<[u32; 3]> = points.iter().map(|&point| self.steps(point).map(word)).collect();
        // EXT_meshopt_compression has version 0 of the encoding.
        let compressed = meshopt::encode_vertex_buffer_level(&words, 2, Some(0)).unwrap_or_default();
        let (mode, filter) = ("ATTRIBUTES", Some("EXPONENTIAL"));
        Stream { compressed, stride: 12, count: points.len(), mode, filter, target: ARRAY_BUFFER }
    }
}

/// Directions as numbers of 24 bits that count in a power of two, with one more number each if there is one.
fn directions<const N: usize>(exponent: i32, all: impl Iterator<Item = ([f32; 3], Option<f32>)>) -> Stream {
    let word = |x: f32| {
        let steps = (x * (1 << -exponent) as f32).round() as i32;
        (exponent as u32) << MANTISSA_BITS | (steps as u32 & ((1 << MANTISSA_BITS) - 1))
    };
    let of = |([x, y, z], last): ([f32; 3], Option<f32>)| {
        // y is up.
        let mut numbers = [x, z, -y].into_iter().chain(last);
        std::array::from_fn::<u32, N, _>(|_| numbers.next().map_or(0, word))
    };
    let words: Vec<[u32; N]> = all.map(of).collect();
    let compressed = meshopt::encode_vertex_buffer_level(&words, 2, Some(0)).unwrap_or_default();
    let (mode, filter) = ("ATTRIBUTES", Some("EXPONENTIAL"));
    Stream { compressed, stride: 4 * N, count: words.len(), mode, filter, target: ARRAY_BUFFER }
}

/// Normals as points of an octahedron.
fn octahedral(normals: impl Iterator<Item = [f32; 3]>) -> Stream {
    // y is up.
    let directions: Vec<[f32; 4]> = normals.map(|[x, y, z]| [x, z, -y, 0.0]).collect();
    let words: Vec<[i8; 4]> = meshopt::encode_filter_oct(&directions, NORMAL_BITS);
    let compressed = meshopt::encode_vertex_buffer_level(&words, 2, Some(0)).unwrap_or_default();
    let (mode, filter) = ("ATTRIBUTES", Some("OCTAHEDRAL"));
    Stream { compressed, stride: 4, count: words.len(), mode, filter, target: ARRAY_BUFFER }
}

/// A binary glTF file of one mesh.
#[derive(Default)]
struct Glb {
    streams: Vec<Stream>,
    accessors: Vec<Value>,
    attributes: Value,
    /// One for each primitive.
    materials: Vec<Value>,
    /// Their indices are accessors 1, 2, ...
    primitive_count: usize,
    images: Vec<Encoded>,
    translation: [f64; 3],
    /// Extensions that a reader must know beside that of compression.
    required: Vec<&'static str>,
    /// How many objects there are, what primitives say of them, and what they are called.
    objects: Option<(usize, Value, [Property; 3])>,
}

impl Glb {
    /// Adds what points look like, which stand in this order.
    fn add(&mut self, paint: &Paint, order: &[usize]) -> io::Result<()> {
        (self.images, self.materials) = paint.encode()?;
        if !paint.has_images() {
            return Ok(());
        }
        // Shares of 65535 of the image: a sixteenth of a texel in one of 4096.
        let share = |x: f32| (x.clamp(0.0, 1.0) * 65535.0).round() as u16;
        let words: Vec<[u16; 2]> = order.iter().map(|&number| paint.places[number].map(share)).collect();
        let compressed = meshopt::encode_vertex_buffer_level(&words, 2, Some(0)).unwrap_or_default();
        let (mode, target) = ("ATTRIBUTES", ARRAY_BUFFER);
        let places = Stream { compressed, stride: 4, count: words.len(), mode, filter: None, target };
        self.add_attribute("TEXCOORD_0", places, UNSIGNED_SHORT, "VEC2");
        if !paint.frames.is_empty() {
            let of = |which: usize| order.iter().map(move |&number| paint.frames[number][which]);
            self.add_attribute("NORMAL", directions::<3>(FINE, of(1).map(|normal| (normal, None))), FLOAT, "VEC3");
            self.add_attribute(
                "TANGENT",
                directions::<4>(FINE, of(0).map(|tangent| (tangent, Some(-1.0)))),
                FLOAT,
                "VEC4",
            );
        }
        Ok(())
    }

    /// Adds normals, and colours if there are some, of points that stand in this order.
    fn add_shading(&mut self, shading: &Shading, order: &[usize]) {
        let normals = order.iter().map(|&number| shading.normals[number]);
        self.add_attribute("NORMAL", octahedral(normals), BYTE, "VEC3");
        self.required.push("KHR_mesh_quantization");
        let Some(colours) = &shading.colours else { return };
        let words: Vec<[u16; 4]> = order.iter().map(|&number| linear(colours[number])).collect();
        let compressed = meshopt::encode_vertex_buffer_level(&words, 2, Some(0)).unwrap_or_default();
        let (mode, target) = ("ATTRIBUTES", ARRAY_BUFFER);
        let colours = Stream { compressed, stride: 8, count: words.len(), mode, filter: None, target };
        self.add_attribute("COLOR_0", colours, UNSIGNED_SHORT, "VEC4");
        let mut material = plain();
        material["pbrMetallicRoughness"]["baseColorFactor"] = json!([1.0, 1.0, 1.0, 1.0]);
        self.materials = vec![material];
    }

    /// Adds the objects of points that stand in this order.
    fn add_features(&mut self, features: &Features, order: &[usize]) {
        let numbers = order.iter().map(|&point| features.of_points[point]);
        // Attributes have no integers of 32 bits, and single precision has 24.
        let (component_type, words): (u32, Vec<[u8; 4]>) = match features.count() <= 1 << 16 {
            true => (UNSIGNED_SHORT, numbers.map(u32::to_le_bytes).collect()),
            false => (FLOAT, numbers.map(|number| (number as f32).to_le_bytes()).collect()),
        };
        let compressed = meshopt::encode_vertex_buffer_level(&words, 2, Some(0)).unwrap_or_default();
        let (mode, target) = ("ATTRIBUTES", ARRAY_BUFFER);
        let numbers = Stream { compressed, stride: 4, count: words.len(), mode, filter: None, target };
        self.attributes["_FEATURE_ID_0"] = self.accessors.len().into();
        self.accessors.push(json!({
            "bufferView": self.streams.len(), "componentType": component_type, "count": words.len(), "type": "SCALAR"}));
        self.streams.push(numbers);
        self.objects = Some((features.count(), features.of_primitive(), features.properties()));
    }

    fn add_attribute(&mut self, name: &str, stream: Stream, component_type: u32, kind: &str) {
        let mut accessor = json!({
            "bufferView": self.streams.len(), "componentType": component_type, "count": stream.count, "type": kind});
        if component_type != FLOAT {
            accessor["normalized"] = true.into();
        }
        self.attributes[name] = self.accessors.len().into();
        self.accessors.push(accessor);
        self.streams.push(stream);
    }

    fn bytes(self) -> Vec<u8> {
        let (mut views, mut binary, mut plain_bytes) = (vec![], vec![], 0);
        for stream in &self.streams {
            let length = stream.stride * stream.count;
            let mut view = json!({
                // Buffer 1 exists only in name: nothing stands in it but what is decompressed.
                "buffer": 1, "byteOffset": plain_bytes, "byteLength": length, "target": stream.target,
                "extensions": {"EXT_meshopt_compression": {
                    "buffer": 0, "byteOffset": binary.len(), "byteLength": stream.compressed.len(),
                    "byteStride": stream.stride, "count": stream.count, "mode": stream.mode,
                }},
            });
            if stream.target == ARRAY_BUFFER {
                view["byteStride"] = stream.stride.into();
            }
            if let Some(filter) = stream.filter {
                view["extensions"]["EXT_meshopt_compression"]["filter"] = filter.into();
            }
            views.push(view);
            plain_bytes = (plain_bytes + length).next_multiple_of(4);
            binary.extend_from_slice(&stream.compressed);
            binary.resize(binary.len().next_multiple_of(4), 0);
        }
        let mut images = vec![];
        for (bytes, media_type) in &self.images {
            images.push(json!({"bufferView": views.len(), "mimeType": media_type}));
            views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len()}));
            binary.extend_from_slice(bytes);
            binary.resize(binary.len().next_multiple_of(4), 0);
        }
        let mut texts = vec![];
        for property in self.objects.iter().flat_map(|(.., properties)| properties) {
            let mut view = |bytes: &[u8]| {
                views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len()}));
                binary.extend_from_slice(bytes);
                binary.resize(binary.len().next_multiple_of(8), 0);
                views.len() - 1
            };
            // A view has at least one byte.
            let values = if property.values.is_empty() { b"\0" } else { property.values.as_slice() };
            texts.push((property.name, view(values), view(&property.offsets)));
        }
        let required = [&["EXT_meshopt_compression"], self.required.as_slice()].concat();
        let is_unlit = |material: &Value| material["extensions"][UNLIT].is_object();
        let unlit = self.materials.iter().any(is_unlit).then_some(UNLIT);
        let of_objects = self.objects.iter().flat_map(|_| [FEATURES, METADATA]);
        let used: Vec<&str> = required.iter().copied().chain(unlit).chain(of_objects).collect();
        let primitive = |number: usize| {
            let mut primitive = json!({"attributes": self.attributes, "indices": 1 + number, "material": number});
            if let Some((_, features, _)) = &self.objects {
                primitive["extensions"] = json!({FEATURES: features});
            }
            primitive
        };
        let primitives: Vec<Value> = (0..self.primitive_count).map(primitive).collect();
        let mut document = json!({
            "asset": {"version": "2.0", "generator": concat!("lodpack ", env!("CARGO_PKG_VERSION"))},
            "extensionsUsed": used, "extensionsRequired": required,
            "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": primitives}],
            "materials": self.materials,
            "buffers": [
                {"byteLength": binary.len()},
                {"byteLength": plain_bytes, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}],
            "bufferViews": views,
            "accessors": self.accessors,
        });
        if let Some((count, ..)) = self.objects {
            document["extensions"] = json!({METADATA: metadata(count, &texts)});
        }
        if self.translation != [0.0; 3] {
            document["nodes"][0]["translation"] = json!(self.translation);
        }
        if !images.is_empty() {
            let texture = |source: usize| json!({"sampler": 0, "source": source});
            document["textures"] = (0..images.len()).map(texture).collect();
            document["images"] = images.into();
            document["samplers"] = json!([{"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}]);
        }
        packed(&document, &binary)
    }
}

/// A document and its binary part as one file.
fn packed(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + binary.len();
    let mut glb = Vec::with_capacity(total);
    // A tile is far smaller than 4 GiB: a block has at most 2^32 triangles of less than a byte, and its memory is
    // limited.
    let words = |glb: &mut Vec<u8>, words: &[usize]| {
        words.iter().for_each(|&word| glb.extend_from_slice(&(word as u32).to_le_bytes()));
    };
    words(&mut glb, &[0x4654_6C67, 2, total, text.len(), 0x4E4F_534A]);
    glb.extend_from_slice(&text);
    words(&mut glb, &[binary.len(), 0x004E_4942]);
    glb.extend_from_slice(binary);
    glb
}
