//! Sampled scalar fields on regular grids.

use glam::{DAffine3, DMat3, DVec3};
use thiserror::Error;

use crate::space::Space;

/// The samples of a volume in its file's number type, x fastest, then y, then z.
#[derive(Clone, Debug, PartialEq)]
pub enum Voxels {
    /// 8 bits.
    U8(Vec<u8>),
    /// 16 bits.
    U16(Vec<u16>),
    /// 16 bits, signed.
    I16(Vec<i16>),
    /// Floating point; values that are not finite are empty.
    F32(Vec<f32>),
}

impl Voxels {
    /// The number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::I16(v) => v.len(),
            Self::F32(v) => v.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample `index` as f32.
    pub fn get(&self, index: usize) -> f32 {
        match self {
            Self::U8(v) => f32::from(v[index]),
            Self::U16(v) => f32::from(v[index]),
            Self::I16(v) => f32::from(v[index]),
            Self::F32(v) => v[index],
        }
    }

    /// The name that `--type` uses.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "u8",
            Self::U16(_) => "u16",
            Self::I16(_) => "i16",
            Self::F32(_) => "f32",
        }
    }
}

/// Where a grid's samples lie: sample (i, j, k) is at origin + direction · (spacing ∘ (i, j, k)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridFrame {
    /// Distance between samples along the grid's axes in world units, each above 0.
    pub spacing: DVec3,
    /// World position of sample (0, 0, 0).
    pub origin: DVec3,
    /// Directions of the grid's axes in the world, as columns; invertible. Where they aren't unit vectors they stretch the spacing.
    pub direction: DMat3,
    /// What the file calls the world that this is in, if it does. It is passed on, and moves nothing.
    pub space: Option<Space>,
}

impl Default for GridFrame {
    fn default() -> Self {
        Self { spacing: DVec3::ONE, origin: DVec3::ZERO, direction: DMat3::IDENTITY, space: None }
    }
}

/// A scalar field on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    dims: [usize; 3],
    voxels: Voxels,
    frame: GridFrame,
}

/// Why numbers do not make a volume.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum VolumeError {
    /// The dimensions do not fit the samples.
    #[error("dims {dims:?} need {expected} voxels, but there are {found}")]
    Count {
        /// Samples along x, y, z.
        dims: [usize; 3],
        /// Their product.
        expected: u128,
        /// How many there are.
        found: usize,
    },
    /// Samples between samples that cannot be.
    #[error("dims {dims:?} with {times} samples a step are none, or more than fit into memory")]
    Refined {
        /// Samples a step.
        times: usize,
        /// Samples along x, y, z.
        dims: [usize; 3],
    },
    /// A number of the frame is outside its range.
    #[error("{what} is {value}; {expected}")]
    Frame {
        /// Which.
        what: &'static str,
        /// What it is.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
}

impl Volume {
    /// A volume of `dims` samples along x, y, z.
    ///
    /// # Errors
    /// When the count differs from the product of `dims`, a dimension is 0, a spacing is not above 0, or
    /// the directions do not span space.
    pub fn new(dims: [usize; 3], voxels: Voxels, frame: GridFrame) -> Result<Self, VolumeError> {
        let expected = dims.iter().map(|&d| d as u128).product::<u128>();
        if expected == 0 || expected != voxels.len() as u128 {
            return Err(VolumeError::Count { dims, expected, found: voxels.len() });
        }
        let bad = |what, value: String, expected| Err(VolumeError::Frame { what, value, expected });
        if !(frame.spacing.is_finite() && frame.spacing.min_element() > 0.0) {
            return bad("spacing", frame.spacing.to_string(), "each must be finite and above 0");
        }
        if !frame.origin.is_finite() {
            return bad("origin", frame.origin.to_string(), "it must be finite");
        }
        let determinant = frame.direction.determinant();
        if !(frame.direction.is_finite() && determinant.abs() > 1e-6) {
            return bad("direction", frame.direction.to_string(), "its columns must span space");
        }
        Ok(Self { dims, voxels, frame })
    }

    /// Samples along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The samples.
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }

    /// The samples alone.
    pub fn into_voxels(self) -> Voxels {
        self.voxels
    }

    /// Where they lie.
    pub fn frame(&self) -> GridFrame {
        self.frame
    }

    /// The same samples elsewhere.
    ///
    /// # Errors
    /// As [`Volume::new`].
    pub fn with_frame(self, frame: GridFrame) -> Result<Self, VolumeError> {
        Self::new(self.dims, self.voxels, frame)
    }

    /// Sample (i, j, k); each index below its dimension.
    pub fn value(&self, index: [usize; 3]) -> f32 {
        self.voxels.get(self.place(index))
    }

    /// Where sample (i, j, k) lies among the samples.
    #[inline]
    pub(crate) fn place(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.dims[1] + j) * self.dims[0] + i
    }

    /// From sample indices to the world.
    pub fn index_to_world(&self) -> DAffine3 {
        let linear = self.frame.direction * DMat3::from_diagonal(self.frame.spacing);
        DAffine3::from_mat3_translation(linear, self.frame.origin)
    }
}
