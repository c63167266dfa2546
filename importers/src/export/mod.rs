//! Content to files.

pub(crate) mod nrrd;
pub(crate) mod samples;
pub(crate) mod surfel_ply;
pub(crate) mod vti;

/// Why content does not become a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The content is not what the format holds.
    #[error("{0}")]
    Unsuited(String),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}
