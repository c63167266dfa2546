//! Content to files.

#[cfg_attr(not(test), expect(dead_code, reason = "for the dispatch of writers to come"))]
pub(crate) mod gltf;

/// Why content is not written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ExportError {
    /// The content is not what the format holds.
    #[error("{0}")]
    Unsuited(String),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}
