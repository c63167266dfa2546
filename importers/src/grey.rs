//! A greyscale picture whose numbers are measurements: a slice of a series, or a depth map.
//!
//! PNG and JPEG of 8 or 16 bits; PGM (P5, P2) with its numbers as they are, whatever its largest value; TIFF of one page as
//! [`crate::volumes::tiff`] reads it. Colour, palettes, transparency and fewer than 8 bits are refused.

use crate::decoder;
use crate::file::File;
use crate::inflate;
use crate::pnm;
use crate::scalar::Scalar;
use crate::volumes::tiff;
use crate::volumes::voxels::Layout;
use crate::{Endian, ImportError, Note, Place};
use image::{ExtendedColorType, ImageDecoder, ImageFormat};

/// Bytes of samples that a byte of a PNG or JPEG can hold at most: deflate's 258 for two bits, and less in JPEG.
const EXPANSION_LIMIT: u64 = 1032;

/// What decoders may allocate for a small image, in bytes.
const LEAST_ALLOC: u64 = 1 << 16;

/// The samples of a picture; `layout` says how they lie, with one sample along z.
pub(crate) struct Grey {
    pub(crate) layout: Layout,
    pub(crate) bytes: Vec<u8>,
    pub(crate) notes: Vec<Note>,
}

/// How numbers of the machine's own byte order lie.
pub(crate) const NATIVE: Endian = if cfg!(target_endian = "big") { Endian::Big } else { Endian::Little };

/// Reads a picture that unpacks to `max_memory` bytes at most; `None` of a file that isn't one.
pub(crate) fn read(file: &File, max_memory: u64) -> Result<Option<Grey>, ImportError> {
    match &file.bytes[..file.bytes.len().min(4)] {
        // The decoder stretches fewer bits to 8 and says nothing of it.
        [0x89, b'P', b'N', b'G'] if matches!(file.bytes.get(24..26), Some([1 | 2 | 4, 0])) => {
            let feature = format!("{} bits a sample; 8 or 16 of grey are needed", file.bytes[24]);
            Err(file.unsupported(Place::Whole, feature))
        }
        [0x89, b'P', b'N', b'G'] => decoded(file, ImageFormat::Png, max_memory).map(Some),
        [0xff, 0xd8, 0xff, _] => decoded(file, ImageFormat::Jpeg, max_memory).map(Some),
        [b'P', b'2' | b'5', white, _] if white.is_ascii_whitespace() => {
            let map = pnm::read(file)?;
            Ok(Some(Grey { layout: map.layout, bytes: map.bytes, notes: Vec::new() }))
        }
        b"II*\0" | b"MM\0*" | b"II+\0" | b"MM\0+" => {
            let stack = tiff::stack(file, max_memory)?;
            if stack.layout.dims[2] > 1 {
                let feature = format!("{} pages, but a picture has one", stack.layout.dims[2]);
                return Err(file.unsupported(Place::Whole, feature));
            }
            Ok(Some(Grey { layout: stack.layout, bytes: stack.bytes, notes: stack.notes }))
        }
        _ => Ok(None),
    }
}

fn decoded(file: &File, format: ImageFormat, max_memory: u64) -> Result<Grey, ImportError> {
    let problem =
        |error: image::ImageError| file.malformed(Place::Whole, format!("it cannot be decoded: {error}"));
    let length = file.bytes.len() as u64;
    let reader = decoder::reader(&file.bytes, format, (EXPANSION_LIMIT * length).max(LEAST_ALLOC))
        .map_err(|problem| file.malformed(Place::Whole, problem))?;
    let decoder = reader.into_decoder().map_err(problem)?;
    let (width, height) = decoder.dimensions();
    let scalar = match (decoder.color_type().into(), decoder.original_color_type()) {
        (ExtendedColorType::L8, ExtendedColorType::L8) => Scalar::U8,
        (ExtendedColorType::L16, ExtendedColorType::L16) => Scalar::U16,
        (_, original) => {
            let feature = format!("samples are {original:?}; greyscale of 8 or 16 bits (L8, L16) is needed");
            return Err(file.unsupported(Place::Whole, feature));
        }
    };
    if decoder.total_bytes() > EXPANSION_LIMIT * length {
        let problem = format!("{length} bytes cannot hold {width}x{height} samples");
        return Err(file.malformed(Place::Whole, problem));
    }
    if decoder.total_bytes() > max_memory {
        return Err(file.malformed(Place::Whole, inflate::over_limit(max_memory)));
    }
    let dims = [width as usize, height as usize, 1];
    let layout = Layout { dims, scalar, endian: NATIVE };
    let mut bytes = vec![0; layout.bytes(file)?];
    decoder.read_image(&mut bytes).map_err(problem)?;
    Ok(Grey { layout, bytes, notes: Vec::new() })
}
