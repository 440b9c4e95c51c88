//! Pieces for a file with more or fewer levels: those of a part of a model do not depend on how many levels there are
//! above it, as long as the piece has nothing there but what belongs to all levels.

use super::piece::{Piece, Runs};
use crate::{
    codec::entropy::{Mark, Tally},
    error::{Error, Result},
};

/// How the levels of a piece change: all but level 0 move together, and the levels between are empty.
#[derive(Clone, Copy, Debug)]
struct Moved {
    /// The second level with anything, before and after.
    from: usize,
    to: usize,
}

impl Piece {
    /// Gives a piece that has blocks from level `from` on, and samples of arcs there and at level 0, the levels of a
    /// file in which that level is `to`.
    ///
    /// # Errors
    /// [`Error::Model`] if the piece has something at levels above, or one of the levels is 0.
    pub fn move_levels(&mut self, from: u8, to: u8) -> Result<()> {
        let Self { index, symbols } = self;
        let level_count = index.arc_tallies.len();
        let moved = Moved { from: from.into(), to: to.into() };
        if from == 0 || to == 0 || moved.from > level_count || index.block_tallies.len() != level_count {
            return Err(above_it());
        }
        if from == to {
            return Ok(());
        }
        let blocks = index.roots.iter_mut().flat_map(|root| &mut root.blocks);
        let levels = blocks.map(|block| &mut block.level).chain(&mut index.corner_levels);
        levels.into_iter().try_for_each(|level| moved.level(level))?;
        index.new_samples = moved.of_each(&index.new_samples, level_count, 0, |&count, _| count == 0)?;
        for tallies in [&mut index.arc_tallies, &mut index.block_tallies] {
            *tallies = moved.of_each(tallies, level_count, Tally::default(), |tally, _| *tally == Tally::default())?;
        }
        symbols.arcs.move_levels(moved, level_count)
    }
}

impl Runs {
    /// Moves levels where each thing has a run for each of them.
    fn move_levels(&mut self, moved: Moved, level_count: usize) -> Result<()> {
        // An empty run ends where the one before it does.
        let of_thing = |ends: &[Mark]| moved.of_each(ends, level_count, ends[0], |end, first| end == first);
        self.ends = self.ends.chunks(level_count).map(of_thing).collect::<Result<Vec<_>>>()?.concat();
        Ok(())
    }
}

impl Moved {
    fn level(self, level: &mut u8) -> Result<()> {
        let below = usize::from(*level).checked_sub(self.from);
        let moved = below.and_then(|below| u8::try_from(below + self.to).ok());
        *level = moved.ok_or_else(above_it)?;
        Ok(())
    }

    /// Moves what there is for each level of each thing. `is_empty` is asked of the levels between, with level 0 beside
    /// it.
    fn of_each<T: Clone>(
        self,
        all: &[T],
        level_count: usize,
        empty: T,
        is_empty: impl Fn(&T, &T) -> bool,
    ) -> Result<Vec<T>> {
        let mut result = Vec::with_capacity(all.len());
        for of_thing in all.chunks(level_count) {
            let (between, rest) = of_thing.split_at_checked(self.from).ok_or_else(above_it)?;
            let (first, between) = between.split_first().ok_or_else(above_it)?;
            if !between.iter().all(|level| is_empty(level, first)) {
                return Err(above_it());
            }
            result.push(first.clone());
            result.extend(std::iter::repeat_n(&empty, self.to - 1).cloned());
            result.extend_from_slice(rest);
        }
        Ok(result)
    }
}

fn above_it() -> Error {
    Error::model("a piece has something at the levels above it, so these cannot change")
}
