//! Watching long reads.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What is told how far a read has come: bytes done, and bytes in all.
///
/// The bytes are those of the file that is opened: neither of files that it names, nor of what it unpacks to, and of a
/// folder nothing is told. It is called every few megabytes, from any thread; calls from several threads may overtake one
/// another. When all is read, a call has both numbers equal.
#[derive(Clone)]
pub struct Watch(Arc<Told>);

/// A function of bytes done and bytes in all.
type Told = dyn Fn(u64, u64) + Send + Sync;

impl Watch {
    /// Calls `told` with bytes done and bytes in all.
    pub fn new(told: impl Fn(u64, u64) + Send + Sync + 'static) -> Self {
        Self(Arc::new(told))
    }
}

impl fmt::Debug for Watch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Watch")
    }
}

/// Two are equal if they are clones of one.
impl PartialEq for Watch {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Bytes between two calls.
const STEP: u64 = 4 << 20;

/// How far a read has come.
#[derive(Debug)]
pub(crate) struct Progress {
    watch: Option<Watch>,
    done: AtomicU64,
    total: u64,
}

impl Progress {
    pub(crate) fn new(watch: Option<&Watch>, total: u64) -> Self {
        Self { watch: watch.cloned(), done: AtomicU64::new(0), total }
    }

    /// Counts bytes that were read.
    pub(crate) fn add(&self, bytes: usize) {
        let before = self.done.fetch_add(bytes as u64, Ordering::Relaxed);
        let done = before + bytes as u64;
        if before / STEP < done / STEP {
            self.tell(done);
        }
    }

    /// Nothing more will be read.
    pub(crate) fn finish(&self) {
        self.tell(self.total);
    }

    fn tell(&self, done: u64) {
        if let Some(watch) = &self.watch {
            (watch.0)(done.min(self.total), self.total);
        }
    }
}
