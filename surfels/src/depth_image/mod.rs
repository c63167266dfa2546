//! Depth images to surfels: one for each pixel, as large as the pixel is on the surface that it shows.
//!
//! `rows` puts the numbers of an image in rows, `edges` says which pixels show one surface, `plane` fits a plane around each of them,
//! `surfels` makes the splats, which are cut where a surface ends; sixteen pixels of a row at once (`lanes`). They are put down square by
//! square (`squares`), two of them at a time (`pairs`).

mod edges;
mod fill;
mod lanes;
mod pairs;
mod plane;
mod room;
mod rows;
mod scattered;
mod squares;
mod surfels;
mod views;

pub use fill::fill_disocclusions;
pub use room::{Hit, Room};
pub use surfels::{DEPTH_LOW_PASS, DepthSettings, depth_surfels};
pub use views::{DepthSampler, merged_depth_surfels};

use glam::{DVec2, DVec3};
use oblate_engine::{Camera, CameraError, CloudError, Intrinsics, Pose, Projection};
use rayon::prelude::*;
use thiserror::Error;

/// Depths along the axis are known if their inverses are larger: below 1e10.
const LEAST_INVERSE: f32 = 1e-10;

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
    /// In world units, one for each pixel. What is not above 0 is unknown, and so is what has a z of 1e10 or more, which some renderers write where
    /// they hit nothing, or one so small that its inverse isn't finite: nothing is drawn there.
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
    /// No pixel has a depth.
    #[error("no pixel has a depth that is above 0, below 1e10 and large enough for its inverse to be finite")]
    NoDepth,
    /// No camera takes such pictures.
    #[error("the camera of the depth image: {0}")]
    Camera(#[from] CameraError),
    /// The surfels are not a cloud.
    #[error("the surfels cannot be drawn: {0}")]
    Cloud(#[from] CloudError),
}

impl RgbdImage {
    /// The camera that took it.
    ///
    /// # Errors
    /// When size, intrinsics or pose are none of a pinhole camera.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        // What a u32 doesn't hold is refused as any side that is too long.
        let size = self.size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        Camera::from_intrinsics(self.pose, self.intrinsics, Projection::Perspective, size)
    }

    /// The point in camera space, at a depth along the axis of 1, that is seen at a place of the picture.
    pub fn ray(&self, place: DVec2) -> DVec3 {
        ((place - self.intrinsics.center) / self.intrinsics.focal).extend(1.0)
    }

    /// Says what is wrong with it.
    ///
    /// # Errors
    /// When its camera is none, or an array is too long, too short or of colours that are not finite.
    pub fn check(&self) -> Result<(), DepthError> {
        self.check_shape()?;
        let wrong = |row| self.check_colors(row).err();
        (0..self.size[1]).into_par_iter().find_map_first(wrong).map_or(Ok(()), Err)
    }

    /// Says what is wrong with the colours of a row.
    fn check_colors(&self, row: usize) -> Result<(), DepthError> {
        let [width, _] = self.size;
        let colors = &self.colors[row * width..][..width];
        let column = colors.iter().position(|color| !color.iter().all(|c| c.is_finite()));
        column.map_or(Ok(()), |column| Err(DepthError::Color { column, row }))
    }

    /// The same, but for colours.
    fn check_shape(&self) -> Result<(), DepthError> {
        self.camera()?;
        let [width, height] = self.size;
        let pixels = width * height;
        for (array, found) in [("colours", self.colors.len()), ("depths", self.depths.len())] {
            if found != pixels {
                return Err(DepthError::Length { array, found, pixels });
            }
        }
        Ok(())
    }

    /// The depths along the axis; 0 where unknown.
    pub fn depths_along_axis(&self) -> Vec<f32> {
        self.depths.par_iter().enumerate().map(|(at, depth)| self.along_axis(at, *depth)).collect()
    }

    /// The depth of a pixel along the axis; 0 where unknown.
    #[inline(always)]
    fn along_axis(&self, at: usize, depth: f32) -> f32 {
        let known =
            |depth: f32| if 1.0 / depth > LEAST_INVERSE && 1.0 / depth < f32::INFINITY { depth } else { 0.0 };
        match self.kind {
            DepthKind::AlongAxis => known(depth),
            DepthKind::AlongRay => {
                let place = [at % self.size[0], at / self.size[0]].map(|x| x as f64 + 0.5);
                known((f64::from(depth) / self.ray(place.into()).length()) as f32)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine3;

    /// The image that a camera at the origin takes of `inverse_depth` at a ray (x, y, 1), grey.
    pub(super) fn image(size: [usize; 2], inverse_depth: impl Fn(DVec3) -> f64) -> RgbdImage {
        let intrinsics = Intrinsics {
            focal: DVec2::splat(size[0] as f64),
            center: DVec2::new(size[0] as f64, size[1] as f64) / 2.0,
        };
        let pose = Pose { world_to_camera: DAffine3::IDENTITY };
        let pixels = size[0] * size[1];
        let (colors, depths, kind) = (vec![[0.5; 3]; pixels], vec![1.0; pixels], DepthKind::AlongAxis);
        let mut image = RgbdImage { size, colors, depths, kind, intrinsics, pose };
        for at in 0..pixels {
            let place = DVec2::new((at % size[0]) as f64 + 0.5, (at / size[0]) as f64 + 0.5);
            image.depths[at] = (1.0 / inverse_depth(image.ray(place))) as f32;
        }
        image
    }

    /// The plane n · p = 1.
    pub(super) fn plane(n: [f64; 3]) -> impl Fn(DVec3) -> f64 {
        move |ray| ray.dot(n.into())
    }
}
