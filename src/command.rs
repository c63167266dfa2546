//! The subcommands.

pub(crate) mod chart;
pub(crate) mod compare;
pub(crate) mod convert;
pub(crate) mod extract;
pub(crate) mod info;
pub(crate) mod pick;
pub(crate) mod render;
pub(crate) mod warp;

use anyhow::{Context, Result, ensure};
use std::io::{ErrorKind, Write};

/// Writes to standard output; that nobody reads on is no error.
pub(crate) fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e).context("standard output"),
        _ => Ok(()),
    }
}

/// Takes so many threads, where any are asked for.
fn use_threads(threads: Option<usize>) -> Result<()> {
    let Some(threads) = threads else { return Ok(()) };
    ensure!((1..=1024).contains(&threads), "--threads is {threads}; it must be from 1 to 1024");
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("--threads")
}
