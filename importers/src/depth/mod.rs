//! Depth maps, the photographs that belong to them, and the cameras that took both.
//!
//! | what | formats | read by |
//! |---|---|---|
//! | depths | PNG and PGM of 8 and 16 bits, TIFF, PFM, OpenEXR | [`read_depth`] |
//! | colours | PNG, JPEG, WebP, PGM and PPM, OpenEXR | [`read_color`] |
//! | poses | 4×4 matrices, TUM's trajectories, Redwood's logs | [`read_poses`] |
//! | intrinsics | JSON of Open3D's `PinholeCameraIntrinsic` | [`read_intrinsics`] |
//!
//! Formats are told by what a file holds. Rows go from top to bottom, columns from left to right, as they are stored: how a
//! JPEG says that it should be turned is not heeded, as the camera's numbers don't heed it either.
//!
//! Sources of what data sets mean: Scharstein, Szeliski, *High-Accuracy Stereo Depth Maps Using Structured Light*, 2003 (Middlebury);
//! Sturm et al., *A Benchmark for the Evaluation of RGB-D SLAM Systems*, 2012 (TUM); Silberman et al., *Indoor Segmentation and Support Inference
//! from RGBD Images*, 2012, with its toolbox (NYU); Shotton et al., *Scene Coordinate Regression Forests*, 2013 (7-Scenes); Choi, Zhou, Koltun,
//! *Robust Reconstruction of Indoor Scenes*, 2015 (Redwood); Song, Lichtenberg, Xiao, *SUN RGB-D*, 2015.
//!
//! `max_memory` is what a picture may unpack to in bytes; [`crate::OpenOptions::MAX_MEMORY`] is a good answer.

mod color;
mod exr;
mod intrinsics;
mod map;
mod pfm;
mod poses;

pub use color::{ColorImage, read_color};
pub use intrinsics::read_intrinsics;
pub use map::{DepthEncoding, DepthMap, read_depth};
pub use poses::{Stamp, TimedPose, read_poses};
