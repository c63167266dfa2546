//! Files that appear only when they are complete.

use crate::command::print;
use anyhow::{Context, Result, ensure};
use serde::Serialize;
use std::fs::OpenOptions;
use std::io::{BufWriter, Cursor, Seek, Write};
use std::path::{Path, PathBuf};
use tempfile::Builder;

/// A place for a file, which [`Output::finish`] writes beside it and moves there.
pub(crate) struct Output {
    path: PathBuf,
    /// Where the path leads, whatever links are on the way.
    place: PathBuf,
}

impl Output {
    /// Finds out whether a file can be written there, and leaves nothing behind. Called before the work whose
    /// result it gets, so that a place that can't be written to costs nobody that work.
    pub(crate) fn begin(path: &Path) -> Result<Self> {
        let failed = || format!("cannot write {}", path.display());
        let Some(name) = path.file_name().filter(|_| !path.is_dir()) else {
            anyhow::bail!("{}: it is a folder", failed());
        };
        let place = match path.canonicalize() {
            Ok(place) => place,
            Err(_) => folder_of(path).canonicalize().with_context(failed)?.join(name),
        };
        if is_stream(&place) {
            return Ok(Self { path: path.to_owned(), place });
        }
        // This file has no name where the system can do without; else it loses it at once.
        tempfile::tempfile_in(folder_of(&place)).map_err(without_path).with_context(failed)?;
        Ok(Self { path: path.to_owned(), place })
    }

    /// That it would not take the place of any of these, which are read, nor of one of several files alike in a folder among them.
    pub(crate) fn ensure_unread<P: AsRef<Path>>(&self, reads: &[P]) -> Result<()> {
        let is_there = |path: &Path| {
            path.canonicalize().is_ok_and(|read| read == self.place || is_one_of_several(&read, &self.place))
        };
        let read = reads.iter().map(AsRef::as_ref).find(|path| is_there(path) && !is_stream(&self.place));
        read.map_or(Ok(()), |read| {
            let [path, read] = [self.path.as_path(), read].map(Path::display);
            anyhow::bail!(
                "cannot write {path}: that would overwrite what is read as {read}; name another file"
            )
        })
    }

    /// Whether both are one file.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        self.place == other.place
    }

    /// Writes the contents and moves the file to its place, over what was there. A device or a pipe stays what it is
    /// and is given the contents.
    pub(crate) fn finish(self, write: impl FnOnce(&mut dyn WriteSeek) -> Result<()>) -> Result<()> {
        self.write(write).with_context(|| format!("cannot write {}", self.path.display()))
    }

    fn write(&self, write: impl FnOnce(&mut dyn WriteSeek) -> Result<()>) -> Result<()> {
        if is_stream(&self.place) {
            // The contents need a place where writing can go back.
            let mut contents = Cursor::new(Vec::new());
            write(&mut contents)?;
            return Ok(OpenOptions::new().write(true).open(&self.place)?.write_all(contents.get_ref())?);
        }
        let mut builder = Builder::new();
        builder.prefix(".oblate-").suffix(".part");
        // Without this only the owner could read the picture; the process's mask still applies.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.tempfile_in(folder_of(&self.place)).map_err(without_path)?;
        let mut buffer = BufWriter::new(file.as_file());
        write(&mut buffer)?;
        buffer.flush()?;
        drop(buffer);
        file.persist(&self.place).map_err(|e| e.error)?;
        Ok(())
    }
}

/// Where `--stats` goes.
pub(crate) enum StatsPlace {
    StandardOutput,
    File(Output),
}

impl StatsPlace {
    pub(crate) fn begin(path: &Path) -> Result<Self> {
        if path == Path::new("-") { Ok(Self::StandardOutput) } else { Output::begin(path).map(Self::File) }
    }

    /// That it is neither where something else is written nor any of these, which are read.
    pub(crate) fn ensure_other<P: AsRef<Path>>(&self, output: &Output, reads: &[P]) -> Result<()> {
        let Self::File(stats) = self else { return Ok(()) };
        ensure!(!stats.is_same(output), "--output and --stats name one file; give two");
        stats.ensure_unread(reads)
    }

    pub(crate) fn finish(self, stats: &impl Serialize) -> Result<()> {
        let json = serde_json::to_string(stats)? + "\n";
        match self {
            Self::StandardOutput => print(&json),
            Self::File(output) => output.finish(|file| Ok(file.write_all(json.as_bytes())?)),
        }
    }
}

/// Whether a file is in a folder with others that have the same extension, as slices are.
fn is_one_of_several(folder: &Path, file: &Path) -> bool {
    let alike = |path: &Path| path != file && path.extension() == file.extension() && path.is_file();
    file.parent() == Some(folder)
        && file.exists()
        && folder.read_dir().is_ok_and(|files| files.flatten().any(|entry| alike(&entry.path())))
}

/// Whether there is a device or a pipe, which no file may replace: that of a user who may do everything would take
/// /dev/null from everybody.
fn is_stream(place: &Path) -> bool {
    place.metadata().is_ok_and(|there| !there.is_file() && !there.is_dir())
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The error without the name of a temporary file, which means nothing to the user.
fn without_path(error: std::io::Error) -> std::io::Error {
    error.kind().into()
}

/// What the picture formats ask of a file.
pub(crate) trait WriteSeek: Write + Seek {}

impl<T: Write + Seek> WriteSeek for T {}
