//! How the library reports its progress without knowing who listens.

use std::collections::BTreeMap;
use std::sync::Mutex;

/// Receives the course of a build. All methods may be called from any thread.
pub trait Progress: Sync {
    /// A stage begins. `total` is its amount of work in units of its own choice, 0 when it is unknown.
    fn begin(&self, stage: &'static str, total: u64);
    /// More of the current stage's work is done.
    fn advance(&self, amount: u64);
    /// An earlier process has already done this much of the current stage's work, so it says nothing about the speed of
    /// this one.
    fn skip(&self, amount: u64) {
        self.advance(amount);
    }
    /// Something that the user should know and that is not an error.
    fn note(&self, message: &str);
}

/// Hands everything on, but of each kind of note only the first few; when it is dropped, it says how many more there
/// were. A file with an image that is missing can have many thousands of them.
pub struct FewNotes<'a> {
    inner: &'a dyn Progress,
    kinds: Mutex<BTreeMap<String, u64>>,
}

/// Notes of a kind that are handed on.
const FEW: u64 = 5;

impl<'a> FewNotes<'a> {
    /// In front of another listener.
    pub fn new(inner: &'a dyn Progress) -> Self {
        Self { inner, kinds: Mutex::default() }
    }
}

impl Progress for FewNotes<'_> {
    fn begin(&self, stage: &'static str, total: u64) {
        self.inner.begin(stage, total);
    }

    fn advance(&self, amount: u64) {
        self.inner.advance(amount);
    }

    fn skip(&self, amount: u64) {
        self.inner.skip(amount);
    }

    fn note(&self, message: &str) {
        let is_few = match self.kinds.lock() {
            Ok(mut kinds) => {
                let count = kinds.entry(kind_of(message)).or_default();
                *count += 1;
                *count <= FEW
            }
            Err(_) => true,
        };
        if is_few {
            self.inner.note(message);
        }
    }
}

impl Drop for FewNotes<'_> {
    fn drop(&mut self) {
        let kinds = self.kinds.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
        for (kind, count) in kinds.iter().filter(|(_, count)| **count > FEW) {
            self.inner.note(&format!("{} more notes like those that say: {kind}", *count - FEW));
        }
    }
}

/// What notes of a kind have in common: how they begin, behind the name of a file, and how they end. Names and numbers
/// stand between.
fn kind_of(message: &str) -> String {
    let said = message.split_once(": ").map_or(message, |(_, said)| said);
    let words: Vec<&str> = said.split_whitespace().collect();
    match words.len() {
        0..=6 => said.to_owned(),
        count => format!("{} ... {}", words[..2].join(" "), words[count - 4..].join(" ")),
    }
}

/// Ignores all progress.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _amount: u64) {}
    fn note(&self, _message: &str) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Heard(Mutex<Vec<String>>);

    impl Progress for Heard {
        fn begin(&self, _stage: &'static str, _total: u64) {}
        fn advance(&self, _amount: u64) {}
        fn note(&self, message: &str) {
            self.0.lock().unwrap().push(message.into());
        }
    }

    #[test]
    fn many_notes_of_a_kind_are_counted() {
        let heard = Heard::default();
        let few = FewNotes::new(&heard);
        for number in 0..50_000 {
            few.note(&format!(
                "x.glb: the image wall {number}.png cannot be used: it is not there; its material has no texture"
            ));
        }
        few.note("x.glb: something else");
        drop(few);
        let notes = heard.0.into_inner().unwrap();
        assert_eq!(notes.len(), 7, "{notes:?}");
        assert!(
            notes[5] == "x.glb: something else"
                && notes[6].starts_with("49995 more notes like those that say: the image")
        );
    }
}
