//! Opening a lodpack file by its path or address.

use anyhow::{Context, Result, bail};
use lodpack::{Counting, File, Limits, ReadAt};
use std::path::Path;

/// Bytes from anywhere, counted.
pub type Source = Counting<Box<dyn ReadAt + Send + Sync>>;

/// Opens a lodpack file for reading: a path, `http://`, `https://`, or with feature `object-store` `s3://`, `gs://`, `az://`.
pub fn open(path: &Path) -> Result<File<Source>> {
    let source: Box<dyn ReadAt + Send + Sync> = match path.to_str().and_then(address) {
        Some(("http" | "https", url)) => Box::new(lodpack::Http::new(url, lodpack::HttpOptions::default())),
        Some(("s3" | "gs" | "az", url)) => open_object(url)?,
        Some((scheme, _)) => bail!("{}: addresses of kind {scheme} cannot be read", path.display()),
        None if path.is_dir() => bail!("{} is a directory; name a .lodpack file", path.display()),
        None => Box::new(std::fs::File::open(path).with_context(|| format!("cannot open {}", path.display()))?),
    };
    File::open(Counting::new(source), Limits::default()).with_context(|| path.display().to_string())
}

/// Scheme and whole text of an address; none for a path.
fn address(text: &str) -> Option<(&str, &str)> {
    let (scheme, _) = text.split_once("://")?;
    // One letter is a drive.
    let is_scheme = scheme.len() > 1 && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric());
    is_scheme.then_some((scheme, text))
}

#[cfg(feature = "object-store")]
fn open_object(url: &str) -> Result<Box<dyn ReadAt + Send + Sync>> {
    Ok(Box::new(lodpack::Object::open(url)?))
}

#[cfg(not(feature = "object-store"))]
fn open_object(url: &str) -> Result<Box<dyn ReadAt + Send + Sync>> {
    bail!("{url}: this program was built without feature object-store; download the file, or use its https address")
}
