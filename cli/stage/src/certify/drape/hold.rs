//! What fixes the points onto which vertices are laid.

/// What fixes the position of a foot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hold {
    /// Nothing: it is the nearest point of its tile.
    Free,
    /// It is the nearest point of a border edge of its tile.
    Edge(u32),
    /// It is a vertex of its tile, on the border.
    Vertex(u32),
    /// It is a vertex of its tile, a plain one (see [`Tiles::plain_vertices`](super::tiles::Tiles::plain_vertices)),
    /// and may become another point.
    Corner(u32),
}

impl Hold {
    /// Whether the foot may be moved to another tile.
    pub fn is_loose(self) -> bool {
        matches!(self, Self::Free | Self::Corner(_))
    }
}
