//! The coders that walk along an arc with symbols.

use super::{ArcSample, Coder, forecast::Forecast};
use crate::{
    codec::entropy::{SymbolBuffer, SymbolSource, context::Context},
    error::Violation,
};

/// Writes known residuals.
pub(super) struct Encoder<'a> {
    pub samples: &'a [ArcSample],
    pub symbols: &'a mut SymbolBuffer,
    /// The number of samples still to come.
    pub left: usize,
}

impl Coder for Encoder<'_> {
    fn left(&self) -> usize {
        self.left
    }

    fn split(&mut self, context: Context, param: u32, level: u8) -> Result<bool, Violation> {
        if self.left == 0 {
            return Ok(false);
        }
        let found = self.samples.binary_search_by_key(&param, |sample| sample.param);
        let split = found.is_ok_and(|index| self.samples[index].level == level);
        self.symbols.put(context, u64::from(split));
        self.left -= usize::from(split);
        Ok(split)
    }

    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let found = self.samples.binary_search_by_key(&forecast.param, |sample| sample.param);
        let index = found.map_err(|_| Violation(&"an arc lacks a sample"))?;
        let residual = self.samples[index].residual;
        for (context, steps) in forecast.contexts(residual[0]).into_iter().zip(residual) {
            self.symbols.put_signed(context, steps);
        }
        Ok(residual)
    }
}

/// Reads residuals.
pub(super) struct Decoder<'a, S> {
    pub symbols: &'a mut S,
    /// The number of samples still to come.
    pub left: u32,
}

impl<S: SymbolSource> Coder for Decoder<'_, S> {
    fn left(&self) -> usize {
        self.left as usize
    }

    fn split(&mut self, context: Context, _param: u32, _level: u8) -> Result<bool, Violation> {
        if self.left == 0 {
            return Ok(false);
        }
        match self.symbols.get(context)? {
            0 => Ok(false),
            1 => {
                self.left -= 1;
                Ok(true)
            }
            _ => Err(Violation(&"an arc's split flag is above 1")),
        }
    }

    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let first = self.symbols.get_signed(forecast.contexts(0)[0])?;
        let contexts = forecast.contexts(first);
        Ok([first, self.symbols.get_signed(contexts[1])?, self.symbols.get_signed(contexts[2])?])
    }
}

/// A decoded sample without its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Split {
    param: u32,
    residual: [i64; 3],
}

/// Reads residuals and records them.
pub(super) struct Recorder<'a, S> {
    pub decoder: Decoder<'a, S>,
    pub splits: &'a mut Vec<Split>,
}

impl<S: SymbolSource> Coder for Recorder<'_, S> {
    fn left(&self) -> usize {
        self.decoder.left()
    }

    fn split(&mut self, context: Context, param: u32, level: u8) -> Result<bool, Violation> {
        self.decoder.split(context, param, level)
    }

    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let residual = self.decoder.residual(forecast)?;
        self.splits.push(Split { param: forecast.param, residual });
        Ok(residual)
    }
}

/// Repeats recorded residuals.
pub(super) struct Repeater<'a> {
    pub splits: &'a [Split],
}

impl Coder for Repeater<'_> {
    fn left(&self) -> usize {
        self.splits.len()
    }

    fn split(&mut self, _context: Context, param: u32, _level: u8) -> Result<bool, Violation> {
        Ok(self.splits.first().is_some_and(|split| split.param == param))
    }

    fn residual(&mut self, _forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let Some((split, rest)) = self.splits.split_first() else {
            return Err(Violation(&"an arc has fewer samples than the index says"));
        };
        self.splits = rest;
        Ok(split.residual)
    }
}
