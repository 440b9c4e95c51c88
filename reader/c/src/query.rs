//! Queries and cuts.
#![expect(unsafe_code, reason = "the names are C's")]

use std::sync::Arc;

use lodpack::heights::HeightsCut;

use crate::{
    file::File,
    objects::ObjectFilter,
    pointer::{borrow, give, release, write},
    status::{Failure, Status, guard},
};

/// What becomes of what is outside the box and the view.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub enum Outside {
    /// It is not drawn.
    Drop = 0,
    /// It is drawn at its coarsest, without a crack in between.
    Coarsest = 1,
}

/// Why a cut is not finer.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub enum Limiter {
    /// It is as fine as was asked for.
    Tolerance = 0,
    /// The file has nothing finer.
    Finest = 1,
    /// The budget of triangles.
    Triangles = 2,
    /// The budget of nodes.
    Nodes = 3,
    /// The budget of bytes.
    Bytes = 4,
}

/// A camera. What it does not show is outside.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Where it stands.
    pub position: [f64; 3],
    /// Where it looks: a direction of any length but zero.
    pub forward: [f64; 3],
    /// What is up in the picture; it need not be perpendicular to `forward`.
    pub up: [f64; 3],
    /// Full angle between the picture's upper and lower border, radians.
    pub vertical_fov: f64,
    /// Depth of the near plane, above zero.
    pub near_plane: f64,
    /// The error to reach in the picture, pixels.
    pub pixel_tolerance: f64,
    /// Width of the picture in pixels.
    pub width: u32,
    /// Height of the picture in pixels.
    pub height: u32,
}

/// What to draw, and how finely. lodpack_query_default() fills all of it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Query {
    /// The error to reach, in units of the file's coordinates. By default 0: as fine as possible. With a view its own
    /// tolerance counts.
    pub tolerance: f64,
    /// The box's smallest coordinates; by default minus infinity.
    pub box_low: [f64; 3],
    /// The box's largest coordinates; by default infinity. Every root whose box touches this one is drawn whole.
    pub box_high: [f64; 3],
    /// A camera, or null: by default everything is in sight.
    pub view: *const View,
    /// The most triangles; by default UINT64_MAX. The cut is one that the file holds: a mixture of levels, often well
    /// below.
    pub max_triangles: u64,
    /// The most nodes (roots at a level each); by default UINT64_MAX.
    pub max_nodes: u64,
    /// The most bytes of pages to read; by default UINT64_MAX.
    pub max_bytes: u64,
    /// A lodpack_outside; by default LODPACK_OUTSIDE_DROP.
    pub outside: i32,
    /// Which objects are drawn: a filter of lodpack_hide_objects() or lodpack_show_only(), or null, by default, for
    /// all. Budgets then count whole roots.
    pub objects: *const ObjectFilter,
}

/// What is known of a cut before anything is decoded.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct CutInfo {
    /// Bound of the two-sided distance to the input, of what is inside the box and the view.
    pub error: f64,
    /// The same of everything that is drawn.
    pub error_everywhere: f64,
    /// The largest error in the view, pixels; 0 without a view.
    pub pixel_error: f64,
    /// Exact number of triangles of the mesh; of heights without those that close the lines between tiles.
    pub triangle_count: u64,
    /// Number of nodes: roots at a level each; of heights tiles.
    pub node_count: u64,
    /// A lodpack_limiter: why it is not finer.
    pub limited_by: i32,
}

/// A level for each root that is drawn; of heights a resolution for each tile.
pub enum Cut {
    Mesh(lodpack::Cut),
    Heights(HeightsCut),
}

/// A view from the origin along the negative z axis: 60 degrees, 1920 x 1080, one pixel.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_view_default() -> View {
    let view = lodpack::View::default();
    View {
        position: view.position,
        forward: view.forward,
        up: view.up,
        vertical_fov: view.vertical_fov,
        near_plane: view.near,
        pixel_tolerance: view.pixel_tolerance,
        width: view.viewport[0],
        height: view.viewport[1],
    }
}

/// A query for everything at the finest level.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_query_default() -> Query {
    Query {
        tolerance: 0.0,
        box_low: [f64::NEG_INFINITY; 3],
        box_high: [f64::INFINITY; 3],
        view: std::ptr::null(),
        max_triangles: u64::MAX,
        max_nodes: u64::MAX,
        max_bytes: u64::MAX,
        outside: Outside::Drop as i32,
        objects: std::ptr::null(),
    }
}

/// Finds the coarsest cut within the tolerance that keeps every budget. Reads the index where the query needs it, and
/// no surface. A box beside the surface gives an empty cut.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_select(file: *const File, query: *const Query, cut: *mut *mut Cut) -> Status {
    guard(|| {
        write(cut, std::ptr::null_mut(), "cut")?;
        let file = borrow(file, "file")?;
        let query = checked(borrow(query, "query")?)?;
        give(cut, Cut::Mesh(file.mesh()?.select(&query).map_err(|error| file.blame(error))?))
    })
}

pub fn checked(query: &Query) -> Result<lodpack::Query, Failure> {
    let everywhere = lodpack_query_default();
    let is_limited = query.box_low != everywhere.box_low || query.box_high != everywhere.box_high;
    let view = match query.view.is_null() {
        true => None,
        false => Some(borrow(query.view, "query->view")?),
    };
    let budget = |most: u64| (most != u64::MAX).then_some(most);
    Ok(lodpack::Query {
        volume: is_limited.then(|| [query.box_low, query.box_high].into()),
        view: view.map(|view| lodpack::View {
            position: view.position,
            forward: view.forward,
            up: view.up,
            viewport: [view.width, view.height],
            vertical_fov: view.vertical_fov,
            near: view.near_plane,
            pixel_tolerance: view.pixel_tolerance,
            ..lodpack::View::default()
        }),
        outside: match query.outside {
            drop if drop == Outside::Drop as i32 => lodpack::Outside::Drop,
            coarsest if coarsest == Outside::Coarsest as i32 => lodpack::Outside::Coarsest,
            other => return Err(Failure::argument(format!("query->outside is {other}, which is no lodpack_outside"))),
        },
        // Without a tolerance the reader need not look for the coarsest.
        tolerance: (view.is_none() && query.tolerance != 0.0).then_some(query.tolerance),
        max_triangles: budget(query.max_triangles),
        max_nodes: budget(query.max_nodes),
        max_bytes: budget(query.max_bytes),
        objects: match query.objects.is_null() {
            true => None,
            false => Some(Arc::clone(&borrow(query.objects, "query->objects")?.0)),
        },
    })
}

/// The limiter in C.
pub fn limiter(limiter: lodpack::Limiter) -> Limiter {
    match limiter {
        lodpack::Limiter::Tolerance => Limiter::Tolerance,
        lodpack::Limiter::Finest => Limiter::Finest,
        lodpack::Limiter::Triangles => Limiter::Triangles,
        lodpack::Limiter::Nodes => Limiter::Nodes,
        _ => Limiter::Bytes,
    }
}

/// Writes what is known of a cut.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_cut_info(cut: *const Cut, info: *mut CutInfo) -> Status {
    guard(|| {
        let value = match borrow(cut, "cut")? {
            Cut::Mesh(cut) => CutInfo {
                error: cut.error,
                error_everywhere: cut.error_everywhere(),
                pixel_error: cut.pixel_error,
                triangle_count: cut.triangle_count,
                node_count: cut.nodes.len() as u64,
                limited_by: limiter(cut.limited_by) as i32,
            },
            Cut::Heights(cut) => CutInfo {
                error: cut.error,
                error_everywhere: cut.error,
                pixel_error: 0.0,
                triangle_count: cut.triangle_count,
                node_count: cut.tiles.len() as u64,
                limited_by: limiter(cut.limiter) as i32,
            },
        };
        write(info, value, "info")
    })
}

/// Frees a cut.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_free_cut(cut: *mut Cut) {
    release(cut);
}
