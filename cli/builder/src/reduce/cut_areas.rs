//! The areas of a cut between which its colours jump, found in its images: a builder knows them from the input, and no
//! file says what they were.

use std::collections::{BTreeMap, BTreeSet};

use lodpack::decode::TexturedMesh;
use lodpack::index::{ChannelInfo, ChannelKind};

use super::shown_colours::colour_at;
use lodpack_mesh::union_find::{find, unite};
use lodpack_mesh::{Adjacency, NONE, next_half_edge};
use lodpack_stage::areas::{ColourAreas, Differences, INWARDS, MOST_INWARDS, OF_DRAWINGS};

/// Differences of less than this, of 255, are no jump: builders keep lines from 28 on at the usual quality, and images
/// are off by some of it.
const LEAST: f64 = 20.0;
/// Places along an edge at which colours are compared.
const PLACES: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];

/// The areas of the triangles of a cut, and where colours jump between them; none if they do nowhere. Pieces of maps
/// never lie on both sides of a line at which they do, so areas are pieces that are taken together as far as no line is
/// between them.
pub(super) fn areas_of_cut(cut: &TexturedMesh, channels: &[&ChannelInfo]) -> Option<ColourAreas> {
    let colour = channels.iter().position(|channel| channel.kind == ChannelKind::Colour);
    let drawings = channels.iter().position(|channel| channel.kind == ChannelKind::Drawing);
    let drawings = drawings.map_or(vec![], |channel| cut.drawings(channel));
    let triangles = &cut.mesh.triangles;
    let adjacency = Adjacency::new(triangles, cut.mesh.positions.len());
    let mut sets: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut borders = vec![];
    for (half_edge, &opposite) in (0..).zip(&adjacency.opposite).filter(|&(h, &other)| other != NONE && h < other) {
        if continues(cut, half_edge, opposite) {
            unite(&mut sets, half_edge / 3, opposite / 3);
        } else {
            borders.push([half_edge, opposite]);
        }
    }
    let mut differences = Differences::default();
    for sides in borders {
        let pair = sides.map(|h| find(&mut sets, h / 3));
        let [a, b] = sides.map(|h| colour.and_then(|channel| colour_along(cut, channel, h)));
        let is_drawn_alike = drawings.is_empty() || drawings[sides[0] as usize / 3] == drawings[sides[1] as usize / 3];
        let square = match (a, b) {
            _ if !is_drawn_alike => OF_DRAWINGS,
            (Some(a), Some(b)) => (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>() / 3.0,
            _ => continue,
        };
        differences.add(pair, square, length(cut, sides[0]));
    }
    let (lines, mut alike) = differences.divided(LEAST);
    if lines.is_empty() {
        return None;
    }
    // Pieces without a line between them are one area, those that are most alike first, unless a line would lie within
    // it.
    let mut enemies: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for &[a, b] in &lines {
        enemies.entry(a).or_default().insert(b);
        enemies.entry(b).or_default().insert(a);
    }
    alike.sort_by(|(one, x), (other, y)| x.total_cmp(y).then(one.cmp(other)));
    for ([a, b], _) in alike {
        let [a, b] = [a, b].map(|piece| find(&mut sets, piece));
        if a == b || enemies.get(&a).is_some_and(|of_a| of_a.contains(&b)) {
            continue;
        }
        unite(&mut sets, a, b);
        let [kept, gone] = [a.min(b), a.max(b)];
        let of_gone = enemies.remove(&gone).unwrap_or_default();
        for &enemy in &of_gone {
            let of_enemy = enemies.entry(enemy).or_default();
            of_enemy.remove(&gone);
            of_enemy.insert(kept);
        }
        enemies.entry(kept).or_default().extend(of_gone);
    }
    let pairs = lines.into_iter().map(|pair| pair.map(|piece| find(&mut sets, piece))).collect();
    Some(ColourAreas::of_sets(&mut sets, pairs))
}

/// Corners of a triangle along a half-edge, then the third one.
fn corners(half_edge: u32) -> (usize, [usize; 3]) {
    let first = half_edge as usize % 3;
    (half_edge as usize / 3, [first, (first + 1) % 3, (first + 2) % 3])
}

/// Whether both sides of an edge lie side by side in one image.
fn continues(cut: &TexturedMesh, half_edge: u32, opposite: u32) -> bool {
    let ((one, [a, b, _]), (other, [c, d, _])) = (corners(half_edge), corners(opposite));
    let (of_one, of_other) = (cut.places[one], cut.places[other]);
    cut.mesh.triangle_nodes[one] == cut.mesh.triangle_nodes[other]
        && of_one[a] == of_other[d]
        && of_one[b] == of_other[c]
}

fn length(cut: &TexturedMesh, half_edge: u32) -> f64 {
    let end = |h: u32| cut.mesh.positions[cut.mesh.triangles[h as usize / 3][h as usize % 3] as usize];
    let (a, b) = (end(half_edge), end(next_half_edge(half_edge)));
    (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>().sqrt()
}

/// The mean colour that a triangle shows along a half-edge, of 255. None where it has no image.
fn colour_along(cut: &TexturedMesh, channel: usize, half_edge: u32) -> Option<[f64; 3]> {
    let (triangle, [a, b, c]) = corners(half_edge);
    let places = cut.places.get(triangle)?.map(|place| place.map(f64::from));
    let [x, y, z] = [a, b, c].map(|corner| places[corner]);
    let (along, up) = ([y[0] - x[0], y[1] - x[1]], [z[0] - x[0], z[1] - x[1]]);
    let height = (along[0] * up[1] - along[1] * up[0]).abs() / (along[0] * along[0] + along[1] * along[1]).sqrt();
    // The smaller of a number and none is the number: where something has no area.
    let inwards = (INWARDS / height).min(MOST_INWARDS);
    let mut sum = [0.0; 3];
    for share in PLACES {
        let mut weights = [0.0; 3];
        (weights[a], weights[b], weights[c]) = ((1.0 - share) * (1.0 - inwards), share * (1.0 - inwards), inwards);
        let shown = colour_at(cut, channel, triangle, weights)?;
        (0..3).for_each(|k| sum[k] += shown[k]);
    }
    Some(sum.map(|sum| sum / PLACES.len() as f64))
}
