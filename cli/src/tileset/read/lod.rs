//! glTF whose nodes have levels (extension MSFT_lod): each level as the document in which its nodes stand in for the
//! finest ones.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::{ReadError, without_mark};
use crate::import::import_bytes;
use crate::mesh::Mesh;
use crate::progress::Progress;

/// Bytes before the text of a binary container.
const CONTAINER: usize = 20;
/// Levels that are read at most.
const MAX_LEVELS: usize = 256;

/// A document with levels.
pub struct GltfLevels {
    path: PathBuf,
    document: Value,
    /// What follows the document in a binary container.
    rest: Option<Vec<u8>>,
    /// How many levels there are, the finest included.
    count: usize,
}

impl GltfLevels {
    /// Reads a glTF document. None if it has no levels.
    ///
    /// # Errors
    /// [`ReadError::Io`] if the file cannot be read.
    pub fn open(path: &Path) -> Result<Option<Self>, ReadError> {
        let bytes = fs::read(path).map_err(|source| ReadError::Io { path: path.to_owned(), source })?;
        let (text, rest) = if bytes.starts_with(b"glTF") {
            let length = bytes.get(12..16).and_then(|word| word.try_into().ok()).map(u32::from_le_bytes);
            let end = length.and_then(|length| CONTAINER.checked_add(length as usize));
            let Some((text, rest)) = end.and_then(|end| Some((bytes.get(CONTAINER..end)?, bytes.get(end..)?))) else {
                return Ok(None);
            };
            (text, Some(rest.to_vec()))
        } else {
            (without_mark(&bytes), None)
        };
        // The importer says what is wrong with a damaged one.
        let Ok(document) = serde_json::from_slice::<Value>(text) else { return Ok(None) };
        let nodes = document["nodes"].as_array().map(Vec::as_slice).unwrap_or_default();
        let count = 1 + nodes.iter().map(|node| ids(node).len()).max().unwrap_or(0);
        let levels = Self { path: path.to_owned(), document, rest, count: count.min(MAX_LEVELS) };
        Ok((levels.count > 1).then_some(levels))
    }

    /// How many levels there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// The error that a level states, as lodpack writes it; 0 is the finest.
    #[must_use]
    pub fn claimed(&self, level: usize) -> Option<f64> {
        let nodes = self.document["nodes"].as_array()?;
        let shown = (0..nodes.len()).filter(|&number| !ids(&nodes[number]).is_empty());
        let errors = shown.filter_map(|number| {
            let at = self.stand_in(number, level);
            nodes.get(at)?["extras"]["certified_error"].as_f64()
        });
        errors.reduce(f64::max)
    }

    /// The node that a level shows in place of one.
    fn stand_in(&self, number: usize, level: usize) -> usize {
        let ids = self.document["nodes"].get(number).map(ids).unwrap_or_default();
        match level.min(ids.len()).checked_sub(1) {
            Some(coarser) => ids[coarser],
            None => number,
        }
    }

    /// The triangles of a level; 0 is the finest.
    ///
    /// # Errors
    /// [`ReadError::Content`].
    pub fn mesh(&self, level: usize, progress: &dyn Progress) -> Result<Mesh, ReadError> {
        let mut document = self.document.clone();
        let replace = |numbers: &mut Value| {
            for number in numbers.as_array_mut().into_iter().flatten() {
                if let Some(at) = number.as_u64().and_then(|at| usize::try_from(at).ok()) {
                    *number = self.stand_in(at, level).into();
                }
            }
        };
        for (all, numbers) in [("scenes", "nodes"), ("nodes", "children")] {
            let all = document.get_mut(all).and_then(Value::as_array_mut).into_iter().flatten();
            all.filter_map(|one| one.get_mut(numbers)).for_each(replace);
        }
        let mut text = document.to_string().into_bytes();
        let bytes = match &self.rest {
            None => text,
            Some(rest) => {
                text.resize(text.len().next_multiple_of(4), b' ');
                let total = (CONTAINER + text.len() + rest.len()) as u32;
                let mut bytes = b"glTF".to_vec();
                for word in [2, total, text.len() as u32] {
                    bytes.extend(word.to_le_bytes());
                }
                bytes.extend(b"JSON");
                [bytes, text, rest.clone()].concat()
            }
        };
        Ok(import_bytes(&self.path, &bytes, progress)?)
    }
}

/// The nodes of coarser levels, the finest of them first.
fn ids(node: &Value) -> Vec<usize> {
    let ids = node["extensions"]["MSFT_lod"]["ids"].as_array();
    ids.into_iter().flatten().filter_map(|id| usize::try_from(id.as_u64()?).ok()).collect()
}
