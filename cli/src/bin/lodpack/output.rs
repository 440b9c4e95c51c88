//! Files that get their final name only when complete, text on stdout, and numbers as people read them.

use crate::interrupt;
use anyhow::{Context, Result, bail};
use lodpack::index::FillingCounts;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// An output under a temporary name beside its final one; removed if it is dropped unfinished. A device or a pipe is written
/// directly, since a file renamed over it would replace it.
pub struct PendingFile {
    /// None once the file has its final name, and for devices.
    temporary: Option<PathBuf>,
    path: PathBuf,
}

impl PendingFile {
    /// Checks that `path` may be written, and creates a file under a temporary name beside it. `path` must not be one of `inputs`.
    pub fn create<'a>(path: &Path, force: bool, inputs: impl IntoIterator<Item = &'a Path>) -> Result<(Self, File)> {
        if path.is_dir() {
            bail!("{} is a directory; name a file", path.display());
        }
        let cannot_write = || format!("cannot write {}", path.display());
        // The target of a link is replaced, not the link.
        let real = match path.is_symlink() {
            true => fs::canonicalize(path)
                .with_context(|| format!("{} is a link whose target does not exist", path.display()))?,
            false => path.to_owned(),
        };
        if real.exists() && !real.is_file() {
            let file = File::options().write(true).open(&real).with_context(cannot_write)?;
            return Ok((Self { temporary: None, path: real }, file));
        }
        if let Ok(output) = fs::canonicalize(&real)
            && inputs.into_iter().any(|input| fs::canonicalize(input).is_ok_and(|input| input == output))
        {
            bail!("{} is an input and cannot be the output, too; name another file with -o", path.display());
        }
        if real.exists() && !force {
            bail!("{} exists; pass --force to overwrite it, or name another file with -o", path.display());
        }
        let Some(name) = real.file_name() else { bail!("{} names no file", path.display()) };
        check_folder(&real)?;
        remove_abandoned(folder_of(&real), &name.to_string_lossy());
        let mut temporary_name = name.to_owned();
        temporary_name.push(format!(".{}.tmp", std::process::id()));
        let temporary = real.with_file_name(temporary_name);
        interrupt::unfinished(&temporary);
        let file = File::create(&temporary).with_context(cannot_write)?;
        // The lock only shows other processes that this file is in use.
        let _ = file.try_lock();
        Ok((Self { temporary: Some(temporary), path: real }, file))
    }

    /// Gives the complete file its final name.
    pub fn finish(mut self, file: File) -> Result<()> {
        let Some(temporary) = &self.temporary else { return Ok(()) };
        file.sync_all().with_context(|| format!("cannot finish {}", temporary.display()))?;
        drop(file);
        fs::rename(temporary, &self.path)
            .with_context(|| format!("cannot rename {} to {}", temporary.display(), self.path.display()))?;
        interrupt::finished(temporary);
        self.temporary = None;
        Ok(())
    }
}

/// Removes temporary files of an output that killed processes have left.
fn remove_abandoned(folder: &Path, name: &str) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let file_name = entry.file_name();
        let number =
            file_name.to_str().and_then(|other| other.strip_prefix(name)?.strip_prefix('.')?.strip_suffix(".tmp"));
        let is_ours = number.is_some_and(|number| !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()));
        if is_ours && File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            // If this fails, the temporary name still shows that the file is no product.
            let _ = fs::remove_file(temporary);
            interrupt::finished(temporary);
        }
    }
}

/// Prints a line on stdout; returns from the function if that fails.
macro_rules! say {
    ($($text:tt)*) => { $crate::output::write_line(format_args!($($text)*))? };
}
pub(crate) use say;

/// Writes a line to stdout. A closed pipe is no error: its reader, such as `head`, has seen enough.
pub fn write_line(text: std::fmt::Arguments) -> Result<()> {
    match writeln!(io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error).context("cannot write to stdout"),
        _ => Ok(()),
    }
}

pub use lodpack_cli::text::{count, shell};

/// How many there are of each filling: "2 irregular, 0 grid".
pub fn by_filling(counts: &FillingCounts) -> String {
    let texts: Vec<_> =
        counts.iter().map(|(filling, number)| format!("{} {}", count(number), filling.name())).collect();
    texts.join(", ")
}

/// The folder of a file.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Refuses a path whose folder does not exist.
pub fn check_folder(path: &Path) -> Result<()> {
    let folder = folder_of(path);
    match folder.is_dir() {
        true => Ok(()),
        false => bail!("cannot write {}: there is no directory {}; create it first", path.display(), folder.display()),
    }
}

/// A length with four significant digits.
#[expect(clippy::disallowed_methods, reason = "only the number of printed digits depends on it")]
pub fn length(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = (3 - value.abs().max(1e-300).log10().floor() as i32).clamp(0, 6);
        format!("{value:.0$}", if value == 0.0 { 0 } else { digits as usize })
    } else {
        format!("{value:.3e}")
    }
}

/// Bytes in a unit that keeps the number short.
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
