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
        /// The system's reason.
        source: std::io::Error,
    },
    /// The answer needs bytes that have not been read yet. Only calls that read nothing themselves return this, such as
    /// those on a
    /// [`crate::Opener`] or an [`crate::Index`]: read the ranges, insert them into [`crate::Fetched`], call
    /// [`crate::Index::supply`], and repeat the call.
    #[error("{} ranges of the file must be read first; read them and repeat the call", ranges.len())]
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
    /// The caller asked for something impossible.
    #[error("{what}")]
    Query {
        /// What is wrong with the query, and what would be right.
        what: String,
    },
    /// The model breaks a rule of the format: the builder has to change it.
    #[error("cannot write this model: {what}")]
    Model {
        /// The rule, and where it is broken.
        what: String,
    },
    /// The output could not be written.
    #[error("cannot write: {source}")]
    Write {
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file asks for more than [`crate::Limits`] allows.
    #[error("{what} is {found}, above the limit of {limit}; raise Limits if the file is trusted")]
    Limit {
        /// The quantity.
        what: &'static str,
        /// The file's value.
        found: u64,
        /// The largest value allowed.
        limit: u64,
    },
}

impl Error {
    /// A broken rule. A caller that knows the location adds it with [`Error::at`].
    pub(crate) fn format(what: &'static str) -> Self {
        Self::Format { what, location: String::new() }
    }

    /// A model that cannot be written.
    pub(crate) fn model(what: impl Into<String>) -> Self {
        Self::Model { what: what.into() }
    }

    /// Adds the location of a broken rule, unless an inner call has done so.
    pub(crate) fn at(self, location: impl FnOnce() -> String) -> Self {
        match self {
            Self::Format { what, location: old } if old.is_empty() => Self::Format { what, location: location() },
            other => other,
        }
    }
}

/// A rule of SPEC.md that coded symbols break, in one machine word, so that the results of the innermost functions
/// travel in registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Violation(pub &'static &'static str);

impl From<Violation> for Error {
    fn from(violation: Violation) -> Self {
        Self::format(violation.0)
    }
}

/// The result of this crate's calls.
pub type Result<T, E = Error> = std::result::Result<T, E>;
