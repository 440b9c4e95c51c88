//! What a server has: files on disk and bytes in memory, by the paths of their addresses.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::UNIX_EPOCH;

/// Something that is served.
#[derive(Debug)]
pub enum Item {
    /// A file, opened anew for every request, so that a new file of that name is served without a restart.
    File(PathBuf),
    /// Bytes that do not change.
    Bytes(Cow<'static, [u8]>),
}

/// Files and pages by path, and where browsers are sent.
pub struct Shelf {
    items: BTreeMap<String, Item>,
    /// The page at `/`.
    pub(super) front: Option<String>,
    /// The address that shows a file, for people who open the file's own in a browser.
    pub(super) shown_at: BTreeMap<String, String>,
    /// The tag of each file when it was last served.
    tags: Mutex<BTreeMap<PathBuf, String>>,
    on_change: Box<dyn Fn(&Path) + Send + Sync>,
}

impl Shelf {
    /// An empty shelf. `on_change` hears of every file that is another one than before.
    pub fn new(on_change: impl Fn(&Path) + Send + Sync + 'static) -> Self {
        let (items, shown_at) = (BTreeMap::new(), BTreeMap::new());
        Self { items, front: None, shown_at, tags: Mutex::default(), on_change: Box::new(on_change) }
    }

    /// Puts something at a path, which begins with a slash and is not escaped.
    pub fn put(&mut self, path: impl Into<String>, item: Item) {
        self.items.insert(path.into(), item);
    }

    /// Puts a file at its name, or at `name-2.lodpack` and so on where that is taken. Returns the path.
    pub fn put_file(&mut self, file: &Path) -> String {
        let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        let (stem, ending) = (text(file.file_stem()), text(file.extension()));
        let dot = if ending.is_empty() { "" } else { "." };
        let names =
            std::iter::once(format!("/{stem}{dot}{ending}")).chain((2..).map(|k| format!("/{stem}-{k}{dot}{ending}")));
        let free = |name: &String| name != "/" && !self.items.contains_key(name);
        // There are more names than items.
        let path = names.into_iter().find(free).unwrap_or_default();
        self.put(path.clone(), Item::File(file.to_owned()));
        path
    }

    /// Shows this page at `/`.
    pub fn set_front(&mut self, html: String) {
        self.front = Some(html);
    }

    /// Sends browsers that open `path` to `address`, which shows it.
    pub fn show_at(&mut self, path: &str, address: String) {
        self.shown_at.insert(path.to_owned(), address);
    }

    pub(super) fn item(&self, path: &str) -> Option<&Item> {
        self.items.get(path)
    }

    /// Opens a file: its size and its tag, which is another one for another file.
    pub(super) fn open(&self, path: &Path) -> io::Result<(File, u64, String)> {
        let file = File::open(path)?;
        let about = file.metadata()?;
        let modified = about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        let tag = format!("\"{:x}-{:x}\"", about.len(), modified.unwrap_or_default().as_nanos());
        let mut tags = self.tags.lock().unwrap_or_else(PoisonError::into_inner);
        if tags.insert(path.to_owned(), tag.clone()).is_some_and(|before| before != tag) {
            (self.on_change)(path);
        }
        Ok((file, about.len(), tag))
    }
}

impl std::fmt::Debug for Shelf {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Shelf").field("items", &self.items.keys()).finish_non_exhaustive()
    }
}

/// A path as it stands in an address.
pub fn escape(path: &str) -> String {
    let plain = |byte: &u8| byte.is_ascii_alphanumeric() || b"/-._~".contains(byte);
    path.bytes().map(|byte| if plain(&byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") }).collect()
}
