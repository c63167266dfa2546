//! Netpbm's maps: PGM (P2, P5) and PPM (P3, P6).
//!
//! Source: Poskanzer, *PGM Format Specification* and *PPM Format Specification*, netpbm.sourceforge.net.

use crate::file::File;
use crate::scalar::Scalar;
use crate::volumes::voxels::Layout;
use crate::{Endian, ImportError, Place};

/// The numbers of a map as they stand, whatever the largest is said to be.
pub(crate) struct Map {
    /// Channels lie side by side along x.
    pub(crate) layout: Layout,
    pub(crate) bytes: Vec<u8>,
    /// 1 or 3.
    pub(crate) channels: usize,
    /// Which number is white: at most 65535.
    pub(crate) white: u32,
}

/// Whether bytes begin as those of a map.
pub(crate) fn begins(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'2' | b'3' | b'5' | b'6', white, ..] if white.is_ascii_whitespace())
}

/// Reads a file that [`begins`] as a map.
pub(crate) fn read(file: &File) -> Result<Map, ImportError> {
    let mut words = Words { file, at: 2 };
    let (width, height) = (words.count("width")?, words.count("height")?);
    let white = words.count("largest value")?;
    let scalar = match white {
        ..=255 => Scalar::U8,
        256..=65535 => Scalar::U16,
        _ => {
            let problem = format!("the largest value is {white}; it is at most 65535");
            return Err(file.malformed(Place::Byte(words.at), problem));
        }
    };
    let body = words.body();
    let is_text = matches!(file.bytes[1], b'2' | b'3');
    let channels = if matches!(file.bytes[1], b'3' | b'6') { 3 } else { 1 };
    let endian = if is_text { Endian::Little } else { Endian::Big };
    // Counts have 32 bits.
    let row = (width as usize).saturating_mul(channels);
    let layout = Layout { dims: [row, height as usize, 1], scalar, endian };
    let expected = layout.bytes(file)?;
    let bytes = if is_text {
        layout.bytes_from_text(file, body)?
    } else if body.len() == expected {
        body.to_vec()
    } else {
        let problem = format!("{} bytes of samples; {width}x{height} need {expected}", body.len());
        return Err(file.malformed(Place::Byte(file.bytes.len() - body.len()), problem));
    };
    Ok(Map { layout, bytes, channels, white })
}

/// The words of a header.
pub(crate) struct Words<'a> {
    pub(crate) file: &'a File,
    /// Where the next one is looked for.
    pub(crate) at: usize,
}

impl<'a> Words<'a> {
    /// The next word of a header, between white space and behind comments; what follows it must be there.
    pub(crate) fn word(&mut self) -> Option<&'a str> {
        let bytes = &self.file.bytes;
        loop {
            let rest = &bytes[self.at..];
            self.at += rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
            if bytes.get(self.at) != Some(&b'#') {
                break;
            }
            let comment = &bytes[self.at..];
            self.at += comment.iter().position(|&b| b == b'\n').unwrap_or(comment.len());
        }
        let rest = &bytes[self.at..];
        let length = rest.iter().position(|b| b.is_ascii_whitespace() || *b == b'#')?;
        let word = str::from_utf8(&rest[..length]).ok();
        self.at += length;
        word
    }

    /// A whole number above 0.
    pub(crate) fn count(&mut self, name: &str) -> Result<u32, ImportError> {
        let value = self.word().and_then(|word| word.parse().ok()).filter(|value| *value > 0);
        let problem = || format!("the header has a {name} above 0 before here");
        value.ok_or_else(|| self.file.malformed(Place::Byte(self.at), problem()))
    }

    /// What follows the one white space that ends a header.
    pub(crate) fn body(&self) -> &'a [u8] {
        self.file.bytes.get(self.at + 1..).unwrap_or_default()
    }
}
