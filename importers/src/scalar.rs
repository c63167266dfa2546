//! Number types of binary files.

use crate::Endian;

/// A number type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// All `N`-byte numbers in `bytes`; a shorter rest is left out.
pub(crate) fn numbers<const N: usize, T>(
    bytes: &[u8],
    endian: Endian,
    from_le_bytes: fn([u8; N]) -> T,
) -> impl Iterator<Item = T> {
    bytes.as_chunks::<N>().0.iter().map(move |&(mut chunk)| {
        if endian == Endian::Big {
            chunk.reverse();
        }
        from_le_bytes(chunk)
    })
}

impl Scalar {
    /// Bytes of one number.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The relative spacing of floating-point numbers; 0 for integers.
    pub(crate) fn rounding(self) -> f64 {
        match self {
            Self::F32 => f64::from(f32::EPSILON),
            Self::F64 => f64::EPSILON,
            _ => 0.0,
        }
    }

    /// The first number in `bytes`, if they are enough; 64-bit integers are rounded.
    pub(crate) fn first(self, bytes: &[u8], endian: Endian) -> Option<f64> {
        match self {
            Self::I8 => numbers(bytes, endian, i8::from_le_bytes).next().map(f64::from),
            Self::U8 => numbers(bytes, endian, u8::from_le_bytes).next().map(f64::from),
            Self::I16 => numbers(bytes, endian, i16::from_le_bytes).next().map(f64::from),
            Self::U16 => numbers(bytes, endian, u16::from_le_bytes).next().map(f64::from),
            Self::I32 => numbers(bytes, endian, i32::from_le_bytes).next().map(f64::from),
            Self::U32 => numbers(bytes, endian, u32::from_le_bytes).next().map(f64::from),
            Self::I64 => numbers(bytes, endian, i64::from_le_bytes).next().map(|v| v as f64),
            Self::U64 => numbers(bytes, endian, u64::from_le_bytes).next().map(|v| v as f64),
            Self::F32 => numbers(bytes, endian, f32::from_le_bytes).next().map(f64::from),
            Self::F64 => numbers(bytes, endian, f64::from_le_bytes).next(),
        }
    }

    /// All numbers in `bytes`; a shorter rest is left out, 64-bit integers are rounded.
    pub(crate) fn all(self, bytes: &[u8], endian: Endian) -> impl Iterator<Item = f64> {
        bytes.chunks_exact(self.size()).filter_map(move |chunk| self.first(chunk, endian))
    }

    /// The largest value of an integer type, with which normalised integers are divided.
    pub(crate) fn integer_max(self) -> Option<f64> {
        match self {
            Self::I8 => Some(f64::from(i8::MAX)),
            Self::U8 => Some(f64::from(u8::MAX)),
            Self::I16 => Some(f64::from(i16::MAX)),
            Self::U16 => Some(f64::from(u16::MAX)),
            Self::I32 => Some(f64::from(i32::MAX)),
            Self::U32 => Some(f64::from(u32::MAX)),
            Self::I64 => Some(i64::MAX as f64),
            Self::U64 => Some(u64::MAX as f64),
            Self::F32 | Self::F64 => None,
        }
    }

    /// Appends the number that `token` writes, little-endian; `None` if it is not one of this type.
    pub(crate) fn push_text(self, token: &str, bytes: &mut Vec<u8>) -> Option<()> {
        match self {
            Self::I8 => bytes.extend(token.parse::<i8>().ok()?.to_le_bytes()),
            Self::U8 => bytes.extend(token.parse::<u8>().ok()?.to_le_bytes()),
            Self::I16 => bytes.extend(token.parse::<i16>().ok()?.to_le_bytes()),
            Self::U16 => bytes.extend(token.parse::<u16>().ok()?.to_le_bytes()),
            Self::I32 => bytes.extend(token.parse::<i32>().ok()?.to_le_bytes()),
            Self::U32 => bytes.extend(token.parse::<u32>().ok()?.to_le_bytes()),
            Self::I64 => bytes.extend(token.parse::<i64>().ok()?.to_le_bytes()),
            Self::U64 => bytes.extend(token.parse::<u64>().ok()?.to_le_bytes()),
            Self::F32 => bytes.extend(token.parse::<f32>().ok()?.to_le_bytes()),
            Self::F64 => bytes.extend(token.parse::<f64>().ok()?.to_le_bytes()),
        }
        Some(())
    }
}

/// Numbers that columns of a file are wanted as.
pub(crate) trait FromF64: Copy {
    fn from_f64(value: f64) -> Self;
    fn from_f32(value: f32) -> Self;
}

impl FromF64 for f32 {
    fn from_f64(value: f64) -> Self {
        value as f32
    }

    fn from_f32(value: f32) -> Self {
        value
    }
}

impl FromF64 for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }

    fn from_f32(value: f32) -> Self {
        f64::from(value)
    }
}
