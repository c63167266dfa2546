//! Scanned volumes, where they are at hand: how far sorted centres and slabs are from the integral along the rays.
//!
//! Pictures are 256² of the whole, of which eight rows are drawn; errors are those of display values, as in a PNG, blended
//! there over black.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::{real_engine, real_head};
use glam::{DVec2, DVec3};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{
    Blend, Camera, FootprintForm, Frame, Intrinsics, Metrics, Order, Pixels, Pose, Projection, ReferenceKind,
    RenderSettings, Scene, compare, reference, render,
};
use oblate_volumes::{ControlPoint, KernelSettings, PRESETS, TransferFunction, Volume, to_kernels};

const LEVEL: f64 = 1.0 / 255.0;

/// Faint casting, ribs and strong bolts.
const ENGINE: &str = "transfer 1
strength opacity_per_unit
color srgb
0    0    0    0     0
8    0    0    0     0
20   0.45 0.5  0.6   0.006
60   0.5  0.5  0.55  0.01
80   0.55 0.45 0.35  0.02
140  0.75 0.65 0.5   0.05
180  0.9  0.85 0.8   0.08
220  0.95 0.4  0.2   0.6
255  1.0  0.5  0.2   0.8
";

/// The direction that all are seen from.
const FROM: DVec3 = DVec3::new(330.0, -412.5, 288.75);

/// Eight rows of a picture of 256² whose camera is this far away.
fn camera(target: DVec3, distance: f64, first_row: u32) -> Camera {
    let pose = Pose::look_at(target + FROM.normalize() * distance, target, DVec3::Z).unwrap();
    let whole = Camera::perspective(pose, 30f64.to_radians(), [256; 2]).unwrap().intrinsics();
    let intrinsics = Intrinsics { center: whole.center - DVec2::Y * f64::from(first_row), ..whole };
    Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, [256, 8]).unwrap()
}

/// The same with other strengths.
fn strengthened(transfer: &TransferFunction, strength: impl Fn(f32) -> f32) -> TransferFunction {
    let point = |point: &ControlPoint| ControlPoint { strength: strength(point.strength), ..*point };
    let points = transfer.points().iter().map(point).collect();
    TransferFunction::new(points, transfer.strength(), transfer.color_space()).unwrap()
}

fn errors(a: &Frame, b: &Frame) -> Metrics {
    let [a, b] = [a, b].map(|frame| {
        let display = frame.color.iter().flat_map(|c| [c[0], c[1], c[2]].map(linear_to_srgb));
        display.collect::<Vec<f32>>()
    });
    let picture = |values| Pixels { width: 256, height: 8, channels: 3, values };
    compare(picture(&a), picture(&b)).unwrap()
}

/// What was found: of slabs of two σ as anyone draws them; and of orders where nothing else errs: exact footprints, kernels
/// cut off where nothing is left of them, nothing left out.
struct Found {
    drawn: Metrics,
    centers: Metrics,
    /// 2.45, 2, 1.5 and 1 σ thick.
    slabs: [Metrics; 4],
}

const THICKNESSES: [f64; 4] = [2.45, 2.0, 1.5, 1.0];

fn find(name: &str, volume: &Volume, transfer: &TransferFunction, camera: &Camera) -> Found {
    let cloud = to_kernels(volume, transfer, &KernelSettings::default()).unwrap();
    let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
    let background = [0.0, 0.0, 0.0, 1.0];
    let usual = RenderSettings { blend: Blend::Display, background, ..RenderSettings::default() };
    let r1 = reference(&scene, camera, &usual, ReferenceKind::R1, &|_| ()).unwrap();
    let bare = RenderSettings { footprint: FootprintForm::Exact, cutoff: 30.0, tolerance: 0.0, ..usual };
    let found = |what: &str, settings: RenderSettings, order: Order| {
        let settings = RenderSettings { order, ..settings };
        let found = errors(&render(&scene, camera, &settings, &()).unwrap(), &r1);
        println!(
            "{name}, {what} {order:?}: {:.1} dB, 99.9 % {:.5}, mean {:.2e}",
            found.psnr_db, found.p999_error, found.mean_error
        );
        found
    };
    Found {
        drawn: found("as drawn", usual, Order::Slabs { thickness: 2.0 }),
        centers: found("alone", bare, Order::Centers),
        slabs: THICKNESSES.map(|thickness| found("alone", bare, Order::Slabs { thickness })),
    }
}

fn assert_close(Found { drawn, centers, slabs: [whole, tent, _, thin] }: &Found) {
    assert!(drawn.psnr_db >= 55.0 && tent.psnr_db >= 55.0, "{drawn:?} {tent:?}");
    for (found, most) in [(whole, 0.7), (tent, 1.0 / 8.0), (thin, 1.0 / 50.0)] {
        let share = found.mean_error / centers.mean_error;
        assert!(share <= most, "{share} of the error of centres, not {most}: {found:?}");
    }
}

fn engine(times: i32) -> Option<Found> {
    let volume = real_engine()?;
    let transfer = strengthened(&ENGINE.parse().unwrap(), |opacity| 1.0 - (1.0 - opacity).powi(times));
    let camera = camera(DVec3::new(127.5, 127.5, 63.5), FROM.length(), 80);
    Some(find(&format!("engine, {times} times"), &volume, &transfer, &camera))
}

#[test]
fn slabs_of_the_engine_are_ahead() {
    let Some(found) = engine(1) else { return };
    assert_close(&found);
    assert!(found.drawn.p999_error <= LEVEL && found.slabs[1].p999_error <= LEVEL);
}

#[test]
fn slabs_of_the_engine_are_ahead_at_ten_times_the_extinction() {
    let Some(found) = engine(10) else { return };
    assert_close(&found);
    // Slabs of two σ are off by up to three levels where it is as dense as this.
    assert!(found.slabs[2].p999_error <= LEVEL);
}

#[test]
fn slabs_of_the_head_are_ahead() {
    let Some(volume) = real_head() else { return };
    let transfer = PRESETS.iter().find(|preset| preset.name == "bone").unwrap().fit(&volume).unwrap();
    let found = find("head", &volume, &transfer, &camera(DVec3::new(128.0, 128.0, 112.0), 800.0, 120));
    assert_close(&found);
    assert!(found.drawn.p999_error <= LEVEL && found.slabs[1].p999_error <= LEVEL);
}
