//! Surfaces that have left the picture and stay on the device, since cameras come back (Niski 2007, section 6.1.2).

use std::{
    collections::{BTreeMap, HashMap},
    sync::{Arc, Weak},
};

use lodpack::stream::DrawnSurface;

use crate::pool::{Place, Pool};

/// They take so many bytes at most; then the one that left first goes.
const MOST_BYTES: u64 = 128 << 20;

/// The places of surfaces that are not drawn.
#[derive(Default)]
pub(crate) struct Kept {
    /// By root and level, with the number of their leaving.
    places: HashMap<(u32, u8), (u64, Weak<DrawnSurface>, Place)>,
    /// Their keys by these numbers.
    order: BTreeMap<u64, (u32, u8)>,
    bytes: u64,
    count: u64,
}

fn key(surface: &DrawnSurface) -> (u32, u8) {
    (surface.root, surface.level)
}

impl Kept {
    /// Keeps the place of a surface.
    pub fn keep(&mut self, surface: &Weak<DrawnSurface>, place: Place, pool: &mut Pool) {
        // What was decoded again has another place.
        let Some(alive) = surface.upgrade() else { return pool.free(place) };
        self.remove(key(&alive), pool);
        self.count += 1;
        self.bytes += place.bytes();
        self.order.insert(self.count, key(&alive));
        self.places.insert(key(&alive), (self.count, surface.clone(), place));
        while self.bytes > MOST_BYTES
            && let Some((_, &first)) = self.order.first_key_value()
        {
            self.remove(first, pool);
        }
    }

    /// The place of a surface that is drawn again.
    pub fn take(&mut self, surface: &Arc<DrawnSurface>, pool: &mut Pool) -> Option<Place> {
        let (of, place) = self.forget(key(surface))?;
        if of.as_ptr() == Arc::as_ptr(surface) {
            return Some(place);
        }
        pool.free(place);
        None
    }

    fn forget(&mut self, key: (u32, u8)) -> Option<(Weak<DrawnSurface>, Place)> {
        let (number, surface, place) = self.places.remove(&key)?;
        self.order.remove(&number);
        self.bytes -= place.bytes();
        Some((surface, place))
    }

    fn remove(&mut self, key: (u32, u8), pool: &mut Pool) {
        pool.give_back(self.forget(key).map(|(_, place)| place));
    }

    /// Keeps nothing.
    pub fn clear(&mut self, pool: &mut Pool) {
        std::mem::take(self).places.into_values().for_each(|(_, _, place)| pool.free(place));
    }
}
