//! Tiles of a city as OBJ files with a texture each: gentle ground, and on it houses with gable roofs.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// Texels along each side of a texture, unless somebody wants others.
pub const TEXTURE_SIDE: u32 = 2048;
/// Lots along each side of a tile, and the length of a lot.
const LOTS: u32 = 14;
const LOT: f64 = 20.0;
/// Cells of a texture along each side: one for each house, and a quarter of all for the ground.
const CELLS: u32 = 16;
const HOUSES: u32 = CELLS * CELLS * 3 / 4;
/// Squares of the ground along each side of a tile.
const SQUARES: u32 = 28;
/// Storeys of a wall that have triangles of their own.
const BANDS: u32 = 2;

/// Writes a city with the given number of tiles, nearly in a square, to a folder, and returns the number of its
/// triangles. Textures have `side` texels along each side. One tile is held at a time.
///
/// # Errors
/// If the folder or a file cannot be written.
pub fn write_city(tiles: u32, side: u32, folder: &Path) -> io::Result<u64> {
    fs::create_dir_all(folder)?;
    let columns = (1..).find(|columns| columns * columns >= tiles).unwrap_or(1);
    let mut triangles = 0;
    for tile in 0..tiles {
        let name = format!("tile-{tile:04}");
        let obj = Tile::new(tile, [tile % columns, tile / columns]).obj(&name);
        triangles += obj.matches("\nf ").count() as u64;
        fs::write(folder.join(format!("{name}.obj")), obj)?;
        fs::write(folder.join(format!("{name}.mtl")), format!("newmtl {name}\nmap_Kd {name}.png\n"))?;
        let file = io::BufWriter::new(fs::File::create(folder.join(format!("{name}.png")))?);
        let encoder = PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Up);
        let texels = texture(tile, side);
        encoder.write_image(&texels, side, side, ExtendedColorType::Rgb8).map_err(io::Error::other)?;
    }
    Ok(triangles)
}

/// A number that depends on numbers (as in SplitMix64).
fn hash(of: [u32; 3]) -> u64 {
    of.iter().fold(0x9E37_79B9_7F4A_7C15, |hash: u64, &number| {
        let mixed = (hash ^ u64::from(number)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (mixed ^ (mixed >> 29)).wrapping_mul(0x94D0_49BB_1331_11EB).rotate_left(31)
    })
}

/// As a share of 1.
fn share(of: [u32; 3]) -> f64 {
    (hash(of) >> 40) as f64 / (1_u64 << 24) as f64
}

/// The height of the ground.
fn ground(x: f64, y: f64) -> f64 {
    6.0 * (x / 170.0).sin() * (y / 130.0).cos() + 2.0 * (x / 47.0 + y / 61.0).sin()
}

struct Tile {
    number: u32,
    low: [f64; 2],
    text: String,
    vertices: u32,
}

impl Tile {
    fn new(number: u32, at: [u32; 2]) -> Self {
        let low = at.map(|x| f64::from(x) * f64::from(LOTS) * LOT);
        Self { number, low, text: String::new(), vertices: 0 }
    }

    fn obj(mut self, name: &str) -> String {
        let _ = writeln!(self.text, "mtllib {name}.mtl\nusemtl {name}");
        self.add_ground();
        (0..HOUSES).for_each(|house| self.add_house(house));
        self.text
    }

    /// Adds a vertex at a place of the texture, in cells from its upper left corner.
    fn vertex(&mut self, [x, y, z]: [f64; 3], place: [f64; 2]) -> u32 {
        let [u, v] = [place[0] / f64::from(CELLS), 1.0 - place[1] / f64::from(CELLS)];
        let _ = writeln!(self.text, "v {x:.3} {y:.3} {z:.3}\nvt {u:.6} {v:.6}");
        self.vertices += 1;
        self.vertices
    }

    fn triangle(&mut self, [a, b, c]: [u32; 3]) {
        let _ = writeln!(self.text, "f {a}/{a} {b}/{b} {c}/{c}");
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangle([a, b, c]);
        self.triangle([a, c, d]);
    }

    fn add_ground(&mut self) {
        let (first, count) = (self.vertices + 1, SQUARES + 1);
        for [row, column] in (0..count).flat_map(|row| (0..count).map(move |column| [row, column])) {
            let [s, t] = [column, row].map(|k| f64::from(k) / f64::from(SQUARES));
            let [x, y] = [s, t].map(|share| share * f64::from(LOTS) * LOT);
            let (x, y, cells) = (self.low[0] + x, self.low[1] + y, f64::from(CELLS / 2));
            self.vertex([x, y, ground(x, y)], [s * cells, t * cells]);
        }
        for [row, column] in (0..SQUARES).flat_map(|row| (0..SQUARES).map(move |column| [row, column])) {
            let at = first + row * count + column;
            self.quad([at, at + 1, at + count + 1, at + count]);
        }
    }

    fn add_house(&mut self, house: u32) {
        let random = |what: u32| share([self.number, house, what]);
        let lot = [house % LOTS, house / LOTS].map(|k| f64::from(k) * LOT);
        let [width, depth, height] = [9.0 + 7.0 * random(0), 9.0 + 7.0 * random(1), 6.0 + 24.0 * random(2).powi(2)];
        let low = [self.low[0] + lot[0] + 2.0, self.low[1] + lot[1] + 2.0];
        let floor = ground(low[0] + width / 2.0, low[1] + depth / 2.0) - 1.5;
        // The cell of the house, of which walls take the lower half and the roof the upper one.
        let half = CELLS / 2;
        // The ground takes the upper left quarter.
        let in_lower = house.checked_sub(half * half);
        let cell = in_lower.map_or([half + house % half, house / half], |n| [n % CELLS, half + n / CELLS]);
        let cell = cell.map(f64::from);
        let ring = [[0.0, 0.0], [width, 0.0], [width, depth], [0.0, depth]].map(|[x, y]| [low[0] + x, low[1] + y]);
        let mut previous: Vec<u32> = vec![];
        let mut bottom = vec![];
        for band in 0..=BANDS {
            let up = f64::from(band) / f64::from(BANDS);
            // The seam of the texture lies at a corner, whose vertices are there twice.
            let corners = (0..5).map(|k| {
                let [x, y] = ring[k % 4];
                let place = [cell[0] + 0.02 + 0.24 * k as f64, cell[1] + 0.98 - 0.46 * up];
                self.vertex([x, y, floor + height * up], place)
            });
            let corners: Vec<u32> = corners.collect();
            for k in 0..previous.len().saturating_sub(1) {
                self.quad([previous[k], previous[k + 1], corners[k + 1], corners[k]]);
            }
            if band == 0 {
                bottom = corners.clone();
            }
            previous = corners;
        }
        self.quad([bottom[3], bottom[2], bottom[1], bottom[0]]);
        // The ridge lies along the first direction.
        let (eaves, rise) = (floor + height, depth * 0.35);
        let ridge = |x: f64| [low[0] + x, low[1] + depth / 2.0, eaves + rise];
        let roof = |x: f64, y: f64| [cell[0] + 0.02 + 0.96 * x, cell[1] + 0.02 + 0.46 * y];
        let [a, b, c, d] = ring.map(|[x, y]| [x, y, eaves]);
        let places = [roof(0.0, 1.0), roof(1.0, 1.0), roof(1.0, 0.0), roof(0.0, 0.0)];
        let corners = [(a, places[0]), (b, places[1]), (c, places[2]), (d, places[3])];
        let [a, b, c, d] = corners.map(|(point, place)| self.vertex(point, place));
        let [left, right] = [(ridge(0.0), roof(0.0, 0.5)), (ridge(width), roof(1.0, 0.5))];
        let [left, right] = [left, right].map(|(point, place)| self.vertex(point, place));
        self.quad([a, b, right, left]);
        self.quad([c, d, left, right]);
        // Gables show the upper end of the wall beneath.
        self.triangle([d, a, left]);
        self.triangle([b, c, right]);
    }
}

/// The texture of a tile, three bytes a texel.
fn texture(tile: u32, side: u32) -> Vec<u8> {
    let mut texels = Vec::with_capacity(3 * side as usize * side as usize);
    for [y, x] in (0..side).flat_map(|y| (0..side).map(move |x| [y, x])) {
        let [s, t] = [x, y].map(|k| (f64::from(k) + 0.5) / f64::from(side) * f64::from(CELLS));
        let colour = if s < f64::from(CELLS / 2) && t < f64::from(CELLS / 2) {
            ground_colour(tile, [s, t])
        } else {
            house_colour(tile, [s, t])
        };
        // Fine grain, as any photograph has it.
        let grain = (hash([tile ^ 0x5EED, x, y]) & 3) as f64 - 1.5;
        texels.extend(colour.map(|value| (value + grain).clamp(0.0, 255.0) as u8));
    }
    texels
}

/// Streets, pavement and grass.
fn ground_colour(tile: u32, at: [f64; 2]) -> [f64; 3] {
    let lots = at.map(|x| x / f64::from(CELLS / 2) * f64::from(LOTS));
    let along = lots.map(|x| (x - x.floor() - 0.85).abs());
    let street = along[0].min(along[1]);
    let lawn = patches(tile, lots.map(|x| 8.0 * x));
    if street < 0.01 {
        [210.0, 205.0, 190.0]
    } else if street < 0.09 {
        let wear = 12.0 * patches(tile, lots.map(|x| 3.0 * x));
        [92.0 + wear, 92.0 + wear, 96.0 + wear]
    } else if street < 0.12 {
        [165.0, 160.0, 150.0]
    } else {
        [70.0 + 45.0 * lawn, 105.0 + 35.0 * lawn, 55.0 + 20.0 * lawn]
    }
}

/// Walls with windows, and roofs with tiles.
fn house_colour(tile: u32, at: [f64; 2]) -> [f64; 3] {
    let cell = at.map(|x| x as u32);
    let [s, t] = [at[0] - f64::from(cell[0]), at[1] - f64::from(cell[1])];
    let number = cell[0] + CELLS * cell[1];
    let random = |what: u32| share([tile, number, what]);
    let shade = 0.9 + 0.2 * patches(tile, [6.0 * at[0], 6.0 * at[1]]);
    if t < 0.5 {
        let row = (t * 40.0).fract();
        let column = (s * 30.0 + 0.5 * f64::from((t * 40.0) as u32 % 2)).fract();
        let joint = if row < 0.15 || column < 0.1 { 0.75 } else { 1.0 };
        return [120.0 + 80.0 * random(10), 70.0 + 40.0 * random(11), 55.0 + 30.0 * random(12)]
            .map(|value| value * shade * joint);
    }
    let (storey, window) = ((t * 12.0).fract(), (s * 16.0).fract());
    let is_window = (0.25..0.8).contains(&storey) && (0.3..0.75).contains(&window);
    if is_window {
        let is_lit = share([tile ^ 77, number, (t * 12.0) as u32 * 16 + (s * 16.0) as u32]) > 0.8;
        let sky = 40.0 * (0.8 - storey);
        return if is_lit { [225.0, 200.0, 140.0] } else { [50.0 + sky, 62.0 + sky, 80.0 + sky] };
    }
    [150.0 + 90.0 * random(13), 140.0 + 80.0 * random(14), 125.0 + 80.0 * random(15)].map(|value| value * shade)
}

/// Smooth noise from 0 to 1.
fn patches(tile: u32, at: [f64; 2]) -> f64 {
    let low = at.map(f64::floor);
    let [x, y] = [at[0] - low[0], at[1] - low[1]].map(|t| t * t * (3.0 - 2.0 * t));
    let corner = |dx: f64, dy: f64| share([tile, (low[0] + dx) as u32, (low[1] + dy) as u32]);
    let row = |dy: f64| corner(0.0, dy) * (1.0 - x) + corner(1.0, dy) * x;
    row(0.0) * (1.0 - y) + row(1.0) * y
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_cli::import::import_meshes;
    use lodpack_cli::progress::Silent;
    use lodpack_cli::stage::repair::repair;

    #[test]
    fn houses_are_closed_and_tiles_meet() {
        let folder = tempfile_folder();
        let triangles = write_city(2, 64, &folder).unwrap();
        let tiles = ["tile-0000.obj", "tile-0001.obj"].map(|name| folder.join(name));
        let mesh = import_meshes(&tiles, &Silent).unwrap();
        let again = fs::read(&tiles[1]).unwrap();
        write_city(2, 64, &folder).unwrap();
        assert_eq!(again, fs::read(&tiles[1]).unwrap());
        fs::remove_dir_all(folder).unwrap();
        assert_eq!(mesh.triangles.len() as u64, triangles);
        let (_, _, report) = repair(mesh);
        // The ground of both tiles is one, and its border is all that is open.
        assert_eq!(report.boundary_edges, u64::from(6 * SQUARES));
        assert_eq!(report.components, u64::from(2 * HOUSES) + 1);
    }

    fn tempfile_folder() -> std::path::PathBuf {
        std::env::temp_dir().join(format!("lodpack-city-{}", std::process::id()))
    }
}
