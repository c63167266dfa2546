//! Splats much smaller than a pixel: surfaces with fine textures and volumes, drawn smaller and smaller.
//!
//! R2 sees what the pixel's filter sees, without filtering any splat; R1 filters every splat as the rasterizer does.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, Cloud, Frame, Metrics, Pixels, Pose, ReferenceKind, Scene, compare, reference, render,
};
use scenes::*;

/// Pixels along a side.
const SIDE: u32 = 8;

/// Surfels from one pixel to the next, along a line.
const PER_PIXEL: [f64; 3] = [1.0, 4.0, 16.0];

/// Samples a pixel of R2. Twice as many move no figure below by more than 0.5 dB.
const SAMPLES: u32 = 256;

/// A lattice with a surfel's distance of 1 that fills the picture when 16 surfels are a pixel wide, coloured by place.
fn textured(color: impl Fn(usize, usize) -> [f32; 3]) -> Cloud {
    let side = 16 * SIDE as usize * 3 / 2;
    let mut splats = plane(side, 1.0, [0.0; 3]).splats();
    splats.colors = (0..side * side).map(|i| color(i % side, i / side)).collect();
    Cloud::new(splats).unwrap()
}

/// Checks two surfels wide.
fn checker() -> Cloud {
    textured(|i, j| [((i / 2 + j / 2) % 2) as f32; 3])
}

/// Stripes of all widths and random grains.
fn texture() -> Cloud {
    let mut state = 1u32;
    let grains: Vec<f32> = (0..(16 * SIDE as usize * 3 / 2).pow(2))
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        })
        .collect();
    let side = 16 * SIDE as usize * 3 / 2;
    textured(move |i, j| {
        let (x, y) = (i as f32, j as f32);
        let wave = 0.5 + 0.5 * (x * y / side as f32).sin();
        [wave, grains[j * side + i], 0.5 + 0.5 * (x * 0.02).sin() * (y * 0.05).cos()]
    })
}

/// Sees the lattice at a slant, with so many surfels a pixel in the middle.
fn view(per_pixel: f64) -> Camera {
    let height = per_pixel * f64::from(SIDE);
    let distance = height / (2.0 * 15f64.to_radians().tan());
    let eye = DVec3::new(0.31, 0.5, -0.8).normalize() * distance;
    let pose = Pose::look_at(eye, DVec3::new(0.3, 0.2, 0.0), DVec3::Y).unwrap();
    Camera::perspective(pose, 30f64.to_radians(), [SIDE; 2]).unwrap()
}

fn metrics(a: &Frame, b: &Frame) -> Metrics {
    let [left, right] = [a, b].map(|frame| frame.color.iter().flatten().copied().collect::<Vec<f32>>());
    let picture = |values| Pixels { width: a.width, height: a.height, channels: 4, values };
    compare(picture(&left), picture(&right)).unwrap()
}

fn mean(frame: &Frame) -> f64 {
    let sum: f64 = frame.color.iter().flat_map(|c| c[..3].iter()).map(|c| f64::from(*c)).sum();
    sum / (3 * frame.color.len()) as f64
}

#[test]
fn textures_are_filtered_and_keep_their_brightness() {
    for (name, cloud) in [("checker", checker()), ("texture", texture())] {
        let scenes = [cloud.clone(), cloud.with_levels()]
            .map(|cloud| Scene { clouds: vec![cloud], lights: Vec::new() });
        for per_pixel in PER_PIXEL {
            let (camera, settings) = (view(per_pixel), unshaded());
            let kind = ReferenceKind::R2 { samples: SAMPLES };
            let exact = reference(&scenes[0], &camera, &settings, kind, &|_| ()).unwrap();
            for (scene, levels) in scenes.iter().zip(["without", "with"]) {
                let drawn = render(scene, &camera, &settings, &()).unwrap();
                let Metrics { psnr_db, max_error, .. } = metrics(&drawn, &exact);
                let brightness = mean(&drawn) / mean(&exact);
                println!(
                    "{name}, {per_pixel} a pixel, {levels} levels: {psnr_db:.1} dB, {max_error:.4}, {brightness:.4}"
                );
                // A checker 16 a pixel is the worst: 47 dB, 0.1 % off.
                assert!(psnr_db >= 40.0, "{psnr_db} dB");
                assert!((brightness - 1.0).abs() <= 0.012, "{brightness}");
            }
        }
    }
}

/// The largest change of a channel from each frame to the next.
fn changes(frames: &[Frame]) -> Vec<f64> {
    frames.windows(2).map(|pair| metrics(&pair[0], &pair[1]).max_error).collect()
}

/// Kernels of two colours in a ball 24 across, thin enough to be seen through.
fn ball() -> Cloud {
    let places = (0..24usize.pow(3)).map(|i| [i % 24, i / 24 % 24, i / 576].map(|n| n as f32 - 11.5));
    let centers: Vec<Vec3> = places.map(Vec3::from).filter(|p| p.length() < 12.0).collect();
    let mut splats = kernels(centers, Mat3::from_diagonal(Vec3::splat(0.7)), 0.2, [0.0; 3]).splats();
    splats.colors = splats
        .centers
        .iter()
        .map(|p| if (p.x * 0.4).sin() * (p.y * 0.3).cos() > 0.0 { [0.9, 0.4, 0.1] } else { [0.1, 0.3, 0.8] })
        .collect();
    Cloud::new(splats.in_morton_order()).unwrap()
}

/// A dolly that goes away by 1 % a frame, past every size at which splats change their form or their level: what changes from
/// frame to frame is what the move changes.
#[test]
fn a_dolly_changes_no_more_than_the_exact_picture() {
    for (name, cloud, wide) in [("checker", checker(), 1.0), ("ball", ball(), 0.25)] {
        let scenes = [cloud.clone(), cloud.with_levels()]
            .map(|cloud| Scene { clouds: vec![cloud], lights: Vec::new() });
        for start in [1.0, 2.0, 4.0, 8.0] {
            let cameras: Vec<Camera> = (0..12).map(|i| view(wide * start * 1.01f64.powi(i))).collect();
            let settings = unshaded();
            let exact: Vec<Frame> = cameras
                .iter()
                .map(|camera| reference(&scenes[0], camera, &settings, ReferenceKind::R1, &|_| ()).unwrap())
                .collect();
            let largest = changes(&exact).into_iter().fold(0.0, f64::max);
            for (scene, levels) in scenes.iter().zip(["without", "with"]) {
                let drawn: Vec<Frame> =
                    cameras.iter().map(|camera| render(scene, camera, &settings, &()).unwrap()).collect();
                let found = changes(&drawn).into_iter().fold(0.0, f64::max);
                println!("{name}, {start}, {levels} levels: {found:.4}, exact {largest:.4}");
                // Levels have a quarter of the tolerance for themselves, which shows where hardly anything changes.
                let bound = 2.0 * largest + settings.tolerance / 4.0;
                assert!(found <= bound, "{name} at {start}: {found}, exact {largest}");
            }
        }
    }
}
