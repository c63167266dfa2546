//! One kernel at three places of a picture, enlarged: what the resampling filter is made of.

use crate::kernels::{draw, round, unfiltered};
use crate::texture::{SIGMA, Texels};
use crate::view::{LEFT, PIXEL_FILTER, Picture, ground};
use glam::{DMat3, DVec2, DVec3};
use oblate::engine::{
    Camera, CameraError, Cloud, CloudError, Intrinsics, Material, OpacityFilter, Projection, RenderSettings,
    Shapes, Splats, Strength,
};
use std::error::Error;

/// Pixels of the picture along a side of a panel, and how many times they are enlarged.
const PIXELS: u32 = 12;
const ENLARGED: u32 = 14;

/// Squared distances in σ at which outlines are drawn.
const OUTLINES: [f32; 2] = [1.0, 4.0];

/// From far to near a row each: reconstruction kernel, low-pass filter, both, and the round kernel of uniform scaling.
pub(crate) fn footprints(texels: &Texels, camera: &Camera) -> Result<Vec<Picture>, Box<dyn Error>> {
    let [width, height] = camera.size().map(f64::from);
    let widened = RenderSettings { low_pass: PIXEL_FILTER * f64::from(ENLARGED * ENLARGED), ..unfiltered() };
    let mut panels = Vec::new();
    for row in [0.06, 0.4, 0.9] {
        let pixel = DVec2::new(0.75 * width, row * height);
        let place = (ground(camera)(pixel) + DVec2::new(LEFT, 0.0)).extend(0.0);
        let kernel = DMat3::from_diagonal((SIGMA * texels.step()).extend(0.0));
        let shapes = [
            (kernel, unfiltered()),
            (kernel * 1e-3, widened),
            (kernel, widened),
            (round(texels, place, camera), unfiltered()),
        ];
        for (factor, settings) in shapes {
            panels.push(outlined(&draw(&single(place, factor)?, &enlarged(camera, pixel)?, &settings)?));
        }
    }
    Ok(panels)
}

/// A splat of opacity 1, which the filter leaves as high as it is.
fn single(center: DVec3, factor: DMat3) -> Result<Cloud, CloudError> {
    Cloud::new(Splats {
        centers: vec![center.as_vec3()],
        shapes: Shapes::Shared(factor.as_mat3()),
        strength: Strength::Opacity { peaks: vec![1.0], filter: OpacityFilter::Classic, least: 0.0 },
        colors: vec![[1.0; 3]],
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
}

/// The camera that sees the pixels around a point of the picture alone.
fn enlarged(camera: &Camera, middle: DVec2) -> Result<Camera, CameraError> {
    let (Intrinsics { focal, center }, scale) = (camera.intrinsics(), f64::from(ENLARGED));
    let center = (center - middle + 0.5 * f64::from(PIXELS)) * scale;
    let intrinsics = Intrinsics { focal: focal * scale, center };
    Camera::from_intrinsics(camera.pose(), intrinsics, Projection::Perspective, [PIXELS * ENLARGED; 2])
}

/// A kernel's value in blue on white, with its outlines and the borders of pixels.
fn outlined(kernel: &Picture) -> Picture {
    let [width, height] = kernel.size;
    let squared = |x: usize, y: usize| -2.0 * kernel.colors[y * width + x][0].max(1e-9).ln();
    let color = |i: usize| {
        let (x, y) = (i % width, i / width);
        let here = squared(x, y);
        let beside = [squared((x + 1).min(width - 1), y), squared(x, (y + 1).min(height - 1))];
        let is_outline = |level: &f32| beside.iter().any(|other| (here < *level) != (*other < *level));
        let is_border = x % ENLARGED as usize == 0 || y % ENLARGED as usize == 0;
        let paper = if is_border { 0.7 } else { 1.0 };
        let value = kernel.colors[i][0];
        if OUTLINES.iter().any(is_outline) {
            [0.0; 3]
        } else {
            [0.05, 0.25, 0.8].map(|ink| paper + value * (ink - paper))
        }
    };
    Picture { size: kernel.size, colors: (0..width * height).map(color).collect() }
}
