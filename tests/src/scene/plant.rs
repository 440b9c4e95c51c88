//! A plant: halls with slabs and walls, and in them lines of pipes with elbows, flanges, bolts and valves, trays with
//! cables, and gratings.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use glam::{DQuat, DVec3};
use lodpack_cli::measure::selftest::shapes::Random;

use super::shapes::{bolt, elbow, flange, grating, pipe, tray, valve};
use super::{Node, Scene, Shape, Transform};

/// The size of a hall, in metres, and about how many objects are in it.
const HALL: DVec3 = DVec3::new(60.0, 30.0, 14.0);
const OBJECTS_OF_HALL: u32 = 1000;
/// Space between halls, in metres.
const ALLEY: f64 = 8.0;
/// Radii of pipes, in metres.
const RADII: [f64; 12] = [0.013, 0.017, 0.024, 0.03, 0.038, 0.051, 0.057, 0.084, 0.11, 0.16, 0.22, 0.27];
/// Different pipes, elbows, valves, trays and gratings; with [`FLANGES`] and [`BOLTS`] for each radius 2,012 shapes.
const PIPE_LENGTHS: u32 = 60;
const BENDS: u32 = 60;
const VALVES: u32 = 32;
const TRAYS: u32 = 60;
const GRATINGS: u32 = 44;
const FLANGES: u32 = 3;
const BOLTS: u32 = 4;

/// A plant of exactly `count` objects in a tree of areas and lines. Some 2 % of them have shapes of their own; the
/// others share 2,012. Names repeat, some are not ASCII, and some objects have none; nine tenths have an id. One valve
/// in eight is mirrored, and one pipe in 50 is stretched.
pub fn plant(count: u32) -> Scene {
    let mut plant = Plant { scene: Scene::default(), random: Random(11), left: count, lines: 1000 };
    let catalogue = plant.catalogue();
    let halls = count.div_ceil(OBJECTS_OF_HALL).max(1);
    let columns = (1..).find(|columns| columns * columns >= halls).unwrap_or(1);
    for hall in 0..halls {
        let at = DVec3::new(f64::from(hall % columns), f64::from(hall / columns), 0.0) * (HALL + ALLEY);
        plant.add_hall(hall, at, &catalogue);
    }
    plant.scene
}

struct Plant {
    scene: Scene,
    random: Random,
    /// Objects that are still to be added.
    left: u32,
    lines: u32,
}

/// The lengths and numbers of shapes that differ in length alone.
type Sizes = Vec<(f64, u32)>;

/// Shapes that repeat, by radius where they have one.
#[derive(Default)]
struct Catalogue {
    pipes: Vec<Sizes>,
    elbows: Vec<Vec<Elbow>>,
    flanges: Vec<Sizes>,
    bolts: Vec<Sizes>,
    valves: Vec<Sizes>,
    trays: Sizes,
    gratings: Sizes,
}

impl Scene {
    /// Adds shapes of `count` lengths.
    fn sizes(&mut self, count: u32, length: impl Fn(f64) -> f64, shape: impl Fn(f64) -> Shape) -> Sizes {
        let lengths = (1..=count).map(|n| length(f64::from(n)));
        lengths.map(|length| (length, self.add_shape(shape(length)))).collect()
    }
}

#[derive(Clone, Copy)]
struct Elbow {
    shape: u32,
    angle: f64,
    bend: f64,
}

/// The end of a line: where it is and which way is on, as a turn of z.
#[derive(Clone, Copy)]
struct End {
    at: DVec3,
    turn: DQuat,
}

impl End {
    fn transform(self) -> Transform {
        Transform { translation: self.at, rotation: self.turn, scale: DVec3::ONE }
    }

    fn forward(self, length: f64) -> Self {
        Self { at: self.at + self.turn * DVec3::Z * length, ..self }
    }
}

impl Plant {
    fn catalogue(&mut self) -> Catalogue {
        let scene = &mut self.scene;
        let mut catalogue = Catalogue::default();
        for (&radius, &colour) in RADII.iter().zip([0, 5, 6, 1].iter().cycle()) {
            catalogue.pipes.push(scene.sizes(PIPE_LENGTHS, |n| 0.1 * n, |length| pipe(radius, length, colour)));
            let elbows = (0..BENDS).map(|n| {
                let angle = [FRAC_PI_2, FRAC_PI_4, FRAC_PI_2 / 3.0][n as usize % 3];
                let bend = radius * (2.0 + 0.1 * f64::from(n));
                Elbow { shape: scene.add_shape(elbow(radius, bend, angle, colour)), angle, bend }
            });
            catalogue.elbows.push(elbows.collect());
            let thicknesses = |n| (0.01 + radius * 0.1) * n;
            catalogue.flanges.push(scene.sizes(FLANGES, thicknesses, |thickness| flange(radius, thickness)));
            catalogue.bolts.push(scene.sizes(BOLTS, |n| 0.03 * n, |length| bolt(0.004 + radius * 0.04, length)));
            let lengths = |n| radius * (2.9 + 0.1 * n) + 0.05;
            catalogue.valves.push(scene.sizes(VALVES, lengths, |length| valve(radius, length, length * 0.6)));
        }
        catalogue.trays = scene.sizes(TRAYS, |n| 0.1 * n, |length| tray(length, 0.1 + 0.05 * length, 0.06));
        let bars = |length: f64| 10 + (length * 25.0) as u32;
        catalogue.gratings = scene.sizes(GRATINGS, |n| 0.05 * n, |length| grating(length, 1.0, bars(length)));
        catalogue
    }

    fn add_hall(&mut self, hall: u32, at: DVec3, catalogue: &Catalogue) {
        let target = self.left.saturating_sub(OBJECTS_OF_HALL);
        let area = self.assembly(format!("AREA-{:02}", hall + 1), None, at);
        for (name, low, size) in [
            ("SLAB", DVec3::new(0.0, 0.0, -0.4), DVec3::new(HALL.x, HALL.y, 0.4)),
            ("WALL-N", DVec3::new(0.0, HALL.y, -0.4), DVec3::new(HALL.x, 0.3, HALL.z)),
            ("WALL-S", DVec3::new(0.0, -0.3, -0.4), DVec3::new(HALL.x, 0.3, HALL.z)),
            ("WALL-W", DVec3::new(-0.3, -0.3, -0.4), DVec3::new(0.3, HALL.y + 0.6, HALL.z)),
            ("ROOF", DVec3::new(-0.3, -0.3, HALL.z - 0.4), DVec3::new(HALL.x + 0.3, HALL.y + 0.6, 0.3)),
        ] {
            let mut shape = Shape::new(4);
            // No two halls are equally thick.
            shape.cuboid(low, size + 1e-4 * f64::from(hall + 1));
            let shape = self.scene.add_shape(shape);
            self.object(name.to_owned(), area, shape, Transform::IDENTITY);
        }
        while self.left > target {
            match self.below(8) {
                0 => self.add_trays(area, catalogue),
                1 => self.add_gratings(area, catalogue),
                _ => self.add_line(area, catalogue, target),
            }
        }
    }

    /// A line of pipes, which bends now and then.
    fn add_line(&mut self, area: u32, catalogue: &Catalogue, target: u32) {
        self.lines += 1;
        let line = self.assembly(format!("LINE-{}", self.lines), Some(area), DVec3::ZERO);
        let kind = self.below(RADII.len() as u32) as usize;
        let at = DVec3::new(self.random.unit(), self.random.unit(), self.random.unit()) * (HALL - 4.0) + 2.0;
        let turn = DQuat::from_rotation_z(FRAC_PI_2 * f64::from(self.below(4))) * DQuat::from_rotation_y(FRAC_PI_2);
        let mut end = End { at, turn };
        for piece in 1..=8 + self.below(16) {
            let (length, shape) = self.one_of(&catalogue.pipes[kind]);
            let stretched = if self.below(50) == 0 { 1.25 } else { 1.0 };
            let scale = DVec3::new(1.0, 1.0, stretched);
            self.object(format!("PIPE-{piece}"), line, shape, Transform { scale, ..end.transform() });
            end = end.forward(length * stretched);
            match self.below(4) {
                0 => end = self.add_elbow(piece, line, end, &catalogue.elbows[kind]),
                1 => end = self.add_flanges(piece, line, end, kind, catalogue),
                2 => {
                    let (length, shape) = self.one_of(&catalogue.valves[kind]);
                    let scale = if self.below(8) == 0 { DVec3::new(-1.0, 1.0, 1.0) } else { DVec3::ONE };
                    let name =
                        if piece.is_multiple_of(5) { format!("Ventil-Ø{piece}") } else { format!("VALVE-{piece}") };
                    self.object(name, line, shape, Transform { scale, ..end.transform() });
                    end = end.forward(length);
                }
                _ => {}
            }
            let is_inside = end.at.cmpge(DVec3::ZERO).all() && end.at.cmple(HALL).all();
            if !is_inside || self.left <= target {
                break;
            }
        }
    }

    fn add_elbow(&mut self, piece: u32, line: u32, end: End, elbows: &[Elbow]) -> End {
        let Elbow { shape, angle, bend } = self.one_of(elbows);
        let turn = end.turn * DQuat::from_rotation_z(FRAC_PI_2 * f64::from(self.below(4)));
        let rotated = End { turn, ..end };
        self.object(format!("ELBOW-{piece}"), line, shape, rotated.transform());
        let by = DVec3::new(bend * (1.0 - angle.cos()), 0.0, bend * angle.sin());
        End { at: end.at + turn * by, turn: turn * DQuat::from_rotation_y(angle) }
    }

    /// Two flanges, face to face, with bolts around.
    fn add_flanges(&mut self, piece: u32, line: u32, end: End, kind: usize, catalogue: &Catalogue) -> End {
        let (thickness, shape) = self.one_of(&catalogue.flanges[kind]);
        let middle = end.forward(2.5 * thickness);
        let back = middle.turn * DQuat::from_rotation_x(std::f64::consts::PI);
        self.object(format!("FLANGE-{piece}"), line, shape, Transform { rotation: back, ..middle.transform() });
        self.object(format!("FLANGE-{piece}"), line, shape, middle.transform());
        let (_, bolt) = self.one_of(&catalogue.bolts[kind]);
        let count = 4 + 4 * (kind as u32 / 5);
        for k in 0..count {
            let turn = middle.turn * DQuat::from_rotation_z(TAU * f64::from(k) / f64::from(count));
            let at = middle.at + turn * DVec3::new(RADII[kind] * 1.4 + 0.01, 0.0, thickness);
            let name = if piece.is_multiple_of(7) { "螺栓 M12".to_owned() } else { "BOLT".to_owned() };
            self.object(name, line, bolt, End { at, turn }.transform());
        }
        middle.forward(2.5 * thickness)
    }

    /// A row of trays, with cables that hang in them.
    fn add_trays(&mut self, area: u32, catalogue: &Catalogue) {
        let run = self.assembly("TRAY RUN".to_owned(), Some(area), DVec3::ZERO);
        let start = DVec3::new(2.0, 2.0 + self.random.unit() * 26.0, 4.0 + self.random.unit() * 8.0);
        let mut x = 0.0;
        for number in 1..=3 + self.below(6) {
            let (length, shape) = self.one_of(&catalogue.trays);
            self.object(format!("TRAY-{number}"), run, shape, Transform::at(start + DVec3::X * x));
            x += length;
        }
        for number in 1..=1 + self.below(4) {
            let [sag, wave] = [0.01 + 0.02 * self.random.unit(), 2.0 + 5.0 * self.random.unit()];
            let steps = (x * 8.0).ceil().max(2.0) as u32;
            let points = (0..=steps).map(|k| f64::from(k) / f64::from(steps) * x);
            let place = |x: f64| DVec3::new(x, sag * (wave * x).sin(), sag * (wave * 0.7 * x).cos());
            let mut cable = Shape::new(3);
            cable.tube(&points.map(place).collect::<Vec<_>>(), |_| 0.008, 8);
            let shape = self.scene.add_shape(cable);
            let at = start + DVec3::new(0.0, 0.018 * f64::from(number), 0.03);
            self.object(format!("CABLE-{number}"), run, shape, Transform::at(at));
        }
    }

    fn add_gratings(&mut self, area: u32, catalogue: &Catalogue) {
        let floor = self.assembly("PLATFORM".to_owned(), Some(area), DVec3::ZERO);
        let start = DVec3::new(4.0, 1.0 + 28.0 * self.random.unit(), 3.0 + f64::from(self.below(4)) * 2.5);
        let mut x = 0.0;
        for number in 1..=4 + self.below(8) {
            let (length, shape) = self.one_of(&catalogue.gratings);
            self.object(format!("GRATING-{number}"), floor, shape, Transform::at(start + DVec3::X * x));
            x += length + 0.01;
        }
    }

    fn assembly(&mut self, name: String, parent: Option<u32>, at: DVec3) -> u32 {
        self.scene.add(Node { name: Some(name), id: None, parent, shape: None, transform: Transform::at(at) })
    }

    /// Adds an object, unless there are as many as there should be.
    fn object(&mut self, name: String, parent: u32, shape: u32, transform: Transform) {
        if self.left == 0 {
            return;
        }
        self.left -= 1;
        let name = (self.below(50) != 0).then_some(name);
        let [high, low] = [(); 2].map(|()| (self.random.unit() * 4294967296.0) as u32);
        let id = (self.below(10) != 0).then(|| format!("{high:08x}-{low:08x}-{:06x}", self.left));
        self.scene.add(Node { name, id, parent: Some(parent), shape: Some(shape), transform });
    }

    fn below(&mut self, limit: u32) -> u32 {
        (self.random.unit() * f64::from(limit)) as u32
    }

    fn one_of<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len() as u32) as usize]
    }
}
