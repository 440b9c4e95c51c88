//! What a loader asks others to do: reads, and decoding, which is pure.

use std::{fmt, io, sync::Arc};

use super::queue::{Class, Place};
use crate::{error::Result, source::ReadAt};

/// What can be loaded. The machinery of loading knows nothing else of the format.
pub(crate) trait Pages {
    /// Names a page. Pages of one priority are read and decoded in this order.
    type Unit: Copy + Ord + fmt::Debug;
    /// A page decoded.
    type Data;

    /// Where its bytes are; a page without bytes is never read.
    fn place(&self, unit: Self::Unit) -> Place;

    /// Whether these bytes are the page's.
    fn is_sound(&self, unit: Self::Unit, bytes: &[u8]) -> bool;

    /// Visits the pages that have to be decoded before, in the order in which [`Pages::decode`] wants them.
    fn prerequisites(&self, unit: Self::Unit, visit: &mut dyn FnMut(Self::Unit));

    /// Whether it is kept for good once it is there.
    fn is_pinned(&self, unit: Self::Unit) -> bool;

    /// Decodes a page. A pure function.
    fn decode(&self, unit: Self::Unit, bytes: &[u8], before: &[Arc<Self::Data>]) -> Result<Self::Data>;

    /// Memory that decoded data takes.
    fn byte_count(&self, data: &Self::Data) -> u64;

    /// What to call it in messages.
    fn name(&self, unit: Self::Unit) -> String;
}

/// A read that a session asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    /// Which one; [`crate::session::Session::supply`] wants it back.
    pub id: u64,
    /// Where it begins, from the start of the file.
    pub offset: u64,
    /// How many bytes; above zero.
    pub length: u64,
    /// Why.
    pub class: Class,
}

impl Read {
    /// Does it.
    ///
    /// # Errors
    /// What the source says.
    pub fn run(&self, source: &impl ReadAt) -> io::Result<Vec<u8>> {
        let length = usize::try_from(self.length).map_err(|_| io::ErrorKind::OutOfMemory)?;
        let mut bytes = vec![0; length];
        source.read_at(self.offset, &mut bytes)?;
        Ok(bytes)
    }
}

/// A page to be decoded, with all that it takes.
pub(crate) struct Task<P: Pages> {
    pub pages: Arc<P>,
    pub unit: P::Unit,
    pub bytes: Arc<[u8]>,
    pub before: Vec<Arc<P::Data>>,
}

impl<P: Pages> Task<P> {
    pub fn run(self) -> Outcome<P> {
        let result = self.pages.decode(self.unit, &self.bytes, &self.before);
        Outcome { unit: self.unit, result: result.map(Arc::new) }
    }
}

/// What became of a [`Task`].
pub(crate) struct Outcome<P: Pages> {
    pub unit: P::Unit,
    pub result: Result<Arc<P::Data>>,
}

/// What a loader wants to be done next.
pub(crate) enum Job<P: Pages> {
    Read(Read),
    Decode(Task<P>),
}
