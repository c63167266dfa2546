//! Grids to volume kernels and iso-surfels.

pub mod volume;

pub use volume::{GridFrame, Volume, VolumeError, Voxels};
