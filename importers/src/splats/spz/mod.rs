//! SPZ, versions 1 to 4: splats in about 20 bytes each.
//!
//! Niantic Labs, *spz*, <https://github.com/nianticlabs/spz>, its README and sources, 2026. All numbers are
//! little-endian. A header tells the number of splats, the degree of harmonics, fractional bits and flags; after it come
//! columns, one after another: positions, alphas, colours, log scales, rotations, harmonics.
//!
//! | version | packing | positions | rotations |
//! |---|---|---|---|
//! | 1 | gzip | half precision | x y z, 8 bits each; w ≥ 0 follows |
//! | 2 | gzip | 24 bits, signed, fixed point | as in 1 |
//! | 3 | gzip | as in 2 | the three smallest of x y z w, 10 bits each |
//! | 4 | a plain header, a table of sizes, a Zstandard frame for each column | as in 2 | as in 3 |
//!
//! Versions 1 to 3 without gzip are read too. Opacities are 8 bits, colours 8 bits of 0.15 · coefficient + 0.5, log
//! scales v / 16 − 10, harmonics (v − 128) / 128 with the colour channel varying fastest. Degree 4 is left out.
//!
//! **Axes**: the format's are right, up, back; splats come out on those of a 3DGS .ply of the same scene, right, down,
//! ahead, as the reference converts them. The extension `SPZ_ADOBE_coordinate_system` may name other axes, of which those
//! turned about x (numbers 9 to 16) are refused: names and transforms of the reference do not agree on them. Other
//! extensions are left out.
//!
//! **Flags**: antialiased is [`OpacityFilter::Compensated`].

mod axes;
mod columns;

pub(crate) use axes::Axes;
pub(crate) use columns::COLOR_SCALE;

use super::packed::{le, within};
use super::{ROWS, Training, gather};
use crate::file::File;
use crate::inflate;
use crate::{ImportError, Note, OpenOptions, Opened, Place};
use columns::Columns;
use oblate_engine::{Blend, OpacityFilter};
use rayon::prelude::*;
use std::borrow::Cow;

pub(crate) const MAGIC: &[u8] = b"NGSP";
/// Bytes of the header before version 4, and since.
const HEADER: usize = 16;
const LONG_HEADER: usize = 32;
pub(crate) const ANTIALIASED: u8 = 1;
const EXTENSIONS: u8 = 2;
const COORDINATE_SYSTEM: u32 = 0xADBE_0003;

/// What all versions say first.
#[derive(Debug)]
struct Header {
    version: u32,
    count: usize,
    degree: u8,
    fractional_bits: u8,
    flags: u8,
}

/// Columns, each by itself or all one after another, and extensions.
struct Unpacked<'a> {
    header: Header,
    columns: Vec<Cow<'a, [u8]>>,
    extensions: Cow<'a, [u8]>,
}

/// Whether a file begins as SPZ does, or unpacks to one.
pub(crate) fn begins(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
        || (bytes.starts_with(&inflate::GZIP) && inflate::gzip_beginning(bytes, MAGIC.len()) == MAGIC)
}

/// Reads the file.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let Unpacked { header, columns, extensions } = unpack(file, options)?;
    let mut whole = columns.iter().map(Cow::as_ref);
    let mut rest: &[u8] = &[];
    let slices = header.sizes().map(|size| {
        if rest.is_empty() && size > 0 {
            rest = whole.next().unwrap_or_default();
        }
        // Sizes were compared when unpacking.
        rest.split_off(..size as usize).unwrap_or_default()
    });
    let [positions, alphas, colors, scales, rotations, harmonics] = slices;
    let training = header.training();
    let columns = Columns { header: &header, positions, alphas, colors, scales, rotations, harmonics };
    let mut notes = Vec::new();
    let axes = header.axes(file, &extensions, &mut notes)?;
    if header.degree > training.degree {
        notes.push(Note::LeftOut("harmonics of degree 4; those up to degree 3 are read".into()));
    }
    let per_splat = training.per_splat();
    let mut opened = gather(file, (header.count, ROWS), training, |range, sink| {
        for index in range {
            let mut splat = columns.splat(index, per_splat);
            axes.apply(&mut splat);
            sink.put(&splat);
        }
        Ok(())
    })?;
    opened.notes.extend(notes);
    Ok(opened)
}

fn unpack<'a>(file: &'a File, options: &OpenOptions) -> Result<Unpacked<'a>, ImportError> {
    let bytes = &file.bytes;
    let compressed = bytes.starts_with(&inflate::GZIP);
    let beginning = if compressed { inflate::gzip_beginning(bytes, HEADER) } else { Vec::new() };
    let header = Header::new(file, if compressed { &beginning } else { bytes })?;
    let body: u64 = header.sizes().iter().sum();
    within(options.max_memory, file, body, (header.count, header.training()))?;
    if header.version == 4 && !compressed {
        return streams(file, header);
    }
    let wrong = |problem| file.malformed(Place::Whole, problem);
    let all = HEADER as u64 + body;
    let mut bytes = if !compressed {
        Cow::Borrowed(&bytes[..])
    } else if header.flags & EXTENSIONS == 0 {
        let all = usize::try_from(all).map_err(|_| wrong(inflate::over_limit(options.max_memory)))?;
        Cow::Owned(inflate::gunzip(bytes, all).map_err(wrong)?)
    } else {
        // Nothing says how long extensions are.
        Cow::Owned(inflate::gunzip_all(bytes, options.max_memory).map_err(wrong)?)
    };
    if (bytes.len() as u64) < all {
        let (count, found) = (header.count, bytes.len());
        return Err(wrong(format!("{count} splats need {all} bytes with the header; there are {found}")));
    }
    let split = |bytes: &mut Cow<'a, [u8]>, at: usize| match bytes {
        Cow::Borrowed(slice) => Cow::Borrowed(slice.split_off(at..).unwrap_or_default()),
        Cow::Owned(owned) => Cow::Owned(owned.split_off(at)),
    };
    let extensions = split(&mut bytes, all as usize);
    if header.flags & EXTENSIONS == 0 && !extensions.is_empty() {
        return Err(wrong(format!("{} bytes are left behind its splats", extensions.len())));
    }
    let body = split(&mut bytes, HEADER);
    Ok(Unpacked { header, columns: vec![body], extensions })
}

/// Unpacks a file of version 4.
fn streams(file: &File, header: Header) -> Result<Unpacked<'_>, ImportError> {
    let bytes = &file.bytes;
    let wrong = |at: usize, problem: String| file.malformed(Place::Byte(at), problem);
    let (Some(&streams), Some(table)) = (bytes.get(15), le(bytes, 16, u32::from_le_bytes)) else {
        return Err(wrong(0, format!("the header has {LONG_HEADER} bytes; there are {}", bytes.len())));
    };
    let table = table as usize;
    let sizes: Vec<u64> = header.sizes().into_iter().filter(|size| *size > 0).collect();
    if usize::from(streams) != sizes.len() {
        let problem = format!("there are {streams} streams; these splats need {}", sizes.len());
        return Err(wrong(15, problem));
    }
    let end = table + 16 * sizes.len();
    if table < LONG_HEADER || end > bytes.len() {
        let problem = format!(
            "the table of streams is at byte {table}; it must be behind the header, within the file's {} bytes",
            bytes.len()
        );
        return Err(wrong(16, problem));
    }
    let mut compressed = Vec::new();
    let mut rest = &bytes[end..];
    for (number, wanted) in sizes.iter().enumerate() {
        let at = table + 16 * number;
        let size = le(bytes, at, u64::from_le_bytes).unwrap_or_default();
        let unpacked = le(bytes, at + 8, u64::from_le_bytes).unwrap_or_default();
        if unpacked != *wanted {
            let problem = format!("stream {number} unpacks to {unpacked} bytes; these splats need {wanted}");
            return Err(wrong(at + 8, problem));
        }
        let stream = usize::try_from(size).ok().and_then(|size| rest.split_off(..size));
        let Some(stream) = stream else {
            let problem = format!("stream {number} has {size} bytes; there are {}", rest.len());
            return Err(wrong(at, problem));
        };
        compressed.push((number, stream, *wanted as usize));
    }
    if !rest.is_empty() {
        let at = bytes.len() - rest.len();
        return Err(wrong(at, format!("there are {} bytes behind the last stream", rest.len())));
    }
    let unpack = |(number, stream, size)| {
        let place = Place::Part(format!("stream {number}"));
        inflate::zstd(stream, size).map(Cow::Owned).map_err(|problem| file.malformed(place, problem))
    };
    let columns: Vec<_> = compressed.into_par_iter().map(unpack).collect();
    let columns = columns.into_iter().collect::<Result<_, _>>()?;
    Ok(Unpacked { header, columns, extensions: Cow::Borrowed(&bytes[LONG_HEADER..table]) })
}

impl Header {
    fn new(file: &File, bytes: &[u8]) -> Result<Self, ImportError> {
        let Some(header) = bytes.first_chunk::<HEADER>().filter(|header| header.starts_with(MAGIC)) else {
            let problem = "SPZ begins with NGSP and a header of 16 bytes, also under gzip";
            return Err(file.malformed(Place::Byte(0), problem));
        };
        let number = |at| le(header, at, u32::from_le_bytes).unwrap_or_default();
        let (version, count) = (number(4), number(8) as usize);
        let [.., degree, fractional_bits, flags, _] = *header;
        if !(1..=4).contains(&version) {
            let problem = format!("SPZ of version {version}; versions 1 to 4 are read");
            return Err(file.unsupported(Place::Byte(4), problem));
        }
        if degree > 4 {
            let problem = format!("harmonics of degree {degree}; SPZ has degrees 0 to 4");
            return Err(file.malformed(Place::Byte(12), problem));
        }
        // Positions of version 1 aren't fixed point.
        if fractional_bits > 24 && version > 1 {
            let problem = format!("{fractional_bits} fractional bits; positions have 24 bits in all");
            return Err(file.malformed(Place::Byte(13), problem));
        }
        Ok(Self { version, count, degree, fractional_bits, flags })
    }

    /// Harmonics of a splat in the file.
    fn harmonics(&self) -> usize {
        (usize::from(self.degree) + 1).pow(2) - 1
    }

    /// Bytes of the columns, unpacked.
    fn sizes(&self) -> [u64; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        [position, 1, 3, 3, rotation, 3 * self.harmonics() as u64].map(|size| size * self.count as u64)
    }

    fn training(&self) -> Training {
        let antialiased = self.flags & ANTIALIASED != 0;
        let filter = if antialiased { OpacityFilter::Compensated } else { OpacityFilter::Classic };
        Training { degree: self.degree.min(3), filter, blend: Blend::Display }
    }

    /// The axes that extensions name, else those of the format.
    fn axes(&self, file: &File, mut rest: &[u8], notes: &mut Vec<Note>) -> Result<Axes, ImportError> {
        let mut axes = Axes::of_format();
        if self.flags & EXTENSIONS == 0 {
            return Ok(axes);
        }
        let wrong = |problem: String| file.malformed(Place::Part("extensions".into()), problem);
        while !rest.is_empty() {
            let kind = le(rest, 0, u32::from_le_bytes);
            let (Some(kind), Some(length)) = (kind, le(rest, 4, u32::from_le_bytes)) else {
                return Err(wrong(format!("one breaks off after {} of 8 bytes", rest.len())));
            };
            rest = &rest[8..];
            let Some(payload) = rest.split_off(..length as usize) else {
                let found = rest.len();
                return Err(wrong(format!("{kind:#010x} has {length} bytes; there are {found}")));
            };
            if kind != COORDINATE_SYSTEM {
                notes.push(Note::LeftOut(format!("the extension {kind:#010x} ({length} bytes)")));
                continue;
            }
            axes = match le(payload, 0, u32::from_le_bytes) {
                Some(0) => {
                    let what = "axes right, up, back: the coordinate system is unspecified";
                    notes.push(Note::Assumed(what.into()));
                    Axes::of_format()
                }
                Some(number @ 9..=16) => {
                    let feature =
                        format!("coordinate system {number}, with axes turned about x; 1 to 8 are supported");
                    return Err(file.unsupported(Place::Part("extensions".into()), feature));
                }
                number => number.and_then(Axes::numbered).ok_or_else(|| {
                    wrong("a coordinate system is a number of four bytes from 1 to 16".into())
                })?,
            };
        }
        Ok(axes)
    }
}
