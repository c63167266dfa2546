//! How a textured plane is seen, and what a picture of it ought to be.

use crate::texture::mean;
use glam::{DVec2, DVec3};
use oblate::engine::footprint::Lens;
use oblate::engine::{Camera, CameraError, Metrics, MetricsError, Pixels, Pose, compare};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Variance of the pixels' filter in px², the default of the program.
pub(crate) const PIXEL_FILTER: f64 = 0.3;

/// A picture in linear colours, rows from top to bottom.
pub(crate) struct Picture {
    /// Width and height in pixels.
    pub(crate) size: [usize; 2],
    /// Its pixels.
    pub(crate) colors: Vec<[f32; 3]>,
}

/// Sees a unit square of the ground, v away from the viewer, 8° to 58° below the horizon. It fills a picture of 4:3. A pixel of the
/// top row sees 37 times as much along v as one of the bottom row, and six times as much along u.
pub(crate) fn view(size: [u32; 2]) -> Result<Camera, CameraError> {
    let eye = DVec3::new(0.0, 0.03, 0.115);
    let forward = DVec3::new(0.0, 33f64.to_radians().cos(), -33f64.to_radians().sin());
    Camera::perspective(Pose::look_at(eye, eye + forward, DVec3::Z)?, 50f64.to_radians(), size)
}

/// The world's x of u = 0.
pub(crate) const LEFT: f64 = -0.5;

/// Where the rays through points of the picture meet the ground, in the unit square.
pub(crate) fn ground(camera: &Camera) -> impl Fn(DVec2) -> DVec2 + Sync {
    let (lens, eye) = (Lens::new(camera, 0.0), camera.pose().eye());
    let rotation = camera.pose().world_to_camera.matrix3.transpose();
    move |pixel| {
        let ray = rotation * lens.ray(pixel);
        (eye - ray * (eye.z / ray.z)).truncate() - DVec2::new(LEFT, 0.0)
    }
}

/// A picture of which every pixel is what a function says of its middle.
pub(crate) fn pixels(camera: &Camera, color: impl Fn(DVec2) -> [f32; 3] + Sync) -> Picture {
    let size @ [width, height] = camera.size().map(|side| side as usize);
    let middle = |i: usize| DVec2::new((i % width) as f64, (i / width) as f64) + 0.5;
    Picture { size, colors: (0..width * height).into_par_iter().map(|i| color(middle(i))).collect() }
}

/// What the pixels' filter sees of the ground's colours: means of so many samples, which lie along a spiral by the golden angle as
/// dense as a normal distribution is there. Twice as many samples differ by half as much.
pub(crate) fn supersampled(
    camera: &Camera,
    samples: usize,
    color: impl Fn(DVec2) -> [f32; 3] + Sync,
) -> Picture {
    let golden = PI * (3.0 - 5f64.sqrt());
    let offset = |i: usize| {
        let outside = (i as f64 + 0.5) / samples as f64;
        (-2.0 * PIXEL_FILTER * outside.ln()).sqrt() * DVec2::from_angle(i as f64 * golden % TAU)
    };
    let offsets: Vec<DVec2> = (0..samples).map(offset).collect();
    let ground = ground(camera);
    pixels(camera, |middle| mean(offsets.iter().map(|offset| color(ground(middle + offset)))))
}

/// How far a picture is from another in its upper half, where the ground is minified, and in its lower half.
pub(crate) fn halves(drawn: &Picture, exact: &Picture) -> Result<[Metrics; 2], MetricsError> {
    let [width, height] = drawn.size;
    let middle = width * (height / 2);
    let [(far, exact_far), (near, exact_near)] = [(0, middle), (middle, width * height)]
        .map(|(from, to)| (&drawn.colors[from..to], &exact.colors[from..to]));
    let apart = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        let height = a.len() / width;
        let [a, b] = [a, b].map(|half| Pixels { width, height, channels: 3, values: half.as_flattened() });
        compare(a, b)
    };
    Ok([apart(far, exact_far)?, apart(near, exact_near)?])
}
