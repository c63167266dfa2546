//! Raw voxels: samples and nothing else, x fastest, also under gzip.
//!
//! The layout comes from the caller or from a name such as `engine_256x256x128_uint8.raw.gz` or
//! `CThead_256x256x113_uint16be.raw.gz`; without a byte order little-endian is meant.

use crate::file::File;
use crate::format;
use crate::inflate;
use crate::scalar::Scalar;
use crate::source::Source;
use crate::volumes::voxels::{Layout, Samples};
use crate::{ImportError, OpenOptions, Place};
use oblate_volumes::{Grid, GridFrame, Volume, Voxels};
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use thiserror::Error;

/// How raw samples lie in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// Samples along x, y, z; x fastest.
    pub dims: [usize; 3],
    /// Their number type.
    pub sample_type: SampleType,
    /// Their byte order.
    pub endian: Endian,
}

/// The number type of raw samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleType {
    /// 8 bits.
    U8,
    /// 16 bits.
    U16,
    /// 16 bits, signed.
    I16,
    /// 32-bit floating point.
    F32,
}

/// The order of a number's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Endian {
    /// Lowest first.
    #[default]
    Little,
    /// Highest first.
    Big,
}

/// A word that names no part of a layout.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{given:?} is not {expected}")]
pub struct LayoutError {
    given: String,
    expected: &'static str,
}

impl FromStr for SampleType {
    type Err = LayoutError;

    /// `u8`, `u16`, `i16`, `f32` or a longer name of these.
    fn from_str(text: &str) -> Result<Self, LayoutError> {
        match text.to_ascii_lowercase().as_str() {
            "u8" | "uint8" | "uchar" => Ok(Self::U8),
            "u16" | "uint16" | "ushort" => Ok(Self::U16),
            "i16" | "int16" | "short" => Ok(Self::I16),
            "f32" | "float32" | "float" => Ok(Self::F32),
            _ => Err(LayoutError { given: text.into(), expected: "a sample type: u8, u16, i16 or f32" }),
        }
    }
}

impl SampleType {
    pub(crate) fn scalar(self) -> Scalar {
        match self {
            Self::U8 => Scalar::U8,
            Self::U16 => Scalar::U16,
            Self::I16 => Scalar::I16,
            Self::F32 => Scalar::F32,
        }
    }
}

impl fmt::Display for SampleType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::F32 => "f32",
        })
    }
}

impl FromStr for Endian {
    type Err = LayoutError;

    /// `little`, `big`, `le` or `be`.
    fn from_str(text: &str) -> Result<Self, LayoutError> {
        match text.to_ascii_lowercase().as_str() {
            "little" | "le" => Ok(Self::Little),
            "big" | "be" => Ok(Self::Big),
            _ => Err(LayoutError { given: text.into(), expected: "a byte order: little or big" }),
        }
    }
}

impl fmt::Display for Endian {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if *self == Self::Little { "little" } else { "big" })
    }
}

/// Reads `256x256x128` as samples along x, y, z; `256x256` is one slice.
///
/// # Errors
/// When the text is not two or three positive numbers with `x` between them.
pub fn parse_dims(text: &str) -> Result<[usize; 3], LayoutError> {
    let error = || LayoutError { given: text.into(), expected: "positive numbers such as 256x256x128" };
    let numbers: Vec<usize> = text
        .split(['x', 'X'])
        .map(|n| n.parse().ok().filter(|&n| n > 0))
        .collect::<Option<_>>()
        .ok_or_else(error)?;
    match numbers[..] {
        [x, y] => Ok([x, y, 1]),
        [x, y, z] => Ok([x, y, z]),
        _ => Err(error()),
    }
}

/// What a file's name says of its layout.
#[derive(Default)]
struct NameLayout {
    dims: Option<[usize; 3]>,
    sample_type: Option<SampleType>,
    endian: Option<Endian>,
}

impl NameLayout {
    fn of(name: &str) -> Self {
        let mut layout = Self::default();
        for word in name.split(['_', '-', '.', ' ']) {
            let (stem, endian) = match word.len().checked_sub(2).and_then(|at| word.split_at_checked(at)) {
                Some((stem, order)) if !stem.is_empty() => match order.parse() {
                    Ok(endian) => (stem, Some(endian)),
                    Err(_) => (word, None),
                },
                _ => (word, None),
            };
            if let Ok(dims) = parse_dims(word) {
                layout.dims = Some(dims);
            } else if let Ok(sample_type) = stem.parse() {
                layout.sample_type = Some(sample_type);
                layout.endian = layout.endian.or(endian);
            } else if let Ok(endian) = word.parse() {
                layout.endian = Some(endian);
            }
        }
        layout
    }
}

/// The caller's layout, else the name's.
pub(crate) fn layout(file: &File, options: &OpenOptions) -> Result<RawLayout, ImportError> {
    if let Some(layout) = options.raw {
        return Ok(layout);
    }
    let name = file.path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
    let named = NameLayout::of(&name);
    if let (Some(dims), Some(sample_type)) = (named.dims, named.sample_type) {
        return Ok(RawLayout { dims, sample_type, endian: named.endian.unwrap_or_default() });
    }
    if let Some(header) = header_beside(&file.path) {
        let feature = format!("it holds the samples of {}; open that", header.display());
        return Err(file.unsupported(Place::Whole, feature));
    }
    let missing = match (named.dims, named.sample_type) {
        (Some(_), _) => "give their number type (u8, u16, i16 or f32) and byte order",
        (_, Some(_)) => "give their dims (such as 256x256x128)",
        _ => "give their dims (such as 256x256x128), number type (u8, u16, i16 or f32) and byte order",
    };
    Err(ImportError::Unknown { path: file.path.clone(), missing: missing.into() })
}

/// The `.hdr` beside an `.img`, also under gzip, of NIfTI or Analyze.
fn header_beside(path: &Path) -> Option<PathBuf> {
    let is = |path: &Path, ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let plain = if is(path, "gz") { path.with_extension("") } else { path.to_owned() };
    let endings = ["hdr", "HDR", "hdr.gz"].map(|ending| plain.with_extension(ending));
    endings.into_iter().find(|header| is(&plain, "img") && header.exists())
}

/// Raw samples, also under gzip.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Volume, ImportError> {
    let begins_as_gzip = file.bytes.starts_with(&inflate::GZIP);
    if begins_as_gzip && options.raw.is_none() {
        let inside = format::of_beginning(&inflate::gzip_beginning(&file.bytes, 1024));
        if let Some(format) = inside {
            let feature = format!("{} under gzip is not supported; unpack it first", format.name);
            return Err(file.unsupported(Place::Whole, feature));
        }
    }
    let RawLayout { dims, sample_type, endian } = layout(file, options)?;
    let layout = Layout { dims, scalar: sample_type.scalar(), endian };
    let expected = layout.bytes(file)?;
    let [x, y, z] = dims;
    let wrong = |problem: String| {
        file.malformed(
            Place::Whole,
            format!("{problem} (dims {x}x{y}x{z} of {sample_type}); check dims and type"),
        )
    };
    // Samples may begin like gzip.
    if begins_as_gzip && file.bytes.len() != expected {
        let bytes = inflate::can_hold(file.bytes.len(), expected)
            .and_then(|()| inflate::within(expected, options.max_memory))
            .and_then(|()| inflate::gunzip(&file.bytes, expected))
            .map_err(wrong)?;
        layout.volume(file, &bytes, GridFrame::default(), options)
    } else if file.bytes.len() != expected {
        Err(wrong(format!("{} bytes; {expected} are expected", file.bytes.len())))
    } else {
        layout.volume(file, &file.bytes, GridFrame::default(), options)
    }
}

/// Raw samples that stay in their file, which is read slice by slice.
pub struct RawSlices {
    source: Source,
    layout: Layout,
    frame: GridFrame,
}

impl RawSlices {
    /// Opens a file that is not compressed; its layout is the options', else its name's.
    ///
    /// # Errors
    /// When the file can't be read or has another number of bytes than its layout needs, or nothing tells the layout.
    pub fn open(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Self, ImportError> {
        let source = Source::open(path.as_ref(), options.watch.as_ref())?;
        let format = format::of(&source.head, source.size, options.raw.is_some());
        let refused = if options.raw.is_none() && format.name != "raw" {
            Some(format!(
                "it is {}; only raw samples are read slice by slice (as which it is read where their dims are given)",
                format.name
            ))
        } else if source.head.bytes.starts_with(&inflate::GZIP) && options.raw.is_none() {
            Some("it is compressed by gzip; unpack it to read it slice by slice".into())
        } else {
            None
        };
        if let Some(feature) = refused {
            return Err(source.head.unsupported(Place::Whole, feature));
        }
        let RawLayout { dims, sample_type, endian } = layout(&source.head, options)?;
        let layout = Layout { dims, scalar: sample_type.scalar(), endian };
        let expected = layout.bytes(&source.head)?;
        if source.size != expected {
            let [x, y, z] = dims;
            let problem = format!(
                "{} bytes; {expected} are expected (dims {x}x{y}x{z} of {sample_type}, not compressed)",
                source.size
            );
            return Err(source.head.malformed(Place::Whole, problem));
        }
        let frame = GridFrame::default();
        let frame = GridFrame { spacing: options.spacing.unwrap_or(frame.spacing), ..frame };
        Ok(Self { source, layout, frame })
    }

    /// The grid.
    pub fn grid(&self) -> Grid {
        Grid { dims: self.layout.dims, frame: self.frame }
    }

    /// The samples of some slices; beyond the last there are none.
    ///
    /// # Errors
    /// When the file can't be read.
    pub fn read(&self, slices: Range<usize>) -> Result<Voxels, ImportError> {
        let [x, y, z] = self.layout.dims;
        let slice = x * y * self.layout.scalar.size();
        let slices = slices.start.min(z)..slices.end.min(z);
        let bytes = self.source.bytes(slices.start * slice, slices.len() * slice)?;
        self.layout.voxels(&self.source.head, &Samples::Binary(bytes.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_are_those_of_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let samples: Vec<u16> = (0..4 * 3 * 5).map(|i| i * 257 + 1).collect();
        let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_be_bytes()).collect();
        let path = folder.path().join("a_4x3x5_u16be.raw");
        std::fs::write(&path, &bytes).unwrap();
        let slices = RawSlices::open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(slices.grid(), Grid { dims: [4, 3, 5], frame: GridFrame::default() });
        for range in [0..5, 0..1, 2..4, 4..9, 5..5, 7..9] {
            let part = samples[range.start.min(5) * 12..range.end.min(5) * 12].to_vec();
            assert_eq!(slices.read(range.clone()).unwrap(), Voxels::U16(part), "{range:?}");
        }
        let other = |name: &str, bytes: &[u8]| {
            std::fs::write(folder.path().join(name), bytes).unwrap();
            RawSlices::open(folder.path().join(name), &OpenOptions::default()).err().unwrap().to_string()
        };
        assert!(other("a.nrrd", b"NRRD0004\n").contains("it is NRRD; only raw samples"));
        assert!(other("a_4x3x5_u8.raw.gz", b"\x1f\x8b\x08").contains("compressed by gzip"));
        // Another layout than the bytes have.
        let raw = RawLayout { dims: [4, 3, 5], sample_type: SampleType::U8, endian: Endian::Big };
        let options = OpenOptions { raw: Some(raw), ..OpenOptions::default() };
        let problem = RawSlices::open(&path, &options).err().unwrap().to_string();
        assert!(problem.contains("120 bytes; 60 are expected"), "{problem}");
    }
}
