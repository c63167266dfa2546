//! Opacity kernels beside answers that are numbers: what the pixel's filter does to their peaks.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, Cloud, Material, OpacityFilter, Pose, RenderSettings, Scene, Shapes, Splats, Strength,
    reference::{ReferenceKind, reference},
};
use scenes::{draw, unshaded};

const SIZE: u32 = 9;
const PEAK: f32 = 0.8;
/// Of the kernel from the middle of the picture, in pixels.
const OFFSET: [f32; 2] = [0.2, -0.3];

/// A kernel with these half-axes in pixels where a pixel is 1 wide.
fn cloud(sigmas: [f32; 2], filter: OpacityFilter, [peak, least]: [f32; 2]) -> Cloud {
    Cloud::new(Splats {
        centers: vec![Vec3::new(OFFSET[0], OFFSET[1], 0.0)],
        shapes: Shapes::Shared(Mat3::from_diagonal(Vec3::new(sigmas[0], sigmas[1], sigmas[0]))),
        strength: Strength::Opacity { peaks: vec![peak], filter, least },
        colors: vec![[1.0; 3]],
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

/// Opacity in the picture, row by row.
fn seen(cloud: Cloud, camera: &Camera, settings: &RenderSettings) -> Vec<f64> {
    draw(vec![cloud], camera, settings).color.iter().map(|pixel| f64::from(pixel[3])).collect()
}

/// The kernel's Gaussian of these variances at a pixel, 1 at its centre.
fn gaussian(place: [usize; 2], variances: [f64; 2]) -> f64 {
    let offset = |axis: usize| place[axis] as f64 - 4.0 - f64::from(OFFSET[axis]);
    let r: f64 = (0..2).map(|axis| offset(axis).powi(2) / variances[axis]).sum();
    (-0.5 * r).exp()
}

/// x to the right and y down, a pixel 1 wide.
fn cameras() -> [Camera; 2] {
    let pose = Pose::look_at(DVec3::Z * -1e4, DVec3::ZERO, DVec3::NEG_Y).unwrap();
    let height = f64::from(SIZE);
    [
        Camera::orthographic(pose, height, [SIZE; 2]).unwrap(),
        // From so far away that the tilt of rays, 5e-4, changes nothing in r but its seventh digit.
        Camera::perspective(pose, 2.0 * (height / 2.0 / 1e4).atan(), [SIZE; 2]).unwrap(),
    ]
}

#[test]
fn the_filter_widens_and_dims_or_not() {
    let settings = RenderSettings { cutoff: 30.0, tolerance: 1e-5, ..unshaded() };
    let low_pass = settings.low_pass;
    assert_eq!(low_pass, 0.3, "what classic scenes are trained with");
    // Less than a pixel, a needle, a disc of pixels, a point, which has no area of its own.
    for sigmas in [[0.2, 0.2], [0.1, 1.5], [2.0, 2.0], [0.0, 0.0]] {
        let variances = sigmas.map(|sigma| f64::from(sigma).powi(2));
        let widened = variances.map(|variance| variance + low_pass);
        let share = variances.iter().product::<f64>() / widened.iter().product::<f64>();
        for (filter, share) in [(OpacityFilter::Classic, 1.0), (OpacityFilter::Compensated, share.sqrt())] {
            for camera in cameras() {
                let found = seen(cloud(sigmas, filter, [PEAK, 0.0]), &camera, &settings);
                for (index, found) in found.into_iter().enumerate() {
                    let place = [index % SIZE as usize, index / SIZE as usize];
                    let alpha = f64::from(PEAK) * share * gaussian(place, widened);
                    // Kernels end at the tolerance, 1e-5, which is half of this; the rest is single precision.
                    let error = (found - alpha).abs();
                    assert!(error <= 2e-5, "{sigmas:?}, {filter:?} at {place:?}: {found} is not {alpha}");
                }
            }
        }
    }
}

#[test]
fn without_a_filter_both_are_the_same() {
    let settings = RenderSettings { low_pass: 0.0, ..unshaded() };
    for camera in cameras() {
        let [classic, compensated] = [OpacityFilter::Classic, OpacityFilter::Compensated]
            .map(|filter| seen(cloud([0.7, 1.1], filter, [PEAK, 0.0]), &camera, &settings));
        assert!(classic.iter().any(|alpha| *alpha > 0.5));
        for (a, b) in classic.into_iter().zip(compensated) {
            // The area over itself, to rounding.
            assert!((a - b).abs() < 1e-6, "{a} is not {b}");
        }
    }
}

/// Where its Gaussian, not yet dimmed, has fallen to the least opacity a kernel ends; in the reference, too.
#[test]
fn kernels_end_at_their_least_opacity() {
    let settings = RenderSettings { cutoff: 30.0, tolerance: 1e-5, ..unshaded() };
    let least = Strength::LEAST_OF_TRAINED;
    let sigmas = [0.8, 1.7];
    let widened = sigmas.map(|sigma| sigma * sigma + settings.low_pass);
    let share = (sigmas[0] * sigmas[1]).powi(2) / widened.iter().product::<f64>();
    for (filter, share) in [(OpacityFilter::Classic, 1.0), (OpacityFilter::Compensated, share.sqrt())] {
        for (peak, camera) in
            [0.03, 0.7, 1.0].into_iter().flat_map(|peak| cameras().map(|camera| (peak, camera)))
        {
            let scene = cloud(sigmas.map(|sigma| sigma as f32), filter, [peak, least]);
            let found = seen(scene.clone(), &camera, &settings);
            let scene = Scene { clouds: vec![scene], lights: Vec::new() };
            let reference = reference(&scene, &camera, &settings, ReferenceKind::R1, &|_| {}).unwrap();
            let reference = reference.color.iter().map(|pixel| f64::from(pixel[3]));
            let (mut whole, mut ended) = (0, 0);
            for (index, (found, reference)) in found.into_iter().zip(reference).enumerate() {
                let place = [index % SIZE as usize, index / SIZE as usize];
                let undimmed = f64::from(peak) * gaussian(place, widened);
                // No pixel is as near to an end as rounding is.
                assert!((undimmed / f64::from(least) - 1.0).abs() > 1e-3, "{place:?} tells nothing");
                let alpha = if undimmed > f64::from(least) { undimmed * share } else { 0.0 };
                whole += usize::from(alpha > 0.0);
                ended += usize::from(alpha == 0.0 && undimmed > 1e-4);
                for found in [found, reference] {
                    assert!(
                        (found - alpha).abs() <= 2e-5,
                        "{peak}, {filter:?} at {place:?}: {found} is not {alpha}"
                    );
                }
            }
            assert!(whole > 5 && ended > 5, "{whole} and {ended} pixels");
        }
    }
}
