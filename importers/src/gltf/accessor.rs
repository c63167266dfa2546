//! Typed views of buffers, with every bound checked.

use super::buffers::{Buffers, slice};
use crate::Endian;
use crate::file::File;
use crate::scalar::{FromF64, Scalar};
use crate::{ImportError, Place};
use ::gltf::json::accessor::{ComponentType, Type, sparse};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index, Root, buffer};

/// How integers are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Integers {
    /// As the accessor's `normalized` says.
    AsMarked,
    /// As shares of the largest.
    Normalized,
}

/// Reads accessors.
pub(crate) struct Accessors<'a> {
    pub(crate) file: &'a File,
    pub(crate) root: &'a Root,
    pub(crate) buffers: &'a Buffers<'a>,
}

/// Elements in bytes.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    scalar: Scalar,
}

impl Accessors<'_> {
    /// The elements of an accessor, one after the other, and the number of components in each, which must
    /// be one of `widths`.
    pub(crate) fn read<T: FromF64>(
        &self,
        index: Index<Accessor>,
        widths: &[usize],
        integers: Integers,
    ) -> Result<(usize, Vec<T>), ImportError> {
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
        // The smallest signed integer is as far as its opposite: -1.
        let convert = |value: f64| T::from_f64(if scale == 1.0 { value } else { (value / scale).max(-1.0) });
        let mut values: Vec<T> = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let elements = self
                    .elements(view, offset, (scalar, width, count))
                    .map_err(|e| e.at(self.file, place()))?;
                elements.values(count, width).map(convert).collect()
            }
            None => {
                let Some(sparse) = &accessor.sparse else {
                    return Err(malformed(
                        "has no bufferView (compressed by an extension that is not read?)".into(),
                    ));
                };
                // All zero but for what is sparse: no bytes bound the count, so what they replace must.
                let limit = usize::try_from(sparse.count.0).unwrap_or(0).saturating_mul(1 << 10).max(1 << 16);
                if count > limit {
                    return Err(malformed(format!(
                        "{count} elements are not there but for {limit} sparse ones"
                    )));
                }
                vec![convert(0.0); count * width]
            }
        };
        if let Some(sparse) = &accessor.sparse {
            self.replace(sparse, (scalar, width, count), |at, value| values[at] = convert(value))
                .map_err(|e| e.at(self.file, place()))?;
        }
        Ok((width, values))
    }

    /// The elements at `offset` in a view, if all are within it.
    fn elements(
        &self,
        view: Index<buffer::View>,
        offset: u64,
        (scalar, width, count): (Scalar, usize, usize),
    ) -> Result<Elements<'_>, Fault> {
        let (bytes, stride) = self.buffers.view(view)?;
        let size = scalar.size() * width;
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
        Ok(Elements { bytes: within.ok_or_else(problem)?, stride, scalar })
    }

    /// Calls `set` with each component's place and value that a sparse accessor replaces.
    fn replace(
        &self,
        sparse: &sparse::Sparse,
        (scalar, width, count): (Scalar, usize, usize),
        mut set: impl FnMut(usize, f64),
    ) -> Result<(), Fault> {
        let replaced = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
        let Checked::Valid(index_type) = sparse.indices.component_type else {
            return Err("sparse.indices.componentType is no index type".to_owned().into());
        };
        let indices = (self::scalar(index_type.0), 1, replaced);
        let indices = self.elements(sparse.indices.buffer_view, sparse.indices.byte_offset.0, indices)?;
        let values =
            self.elements(sparse.values.buffer_view, sparse.values.byte_offset.0, (scalar, width, replaced))?;
        let mut values = values.values(replaced, width);
        for index in indices.values(replaced, 1) {
            let index = index as usize;
            if index >= count {
                return Err(format!("sparse index {index} must be below {count}").into());
            }
            values.by_ref().take(width).enumerate().for_each(|(c, value)| set(index * width + c, value));
        }
        Ok(())
    }
}

impl Elements<'_> {
    fn values(&self, count: usize, width: usize) -> impl Iterator<Item = f64> {
        let size = self.scalar.size();
        let starts = (0..count).flat_map(move |i| (0..width).map(move |c| i * self.stride + c * size));
        // All lie within the bytes, whose length was made from these numbers.
        starts.filter_map(|start| self.scalar.first(&self.bytes[start..], Endian::Little))
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
