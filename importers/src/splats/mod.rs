//! Trained Gaussian splats: what all their formats come to.
//!
//! Kerbl, Kopanas, Leimkühler, Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023.
//! A reader turns a file's numbers to `Trained` records; `gather` checks them and makes splats of them, and
//! `trained` goes the way back for writers. Whatever the format, a record is left out, counted and reported if it
//! is no splat:
//!
//! - a number of it is not one (NaN, or infinite where that means nothing);
//! - its quaternion is zero: real files hold rows of zeros;
//! - the logarithm of one of its σ is finite and beyond ±40;
//! - a coefficient of its colour is beyond ±1e12, so that sums of harmonics could be infinite.
//!
//! **Axes**: all formats come out on those that a 3DGS .ply of the same scene has. By the convention of training from
//! photographs that is x right, y down, z ahead, though no file says so; SPZ, which says otherwise, is turned.
//!
//! Opacities 0 and 1, σ of 0 (flat splats) and any place that single precision has are drawn.

mod gather;
pub mod ksplat;
pub(crate) mod packed;
mod rotate;
pub mod sog;
pub mod splat;
pub mod spz;
mod trained;

pub(crate) use gather::{ROWS, Sink, Training, gather};
pub(crate) use rotate::Turn;
pub(crate) use trained::{
    LARGEST_LOG_SCALE, Trained, color, constant, half_axes, log_scale, of_half_axes, trained,
};
