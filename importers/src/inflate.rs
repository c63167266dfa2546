//! Decompression that stops at the size that is expected.

use flate2::read::{MultiGzDecoder, ZlibDecoder};
use std::io::Read;

/// How gzip files begin.
pub(crate) const GZIP: [u8; 2] = [0x1f, 0x8b];

/// A deflate stream holds at most this many bytes for each of its own: 258 for two bits.
const DEFLATE_LIMIT: usize = 1032;

/// Exactly `expected` bytes from a gzip file (of one or more members).
pub(crate) fn gunzip(compressed: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    exactly(MultiGzDecoder::new(compressed), compressed.len(), expected)
}

/// Exactly `expected` bytes from a zlib stream.
pub(crate) fn zlib(compressed: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    exactly(ZlibDecoder::new(compressed), compressed.len(), expected)
}

/// Up to `limit` first bytes of a gzip file; what is broken ends them.
pub(crate) fn gzip_beginning(compressed: &[u8], limit: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    // What was read before an error is in `bytes` and is all that is asked for.
    let _ = MultiGzDecoder::new(compressed).take(limit as u64).read_to_end(&mut bytes);
    bytes
}

/// All of a gzip file, if it unpacks to no more than `limit` bytes.
pub(crate) fn gunzip_all(compressed: &[u8], limit: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let unpacked = MultiGzDecoder::new(compressed).take(limit.saturating_add(1)).read_to_end(&mut bytes);
    match unpacked {
        Err(error) => Err(format!("the compressed data break off after {} bytes: {error}", bytes.len())),
        Ok(length) if length as u64 > limit => Err(over_limit(limit)),
        Ok(_) => Ok(bytes),
    }
}

/// What is said of compressed data that unpack to more than `OpenOptions::max_memory`.
pub(crate) fn over_limit(limit: u64) -> String {
    format!("the compressed data unpack to more than {limit} bytes, which is the limit that is set")
}

/// That `expected` bytes are no more than the `limit` of what compressed files may unpack to.
pub(crate) fn within(expected: usize, limit: u64) -> Result<(), String> {
    if expected as u64 > limit { Err(over_limit(limit)) } else { Ok(()) }
}

/// That `compressed` bytes of deflate can be `expected` bytes at all.
pub(crate) fn can_hold(compressed: usize, expected: usize) -> Result<(), String> {
    if expected / DEFLATE_LIMIT > compressed {
        Err(format!("{compressed} compressed bytes cannot hold the {expected} bytes that are expected"))
    } else {
        Ok(())
    }
}

fn exactly(reader: impl Read, compressed: usize, expected: usize) -> Result<Vec<u8>, String> {
    can_hold(compressed, expected)?;
    let mut bytes = Vec::new();
    if let Err(error) = reader.take(expected as u64 + 1).read_to_end(&mut bytes) {
        return Err(format!(
            "the compressed data break off after {} of {expected} bytes: {error}",
            bytes.len()
        ));
    }
    match bytes.len() {
        found if found < expected => Err(format!("decompressed to {found} bytes; {expected} are expected")),
        found if found > expected => {
            Err(format!("decompressed to more than the {expected} bytes that are expected"))
        }
        _ => Ok(bytes),
    }
}
