//! Files that get their final name only when they are complete, and numbers for people.

use anyhow::{Context, Result, bail};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// An output under a temporary name beside its final one; removed when it is dropped unfinished.
pub struct PendingFile {
    temporary: PathBuf,
    path: PathBuf,
    done: bool,
}

impl PendingFile {
    /// Checks that `path` may be written and reserves a temporary name beside it.
    pub fn create(path: &Path, force: bool) -> Result<(Self, File)> {
        if path.is_dir() {
            bail!("{} is a directory; name a file", path.display());
        }
        if path.exists() && !force {
            bail!("{} exists; pass --force to overwrite it", path.display());
        }
        let Some(name) = path.file_name() else { bail!("{} names no file", path.display()) };
        let mut temporary_name = name.to_owned();
        temporary_name.push(format!(".{}.tmp", std::process::id()));
        let temporary = path.with_file_name(temporary_name);
        let file = File::create(&temporary).with_context(|| format!("cannot write {}", temporary.display()))?;
        Ok((Self { temporary, path: path.to_owned(), done: false }, file))
    }

    /// Gives the complete file its final name.
    pub fn finish(mut self, file: File) -> Result<()> {
        file.sync_all().with_context(|| format!("cannot finish {}", self.temporary.display()))?;
        drop(file);
        fs::rename(&self.temporary, &self.path)
            .with_context(|| format!("cannot rename {} to {}", self.temporary.display(), self.path.display()))?;
        self.done = true;
        Ok(())
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        if !self.done {
            // Nothing more can be done about a failure here; the name says that it is no product.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// A count with thousands separators.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A length with four significant digits.
pub fn length(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = (3 - value.abs().max(1e-300).log10().floor() as i32).clamp(0, 6);
        format!("{value:.0$}", if value == 0.0 { 0 } else { digits as usize })
    } else {
        format!("{value:.3e}")
    }
}

/// Bytes in the unit that suits.
pub fn bytes(value: u64) -> String {
    match value {
        0..=9_999 => format!("{value} B"),
        10_000..=9_999_999 => format!("{:.1} kB", value as f64 / 1e3),
        _ => format!("{:.1} MB", value as f64 / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(count(1_234_567), "1,234,567");
        assert_eq!(count(12), "12");
        assert_eq!(length(0.012345), "0.01235");
        assert_eq!(length(1.5e-7), "1.500e-7");
        assert_eq!(length(0.0), "0");
    }
}
