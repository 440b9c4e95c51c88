//! What a ray meets first: leaves from front to back, each at its finest level.

use std::ops::Range;

use super::{Mesh, cut::joined};
use crate::{
    codec::patch::Patch,
    error::{Error, Result},
    index::{Index, Ray},
    islands::islands,
    objects::{ObjectFilter, ObjectState},
    select::{Cut, Node},
    source::{
        Fetched,
        requests::{plan, plan_within},
    },
};

/// Leaves are asked for at once up to this many bytes: the first one that a ray enters is often not the one that it
/// meets, and each further step of a pick waits for a server.
const AT_ONCE_BYTES: u64 = 48 << 10;
/// The most of them. They are decoded once more when the answer comes.
const AT_ONCE: usize = 6;
/// Requests are joined up to this many bytes, whatever lies between: leaves that lie near each other do so in the file,
/// too, but not side by side.
const JOINED_BYTES: u64 = 96 << 10;

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// The leaf.
    pub root: u32,
    /// Its object, in a file that has any.
    pub object: Option<u32>,
    /// Where the ray meets it, world units.
    pub point: [f64; 3],
    /// How far that is from where the ray begins, world units.
    pub distance: f64,
    /// Bound of the distance between the surface that was met and the input, world units.
    pub error: f64,
}

/// The first point of the finest surface that a ray meets, from either side.
///
/// # Errors
/// [`Error::Missing`] until everything needed has been read; [`Error::Query`] if the ray has no direction;
/// [`Error::Format`], [`Error::Limit`].
pub fn pick(index: &Index, ray: Ray, fetched: &Fetched) -> Result<Option<Pick>> {
    pick_shown(index, ray, None, fetched)
}

/// As [`pick`], past the objects that a filter hides.
///
/// # Errors
/// As [`pick`]; [`Error::Query`] if the filter is one of another file.
pub fn pick_shown(index: &Index, ray: Ray, filter: Option<&ObjectFilter>, fetched: &Fetched) -> Result<Option<Pick>> {
    filter.map_or(Ok(()), |filter| index.id().check_filter(filter.file))?;
    let ray = ray.unit()?;
    let leaves =
        index.leaves_along(&ray, |root| filter.is_none_or(|filter| filter.state(root) != Some(ObjectState::Hidden)))?;
    let mut best: Option<(Pick, u32)> = None;
    let mut rest = &leaves[..];
    while let Some((&(enters, root), others)) = rest.split_first() {
        let reached = best.as_ref().map_or(f64::INFINITY, |(pick, _)| pick.distance);
        if reached < enters {
            break;
        }
        let leaf = match Leaf::new(index, root, filter, fetched) {
            Err(Error::Missing { mut ranges }) => {
                let enough = |ranges: &[Range<u64>]| {
                    plan(ranges.iter().cloned()).iter().map(|range| range.end - range.start).sum::<u64>()
                        >= AT_ONCE_BYTES
                };
                for &(_, root) in others.iter().take(AT_ONCE - 1).take_while(|leaf| leaf.0 <= reached) {
                    if enough(&ranges) {
                        break;
                    }
                    match Leaf::new(index, root, filter, fetched) {
                        Err(Error::Missing { ranges: more }) => ranges.extend(more),
                        Err(error) => return Err(error),
                        Ok(_) => {}
                    }
                }
                return Err(Error::Missing { ranges: plan_within(JOINED_BYTES, ranges) });
            }
            leaf => leaf?,
        };
        for (triangle, &origin) in leaf.mesh.triangles.iter().zip(&leaf.origins) {
            let corners = triangle.map(|vertex| leaf.mesh.positions[vertex as usize]);
            let Some(distance) = meets(&ray, corners) else { continue };
            if best.as_ref().is_none_or(|(pick, _)| distance < pick.distance) {
                let point = [0, 1, 2].map(|axis| ray.origin[axis] + ray.direction[axis] * distance);
                let island = leaf.islands.get(origin as usize).copied().unwrap_or(0);
                best = Some((Pick { root, object: None, point, distance, error: leaf.error }, island));
            }
        }
        rest = others;
    }
    let Some((mut pick, island)) = best else { return Ok(None) };
    if let Some(objects) = index.objects() {
        let owners = objects.owners(pick.root, finest_level(index, pick.root)?, fetched)?;
        pick.object = Some(*owners.get(island as usize).ok_or_else(|| Error::format("an island has no owner"))?);
    }
    Ok(Some(pick))
}

/// A leaf at its finest level, with borders as fine as any of its neighbours', so that no ray falls between them.
struct Leaf {
    mesh: Mesh,
    /// For each triangle that of the patch.
    origins: Vec<u32>,
    /// For each triangle of the patch.
    islands: Vec<u32>,
    error: f64,
}

impl Leaf {
    fn new(index: &Index, root: u32, filter: Option<&ObjectFilter>, fetched: &Fetched) -> Result<Self> {
        let level = finest_level(index, root)?;
        let cut = Cut { nodes: vec![Node { root, level }], ..Cut::default() };
        let mut of_patch = vec![];
        let states = filter.and_then(|filter| filter.islands(root, level));
        let mut visit = |_, patch: &Patch, _| {
            of_patch = islands(&patch.triangles).0;
            Ok(())
        };
        let (mut mesh, mut origins) = joined(index, &cut, u8::MAX, fetched, Some(&mut visit))?;
        if let Some(states) = states {
            let is_shown = |origin: &u32| {
                let island = of_patch.get(*origin as usize).copied().unwrap_or(0);
                states.get(island as usize) != Some(&ObjectState::Hidden)
            };
            let mut of_triangles = origins.iter();
            mesh.triangles.retain(|_| of_triangles.next().is_none_or(is_shown));
            origins.retain(is_shown);
        }
        let block = index.root_contents(root)?.blocks.last().copied();
        let error = block.map_or(0.0, |block| match block.border_deviation {
            0.0 => block.error,
            deviation => (block.error + deviation) * (1.0 + f64::EPSILON),
        });
        Ok(Self { mesh, origins, islands: of_patch, error })
    }
}

fn finest_level(index: &Index, root: u32) -> Result<u8> {
    let blocks = index.root_contents(root)?.blocks;
    blocks.last().map(|block| block.level).ok_or_else(|| Error::format("a root has no block"))
}

/// How far along a ray, whose direction has length 1, a triangle is (T. Moeller, B. Trumbore: Fast, minimum storage
/// ray/triangle intersection, 1997).
pub(crate) fn meets(ray: &Ray, [a, b, c]: [[f64; 3]; 3]) -> Option<f64> {
    let minus = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|k| p[k] - q[k]);
    let cross =
        |p: [f64; 3], q: [f64; 3]| [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let (u, v) = (minus(b, a), minus(c, a));
    let across = cross(ray.direction, v);
    let area = dot(u, across);
    if area == 0.0 {
        return None;
    }
    let from = minus(ray.origin, a);
    let first = dot(from, across) / area;
    let around = cross(from, u);
    let second = dot(ray.direction, around) / area;
    let distance = dot(v, around) / area;
    // A ray through an edge meets one of its triangles.
    const SLACK: f64 = 1e-12;
    let is_in = first >= -SLACK && second >= -SLACK && first + second <= 1.0 + SLACK && distance >= 0.0;
    is_in.then_some(distance)
}
