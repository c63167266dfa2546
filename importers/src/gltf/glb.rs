//! The container.

use crate::file::File;
use crate::{ImportError, Place};

/// The JSON chunk of a GLB and, if there is one, the binary chunk.
pub(super) fn chunks(file: &File) -> Result<(&[u8], Option<&[u8]>), ImportError> {
    let number = |at: usize| {
        let bytes = file.bytes.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
        let problem = "the file ends in the middle of a GLB header";
        bytes.map(u32::from_le_bytes).ok_or_else(|| file.malformed(Place::Byte(at), problem))
    };
    let version = number(4)?;
    if version != 2 {
        return Err(
            file.unsupported(Place::Byte(4), format!("GLB version {version}; version 2 is supported"))
        );
    }
    let end = number(8)? as usize;
    if end > file.bytes.len() {
        let problem = format!("the GLB declares {end} bytes, but the file has {}", file.bytes.len());
        return Err(file.malformed(Place::Byte(8), problem));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at < end {
        let (length, kind) = (number(at)? as usize, number(at + 4)?.to_le_bytes());
        let Some(chunk) = file.bytes.get(at + 8..at + 8 + length) else {
            let problem = format!("a chunk of {length} bytes goes beyond the end of the file");
            return Err(file.malformed(Place::Byte(at), problem));
        };
        match &kind {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            // Other chunks are extensions' and may be skipped.
            _ => {}
        }
        at += 8 + length;
    }
    let missing = || file.malformed(Place::Byte(12), "the GLB has no JSON chunk");
    Ok((json.ok_or_else(missing)?, binary))
}
