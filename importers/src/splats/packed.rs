//! What packed formats of trained splats have in common.

use super::gather::Training;
use crate::file::File;
use crate::{ImportError, Place};

/// The number at byte `at`, if there are enough bytes.
pub(crate) fn le<const N: usize, T>(bytes: &[u8], at: usize, from_le_bytes: fn([u8; N]) -> T) -> Option<T> {
    bytes.get(at..)?.first_chunk().map(|chunk| from_le_bytes(*chunk))
}

/// Whether a compressed file's `unpacked` bytes and the splats made of them are within `limit`
/// ([`crate::OpenOptions::max_memory`]).
pub(crate) fn within(
    limit: u64,
    file: &File,
    unpacked: u64,
    (count, training): (usize, Training),
) -> Result<(), ImportError> {
    let splats = training.bytes_per_splat().saturating_mul(count as u64);
    let all = unpacked.saturating_add(splats);
    if all <= limit {
        return Ok(());
    }
    let problem =
        format!("it unpacks to {count} splats, which take {all} bytes; the limit that is set is {limit}");
    Err(file.unsupported(Place::Whole, problem))
}
