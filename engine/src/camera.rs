//! Cameras: pinhole and orthographic, kept in f64.

use crate::cull::largest_stretch;
use glam::{DAffine3, DMat3, DVec2, DVec3};
use thiserror::Error;

/// Where a camera stands: camera space is x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// From the world to camera space; a rigid motion.
    pub world_to_camera: DAffine3,
}

/// Intrinsics in pixels: a camera-space point (x, y, z) is seen at `focal * (x, y) / z + center`, or, by an
/// orthographic camera, at `focal * (x, y) + center`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal lengths f_x, f_y in pixels; for an orthographic camera pixels a world unit.
    pub focal: DVec2,
    /// Principal point in pixels from the top left corner of the picture.
    pub center: DVec2,
}

/// How depth acts on the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// A pinhole camera.
    Perspective,
    /// Parallel rays along the view axis.
    Orthographic,
}

/// A camera and the size of its picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pose: Pose,
    intrinsics: Intrinsics,
    projection: Projection,
    size: [u32; 2],
    near: f64,
}

/// Why numbers do not make a camera.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CameraError {
    /// The view direction is undefined.
    #[error("eye {eye} and target {target} are one point; they must differ")]
    NoDirection {
        /// Where the camera stands.
        eye: DVec3,
        /// What it looks at.
        target: DVec3,
    },
    /// The up vector says nothing about the roll.
    #[error("up {up} is parallel to the view direction {forward}; choose another")]
    NoRoll {
        /// The up vector given.
        up: DVec3,
        /// The view direction.
        forward: DVec3,
    },
    /// A number is outside its range.
    #[error("{what} is {value}; {expected}")]
    Value {
        /// Which number.
        what: &'static str,
        /// What it is.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
}

impl Pose {
    /// Stands at `eye`, looks at `target`, with `up` upwards in the picture (world space, any length).
    ///
    /// # Errors
    /// When the points coincide, `up` is parallel to the view direction, or a number is not finite.
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Result<Self, CameraError> {
        for (what, v) in [("eye", eye), ("target", target), ("up", up)] {
            if !v.is_finite() {
                let value = v.to_array().into_iter().find(|x| !x.is_finite()).unwrap_or(f64::NAN);
                return Err(CameraError::Value { what, value, expected: "it must be finite" });
            }
        }
        let forward = (target - eye).try_normalize().ok_or(CameraError::NoDirection { eye, target })?;
        let up_unit = up.try_normalize().ok_or(CameraError::NoRoll { up, forward })?;
        let right = forward.cross(up_unit);
        if right.length() < 1e-9 {
            return Err(CameraError::NoRoll { up, forward });
        }
        let right = right.normalize();
        let down = forward.cross(right);
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        Ok(Self { world_to_camera: DAffine3::from_mat3_translation(rotation, -(rotation * eye)) })
    }

    /// Where the camera stands in the world.
    pub fn eye(&self) -> DVec3 {
        self.world_to_camera.inverse().translation
    }

    /// The view axis in the world.
    pub fn forward(&self) -> DVec3 {
        self.world_to_camera.matrix3.row(2)
    }
}

impl Camera {
    /// A pinhole camera with square pixels and a vertical angle of view in radians, in (0, π).
    ///
    /// # Errors
    /// When the angle or the size is outside its range.
    pub fn perspective(pose: Pose, vertical_angle: f64, size: [u32; 2]) -> Result<Self, CameraError> {
        if !(vertical_angle > 0.0 && vertical_angle < std::f64::consts::PI) {
            return Err(CameraError::Value {
                what: "vertical angle",
                value: vertical_angle,
                expected: "it must be between 0 and π radians",
            });
        }
        let focal = f64::from(size[1]) / (2.0 * (vertical_angle / 2.0).tan());
        let intrinsics = Intrinsics { focal: DVec2::splat(focal), center: half(size) };
        Self::from_intrinsics(pose, intrinsics, Projection::Perspective, size)
    }

    /// An orthographic camera with square pixels that sees `height` world units from top to bottom.
    ///
    /// # Errors
    /// When the height or the size is outside its range.
    pub fn orthographic(pose: Pose, height: f64, size: [u32; 2]) -> Result<Self, CameraError> {
        if !(height > 0.0 && height.is_finite()) {
            let expected = "it must be finite and above 0";
            return Err(CameraError::Value { what: "height", value: height, expected });
        }
        let intrinsics = Intrinsics { focal: DVec2::splat(f64::from(size[1]) / height), center: half(size) };
        Self::from_intrinsics(pose, intrinsics, Projection::Orthographic, size)
    }

    /// A camera from its intrinsics and pose.
    ///
    /// # Errors
    /// When a focal length is not above 0, a number is not finite, a side of the picture is 0 or above
    /// 65,535, or the pose does more than turn and shift.
    pub fn from_intrinsics(
        pose: Pose,
        intrinsics: Intrinsics,
        projection: Projection,
        size: [u32; 2],
    ) -> Result<Self, CameraError> {
        for value in intrinsics.focal.to_array() {
            if !(value > 0.0 && value.is_finite()) {
                let expected = "it must be finite and above 0";
                return Err(CameraError::Value { what: "focal length", value, expected });
            }
        }
        for value in intrinsics.center.to_array() {
            if !value.is_finite() {
                return Err(CameraError::Value {
                    what: "principal point",
                    value,
                    expected: "it must be finite",
                });
            }
        }
        for value in size.map(f64::from) {
            if !(1.0..=65_535.0).contains(&value) {
                let expected = "it must be from 1 to 65535 pixels";
                return Err(CameraError::Value { what: "side of the picture", value, expected });
            }
        }
        let rotation = pose.world_to_camera.matrix3;
        let off = rotation * rotation.transpose() - DMat3::IDENTITY;
        let stretch = off.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
        if !pose.world_to_camera.is_finite() || stretch > 1e-6 || rotation.determinant() < 0.0 {
            let expected = "it must be a rotation and a shift; this is how far from 1 its axes are";
            return Err(CameraError::Value { what: "pose", value: stretch, expected });
        }
        Ok(Self { pose, intrinsics, projection, size, near: 0.0 })
    }

    /// The same camera with nothing drawn nearer than `near` (world units along the view axis, default 0).
    ///
    /// # Errors
    /// When it is not finite, or below 0 for a pinhole camera.
    pub fn with_near(mut self, near: f64) -> Result<Self, CameraError> {
        if !near.is_finite() || (near < 0.0 && self.projection == Projection::Perspective) {
            let expected = "it must be finite, and at least 0 for a pinhole camera";
            return Err(CameraError::Value { what: "near plane", value: near, expected });
        }
        self.near = near;
        Ok(self)
    }

    /// The same picture where rays are parallel and nothing of it lies before `z`, seen from there: all depths are so much less.
    pub(crate) fn seen_from_plane(mut self, z: f64) -> Self {
        self.pose.world_to_camera.translation.z -= z;
        self.near = (self.near - z).max(0.0);
        self
    }

    /// A camera that sees a part of the picture: `size` pixels from `corner` on, which may lie outside.
    ///
    /// # Errors
    /// When a side is 0 or above 65,535.
    pub fn part(&self, corner: [i32; 2], size: [u32; 2]) -> Result<Self, CameraError> {
        let center = self.intrinsics.center - DVec2::from(corner.map(f64::from));
        let intrinsics = Intrinsics { center, ..self.intrinsics };
        let part = Self::from_intrinsics(self.pose, intrinsics, self.projection, size)?;
        Ok(Self { near: self.near, ..part })
    }

    /// Where it stands.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Its intrinsics in pixels.
    pub fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    /// How depth acts on the picture.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Width and height of the picture in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether the eye and the whole near plane are outside of a box, given by two corners in a space from which `to_world` leads; where rays are parallel,
    /// whether the near plane is before it.
    pub fn is_outside(&self, to_world: &DAffine3, [low, high]: [DVec3; 2]) -> bool {
        let to_camera = self.pose.world_to_camera * *to_world;
        let [middle, half] = [0.5 * (low + high), 0.5 * (high - low)];
        match self.projection {
            Projection::Perspective => {
                let from_camera = to_camera.inverse();
                let beside = ((from_camera.translation - middle).abs() - half).max(DVec3::ZERO);
                beside.length() > self.near_reach() * largest_stretch(from_camera.matrix3)
            }
            Projection::Orthographic => {
                let depth = to_camera.matrix3.row(2);
                to_camera.transform_point3(middle).z - depth.abs().dot(half) > self.near
            }
        }
    }

    /// How far the near plane's farthest corner is from the eye.
    fn near_reach(&self) -> f64 {
        let Intrinsics { focal, center } = self.intrinsics;
        let [width, height] = self.size.map(f64::from);
        let slopes = center.max(DVec2::new(width, height) - center).abs() / focal;
        self.near * slopes.extend(1.0).length()
    }

    /// The near plane's z.
    pub fn near(&self) -> f64 {
        self.near
    }

    /// Width of a pixel at depth `z`, in world units.
    pub fn pixel_width_at(&self, z: f64) -> f64 {
        let focal = self.intrinsics.focal.min_element();
        match self.projection {
            Projection::Perspective => z / focal,
            Projection::Orthographic => 1.0 / focal,
        }
    }
}

fn half(size: [u32; 2]) -> DVec2 {
    DVec2::new(f64::from(size[0]), f64::from(size[1])) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the origin, looking along z, 90° across, with a near plane at 2, whose corners are 2√3 = 3.46 away.
    fn camera(is_parallel: bool) -> Camera {
        let pose = Pose::look_at(DVec3::ZERO, DVec3::Z, DVec3::NEG_Y).unwrap();
        let made = if is_parallel {
            Camera::orthographic(pose, 4.0, [10; 2])
        } else {
            Camera::perspective(pose, std::f64::consts::FRAC_PI_2, [10; 2])
        };
        made.unwrap().with_near(2.0).unwrap()
    }

    #[test]
    fn a_box_is_outside_if_neither_eye_nor_near_plane_is_in_it() {
        let unit = [DVec3::NEG_ONE, DVec3::ONE];
        let at = |middle: DVec3, is_parallel: bool| {
            camera(is_parallel).is_outside(&DAffine3::from_translation(middle), unit)
        };
        // In the box, with the near plane through it, beside its farthest corner, and well beyond.
        for (z, perspective, parallel) in
            [(0.0, false, false), (2.5, false, false), (4.4, false, true), (4.5, true, true)]
        {
            assert_eq!(at(DVec3::Z * z, false), perspective, "{z}");
            assert_eq!(at(DVec3::Z * z, true), parallel, "{z}");
        }
        // Behind the eye pictures show nothing of it; where rays are parallel the near plane has cut it away.
        assert!(at(DVec3::NEG_Z * 5.0, false) && !at(DVec3::NEG_Z * 5.0, true));
        // Ten times as large along x: reaches count in the world.
        let stretched = DAffine3::from_scale(DVec3::new(10.0, 1.0, 1.0));
        let beside =
            |x: f64| camera(false).is_outside(&(DAffine3::from_translation(DVec3::X * x) * stretched), unit);
        assert!(!beside(9.0) && beside(100.0));
    }
}
