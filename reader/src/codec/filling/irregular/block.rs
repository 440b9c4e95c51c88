//! The irregular filling's side of the interface of fillings.
//!
//! Each triangle waits for the one before it: the next gate and its statistics follow from where the last vertex came
//! to lie. So the blocks of several lanes are decoded in turn, a triangle each; while one waits, the other continues.

use super::{PatchLimits, decode::PatchDecoder};
use crate::{
    codec::{
        entropy::Decoder,
        filling::{self, BlockTask, LANES, LaneSymbols},
        patch::Patch,
    },
    error::{Result, Violation},
};

/// A decoder a lane, whose memory serves one block after the other.
#[derive(Debug, Default)]
pub(super) struct BlockDecoder {
    lanes: [PatchDecoder; LANES],
}

impl filling::BlockDecoder for BlockDecoder {
    fn begin(&mut self, lane: usize, task: &BlockTask<'_>, symbols: &mut Decoder<'_>) -> Result<bool> {
        let limits = PatchLimits { vertices: task.vertex_limit, triangles: u64::from(task.triangle_count) };
        self.lanes[lane].begin(symbols, &task.border.positions(), task.quantisation, limits)?;
        Ok(true)
    }

    fn advance(&mut self, lanes: &mut [LaneSymbols<'_, '_>]) -> Result<usize, (usize, Violation)> {
        let mut busy: Vec<_> = self.lanes.iter_mut().enumerate().collect();
        busy.retain(|(lane, _)| lanes.iter().any(|other| other.lane == *lane));
        loop {
            for ((lane, decoder), LaneSymbols { symbols, .. }) in busy.iter_mut().zip(lanes.iter_mut()) {
                if !decoder.advance(*symbols).map_err(|violation| (*lane, violation))? {
                    return Ok(*lane);
                }
            }
        }
    }

    fn take_patch(&mut self, lane: usize) -> Option<Patch> {
        Some(self.lanes[lane].take_patch())
    }
}
