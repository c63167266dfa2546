//! Typed views of buffers, with every bound checked.

use super::buffers::{Buffers, slice};
use crate::Endian;
use crate::file::File;
use crate::scalar::{FromF64, Scalar};
use crate::{ImportError, Place};
use ::gltf::json::accessor::{ComponentType, Type, sparse};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index, Root, buffer};
use std::borrow::Cow;

/// How integers are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Integers {
    /// As the accessor's `normalized` says.
    AsMarked,
    /// As shares of the largest.
    Normalized,
}

/// Finds accessors.
pub(crate) struct Accessors<'a> {
    pub(crate) file: &'a File,
    pub(crate) root: &'a Root,
    pub(crate) buffers: &'a Buffers<'a>,
}

/// An accessor's elements in bytes.
pub(crate) struct Column<'a> {
    /// From the first element to the end of the last.
    bytes: Cow<'a, [u8]>,
    stride: usize,
    pub(crate) scalar: Scalar,
    /// What 1 is, where integers are shares of it.
    scale: f64,
    pub(crate) count: usize,
    /// Components of an element.
    pub(crate) width: usize,
}

impl Column<'_> {
    /// Whether they are integers that are shares of the largest.
    pub(crate) fn is_normalized(&self) -> bool {
        self.scale != 1.0
    }

    /// A component of an element; `row` must be below `count`.
    pub(crate) fn value(&self, row: usize, component: usize) -> f64 {
        let start = row * self.stride + component * self.scalar.size();
        let value = self.scalar.first(&self.bytes[start..], Endian::Little).unwrap_or(f64::NAN);
        // The smallest signed integer is as far as its opposite: -1.
        if self.scale == 1.0 { value } else { (value / self.scale).max(-1.0) }
    }

    /// All components, one element after the other.
    pub(crate) fn values<T: FromF64>(&self) -> Vec<T> {
        let rows = (0..self.count).flat_map(|row| (0..self.width).map(move |c| (row, c)));
        rows.map(|(row, c)| T::from_f64(self.value(row, c))).collect()
    }
}

impl<'a> Accessors<'a> {
    /// The elements of an accessor; the number of components in each must be one of `widths`.
    pub(crate) fn column(
        &self,
        index: Index<Accessor>,
        widths: &[usize],
        integers: Integers,
    ) -> Result<Column<'a>, ImportError> {
        let place = || Place::Part(format!("accessor {}", index.value()));
        let malformed = |problem: String| self.file.malformed(place(), problem);
        let accessor = self.root.get(index).ok_or_else(|| malformed("is named, but not there".into()))?;
        let (Checked::Valid(kind), Checked::Valid(component)) = (accessor.type_, accessor.component_type)
        else {
            return Err(malformed("type or componentType is none of glTF's".into()));
        };
        let width = match kind {
            Type::Scalar | Type::Vec2 | Type::Vec3 | Type::Vec4 => kind.multiplicity(),
            Type::Mat2 | Type::Mat3 | Type::Mat4 => 0,
        };
        if !widths.contains(&width) {
            return Err(malformed(format!("type {kind:?} does not fit; {widths:?} components are expected")));
        }
        let scalar = scalar(component.0);
        let count = usize::try_from(accessor.count.0).unwrap_or(usize::MAX);
        let normalized = accessor.normalized || integers == Integers::Normalized;
        let scale = if normalized { scalar.integer_max().unwrap_or(1.0) } else { 1.0 };
        let size = scalar.size() * width;
        let (mut bytes, mut stride) = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let (bytes, stride) =
                    self.elements(view, offset, (size, count)).map_err(|e| e.at(self.file, place()))?;
                (Cow::Borrowed(bytes), stride)
            }
            None => {
                if accessor.sparse.is_none() {
                    return Err(malformed(
                        "has no bufferView (compressed by an extension that is not read?)".into(),
                    ));
                }
                (Cow::Borrowed(&[][..]), size)
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let changes = self.changes(sparse, (size, count)).map_err(|e| e.at(self.file, place()))?;
            // All zero but for what is sparse: no bytes bound the count, so what they replace must.
            let limit = changes.indices.count.saturating_mul(1 << 10).max(1 << 16);
            if accessor.buffer_view.is_none() && count > limit {
                return Err(malformed(format!(
                    "{count} elements are not there but for {} sparse ones",
                    changes.indices.count
                )));
            }
            self.buffers.budget().take(self.file, place, (count, size))?;
            let mut dense = vec![0; count * size];
            for (to, from) in dense.chunks_exact_mut(size).zip(bytes.chunks(stride)) {
                to.copy_from_slice(&from[..size]);
            }
            changes.apply(&mut dense).map_err(malformed)?;
            (bytes, stride) = (Cow::Owned(dense), size);
        }
        Ok(Column { bytes, stride, scalar, scale, count, width })
    }

    /// The bytes of `count` elements of `size` bytes at `offset` in a view, if all are within it, and how far apart they are.
    fn elements(
        &self,
        view: Index<buffer::View>,
        offset: u64,
        (size, count): (usize, usize),
    ) -> Result<(&'a [u8], usize), Fault> {
        let (bytes, stride) = self.buffers.view(view)?;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(format!("byteStride {stride} is less than an element's {size} bytes").into());
        }
        let length = match count {
            0 => Some(0),
            _ => (count - 1).checked_mul(stride).and_then(|length| length.checked_add(size)),
        };
        let within = length.and_then(|length| slice(bytes, offset, length as u64));
        let problem = || {
            format!(
                "{count} elements of {size} bytes, {stride} apart, from byte {offset} go beyond bufferView {} of {} bytes",
                view.value(),
                bytes.len()
            )
        };
        Ok((within.ok_or_else(problem)?, stride))
    }

    /// What a sparse accessor replaces among `count` elements of `size` bytes.
    fn changes(&self, sparse: &sparse::Sparse, (size, count): (usize, usize)) -> Result<Changes<'a>, Fault> {
        let changed = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
        // Each is replaced once (glTF 2.0, 3.6.2.3): otherwise few elements could take long.
        if changed > count {
            return Err(format!("sparse.count is {changed}, but there are {count} elements").into());
        }
        let Checked::Valid(index_type) = sparse.indices.component_type else {
            return Err("sparse.indices.componentType is no index type".to_owned().into());
        };
        let scalar = self::scalar(index_type.0);
        let place = (sparse.indices.buffer_view, sparse.indices.byte_offset.0);
        let (bytes, stride) = self.elements(place.0, place.1, (scalar.size(), changed))?;
        let indices =
            Column { bytes: Cow::Borrowed(bytes), stride, scalar, scale: 1.0, count: changed, width: 1 };
        let place = (sparse.values.buffer_view, sparse.values.byte_offset.0);
        let (values, stride) = self.elements(place.0, place.1, (size, changed))?;
        Ok(Changes { indices, values, stride, size })
    }
}

/// Elements of `size` bytes, `stride` apart, and where they go.
struct Changes<'a> {
    indices: Column<'a>,
    values: &'a [u8],
    stride: usize,
    size: usize,
}

impl Changes<'_> {
    /// Puts them into elements without gaps.
    fn apply(&self, dense: &mut [u8]) -> Result<(), String> {
        let rows = dense.len() / self.size;
        for number in 0..self.indices.count {
            let index = self.indices.value(number, 0);
            let Some(element) = dense.chunks_exact_mut(self.size).nth(index as usize) else {
                return Err(format!("sparse index {index} must be below {rows}"));
            };
            element.copy_from_slice(&self.values[number * self.stride..][..self.size]);
        }
        Ok(())
    }
}

/// A problem with an accessor, or an error that already has its place.
enum Fault {
    Here(String),
    Elsewhere(ImportError),
}

impl Fault {
    fn at(self, file: &File, place: Place) -> ImportError {
        match self {
            Self::Here(problem) => file.malformed(place, problem),
            Self::Elsewhere(error) => error,
        }
    }
}

impl From<String> for Fault {
    fn from(problem: String) -> Self {
        Self::Here(problem)
    }
}

impl From<ImportError> for Fault {
    fn from(error: ImportError) -> Self {
        Self::Elsewhere(error)
    }
}

fn scalar(component: ComponentType) -> Scalar {
    match component {
        ComponentType::I8 => Scalar::I8,
        ComponentType::U8 => Scalar::U8,
        ComponentType::I16 => Scalar::I16,
        ComponentType::U16 => Scalar::U16,
        ComponentType::U32 => Scalar::U32,
        ComponentType::F32 => Scalar::F32,
    }
}
