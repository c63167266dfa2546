//! Decompression that stops at the size that is expected.

use flate2::read::{DeflateDecoder, MultiGzDecoder, ZlibDecoder};
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};
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
    all(MultiGzDecoder::new(compressed), limit)
}

/// All of a deflate stream without head, if it unpacks to no more than `limit` bytes.
pub(crate) fn deflated_all(compressed: &[u8], limit: u64) -> Result<Vec<u8>, String> {
    all(DeflateDecoder::new(compressed), limit)
}

fn all(reader: impl Read, limit: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    match reader.take(limit.saturating_add(1)).read_to_end(&mut bytes) {
        Err(error) => Err(format!("the compressed data break off after {} bytes: {error}", bytes.len())),
        Ok(length) if length as u64 > limit => Err(over_limit(limit)),
        Ok(_) => Ok(bytes),
    }
}

/// A block of Zstandard holds at most 128 KiB and has at least four bytes.
const ZSTD_LIMIT: usize = 1 << 15;

/// The history that a small Zstandard frame may ask for: what its authors say a decoder should have, at least.
const ZSTD_WINDOW: usize = 8 << 20;

/// Exactly `expected` bytes from a Zstandard frame.
pub(crate) fn zstd(compressed: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    if expected / ZSTD_LIMIT > compressed.len() {
        return Err(cannot_hold(compressed.len(), expected));
    }
    let mut rest = compressed;
    let mut bytes = Vec::new();
    let mut decoder = FrameDecoder::new();
    decoder.set_max_window_size(expected.max(ZSTD_WINDOW) as u64);
    decoder.reset(&mut rest).map_err(|error| format!("not a Zstandard frame: {error}"))?;
    while !decoder.is_finished() {
        decoder
            .decode_blocks(&mut rest, BlockDecodingStrategy::UptoBlocks(1))
            .map_err(|error| breaks_off(bytes.len(), expected, &error))?;
        // Before the end the decoder keeps back no more than its window.
        let left = (expected - bytes.len()) as u64 + 1;
        let read = decoder.by_ref().take(left).read_to_end(&mut bytes);
        read.map_err(|error| breaks_off(bytes.len(), expected, &error))?;
        if bytes.len() > expected {
            break;
        }
    }
    let sums = decoder.get_checksum_from_data().zip(decoder.get_calculated_checksum());
    match () {
        () if bytes.len() > expected => Err(too_many(expected)),
        () if !rest.is_empty() => Err(format!("{} bytes are left behind the Zstandard frame", rest.len())),
        () if sums.is_some_and(|(said, found)| said != found) => {
            Err("the checksum of the Zstandard frame is wrong".into())
        }
        () if bytes.len() < expected => Err(too_few(bytes.len(), expected)),
        () => Ok(bytes),
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
    if expected / DEFLATE_LIMIT > compressed { Err(cannot_hold(compressed, expected)) } else { Ok(()) }
}

fn exactly(reader: impl Read, compressed: usize, expected: usize) -> Result<Vec<u8>, String> {
    can_hold(compressed, expected)?;
    let mut bytes = Vec::new();
    if let Err(error) = reader.take(expected as u64 + 1).read_to_end(&mut bytes) {
        return Err(breaks_off(bytes.len(), expected, &error));
    }
    match bytes.len() {
        found if found < expected => Err(too_few(found, expected)),
        found if found > expected => Err(too_many(expected)),
        _ => Ok(bytes),
    }
}

fn cannot_hold(compressed: usize, expected: usize) -> String {
    format!("{compressed} compressed bytes cannot hold the {expected} bytes that are expected")
}

fn breaks_off(found: usize, expected: usize, error: &dyn std::fmt::Display) -> String {
    format!("the compressed data break off after {found} of {expected} bytes: {error}")
}

fn too_few(found: usize, expected: usize) -> String {
    format!("decompressed to {found} bytes; {expected} are expected")
}

fn too_many(expected: usize) -> String {
    format!("decompressed to more than the {expected} bytes that are expected")
}
