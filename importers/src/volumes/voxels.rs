//! Bytes of any number type to voxels: the last step of every volume format.

use crate::Endian;
use crate::file::{File, quoted};
use crate::scalar::{Scalar, numbers};
use crate::{ImportError, OpenOptions, Place};
use oblate_volumes::{GridFrame, Volume, Voxels};
use std::borrow::Cow;

/// Samples as a file has them.
pub(crate) enum Samples<'a> {
    /// Numbers between white space or commas.
    Text(Cow<'a, [u8]>),
    /// Numbers of the layout's type and byte order, of the length that [`Layout::bytes`] gives.
    Binary(Cow<'a, [u8]>),
}

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
        let mut bytes = Vec::new();
        self.parts_of_text(file, text, |_, part| {
            bytes.extend_from_slice(part);
            Ok(())
        })?;
        Ok(bytes)
    }

    /// The same in parts, with the index of each part's first number: bytes of all may be more than the text has.
    fn parts_of_text(
        &self,
        file: &File,
        text: &[u8],
        mut part: impl FnMut(usize, &[u8]) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        const PART: usize = 4096;
        let expected = self.bytes(file)? / self.scalar.size();
        if expected > text.len() / 2 + 1 {
            let problem = format!("{} bytes of text cannot write {expected} numbers", text.len());
            return Err(file.malformed(Place::Whole, problem));
        }
        let tokens = text.split(|b| b.is_ascii_whitespace() || *b == b',').filter(|token| !token.is_empty());
        let mut bytes = Vec::with_capacity(PART * self.scalar.size());
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
            if found % PART == 0 {
                part(found - PART, &bytes)?;
                bytes.clear();
            }
        }
        if found != expected {
            let count = if found > expected { "more".into() } else { format!("only {found}") };
            return Err(
                file.malformed(Place::Whole, format!("dims need {expected} numbers; there are {count}"))
            );
        }
        part(found - found % PART, &bytes)
    }

    /// The volume whose samples are `bytes`, of the length that [`Layout::bytes`] gives.
    pub(crate) fn volume(
        &self,
        file: &File,
        bytes: &[u8],
        frame: GridFrame,
        options: &OpenOptions,
    ) -> Result<Volume, ImportError> {
        let voxels = self.voxels(file, &Samples::Binary(Cow::Borrowed(bytes)))?;
        self.placed(file, voxels, frame, options)
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

    /// The samples, in their own type where voxels have it.
    pub(crate) fn voxels(&self, file: &File, samples: &Samples<'_>) -> Result<Voxels, ImportError> {
        match samples {
            Samples::Binary(bytes) => self.converted(bytes).map_err(|unequalled| unequalled.error(file, 0)),
            Samples::Text(text) => {
                let mut voxels = None;
                let little = Self { endian: Endian::Little, ..*self };
                self.parts_of_text(file, text, |first, bytes| {
                    let part = little.converted(bytes).map_err(|unequalled| unequalled.error(file, first))?;
                    append(&mut voxels, part);
                    Ok(())
                })?;
                Ok(voxels.unwrap_or(Voxels::U8(Vec::new())))
            }
        }
    }

    fn converted(&self, bytes: &[u8]) -> Result<Voxels, Unequalled> {
        let endian = self.endian;
        Ok(match self.scalar {
            Scalar::U8 => Voxels::U8(bytes.to_vec()),
            Scalar::I8 => Voxels::I16(numbers(bytes, endian, i8::from_le_bytes).map(i16::from).collect()),
            Scalar::U16 => Voxels::U16(numbers(bytes, endian, u16::from_le_bytes).collect()),
            Scalar::I16 => Voxels::I16(numbers(bytes, endian, i16::from_le_bytes).collect()),
            Scalar::F32 => Voxels::F32(numbers(bytes, endian, f32::from_le_bytes).collect()),
            Scalar::I32 => exact(numbers(bytes, endian, i32::from_le_bytes).map(i128::from))?,
            Scalar::U32 => exact(numbers(bytes, endian, u32::from_le_bytes).map(i128::from))?,
            Scalar::I64 => exact(numbers(bytes, endian, i64::from_le_bytes).map(i128::from))?,
            Scalar::U64 => exact(numbers(bytes, endian, u64::from_le_bytes).map(i128::from))?,
            Scalar::F64 => rounded(numbers(bytes, endian, f64::from_le_bytes), |value| value)?,
        })
    }

    /// The samples as they are, for numbers that become no voxels; 64-bit integers are rounded.
    pub(crate) fn numbers(&self, file: &File, samples: &Samples<'_>) -> Result<Vec<f64>, ImportError> {
        match samples {
            Samples::Binary(bytes) => Ok(self.scalar.all(bytes, self.endian).collect()),
            Samples::Text(text) => {
                let mut numbers = Vec::new();
                self.parts_of_text(file, text, |_, bytes| {
                    numbers.extend(self.scalar.all(bytes, Endian::Little));
                    Ok(())
                })?;
                Ok(numbers)
            }
        }
    }

    /// The samples slope · stored + intercept, computed in f64 and rounded to f32.
    pub(crate) fn scaled_voxels(
        &self,
        file: &File,
        bytes: &[u8],
        (slope, intercept): (f64, f64),
    ) -> Result<Voxels, ImportError> {
        rounded(self.scalar.all(bytes, self.endian), |stored| slope * stored + intercept)
            .map_err(|unequalled| unequalled.error(file, 0))
    }
}

/// Puts voxels behind others of the same type.
fn append(voxels: &mut Option<Voxels>, mut part: Voxels) {
    match (voxels, &mut part) {
        (Some(Voxels::U8(all)), Voxels::U8(part)) => all.append(part),
        (Some(Voxels::U16(all)), Voxels::U16(part)) => all.append(part),
        (Some(Voxels::I16(all)), Voxels::I16(part)) => all.append(part),
        (Some(Voxels::F32(all)), Voxels::F32(part)) => all.append(part),
        (voxels, _) => *voxels = Some(part),
    }
}

/// A sample without an equal among f32, and its place among the samples.
struct Unequalled(usize, String);

impl Unequalled {
    /// What is said of it where the first of these samples is number `first` of the file's.
    fn error(self, file: &File, first: usize) -> ImportError {
        let Self(index, value) = self;
        let index = first + index;
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
