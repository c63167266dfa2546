//! KSPLAT: sections of splats, plain or in buckets.
//!
//! Kellogg, *GaussianSplats3D*, <https://github.com/mkkellogg/GaussianSplats3D>, `src/loaders/SplatBuffer.js`, version 0.1,
//! 2024. All numbers are little-endian. A header of 4096 bytes, then 1024 bytes for each section, then each section's
//! buckets and splats: centre, σ, rotation w x y z, red, green, blue, opacity, harmonics channel by channel within each
//! degree.
//!
//! | level | centre | σ, rotation | harmonics |
//! |---|---|---|---|
//! | 0 | single precision | single precision | single precision |
//! | 1 | 16 bits of the block around its bucket's centre | half precision | half precision |
//! | 2 | as in 1 | half precision | 8 bits between the header's bounds |
//!
//! Full buckets come first, all with as many splats; then those that are not, whose sizes stand before the buckets.
//! Colours are display-encoded and include the constant harmonic; σ are no logarithms.
//!
//! **Axes** are those of the 3DGS .ply that the file was made of. There are no **flags**: opacities count as
//! [`OpacityFilter::Classic`].
//!
//! The format has no fixed beginning: files are known by their name. Refused: versions but 0.1 to 0.255, harmonics above
//! degree 2, sections or buckets that don't add up.

use super::packed::le;
use super::{ROWS, Trained, Training, gather, log_scale};
use crate::file::File;
use crate::{ImportError, Note, Opened, Place};
use oblate_engine::{Blend, OpacityFilter};

const HEADER: usize = 4096;
const SECTION_HEADER: usize = 1024;
/// Bytes of a bucket's centre.
const BUCKET: usize = 12;

/// How numbers are stored.
#[derive(Clone, Copy, PartialEq)]
enum Level {
    Single,
    Half,
    HalfAndBytes,
}

struct Section<'a> {
    /// Splats of the sections before this one and of it.
    end: usize,
    count: usize,
    level: Level,
    degree: usize,
    buckets: &'a [u8],
    /// For each bucket that is not full, the splats of all buckets up to it.
    partial_ends: Vec<usize>,
    full: usize,
    capacity: usize,
    /// World units of a step of a coordinate, and the steps of half a block.
    step: f32,
    range: f32,
    bytes_per_splat: usize,
    splats: &'a [u8],
    /// What 0 and 255 stand for in harmonics.
    bounds: [f32; 2],
}

/// Reads the file.
pub(crate) fn read(file: &File) -> Result<Opened, ImportError> {
    let bytes = &file.bytes[..];
    let wrong = |at: usize, problem: String| file.malformed(Place::Byte(at), problem);
    if bytes.len() < HEADER {
        let problem = format!("the header of .ksplat has {HEADER} bytes; there are {}", bytes.len());
        return Err(wrong(0, problem));
    }
    let [major, minor] = [bytes[0], bytes[1]];
    if major != 0 || minor == 0 {
        let feature = format!(".ksplat of version {major}.{minor}; versions 0.1 and above of 0 are read");
        return Err(file.unsupported(Place::Byte(0), feature));
    }
    let number = |at| le(bytes, at, u32::from_le_bytes).unwrap_or_default() as usize;
    let (section_count, count) = (number(4), number(16));
    let level = match le(bytes, 20, u16::from_le_bytes) {
        Some(0) => Level::Single,
        Some(1) => Level::Half,
        Some(2) => Level::HalfAndBytes,
        level => {
            let level = level.unwrap_or_default();
            return Err(wrong(20, format!("compression level {level}, which must be 0, 1 or 2")));
        }
    };
    let bound = |at, default: f32| match le(bytes, at, f32::from_le_bytes) {
        Some(bound) if bound != 0.0 && !bound.is_nan() => bound,
        _ => default,
    };
    let bounds = [bound(36, -1.5), bound(40, 1.5)];
    let start = (section_count.checked_mul(SECTION_HEADER)).and_then(|size| size.checked_add(HEADER));
    let Some(mut rest) = start.and_then(|start| bytes.get(start..)) else {
        let found = bytes.len();
        return Err(wrong(4, format!("{section_count} sections do not fit the file's {found} bytes")));
    };
    let (mut sections, mut end, mut room) = (Vec::new(), 0, 0);
    for index in 0..section_count {
        let at = HEADER + index * SECTION_HEADER;
        let header = &bytes[at..][..SECTION_HEADER];
        let (section, slots) = Section::new(header, level, &mut rest, end)
            .map_err(|problem| file.malformed(Place::Part(format!("section {index}")), problem))?;
        end = section.end;
        room += slots;
        sections.push(Section { bounds, ..section });
    }
    if end != count {
        return Err(wrong(16, format!("there should be {count} splats; the sections have {end}")));
    }
    let degree = sections.iter().map(|section| section.degree).max().unwrap_or(0);
    let training = Training { degree: degree as u8, filter: OpacityFilter::Classic, blend: Blend::Display };
    let mut opened = gather(file, (count, ROWS), training, |range, sink| {
        let mut current = sections.partition_point(|section| section.end <= range.start);
        for row in range {
            while sections[current].end <= row {
                current += 1;
            }
            let section = &sections[current];
            sink.put(&section.splat(row + section.count - section.end));
        }
        Ok(())
    })?;
    if room > count {
        let what = format!("{} of {room} places for splats, which are not filled", room - count);
        opened.notes.push(Note::LeftOut(what));
    }
    if !rest.is_empty() {
        opened.notes.push(Note::LeftOut(format!("{} bytes behind the last section", rest.len())));
    }
    Ok(opened)
}

impl<'a> Section<'a> {
    /// The section that begins `rest`, which is moved past it; also how many splats there is room for.
    fn new(header: &[u8], level: Level, rest: &mut &'a [u8], before: usize) -> Result<(Self, usize), String> {
        let number = |at| le(header, at, u32::from_le_bytes).unwrap_or_default() as usize;
        let (count, room, capacity, bucket_count) = (number(0), number(4), number(8), number(12));
        let block = le(header, 16, f32::from_le_bytes).unwrap_or_default();
        let bucket_size = usize::from(le(header, 20, u16::from_le_bytes).unwrap_or_default());
        let (full, partial) = (number(32), number(36));
        let degree = usize::from(le(header, 40, u16::from_le_bytes).unwrap_or_default());
        if count > room {
            return Err(format!("has {count} splats and room for {room}"));
        }
        if degree > 2 {
            return Err(format!("has harmonics of degree {degree}; .ksplat has degrees 0 to 2"));
        }
        if level != Level::Single && bucket_count > 0 && bucket_size != BUCKET {
            return Err(format!("has buckets of {bucket_size} bytes, which must be {BUCKET}"));
        }
        let mut take = |size: Option<usize>, what: &str| {
            let found = rest.len();
            size.and_then(|size| rest.split_off(..size)).ok_or_else(|| match size {
                Some(size) => format!("needs {size} bytes for {what}; {found} are left"),
                None => format!("needs more bytes for {what} than a file can have"),
            })
        };
        let sizes = take(partial.checked_mul(4), "the sizes of buckets")?;
        let buckets = take(bucket_count.checked_mul(bucket_size), "buckets")?;
        let bytes_per_splat = level.bytes_per_splat(degree);
        let splats = take(room.checked_mul(bytes_per_splat), "splats")?;
        let mut partial_ends = Vec::new();
        if level != Level::Single {
            let mut filled = full.saturating_mul(capacity);
            for size in sizes.as_chunks().0 {
                filled = filled.saturating_add(u32::from_le_bytes(*size) as usize);
                partial_ends.push(filled);
            }
            if full.saturating_add(partial) > bucket_count {
                return Err(format!("has {full} full and {partial} other buckets, in all {bucket_count}"));
            }
            if filled < count {
                return Err(format!("has {count} splats; its buckets hold {filled}"));
            }
        }
        // As many steps on both sides of a bucket's centre.
        let range = match number(24) {
            0 => 32767.0,
            range => range as f32,
        };
        let section = Self {
            end: before.saturating_add(count),
            count,
            level,
            degree,
            buckets,
            partial_ends,
            full,
            capacity,
            step: block / 2.0 / range,
            range,
            bytes_per_splat,
            splats,
            bounds: [0.0; 2],
        };
        Ok((section, room))
    }

    fn splat(&self, index: usize) -> Trained {
        let bytes = &self.splats[index * self.bytes_per_splat..][..self.bytes_per_splat];
        let (geometry, rest) = bytes.split_at(self.level.geometry());
        let (center, numbers) = geometry.split_at(if self.level == Level::Single { 12 } else { 6 });
        let mut seven = [0.0; 7];
        match self.level {
            Level::Single => singles(numbers, &mut seven),
            Level::Half | Level::HalfAndBytes => halves(numbers, &mut seven),
        }
        let [sx, sy, sz, rotation @ ..] = seven;
        let (rgba, packed) = rest.split_at(4);
        let shade = [rgba[0], rgba[1], rgba[2], rgba[3]].map(|byte| f32::from(byte) / 255.0);
        let mut splat = Trained {
            center: self.center(center, index),
            log_scales: [sx, sy, sz].map(log_scale),
            rotation,
            opacity: shade[3],
            color: [shade[0], shade[1], shade[2]],
            ..Trained::default()
        };
        let mut values = [0.0; 24];
        match self.level {
            Level::Single => singles(packed, &mut values),
            Level::Half => halves(packed, &mut values),
            Level::HalfAndBytes => {
                let [low, high] = self.bounds;
                for (value, byte) in values.iter_mut().zip(packed) {
                    *value = low + (high - low) * (f32::from(*byte) / 255.0);
                }
            }
        }
        // All orders of a channel stand together within a degree.
        for (first, orders) in [(0, 3), (3, 5)].into_iter().take(self.degree) {
            for order in 0..orders {
                let at = |channel| values[3 * first + channel * orders + order];
                splat.harmonics[first + order] = [at(0), at(1), at(2)];
            }
        }
        splat
    }

    fn center(&self, bytes: &[u8], index: usize) -> [f32; 3] {
        let mut center = [0.0; 3];
        if self.level == Level::Single {
            singles(bytes, &mut center);
            return center;
        }
        let in_full = self.full.saturating_mul(self.capacity);
        let bucket = if index < in_full {
            index / self.capacity
        } else {
            self.full + self.partial_ends.partition_point(|end| *end <= index)
        };
        singles(&self.buckets[bucket * BUCKET..][..BUCKET], &mut center);
        for (coordinate, steps) in center.iter_mut().zip(bytes.as_chunks().0) {
            *coordinate += (f32::from(u16::from_le_bytes(*steps)) - self.range) * self.step;
        }
        center
    }
}

impl Level {
    /// Bytes of centre, σ and rotation.
    fn geometry(self) -> usize {
        match self {
            Self::Single => 40,
            Self::Half | Self::HalfAndBytes => 20,
        }
    }

    fn bytes_per_splat(self, degree: usize) -> usize {
        let harmonic = match self {
            Self::Single => 4,
            Self::Half => 2,
            Self::HalfAndBytes => 1,
        };
        self.geometry() + 4 + 3 * ((degree + 1).pow(2) - 1) * harmonic
    }
}

fn singles(bytes: &[u8], values: &mut [f32]) {
    for (value, bytes) in values.iter_mut().zip(bytes.as_chunks().0) {
        *value = f32::from_le_bytes(*bytes);
    }
}

fn halves(bytes: &[u8], values: &mut [f32]) {
    for (value, bytes) in values.iter_mut().zip(bytes.as_chunks().0) {
        *value = half::f16::from_le_bytes(*bytes).to_f32();
    }
}
