//! The numbers of a record: what a corner carries, and in which places.

use serde::{Deserialize, Serialize};

/// The numbers of a record. Places count in numbers from its beginning.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AttributeLayout {
    /// Place of red, green, blue and alpha in linear light, 0 to 1. White where there is none.
    pub colour: Option<usize>,
    /// Place of the three coordinates of the normal. NaN where a corner has none.
    pub normal: Option<usize>,
    /// Place of the three coordinates of the tangent, along which images of normals have their right, and of the side
    /// on which they have their top: that of the cross product of normal and tangent if it is positive, the other one
    /// if it is negative. NaN where a corner has none.
    pub tangent: Option<usize>,
    /// Places of the two coordinates of each set. NaN where a corner has none.
    pub uv: Vec<usize>,
    /// Name and place of each scalar. NaN where a corner has none.
    pub scalars: Vec<(String, usize)>,
    /// Numbers in a record.
    pub stride: usize,
}

impl AttributeLayout {
    /// Adds a colour, unless there is one.
    pub fn add_colour(&mut self) {
        if self.colour.is_none() {
            self.colour = Some(self.grow(4));
        }
    }

    /// Adds a normal, unless there is one.
    pub fn add_normal(&mut self) {
        if self.normal.is_none() {
            self.normal = Some(self.grow(3));
        }
    }

    /// Adds a tangent, unless there is one.
    pub fn add_tangent(&mut self) {
        if self.tangent.is_none() {
            self.tangent = Some(self.grow(4));
        }
    }

    /// Adds sets of coordinates until there are `sets`.
    pub fn add_uv(&mut self, sets: usize) {
        while self.uv.len() < sets {
            let place = self.grow(2);
            self.uv.push(place);
        }
    }

    /// Adds a scalar, unless there is one of the name.
    pub fn add_scalar(&mut self, name: &str) {
        if !self.scalars.iter().any(|(known, _)| known == name) {
            let place = self.grow(1);
            self.scalars.push((name.to_owned(), place));
        }
    }

    fn grow(&mut self, count: usize) -> usize {
        self.stride += count;
        self.stride - count
    }

    /// Adds everything that another layout has.
    pub fn join(&mut self, other: &Self) {
        if other.colour.is_some() {
            self.add_colour();
        }
        if other.normal.is_some() {
            self.add_normal();
        }
        if other.tangent.is_some() {
            self.add_tangent();
        }
        self.add_uv(other.uv.len());
        other.scalars.iter().for_each(|(name, _)| self.add_scalar(name));
    }

    /// The record of a corner of which nothing is known.
    pub fn blank(&self) -> Vec<f32> {
        let mut record = vec![f32::NAN; self.stride];
        if let Some(colour) = self.colour {
            record[colour..colour + 4].fill(1.0);
        }
        record
    }

    /// For each number of a record of this layout its place in a record of another one, if it has it.
    pub(super) fn places_in(&self, other: &Self) -> Vec<Option<usize>> {
        let mut places = vec![None; self.stride];
        let mut copy = |to: usize, from: usize, count: usize| {
            (0..count).for_each(|i| places[to + i] = Some(from + i));
        };
        if let (Some(to), Some(from)) = (self.colour, other.colour) {
            copy(to, from, 4);
        }
        if let (Some(to), Some(from)) = (self.normal, other.normal) {
            copy(to, from, 3);
        }
        if let (Some(to), Some(from)) = (self.tangent, other.tangent) {
            copy(to, from, 4);
        }
        self.uv.iter().zip(&other.uv).for_each(|(&to, &from)| copy(to, from, 2));
        for (name, to) in &self.scalars {
            if let Some((_, from)) = other.scalars.iter().find(|(other, _)| other == name) {
                copy(*to, *from, 1);
            }
        }
        places
    }
}
