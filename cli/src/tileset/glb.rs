//! The content of a tile: binary glTF with compressed triangles (EXT_meshopt_compression).
//!
//! Positions are lattice points as single-precision numbers: steps from the middle of the file times a power of two, with 24 bits, which the
//! compression stores as integers (its filter EXPONENTIAL). So nothing is rounded in a file of up to 2^24 steps, and what tiles share is
//! the same in all of them to the bit. No tile has a transform of its own: with 16-bit integers (KHR_mesh_quantization) each would need
//! one, in which renderers round, and pixels of the background show between tiles.

use super::material;
use lodpack::{Lattice, LatticePoint};
use serde_json::{Value, json};

/// glTF's numbers for types of components and targets of buffers.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

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
    /// Triangles between some of these points.
    pub fn new(points: &[LatticePoint], triangles: &[[u32; 3]], positions: &Positions) -> Self {
        let (points, indices) = in_order_of_use(points, triangles.as_flattened());
        // Strips compress best.
        let indices = meshopt::optimize_vertex_cache_strip(&indices, points.len());
        let (points, indices) = in_order_of_use(&points, &indices);
        let Some(&first) = points.first() else { return Self { glb: None, bounds: None } };
        let bounds = points.iter().fold([first; 2], |[low, high], p| {
            [[0, 1, 2].map(|k| low[k].min(p[k])), [0, 1, 2].map(|k| high[k].max(p[k]))]
        });
        let corners = bounds.map(|point| positions.world(point));
        // glTF has y up, and the tileset's z is its -z.
        let low: [f64; 3] = [0, 1, 2].map(|k| corners[0][k].min(corners[1][k]));
        let high: [f64; 3] = [0, 1, 2].map(|k| corners[0][k].max(corners[1][k]));
        let vertices = positions.stream(&points);
        let (index_type, stride) = if points.len() <= 1 << 16 { (UNSIGNED_SHORT, 2) } else { (UNSIGNED_INT, 4) };
        // Both encoders fail only without memory.
        let compressed = meshopt::encode_index_buffer(&indices, points.len()).unwrap_or_default();
        let triangles = Stream {
            compressed,
            stride,
            count: indices.len(),
            mode: "TRIANGLES",
            filter: None,
            target: ELEMENT_ARRAY_BUFFER,
        };
        let accessors = json!([
            {"bufferView": 0, "componentType": FLOAT, "count": points.len(), "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": index_type, "count": indices.len(), "type": "SCALAR"},
        ]);
        Self { glb: Some(glb(&[vertices, triangles], &accessors)), bounds: Some(bounds) }
    }
}

/// Vertices in the order in which triangles use them; others are dropped.
fn in_order_of_use(points: &[LatticePoint], indices: &[u32]) -> (Vec<LatticePoint>, Vec<u32>) {
    let mut new = vec![u32::MAX; points.len()];
    let mut used = Vec::with_capacity(points.len());
    let rename = |&old: &u32| {
        let slot = &mut new[old as usize];
        if *slot == u32::MAX {
            *slot = used.len() as u32;
            used.push(points[old as usize]);
        }
        *slot
    };
    let indices = indices.iter().map(rename).collect();
    (used, indices)
}

/// How lattice points become numbers of 24 bits and an exponent.
#[derive(Clone, Copy, Debug)]
pub struct Positions {
    origin: LatticePoint,
    /// Bits of a lattice coordinate that are lost; 0 unless the file has more than 2^24 steps.
    shift: u32,
    exponent: i32,
}

impl Positions {
    /// For a file whose lattice points are at most `extent` steps from the origin.
    pub fn new(lattice: &Lattice, origin: LatticePoint, extent: u64) -> Self {
        let shift = (u64::BITS - extent.leading_zeros()).saturating_sub(MANTISSA_BITS - 1);
        Self { origin, shift, exponent: lattice.step_log2.saturating_add(shift as i32) }
    }

    /// Whether single precision can hold such numbers.
    pub fn fits(&self) -> bool {
        (-100..=100).contains(&self.exponent)
    }

    /// How far a point is moved at most, in lattice steps.
    pub fn rounding(&self) -> f64 {
        if self.shift == 0 { 0.0 } else { 0.5 * (1_u64 << self.shift) as f64 * 3_f64.sqrt() }
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

fn glb(streams: &[Stream], accessors: &Value) -> Vec<u8> {
    let (mut views, mut compressed, mut plain_bytes) = (vec![], vec![], 0);
    for stream in streams {
        let length = stream.stride * stream.count;
        let mut view = json!({
            // Buffer 1 exists only in name: nothing stands in it but what is decompressed.
            "buffer": 1, "byteOffset": plain_bytes, "byteLength": length, "target": stream.target,
            "extensions": {"EXT_meshopt_compression": {
                "buffer": 0, "byteOffset": compressed.len(), "byteLength": stream.compressed.len(),
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
        compressed.extend_from_slice(&stream.compressed);
        compressed.resize(compressed.len().next_multiple_of(4), 0);
    }
    let extensions = ["EXT_meshopt_compression"];
    let mut document = json!({
        "asset": {"version": "2.0", "generator": concat!("lodpack ", env!("CARGO_PKG_VERSION"))},
        "extensionsUsed": extensions, "extensionsRequired": extensions,
        "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [
            {"byteLength": compressed.len()},
            {"byteLength": plain_bytes, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}],
        "bufferViews": views,
        "accessors": accessors,
    });
    material::apply(&mut document);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + compressed.len();
    let mut glb = Vec::with_capacity(total);
    // A tile is far smaller than 4 GiB: a block has at most 2^32 triangles of less than a byte, and its memory is limited.
    let words = |glb: &mut Vec<u8>, words: &[usize]| {
        words.iter().for_each(|&word| glb.extend_from_slice(&(word as u32).to_le_bytes()));
    };
    words(&mut glb, &[0x4654_6C67, 2, total, text.len(), 0x4E4F_534A]);
    glb.extend_from_slice(&text);
    words(&mut glb, &[compressed.len(), 0x004E_4942]);
    glb.extend_from_slice(&compressed);
    glb
}
