//! The jobs of a loader: reads, and decoding, which is pure.

use std::{fmt, io, sync::Arc};

use super::queue::{ByteSpan, Class};
use crate::{error::Result, source::ReadAt};

/// Content that can be loaded. The loader knows nothing else about the format.
pub(crate) trait Content {
    /// Identifies bytes that are read and checked together.
    type Page: Copy + Ord + fmt::Debug;
    /// Identifies what is decoded at once, from one or more pages. Units of equal priority are decoded in this order.
    type Unit: Copy + Ord + fmt::Debug;
    /// A decoded unit.
    type Data;

    /// The pages that a unit is decoded from, each once and none empty. Units may share pages.
    /// [`crate::Error::Missing`] if that is not known yet.
    fn pages(&self, unit: Self::Unit) -> Result<Vec<Self::Page>>;

    /// Takes bytes of the index that [`Content::pages`] said were missing.
    fn supply(&self, offset: u64, bytes: Vec<u8>);

    /// Where a page is.
    fn span(&self, page: Self::Page) -> ByteSpan;

    /// Whether these bytes are the page's.
    fn is_sound(&self, page: Self::Page, bytes: &[u8]) -> bool;

    /// Whether a unit is never evicted.
    fn is_pinned(&self, unit: Self::Unit) -> bool;

    /// The unit from whose data this one is decoded, if there is one.
    fn base(&self, unit: Self::Unit) -> Option<Self::Unit> {
        let _ = unit;
        None
    }

    /// Decodes a unit from its pages, and from the data of its base. A pure function.
    fn decode(
        &self,
        unit: Self::Unit,
        pages: &[(Self::Page, Arc<[u8]>)],
        base: Option<&Self::Data>,
    ) -> Result<Self::Data>;

    /// Memory that decoded data takes.
    fn byte_count(&self, data: &Self::Data) -> u64;

    /// A page's name in messages.
    fn page_name(&self, page: Self::Page) -> String;

    /// A unit's name in messages.
    fn unit_name(&self, unit: Self::Unit) -> String;
}

/// A read that a session asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    /// Its number, by which [`crate::stream::Session::supply`] knows it.
    pub id: u64,
    /// Where it begins, from the start of the file.
    pub offset: u64,
    /// How many bytes; above zero.
    pub length: u64,
    /// Why it is wanted.
    pub class: Class,
}

impl Read {
    /// Reads the bytes.
    ///
    /// # Errors
    /// The source's error.
    pub fn run(&self, source: &(impl ReadAt + ?Sized)) -> io::Result<Vec<u8>> {
        let length = usize::try_from(self.length).map_err(|_| io::ErrorKind::OutOfMemory)?;
        let mut bytes = vec![0; length];
        source.read_at(self.offset, &mut bytes)?;
        Ok(bytes)
    }
}

/// A unit to decode, with the pages that it needs.
pub(crate) struct Task<C: Content> {
    pub content: Arc<C>,
    pub unit: C::Unit,
    pub pages: Vec<(C::Page, Arc<[u8]>)>,
    pub base: Option<Arc<C::Data>>,
}

impl<C: Content> Task<C> {
    pub fn run(self) -> Outcome<C> {
        let result = self.content.decode(self.unit, &self.pages, self.base.as_deref());
        Outcome { unit: self.unit, result: result.map(Arc::new) }
    }
}

/// The result of a [`Task`].
pub(crate) struct Outcome<C: Content> {
    pub unit: C::Unit,
    pub result: Result<Arc<C::Data>>,
}

/// The next job of a loader.
pub(crate) enum Job<C: Content> {
    Read(Read),
    Decode(Task<C>),
}
