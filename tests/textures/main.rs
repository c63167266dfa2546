//! What resampling filters leave of a texture on a tilted plane: the kernels and pictures of `examples/textures`, small.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

#[path = "../../examples/textures/kernels.rs"]
#[allow(dead_code, reason = "the example draws more")]
mod kernels;
#[path = "../../examples/textures/texture.rs"]
#[allow(dead_code, reason = "the example draws more")]
mod texture;
#[path = "../../examples/textures/view.rs"]
#[allow(dead_code, reason = "the example draws more")]
mod view;

use glam::{DVec2, DVec3};
use kernels::{Kind, draw, elliptical, one_sheet, unfiltered, uniform};
use oblate::engine::{Camera, Pose};
use std::f64::consts::{PI, TAU};
use texture::{PER_SIDE, SIGMA, Texels, zebra};
use view::{PIXEL_FILTER, Picture, halves, supersampled, view};

/// Pixels along a side of pictures of gratings, and the width of one in sides of the square.
const SIDE: u32 = 64;
const PIXEL: f64 = 1.0 / 256.0;

/// The tilt of the plane is 60°: along v a pixel sees twice as much.
const COSINE: f64 = 0.5;
const TANGENT: f64 = 1.732_050_807_568_877;

/// Samples of a texel along each side.
const SIDES: f64 = PER_SIDE as f64;

/// How far a wave's share may be from the whole Gaussian's: a quarter of the tolerance by the footprint's form; and of a Gaussian that is cut off
/// at ρ = 12.25, e^{−ρ/2} = 0.0022 is missing, which is added to the rest, so that no share changes by more than twice that.
const SHARE: f64 = 0.25 / 255.0 + 2.0 * 0.0022;

/// Sees the middle of the unit square at a slant, from so far away that rays are parallel to within 1/1000.
fn slanted() -> Camera {
    let (middle, distance) = (DVec3::new(0.0, 0.5, 0.0), 500.0);
    let eye = middle + DVec3::new(0.0, -COSINE * TANGENT, COSINE) * distance;
    let angle = 2.0 * (0.5 * f64::from(SIDE) * PIXEL / distance).atan();
    Camera::perspective(Pose::look_at(eye, middle, DVec3::Y).unwrap(), angle, [SIDE; 2]).unwrap()
}

/// The amplitude of the wave with so many periods across and up a picture.
fn amplitude(picture: &Picture, periods: DVec2) -> f64 {
    let [width, height] = picture.size;
    let [mut cosine, mut sine] = [0.0; 2];
    for (i, color) in picture.colors.iter().enumerate() {
        let at = DVec2::new((i % width) as f64 + 0.5, 0.5 - (i / width) as f64);
        let phase = TAU * periods.dot(at / f64::from(SIDE));
        cosine += f64::from(color[0]) * phase.cos();
        sine += f64::from(color[0]) * phase.sin();
    }
    2.0 * f64::hypot(cosine, sine) / (width * height) as f64
}

/// Of a wave with frequency k, a kernel with the covariance V on the plane leaves e^{−2π² kᵀVk}: of elliptical ones V is the
/// reconstruction kernel's plus the filter's, of round ones the circle's that is seen in the picture.
#[test]
fn waves_fade_as_the_footprints_covariance_says() {
    let camera = slanted();
    let pixel = DVec2::new(PIXEL, PIXEL / COSINE);
    // Magnified twice and minified twice, by kernels twice and four times as long as wide.
    for size in [[128, 64], [256, 64], [512, 256], [1024, 256]] {
        for periods in [DVec2::new(8.0, 0.0), DVec2::new(0.0, 8.0), DVec2::new(6.0, 5.0)] {
            let frequency = periods / (f64::from(SIDE) * pixel);
            let wave = |at: DVec2| [(0.5 + 0.4 * (TAU * frequency.dot(at - 0.5)).cos()) as f32; 3];
            let texels = Texels::new(wave, size);
            // What means of a few samples a side leave.
            let mean =
                |x: f64| if x == 0.0 { 1.0 } else { (PI * x).sin() / (SIDES * (PI * x / SIDES).sin()) };
            let in_texels = frequency * texels.step();
            let sampled = 0.4 * mean(in_texels.x) * mean(in_texels.y);
            let left = |variance: DVec2| (-2.0 * PI * PI * (frequency * frequency).dot(variance)).exp();
            let kernel = SIGMA * texels.step();
            let radius = SIGMA * texels.step().max_element().max(PIXEL);
            let sigma = kernel.min_element();
            for (kind, seen_across) in [(Kind::Surface, 0.0), (Kind::Slab(sigma), TANGENT * sigma)] {
                let ellipse = kernel * kernel + PIXEL_FILTER * pixel * pixel;
                let derived = [
                    left(ellipse + DVec2::new(0.0, seen_across.powi(2))),
                    left(DVec2::new(radius, radius / COSINE).powf(2.0)),
                ];
                let drawn = [
                    draw(&elliptical(&texels, kind).unwrap(), &camera, &one_sheet()).unwrap(),
                    draw(&uniform(&texels, kind, &camera).unwrap(), &camera, &unfiltered()).unwrap(),
                ];
                let found = drawn.map(|picture| amplitude(&picture, periods) / sampled);
                println!("{size:?}, {periods}: {found:.4?}, derived {derived:.4?}");
                for (found, derived) in found.into_iter().zip(derived) {
                    assert!((found - derived).abs() <= SHARE, "{size:?}, {periods}: {found}, {derived}");
                }
            }
        }
    }
}

/// Against what the texels' kernels make of the plane, ellipses have no error but [`SHARE`]. Circles are 29 to 43 dB farther from
/// that. Against the texture itself, which kernels blur before anything is resampled, they are 7.6 and 8.4 dB farther where it is
/// minified, 2.6 and 3.1 dB where it is magnified; the bounds are four fifths of those.
#[test]
fn ellipses_keep_more_of_a_zebra_than_circles() {
    let camera = view([128, 96]).unwrap();
    let zebra = |at: DVec2| zebra(0.4 * at);
    let exact = supersampled(&camera, 256, zebra);
    for size in [[400, 200], [400, 100]] {
        let texels = Texels::new(zebra, size);
        let by_kernels = supersampled(&camera, 256, |at| texels.by_kernels(at));
        let ellipses = elliptical(&texels, Kind::Surface).unwrap();
        let ellipses = draw(&ellipses, &camera, &one_sheet()).unwrap();
        let circles = uniform(&texels, Kind::Surface, &camera).unwrap();
        let circles = draw(&circles, &camera, &unfiltered()).unwrap();
        let psnr = |picture, truth| halves(picture, truth).unwrap().map(|half| half.psnr_db);
        for (truth, least) in [(&exact, [6.0, 2.1]), (&by_kernels, [23.0; 2])] {
            let (long, round) = (psnr(&ellipses, truth), psnr(&circles, truth));
            println!("{size:?}: {long:.1?} dB, {round:.1?} dB");
            for half in 0..2 {
                assert!(long[half] - round[half] >= least[half], "{size:?}: {long:?}, {round:?}");
            }
        }
        for half in psnr(&ellipses, &by_kernels) {
            assert!(half >= -20.0 * SHARE.log10(), "{size:?}: {half}");
        }
    }
}
