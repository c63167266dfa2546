//! Stage `raster`: a tile's records and octets to amplitudes at its pixels, a block of 4×4 at a time.
//!
//! Records are taken in batches. First it is found which blocks each ellipse meets; then each block takes its records
//! one after the other, and keeps meanwhile in registers what they make of its pixels.

mod column;
mod kernel;
mod offsets;
mod outline;
mod plain;
mod sixteen;
mod slabs;
mod surfel;

pub(crate) use column::{BATCH, Column};
pub(crate) use kernel::{Fragments, KERNEL_REACH, KernelLens, Kernels, Places, Spans, reach_to_cuts};
pub(crate) use slabs::{Grain, SlabColumns, SlabShare};
pub(crate) use surfel::{
    CloudSurface, Look, Room, STEEPEST, SURFEL_REACH, Surfaces, Surfel, SurfelLens, Surfels,
};
