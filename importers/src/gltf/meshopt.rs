//! Buffer views under EXT_meshopt_compression and KHR_meshopt_compression.
//!
//! Kapoulkine and others, the two extensions' specifications (Khronos, 2021 and 2026); the streams are decoded by
//! meshoptimizer through the crate `meshopt`. Its decoders never leave the bytes they are given; what they take for granted
//! (element sizes, counts, and inside filters numbers that mean a scale) is checked here.

use ::gltf::json::Index;
use ::gltf::json::buffer::{Buffer, View};
use serde::Deserialize;

/// The extensions.
pub(super) const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Whether this program can unpack.
pub(super) const AVAILABLE: bool = cfg!(feature = "meshopt");

/// What is said where it cannot.
pub(super) const UNAVAILABLE: &str =
    "a program built with the cargo feature `meshopt` reads it; else save it without this compression";

/// A stream of n bytes unpacks to at most this many times n: a byte of control stands for a block of 1024.
const RATIO_LIMIT: usize = 1024;

/// How a view's bytes are compressed.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Packed {
    pub(super) buffer: Index<Buffer>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: usize,
    pub(super) count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

impl Packed {
    /// The compression of a view, if it is compressed.
    pub(super) fn of(view: &View) -> Result<Option<Self>, String> {
        let Some(others) = view.extensions.as_ref().map(|extensions| &extensions.others) else {
            return Ok(None);
        };
        let Some((name, value)) = NAMES.iter().find_map(|name| Some((name, others.get(*name)?))) else {
            return Ok(None);
        };
        let packed = Self::deserialize(value).map_err(|error| format!("{name}: {error}"))?;
        packed.check(view).map_err(|problem| format!("{name}: {problem}"))?;
        Ok(Some(packed))
    }

    /// The specification's conditions, which the decoders rely on.
    fn check(&self, view: &View) -> Result<(), String> {
        let Self { byte_stride: stride, count, mode, filter, .. } = *self;
        let strides: &[usize] = match (mode, filter) {
            (Mode::Attributes, Filter::None | Filter::Exponential) => &[],
            (Mode::Attributes, Filter::Octahedral | Filter::Color) => &[4, 8],
            (Mode::Attributes, Filter::Quaternion) => &[8],
            (Mode::Triangles | Mode::Indices, Filter::None) => &[2, 4],
            (Mode::Triangles | Mode::Indices, _) => return Err("indices have no filter".into()),
        };
        if !strides.is_empty() && !strides.contains(&stride) {
            return Err(format!("byteStride is {stride}; it must be one of {strides:?}"));
        }
        if strides.is_empty() && !(stride.is_multiple_of(4) && (4..=256).contains(&stride)) {
            return Err(format!("byteStride is {stride}; it must be a multiple of 4 from 4 to 256"));
        }
        if mode == Mode::Triangles && !count.is_multiple_of(3) {
            return Err(format!("count is {count}; triangles have a multiple of 3"));
        }
        if let Some(other) = view.byte_stride.filter(|other| other.0 != stride) {
            return Err(format!("byteStride is {stride}, but the view's is {}", other.0));
        }
        let view_length = view.byte_length.0;
        if (count as u64).checked_mul(stride as u64) != Some(view_length) {
            return Err(format!("{count} elements of {stride} bytes must be the view's {view_length} bytes"));
        }
        Ok(())
    }

    /// Refuses what the stream is too short for.
    pub(super) fn check_ratio(&self, stream: &[u8]) -> Result<(), String> {
        let size = self.count.saturating_mul(self.byte_stride);
        if size / RATIO_LIMIT > stream.len() {
            return Err(format!("{} compressed bytes cannot hold {size} bytes", stream.len()));
        }
        Ok(())
    }

    #[cfg(not(feature = "meshopt"))]
    pub(super) fn unpack(&self, _: &[u8]) -> Result<Vec<u8>, String> {
        Err(UNAVAILABLE.into())
    }

    /// The view's bytes.
    #[cfg(feature = "meshopt")]
    pub(super) fn unpack(&self, stream: &[u8]) -> Result<Vec<u8>, String> {
        use decode::{attributes, bytes};
        let broken = |_| "the compressed data are broken".to_owned();
        let unpacked = match (self.mode, self.byte_stride) {
            (Mode::Attributes, _) => attributes(stream, self.count, self.byte_stride).map_err(broken)?,
            (Mode::Triangles, 2) => {
                bytes(meshopt::decode_index_buffer(stream, self.count).map_err(broken)?, u16::to_le_bytes)
            }
            (Mode::Triangles, _) => {
                bytes(meshopt::decode_index_buffer(stream, self.count).map_err(broken)?, u32::to_le_bytes)
            }
            (Mode::Indices, 2) => {
                bytes(meshopt::decode_index_sequence(stream, self.count).map_err(broken)?, u16::to_le_bytes)
            }
            (Mode::Indices, _) => {
                bytes(meshopt::decode_index_sequence(stream, self.count).map_err(broken)?, u32::to_le_bytes)
            }
        };
        decode::filtered(self.filter, self.byte_stride, unpacked)
    }
}

#[cfg(feature = "meshopt")]
mod decode {
    use super::Filter;
    use crate::Endian;
    use crate::scalar::numbers;
    use meshopt::encoding::FilterComponent;

    /// An element of `N` bytes.
    #[derive(Clone)]
    struct Element<const N: usize>([u8; N]);

    impl<const N: usize> Default for Element<N> {
        fn default() -> Self {
            Self([0; N])
        }
    }

    fn elements<const N: usize>(stream: &[u8], count: usize) -> meshopt::Result<Vec<u8>> {
        let elements: Vec<Element<N>> = meshopt::decode_vertex_buffer(stream, count)?;
        Ok(elements.iter().flat_map(|element| element.0).collect())
    }

    /// Elements of `stride` bytes, a multiple of 4 from 4 to 256.
    pub(super) fn attributes(stream: &[u8], count: usize, stride: usize) -> meshopt::Result<Vec<u8>> {
        // The decoder knows sizes as types.
        macro_rules! of_words {
            ($($words:literal)*) => {
                match stride / 4 {
                    $($words => elements::<{ 4 * $words }>(stream, count),)*
                    _ => elements::<256>(stream, count),
                }
            };
        }
        of_words!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
            33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63)
    }

    pub(super) fn bytes<T, const N: usize>(numbers: Vec<T>, to_le_bytes: fn(T) -> [u8; N]) -> Vec<u8> {
        numbers.into_iter().flat_map(to_le_bytes).collect()
    }

    /// Undoes a filter; elements whose scale is none are refused, since what they come to is unspecified.
    pub(super) fn filtered(filter: Filter, stride: usize, raw: Vec<u8>) -> Result<Vec<u8>, String> {
        let all_ones = |number: i32, least: i32| number >= least && (number + 1).count_ones() == 1;
        match (filter, stride) {
            (Filter::None, _) => Ok(raw),
            (Filter::Octahedral, 4) => {
                let unit = |v: &[i8; 4]| all_ones(v[2].into(), 1);
                vectors(&raw, i8::from_le_bytes, unit, meshopt::decode_filter_oct, i8::to_le_bytes)
            }
            (Filter::Octahedral, _) => {
                let unit = |v: &[i16; 4]| all_ones(v[2].into(), 1);
                vectors(&raw, i16::from_le_bytes, unit, meshopt::decode_filter_oct, i16::to_le_bytes)
            }
            (Filter::Quaternion, _) => {
                let unit = |v: &[i16; 4]| all_ones(i32::from(v[3]) | 3, 7);
                vectors(&raw, i16::from_le_bytes, unit, meshopt::decode_filter_quat, i16::to_le_bytes)
            }
            (Filter::Color, 4) => {
                let has_scale = |v: &[u8; 4]| v[3] != 0;
                vectors(&raw, u8::from_le_bytes, has_scale, meshopt::decode_filter_color, u8::to_le_bytes)
            }
            (Filter::Color, _) => {
                let has_scale = |v: &[u16; 4]| v[3] != 0;
                vectors(&raw, u16::from_le_bytes, has_scale, meshopt::decode_filter_color, u16::to_le_bytes)
            }
            (Filter::Exponential, _) => {
                let mut words: Vec<[u32; 1]> =
                    numbers(&raw, Endian::Little, u32::from_le_bytes).map(|word| [word]).collect();
                if let Some(at) =
                    words.iter().position(|[word]| !(-100..=100).contains(&(*word as i32 >> 24)))
                {
                    return Err(format!("the exponent of number {at} must be from -100 to 100"));
                }
                meshopt::decode_filter_exp(&mut words);
                Ok(bytes(words.into_iter().flatten().collect(), u32::to_le_bytes))
            }
        }
    }

    /// Undoes a filter of four numbers each.
    fn vectors<T: FilterComponent, const N: usize>(
        raw: &[u8],
        from_le_bytes: fn([u8; N]) -> T,
        has_scale: impl Fn(&[T; 4]) -> bool,
        undo: fn(&mut [[T; 4]]),
        to_le_bytes: fn(T) -> [u8; N],
    ) -> Result<Vec<u8>, String> {
        let numbers: Vec<T> = numbers(raw, Endian::Little, from_le_bytes).collect();
        let mut vectors = numbers.as_chunks::<4>().0.to_vec();
        if let Some(at) = vectors.iter().position(|vector| !has_scale(vector)) {
            return Err(format!("element {at} has no scale by which its filter could be undone"));
        }
        undo(&mut vectors);
        Ok(bytes(vectors.into_iter().flatten().collect(), to_le_bytes))
    }
}
