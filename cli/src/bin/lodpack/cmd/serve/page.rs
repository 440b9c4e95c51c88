//! The viewer page (`viewer-min/web`): part of the program, or in a folder.

use anyhow::{Context, Result, bail};
use flate2::read::GzDecoder;
use lodpack_cli::serve::Item;
use std::borrow::Cow;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

// `EMBEDDED`: paths and bytes of the page, none if the program was built outside of lodpack's repository. Made by
// build.rs.
include!(concat!(env!("OUT_DIR"), "/page.rs"));

/// How to get the page.
pub const MISSING: &str = "this lodpack was built outside of its repository, without the viewer page; `viewer-min/web/pack DIR` \
                           there makes one, which --page DIR serves";

/// Most files of a page: `--page /` is a mistake.
const MOST_FILES: usize = 1000;

/// The page's files, by path.
pub struct Page {
    pub items: Vec<(String, Item)>,
    pub is_there: bool,
}

/// The page in a folder, or the program's own.
pub fn load(folder: Option<&Path>) -> Result<Page> {
    let mut items = vec![];
    match folder {
        None => {
            for &(path, bytes) in EMBEDDED {
                items.push(match path.strip_suffix(".gz") {
                    Some(path) => (path.to_owned(), Item::Bytes(Cow::Owned(unpacked(bytes)?))),
                    None => (path.to_owned(), Item::Bytes(Cow::Borrowed(bytes))),
                });
            }
        }
        Some(folder) => {
            if !folder.join("index.html").is_file() {
                bail!(
                    "{} holds no index.html; `viewer-min/web/pack DIR` in lodpack's source code makes a page",
                    folder.display()
                );
            }
            let folder = std::path::absolute(folder).with_context(|| format!("cannot find {}", folder.display()))?;
            collect(&folder, "", &mut items).with_context(|| format!("cannot read {}", folder.display()))?;
            if items.len() > MOST_FILES {
                bail!("{} holds more than {MOST_FILES} files: name the folder of the page alone", folder.display());
            }
        }
    }
    Ok(Page { is_there: !items.is_empty(), items })
}

fn unpacked(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut all = vec![];
    GzDecoder::new(bytes).read_to_end(&mut all).context("the page in this program is damaged")?;
    Ok(all)
}

/// Lists the files of a folder and of the folders in it. Links are left out: they could lead anywhere.
fn collect(folder: &Path, prefix: &str, items: &mut Vec<(String, Item)>) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let (kind, path): (_, PathBuf) = (entry.file_type()?, entry.path());
        // A name that is no UTF-8 cannot be an address.
        let Some(name) = entry.file_name().to_str().map(|name| format!("{prefix}/{name}")) else { continue };
        if items.len() > MOST_FILES {
            break;
        } else if kind.is_dir() {
            collect(&path, &name, items)?;
        } else if kind.is_file() {
            items.push((name, Item::File(path)));
        }
    }
    Ok(())
}
