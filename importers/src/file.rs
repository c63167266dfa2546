//! A file in memory that knows its name, so that errors can say it.

use crate::source::regular;
use crate::{ImportError, Place};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// A file's bytes and path.
pub(crate) struct File {
    pub(crate) path: PathBuf,
    pub(crate) bytes: Vec<u8>,
}

impl File {
    /// Reads a regular file.
    pub(crate) fn read(path: &Path) -> Result<Self, ImportError> {
        match all(path) {
            Ok(bytes) => Ok(Self { path: path.to_owned(), bytes }),
            Err(source) => Err(ImportError::Read { path: path.to_owned(), source }),
        }
    }

    /// Reads a file that this one names at `place`, relative to this one's folder.
    pub(crate) fn read_named(&self, place: Place, name: &str) -> Result<Self, ImportError> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let as_written = folder.join(name);
        // Files made on Windows name others with its separator.
        let portable = folder.join(name.replace('\\', "/"));
        let named = if as_written.exists() { as_written } else { portable };
        match all(&named) {
            Ok(bytes) => Ok(Self { path: named, bytes }),
            Err(source) => Err(ImportError::Named { path: self.path.clone(), place, named, source }),
        }
    }

    /// The bytes of a text: what follows the mark of UTF-8, if it begins with one.
    pub(crate) fn text(&self) -> &[u8] {
        unmarked(&self.bytes)
    }

    pub(crate) fn malformed(&self, place: Place, problem: impl Into<String>) -> ImportError {
        ImportError::Malformed { path: self.path.clone(), place, problem: problem.into() }
    }

    pub(crate) fn unsupported(&self, place: Place, feature: impl Into<String>) -> ImportError {
        ImportError::Unsupported { path: self.path.clone(), place, feature: feature.into() }
    }
}

/// The bytes of a regular file.
fn all(path: &Path) -> io::Result<Vec<u8>> {
    let (mut handle, length) = regular(path)?;
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(length).map_err(io::Error::other)?).map_err(io::Error::other)?;
    handle.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// What follows the mark of UTF-8 that some programs begin texts with.
pub(crate) fn unmarked(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// Text of a file in quotes for a message: its beginning, where it is long.
pub(crate) fn quoted(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{:?}…", &text[..end]),
        None => format!("{text:?}"),
    }
}
