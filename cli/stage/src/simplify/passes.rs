//! A level in passes: each measures from the surface that the one before has left, and goes a little farther.
//!
//! What all passes together are off is not their sum: they go astray in all directions, and a level is measured anyway
//! (`certify`).

use super::collapse::Collapser;

/// Passes by sweeps, as shares of the squared distance that the level allows: what they take is still cheap.
const SWEPT: [f64; 2] = [0.2, 0.4];
/// Passes by the queue, the last of which makes the level. The last share is above 1, since what has been passed counts
/// no more.
const QUEUED: [f64; 4] = [0.6, 0.8, 1.0, 1.1];
/// After a pass that takes fewer triangles than one in this many, others like it are left out: parts that can hardly be
/// simplified would take their time for nothing.
const FEW: usize = 100;

impl Collapser<'_> {
    /// Begins a level, with all but its last pass done. `threshold` is a squared distance.
    pub fn approach(&mut self, level: u8, threshold: f64) {
        if threshold == f64::INFINITY {
            self.thin(level);
            self.begin_level(level, threshold);
        } else if threshold > 0.0 {
            for share in SWEPT {
                self.renew_planes();
                self.sweep(1, share * threshold);
            }
            let [first @ .., last] = QUEUED;
            for share in first {
                let before = self.mesh.triangle_count();
                self.renew_planes();
                self.begin_level(level, share * threshold);
                self.drain();
                if self.took_few(before) {
                    break;
                }
            }
            self.renew_planes();
            self.begin_level(level, last * threshold);
        } else {
            self.begin_level(level, threshold);
        }
    }

    /// Whether a pass took few triangles, which begins with some.
    pub(super) fn took_few(&self, before: usize) -> bool {
        before - self.mesh.triangle_count() < before / FEW
    }

    /// The passes of a level that only a number of triangles ends.
    fn thin(&mut self, level: u8) {
        let least = self.min_triangles;
        for times in self.stops {
            self.min_triangles = (times * least as f64) as usize;
            if self.mesh.triangle_count() > self.min_triangles {
                self.begin_level(level, f64::INFINITY);
                self.drain();
                self.renew_planes();
            }
        }
        self.min_triangles = least;
    }
}
