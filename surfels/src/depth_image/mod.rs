//! Depth images: photographs that know how far away each of their pixels is.

use glam::{DVec2, DVec3};
use oblate_engine::{CameraError, CloudError, Intrinsics, Pose};
use thiserror::Error;

/// What the numbers of a depth image measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthKind {
    /// z along the view axis, as most cameras and data sets have it.
    #[default]
    AlongAxis,
    /// The distance from the camera along the pixel's ray, as laser scanners and some renderers have it.
    AlongRay,
}

/// A picture with a depth for each pixel, and the pinhole camera that took it. Rows go from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdImage {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Linear Rec. 709, one for each pixel.
    pub colors: Vec<[f32; 3]>,
    /// In world units, one for each pixel. What is not finite or not above 0 is unknown: nothing is drawn there.
    pub depths: Vec<f32>,
    /// What they measure.
    pub kind: DepthKind,
    /// In pixels; the centre of the first pixel is (0.5, 0.5).
    pub intrinsics: Intrinsics,
    /// Where the camera stood.
    pub pose: Pose,
}

/// Why a depth image cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DepthError {
    /// Nothing is there.
    #[error("a depth image of {0} × {1} pixels; both sides must be from 1 to 65535")]
    Size(usize, usize),
    /// An array does not have one entry for each pixel.
    #[error("{found} {array} for {pixels} pixels; there must be one for each")]
    Length {
        /// The name of the array.
        array: &'static str,
        /// Its length.
        found: usize,
        /// How many pixels there are.
        pixels: usize,
    },
    /// A colour is infinite or not a number.
    #[error("the colour of pixel ({column}, {row}) is not finite")]
    Color {
        /// From the left, from 0.
        column: usize,
        /// From the top, from 0.
        row: usize,
    },
    /// No camera takes such pictures.
    #[error("the camera of the depth image: {0}")]
    Camera(#[from] CameraError),
    /// The surfels are not a cloud.
    #[error("the surfels cannot be drawn: {0}")]
    Cloud(#[from] CloudError),
}

impl RgbdImage {
    /// The point in camera space that is seen at a place of the picture, at a depth along the axis of 1.
    fn ray(&self, place: DVec2) -> DVec3 {
        ((place - self.intrinsics.center) / self.intrinsics.focal).extend(1.0)
    }
}
