//! Reduced cuts: one surface with a stated number of triangles, made from a finer one, with what it looks like.
//!
//! The tops of groups, the overview of a file and what `lodpack extract --triangles` writes are made here. A file
//! stands above those that it uses:
//!
//! | file | what it does |
//! |---|---|
//! | `painted_cut` | 5. the nearest results get images of what the cut shows, and the one that shows most at its distance is taken |
//! | `colour_weights` | 4. the surface is collapsed again, with more weight where the last result shows wrong colours |
//! | `moved_singly` | with few triangles left, vertices move one at a time as long as more is shown |
//! | `watched` | what a patch shows while vertices move: only points around them are looked at again |
//! | `grouped` | points of the surface in groups, which are looked at together |
//! | `cut_areas` | 3. the areas of the cut between which its colours jump, found in its images |
//! | `shown_colours` | the colours of the cut at its points |
//! | `cells` | what a patch shows of coloured points, compared without images |
//! | `finish` | 1. a cut of a file that has enough triangles is chosen, and made one surface near the origin |
//! | `ways` | 2. the surface is reduced in several ways, and the nearest result is taken |
//! | `other_topology` | handles are closed and parts merged where no collapse reaches the number |
//! | `far_weights` | weights for another collapse: more where the last one was farthest off |
//! | `moved_nearer` | all vertices move so that the squares of distances are least |
//! | `spread_points` | points spread by area, at which surfaces are compared |
//! | `collapsed` | edge collapse of a whole surface |
//! | `surface` | the surface with its error; joined from several, without cracks |
//! | `manifold` | a surface as a manifold with simple boundaries |
//!
//! The numbers are the order in which a cut with colours takes these steps; without colours it takes the first two.

mod cells;
mod collapsed;
mod colour_weights;
mod cut_areas;
mod far_weights;
mod finish;
mod grouped;
mod manifold;
mod moved_nearer;
mod moved_singly;
mod other_topology;
mod painted_cut;
mod shown_colours;
mod spread_points;
mod surface;
mod watched;
mod ways;

pub(crate) use collapsed::collapsed;
pub use finish::{Finished, cut_to_finish, finish, is_nearer};
#[cfg(test)]
pub(crate) use manifold::open_edges;
pub(crate) use manifold::{boundary_loops, manifold};
pub(crate) use other_topology::clustered;
pub use painted_cut::{CutPainter, Detail};
pub(crate) use spread_points::weights_of;
pub(crate) use surface::{CoarseSurface, error_sum, filled};
pub use ways::Topology;
pub(crate) use ways::{Ways, reduce};
