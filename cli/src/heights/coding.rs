//! Blocks and the file.

use std::io::Write;
use std::path::Path;
use std::sync::Mutex;

use lodpack::heights::{Grid, TileId, TileValues};

use super::HeightsError;
use super::above::is_below;
use super::samples::Scale;
use super::tile::Setting;
use super::unit::Finished;
use crate::import::raster::HeightSource;

#[derive(Clone)]
pub struct TileSymbols(Vec<i32>);

pub fn symbols_of(_grid: &Grid, _id: TileId, _above: Option<&TileValues>, values: &TileValues) -> TileSymbols {
    TileSymbols(values.steps.to_vec())
}

pub struct Coder;

impl Coder {
    pub fn new(_symbols: &[TileSymbols]) -> Result<Self, lodpack::Error> {
        Ok(Self)
    }

    pub fn encode(&self, symbols: &TileSymbols) -> Result<Vec<u8>, lodpack::Error> {
        Ok(vec![0; symbols.0.len() / 3])
    }
}

pub struct Spill {
    all: Mutex<Vec<Finished>>,
}

pub struct Written {
    pub tiles: u64,
    pub triangles: u64,
    pub error: f64,
    pub bytes: u64,
}

impl Spill {
    pub fn new(_folder: &Path) -> Result<Self, HeightsError> {
        Ok(Self { all: Mutex::default() })
    }

    pub fn put(&self, finished: Vec<Finished>) -> Result<(), HeightsError> {
        self.all.lock().unwrap().extend(finished);
        Ok(())
    }

    pub fn forget_below(&self, id: TileId) {
        self.all.lock().unwrap().retain(|tile| !is_below(tile.id, id));
    }

    pub fn write(
        self,
        _source: &HeightSource,
        _setting: &Setting<'_>,
        _scale: Scale,
        _range: [i32; 2],
        _coder: Coder,
        _out: &mut impl Write,
    ) -> Result<Written, HeightsError> {
        let all = self.all.into_inner().unwrap();
        let leaves = all.iter().filter(|tile| tile.children == 0);
        let finest = leaves.filter_map(|tile| tile.resolutions.first());
        for depth in 0..20 {
            let of = all.iter().filter(|tile| tile.id.depth == depth);
            let (mut count, mut t, mut e) = (0, [0; 4], [0.0f64; 4]);
            for tile in of {
                count += 1;
                for (k, r) in tile.resolutions.iter().enumerate() {
                    t[k] += r.triangles;
                    e[k] = e[k].max(r.error);
                }
            }
            if count > 0 {
                println!("{depth} {count} {t:?} {e:?}");
            }
        }
        let (triangles, error) = finest.fold((0, 0.0f64), |(t, e), r| (t + u64::from(r.triangles), e.max(r.error)));
        Ok(Written { tiles: all.len() as u64, triangles, error, bytes: 0 })
    }
}
