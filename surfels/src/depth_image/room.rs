//! A room whose picture is known from everywhere.

use super::{DepthKind, RgbdImage};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use oblate_engine::color::srgb_to_linear;
use oblate_engine::{Camera, CameraError, Intrinsics, Pose, Projection};
use rayon::prelude::*;

/// A bent wall, a floor, a ball and a panel in front of them, all chequered, for tests, charts and examples: what a camera sees of them
/// is computed ray by ray.
///
/// Its world is the space of the camera that it is made for: metres, x right, y down, z forward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Room;

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// In lengths of the ray's direction.
    pub distance: f64,
    /// Linear Rec. 709.
    pub color: [f32; 3],
}

impl Room {
    /// The camera that it is made for, of a picture `width` pixels wide and three quarters as high.
    ///
    /// # Errors
    /// When the width is 0 or above 65,535.
    pub fn camera(self, width: u32) -> Result<Camera, CameraError> {
        let size = [width, width * 3 / 4];
        let intrinsics = Intrinsics {
            focal: DVec2::splat(525.0 / 640.0 * f64::from(width)),
            center: DVec2::new(f64::from(size[0]), f64::from(size[1])) / 2.0,
        };
        Camera::from_intrinsics(
            Pose { world_to_camera: DAffine3::IDENTITY },
            intrinsics,
            Projection::Perspective,
            size,
        )
    }

    /// The same camera a quarter of a metre to the right and turned by 6°.
    ///
    /// # Errors
    /// When the width is 0 or above 65,535.
    pub fn other_camera(self, width: u32) -> Result<Camera, CameraError> {
        let camera = self.camera(width)?;
        let turn = DMat3::from_rotation_y((-6.0_f64).to_radians());
        let pose =
            Pose { world_to_camera: DAffine3::from_mat3_translation(turn, DVec3::new(-0.25, 0.05, 0.0)) };
        Camera::from_intrinsics(pose, camera.intrinsics(), Projection::Perspective, camera.size())
    }

    /// What a ray from `eye` meets first.
    pub fn hit(self, eye: DVec3, direction: DVec3) -> Option<Hit> {
        let (e, d) = (eye, direction);
        let panel = |distance: f64| {
            let p = e + distance * d;
            (p.x - 0.55).abs() < 0.3 && (p.y - 0.1).abs() < 0.35
        };
        let from_ball = e - DVec3::new(-0.3, 0.2, 2.0);
        // z² − 3.5 z = 0.4 x: where the ray of slope x/z has z = 3.5 + 0.4 x/z.
        let wall = [d.z * d.z, 2.0 * e.z * d.z - 3.5 * d.z - 0.4 * d.x, e.z * e.z - 3.5 * e.z - 0.4 * e.x];
        let ball = [d.length_squared(), 2.0 * from_ball.dot(d), from_ball.length_squared() - 0.25];
        let through_panel = Some((1.6 - e.z) / d.z).filter(|distance| panel(*distance));
        let through_floor = Some((1.2 - e.y) / d.y);
        let is_ahead = |distance: &f64| *distance > 1e-9 && distance.is_finite();
        let [near, far] = roots(wall);
        let of_ball = roots(ball)[0];
        let meets = [near, far].into_iter().flatten().filter(|t| e.z + t * d.z > 1.0);
        let distance = meets
            .chain(of_ball)
            .chain(through_panel)
            .chain(through_floor)
            .filter(is_ahead)
            .reduce(f64::min)?;
        Some(Hit { distance, color: paint(e + distance * d) })
    }

    /// The image with depths that a camera takes: what is seen at the centres of its pixels.
    pub fn image(self, camera: &Camera) -> RgbdImage {
        let size = camera.size().map(|side| side as usize);
        let rays = Rays::of(camera);
        let hits: Vec<Option<Hit>> = (0..size[0] * size[1])
            .into_par_iter()
            .map(|at| self.hit(rays.eye, rays.direction(at, DVec2::splat(0.5))))
            .collect();
        RgbdImage {
            size,
            colors: hits.iter().map(|hit| hit.map_or([0.0; 3], |hit| hit.color)).collect(),
            depths: hits.iter().map(|hit| hit.map_or(0.0, |hit| hit.distance as f32)).collect(),
            kind: DepthKind::AlongAxis,
            intrinsics: camera.intrinsics(),
            pose: camera.pose(),
        }
    }

    /// The picture that a camera takes: means of `side`² places in each pixel; linear Rec. 709.
    pub fn picture(self, camera: &Camera, side: usize) -> Vec<[f32; 3]> {
        let rays = Rays::of(camera);
        let [width, height] = camera.size().map(|side| side as usize);
        let mean = |at: usize| {
            let mut sum = [0.0; 3];
            for place in 0..side * side {
                let within =
                    DVec2::new((place % side) as f64 + 0.5, (place / side) as f64 + 0.5) / side as f64;
                if let Some(hit) = self.hit(rays.eye, rays.direction(at, within)) {
                    sum = std::array::from_fn(|i| sum[i] + hit.color[i]);
                }
            }
            sum.map(|sum| sum / (side * side) as f32)
        };
        (0..width * height).into_par_iter().map(mean).collect()
    }
}

/// The real roots of c₀t² + c₁t + c₂, the smaller one first.
fn roots([square, linear, constant]: [f64; 3]) -> [Option<f64>; 2] {
    let discriminant = linear * linear - 4.0 * square * constant;
    if discriminant < 0.0 || square == 0.0 {
        return [None; 2];
    }
    let root = discriminant.sqrt();
    [-1.0, 1.0].map(|sign| Some((-linear + sign * root) / (2.0 * square)))
}

/// The colour at a point: cubes of a fifth of a metre, and waves.
fn paint(p: DVec3) -> [f32; 3] {
    let cube = (p * 5.0).floor();
    let check = (cube.x + cube.y + cube.z).rem_euclid(2.0);
    let levels = [
        90.0 + 120.0 * check + 20.0 * (9.0 * p.x).sin(),
        110.0 + 60.0 * check + 30.0 * (7.0 * p.z).sin(),
        130.0 + 40.0 * (1.0 - check) + 40.0 * (5.0 * p.y).sin(),
    ];
    levels.map(|level| srgb_to_linear((level / 255.0).clamp(0.0, 1.0) as f32))
}

/// Rays of a camera's pixels, a depth of 1 long.
struct Rays {
    eye: DVec3,
    to_world: DMat3,
    intrinsics: Intrinsics,
    width: usize,
}

impl Rays {
    fn of(camera: &Camera) -> Self {
        let to_world = camera.pose().world_to_camera.matrix3.transpose();
        let (eye, intrinsics) = (camera.pose().eye(), camera.intrinsics());
        Self { eye, to_world, intrinsics, width: camera.size()[0] as usize }
    }

    /// Through a place within a pixel, from (0, 0) to (1, 1).
    fn direction(&self, at: usize, within: DVec2) -> DVec3 {
        let place = DVec2::new((at % self.width) as f64, (at / self.width) as f64) + within;
        self.to_world * ((place - self.intrinsics.center) / self.intrinsics.focal).extend(1.0)
    }
}
