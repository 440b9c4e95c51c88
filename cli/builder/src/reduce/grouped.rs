//! Points of a surface in groups that lie close together and are looked at at once.

use glam::{DVec3, Vec3};

use super::cells::Sampled;
use lodpack_stage::certify::{Numbers, TOGETHER};
use lodpack_stage::nearest::doubled_area;

/// Points of the surface that lie near one another.
pub(crate) struct Group {
    pub places: [Numbers; 3],
    pub bounds: Bounds,
    pub colours: [[f32; 3]; TOGETHER],
    /// Normals of their triangles.
    pub normals: [Vec3; TOGETHER],
    /// Areas that they stand for.
    pub weights: [f64; TOGETHER],
}

/// The least and the greatest coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Bounds([Vec3; 2]);

/// The points of a surface in groups.
pub struct Grouped<'a> {
    pub(crate) surface: &'a Sampled,
    pub(crate) groups: Vec<Group>,
    /// The area of the surface.
    pub(crate) area: f64,
    /// What places are relative to.
    pub(crate) middle: DVec3,
}

impl Bounds {
    pub const NOTHING: Self = Self([Vec3::INFINITY, Vec3::NEG_INFINITY]);

    pub fn with(self, point: Vec3) -> Self {
        let Self([low, high]) = self;
        Self([low.min(point), high.max(point)])
    }

    pub fn union(self, other: Self) -> Self {
        self.with(other.0[0]).with(other.0[1])
    }

    pub fn square_distance(self, other: Self) -> f32 {
        let (Self([low, high]), Self([least, greatest])) = (self, other);
        (least - high).max(low - greatest).max(Vec3::ZERO).length_squared()
    }
}

impl<'a> Grouped<'a> {
    /// Of a surface, which may have no colours anywhere: there are no groups then.
    pub fn new(surface: &'a Sampled) -> Self {
        let (mut places, mut of_points) = (vec![], vec![]);
        for (corners, rows, colours) in surface.of_triangles() {
            let (normal, weight) = (doubled_area(corners).as_vec3(), rows.area / rows.count().max(1) as f64);
            places.extend(rows.points_of_all().map(|(_, place)| place));
            of_points.extend(colours.iter().map(|&colour| (normal, weight, colour)));
        }
        let area = of_points.iter().map(|(_, weight, _)| weight).sum();
        let [low, high] = places
            .iter()
            .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &place| [low.min(place), high.max(place)]);
        let middle = low.midpoint(high);
        // Along a curve on which neighbours lie near one another (Morton 1966).
        let scale = 1023.0 / (high - low).max_element().max(f64::MIN_POSITIVE);
        let spread = |x: f64| (0..10).fold(0_u32, |key, bit| key | (x as u32 >> bit & 1) << (3 * bit));
        let mut order: Vec<u32> = (0..places.len() as u32).collect();
        order.sort_by_cached_key(|&k| {
            let [x, y, z] = ((places[k as usize] - low) * scale).to_array().map(spread);
            x | y << 1 | z << 2
        });
        let group = |numbers: &[u32]| {
            // The last group may have fewer points: what is there twice weighs nothing.
            let number = |k: usize| numbers[k.min(numbers.len() - 1)] as usize;
            let place: [Vec3; TOGETHER] = std::array::from_fn(|k| (places[number(k)] - middle).as_vec3());
            let of_point = std::array::from_fn::<_, TOGETHER, _>(|k| of_points[number(k)]);
            Group {
                places: [0, 1, 2].map(|axis| place.map(|place| place[axis])),
                bounds: place.into_iter().fold(Bounds::NOTHING, Bounds::with),
                colours: of_point.map(|(.., colour)| colour),
                normals: of_point.map(|(normal, ..)| normal),
                weights: std::array::from_fn(|k| if k < numbers.len() { of_point[k].1 } else { 0.0 }),
            }
        };
        Self { groups: order.chunks(TOGETHER).map(group).collect(), surface, area, middle }
    }
}
