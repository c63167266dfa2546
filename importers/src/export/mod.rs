//! Splats to files.

pub(crate) mod spz;

/// Why nothing is written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The content is not what the format holds.
    #[error("{0}")]
    Unsuited(String),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}
