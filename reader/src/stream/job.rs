//! What a loader asks others to do: reads, and decoding, which is pure.

use std::{fmt, io, sync::Arc};

use super::queue::{ByteSpan, Class};
use crate::{error::Result, source::ReadAt};

/// What can be loaded. The machinery of loading knows nothing else of the format.
pub(crate) trait Content {
    /// Names bytes that are read and checked together.
    type Page: Copy + Ord + fmt::Debug;
    /// Names what is decoded at once, from one or more pages. Units of one priority are decoded in this order.
    type Unit: Copy + Ord + fmt::Debug;
    /// A decoded unit.
    type Data;

    /// The pages that a unit is decoded from, each once and none without bytes; other units may need some of them too.
    fn pages(&self, unit: Self::Unit) -> Result<Vec<Self::Page>>;

    /// Where a page is.
    fn span(&self, page: Self::Page) -> ByteSpan;

    /// Whether these bytes are the page's.
    fn is_sound(&self, page: Self::Page, bytes: &[u8]) -> bool;

    /// Whether a unit is kept for good once it is there.
    fn is_pinned(&self, unit: Self::Unit) -> bool;

    /// Decodes a unit from its pages. A pure function.
    fn decode(&self, unit: Self::Unit, pages: &[(Self::Page, Arc<[u8]>)]) -> Result<Self::Data>;

    /// Memory that decoded data takes.
    fn byte_count(&self, data: &Self::Data) -> u64;

    /// What to call a page in messages.
    fn page_name(&self, page: Self::Page) -> String;

    /// What to call a unit in messages.
    fn unit_name(&self, unit: Self::Unit) -> String;
}

/// A read that a session asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    /// Which one; [`crate::stream::Session::supply`] wants it back.
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
    pub fn run(&self, source: &(impl ReadAt + ?Sized)) -> io::Result<Vec<u8>> {
        let length = usize::try_from(self.length).map_err(|_| io::ErrorKind::OutOfMemory)?;
        let mut bytes = vec![0; length];
        source.read_at(self.offset, &mut bytes)?;
        Ok(bytes)
    }
}

/// A unit to be decoded, with all that it takes.
pub(crate) struct Task<C: Content> {
    pub content: Arc<C>,
    pub unit: C::Unit,
    pub pages: Vec<(C::Page, Arc<[u8]>)>,
}

impl<C: Content> Task<C> {
    pub fn run(self) -> Outcome<C> {
        let result = self.content.decode(self.unit, &self.pages);
        Outcome { unit: self.unit, result: result.map(Arc::new) }
    }
}

/// What became of a [`Task`].
pub(crate) struct Outcome<C: Content> {
    pub unit: C::Unit,
    pub result: Result<Arc<C::Data>>,
}

/// What a loader wants to be done next.
pub(crate) enum Job<C: Content> {
    Read(Read),
    Decode(Task<C>),
}
