//! Opens what is named on the command line.

use std::{path::Path, sync::Arc};

use anyhow::{Context, Result};
use lodpack::{Http, HttpOptions, ReadAt};

/// Where the bytes are.
pub type Source = Arc<dyn ReadAt + Send + Sync>;

/// Opens a file or a URL.
///
/// # Errors
/// Where there is nothing to read.
pub fn open_source(place: &str) -> Result<Source> {
    if place.starts_with("http://") || place.starts_with("https://") {
        return Ok(Arc::new(Http::new(place, HttpOptions::default())));
    }
    let file = std::fs::File::open(Path::new(place)).with_context(|| format!("{place} cannot be opened"))?;
    Ok(Arc::new(file))
}
