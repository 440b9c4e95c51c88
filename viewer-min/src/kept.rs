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

#[cfg(test)]
mod tests {
    use lodpack::{View, stream::Mode};

    use crate::{
        args::Way,
        camera::whole,
        draw::Renderer,
        gpu::{Gpu, Targets},
        scene::{Scene, open_source},
    };

    #[test]
    fn a_picture_that_stays_uploads_nothing_and_what_comes_back_little() {
        let Ok(gpu) = Gpu::headless() else {
            assert!(std::env::var_os("LODPACK_REQUIRE_GPU").is_none_or(|value| value != "1"), "no graphics adapter");
            return;
        };
        let gpu = std::sync::Arc::new(gpu);
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../format-spec/vectors/tree.lodpack");
        let mut scene = Scene::open(open_source(path).unwrap(), Mode::Synchronous).unwrap();
        let (targets, mut renderer) = (Targets::new(&gpu, [64; 2]), Renderer::new(&gpu, Way::Stitched));
        let mut upload = |pixel_tolerance: f64| {
            let view = View { pixel_tolerance, viewport: [64; 2], ..whole(scene.bounds, [0.0, 1.0, 0.0], 1.0) };
            scene.follow_to_the_end(&view).unwrap();
            let before = gpu.uploaded();
            renderer.update(scene.picture());
            renderer.draw(&targets, &view);
            (gpu.uploaded() - before, renderer.picture(&targets, &view).unwrap())
        };
        let (first, picture) = upload(1e-3);
        assert_eq!(upload(1e-3).0, 0);
        upload(1e4);
        let (again, same) = upload(1e-3);
        assert!(again * 2 < first, "{first} bytes, and then {again}");
        assert!(picture == same);
    }
}
