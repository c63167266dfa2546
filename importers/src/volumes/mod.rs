//! Files to volumes.

pub mod nrrd;
pub mod raw;
pub(crate) mod voxels;
pub mod vti;
mod vti_array;
