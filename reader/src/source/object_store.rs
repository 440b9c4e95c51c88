//! Objects in S3, Google Cloud Storage, Azure and other stores, through the crate `object_store`, which also retries.

use std::{
    io,
    ops::Range,
    sync::{Arc, OnceLock},
};

use ::object_store::{Error, GetOptions, GetResult, ObjectStore, ObjectStoreExt as _, path::Path};
use futures_util::{StreamExt as _, TryStreamExt as _, stream};

use super::{ReadAt, Request, SourceError, start::Start};

/// Most requests at once.
const CONNECTIONS: usize = 6;

/// What the crate sets if the caller's variables do not: silence is limited, not how long an answer takes in all.
const TIME_LIMITS: [(&str, &str); 2] = [("read_timeout", "30 seconds"), ("timeout", "30 days")];

/// An answer that breaks off after as many bytes is continued, however often the crate has retried.
const PROGRESS: usize = 1 << 14;

/// An object in a store. Its calls block: an asynchronous program uses [`crate::Opener`] and [`crate::Index`] instead.
#[derive(Debug)]
pub struct Object {
    store: Arc<dyn ObjectStore>,
    path: Path,
    runtime: tokio::runtime::Runtime,
    /// Size and ETag of the first answer.
    identity: OnceLock<(u64, Option<String>)>,
    start: Start,
}

impl Object {
    /// An object by its address: `s3://bucket/path`, `gs://bucket/path`, `az://container/path`. Keys, region and
    /// endpoint come from the variables that the stores' own programs use, such as `AWS_ACCESS_KEY_ID`, `AWS_REGION`,
    /// `AWS_ENDPOINT`. Sends no request yet.
    ///
    /// # Errors
    /// If the address or a variable is wrong.
    pub fn open(url: &str) -> io::Result<Self> {
        let invalid = |error: &dyn std::fmt::Display| {
            io::Error::new(io::ErrorKind::InvalidInput, format!("cannot open {url}: {error}"))
        };
        let parsed = url::Url::parse(url).map_err(|error| invalid(&error))?;
        let limits = TIME_LIMITS.map(|(name, value)| (name.to_owned(), value.to_owned()));
        let options = limits.into_iter().chain(std::env::vars());
        let (store, path) = ::object_store::parse_url_opts(&parsed, options).map_err(|error| invalid(&error))?;
        Self::new(Arc::from(store), path)
    }

    /// An object of a store that the caller has set up.
    ///
    /// # Errors
    /// If the system has no resources for a runtime.
    pub fn new(store: Arc<dyn ObjectStore>, path: Path) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        Ok(Self { store, path, runtime, identity: OnceLock::new(), start: Start::default() })
    }

    /// A range, shorter only where the object ends, and the size of the object.
    async fn fetch(&self, offset: u64, length: u64) -> io::Result<(Vec<u8>, u64)> {
        let mut bytes = Vec::new();
        loop {
            let before = bytes.len();
            match self.try_fetch(offset..offset.saturating_add(length), &mut bytes).await {
                Err(_) if bytes.len() >= before + PROGRESS => {}
                done => return Ok((bytes, done?)),
            }
        }
    }

    /// Adds what `bytes` lack of a range. Returns the size of the object.
    async fn try_fetch(&self, whole: Range<u64>, bytes: &mut Vec<u8>) -> io::Result<u64> {
        let asked = whole.start + bytes.len() as u64..whole.end;
        let if_match = self.identity.get().and_then(|(_, tag)| tag.clone());
        let options = GetOptions { range: Some(asked.clone().into()), if_match, ..GetOptions::default() };
        let result = self.store.get_opts(&self.path, options).await.map_err(source_error)?;
        let GetResult { meta, range, .. } = &result;
        let (size, _) = *self.identity.get_or_init(|| (meta.size, meta.e_tag.clone()));
        if meta.size != size {
            return Err(SourceError::Changed { what: format!("size {} instead of {size}", meta.size) }.into());
        }
        if range.start != asked.start || range.end != asked.end.min(size) {
            return Err(SourceError::WrongRange { what: format!("{range:?}") }.into());
        }
        let (expected, mut found) = (range.end - range.start, 0);
        let mut parts = result.into_stream();
        while let Some(part) = parts.next().await {
            let part = part.map_err(source_error)?;
            found += part.len() as u64;
            // A server that sends more than was asked for fills no memory.
            if found > expected {
                return Err(SourceError::WrongRange { what: format!("more than {expected} bytes") }.into());
            }
            bytes.extend_from_slice(&part);
        }
        if found == expected { Ok(size) } else { Err(SourceError::Short { expected, found }.into()) }
    }

    async fn fill(&self, request: &mut Request<'_>) -> io::Result<()> {
        if request.buf.is_empty() || self.start.fill(request.offset, request.buf) {
            return Ok(());
        }
        let (bytes, _) = self.fetch(request.offset, request.buf.len() as u64).await?;
        if bytes.len() != request.buf.len() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        request.buf.copy_from_slice(&bytes);
        Ok(())
    }
}

fn source_error(error: Error) -> io::Error {
    match error {
        Error::Precondition { .. } => SourceError::Changed { what: "ETag".into() }.into(),
        Error::NotFound { .. } => SourceError::Status { status: 404 }.into(),
        Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => SourceError::Status { status: 403 }.into(),
        other => SourceError::Closed { what: other.to_string() }.into(),
    }
}

impl ReadAt for Object {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.runtime.block_on(self.fill(&mut Request { offset, buf }))
    }

    fn size(&self) -> io::Result<u64> {
        match self.identity.get() {
            Some(&(size, _)) => Ok(size),
            None => self.runtime.block_on(async {
                let meta = self.store.head(&self.path).await.map_err(source_error)?;
                Ok(self.identity.get_or_init(|| (meta.size, meta.e_tag)).0)
            }),
        }
    }

    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        let (bytes, size) = self.runtime.block_on(self.fetch(0, length.max(1) as u64))?;
        self.start.keep(&bytes);
        Ok((bytes, size))
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        let reads = requests.iter_mut().map(|request| async move { self.fill(request).await });
        let all = stream::iter(reads).buffer_unordered(CONNECTIONS).try_collect::<()>();
        self.runtime.block_on(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_read_by_ranges_and_changes_are_noticed() {
        let store = Arc::new(::object_store::memory::InMemory::new());
        let path = Path::from("a/model.lodpack");
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let bytes: Vec<u8> = (0..1000_u32).map(|i| (i / 3) as u8).collect();
        runtime.block_on(store.put(&path, bytes.clone().into())).unwrap();
        let object = Object::new(store.clone(), path.clone()).unwrap();
        assert_eq!(object.read_start(4000).unwrap(), (bytes.clone(), 1000));
        let mut bufs = [vec![0; 10], vec![0; 500]];
        let mut requests: Vec<_> = bufs.iter_mut().zip([7, 400]).map(|(buf, offset)| Request { offset, buf }).collect();
        object.read_ranges(&mut requests).unwrap();
        assert_eq!((&bufs[0][..], &bufs[1][..]), (&bytes[7..17], &bytes[400..900]));
        assert_eq!(object.read_at(995, &mut [0; 10]).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);

        runtime.block_on(store.put(&path, bytes.into())).unwrap();
        let error = object.read_at(0, &mut [0; 10]).unwrap_err();
        assert!(matches!(SourceError::of(&error), Some(SourceError::Changed { .. })), "{error}");
        let missing = Object::new(store, Path::from("nothing")).unwrap();
        assert_eq!(missing.read_start(10).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
