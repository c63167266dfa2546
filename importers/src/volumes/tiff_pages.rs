//! What the directories of a TIFF file say, read before any sample is decoded: what they declare is compared with the
//! file's size, and a chain that comes back to itself is refused.
//!
//! Source: Adobe, *TIFF Revision 6.0*, 1992, sections 2, 8 and 19; BigTIFF as libtiff has it.

use crate::Endian;
use crate::file::File;
use crate::scalar::{Scalar, numbers};
use crate::{ImportError, Place};
use std::collections::HashSet;

/// Samples that a byte of the file can hold at most, where they are compressed: LZW's longest string has 4096 bytes and
/// takes more than a byte.
pub(super) const EXPANSION_LIMIT: u64 = 4096;

/// A page.
#[derive(Clone, Debug)]
pub(super) struct Page<'a> {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) scalar: Scalar,
    pub(super) compressed: bool,
    /// Whether it is of LZW in tiles of which some reach beyond its last column: most of these the decoder takes for cut off.
    pub(super) lzw_beyond: bool,
    pub(super) white_is_zero: bool,
    /// Whether it is a smaller copy of another page, or a mask of one.
    pub(super) auxiliary: bool,
    /// Whether its first row is not the upper one, or its first column not the left one.
    pub(super) turned: bool,
    pub(super) description: &'a [u8],
    /// Pixels in a unit of length, along x and y.
    pub(super) resolution: [Option<f64>; 2],
}

/// The tags that matter here.
mod tag {
    pub(super) const SUBFILE: u16 = 254;
    pub(super) const WIDTH: u16 = 256;
    pub(super) const HEIGHT: u16 = 257;
    pub(super) const BITS: u16 = 258;
    pub(super) const COMPRESSION: u16 = 259;
    pub(super) const PHOTOMETRIC: u16 = 262;
    pub(super) const FILL_ORDER: u16 = 266;
    pub(super) const DESCRIPTION: u16 = 270;
    pub(super) const ORIENTATION: u16 = 274;
    pub(super) const SAMPLES: u16 = 277;
    pub(super) const X_RESOLUTION: u16 = 282;
    pub(super) const Y_RESOLUTION: u16 = 283;
    pub(super) const TILE_WIDTH: u16 = 322;
    pub(super) const FORMAT: u16 = 339;
    pub(super) const ALL: [u16; 14] = [
        SUBFILE,
        WIDTH,
        HEIGHT,
        BITS,
        COMPRESSION,
        PHOTOMETRIC,
        FILL_ORDER,
        DESCRIPTION,
        ORIENTATION,
        SAMPLES,
        X_RESOLUTION,
        Y_RESOLUTION,
        TILE_WIDTH,
        FORMAT,
    ];
}

/// Reads numbers of either width in either byte order.
struct Reader<'a> {
    file: &'a File,
    endian: Endian,
    big: bool,
}

/// A field: its tag, type and value.
struct Entry<'a> {
    tag: u16,
    kind: u64,
    value: &'a [u8],
}

/// The pages, each checked by itself.
pub(super) fn pages(file: &File) -> Result<Vec<Page<'_>>, ImportError> {
    let (endian, big) = match file.bytes.get(..4) {
        Some(b"II*\0") => (Endian::Little, false),
        Some(b"MM\0*") => (Endian::Big, false),
        Some(b"II+\0") => (Endian::Little, true),
        Some(b"MM\0+") => (Endian::Big, true),
        _ => return Err(file.malformed(Place::Byte(0), "a TIFF begins with II*, MM* or their BigTIFF forms")),
    };
    let reader = Reader { file, endian, big };
    let mut next = reader.offset(if big { 8 } else { 4 })?;
    let (mut pages, mut seen) = (Vec::new(), HashSet::new());
    // Tables that overlap could be as many as the file has bytes, each as large as the file.
    let mut left = file.bytes.len();
    while next != 0 {
        if !seen.insert(next) {
            let problem = format!("page {} is followed by a page that was already there", pages.len());
            return Err(file.malformed(Place::Byte(next), problem));
        }
        let (entries, after) = reader.directory(next, &mut left)?;
        let page = reader.page(&entries, Place::Part(format!("page {}", pages.len() + 1)))?;
        pages.push(page);
        next = after;
    }
    if pages.is_empty() {
        return Err(file.malformed(Place::Byte(4), "it has no pages"));
    }
    Ok(pages)
}

impl<'a> Reader<'a> {
    fn bytes(&self, at: usize, count: usize) -> Result<&'a [u8], ImportError> {
        let found = at.checked_add(count).and_then(|end| self.file.bytes.get(at..end));
        found.ok_or_else(|| {
            let problem = format!("{count} bytes are to be here, but the file has {}", self.file.bytes.len());
            self.file.malformed(Place::Byte(at), problem)
        })
    }

    fn number(&self, bytes: &[u8]) -> u64 {
        match bytes.len() {
            1 => u64::from(bytes[0]),
            2 => numbers(bytes, self.endian, u16::from_le_bytes).map(u64::from).next().unwrap_or(0),
            4 => numbers(bytes, self.endian, u32::from_le_bytes).map(u64::from).next().unwrap_or(0),
            _ => numbers(bytes, self.endian, u64::from_le_bytes).next().unwrap_or(0),
        }
    }

    fn number_at(&self, at: usize, count: usize) -> Result<u64, ImportError> {
        Ok(self.number(self.bytes(at, count)?))
    }

    /// A place in the file. One that memory cannot name is one that the file doesn't have.
    fn offset(&self, at: usize) -> Result<usize, ImportError> {
        let offset = self.number_at(at, if self.big { 8 } else { 4 })?;
        Ok(usize::try_from(offset).unwrap_or(usize::MAX))
    }

    /// The fields of the directory at a place, and where the next one is. All tables together have `left` bytes.
    fn directory(&self, at: usize, left: &mut usize) -> Result<(Vec<Entry<'a>>, usize), ImportError> {
        let (head, size) = if self.big { (8, 20) } else { (2, 12) };
        let count = self.number_at(at, head)?;
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        let table = self.bytes(at + head, count.saturating_mul(size))?;
        *left = left.checked_sub(table.len()).ok_or_else(|| {
            self.file.malformed(Place::Byte(at), "its tables of fields overlap those of other pages")
        })?;
        let mut entries = Vec::new();
        for (index, entry) in table.chunks(size).enumerate() {
            let (tag, kind) = (self.number(&entry[..2]), self.number(&entry[2..4]));
            let (count, value) = entry[4..].split_at((size - 4) / 2);
            // BYTE ASCII SHORT LONG RATIONAL and the others in the order of their numbers.
            let Some(width) = [0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8].get(kind as usize)
            else {
                continue;
            };
            let length = self.number(count).saturating_mul(*width);
            let length = usize::try_from(length).unwrap_or(usize::MAX);
            let value = if length <= value.len() {
                &value[..length]
            } else {
                let from = at + head + index * size + size - value.len();
                self.bytes(self.offset(from)?, length)?
            };
            let tag = tag as u16;
            // A table may be as large as the file, and have a field many times: the first counts.
            if tag::ALL.contains(&tag) && entries.iter().all(|entry: &Entry<'_>| entry.tag != tag) {
                entries.push(Entry { tag, kind, value });
            }
        }
        Ok((entries, self.offset(at + head + count * size)?))
    }

    /// What the fields say, where samples are of a kind that is read.
    fn page(&self, entries: &[Entry<'a>], place: Place) -> Result<Page<'a>, ImportError> {
        let file = self.file;
        let field = |tag| entries.iter().find(|entry| entry.tag == tag && !entry.value.is_empty());
        // The first value of an integer field.
        let integer = |tag| -> Option<u64> {
            let entry = field(tag)?;
            let width = match entry.kind {
                1 => 1,
                3 => 2,
                4 => 4,
                16 => 8,
                _ => return None,
            };
            Some(self.number(&entry.value[..width]))
        };
        let size = |tag, name: &str| {
            let found = integer(tag).and_then(|n| u32::try_from(n).ok()).filter(|n| *n > 0);
            found.ok_or_else(|| file.malformed(place.clone(), format!("it has no {name} above 0")))
        };
        let unsupported = |feature: String| Err(file.unsupported(place.clone(), feature));
        let (width, height) = (size(tag::WIDTH, "ImageWidth")?, size(tag::HEIGHT, "ImageLength")?);
        let photometric = integer(tag::PHOTOMETRIC);
        let samples = integer(tag::SAMPLES).unwrap_or(1);
        if !matches!(photometric, Some(0 | 1)) || samples != 1 {
            let name = match photometric {
                Some(0 | 1) => "greyscale",
                Some(2) => "RGB",
                Some(3) => "a palette",
                Some(4) => "a mask",
                Some(5) => "CMYK",
                Some(6) => "YCbCr",
                Some(8) => "CIE L*a*b*",
                _ => "an unknown colour space",
            };
            let each = if samples == 1 { String::new() } else { format!(" of {samples} samples a pixel") };
            return unsupported(format!("{name}{each}; greyscale of one sample a pixel is read"));
        }
        let (bits, format) = (integer(tag::BITS).unwrap_or(1), integer(tag::FORMAT).unwrap_or(1));
        let scalar = match (format, bits) {
            (1, 8) => Scalar::U8,
            (1, 16) => Scalar::U16,
            (1, 32) => Scalar::U32,
            (1, 64) => Scalar::U64,
            (2, 8) => Scalar::I8,
            (2, 16) => Scalar::I16,
            (2, 32) => Scalar::I32,
            (2, 64) => Scalar::I64,
            (3, 32) => Scalar::F32,
            (3, 64) => Scalar::F64,
            _ => {
                return unsupported(format!(
                    "{bits} bits of SampleFormat {format}; integers (1, 2) of 8, 16, 32 or 64 bits and floating point \
                     (3) of 32 or 64 are read"
                ));
            }
        };
        let unsigned = format == 1;
        if photometric == Some(0) && !unsigned {
            return unsupported(format!("white is 0 in {scalar:?}; that is read of unsigned integers"));
        }
        if integer(tag::FILL_ORDER).is_some_and(|order| order != 1) {
            return unsupported("FillOrder 2, bytes whose lowest bit is first; 1 is read".into());
        }
        let compression = integer(tag::COMPRESSION).unwrap_or(1);
        let compressed = compression != 1;
        if !matches!(compression, 1 | 5 | 8 | 32946 | 32773) {
            let name = match compression {
                2..=4 => "fax",
                6 | 7 => "JPEG",
                33003 | 33005 | 34712 => "JPEG 2000",
                34887 => "LERC",
                34925 => "LZMA",
                50000 => "Zstandard",
                50001 => "WebP",
                50002 => "JPEG XL",
                _ => "an unknown one",
            };
            return unsupported(format!(
                "compression {compression}, {name}; none (1), LZW (5), deflate (8) and PackBits (32773) are read"
            ));
        }
        let bytes = (u64::from(width) * u64::from(height)).saturating_mul(scalar.size() as u64);
        let length = file.bytes.len() as u64;
        let most = if compressed { length.saturating_mul(EXPANSION_LIMIT) } else { length };
        if bytes > most {
            let problem = format!("{width}x{height} samples need {bytes} bytes; the file has {length}");
            return Err(file.malformed(place, problem));
        }
        let ratio = |tag| {
            let entry = field(tag).filter(|entry| entry.kind == 5)?;
            let ratio = self.number(&entry.value[..4]) as f64 / self.number(&entry.value[4..8]) as f64;
            Some(ratio).filter(|ratio| ratio.is_finite() && *ratio > 0.0)
        };
        Ok(Page {
            width,
            height,
            scalar,
            compressed,
            lzw_beyond: compression == 5
                && integer(tag::TILE_WIDTH).is_some_and(|tile| tile > 0 && u64::from(width) % tile != 0),
            white_is_zero: photometric == Some(0),
            auxiliary: integer(tag::SUBFILE).is_some_and(|kind| kind & 0b101 != 0),
            turned: integer(tag::ORIENTATION).is_some_and(|orientation| orientation != 1),
            description: field(tag::DESCRIPTION).map_or(&[], |entry| entry.value),
            resolution: [ratio(tag::X_RESOLUTION), ratio(tag::Y_RESOLUTION)],
        })
    }
}
