//! Rays of a camera, and what a block of pixels can see.

use super::random::Random;
use crate::camera::{Camera, Projection};
use glam::{DVec2, DVec3};

/// The line `origin + z * direction` in camera space, with z along the view axis: `direction.z` is 1 and
/// `origin.z` is 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
}

impl Ray {
    pub(super) fn at(&self, z: f64) -> DVec3 {
        self.origin + z * self.direction
    }
}

/// Points with `normal · p + offset ≥ 0`; the normal has length 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct HalfSpace {
    normal: DVec3,
    offset: f64,
}

impl HalfSpace {
    pub(super) fn touches(&self, center: DVec3, radius: f64) -> bool {
        self.normal.dot(center) + self.offset >= -radius
    }
}

/// A camera as rays.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    focal: DVec2,
    center: DVec2,
    pub(super) parallel: bool,
    /// Nothing nearer counts; at least 0 where rays meet in the eye.
    pub(super) near: f64,
}

impl View {
    pub(super) fn new(camera: &Camera) -> Self {
        let intrinsics = camera.intrinsics();
        let parallel = camera.projection() == Projection::Orthographic;
        Self { focal: intrinsics.focal, center: intrinsics.center, parallel, near: camera.near() }
    }

    /// The ray through a point of the picture.
    pub(super) fn ray(&self, pixel: DVec2) -> Ray {
        let on_plane = (pixel - self.center) / self.focal;
        if self.parallel {
            Ray { origin: on_plane.extend(0.0), direction: DVec3::Z }
        } else {
            Ray { origin: DVec3::ZERO, direction: on_plane.extend(1.0) }
        }
    }

    /// The direction in which a point is seen, any length.
    pub(super) fn direction(&self, point: DVec3) -> DVec3 {
        if self.parallel { DVec3::Z } else { point }
    }

    /// What decides which splat is nearer when centres are ordered: the distance from the eye, which for
    /// parallel rays is infinitely far.
    pub(super) fn distance(&self, point: DVec3) -> f64 {
        if self.parallel { point.z } else { point.length() }
    }

    /// Standard deviations in world units along x and y, at depth `z`, of a filter of variance `low_pass`
    /// in squared pixels.
    pub(super) fn filter_at(&self, z: f64, low_pass: f64) -> DVec2 {
        let scale = if self.parallel { 1.0 } else { z.abs() };
        scale * low_pass.sqrt() / self.focal
    }

    /// The sides of all rays between two columns (`axis` 0) or rows (`axis` 1) of pixel edges.
    pub(super) fn between(&self, axis: usize, low: f64, high: f64) -> [HalfSpace; 2] {
        [(low, 1.0), (high, -1.0)].map(|(edge, sign)| {
            let on_plane = (edge - self.center[axis]) / self.focal[axis];
            let mut normal = DVec3::ZERO;
            normal[axis] = sign;
            if self.parallel {
                HalfSpace { normal, offset: -sign * on_plane }
            } else {
                normal.z = -sign * on_plane;
                HalfSpace { normal: normal.normalize(), offset: 0.0 }
            }
        })
    }

    /// What the near plane leaves.
    pub(super) fn beyond_near(&self) -> HalfSpace {
        HalfSpace { normal: DVec3::Z, offset: -self.near }
    }
}

/// Where the rays of a pixel go, as offsets from its centre in pixels: equal weights, together a 2-D
/// Gaussian of variance `low_pass`.
///
/// Radii are the quantiles of the Rayleigh distribution at the middles of equal shares, as in Box, Muller,
/// *A Note on the Generation of Random Normal Deviates*, 1958, scaled so that the variance is met exactly;
/// angles advance by the golden angle (Vogel, *A better way to construct the sunflower head*, 1979).
pub(super) fn pixel_samples(count: u32, low_pass: f64) -> Vec<DVec2> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let quantile = |i: u32| -2.0 * (-(f64::from(i) + 0.5) / f64::from(count)).ln_1p();
    let mean: f64 = (0..count).map(quantile).sum::<f64>() / f64::from(count);
    (0..count)
        .map(|i| {
            let radius = (quantile(i) * 2.0 / mean * low_pass).sqrt();
            radius * DVec2::from_angle(golden_angle * f64::from(i))
        })
        .collect()
}

/// A rotation that looks random from pixel to pixel and is the same in every run.
pub(super) fn pixel_rotation([column, row]: [usize; 2]) -> DVec2 {
    let mut random = Random::new((row as u64) << 32 | column as u64);
    DVec2::from_angle(std::f64::consts::TAU * random.uniform())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixel_samples_have_the_moments_of_the_filter() {
        for count in [4, 64, 1000] {
            let samples = pixel_samples(count, 0.3);
            let n = f64::from(count);
            let mean = samples.iter().sum::<DVec2>() / n;
            let total = samples.iter().map(|s| s.length_squared()).sum::<f64>() / n;
            assert!((total - 0.6).abs() < 1e-12);
            // A spiral of golden angles leaves about one sample's share unbalanced.
            assert!(mean.length() < 2.0 / n, "{count}: {mean}");
            if count >= 64 {
                let fourth = samples.iter().map(|s| s.length_squared().powi(2)).sum::<f64>() / n;
                // E r⁴ = 8 h⁴; the outermost share's middle stands for an infinite tail.
                assert!((fourth / (8.0 * 0.09) - 1.0).abs() < 0.2);
            }
        }
    }
}
