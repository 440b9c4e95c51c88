//! One budget of triangles for several streams that are drawn into one picture.
#![expect(unsafe_code, reason = "the names are C's")]

use lodpack::select::{SharedBudget, Taken};

use crate::{
    pointer::{borrow_mut, copy_rows, give, release, slice, write},
    query::Limiter,
    status::{Status, guard},
    stream::Frame,
};

/// What several streams share: a mesh, the ground that it stands on, and other files in the same picture.
pub struct Budget(SharedBudget);

/// Makes a budget that streams share from frame to frame.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_budget(budget: *mut *mut Budget) -> Status {
    guard(|| give(budget, Budget(SharedBudget::default())))
}

/// Writes what each of `count` streams may take in the next frame, for `max_triangles` of all of them together and the
/// tolerance that is worth having, in pixels: a tolerance for the views of all of them, and a number for the
/// `max_triangles` of each one's query. Together these numbers are the budget, in every frame; which one gets how much
/// follows from what was recorded, so that all have about the same error after a few frames.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_share_budget(
    budget: *mut Budget,
    max_triangles: u64,
    pixel_tolerance: f64,
    shared_tolerance: *mut f64,
    shares: *mut u64,
    count: usize,
) -> Status {
    guard(|| {
        let found = borrow_mut(budget, "budget")?.0.limits(max_triangles, pixel_tolerance, count);
        write(shared_tolerance, found.tolerance, "shared_tolerance")?;
        copy_rows(found.budgets.iter().map(|&share| [share]), shares, count, 0)
    })
}

/// Records the frames of all streams, in the order of the shares.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_record_frames(budget: *mut Budget, frames: *const Frame, count: usize) -> Status {
    guard(|| {
        let taken = |frame: &Frame| Taken {
            triangles: frame.wanted_triangle_count,
            is_limited: frame.limited_by == Limiter::Triangles as i32,
        };
        let taken: Vec<Taken> = slice(frames, count, "frames")?.iter().map(taken).collect();
        borrow_mut(budget, "budget")?.0.record(&taken);
        Ok(())
    })
}

/// Ends a budget.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_close_budget(budget: *mut Budget) {
    release(budget);
}
