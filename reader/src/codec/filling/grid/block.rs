//! The grid filling's side of the interface of fillings: a block is decoded at once.

use super::{GridLimits, GridSides, GridState, decode_level};
use crate::{
    codec::{
        entropy::Decoder,
        filling::{self, BlockTask, LANES},
        patch::Patch,
    },
    error::Result,
    sorted::SortedMap,
};

/// The grids so far, by root, and the patches that wait to be taken.
#[derive(Debug, Default)]
pub(super) struct BlockDecoder {
    grids: SortedMap<u32, GridState>,
    patches: [Option<Patch>; LANES],
}

impl filling::BlockDecoder for BlockDecoder {
    fn begin(&mut self, lane: usize, task: &BlockTask<'_>, symbols: &mut Decoder<'_>) -> Result<bool> {
        let sides = GridSides { sides: task.border.sides()? };
        let limits = GridLimits { vertex_count: task.vertex_limit };
        let coarser = self.grids.remove(&task.root);
        let state = decode_level(symbols, coarser, &sides, task.quantisation, limits)?;
        if task.is_wanted {
            self.patches[lane] = Some(state.patch(&sides)?);
        }
        self.grids.insert(task.root, state);
        Ok(false)
    }

    fn take_patch(&mut self, lane: usize) -> Option<Patch> {
        self.patches[lane].take()
    }

    fn forget_roots(&mut self) {
        self.grids.clear();
    }
}
