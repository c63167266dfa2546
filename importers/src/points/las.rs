//! LAS and LAZ: points of laser scanners, versions 1.0 to 1.4, point formats 0 to 10.
//!
//! Source: *LAS Specification 1.4 – R15*, American Society for Photogrammetry and Remote Sensing, 2019.
//!
//! Read are, for each point:
//! - its place: the stored integers times the header's scale plus its offset, z up, in the unit of the file's coordinate
//!   reference system, which is not read;
//! - the intensity, as it is stored;
//! - red, green, blue of formats 2, 3, 5, 7, 8 and 10, as sRGB-encoded 16-bit values. Where none in the file is above 255, they are
//!   8-bit values, as some programs write them, which is noted. Where all are 0 there are no colours.
//!
//! Left out and counted are points that are withheld and those classified as noise (7; 18 too in formats 6 to 10). GPS times,
//! returns, scan angles, near infrared, waveforms and extra bytes are not read.
//!
//! The laszip compression of **LAZ** is undone by chunks, in the variants of formats 0 to 5 (pointwise, chunks of one size) and
//! of 6 to 10 (layered, also with chunks of various sizes as in COPC); it may unpack to no more than
//! [`OpenOptions::max_memory`].

use super::laz;
use super::{Gather, Has, Point};
use crate::Endian;
use crate::file::File;
use crate::scalar::Scalar;
use crate::{ImportError, Note, OpenOptions, Opened, Place};
use glam::DVec3;

/// Bytes of the records of each point format without extra bytes.
pub(super) const RECORD_SIZES: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Where colours begin in the records of each point format.
const COLORS: [Option<usize>; 11] =
    [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)];

/// What the header says of the points.
pub(super) struct Header {
    /// Bytes of the header itself, after which come the variable-length records.
    pub(super) size: usize,
    pub(super) records: usize,
    /// Where the points begin.
    pub(super) points: usize,
    pub(super) format: usize,
    pub(super) compressed: bool,
    pub(super) record_size: usize,
    pub(super) count: u64,
    scale: DVec3,
    offset: DVec3,
}

/// Reads a number of the header, which is there.
pub(super) fn number(file: &File, at: usize, scalar: Scalar) -> Result<f64, ImportError> {
    let bytes = file.bytes.get(at..).unwrap_or_default();
    let missing = || file.malformed(Place::Byte(at), "the file ends in the middle of its header");
    scalar.first(bytes, Endian::Little).ok_or_else(missing)
}

impl Header {
    fn parse(file: &File) -> Result<Self, ImportError> {
        let get = |at, scalar| number(file, at, scalar);
        let whole = |at, scalar| Ok::<_, ImportError>(get(at, scalar)? as usize);
        if !file.bytes.starts_with(b"LASF") {
            return Err(file.malformed(Place::Byte(0), "a LAS file begins with \"LASF\""));
        }
        let (major, minor) = (whole(24, Scalar::U8)?, whole(25, Scalar::U8)?);
        if major != 1 || minor > 4 {
            let feature = format!("LAS {major}.{minor} is not supported; 1.0 to 1.4 are");
            return Err(file.unsupported(Place::Byte(24), feature));
        }
        let size = whole(94, Scalar::U16)?;
        let least = [227, 227, 227, 235, 375][minor];
        if size < least {
            let problem = format!("a header of {size} bytes; LAS 1.{minor} has {least} at least");
            return Err(file.malformed(Place::Byte(94), problem));
        }
        // The two highest bits say that the points are compressed.
        let format_byte = whole(104, Scalar::U8)?;
        let format = format_byte & 0x3f;
        let record_size = whole(105, Scalar::U16)?;
        let Some(&least) = RECORD_SIZES.get(format) else {
            let feature = format!("point format {format} is not supported; 0 to 10 are");
            return Err(file.unsupported(Place::Byte(104), feature));
        };
        if record_size < least {
            let problem = format!(
                "records of {record_size} bytes; those of point format {format} have {least} at least"
            );
            return Err(file.malformed(Place::Byte(105), problem));
        }
        let vector = |at: usize| {
            let [x, y, z] = [get(at, Scalar::F64)?, get(at + 8, Scalar::F64)?, get(at + 16, Scalar::F64)?];
            Ok::<_, ImportError>(DVec3::new(x, y, z))
        };
        let (scale, offset) = (vector(131)?, vector(155)?);
        if !(scale.is_finite() && offset.is_finite()) || scale.to_array().contains(&0.0) {
            let problem = format!("scale {scale} and offset {offset} must be finite, and scales not 0");
            return Err(file.malformed(Place::Byte(131), problem));
        }
        let legacy = get(107, Scalar::U32)? as u64;
        let count = match (minor, file.bytes.get(247..255).and_then(|bytes| bytes.first_chunk::<8>())) {
            (4, Some(&bytes)) if bytes != [0; 8] => u64::from_le_bytes(bytes),
            _ => legacy,
        };
        let points = whole(96, Scalar::U32)?;
        if points < size || points > file.bytes.len() {
            let problem = format!(
                "points begin at byte {points}; it must be from {size}, the end of the header, to {}, that of the file",
                file.bytes.len()
            );
            return Err(file.malformed(Place::Byte(96), problem));
        }
        let records = whole(100, Scalar::U32)?;
        let compressed = format_byte & 0xc0 != 0;
        Ok(Self { size, records, points, format, compressed, record_size, count, scale, offset })
    }

    /// Bytes of all points.
    pub(super) fn points_size(&self) -> Option<usize> {
        usize::try_from(self.count).ok()?.checked_mul(self.record_size)
    }

    /// The points as they stand in a file that is not compressed.
    fn plain<'a>(&self, file: &'a File) -> Result<&'a [u8], ImportError> {
        let bytes = &file.bytes[self.points..];
        self.points_size().and_then(|size| bytes.get(..size)).ok_or_else(|| {
            let Self { count, record_size, points, .. } = self;
            let problem = format!(
                "{count} points of {record_size} bytes need more than the {} bytes that are left",
                bytes.len()
            );
            file.malformed(Place::Byte(*points), problem)
        })
    }
}

/// Reads a LAS or LAZ file.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let header = Header::parse(file)?;
    let unpacked;
    let records = if header.compressed {
        unpacked = laz::unpack(file, &header, options)?;
        &unpacked[..]
    } else {
        header.plain(file)?
    };
    let colors = COLORS[header.format];
    let has = Has { colors: colors.is_some(), intensities: true, ..Has::default() };
    let mut gather = Gather::new(records.len() / header.record_size, has);
    let (mut withheld, mut noise) = (0_usize, 0_usize);
    for record in records.chunks_exact(header.record_size) {
        let long = header.format >= 6;
        let class = if long { record[16] } else { record[15] & 0x1f };
        if record[15] & (if long { 0x04 } else { 0x80 }) != 0 {
            withheld += 1;
            continue;
        }
        if class == 7 || (long && class == 18) {
            noise += 1;
            continue;
        }
        let raw = |axis: usize| f64::from(i32::from_le_bytes(std::array::from_fn(|i| record[4 * axis + i])));
        let short = |at: usize| f32::from(u16::from_le_bytes([record[at], record[at + 1]]));
        gather.put(&Point {
            position: DVec3::new(raw(0), raw(1), raw(2)) * header.scale + header.offset,
            color: colors.map_or([0.0; 3], |at| [short(at), short(at + 2), short(at + 4)]),
            intensity: short(12),
            ..Point::default()
        });
    }
    for (count, what) in [(withheld, "that are withheld"), (noise, "that are classified as noise")] {
        if count > 0 {
            gather.notes.push(Note::LeftOut(format!("{count} of {} points, {what}", header.count)));
        }
    }
    let white = gather.white(&[0.0, 255.0, 65535.0]).filter(|white| *white > 0.0);
    if white == Some(255.0) {
        let what = "no colour is above 255: they are 8-bit values, though the format's have 16 bits";
        gather.notes.push(Note::Assumed(what.into()));
    }
    gather.decode_colors(white);
    gather.finish(file)
}
