//! Generated terrain of any size, and the GeoTIFFs that hold it. Rows are made and written one after the other.

use glam::DVec3;
use lodpack_cli::mesh::Mesh;
use rayon::prelude::*;
use std::io::{self, Write};

/// A grid of heights and what its file says about it.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Columns and rows.
    pub size: [u32; 2],
    /// West and north edge (or, for points, the north-western sample), and the distances of columns and rows; none to
    /// say nothing.
    pub place: Option<[f64; 4]>,
    /// Whether pixels are points.
    pub is_point: bool,
    /// The number of EPSG; below 5000 it counts as geographic. None to say nothing.
    pub epsg: Option<u16>,
    /// The value of samples without data.
    pub nodata: Option<f64>,
    /// Rows in a strip.
    pub strip_rows: u32,
}

impl Grid {
    /// A grid in UTM, 30 m apart.
    pub fn utm(size: [u32; 2]) -> Self {
        let place = Some([500_000.0, 5_200_000.0, 30.0, 30.0]);
        Self { size, place, is_point: false, epsg: Some(32632), nodata: None, strip_rows: 16 }
    }

    /// A grid of areas over the whole globe.
    pub fn globe([columns, rows]: [u32; 2]) -> Self {
        let place = Some([-180.0, 90.0, 360.0 / f64::from(columns), 180.0 / f64::from(rows)]);
        Self { size: [columns, rows], place, epsg: Some(4326), ..Self::utm([1, 1]) }
    }

    /// A window of the grid, as a tile of a mosaic.
    pub fn window(&self, first: [u32; 2], size: [u32; 2]) -> Self {
        let place =
            self.place.map(|[x, y, dx, dy]| [x + f64::from(first[0]) * dx, y - f64::from(first[1]) * dy, dx, dy]);
        Self { size, place, ..self.clone() }
    }

    /// Writes a TIFF of 32-bit floats: `row` fills each row in turn.
    ///
    /// # Errors
    ///
    /// Any error of the output.
    pub fn write(&self, out: &mut impl Write, mut row: impl FnMut(u32, &mut [f32])) -> io::Result<()> {
        let [columns, rows] = self.size;
        out.write_all(&self.header())?;
        let mut heights = vec![0.0; columns as usize];
        for number in 0..rows {
            row(number, &mut heights);
            let bytes: Vec<u8> = heights.iter().flat_map(|height| height.to_le_bytes()).collect();
            out.write_all(&bytes)?;
        }
        out.flush()
    }

    /// The bytes of a TIFF whose heights are given row by row.
    pub fn bytes(&self, heights: &[f32]) -> Vec<u8> {
        let (mut out, columns) = (vec![], self.size[0] as usize);
        let row = |row: u32, into: &mut [f32]| into.copy_from_slice(&heights[row as usize * columns..][..columns]);
        self.write(&mut out, row).expect("memory takes everything");
        out
    }

    /// Everything before the samples.
    fn header(&self) -> Vec<u8> {
        let [columns, rows] = self.size;
        let strips = rows.div_ceil(self.strip_rows);
        let row_bytes = columns * 4;
        // Tag, type, and values as bytes. Types: 2 text, 3 u16, 4 u32, 12 f64.
        let short =
            |values: &[u16]| (3u16, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
        let long =
            |values: &[u32]| (4u16, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
        let double =
            |values: &[f64]| (12u16, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
        let rows_of = |strip: u32| self.strip_rows.min(rows - strip * self.strip_rows);
        let counts: Vec<u32> = (0..strips).map(|strip| rows_of(strip) * row_bytes).collect();
        let mut tags = vec![
            (256, long(&[columns])),
            (257, long(&[rows])),
            (258, short(&[32])),
            (259, short(&[1])),
            (262, short(&[1])),
            (273, long(&vec![0; strips as usize])),
            (277, short(&[1])),
            (278, long(&[self.strip_rows])),
            (279, long(&counts)),
            (339, short(&[3])),
        ];
        if let Some([x, y, dx, dy]) = self.place {
            tags.push((33550, double(&[dx, dy, 0.0])));
            tags.push((33922, double(&[0.0, 0.0, 0.0, x, y, 0.0])));
        }
        if let Some(code) = self.epsg {
            let (model, key) = if code < 5000 { (2, 2048) } else { (1, 3072) };
            let kind = if self.is_point { 2 } else { 1 };
            tags.push((34735, short(&[1, 1, 0, 3, 1024, 0, 1, model, 1025, 0, 1, kind, key, 0, 1, code])));
        }
        if let Some(nodata) = self.nodata {
            let text = format!("{nodata}\0");
            tags.push((42113, (2, text.len(), text.into_bytes())));
        }
        let directory_bytes = 2 + 12 * tags.len() + 4;
        let values_bytes: usize =
            tags.iter().map(|(_, (.., bytes))| if bytes.len() > 4 { bytes.len() } else { 0 }).sum();
        let data = (8 + directory_bytes + values_bytes) as u32;
        let offsets: Vec<u32> = (0..strips).map(|strip| data + strip * self.strip_rows * row_bytes).collect();
        tags[5].1 = long(&offsets);
        let mut out = b"II\x2a\x00\x08\x00\x00\x00".to_vec();
        let mut values = vec![];
        out.extend((tags.len() as u16).to_le_bytes());
        for (tag, (kind, count, bytes)) in tags {
            out.extend((tag as u16).to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend((count as u32).to_le_bytes());
            if bytes.len() > 4 {
                out.extend(((8 + directory_bytes + values.len()) as u32).to_le_bytes());
                values.extend(bytes);
            } else {
                out.extend(bytes.iter().copied().chain([0; 4]).take(4));
            }
        }
        out.extend([0; 4]);
        out.extend(values);
        out
    }
}

/// Heights in metres, between about -6,000 and 6,000, that look like mountains and plains: octaves of noise in space,
/// so that a globe has neither a seam nor a pole. Detail ends at two samples.
#[derive(Clone, Copy, Debug)]
pub struct Fractal {
    /// Another world.
    pub seed: u64,
    /// How many octaves, each half as wide as the one before.
    pub octaves: u32,
}

impl Fractal {
    /// The octaves that a grid needs, given the samples of its wider side.
    pub fn of_samples(seed: u64, samples: u32) -> Self {
        Self { seed, octaves: samples.max(16).ilog2().saturating_sub(2) }
    }

    /// The height at a point; its first octave has a wavelength of 1.
    pub fn height(&self, at: DVec3) -> f64 {
        let (mut sum, mut size, mut scale, mut rough) = (0.0, 1.0, 1.0, 1.0);
        for octave in 0..self.octaves {
            let noise = noise(at * scale + DVec3::splat(f64::from(octave) * 17.37), self.seed ^ u64::from(octave));
            // Mountains are rougher than plains.
            sum += size * rough * noise;
            if octave == 1 {
                rough = (0.55 + sum).clamp(0.08, 1.0);
            }
            (size, scale) = (size * 0.5, scale * 2.0);
        }
        sum * 5000.0
    }

    /// A row of a plane whose wider side is four first wavelengths.
    pub fn flat_row(&self, [columns, rows]: [u32; 2], row: u32, first: u32, heights: &mut [f32]) {
        let step = 4.0 / f64::from(columns.max(rows));
        heights.par_iter_mut().enumerate().for_each(|(column, height)| {
            let at = DVec3::new((f64::from(first) + column as f64) * step, f64::from(row) * step, 0.5);
            *height = self.height(at) as f32;
        });
    }

    /// A row of a globe.
    pub fn globe_row(&self, [columns, rows]: [u32; 2], row: u32, first: u32, heights: &mut [f32]) {
        let latitude = std::f64::consts::PI * (0.5 - (f64::from(row) + 0.5) / f64::from(rows));
        heights.par_iter_mut().enumerate().for_each(|(column, height)| {
            let longitude = std::f64::consts::TAU * (f64::from(first) + column as f64 + 0.5) / f64::from(columns);
            let around = latitude.cos();
            let at = DVec3::new(around * longitude.cos(), around * longitude.sin(), latitude.sin());
            *height = self.height(at * 1.5) as f32;
        });
    }
}

/// Value noise from -1 to 1: numbers at the corners of a lattice, joined smoothly.
fn noise(at: DVec3, seed: u64) -> f64 {
    let cell = at.floor();
    let t = at - cell;
    let t = t * t * t * (t * (t * 6.0 - DVec3::splat(15.0)) + DVec3::splat(10.0));
    let corner = |i: i64, j: i64, k: i64| {
        let mut hash = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        for c in [cell.x as i64 + i, cell.y as i64 + j, cell.z as i64 + k] {
            hash = (hash ^ c as u64).wrapping_mul(0xD6E8_FEB8_6659_FD93);
            hash ^= hash >> 32;
        }
        (hash >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
    let along = |j, k| mix(corner(0, j, k), corner(1, j, k), t.x);
    let across = |k| mix(along(0, k), along(1, k), t.y);
    mix(across(0), across(1), t.z)
}

/// How far a drawn terrain is above or below the samples of its input.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vertical {
    /// The largest distance along z.
    pub largest: f64,
    /// The root mean square of the distances.
    pub rms: f64,
    /// Samples below or above which nothing is drawn.
    pub missing: usize,
    /// The steepest slope of the input.
    pub steepest: f64,
}

impl Vertical {
    /// Measures at every vertex of the input, which lies on a plane. Code of its own: it shares nothing with a
    /// certificate.
    pub fn between(positions: &[[f64; 3]], triangles: &[[u32; 3]], input: &Mesh) -> Self {
        let [low, high] = input.bounds();
        let cells = ((input.positions.len() as f64).sqrt() as usize).clamp(1, 4096);
        let size = (high - low).truncate().max(glam::DVec2::splat(1e-9)) / cells as f64;
        let cell = |x: f64, axis: usize| (((x - low[axis]) / size[axis]).floor().max(0.0) as usize).min(cells - 1);
        let mut bins: Vec<Vec<u32>> = vec![vec![]; cells * cells];
        let corners = |t: u32| triangles[t as usize].map(|v| DVec3::from_array(positions[v as usize]));
        for t in 0..triangles.len() as u32 {
            let [a, b, c] = corners(t);
            let (from, to) = (a.min(b).min(c), a.max(b).max(c));
            for y in cell(from.y, 1)..=cell(to.y, 1) {
                (cell(from.x, 0)..=cell(to.x, 0)).for_each(|x| bins[y * cells + x].push(t));
            }
        }
        let mut all = Self::default();
        let mut sum = 0.0;
        for p in &input.positions {
            let heights = bins[cell(p.y, 1) * cells + cell(p.x, 0)].iter().filter_map(|&t| height_at(corners(t), *p));
            match heights.map(|height| (height - p.z).abs()).reduce(f64::min) {
                Some(distance) => {
                    all.largest = all.largest.max(distance);
                    sum += distance * distance;
                }
                None => all.missing += 1,
            }
        }
        all.rms = (sum / (input.positions.len() - all.missing).max(1) as f64).sqrt();
        all.steepest = (0..input.triangles.len() as u32).fold(0.0, |most: f64, t| {
            let normal = input.doubled_area(t);
            most.max(normal.truncate().length() / normal.z.abs())
        });
        all
    }
}

/// The height of a triangle above or below a point, if it is there.
fn height_at([a, b, c]: [DVec3; 3], p: DVec3) -> Option<f64> {
    let (u, v, w) = ((b - a).truncate(), (c - a).truncate(), (p - a).truncate());
    let area = u.perp_dot(v);
    let [s, t] = [w.perp_dot(v) / area, u.perp_dot(w) / area];
    let is_inside = s >= -1e-9 && t >= -1e-9 && s + t <= 1.0 + 1e-9;
    is_inside.then_some(a.z + s * (b.z - a.z) + t * (c.z - a.z))
}
