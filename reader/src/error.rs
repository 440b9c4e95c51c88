//! Errors by culprit: who has to act to make the call succeed.

/// Why a call of this crate failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The bytes could not be read.
    #[error("cannot read {length} bytes at offset {offset}: {source}")]
    Io {
        /// Where the read began.
        offset: u64,
        /// How many bytes were asked for.
        length: u64,
        /// What the system said.
        source: std::io::Error,
    },
    /// Bytes are needed that are not there yet. Only functions of [`crate::Opener`] and [`crate::Index`] say so, which read
    /// nothing themselves: read the ranges, insert them into [`crate::Fetched`], call [`crate::Index::supply`], ask again.
    #[error("{} ranges of the file have to be read first, and the call repeated", ranges.len())]
    Missing {
        /// What to read: ascending, near ones joined.
        ranges: Vec<std::ops::Range<u64>>,
    },
    /// The file breaks a rule of SPEC.md: it is damaged, or not a lodpack file.
    #[error("damaged file: {what} ({location})")]
    Format {
        /// The rule that is broken.
        what: &'static str,
        /// Where: a section, page or record.
        location: String,
    },
    /// The file is sound but needs a newer program.
    #[error("this file needs a newer lodpack: {what}")]
    Unsupported {
        /// The feature that is unknown here.
        what: String,
    },
    /// The caller asked for something that cannot be.
    #[error("{what}")]
    Query {
        /// What is wrong with the query and what would be right.
        what: String,
    },
    /// The model to be written breaks a rule: the builder has to change it.
    #[error("cannot write this model: {what}")]
    Model {
        /// The rule, and where it is broken.
        what: String,
    },
    /// The output could not be written.
    #[error("cannot write: {source}")]
    Write {
        /// What the system said.
        source: std::io::Error,
    },
    /// The file asks for more than [`crate::Limits`] allows.
    #[error("{what} is {found}, above the limit of {limit}; raise Limits if the file is trusted")]
    Limit {
        /// The quantity.
        what: &'static str,
        /// What the file asks for.
        found: u64,
        /// What is allowed.
        limit: u64,
    },
}

impl Error {
    /// A broken rule; the location is filled in by a caller that knows it ([`Error::at`]).
    pub(crate) fn format(what: &'static str) -> Self {
        Self::Format { what, location: String::new() }
    }

    /// A model that cannot be written.
    pub(crate) fn model(what: impl Into<String>) -> Self {
        Self::Model { what: what.into() }
    }

    /// Names the location of a broken rule where it is not named yet.
    pub(crate) fn at(self, location: impl FnOnce() -> String) -> Self {
        match self {
            Self::Format { what, location: old } if old.is_empty() => Self::Format { what, location: location() },
            other => other,
        }
    }
}

/// A rule of SPEC.md that coded symbols break, in one word: innermost functions return it, and their results travel in registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Violation(pub &'static &'static str);

impl From<Violation> for Error {
    fn from(violation: Violation) -> Self {
        Self::format(violation.0)
    }
}

/// The result of this crate's calls.
pub type Result<T, E = Error> = std::result::Result<T, E>;
