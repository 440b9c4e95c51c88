//! The edges between a grid's vertices. The cells on both sides know an edge by its number, so neither has to search
//! for the other.

/// A vertex of a grid, at all levels: an inner vertex by its number, or a border sample by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Vertex(u32);

/// Marks a border sample. Its number in a patch changes from level to level.
const BORDER: u32 = 1 << 31;

/// Inner vertices have numbers below this.
pub(super) const VERTEX_LIMIT: u64 = BORDER as u64 - 1;

/// What a [`Vertex`] is.
pub(super) enum Kind {
    /// An inner vertex, by its number.
    Inner(usize),
    /// A sample of the border, by its number in [`Edges::border_places`].
    Border(usize),
}

impl Vertex {
    /// No vertex.
    pub(super) const NONE: Self = Self(u32::MAX);

    /// The inner vertex of a number below [`VERTEX_LIMIT`].
    pub(super) fn inner(number: u32) -> Self {
        Self(number)
    }

    pub(super) fn kind(self) -> Kind {
        if self.0 & BORDER == 0 { Kind::Inner(self.0 as usize) } else { Kind::Border((self.0 & !BORDER) as usize) }
    }
}

/// Part of a side or spoke, or of a line across a quad.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Edge {
    /// The vertex that divides it.
    middle: Vertex,
    /// Index of its first half, the one of smaller coordinates, which the second one follows; 0 where it is not
    /// divided.
    halves: u32,
}

/// All edges, and the border samples that are corners of cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Edges {
    edges: Vec<Edge>,
    /// Side and parameter.
    border_places: Vec<(u32, u32)>,
}

impl Edges {
    /// Adds undivided edges and returns the first one's index.
    pub(super) fn add(&mut self, count: usize) -> u32 {
        let first = self.edges.len();
        self.edges.resize(first + count, Edge { middle: Vertex::NONE, halves: 0 });
        first as u32
    }

    /// The vertex that divides an edge, and the first half of the edge.
    pub(super) fn halves(&self, edge: u32) -> Option<(Vertex, u32)> {
        let Edge { middle, halves } = self.edges[edge as usize];
        (halves != 0).then_some((middle, halves))
    }

    /// Whether an edge has a vertex between its ends.
    pub(super) fn is_divided(&self, edge: u32) -> bool {
        self.edges[edge as usize].halves != 0
    }

    /// Divides an edge, unless that has been done, and returns its first half.
    pub(super) fn divide(&mut self, edge: u32, middle: Vertex) -> u32 {
        let halves = self.edges[edge as usize].halves;
        if halves != 0 {
            return halves;
        }
        let halves = self.add(2);
        self.edges[edge as usize] = Edge { middle, halves };
        halves
    }

    /// Names a sample of the border.
    pub(super) fn border_vertex(&mut self, side: usize, param: u32) -> Vertex {
        self.border_places.push((side as u32, param));
        Vertex(BORDER | (self.border_places.len() - 1) as u32)
    }

    /// The side and the parameter of each sample with a name.
    pub(super) fn border_places(&self) -> &[(u32, u32)] {
        &self.border_places
    }

    /// The vertex `along` an edge of length `size`, strictly between its ends, if there is one.
    pub(super) fn vertex_at(&self, edge: u32, size: u32, along: u32) -> Option<Vertex> {
        let (mut edge, mut half, mut along) = (edge, size / 2, along);
        loop {
            let (middle, halves) = self.halves(edge)?;
            if along == half {
                return Some(middle);
            }
            let is_second = along > half;
            edge = halves + u32::from(is_second);
            along -= if is_second { half } else { 0 };
            half /= 2;
        }
    }
}
