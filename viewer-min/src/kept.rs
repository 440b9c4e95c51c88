//! Surfaces that have left the picture and stay on the device, since cameras come back (Niski 2007, section 6.1.2).

use std::{
    collections::{HashMap, VecDeque},
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
    order: VecDeque<(u64, (u32, u8))>,
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
        self.bytes += place.bytes();
        self.count += 1;
        self.order.push_back((self.count, key(&alive)));
        if let Some((_, _, before)) = self.places.insert(key(&alive), (self.count, surface.clone(), place)) {
            self.release(before, pool);
        }
        while self.bytes > MOST_BYTES
            && let Some((number, key)) = self.order.pop_front()
        {
            if self.places.get(&key).is_some_and(|kept| kept.0 == number)
                && let Some((_, _, place)) = self.places.remove(&key)
            {
                self.release(place, pool);
            }
        }
    }

    /// The place of a surface that is drawn again.
    pub fn take(&mut self, surface: &Arc<DrawnSurface>, pool: &mut Pool) -> Option<Place> {
        let (_, of, place) = self.places.remove(&key(surface))?;
        if of.as_ptr() == Arc::as_ptr(surface) {
            self.bytes -= place.bytes();
            return Some(place);
        }
        self.release(place, pool);
        None
    }

    fn release(&mut self, place: Place, pool: &mut Pool) {
        self.bytes -= place.bytes();
        pool.free(place);
    }

    /// Keeps nothing.
    pub fn clear(&mut self, pool: &mut Pool) {
        std::mem::take(self).places.into_values().for_each(|(_, _, place)| pool.free(place));
    }
}
