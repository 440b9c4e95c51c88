//! The stages of a build: one algorithm per module. `pipeline` calls them in order and says what holds between them; a
//! stage never calls `pipeline`, prints, or reads a file.
//!
//! Arrows between stages point down only, lowest first. A stage names the stages below it whose types it needs, and
//! nothing else:
//!
//! ```text
//! chart        one chart as a mesh of its own: the contract of embed, sample and simplify
//! areas        parts of the surface between which colours jump: the contract of shade, simplify and bake
//! arcs         labels -> corners, arcs, loops; how an arc is halved
//! repair       input -> oriented manifold
//! subdivide    manifold -> the same, triangles of very many texels in parts
//! segment      manifold -> labels                    (arcs: edges between labels)
//! arc_samples  arcs -> samples and their levels      (chart, arcs)
//! group        charts -> nested groups of them
//! pack         labels -> the same, small parts together      (segment, group)
//! embed        chart -> map onto a regular polygon   (chart)
//! least_squares  squares over offsets of vertices -> those that make them least
//! sample       map -> quadtrees of a grid filling    (chart, embed, least_squares)
//! simplify     chart -> levels of an irregular one   (chart, areas)
//! cluster_vertices  surface -> one of any number of triangles    (simplify)
//! certify      two triangle sets -> a proven bound on their distance
//! nearest      points of one surface -> what lies closest to them on another    (certify)
//! shade        points of the input -> their colour and values       (areas)
//! bake         patch, input -> an image over the patch       (nearest, certify, areas)
//! resample     closed surface -> one of simpler topology    (certify)
//! ```
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

pub mod arc_samples;
pub mod arcs;
pub mod areas;
pub mod bake;
pub mod certify;
pub mod chart;
pub mod cluster_vertices;
pub mod embed;
pub mod group;
pub mod least_squares;
pub mod nearest;
pub mod pack;
pub mod repair;
pub mod resample;
pub mod sample;
pub mod segment;
pub mod shade;
pub mod simplify;
pub mod subdivide;
