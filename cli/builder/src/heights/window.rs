//! Samples at equal distances out of a file of heights.

/// A window of samples at equal distances.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterWindow {
    /// Depth of the tiles that have its samples.
    pub(super) depth: u32,
    /// Lines of the grid from a sample to the next.
    pub stride: u64,
    /// The first column and the first row, counted in strides.
    pub(super) first: [u64; 2],
    /// Columns and rows.
    pub size: [u64; 2],
    /// A bound of the distance between the surface of these samples and what the heights were made from, in units of
    /// space.
    pub error: f64,
}
