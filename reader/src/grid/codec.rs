//! Coding of a level: shape, then depth by depth each candidate cell's split flag, edge middles and middle.
//!
//! Encoder and decoder run the same walk ([`code_level`]) with another [`Coder`], so they cannot drift apart.

use super::{
    Border, GridCell, GridLimits, GridShape, GridSides, GridState, MAX_DEPTH, Quantisation, UNIT,
    predict::{cell_middle, centre, edge_middle},
    state::{GridSite, Node, Place},
};
use crate::{
    context::{Context, grid as contexts},
    entropy::{SymbolBuffer, SymbolSource},
    error::{Error, Result},
    frame::{Frame, round, to_lattice},
    irregular::Slide,
    vector::{Vec3, cross, dot, sub, to_f64},
};

/// What an encoder wants a level to be.
pub trait GridTarget: Slide<GridSite> {
    /// How the inside is drawn.
    fn shape(&self) -> GridShape;
    /// Whether a cell is split at this level. Cells split at the coarser level stay split unasked.
    fn is_split(&self, cell: GridCell) -> bool;
    /// Where the vertex at a site should be, in lattice units.
    fn position(&self, site: GridSite) -> [f64; 3];
}

/// Writes one level in closed loop and returns the state that the decoder will have.
///
/// # Errors
/// As the decoder: sides that do not fit, positions beyond 2^40, too many vertices. [`Error::Query`] where the target
/// asks for a coarser shape than the level before.
pub fn encode_level(
    target: &dyn GridTarget,
    previous: Option<GridState>,
    sides: &GridSides,
    quantisation: Quantisation,
    symbols: &mut SymbolBuffer,
) -> Result<GridState> {
    let mut encoder = Encoder { target, symbols, steps: quantisation.steps() };
    code_level(&mut encoder, previous, sides, GridLimits { vertex_count: u32::MAX as u64 })
}

/// Reads one level.
///
/// # Errors
/// [`Error::Format`] where symbols or sides break a rule, [`Error::Limit`] above `limits`.
pub(crate) fn decode_level(
    symbols: &mut impl SymbolSource,
    previous: Option<GridState>,
    sides: &GridSides,
    quantisation: Quantisation,
    limits: GridLimits,
) -> Result<GridState> {
    let mut decoder = Decoder { symbols, steps: quantisation.steps() };
    code_level(&mut decoder, previous, sides, limits)
}

/// A vertex about to be coded.
struct Vertex {
    site: GridSite,
    prediction: Vec3,
    frame: Frame,
    /// Contexts of the residual's components; the tangential ones twice: after a zero and a non-zero normal component.
    normal_context: Context,
    tangent_contexts: [[Context; 2]; 2],
}

/// One direction of coding.
trait Coder {
    fn shape(&mut self, coarser: GridShape) -> Result<GridShape>;
    fn split(&mut self, context: Context, cell: GridCell) -> Result<bool>;
    /// Residual steps along the normal and both tangents.
    fn residual(&mut self, vertex: &Vertex) -> Result<[i64; 3]>;
    /// Steps along the normal and within the surface.
    fn steps(&self) -> (f64, f64);
}

struct Decoder<'a, S> {
    symbols: &'a mut S,
    steps: (f64, f64),
}

impl<S: SymbolSource> Coder for Decoder<'_, S> {
    fn shape(&mut self, coarser: GridShape) -> Result<GridShape> {
        let step = self.symbols.get(contexts::SHAPE + coarser as Context)?;
        let shape =
            usize::try_from(step).ok().and_then(|step| GridShape::ALL.get((coarser as usize).saturating_add(step)));
        shape.copied().ok_or(Error::format("a grid's shape is unknown"))
    }

    fn split(&mut self, context: Context, _cell: GridCell) -> Result<bool> {
        match self.symbols.get(context)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(Error::format("a grid cell's split flag is above 1")),
        }
    }

    fn residual(&mut self, vertex: &Vertex) -> Result<[i64; 3]> {
        let normal = self.symbols.get_signed(vertex.normal_context)?;
        let after = (normal != 0) as usize;
        let first = self.symbols.get_signed(vertex.tangent_contexts[0][after])?;
        let second = self.symbols.get_signed(vertex.tangent_contexts[1][after])?;
        Ok([normal, first, second])
    }

    fn steps(&self) -> (f64, f64) {
        self.steps
    }
}

struct Encoder<'a> {
    target: &'a dyn GridTarget,
    symbols: &'a mut SymbolBuffer,
    steps: (f64, f64),
}

impl Coder for Encoder<'_> {
    fn shape(&mut self, coarser: GridShape) -> Result<GridShape> {
        let shape = self.target.shape();
        let Some(step) = (shape as u64).checked_sub(coarser as u64) else {
            return Err(Error::Query {
                what: "a grid's level must not have a coarser shape than the level before".into(),
            });
        };
        self.symbols.put(contexts::SHAPE + coarser as Context, step);
        Ok(shape)
    }

    fn split(&mut self, context: Context, cell: GridCell) -> Result<bool> {
        let split = self.target.is_split(cell);
        self.symbols.put(context, split as u64);
        Ok(split)
    }

    fn residual(&mut self, vertex: &Vertex) -> Result<[i64; 3]> {
        let Vertex { site, prediction, frame, .. } = *vertex;
        let (normal_step, tangent_step) = self.steps;
        let target = self.target.position(site);
        let offset = sub(target, prediction);
        let [first, second] = [frame.along, frame.across].map(|t| round(dot(offset, t) / tangent_step));
        let point = frame.slide(prediction, first * tangent_step, second * tangent_step);
        let height = self.target.offset(site, point, frame.normal);
        let residual = [round(height / normal_step), first, second].map(|r| r as i64);
        let after = (residual[0] != 0) as usize;
        self.symbols.put_signed(vertex.normal_context, residual[0]);
        self.symbols.put_signed(vertex.tangent_contexts[0][after], residual[1]);
        self.symbols.put_signed(vertex.tangent_contexts[1][after], residual[2]);
        Ok(residual)
    }

    fn steps(&self) -> (f64, f64) {
        self.steps
    }
}

/// Codes a vertex, adds it and returns the size of its residual.
fn code_vertex(coder: &mut impl Coder, state: &mut GridState, vertex: &Vertex, limits: GridLimits) -> Result<u64> {
    if state.positions.len() as u64 >= limits.vertex_count {
        return Err(Error::Limit {
            what: "the number of a grid's vertices",
            found: state.positions.len() as u64 + 1,
            limit: limits.vertex_count,
        });
    }
    let residual = coder.residual(vertex)?;
    let (normal_step, tangent_step) = coder.steps();
    let within = [1, 2].map(|k| residual[k] as f64 * tangent_step);
    let moved = vertex.frame.slide(vertex.prediction, within[0], within[1]);
    let point = vertex.frame.lift(moved, residual[0] as f64 * normal_step);
    let position = to_lattice(point).ok_or(Error::format("a grid vertex lies outside the lattice"))?;
    state.insert(vertex.site, position);
    let [a, b, c] = residual.map(i64::unsigned_abs);
    Ok(a.saturating_add(b.saturating_add(c) / 2))
}

/// The walk that encoder and decoder share.
fn code_level(
    coder: &mut impl Coder,
    previous: Option<GridState>,
    sides: &GridSides,
    limits: GridLimits,
) -> Result<GridState> {
    let border = Border::new(sides)?;
    let mut state = previous.unwrap_or_else(|| GridState { side_count: border.side_count(), ..GridState::default() });
    if state.side_count != border.side_count() {
        return Err(Error::format("a grid's side count differs between levels"));
    }
    state.shape = coder.shape(state.shape)?;
    if state.shape >= GridShape::Fan && state.positions.is_empty() {
        code_centre(coder, &mut state, &border, limits)?;
    }
    if state.shape < GridShape::Quads {
        return Ok(state);
    }
    if state.nodes.is_empty() {
        if (0..state.side_count).any(|side| border.vertex(side, UNIT).is_none()) {
            return Err(Error::format("a grid of quads lacks the middle of a side"));
        }
        state.add_roots();
    }
    // Leaves by depth, those of coarser levels first; splits append their children.
    let mut candidates: Vec<Vec<(u32, bool)>> = vec![Vec::new(); MAX_DEPTH as usize + 1];
    for (index, node) in state.nodes.iter().enumerate().filter(|(_, node)| node.children == 0) {
        candidates[node.cell.depth as usize].push((index as u32, false));
    }
    for depth in 0..MAX_DEPTH as usize {
        for (index, is_new) in std::mem::take(&mut candidates[depth]) {
            let node = state.nodes[index as usize];
            let Some(around) = Surroundings::new(&state, &border, node.cell)? else { continue };
            let context = contexts::split(is_new, size_class(node.magnitude), around.finer_neighbour_count());
            if !coder.split(context, node.cell)? {
                continue;
            }
            let magnitude = split_cell(coder, &mut state, &border, node, &around, limits)?;
            let children = state.add_children(index as usize, magnitude);
            candidates[depth + 1].extend((children..children + 4).map(|child| (child, true)));
        }
    }
    Ok(state)
}

/// The centre, predicted from the corners and those middles of sides that are samples.
fn code_centre(coder: &mut impl Coder, state: &mut GridState, border: &Border, limits: GridLimits) -> Result<()> {
    let mut chain = Vec::new();
    for side in 0..state.side_count {
        for param in [0, UNIT] {
            chain.extend(border.vertex(side, param).map(|v| state.position(border, v)));
        }
    }
    let (prediction, area) = centre(&chain);
    let along = chain.first().map_or([0.0; 3], |&p| sub(p, prediction));
    let vertex = Vertex {
        site: GridSite { quad: 0, x: 0, y: 0 },
        prediction,
        frame: Frame::new(area, along),
        normal_context: contexts::CENTRE,
        tangent_contexts: [[contexts::CENTRE + 1; 2], [contexts::CENTRE + 2; 2]],
    };
    state.centre_magnitude = code_vertex(coder, state, &vertex, limits)?;
    Ok(())
}

/// What is known about a cell that may be split.
struct Surroundings {
    corners: [Vec3; 4],
    /// Coordinates, site (none on the border) and, where known, position of each edge's middle.
    middles: [([u32; 2], Option<GridSite>, Option<Vec3>); 4],
}

impl Surroundings {
    /// None where the cell cannot be split because the middle of a border edge is no sample.
    fn new(state: &GridState, border: &Border, cell: GridCell) -> Result<Option<Self>> {
        let corners = cell.corners();
        let mut points = [[0.0; 3]; 4];
        for (point, corner) in points.iter_mut().zip(corners) {
            *point = state.point(border, cell.quad, corner).ok_or(Error::format("a grid cell's corner is missing"))?;
        }
        let mut middles = [([0; 2], None, None); 4];
        for (edge, middle) in middles.iter_mut().enumerate() {
            let (a, b) = (corners[edge], corners[(edge + 1) % 4]);
            let at = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
            let point = state.point(border, cell.quad, at);
            *middle = match Place::new(state.side_count, cell.quad, at) {
                Place::Border { .. } if point.is_none() => return Ok(None),
                Place::Border { .. } => (at, None, point),
                Place::Inner(site) => (at, Some(site), point),
            };
        }
        Ok(Some(Self { corners: points, middles }))
    }

    /// How many inner edges have a split cell on their other side.
    fn finer_neighbour_count(&self) -> usize {
        self.middles.iter().filter(|(_, site, point)| site.is_some() && point.is_some()).count()
    }
}

/// Codes the new vertices of a cell that is split; returns the mean size of their residuals.
fn split_cell(
    coder: &mut impl Coder,
    state: &mut GridState,
    border: &Border,
    node: Node,
    around: &Surroundings,
    limits: GridLimits,
) -> Result<u64> {
    let Surroundings { corners, middles } = around;
    let cell = node.cell;
    let across = cross(sub(corners[2], corners[0]), sub(corners[3], corners[1]));
    let (mut sum, mut count) = (0u64, 0);
    // The size to expect: two parts what this cell showed so far (or its parent), one part its parent.
    let class = |sum: u64, count: u64| {
        let shown = sum.checked_div(count).unwrap_or(node.magnitude);
        size_class(
            (shown / 3).saturating_mul(2).saturating_add(shown % 3 * 2 / 3).saturating_add(node.magnitude.div_ceil(3)),
        )
    };
    let mut edges = [[0.0; 3]; 4];
    for edge in 0..4 {
        let (at, site, point) = middles[edge];
        edges[edge] = match (point, site) {
            (Some(point), _) => point,
            (None, None) => return Err(Error::format("a border sample of a grid is missing")),
            (None, Some(site)) => {
                let ends = [corners[edge], corners[(edge + 1) % 4]];
                let [before, after] = beyond(state, border, cell, edge, at);
                let vertex = Vertex {
                    site,
                    prediction: edge_middle(before, ends, after),
                    frame: Frame::new(across, sub(ends[1], ends[0])),
                    normal_context: contexts::normal(0, class(sum, count)),
                    tangent_contexts: contexts::tangents(0, class(sum, count)),
                };
                sum = sum.saturating_add(code_vertex(coder, state, &vertex, limits)?);
                count += 1;
                state.positions.last().map_or([0.0; 3], |&p| to_f64(p))
            }
        };
    }
    let [bottom, right, top, left] = edges;
    let middle = [cell.x as u32 + cell.size() / 2, cell.y as u32 + cell.size() / 2];
    let Place::Inner(site) = Place::new(state.side_count, cell.quad, middle) else {
        return Err(Error::format("a grid cell's middle lies on the border"));
    };
    let vertex = Vertex {
        site,
        prediction: cell_middle(edges, *corners),
        frame: Frame::new(cross(sub(right, left), sub(top, bottom)), sub(right, left)),
        normal_context: contexts::normal(1, class(sum, count)),
        tangent_contexts: contexts::tangents(1, class(sum, count)),
    };
    sum = sum.saturating_add(code_vertex(coder, state, &vertex, limits)?);
    Ok(sum / (count + 1))
}

/// The vertices beyond both ends of an edge of a cell, an edge length away, inside the same quad.
fn beyond(state: &GridState, border: &Border, cell: GridCell, edge: usize, at: [u32; 2]) -> [Option<Vec3>; 2] {
    let axis = edge % 2;
    let reach = cell.size() + cell.size() / 2;
    let point = |coordinate: Option<u32>| {
        let mut place = at;
        place[axis] = coordinate.filter(|&c| c <= UNIT)?;
        state.point(border, cell.quad, place)
    };
    let (less, more) = (point(at[axis].checked_sub(reach)), point(at[axis].checked_add(reach)));
    // Edges 2 and 3 run towards smaller coordinates.
    if edge < 2 { [less, more] } else { [more, less] }
}

/// Bit length of a residual's size, at most [`contexts::SIZE_CLASSES`] - 1.
fn size_class(magnitude: u64) -> usize {
    ((u64::BITS - magnitude.leading_zeros()) as usize).min(contexts::SIZE_CLASSES - 1)
}
