//! The subcommands.

pub(crate) mod compare;
pub(crate) mod convert;
pub(crate) mod info;
pub(crate) mod pick;
pub(crate) mod render;

use anyhow::{Context, Result};
use std::io::{ErrorKind, Write};

/// Writes to standard output; that nobody reads on is no error.
fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e).context("standard output"),
        _ => Ok(()),
    }
}
