//! A file of which only the beginning is in memory.

use crate::file::File;
use crate::watch::Progress;
use crate::{ImportError, Place, Watch};
use std::fs;
use std::io::{self, Read};
use std::path::Path;

/// Bytes of the beginning: formats are told by it, and headers that readers of parts of a file need lie in it.
const HEAD: usize = 1 << 20;

/// Bytes that are read at a time, where all are.
const BLOCK: u64 = 8 << 20;

/// An open file.
pub(crate) struct Source {
    /// Its path and beginning: all of it, if it is small.
    pub(crate) head: File,
    handle: fs::File,
    /// Its bytes in all.
    pub(crate) size: usize,
    progress: Progress,
}

impl Source {
    /// Opens a regular file and reads its beginning.
    pub(crate) fn open(path: &Path, watch: Option<&Watch>) -> Result<Self, ImportError> {
        let open = || {
            let (mut handle, length) = regular(path)?;
            let size = usize::try_from(length).map_err(io::Error::other)?;
            let mut bytes = Vec::with_capacity(size.min(HEAD));
            (&mut handle).take(HEAD as u64).read_to_end(&mut bytes)?;
            let progress = Progress::new(watch, length);
            Ok(Self { head: File { path: path.to_owned(), bytes }, handle, size, progress })
        };
        open().map_err(|source| ImportError::Read { path: path.to_owned(), source })
    }

    /// Reads what is not read yet: the whole file in memory.
    pub(crate) fn into_file(mut self) -> Result<File, ImportError> {
        let File { path, mut bytes } = self.head;
        let mut read = || {
            self.progress.add(bytes.len());
            bytes.try_reserve_exact(self.size.saturating_sub(bytes.len())).map_err(io::Error::other)?;
            loop {
                match (&mut self.handle).take(BLOCK).read_to_end(&mut bytes)? {
                    0 => return Ok(()),
                    count => self.progress.add(count),
                }
            }
        };
        match read() {
            Ok(()) => {
                self.progress.finish();
                Ok(File { path, bytes })
            }
            Err(source) => Err(ImportError::Read { path, source }),
        }
    }

    /// The `count` bytes from byte `at` on. It may be called from several threads at the same time.
    pub(crate) fn bytes(&self, at: usize, count: usize) -> Result<Vec<u8>, ImportError> {
        let end = at.checked_add(count).filter(|end| *end <= self.size);
        let Some(end) = end else {
            let problem = format!("{count} bytes are needed from here on, but the file has {}", self.size);
            return Err(self.head.malformed(Place::Byte(at), problem));
        };
        if let Some(bytes) = self.head.bytes.get(at..end) {
            self.progress.add(count);
            return Ok(bytes.to_vec());
        }
        let mut bytes = vec![0; count];
        let mut done = 0;
        while done < count {
            match read_at(&self.handle, &mut bytes[done..], (at + done) as u64) {
                Ok(0) => return Err(self.unread(io::ErrorKind::UnexpectedEof.into())),
                Ok(read) => done += read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.unread(error)),
            }
        }
        self.progress.add(count);
        Ok(bytes)
    }

    /// Tells the watch that nothing more will be read.
    pub(crate) fn finish(&self) {
        self.progress.finish();
    }

    fn unread(&self, source: io::Error) -> ImportError {
        ImportError::Read { path: self.head.path.clone(), source }
    }
}

/// A regular file and its size: a device or pipe could have no end.
pub(crate) fn regular(path: &Path) -> io::Result<(fs::File, u64)> {
    let metadata = fs::metadata(path)?;
    if !metadata.is_file() {
        return Err(io::Error::other("not a regular file"));
    }
    Ok((fs::File::open(path)?, metadata.len()))
}

#[cfg(unix)]
fn read_at(handle: &fs::File, bytes: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(handle, bytes, at)
}

#[cfg(windows)]
fn read_at(handle: &fs::File, bytes: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(handle, bytes, at)
}

#[cfg(not(any(unix, windows)))]
fn read_at(_: &fs::File, _: &mut [u8], _: u64) -> io::Result<usize> {
    Err(io::ErrorKind::Unsupported.into())
}
