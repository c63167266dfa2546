//! Files to volumes.

pub(crate) mod frame;
pub mod meta_image;
pub mod nifti;
pub mod nrrd;
pub mod raw;
pub(crate) mod voxels;
pub mod vtk;
