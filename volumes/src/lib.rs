//! Grids to volume kernels and iso-surfels.
//!
//! A [`Volume`] becomes splats in two ways, and both can be drawn together: [`to_kernels`] turns each sample
//! that a [`TransferFunction`] makes visible into an extinction kernel, and a [`Classifier`] does so again each
//! time the function changes; [`iso_surfels`] samples the surface at a value. An [`IrregularVolume`], whose samples lie on no regular grid, does
//! the same by its [`Partition`] and [`IrregularVolume::iso_surfels`]. [`PRESETS`] and [`propose_iso`]
//! look at the volume's [`Histogram`] when the user says nothing. [`painted`] gives splats the colours of another volume.

mod brick;
mod classify;
mod field;
pub mod histogram;
pub mod irregular;
pub mod iso;
pub mod kernels;
pub mod paint;
pub mod phantom;
pub mod presets;
mod space;
pub mod transfer;
mod transfer_text;
pub mod volume;

pub use histogram::{Classes, Histogram, propose_iso};
pub use irregular::{Arrangement, IrregularError, IrregularExtractor, IrregularVolume, Partition, Residual};
pub use iso::{
    Grid, IRREGULAR_COVERAGE_FLOOR, ISO_COVERAGE_FLOOR, Interpolation, IsoError, IsoExtractor, IsoSettings,
    IsoSurfel, IsoSurfels, SURFEL_BLUR, iso_surfels, stream_iso_surfels,
};
pub use kernels::{Classifier, Flattening, KERNEL_SIGMA, KernelSettings, to_kernels};
pub use paint::painted;
pub use phantom::{marschner_lobb, shepp_logan};
pub use presets::{PRESETS, Preset, preset};
pub use space::Space;
pub use transfer::{
    ColorSpace, ControlPoint, GradientRamp, MAX_OPACITY, Optical, StrengthKind, TransferError,
    TransferFunction,
};
pub use transfer_text::TransferTextError;
pub use volume::{GridFrame, Volume, VolumeError, Voxels};
