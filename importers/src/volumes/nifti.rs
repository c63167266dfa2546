//! NIfTI-1 and NIfTI-2: `.nii`, also under gzip, and pairs of `.hdr` and `.img`.
//!
//! Sources: Cox and others, *A (sort of) new ANALYZE-style data format: NIfTI-1* (`nifti1.h`, 2004, nifti.nimh.nih.gov);
//! *NIfTI-2* (`nifti2.h`, 2011). Integers of 8 to 64 bits and floating point of 32 and 64; colours, complex numbers and
//! 128 bits are refused. Both byte orders, told by `dim[0]`.
//!
//! The frame is, in this order, `srow` where `sform_code` is above 0, the quaternion where `qform_code` is, else
//! `pixdim` alone with the first sample at 0. Axes are NIfTI's (right, anterior, superior), units the file's own
//! (`xyzt_units` converts nothing). Where `scl_slope` is neither 0 nor NaN samples are slope · stored + intercept, as f32; with
//! slope 1 and intercept 0 they stay integers. Of several time points the first is read, and that is said; more
//! than one value for each voxel (`dim[5]` and on) is refused. Extensions are passed over by `vox_offset`.
//!
//! The header is a table of fields at fixed bytes, so that this file reads it itself.

use crate::file::File;
use crate::inflate;
use crate::scalar::Scalar;
use crate::volumes::frame;
use crate::volumes::voxels::{Layout, Samples};
use crate::{Content, Endian, ImportError, Note, OpenOptions, Opened, Place};
use glam::{DMat3, DQuat, DVec3};
use oblate_volumes::{GridFrame, Space};
use std::borrow::Cow;

/// Bytes of a NIfTI-2 header, the longer one.
const HEADER: usize = 540;

/// A field of the header: where it begins and its number type, in NIfTI-1 and in NIfTI-2.
type Field = [(usize, Scalar); 2];

const DIM: Field = [(40, Scalar::I16), (16, Scalar::I64)];
const DATATYPE: Field = [(70, Scalar::I16), (12, Scalar::I16)];
const PIXDIM: Field = [(76, Scalar::F32), (104, Scalar::F64)];
const VOX_OFFSET: Field = [(108, Scalar::F32), (168, Scalar::I64)];
const SCL_SLOPE: Field = [(112, Scalar::F32), (176, Scalar::F64)];
const SCL_INTER: Field = [(116, Scalar::F32), (184, Scalar::F64)];
const QFORM_CODE: Field = [(252, Scalar::I16), (344, Scalar::I32)];
const SFORM_CODE: Field = [(254, Scalar::I16), (348, Scalar::I32)];
const QUATERN: Field = [(256, Scalar::F32), (352, Scalar::F64)];
const QOFFSET: Field = [(268, Scalar::F32), (376, Scalar::F64)];
const SROW: Field = [(280, Scalar::F32), (400, Scalar::F64)];

/// A header's bytes and how they are read.
struct Header<'a> {
    file: &'a File,
    bytes: &'a [u8],
    /// 0 for NIfTI-1, 1 for NIfTI-2.
    version: usize,
    endian: Endian,
    /// Whether the samples are in an `.img` beside it.
    is_pair: bool,
}

/// Whether a file that begins with `bytes`, 348 or more, is NIfTI: its version (0 or 1) and whether it is one of a pair.
fn magic(bytes: &[u8]) -> Option<(usize, bool)> {
    let at = |range: std::ops::Range<usize>| bytes.get(range);
    match (at(344..348), at(4..8)) {
        (_, Some(b"n+2\0")) => Some((1, false)),
        (_, Some(b"ni2\0")) => Some((1, true)),
        (Some(b"n+1\0"), _) => Some((0, false)),
        (Some(b"ni1\0"), _) => Some((0, true)),
        _ => None,
    }
}

/// Whether a file that begins with `bytes` is NIfTI, as it stands or under gzip.
pub(crate) fn begins(bytes: &[u8]) -> bool {
    magic(&head(bytes)).is_some()
}

/// A file's first bytes, unpacked, up to the length of a header.
fn head(bytes: &[u8]) -> Vec<u8> {
    if bytes.starts_with(&inflate::GZIP) {
        inflate::gzip_beginning(bytes, HEADER)
    } else {
        bytes[..bytes.len().min(HEADER)].to_vec()
    }
}

/// Reads a volume.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let head = head(&file.bytes);
    let header = Header::new(file, &head)?;
    let mut notes = Vec::new();
    let (dims, frames) = header.dims()?;
    let layout = Layout { dims, scalar: header.scalar()?, endian: header.endian };
    let frame = header.frame(&mut notes)?;
    let scale = header.scale()?;
    let frame_bytes = layout.bytes(file)?;
    let start = header.start()?;
    let Some(end) = frame_bytes.checked_mul(frames).and_then(|all| all.checked_add(start)) else {
        return Err(file.malformed(Place::Byte(DIM[header.version].0), "dim is more than memory can hold"));
    };
    let data = if header.is_pair { Some(header.samples_file()?) } else { None };
    let source = data.as_ref().unwrap_or(file);
    let bytes = contents(source, end, options.max_memory)?;
    if frames > 1 {
        notes.push(Note::LeftOut(format!("time points 2 to {frames}")));
    }
    if bytes.len() > end {
        notes.push(Note::LeftOut(format!("{} bytes after the samples", bytes.len() - end)));
    }
    let samples = &bytes[start..start + frame_bytes];
    let voxels = match scale {
        Some(scale) => layout.scaled_voxels(file, samples, scale)?,
        None => layout.voxels(file, &Samples::Binary(Cow::Borrowed(samples)))?,
    };
    let volume = layout.placed(file, voxels, frame, options)?;
    Ok(Opened::noting(Content::Volume(volume), notes))
}

/// A file's bytes, unpacked, of which there are at least `expected`.
fn contents(source: &File, expected: usize, limit: u64) -> Result<Cow<'_, [u8]>, ImportError> {
    let malformed = |problem: String| source.malformed(Place::Whole, problem);
    let bytes = if source.bytes.starts_with(&inflate::GZIP) {
        inflate::can_hold(source.bytes.len(), expected).map_err(malformed)?;
        inflate::within(expected, limit).map_err(malformed)?;
        Cow::Owned(inflate::gunzip_all(&source.bytes, limit).map_err(malformed)?)
    } else {
        Cow::Borrowed(&source.bytes[..])
    };
    if bytes.len() < expected {
        return Err(malformed(format!("{} bytes; the header needs {expected}", bytes.len())));
    }
    Ok(bytes)
}

impl<'a> Header<'a> {
    fn new(file: &'a File, bytes: &'a [u8]) -> Result<Self, ImportError> {
        let Some((version, is_pair)) = magic(bytes) else {
            let problem = "no NIfTI header begins it: \"n+1\" or \"ni1\" at byte 344, or \"n+2\" or \"ni2\" at byte 4 \
                           (headers of Analyze 7.5 have none and are not supported)";
            return Err(file.malformed(Place::Whole, problem));
        };
        let length = [348, HEADER][version];
        if bytes.len() < length {
            let problem = format!("{} bytes; a header of NIfTI-{} has {length}", bytes.len(), version + 1);
            return Err(file.malformed(Place::Whole, problem));
        }
        let mut header = Self { file, bytes, version, endian: Endian::Little, is_pair };
        if !header.has_axes() {
            header.endian = Endian::Big;
        }
        if !header.has_axes() {
            return Err(header.malformed(DIM, "dim[0], the number of axes, must be 1 to 7".into()));
        }
        Ok(header)
    }

    fn has_axes(&self) -> bool {
        (1.0..=7.0).contains(&self.number(DIM, 0))
    }

    /// Number `index` of a field; all fields end within the header.
    fn number(&self, field: Field, index: usize) -> f64 {
        let (at, scalar) = field[self.version];
        let bytes = self.bytes.get(at + index * scalar.size()..).unwrap_or_default();
        scalar.first(bytes, self.endian).unwrap_or(f64::NAN)
    }

    fn vector(&self, field: Field, first: usize) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|i| self.number(field, first + i)))
    }

    fn malformed(&self, field: Field, problem: String) -> ImportError {
        self.file.malformed(Place::Byte(field[self.version].0), problem)
    }

    fn unsupported(&self, field: Field, feature: String) -> ImportError {
        self.file.unsupported(Place::Byte(field[self.version].0), feature)
    }

    /// Samples along x, y and z, and the number of time points.
    fn dims(&self) -> Result<([usize; 3], usize), ImportError> {
        let axes = self.number(DIM, 0) as usize;
        let mut sizes = [1; 7];
        for (axis, size) in sizes.iter_mut().enumerate().take(axes) {
            let stated = self.number(DIM, axis + 1);
            if stated >= 1.0 {
                *size = stated as usize;
            } else if axis < 3 {
                return Err(self.malformed(DIM, format!("dim[{}] is {stated}; it must be above 0", axis + 1)));
            }
        }
        if let Some(axis) = (4..7).find(|&axis| sizes[axis] > 1) {
            let feature =
                format!("dim[{}] is {}: one value for each voxel is supported", axis + 1, sizes[axis]);
            return Err(self.unsupported(DIM, feature));
        }
        Ok(([sizes[0], sizes[1], sizes[2]], sizes[3]))
    }

    fn scalar(&self) -> Result<Scalar, ImportError> {
        let code = self.number(DATATYPE, 0);
        let name = match code as i64 {
            2 => return Ok(Scalar::U8),
            4 => return Ok(Scalar::I16),
            8 => return Ok(Scalar::I32),
            16 => return Ok(Scalar::F32),
            64 => return Ok(Scalar::F64),
            256 => return Ok(Scalar::I8),
            512 => return Ok(Scalar::U16),
            768 => return Ok(Scalar::U32),
            1024 => return Ok(Scalar::I64),
            1280 => return Ok(Scalar::U64),
            1 => "single bits",
            32 | 1792 | 2048 => "complex numbers",
            128 | 2304 => "colours",
            1536 => "128-bit floating point",
            _ => "no type of NIfTI",
        };
        let feature =
            format!("datatype {code} ({name}); integers and floating point of 8 to 64 bits are supported");
        Err(self.unsupported(DATATYPE, feature))
    }

    /// Slope and intercept, unless they change nothing.
    fn scale(&self) -> Result<Option<(f64, f64)>, ImportError> {
        let (slope, intercept) = (self.number(SCL_SLOPE, 0), self.number(SCL_INTER, 0));
        if slope == 0.0 || !slope.is_finite() || (slope, intercept) == (1.0, 0.0) {
            Ok(None)
        } else if intercept.is_finite() {
            Ok(Some((slope, intercept)))
        } else {
            Err(self.malformed(
                SCL_INTER,
                format!("scl_inter is {intercept} with scl_slope {slope}; it must be finite"),
            ))
        }
    }

    /// The byte at which the samples begin.
    fn start(&self) -> Result<usize, ImportError> {
        // Four bytes say whether extensions follow the header.
        let least = if self.is_pair { 0 } else { [348, HEADER][self.version] + 4 };
        match self.number(VOX_OFFSET, 0) {
            0.0 => Ok(least),
            offset if offset >= least as f64 && offset < 2.0_f64.powi(53) && offset.fract() == 0.0 => {
                Ok(offset as usize)
            }
            offset => {
                let problem =
                    format!("vox_offset is {offset}; it must be 0 or a whole number from {least} on");
                Err(self.malformed(VOX_OFFSET, problem))
            }
        }
    }

    /// Distances between samples; those that are not known are 1.
    fn spacing(&self, notes: &mut Vec<Note>) -> Result<DVec3, ImportError> {
        let mut spacing = self.vector(PIXDIM, 1);
        for axis in 0..3 {
            if spacing[axis] == 0.0 || !spacing[axis].is_finite() {
                notes.push(Note::Assumed(format!(
                    "a spacing of 1, as pixdim[{}] is {}",
                    axis + 1,
                    spacing[axis]
                )));
                spacing[axis] = 1.0;
            } else if spacing[axis] < 0.0 {
                let problem = format!("pixdim[{}] is {}; it must be above 0", axis + 1, spacing[axis]);
                return Err(self.malformed(PIXDIM, problem));
            }
        }
        Ok(spacing)
    }

    fn frame(&self, notes: &mut Vec<Note>) -> Result<GridFrame, ImportError> {
        if self.number(SFORM_CODE, 0) > 0.0 {
            let rows = [0, 4, 8].map(|first| self.vector(SROW, first));
            let origin = DVec3::from_array([3, 7, 11].map(|index| self.number(SROW, index)));
            let edges = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            return Ok(GridFrame { space: Some(Space::Ras), ..frame::of_edges(origin, edges) });
        }
        let spacing = self.spacing(notes)?;
        if self.number(QFORM_CODE, 0) > 0.0 {
            let mut edges = DMat3::from_quat(self.rotation()?) * DMat3::from_diagonal(spacing);
            // "qfac": the grid is left-handed.
            if self.number(PIXDIM, 0) < 0.0 {
                edges.z_axis = -edges.z_axis;
            }
            let frame = frame::of_edges(self.vector(QOFFSET, 0), edges);
            return Ok(GridFrame { space: Some(Space::Ras), ..frame });
        }
        notes.push(Note::Assumed(
            "x, y, z along the grid's axes from the first sample on, as sform_code and qform_code are 0"
                .into(),
        ));
        Ok(frame::of_edges(DVec3::ZERO, DMat3::from_diagonal(spacing)))
    }

    /// The unit quaternion whose real part, 0 or more, is not stored.
    fn rotation(&self) -> Result<DQuat, ImportError> {
        let imaginary = self.vector(QUATERN, 0);
        let squared = imaginary.length_squared();
        // A few ulps of f32 above 1 is a half turn, rounded.
        if squared.is_nan() || squared > 1.0 + 1e-5 {
            let problem = format!("quatern_b, c, d are {imaginary}: no part of a unit quaternion");
            return Err(self.malformed(QUATERN, problem));
        }
        let real = (1.0 - squared).max(0.0).sqrt();
        Ok(DQuat::from_xyzw(imaginary.x, imaginary.y, imaginary.z, real).normalize())
    }

    /// The `.img` beside a `.hdr`, also under gzip.
    fn samples_file(&self) -> Result<File, ImportError> {
        let path = &self.file.path;
        let is_gz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
        let stem = if is_gz { path.with_extension("") } else { path.clone() };
        let plain = stem.with_extension("img");
        let packed = stem.with_extension("img.gz");
        let named = if !plain.exists() && packed.exists() { packed } else { plain };
        let name = named.file_name().unwrap_or_default().to_string_lossy();
        self.file.read_named(Place::Byte(if self.version == 0 { 344 } else { 4 }), &name)
    }
}
