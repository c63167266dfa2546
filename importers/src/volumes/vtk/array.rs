//! The binary arrays of VTK's XML formats: one form behind inline, appended, raw and base64.
//!
//! Uncompressed: the number of bytes, then these. Compressed: the number of blocks, the size of a block, the
//! size of the last if it is shorter (else 0), each block's compressed size, then the blocks. The numbers
//! are of `header_type`. In base64 the header of compressed data is padded on its own; decoding each
//! padded part by itself makes the bytes the same as raw ones.

use crate::Endian;
use crate::inflate;
use crate::scalar::Scalar;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::borrow::Cow;

/// How appended data are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Raw,
    Base64,
}

/// The content of `AppendedData` after its underscore.
pub(crate) struct Appended<'a> {
    pub(crate) encoding: Encoding,
    pub(crate) data: &'a [u8],
}

impl<'a> Appended<'a> {
    /// The bytes from `offset` (counted as written) on.
    pub(crate) fn stream(&self, offset: usize) -> Result<Stream<'a>, String> {
        let Some(data) = self.data.get(offset..) else {
            return Err(format!("offset {offset} is beyond the {} appended bytes", self.data.len()));
        };
        match self.encoding {
            Encoding::Raw => Ok(Stream::new(Cow::Borrowed(data))),
            Encoding::Base64 => Stream::from_base64(data),
        }
    }
}

/// Bytes that are taken from the front.
pub(crate) struct Stream<'a> {
    bytes: Cow<'a, [u8]>,
    at: usize,
    header: (Scalar, Endian),
}

impl<'a> Stream<'a> {
    fn new(bytes: Cow<'a, [u8]>) -> Self {
        Self { bytes, at: 0, header: (Scalar::U32, Endian::Little) }
    }

    /// Decodes text of one or more padded parts.
    pub(crate) fn from_base64(text: &[u8]) -> Result<Self, String> {
        let text: Vec<u8> = text.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
        let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
        let mut rest = &text[..];
        while !rest.is_empty() {
            let end = rest.iter().position(|&b| b == b'=').map_or(rest.len(), |pad| (pad / 4 + 1) * 4);
            let (part, after) = rest.split_at(end.min(rest.len()));
            STANDARD.decode_vec(part, &mut bytes).map_err(|error| format!("base64: {error}"))?;
            rest = after;
        }
        Ok(Self::new(Cow::Owned(bytes)))
    }

    /// The same bytes with headers of this type and byte order.
    pub(crate) fn with_header(self, scalar: Scalar, endian: Endian) -> Self {
        Self { header: (scalar, endian), ..self }
    }

    fn take(&mut self, count: usize) -> Result<&[u8], String> {
        let left = self.bytes.len() - self.at;
        if count > left {
            return Err(format!("the data break off: {count} bytes are expected, {left} are left"));
        }
        self.at += count;
        Ok(&self.bytes[self.at - count..self.at])
    }

    fn header_number(&mut self) -> Result<usize, String> {
        let (scalar, endian) = self.header;
        let bytes = self.take(scalar.size())?;
        let number = match scalar {
            Scalar::U64 => crate::scalar::numbers(bytes, endian, u64::from_le_bytes).next(),
            _ => crate::scalar::numbers(bytes, endian, u32::from_le_bytes).next().map(u64::from),
        };
        number.and_then(|n| usize::try_from(n).ok()).ok_or_else(|| "a header number is too large".into())
    }

    /// An uncompressed array of `expected` bytes.
    pub(crate) fn uncompressed(mut self, expected: usize) -> Result<Cow<'a, [u8]>, String> {
        let declared = self.header_number()?;
        check(declared, expected)?;
        let start = self.at;
        self.take(expected)?;
        Ok(match self.bytes {
            Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[start..self.at]),
            Cow::Owned(mut bytes) => {
                bytes.truncate(self.at);
                bytes.drain(..start);
                Cow::Owned(bytes)
            }
        })
    }

    /// An array of `expected` bytes in zlib blocks.
    pub(crate) fn zlib_blocks(mut self, expected: usize) -> Result<Vec<u8>, String> {
        let (blocks, size, last) = (self.header_number()?, self.header_number()?, self.header_number()?);
        let whole = if last > 0 { blocks.saturating_sub(1) } else { blocks };
        check(whole.saturating_mul(size).saturating_add(last), expected)?;
        // Each block's compressed size is still to come.
        if blocks > (self.bytes.len() - self.at) / self.header.0.size() {
            return Err(format!("the data break off: {blocks} blocks are declared"));
        }
        let compressed: Vec<usize> = (0..blocks).map(|_| self.header_number()).collect::<Result<_, _>>()?;
        let mut bytes = Vec::new();
        for (index, &count) in compressed.iter().enumerate() {
            let size = if index < whole { size } else { last };
            let in_block = |problem| format!("block {index} of {blocks}: {problem}");
            let block = self.take(count).map_err(in_block)?;
            bytes.extend(inflate::zlib(block, size).map_err(in_block)?);
        }
        check(bytes.len(), expected)?;
        Ok(bytes)
    }
}

fn check(declared: usize, expected: usize) -> Result<(), String> {
    if declared == expected {
        Ok(())
    } else {
        Err(format!("the array declares {declared} bytes; the extent and type need {expected}"))
    }
}
