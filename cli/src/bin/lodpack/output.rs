//! Files that get their final name only when complete, text on stdout, and numbers as people read them.

use crate::interrupt;
use anyhow::{Context, Result, bail};
use lodpack::index::FillingCounts;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// An output under a temporary name beside its final one; removed if it is dropped unfinished. A device or a pipe is
/// written directly, since a file renamed over it would replace it.
pub struct PendingFile {
    /// None once the file has its final name, and for devices.
    temporary: Option<PathBuf>,
    path: PathBuf,
    /// Whether it may take the place of another file.
    replaces: bool,
}

/// The most temporary names that are tried: they are taken only where processes of several machines or containers
/// have the same number.
const NAMES: u32 = 100;

impl PendingFile {
    /// Checks that `path` may be written, and creates a file under a temporary name beside it. `path` must not be one
    /// of `inputs`.
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
            return Ok((Self { temporary: None, path: real, replaces: false }, file));
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
        let (temporary, file) = new_file(&real, name).with_context(cannot_write)?;
        Ok((Self { temporary: Some(temporary), path: real, replaces: force }, file))
    }

    /// Gives the complete file its final name.
    pub fn finish(mut self, file: File) -> Result<()> {
        let Some(temporary) = &self.temporary else { return Ok(()) };
        file.sync_all().with_context(|| format!("cannot finish {}", temporary.display()))?;
        let named = match self.replaces {
            true => fs::rename(temporary, &self.path),
            false => TempPath::try_from_path(temporary)
                .and_then(|temporary| temporary.persist_noclobber(&self.path).map_err(|refused| refused.error)),
        };
        drop(file);
        match named {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => bail!(
                "{} appeared while it was written, and stays as it is; pass --force to overwrite it, or name another file with -o",
                self.path.display()
            ),
            named => {
                named.with_context(|| format!("cannot rename {} to {}", temporary.display(), self.path.display()))?
            }
        }
        interrupt::finished(temporary);
        self.temporary = None;
        Ok(())
    }
}

/// Finishes several files, of which none gets its name before all of them have reached the disk.
pub fn finish_all(files: Vec<(PendingFile, File)>) -> Result<()> {
    for (pending, file) in files.iter().filter(|(pending, _)| pending.temporary.is_some()) {
        file.sync_all().with_context(|| format!("cannot write {}", pending.path.display()))?;
    }
    files.into_iter().try_for_each(|(pending, file)| pending.finish(file))
}

/// Makes a file that nobody else has, under a temporary name, and locks it: the lock shows other processes that it is
/// in use.
fn new_file(output: &Path, name: &OsStr) -> io::Result<(PathBuf, File)> {
    let mut taken = io::ErrorKind::AlreadyExists.into();
    for attempt in 0..NAMES {
        let temporary = output.with_file_name(temporary_name(name, attempt));
        match File::options().create_new(true).read(true).write(true).open(&temporary) {
            Ok(file) => {
                interrupt::unfinished(&temporary);
                // A process that looked for abandoned files may have taken it for one before it was locked.
                let is_taken = matches!(file.try_lock(), Err(TryLockError::WouldBlock)) || !temporary.exists();
                if !is_taken {
                    return Ok((temporary, file));
                }
                interrupt::finished(&temporary);
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => taken = error,
            Err(error) => return Err(error),
        }
    }
    Err(taken)
}

/// Makes a folder as [`new_file`] makes a file. There is no lock where folders cannot be locked: nobody takes them for
/// abandoned there.
fn new_folder(output: &Path, name: &OsStr) -> io::Result<(PathBuf, Option<File>)> {
    let mut taken = io::ErrorKind::AlreadyExists.into();
    for attempt in 0..NAMES {
        let temporary = output.with_file_name(temporary_name(name, attempt));
        match fs::create_dir(&temporary) {
            Ok(()) => {
                interrupt::unfinished(&temporary);
                let folder = File::open(&temporary).ok();
                let lock = folder.as_ref().map(File::try_lock);
                if !matches!(lock, Some(Err(TryLockError::WouldBlock))) && temporary.exists() {
                    return Ok((temporary, folder.filter(|_| lock.is_some_and(|lock| lock.is_ok()))));
                }
                interrupt::finished(&temporary);
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => taken = error,
            Err(error) => return Err(error),
        }
    }
    Err(taken)
}

/// The temporary name of an output; another one after each attempt.
fn temporary_name(name: &OsStr, attempt: u32) -> OsString {
    let mut temporary = name.to_owned();
    temporary.push(format!(".{}", std::process::id()));
    if attempt > 0 {
        temporary.push(format!("-{attempt}"));
    }
    temporary.push(".tmp");
    temporary
}

/// Removes temporary files and folders of an output that killed processes have left.
fn remove_abandoned(folder: &Path, name: &str) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let file_name = entry.file_name();
        let number =
            file_name.to_str().and_then(|other| other.strip_prefix(name)?.strip_prefix('.')?.strip_suffix(".tmp"));
        let is_number = |b: u8| b.is_ascii_digit() || b == b'-';
        let is_ours = number.is_some_and(|number| !number.is_empty() && number.bytes().all(is_number));
        // Opening a pipe would wait for whoever writes to it.
        if is_ours
            && let Ok(kind) = entry.file_type()
            && (kind.is_file() || kind.is_dir())
            && let Ok(file) = File::open(entry.path())
            && file.try_lock().is_ok()
        {
            // If it cannot be removed, its name still shows that it is no product.
            match kind.is_dir() {
                true => interrupt::remove_folder(&entry.path()),
                false => drop(fs::remove_file(entry.path())),
            }
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

/// An output folder under a temporary name beside its final one; removed if it is dropped unfinished.
pub struct PendingFolder {
    temporary: PathBuf,
    path: PathBuf,
    is_finished: bool,
    /// Shows other processes that the folder is in use.
    _lock: Option<File>,
}

impl PendingFolder {
    /// Checks that `path` may be written, and creates a folder under a temporary name beside it. Only a new or empty
    /// folder may be, or with `force` one in which every name `is_own`: the products of an earlier run, and nothing
    /// that anybody could miss.
    pub fn create(path: &Path, force: bool, is_own: impl Fn(&str) -> bool) -> Result<Self> {
        let shown = path.display();
        // Its last part may be a dot or a slash.
        let path = match fs::canonicalize(path) {
            Ok(real) => real,
            Err(_) => std::path::absolute(path).with_context(|| format!("cannot write {shown}"))?,
        };
        if path.exists() && !path.is_dir() {
            bail!("{shown} is a file; name a folder with -o");
        }
        let names = fs::read_dir(&path).into_iter().flatten().flatten().map(|entry| entry.file_name());
        let names: Vec<String> = names.map(|name| name.to_string_lossy().into_owned()).collect();
        match names.iter().find(|name| !force || !is_own(name)) {
            None => {}
            Some(_) if !force => {
                bail!("{shown} is not empty; pass --force to replace an earlier export, or name another folder with -o")
            }
            Some(name) => {
                bail!("{shown} holds {name}, which no export has written; move it away, or name another folder with -o")
            }
        }
        check_folder(&path)?;
        let Some(name) = path.file_name() else { bail!("{shown} cannot be an output; name another folder with -o") };
        remove_abandoned(folder_of(&path), &name.to_string_lossy());
        Self::begin(&path, name, &path)
    }

    /// Creates a folder whose files go among those of `path`, which may have any others: within it, so that they can be
    /// moved there even if it is a file system of its own, or beside it if it is not there yet. [`Self::finish_by`]
    /// says how.
    pub fn merging(path: &Path) -> Result<Self> {
        let path = std::path::absolute(path).with_context(|| format!("cannot write {}", path.display()))?;
        match path.file_name().filter(|_| !path.exists()) {
            Some(name) => Self::begin(&path, name, &path),
            None => Self::begin(&path.join("unfinished"), "unfinished".as_ref(), &path),
        }
    }

    fn begin(beside: &Path, name: &OsStr, path: &Path) -> Result<Self> {
        let cannot_write = || format!("cannot write a folder beside {}", beside.display());
        let (temporary, lock) = new_folder(beside, name).with_context(cannot_write)?;
        Ok(Self { temporary, path: path.to_owned(), is_finished: false, _lock: lock })
    }

    /// Where to write.
    pub fn unfinished(&self) -> &Path {
        &self.temporary
    }

    /// Gives the complete folder its final name, in place of an earlier one.
    pub fn finish(self) -> Result<()> {
        self.finish_by(|temporary, path| {
            if path.exists() {
                fs::remove_dir_all(path).with_context(|| format!("cannot replace {}", path.display()))?;
            }
            fs::rename(temporary, path)
                .with_context(|| format!("cannot rename {} to {}", temporary.display(), path.display()))
        })
    }

    /// Has the complete folder put in its place, of which nothing may be left under the temporary name.
    pub fn finish_by(mut self, put: impl FnOnce(&Path, &Path) -> Result<()>) -> Result<()> {
        put(&self.temporary, &self.path)?;
        interrupt::finished(&self.temporary);
        self.is_finished = true;
        Ok(())
    }
}

impl Drop for PendingFolder {
    fn drop(&mut self) {
        if !self.is_finished {
            // If this fails, the temporary name still shows that the folder is no product.
            interrupt::remove_folder(&self.temporary);
            interrupt::finished(&self.temporary);
        }
    }
}

/// Prints a line on stdout; returns from the function if that fails.
macro_rules! say {
    ($($text:tt)*) => { $crate::output::write_line(format_args!($($text)*))? };
}
pub(crate) use say;

/// Writes a line to stdout, without what a terminal would take as commands. A closed pipe is no error: its reader, such
/// as `head`, has seen enough.
pub fn write_line(text: std::fmt::Arguments) -> Result<()> {
    match writeln!(io::stdout().lock(), "{}", plain(&text.to_string())) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error).context("cannot write to stdout"),
        _ => Ok(()),
    }
}

use lodpack_cli::text::plain;
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

/// A bound from above with four significant digits, which are rounded up, so that what is printed is a bound, too.
pub fn bound(value: f64) -> String {
    let text = length(value);
    match text.parse::<f64>() {
        // Half a unit of the fourth digit is at most this share.
        Ok(shown) if shown < value => {
            let text = length(value * (1.0 + 5e-4));
            if text.parse::<f64>().is_ok_and(|shown| shown >= value) { text } else { value.to_string() }
        }
        _ => text,
    }
}

/// A number as it is, or its first seven digits where there are many.
pub fn number(value: f64) -> String {
    let all = value.to_string();
    if all.len() <= 12 { all } else { format!("{value:.6e}") }
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
        assert_eq!(bound(0.012341), "0.01235");
        assert_eq!(bound(0.25), "0.2500");
        for k in 1..2000 {
            let k = f64::from(k);
            let value = k * k * k * k * k * 1.234_567_89e-9;
            let shown = bound(value).parse::<f64>().unwrap();
            assert!(shown >= value && shown <= value * 1.0011, "{value} {shown}");
        }
    }

    #[test]
    fn outputs_of_one_name_at_the_same_moment_have_temporary_folders_of_their_own() {
        let beside = tempfile::tempdir().unwrap();
        let path = beside.path().join("tiles");
        let begin = || {
            let one = PendingFolder::create(&path, false, |_| false).unwrap();
            fs::create_dir(one.unfinished().join("own")).unwrap();
            one
        };
        let all: Vec<PendingFolder> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| [begin(), begin()])).collect();
            threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
        });
        assert!(all.iter().all(|one| one.unfinished().join("own").is_dir()));
        let mut all = all.into_iter();
        all.next().unwrap().finish().unwrap();
        drop(all);
        assert!(path.join("own").is_dir());
        assert_eq!(fs::read_dir(beside.path()).unwrap().count(), 1);
    }
}
