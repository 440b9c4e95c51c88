//! Files of heights: what they say of themselves, cuts, and windows of samples.
#![expect(unsafe_code, reason = "the names are C's")]

use std::ffi::c_char;

use lodpack::heights::Base;

use crate::{
    file::File,
    pointer::{borrow, copy_rows, give, write},
    query::Cut,
    status::{Failure, Status, guard},
};

/// What heights stand on.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub enum Ground {
    /// A plane: coordinates are x and y, and z is up.
    Plane = 0,
    /// A sphere around the origin: coordinates are degrees of longitude and latitude.
    Sphere = 1,
    /// An ellipsoid of revolution around the origin, in the same coordinates.
    Ellipsoid = 2,
}

/// What is known about a file of heights as soon as it is open.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HeightsInfo {
    /// A lodpack_ground.
    pub ground: i32,
    /// Whether the last column is followed by the first one, around a globe.
    pub wraps: i32,
    /// Whether its meshes have colours: those of a ramp, or of an image over the heights.
    pub has_colours: i32,
    /// The tolerance of a query is met by tiles of at most this many depths.
    pub depth_count: u32,
    /// Columns of samples.
    pub column_count: u64,
    /// Rows of samples.
    pub row_count: u64,
    /// Coordinates of the first column and the first row, which is the northernmost.
    pub first: [f64; 2],
    /// What each column and each row adds to them. Rows go to the south, so theirs is negative.
    pub spacing: [f64; 2],
    /// Stored heights are multiples of it, but for a constant.
    pub step: f64,
    /// No stored height is further from the sample that it was made from.
    pub sample_error: f64,
    /// Units of positions in a unit of heights.
    pub height_scale: f64,
    /// Metres in a unit of heights; 0 if nobody has said.
    pub unit: f64,
    /// The coordinate reference system, as "EPSG:" and a number or as WKT; empty if there is none. Valid until the file
    /// is closed.
    pub crs: *const c_char,
}

/// What to draw of heights, and how finely. lodpack_heights_query_default() fills all of it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HeightsQuery {
    /// The error to reach, in units of positions. By default 0: as fine as possible.
    pub tolerance: f64,
    /// The least coordinates: x and y, or degrees of longitude and latitude; by default minus infinity. Tiles that meet
    /// the box are drawn whole.
    pub low: [f64; 2],
    /// The greatest coordinates; by default infinity. On a globe the least longitude may be larger: then the box
    /// crosses the end of the grid.
    pub high: [f64; 2],
    /// The most triangles, without those that close the lines between tiles; by default UINT64_MAX.
    pub max_triangles: u64,
}

/// Writes what a file of heights says of itself. Reads nothing.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_heights_info(file: *const File, info: *mut HeightsInfo) -> Status {
    guard(|| {
        let file = borrow(file, "file")?;
        let heights = file.heights()?;
        let (grid, surface, about) = (heights.grid(), heights.surface(), heights.info());
        let ground = match surface.base {
            Base::Plane => Ground::Plane,
            Base::Ellipsoid { eccentricity: 0.0, .. } => Ground::Sphere,
            Base::Ellipsoid { .. } => Ground::Ellipsoid,
        };
        let [column_count, row_count] = grid.samples();
        let value = HeightsInfo {
            ground: ground as i32,
            wraps: grid.wraps().into(),
            has_colours: (heights.ramp().is_some() || heights.drape().is_some()).into(),
            depth_count: grid.depth() + 1,
            column_count,
            row_count,
            first: surface.first,
            spacing: surface.spacing,
            step: about.step,
            sample_error: about.sample_error,
            height_scale: surface.height_scale,
            unit: about.unit.unwrap_or(0.0),
            crs: file.names.crs.as_ptr(),
        };
        write(info, value, "info")
    })
}

/// A query for everything at the finest resolution.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_heights_query_default() -> HeightsQuery {
    HeightsQuery { tolerance: 0.0, low: [f64::NEG_INFINITY; 2], high: [f64::INFINITY; 2], max_triangles: u64::MAX }
}

/// Finds the coarsest tiles within the tolerance, or the finest ones that keep the budget. lodpack_decode() makes their
/// mesh, without cracks.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_select_heights(file: *const File, query: *const HeightsQuery, cut: *mut *mut Cut) -> Status {
    guard(|| {
        write(cut, std::ptr::null_mut(), "cut")?;
        let file = borrow(file, "file")?;
        let &HeightsQuery { tolerance, low, high, max_triangles } = borrow(query, "query")?;
        let everywhere = lodpack_heights_query_default();
        let query = lodpack::heights::HeightsQuery {
            bounds: (low != everywhere.low || high != everywhere.high).then_some([low, high]),
            tolerance: (tolerance != 0.0).then_some(tolerance),
            max_triangles: (max_triangles != u64::MAX).then_some(max_triangles),
        };
        give(cut, Cut::Heights(file.heights()?.cut(&query).map_err(|error| file.blame(error))?))
    })
}

/// Reads a window of samples to `heights`, which has room for `capacity` numbers: `row_count` rows of `column_count`,
/// from the north; NaN where there are none. Around a globe a window may go on beyond the last column.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_read_heights(
    file: *const File,
    first_column: u64,
    column_count: u64,
    first_row: u64,
    row_count: u64,
    heights: *mut f64,
    capacity: usize,
) -> Status {
    guard(|| {
        let file = borrow(file, "file")?;
        let count = column_count.checked_mul(row_count).and_then(|count| usize::try_from(count).ok());
        if count.is_none_or(|count| count > capacity) {
            let what = format!("there is room for {capacity} heights, not for {column_count} x {row_count}");
            return Err(Failure::argument(what));
        }
        let columns = first_column..first_column.saturating_add(column_count);
        let rows = first_row..first_row.saturating_add(row_count);
        let found = file.heights()?.window(columns, rows).map_err(|error| file.blame(error))?;
        copy_rows(found.into_iter().map(|height| [height]), heights, capacity, 0)
    })
}
