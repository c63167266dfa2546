//! Portable float maps: Debevec, *PFM Portable FloatMap Image Format*, pauldebevec.com/Research/HDR/PFM.

use crate::file::File;
use crate::grey::Grey;
use crate::pnm::Words;
use crate::scalar::Scalar;
use crate::volumes::voxels::Layout;
use crate::{Endian, ImportError, Note, Place};

/// Whether bytes begin as those of a map, of one channel or three.
pub(super) fn begins(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'f' | b'F', white, ..] if white.is_ascii_whitespace())
}

/// Reads a file that [`begins`] as a map: after it the rows go from top to bottom.
pub(super) fn read(file: &File) -> Result<Grey, ImportError> {
    if file.bytes[1] == b'F' {
        let feature = "a PFM of colours (PF); a depth map has one channel (Pf)";
        return Err(file.unsupported(Place::Whole, feature));
    }
    let mut words = Words { file, at: 2 };
    let (width, height) = (words.count("width")?, words.count("height")?);
    let scale = words.word().and_then(|word| word.parse().ok());
    let Some(scale) = scale.filter(|scale: &f64| scale.is_finite() && *scale != 0.0) else {
        let problem = "the header has a scale before here, which is not 0; below 0 it says little-endian";
        return Err(file.malformed(Place::Byte(words.at), problem));
    };
    let endian = if scale < 0.0 { Endian::Little } else { Endian::Big };
    let layout = Layout { dims: [width as usize, height as usize, 1], scalar: Scalar::F32, endian };
    let (body, expected) = (words.body(), layout.bytes(file)?);
    if body.len() != expected {
        let problem = format!("{} bytes of samples; {width}x{height} need {expected}", body.len());
        return Err(file.malformed(Place::Byte(file.bytes.len() - body.len()), problem));
    }
    let mut bytes = Vec::with_capacity(expected);
    body.chunks(expected / layout.dims[1]).rev().for_each(|row| bytes.extend_from_slice(row));
    let mut notes = Vec::new();
    if scale.abs() != 1.0 {
        notes.push(Note::LeftOut(format!("the scale {} of its header", scale.abs())));
    }
    Ok(Grey { layout, bytes, notes })
}
