//! Decoded images: each is decoded when it is first used, and forgotten when others need its memory.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use super::meaning::{Meaning, TextureError};
use super::texels::Place;
use super::texture::Texture;
use lodpack_mesh::images::{ImageSource, unreadable};
use lodpack_runtime::storage::WorkError;

/// Images as textures. Each can be there several times, by how it is meant.
pub(super) struct TextureCache<'a> {
    images: &'a [ImageSource],
    folder: Option<&'a Path>,
    note: &'a (dyn Fn(&str) + Sync),
    memory: u64,
    place: Place,
    /// Why a file for texels cannot be used, the first time that this happens.
    failure: Mutex<Option<WorkError>>,
    slots: Vec<Mutex<Slot>>,
    /// The images of which was said that they cannot be used: each may be there several times.
    noted: Mutex<BTreeSet<usize>>,
    usage: Mutex<Usage>,
}

enum Slot {
    Absent,
    Damaged,
    Loaded(Arc<Texture>),
}

/// The textures that are loaded.
#[derive(Default)]
struct Usage {
    /// Their keys and bytes, the one that was used last at the end.
    order: Vec<(usize, u64)>,
    bytes: u64,
}

impl<'a> TextureCache<'a> {
    pub(super) fn new(
        images: &'a [ImageSource],
        folder: Option<&'a Path>,
        scratch: &Path,
        memory: u64,
        note: &'a (dyn Fn(&str) + Sync),
    ) -> Self {
        let slots = (0..Meaning::COUNT * images.len()).map(|_| Mutex::new(Slot::Absent)).collect();
        let place = Place::new(scratch, memory / 2);
        Self {
            images,
            folder,
            note,
            memory,
            place,
            failure: Mutex::default(),
            slots,
            noted: Mutex::default(),
            usage: Mutex::default(),
        }
    }

    /// The texture of a key ([`Meaning::key`]). None if the image cannot be decoded.
    pub(super) fn get(&self, key: usize) -> Option<Arc<Texture>> {
        // Whoever comes while an image is decoded waits for it. Nothing is locked beside the slot meanwhile.
        let texture = {
            let mut slot = self.slots.get(key)?.lock().unwrap_or_else(PoisonError::into_inner);
            match &*slot {
                Slot::Loaded(texture) => texture.clone(),
                Slot::Damaged => return None,
                Slot::Absent => {
                    let texture = self.decode(key).map(Arc::new);
                    *slot = texture.as_ref().map_or(Slot::Damaged, |texture| Slot::Loaded(texture.clone()));
                    texture?
                }
            }
        };
        for forgotten in self.use_now(key, texture.bytes()) {
            let mut slot = self.slots[forgotten].lock().unwrap_or_else(PoisonError::into_inner);
            if let Slot::Loaded(_) = &*slot {
                *slot = Slot::Absent;
            }
        }
        Some(texture)
    }

    /// Why textures are missing that could be there: a file for their texels cannot be used. What is made after that is
    /// of no use.
    pub(super) fn failure(&self) -> Option<WorkError> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn decode(&self, key: usize) -> Option<Texture> {
        let number = key / Meaning::COUNT;
        let image = self.images.get(number)?;
        let opened = image.open(self.folder).map_err(|error| TextureError::Image(unreadable(&error)));
        let texture = opened.and_then(|encoded| Texture::decode(encoded, Meaning::of_key(key), &self.place));
        match texture {
            Ok(texture) => return Some(texture),
            Err(TextureError::Image(problem)) => {
                if self.noted.lock().unwrap_or_else(PoisonError::into_inner).insert(number) {
                    let name = image.name();
                    (self.note)(&format!("the image {name} cannot be used: {problem}; its material has no texture"));
                }
            }
            Err(TextureError::File(error)) => {
                self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            }
        }
        None
    }

    /// Notes that a texture is used, and returns those to forget.
    fn use_now(&self, key: usize, bytes: u64) -> Vec<usize> {
        let mut usage = self.usage.lock().unwrap_or_else(PoisonError::into_inner);
        let known = usage.order.iter().position(|(known, _)| *known == key);
        match known {
            Some(at) => usage.order[at..].rotate_left(1),
            None => {
                usage.order.push((key, bytes));
                usage.bytes += bytes;
            }
        }
        let mut forgotten = vec![];
        while usage.bytes > self.memory && usage.order.len() > 1 {
            let (key, bytes) = usage.order.remove(0);
            usage.bytes -= bytes;
            forgotten.push(key);
        }
        forgotten
    }
}
