//! Coding of a level: its shape, then, depth by depth, the split flag of each candidate cell with the middles of its
//! edges and its own.
//!
//! Encoder and decoder run the same walk ([`code_level`]), each with its own [`Coder`], so they cannot drift apart.

use super::{
    Border, GridCell, GridLimits, GridShape, GridSides, GridState, MAX_DEPTH, Quantisation, UNIT, contexts,
    edges::{Kind, VERTEX_LIMIT, Vertex},
    predict::{cell_middle, centre, edge_middle},
    state::{GridSite, GridVertexRef, QuadNode, side_before},
};
use crate::{
    codec::{
        entropy::{SymbolBuffer, SymbolSource, context::Context},
        filling::Slide,
        local_frame::{LocalFrame, round, to_lattice},
        vector::{Vec3, cross, dot, sub, to_f64},
    },
    error::{Error, Result, Violation},
};

/// The target of an encoder: what a level should be.
pub trait GridTarget: Slide<GridSite> {
    /// How the inside is drawn.
    fn shape(&self) -> GridShape;
    /// Whether a cell is split at this level. Nobody asks about cells that are split at a coarser level: they stay
    /// split.
    fn is_split(&self, cell: GridCell) -> bool;
    /// The wanted position of the vertex at a site, in lattice units.
    fn position(&self, site: GridSite) -> [f64; 3];
}

/// Encodes one level, and returns the state that a decoder will have.
///
/// # Errors
/// As a decoder: if sides do not fit, positions exceed 2^40, or there are too many vertices. [`Error::Query`] if the
/// target asks for a coarser shape than that of the level before.
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

/// Decodes one level.
///
/// # Errors
/// [`Error::Format`] if symbols or sides break a rule, [`Error::Limit`] above `limits`.
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

/// A vertex that is about to be coded.
struct NewVertex {
    site: GridSite,
    prediction: Vec3,
    frame: LocalFrame,
    /// The context of the normal component, and those of the tangential ones: after a zero, and after a non-zero normal
    /// component.
    normal_context: Context,
    tangent_contexts: [[Context; 2]; 2],
}

/// What the walk asks about a grid: the encoder answers from its target, the decoder from symbols.
trait Coder {
    fn shape(&mut self, coarser: GridShape) -> Result<GridShape>;
    fn split(&mut self, context: Context, cell: GridCell) -> Result<bool, Violation>;
    /// The residual in steps, along the normal and along both tangents.
    fn residual(&mut self, vertex: &NewVertex) -> Result<[i64; 3], Violation>;
    /// The lengths of a step along the normal and along the surface.
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

    fn split(&mut self, context: Context, _cell: GridCell) -> Result<bool, Violation> {
        match self.symbols.get(context)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(Violation(&"a split flag of a grid is above 1")),
        }
    }

    fn residual(&mut self, vertex: &NewVertex) -> Result<[i64; 3], Violation> {
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
                what: "a level of a grid must not have a coarser shape than the level before".into(),
            });
        };
        self.symbols.put(contexts::SHAPE + coarser as Context, step);
        Ok(shape)
    }

    fn split(&mut self, context: Context, cell: GridCell) -> Result<bool, Violation> {
        let split = self.target.is_split(cell);
        self.symbols.put(context, split as u64);
        Ok(split)
    }

    fn residual(&mut self, vertex: &NewVertex) -> Result<[i64; 3], Violation> {
        let NewVertex { site, prediction, frame, .. } = *vertex;
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

/// Codes a vertex and adds it. Returns it with the size of its residual.
fn code_vertex(
    coder: &mut impl Coder,
    state: &mut GridState,
    vertex: &NewVertex,
    limits: GridLimits,
) -> Result<(Vertex, u64)> {
    let limit = limits.vertex_count.min(VERTEX_LIMIT);
    if state.positions.len() as u64 >= limit {
        return Err(Error::Limit {
            what: "the number of a grid's vertices",
            found: state.positions.len() as u64 + 1,
            limit,
        });
    }
    let residual = coder.residual(vertex)?;
    let (normal_step, tangent_step) = coder.steps();
    let (first, second) = (residual[1] as f64 * tangent_step, residual[2] as f64 * tangent_step);
    let moved = vertex.frame.slide(vertex.prediction, first, second);
    let point = vertex.frame.lift(moved, residual[0] as f64 * normal_step);
    let position = to_lattice(point).ok_or(Error::format("a grid vertex lies outside the lattice"))?;
    let added = state.insert(vertex.site, position);
    let [a, b, c] = residual.map(i64::unsigned_abs);
    Ok((added, a.saturating_add(b.saturating_add(c) / 2)))
}

/// The border at the present level, and those of its samples that the grid has names for.
struct Rim<'a> {
    border: Border<'a>,
    /// Patch vertices.
    named: Vec<u32>,
}

impl Rim<'_> {
    fn point(&self, state: &GridState, vertex: Vertex) -> Vec3 {
        match vertex.kind() {
            Kind::Inner(number) => to_f64(state.positions[number]),
            Kind::Border(number) => to_f64(self.border.positions[self.named[number] as usize]),
        }
    }

    /// Names a sample.
    fn name(&mut self, state: &mut GridState, side: usize, param: u32) -> Result<Vertex> {
        let vertex = self.border.vertex(side, param);
        self.named.push(vertex.ok_or(Error::format("a border sample of a grid is missing"))?);
        Ok(state.edges.border_vertex(side, param))
    }
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
        return Err(Error::format("the number of a grid's sides differs between levels"));
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
            return Err(Error::format("a grid has quads, but a side has no sample in its middle"));
        }
        state.add_roots();
    }
    let named = border.named(state.edges.border_places())?;
    let mut rim = Rim { border, named };
    // The leaves by depth, those of coarser levels first. Each split appends its children.
    let mut candidates: Vec<Vec<(u32, bool)>> = vec![Vec::new(); MAX_DEPTH as usize + 1];
    for (index, node) in state.nodes.iter().enumerate().filter(|(_, node)| node.children == 0) {
        candidates[node.cell.depth as usize].push((index as u32, false));
    }
    for depth in 0..MAX_DEPTH as usize {
        for (index, is_new) in std::mem::take(&mut candidates[depth]) {
            let node = state.nodes[index as usize];
            let Some(finer_neighbour_count) = finer_neighbour_count(&state, &rim.border, &node) else { continue };
            let context = contexts::split(is_new, size_class(node.magnitude), finer_neighbour_count);
            if !coder.split(context, node.cell)? {
                continue;
            }
            let children = split_cell(coder, &mut state, &mut rim, index as usize, limits)?;
            candidates[depth + 1].extend((children..children + 4).map(|child| (child, true)));
        }
    }
    Ok(state)
}

/// The number of inner edges of a cell that have a split cell on their other side. None if the cell cannot be split,
/// because the middle of an edge on the border is no sample.
fn finer_neighbour_count(state: &GridState, border: &Border, node: &QuadNode) -> Option<usize> {
    let GridCell { quad, x, y, .. } = node.cell;
    let (x, y, size) = (u32::from(x), u32::from(y), node.cell.size());
    let (mut right, mut top) = (0, 0);
    if x + size == UNIT {
        border.vertex(side_before(quad, state.side_count), UNIT + y + size / 2)?;
    } else {
        right = usize::from(state.edges.is_divided(node.edges[1]));
    }
    if y + size == UNIT {
        border.vertex(usize::from(quad), UNIT - x - size / 2)?;
    } else {
        top = usize::from(state.edges.is_divided(node.edges[2]));
    }
    let [bottom, left] = [0, 3].map(|edge| usize::from(state.edges.is_divided(node.edges[edge])));
    Some(bottom + right + top + left)
}

/// Codes the centre. Its prediction is the mean of the corners and of those middles of sides that are samples.
fn code_centre(coder: &mut impl Coder, state: &mut GridState, border: &Border, limits: GridLimits) -> Result<()> {
    let mut chain = Vec::new();
    for side in 0..state.side_count {
        for param in [0, UNIT] {
            chain.extend(border.vertex(side, param).map(|v| to_f64(border.positions[v as usize])));
        }
    }
    let (prediction, area) = centre(&chain);
    let along = chain.first().map_or([0.0; 3], |&p| sub(p, prediction));
    let vertex = NewVertex {
        site: GridSite { quad: 0, x: 0, y: 0 },
        prediction,
        frame: LocalFrame::new(area, along),
        normal_context: contexts::CENTRE,
        tangent_contexts: [[contexts::CENTRE + 1; 2], [contexts::CENTRE + 2; 2]],
    };
    state.centre_magnitude = code_vertex(coder, state, &vertex, limits)?.1;
    Ok(())
}

/// Codes the new vertices of a cell, and splits it. Returns the first of its children.
fn split_cell(
    coder: &mut impl Coder,
    state: &mut GridState,
    rim: &mut Rim<'_>,
    index: usize,
    limits: GridLimits,
) -> Result<u32> {
    let node = state.nodes[index];
    let cell = node.cell;
    let corner = |k: usize| rim.point(state, node.corners[k]);
    let corners = [corner(0), corner(1), corner(2), corner(3)];
    let across = cross(sub(corners[2], corners[0]), sub(corners[3], corners[1]));
    let (mut sum, mut count) = (0u64, 0);
    // The expected size: two parts what this cell has shown so far (or its parent), one part its parent.
    let class = |sum: u64, count: u64| {
        let shown = sum.checked_div(count).unwrap_or(node.magnitude);
        size_class(
            (shown / 3).saturating_mul(2).saturating_add(shown % 3 * 2 / 3).saturating_add(node.magnitude.div_ceil(3)),
        )
    };
    let mut middles = [Vertex::NONE; 4];
    let mut edges = [[0.0; 3]; 4];
    for edge in 0..4 {
        middles[edge] = match state.edge_middle(index, edge) {
            (GridVertexRef::Border { side, param }, _) => rim.name(state, side, param)?,
            (GridVertexRef::Inner(_), Some(middle)) => middle,
            (GridVertexRef::Inner(site), None) => {
                let ends = [corners[edge], corners[(edge + 1) % 4]];
                let [before, after] = beyond(state, rim, cell, edge);
                let class = class(sum, count);
                let vertex = NewVertex {
                    site,
                    prediction: edge_middle(before, ends, after),
                    frame: LocalFrame::new(across, sub(ends[1], ends[0])),
                    normal_context: contexts::normal(0, class),
                    tangent_contexts: contexts::tangents(0, class),
                };
                let (middle, magnitude) = code_vertex(coder, state, &vertex, limits)?;
                sum = sum.saturating_add(magnitude);
                count += 1;
                middle
            }
        };
        edges[edge] = rim.point(state, middles[edge]);
    }
    let [bottom, right, top, left] = edges;
    let class = class(sum, count);
    let vertex = NewVertex {
        site: cell.middle_site(),
        prediction: cell_middle(edges, corners),
        frame: LocalFrame::new(cross(sub(right, left), sub(top, bottom)), sub(right, left)),
        normal_context: contexts::normal(1, class),
        tangent_contexts: contexts::tangents(1, class),
    };
    let (middle, magnitude) = code_vertex(coder, state, &vertex, limits)?;
    sum = sum.saturating_add(magnitude);
    Ok(state.divide(index, middles, middle, sum / (count + 1)))
}

/// The vertices one edge length beyond both ends of a cell's edge, within the same quad.
fn beyond(state: &GridState, rim: &Rim<'_>, cell: GridCell, edge: usize) -> [Option<Vec3>; 2] {
    let axis = edge % 2;
    let (corners, size) = (cell.corners(), cell.size());
    // The end with the smaller coordinates.
    let start = corners[[0, 1, 3, 0][edge]];
    let point = |coordinate: Option<u32>| {
        let mut at = start;
        at[axis] = coordinate.filter(|&c| c <= UNIT)?;
        match GridVertexRef::new(state.side_count, cell.quad, at) {
            GridVertexRef::Border { side, param } => {
                rim.border.vertex(side, param).map(|vertex| to_f64(rim.border.positions[vertex as usize]))
            }
            GridVertexRef::Inner(_) => state.inner_vertex(cell.quad, at).map(|vertex| rim.point(state, vertex)),
        }
    };
    let (less, more) = (point(start[axis].checked_sub(size)), point(Some(start[axis] + 2 * size)));
    // Edges 2 and 3 run towards smaller coordinates.
    if edge < 2 { [less, more] } else { [more, less] }
}

/// The bit length of a residual's size, at most [`contexts::SIZE_CLASSES`] - 1.
fn size_class(magnitude: u64) -> usize {
    ((u64::BITS - magnitude.leading_zeros()) as usize).min(contexts::SIZE_CLASSES - 1)
}
