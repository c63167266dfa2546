//! Stored numbers of a DICOM file's one frame: NEMA PS3.5, section 8 and annexes A.4 and G.

use crate::Endian;
use crate::decoder;
use crate::file::File;
use crate::scalar::numbers;
use crate::volumes::dicom_data_set::{DataSet, Packing};
use crate::{ImportError, Place};
use image::{ImageDecoder, ImageFormat};
use std::borrow::Cow;

const SAMPLES: u32 = 0x0028_0002;
const PHOTOMETRIC: u32 = 0x0028_0004;
const FRAMES: u32 = 0x0028_0008;
const ROWS: u32 = 0x0028_0010;
const COLUMNS: u32 = 0x0028_0011;
const BITS_ALLOCATED: u32 = 0x0028_0100;
const BITS_STORED: u32 = 0x0028_0101;
const HIGH_BIT: u32 = 0x0028_0102;
const REPRESENTATION: u32 = 0x0028_0103;
const PADDING: u32 = 0x0028_0120;
const PADDING_LIMIT: u32 = 0x0028_0121;

/// Samples that a byte can hold at most: RLE writes 128 with two, and JPEG 64 with a bit.
const EXPANSION_LIMIT: usize = 1032;

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pixels {
    pub(super) columns: u16,
    pub(super) rows: u16,
    /// Bits that count.
    pub(super) bits: u16,
    pub(super) signed: bool,
    /// MONOCHROME1.
    pub(super) inverted: bool,
}

/// A file's frame and the values of its stored numbers, row by row; NaN where they are padding.
pub(super) fn read(
    file: &File,
    set: &DataSet,
    value: impl Fn(i32) -> f32,
) -> Result<(Pixels, Vec<f32>), ImportError> {
    let part = |name: &str| Place::Part(name.into());
    let short = |tag, name: &str| {
        let missing = || file.malformed(part(name), "it is missing");
        set.short(tag).ok_or_else(missing)
    };
    let unsupported = |name: &str, feature: String| Err(file.unsupported(part(name), feature));
    if set.pixels.is_empty() {
        return unsupported("PixelData", "it is missing: the file holds no image".into());
    }
    let photometric = set.text(PHOTOMETRIC).unwrap_or_default();
    let samples = set.short(SAMPLES).unwrap_or(1);
    if samples != 1 || !matches!(photometric.as_str(), "MONOCHROME1" | "MONOCHROME2") {
        let feature = format!(
            "{photometric:?} of {samples} samples a pixel; MONOCHROME1 and MONOCHROME2 of one are read"
        );
        return unsupported("PhotometricInterpretation", feature);
    }
    let frames = set.text(FRAMES).unwrap_or_else(|| "1".into());
    if frames != "1" {
        return unsupported("NumberOfFrames", format!("{frames} frames in one file; one in each is read"));
    }
    let (columns, rows) = (short(COLUMNS, "Columns")?, short(ROWS, "Rows")?);
    if columns == 0 || rows == 0 {
        return Err(file.malformed(part("Rows"), format!("{columns}x{rows} pixels; each must be above 0")));
    }
    let allocated = short(BITS_ALLOCATED, "BitsAllocated")?;
    let bits = set.short(BITS_STORED).unwrap_or(allocated);
    if !matches!(allocated, 8 | 16) {
        return unsupported("BitsAllocated", format!("{allocated} bits; 8 and 16 are read"));
    }
    let high = set.short(HIGH_BIT).unwrap_or(bits.saturating_sub(1));
    if bits == 0 || bits > allocated || high != bits - 1 {
        let feature = format!("{bits} of {allocated} bits up to bit {high}; they must be the lowest");
        return unsupported("BitsStored", feature);
    }
    let signed = match set.short(REPRESENTATION).unwrap_or(0) {
        0 => false,
        1 => true,
        other => return Err(file.malformed(part("PixelRepresentation"), format!("{other}; it is 0 or 1"))),
    };
    let pixels = Pixels { columns, rows, bits, signed, inverted: photometric == "MONOCHROME1" };
    let count = usize::from(columns) * usize::from(rows);
    let size = usize::from(allocated / 8);
    let given: usize = set.pixels.iter().map(Vec::len).sum();
    if count / EXPANSION_LIMIT > given {
        let problem = format!("{given} bytes cannot hold {columns}x{rows} pixels");
        return Err(file.malformed(part("PixelData"), problem));
    }
    let bytes = match set.packing {
        Packing::Native => native(&set.pixels[0], count * size).map(Cow::Borrowed),
        Packing::Rle => rle(&set.pixels, count, size).map(Cow::Owned),
        Packing::Jpeg if size == 1 => jpeg(&set.pixels.concat(), [columns, rows]).map(Cow::Owned),
        Packing::Jpeg => Err("baseline JPEG has 8 bits a pixel".into()),
    };
    let bytes = bytes.map_err(|problem| file.malformed(part("PixelData"), problem))?;
    // What lies above the bits that count is no part of the number.
    let unused = 32 - u32::from(bits);
    let stored = |word: u16| {
        let shifted = u32::from(word) << unused;
        if signed { shifted.cast_signed() >> unused } else { (shifted >> unused).cast_signed() }
    };
    // Padding is a number as stored, or all from it to its limit.
    let padding = set.short(PADDING).map(|padding| {
        let ends = [padding, set.short(PADDING_LIMIT).unwrap_or(padding)].map(stored);
        ends[0].min(ends[1])..=ends[0].max(ends[1])
    });
    let number = |word: u16| {
        let stored = stored(word);
        if padding.as_ref().is_some_and(|padding| padding.contains(&stored)) {
            f32::NAN
        } else {
            value(stored)
        }
    };
    let endian = if set.packing == Packing::Native { set.endian } else { Endian::Little };
    let values = match size {
        1 => bytes.iter().map(|byte| number(u16::from(*byte))).collect(),
        _ => numbers(&bytes, endian, u16::from_le_bytes).map(number).collect(),
    };
    Ok((pixels, values))
}

/// Bytes as they are, filled up to an even number of them.
fn native(bytes: &[u8], expected: usize) -> Result<&[u8], String> {
    if bytes.len() == expected || bytes.len() == expected + expected % 2 {
        Ok(&bytes[..expected])
    } else {
        Err(format!("{} bytes; rows, columns and bits need {expected}", bytes.len()))
    }
}

/// Planes of bytes, the highest first, each run-length coded; as little-endian numbers.
fn rle(fragments: &[Vec<u8>], count: usize, size: usize) -> Result<Vec<u8>, String> {
    let [fragment] = fragments else {
        return Err(format!("RLE has {} fragments for one frame", fragments.len()));
    };
    // 16 numbers: how many segments there are, and where each begins.
    let Some((head, _)) = fragment.split_at_checked(64) else {
        return Err("RLE begins with 64 bytes on its segments".into());
    };
    let head: Vec<usize> =
        numbers(head, Endian::Little, u32::from_le_bytes).map(|number| number as usize).collect();
    if head[0] != size {
        return Err(format!("RLE of {} segments; {size} bytes a pixel need as many", head[0]));
    }
    let mut bytes = vec![0; count * size];
    for plane in 0..size {
        let start = head[1 + plane];
        let end = if plane + 1 < size { head[2 + plane] } else { fragment.len() };
        let segment = fragment.get(start..end).ok_or("a segment of RLE lies outside of its fragment")?;
        let unpacked = unpacked(segment, count)?;
        let place = size - 1 - plane;
        for (number, byte) in bytes[place..].iter_mut().step_by(size).zip(unpacked) {
            *number = byte;
        }
    }
    Ok(bytes)
}

/// `count` bytes of a segment, which is PackBits.
fn unpacked(mut segment: &[u8], count: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let broken = || "a segment of RLE breaks off".to_owned();
    while bytes.len() < count {
        let (&head, rest) = segment.split_first().ok_or_else(broken)?;
        segment = match head {
            0..=127 => {
                let (literal, after) = rest.split_at_checked(usize::from(head) + 1).ok_or_else(broken)?;
                bytes.extend_from_slice(literal);
                after
            }
            128 => rest,
            129.. => {
                let (&value, after) = rest.split_first().ok_or_else(broken)?;
                bytes.resize(bytes.len() + 257 - usize::from(head), value);
                after
            }
        };
    }
    if bytes.len() > count {
        return Err(format!("a segment of RLE has {} bytes; {count} are expected", bytes.len()));
    }
    Ok(bytes)
}

fn jpeg(bytes: &[u8], [columns, rows]: [u16; 2]) -> Result<Vec<u8>, String> {
    let problem = |error: image::ImageError| format!("JPEG: {error}");
    let most = EXPANSION_LIMIT as u64 * bytes.len() as u64 + (1 << 16);
    let decoder = decoder::reader(bytes, ImageFormat::Jpeg, most)?.into_decoder().map_err(problem)?;
    let (width, height) = decoder.dimensions();
    if decoder.color_type() != image::ColorType::L8 || [width, height] != [columns, rows].map(u32::from) {
        let found = format!("{width}x{height} samples of {:?}", decoder.color_type());
        return Err(format!("JPEG of {found}; {columns}x{rows} of L8 are expected"));
    }
    let mut samples = vec![0; usize::from(columns) * usize::from(rows)];
    decoder.read_image(&mut samples).map_err(problem)?;
    Ok(samples)
}
