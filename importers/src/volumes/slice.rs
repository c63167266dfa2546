//! One slice of a series: a greyscale image.
//!
//! PNG and JPEG of 8 or 16 bits; PGM (P5, P2) with its numbers as they are, whatever its largest value; TIFF of one page as
//! [`super::tiff`] reads it. Colour, palettes, transparency and fewer than 8 bits are refused.

use crate::file::File;
use crate::scalar::Scalar;
use crate::volumes::tiff;
use crate::volumes::voxels::Layout;
use crate::{Endian, ImportError, Note, Place};
use image::{ExtendedColorType, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::io::Cursor;

/// Bytes of samples that a byte of a PNG or JPEG can hold at most: deflate's 258 for two bits, and less in JPEG.
const EXPANSION_LIMIT: u64 = 1032;

/// What decoders may allocate for a small image, in bytes.
const LEAST_ALLOC: u64 = 1 << 16;

/// The samples of a slice; `layout` says how they lie, with one sample along z.
pub(super) struct Slice {
    pub(super) layout: Layout,
    pub(super) bytes: Vec<u8>,
    pub(super) notes: Vec<Note>,
}

/// Reads an image; `None` of a file that isn't one.
pub(super) fn read(file: &File, max_memory: u64) -> Result<Option<Slice>, ImportError> {
    match &file.bytes[..file.bytes.len().min(4)] {
        [0x89, b'P', b'N', b'G'] => decoded(file, ImageFormat::Png).map(Some),
        [0xff, 0xd8, 0xff, _] => decoded(file, ImageFormat::Jpeg).map(Some),
        [b'P', b'2' | b'5', white, _] if white.is_ascii_whitespace() => pgm(file).map(Some),
        b"II*\0" | b"MM\0*" | b"II+\0" | b"MM\0+" => {
            let stack = tiff::stack(file, max_memory)?;
            if stack.layout.dims[2] > 1 {
                let feature = format!("{} pages, but one slice of a series has one", stack.layout.dims[2]);
                return Err(file.unsupported(Place::Whole, feature));
            }
            Ok(Some(Slice { layout: stack.layout, bytes: stack.bytes, notes: stack.notes }))
        }
        _ => Ok(None),
    }
}

fn decoded(file: &File, format: ImageFormat) -> Result<Slice, ImportError> {
    let problem =
        |error: image::ImageError| file.malformed(Place::Whole, format!("it cannot be decoded: {error}"));
    let length = file.bytes.len() as u64;
    let mut limits = Limits::default();
    limits.max_alloc = Some((EXPANSION_LIMIT * length).max(LEAST_ALLOC));
    let mut reader = ImageReader::with_format(Cursor::new(&file.bytes[..]), format);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(problem)?;
    let (width, height) = decoder.dimensions();
    let scalar = match (decoder.color_type().into(), decoder.original_color_type()) {
        (ExtendedColorType::L8, ExtendedColorType::L8) => Scalar::U8,
        (ExtendedColorType::L16, ExtendedColorType::L16) => Scalar::U16,
        (_, original) => {
            let feature = format!("samples are {original:?}; slices are greyscale of 8 or 16 bits (L8, L16)");
            return Err(file.unsupported(Place::Whole, feature));
        }
    };
    if decoder.total_bytes() > EXPANSION_LIMIT * length {
        let problem = format!("{length} bytes cannot hold {width}x{height} samples");
        return Err(file.malformed(Place::Whole, problem));
    }
    let dims = [width as usize, height as usize, 1];
    let endian = if cfg!(target_endian = "big") { Endian::Big } else { Endian::Little };
    let layout = Layout { dims, scalar, endian };
    let mut bytes = vec![0; layout.bytes(file)?];
    decoder.read_image(&mut bytes).map_err(problem)?;
    Ok(Slice { layout, bytes, notes: Vec::new() })
}

/// Portable grey map: *PGM Format Specification*, netpbm.sourceforge.net.
fn pgm(file: &File) -> Result<Slice, ImportError> {
    let mut at = 2;
    let mut number = |name: &str| {
        loop {
            let rest = &file.bytes[at..];
            let white = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
            at += white;
            if file.bytes.get(at) != Some(&b'#') {
                break;
            }
            let comment = &file.bytes[at..];
            at += comment.iter().position(|&b| b == b'\n').unwrap_or(comment.len());
        }
        let rest = &file.bytes[at..];
        let digits = rest.iter().position(|b| !b.is_ascii_digit()).unwrap_or(rest.len());
        let value = str::from_utf8(&rest[..digits]).ok().and_then(|digits| digits.parse::<u32>().ok());
        let found = value.filter(|value| *value > 0 && digits < rest.len());
        let problem = || file.malformed(Place::Byte(at), format!("a PGM has a {name} above 0 here"));
        let found = found.ok_or_else(problem)?;
        at += digits;
        Ok(found)
    };
    let (width, height) = (number("width")?, number("height")?);
    let most = number("largest value")?;
    // One white space ends the header.
    let body = &file.bytes[at + 1..];
    let scalar = match most {
        ..=255 => Scalar::U8,
        256..=65535 => Scalar::U16,
        _ => {
            let problem = format!("the largest value is {most}; it is at most 65535");
            return Err(file.malformed(Place::Byte(at), problem));
        }
    };
    let is_text = file.bytes[1] == b'2';
    let endian = if is_text { Endian::Little } else { Endian::Big };
    let layout = Layout { dims: [width as usize, height as usize, 1], scalar, endian };
    let expected = layout.bytes(file)?;
    let bytes = if is_text {
        layout.bytes_from_text(file, body)?
    } else if body.len() == expected {
        body.to_vec()
    } else {
        let problem = format!("{} bytes of samples; {width}x{height} need {expected}", body.len());
        return Err(file.malformed(Place::Byte(at + 1), problem));
    };
    Ok(Slice { layout, bytes, notes: Vec::new() })
}
