//! Bytes of any number type to voxels: the last step of every volume format.

use crate::Endian;
use crate::file::{File, quoted};
use crate::scalar::{Scalar, numbers};
use crate::{ImportError, OpenOptions, Place};
use oblate_volumes::{GridFrame, Volume, Voxels};

/// How samples lie in bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub(crate) dims: [usize; 3],
    pub(crate) scalar: Scalar,
    pub(crate) endian: Endian,
}

impl Layout {
    /// Bytes of all samples.
    pub(crate) fn bytes(&self, file: &File) -> Result<usize, ImportError> {
        let [x, y, z] = self.dims;
        let bytes = [y, z, self.scalar.size()].iter().try_fold(x, |product, &n| product.checked_mul(n));
        match bytes {
            Some(0) => Err(file.malformed(Place::Whole, format!("dims {x}x{y}x{z}: each must be above 0"))),
            Some(bytes) if isize::try_from(bytes).is_ok() => Ok(bytes),
            _ => Err(file.malformed(Place::Whole, format!("dims {x}x{y}x{z} are more than memory can hold"))),
        }
    }

    /// Numbers written as text, separated by white space or commas, as little-endian bytes.
    pub(crate) fn bytes_from_text(&self, file: &File, text: &[u8]) -> Result<Vec<u8>, ImportError> {
        let expected = self.bytes(file)? / self.scalar.size();
        if expected > text.len() / 2 + 1 {
            let problem = format!("{} bytes of text cannot write {expected} numbers", text.len());
            return Err(file.malformed(Place::Whole, problem));
        }
        let tokens = text.split(|b| b.is_ascii_whitespace() || *b == b',').filter(|token| !token.is_empty());
        let mut bytes = Vec::with_capacity(expected * self.scalar.size());
        let mut found = 0;
        for token in tokens {
            let token = String::from_utf8_lossy(token);
            if self.scalar.push_text(&token, &mut bytes).is_none() {
                let place = Place::Part(format!("sample {found}"));
                return Err(file
                    .malformed(place, format!("{} is no number of type {:?}", quoted(&token), self.scalar)));
            }
            found += 1;
            if found > expected {
                break;
            }
        }
        if found != expected {
            let count = if found > expected { "more".into() } else { format!("only {found}") };
            return Err(
                file.malformed(Place::Whole, format!("dims need {expected} numbers; there are {count}"))
            );
        }
        Ok(bytes)
    }

    /// The volume whose samples are `bytes`, of the length that [`Layout::bytes`] gives.
    pub(crate) fn volume(
        &self,
        file: &File,
        bytes: &[u8],
        frame: GridFrame,
        options: &OpenOptions,
    ) -> Result<Volume, ImportError> {
        self.placed(file, self.voxels(file, bytes)?, frame, options)
    }

    /// The volume of these samples.
    pub(crate) fn placed(
        &self,
        file: &File,
        voxels: Voxels,
        frame: GridFrame,
        options: &OpenOptions,
    ) -> Result<Volume, ImportError> {
        let frame = GridFrame { spacing: options.spacing.unwrap_or(frame.spacing), ..frame };
        Volume::new(self.dims, voxels, frame)
            .map_err(|source| ImportError::Volume { path: file.path.clone(), source })
    }

    /// The samples in `bytes`, in their own type where voxels have it.
    pub(crate) fn voxels(&self, file: &File, bytes: &[u8]) -> Result<Voxels, ImportError> {
        let endian = self.endian;
        let voxels = match self.scalar {
            Scalar::U8 => Ok(Voxels::U8(bytes.to_vec())),
            Scalar::I8 => Ok(Voxels::I16(numbers(bytes, endian, i8::from_le_bytes).map(i16::from).collect())),
            Scalar::U16 => Ok(Voxels::U16(numbers(bytes, endian, u16::from_le_bytes).collect())),
            Scalar::I16 => Ok(Voxels::I16(numbers(bytes, endian, i16::from_le_bytes).collect())),
            Scalar::F32 => Ok(Voxels::F32(numbers(bytes, endian, f32::from_le_bytes).collect())),
            Scalar::I32 => exact(numbers(bytes, endian, i32::from_le_bytes).map(i128::from)),
            Scalar::U32 => exact(numbers(bytes, endian, u32::from_le_bytes).map(i128::from)),
            Scalar::I64 => exact(numbers(bytes, endian, i64::from_le_bytes).map(i128::from)),
            Scalar::U64 => exact(numbers(bytes, endian, u64::from_le_bytes).map(i128::from)),
            Scalar::F64 => rounded(numbers(bytes, endian, f64::from_le_bytes), |value| value),
        };
        voxels.map_err(|unequalled| unequalled.error(file))
    }

    /// The samples slope · stored + intercept, computed in f64 and rounded to f32.
    pub(crate) fn scaled_voxels(
        &self,
        file: &File,
        bytes: &[u8],
        (slope, intercept): (f64, f64),
    ) -> Result<Voxels, ImportError> {
        rounded(self.scalar.all(bytes, self.endian), |stored| slope * stored + intercept)
            .map_err(|unequalled| unequalled.error(file))
    }
}

/// A sample without an equal among f32, and its place among the samples.
struct Unequalled(usize, String);

impl Unequalled {
    fn error(self, file: &File) -> ImportError {
        let Self(index, value) = self;
        let problem = format!("{value} has no equal among 32-bit floating-point numbers; rescale the data");
        file.malformed(Place::Part(format!("sample {index}")), problem)
    }
}

/// Integers as f32 of the same value.
fn exact(values: impl Iterator<Item = i128>) -> Result<Voxels, Unequalled> {
    let convert = |(index, value): (usize, i128)| {
        let float = value as f32;
        if float as i128 == value { Ok(float) } else { Err(Unequalled(index, value.to_string())) }
    };
    values.enumerate().map(convert).collect::<Result<_, _>>().map(Voxels::F32)
}

/// Mapped doubles as the nearest f32; those that are not finite stay so, finite ones must stay finite.
fn rounded(values: impl Iterator<Item = f64>, map: impl Fn(f64) -> f64) -> Result<Voxels, Unequalled> {
    let convert = |(index, value): (usize, f64)| {
        let float = map(value) as f32;
        if value.is_finite() && !float.is_finite() {
            Err(Unequalled(index, map(value).to_string()))
        } else {
            Ok(float)
        }
    };
    values.enumerate().map(convert).collect::<Result<_, _>>().map(Voxels::F32)
}
