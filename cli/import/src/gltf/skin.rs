//! Skins: a mesh is where its joints put it, not where its node is (glTF 2.0, section 3.7.3.3).

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use glam::{DMat4, DVec4};

use super::accessor::{Array, read_vectors};
use super::arrays::Arrays;
use super::buffers::Buffers;
use super::document::{Document, Semantic, Skin};
use super::nodes::worlds_of_nodes;
use crate::error::{Location, Parsed};
use crate::source::Source;

/// Where the joints of all skins are, as the nodes of the document stand.
pub(super) struct Joints<'b> {
    document: &'b Document,
    buffers: &'b Buffers<'b>,
    worlds: Vec<DMat4>,
    /// Those of skins that were asked for. Many nodes may have the same one.
    known: RefCell<HashMap<usize, Rc<[DMat4]>>>,
}

impl<'b> Joints<'b> {
    pub(super) fn new(document: &'b Document, buffers: &'b Buffers<'b>) -> Self {
        Self { document, buffers, worlds: worlds_of_nodes(document), known: RefCell::default() }
    }

    /// What the joints of a skin do to a vertex that hangs on them.
    pub(super) fn matrices(&self, source: &Source, number: usize) -> Parsed<Rc<[DMat4]>> {
        if let Some(known) = self.known.borrow().get(&number) {
            return Ok(Rc::clone(known));
        }
        let location = Location::Item("skin", number as u64);
        let Some(Skin { joints, inverse_bind_matrices }) = self.document.skins.get(number) else {
            return Err(source.syntax(location, "is used by a node, but is not there; export the file again"));
        };
        let mut inverses = match inverse_bind_matrices.map(usize::from) {
            None => None,
            Some(accessor) => {
                let Some(array) = Array::find(self.document, self.buffers, accessor) else {
                    return Err(source.syntax(
                        location,
                        format!("uses accessor {accessor}, which is not there; export the file again"),
                    ));
                };
                if array.count() < joints.len() {
                    return Err(source.syntax(
                        array.location(),
                        "has fewer matrices than its skin has joints; export the file again",
                    ));
                }
                Some(read_vectors::<16>(source, &array)?)
            }
        };
        let matrix = |&joint: &_| {
            let node = usize::from(joint);
            let Some(world) = self.worlds.get(node) else {
                return Err(
                    source.syntax(location, format!("uses node {node}, which is not there; export the file again"))
                );
            };
            let inverse = inverses.as_mut().and_then(Iterator::next);
            Ok(*world * inverse.map_or(DMat4::IDENTITY, |inverse| DMat4::from_cols_array(&inverse)))
        };
        let matrices: Rc<[DMat4]> = joints.iter().map(matrix).collect::<Parsed<Vec<DMat4>>>()?.into();
        self.known.borrow_mut().insert(number, Rc::clone(&matrices));
        Ok(matrices)
    }
}

/// Joints and their weights, four and four for each vertex.
type Influences<'b> = Vec<[Box<dyn Iterator<Item = [f64; 4]> + 'b>; 2]>;

/// Where each vertex of a primitive goes.
pub(super) struct Skinning<'b> {
    matrices: &'b [DMat4],
    influences: Influences<'b>,
}

impl<'b> Skinning<'b> {
    /// None if the primitive hangs on no joint, so that it stays where it is.
    pub(super) fn of_primitive(source: &Source, arrays: &'b Arrays<'b>, matrices: &'b [DMat4]) -> Parsed<Option<Self>> {
        let mut influences = Influences::new();
        for set in 0.. {
            let of = [Semantic::Joints(set), Semantic::Weights(set)].map(|semantic| arrays.get(semantic));
            let [Some(joints), Some(weights)] = of else { break };
            let joints = Box::new(read_vectors(source, &joints)?) as Box<dyn Iterator<Item = [f64; 4]> + 'b>;
            influences.push([joints, Box::new(read_vectors(source, &weights)?)]);
        }
        Ok((!influences.is_empty()).then_some(Self { matrices, influences }))
    }

    /// The matrix of the next vertex: the mean of its joints'.
    pub(super) fn next(&mut self) -> DMat4 {
        let (mut sum, mut weight_sum) = (DMat4::ZERO, 0.0);
        for [joints, weights] in &mut self.influences {
            let [Some(joints), Some(weights)] = [joints.next(), weights.next()] else { continue };
            for (joint, weight) in joints.into_iter().zip(weights) {
                let matrix = self.matrices.get(joint as usize).filter(|_| weight > 0.0 && weight.is_finite());
                if let Some(&matrix) = matrix {
                    sum += matrix * weight;
                    weight_sum += weight;
                }
            }
        }
        if weight_sum == 0.0 {
            return DMat4::IDENTITY;
        }
        let mut mean = sum * (1.0 / weight_sum);
        // Sums of weights are only nearly 1, which must not move what is far away.
        mean.w_axis = DVec4::from((mean.w_axis.truncate(), 1.0));
        mean
    }
}
