//! Content to files.

pub(crate) mod gaussian_ply;
pub(crate) mod records;
pub(crate) mod splat;

#[cfg(test)]
mod tests;

use thiserror::Error;

/// Why content is not written.
#[derive(Debug, Error)]
pub(crate) enum ExportError {
    /// The content is not what the format holds.
    #[error("{0}")]
    Unsuited(String),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}
