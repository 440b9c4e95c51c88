//! Queries as numbers: `js/query.js` packs them.

use lodpack::{Error, Outside, Query, View, Volume, select::Plane};

use crate::answer::wrong;

/// Bits of the first number: which parts follow, in this order.
mod part {
    pub const TOLERANCE: u32 = 1;
    pub const MAX_TRIANGLES: u32 = 2;
    pub const MAX_NODES: u32 = 4;
    pub const MAX_BYTES: u32 = 8;
    pub const BOX: u32 = 16;
    pub const SPHERE: u32 = 32;
    pub const FRUSTUM: u32 = 64;
    pub const VIEW: u32 = 128;
    /// Nothing follows: what is outside is drawn coarsely.
    pub const OUTSIDE_COARSEST: u32 = 256;
}

/// Reads a query from its numbers.
pub fn unpack(numbers: impl Iterator<Item = f64>) -> Result<Query, Error> {
    let mut numbers = Numbers(numbers);
    let parts = numbers.next()? as u32;
    let has = |part: u32| parts & part != 0;
    let mut query = Query::default();
    if has(part::OUTSIDE_COARSEST) {
        query.outside = Outside::Coarsest;
    }
    if has(part::TOLERANCE) {
        query.tolerance = Some(numbers.next()?);
    }
    if has(part::MAX_TRIANGLES) {
        query.max_triangles = Some(numbers.count("maxTriangles")?);
    }
    if has(part::MAX_NODES) {
        query.max_nodes = Some(numbers.count("maxNodes")?);
    }
    if has(part::MAX_BYTES) {
        query.max_bytes = Some(numbers.count("maxBytes")?);
    }
    if has(part::BOX) {
        query.volume = Some(Volume::Box([numbers.array()?, numbers.array()?]));
    }
    if has(part::SPHERE) {
        query.volume = Some(Volume::Sphere { centre: numbers.array()?, radius: numbers.next()? });
    }
    if has(part::FRUSTUM) {
        let mut planes = [Plane { normal: [0.0; 3], offset: 0.0 }; 6];
        for plane in &mut planes {
            *plane = Plane { normal: numbers.array()?, offset: numbers.next()? };
        }
        query.volume = Some(Volume::Frustum(planes));
    }
    if has(part::VIEW) {
        query.view = Some(View {
            position: numbers.array()?,
            forward: numbers.array()?,
            up: numbers.array()?,
            viewport: numbers.array()?.map(|pixels| pixels as u32),
            vertical_fov: numbers.next()?,
            near: numbers.next()?,
            pixel_tolerance: numbers.next()?,
            window: [numbers.array()?, numbers.array()?],
        });
    }
    Ok(query)
}

struct Numbers<I>(I);

impl<I: Iterator<Item = f64>> Numbers<I> {
    fn next(&mut self) -> Result<f64, Error> {
        self.0.next().ok_or_else(|| wrong("the query has too few numbers"))
    }

    fn count(&mut self, name: &str) -> Result<u64, Error> {
        let number = self.next()?;
        // NaN is no count either.
        if number >= 0.0 { Ok(number as u64) } else { Err(wrong(&format!("{name} must be zero or more"))) }
    }

    fn array<const N: usize>(&mut self) -> Result<[f64; N], Error> {
        let mut array = [0.0; N];
        for number in &mut array {
            *number = self.next()?;
        }
        Ok(array)
    }
}
