//! Files that appear only when they are complete.

use anyhow::{Context, Result};
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use tempfile::{Builder, NamedTempFile};

/// A file being written beside its place. [`Output::finish`] moves it there; dropped before, it is gone.
pub(crate) struct Output {
    path: PathBuf,
    file: NamedTempFile,
}

impl Output {
    /// Begins a file. Called before the work whose result it gets, so that a place that can't be written
    /// to costs nobody that work.
    pub(crate) fn begin(path: &Path) -> Result<Self> {
        let failed = || format!("cannot write {}", path.display());
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        if path.is_dir() {
            anyhow::bail!("{}: it is a folder", failed());
        }
        let mut builder = Builder::new();
        builder.prefix(".oblate-").suffix(".part");
        // Without this only the owner could read the picture; the process's mask still applies.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.tempfile_in(folder).with_context(failed)?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Writes the contents and moves the file to its place, over what was there.
    pub(crate) fn finish(self, write: impl FnOnce(&mut dyn WriteSeek) -> Result<()>) -> Result<()> {
        let failed = || format!("cannot write {}", self.path.display());
        let mut buffer = BufWriter::new(self.file.as_file());
        write(&mut buffer).with_context(failed)?;
        buffer.flush().with_context(failed)?;
        drop(buffer);
        self.file
            .persist(&self.path)
            .map_err(|e| e.error)
            .with_context(|| format!("cannot write {}", self.path.display()))?;
        Ok(())
    }
}

/// What the picture formats ask of a file.
pub(crate) trait WriteSeek: Write + Seek {}

impl<T: Write + Seek> WriteSeek for T {}
