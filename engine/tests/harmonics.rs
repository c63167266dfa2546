//! Splats whose colours depend on the view: the rasterizer against R1, which evaluates them by another formula.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use oblate_engine::{
    Blend, Camera, Cloud, FootprintForm, Frame, Harmonics, Material, OpacityFilter, Pose, ReferenceKind,
    RenderSettings, Scene, Shapes, Splats, Strength, reference, render,
};
use scenes::unshaded;

const SPLATS: usize = 36;

/// Each coefficient is at most this: the functions' squares sum to at most 15/4π, so colours change by at most
/// √(15 · 15/4π)/4 = 1.06 (Cauchy–Schwarz).
const LARGEST: f32 = 0.25;

/// A number in [0, 1) that looks random.
fn random(seed: usize) -> f32 {
    ((seed as f64 * 12.9898).sin() * 43758.5453).rem_euclid(1.0) as f32
}

fn trained(degree: u8) -> Splats {
    let signed = |seed: usize| 2.0 * random(seed) - 1.0;
    let vector = |seed: usize| Vec3::new(signed(3 * seed), signed(3 * seed + 1), signed(3 * seed + 2));
    let per_splat = (usize::from(degree) + 1).pow(2) - 1;
    let color = |seed: usize| [0, 1, 2].map(|channel| LARGEST * signed(5000 + 3 * seed + channel));
    let factor = |i: usize| {
        let rotation = Mat3::from_axis_angle(vector(100 + i).normalize(), 3.0 * random(i));
        rotation * Mat3::from_diagonal(vector(200 + i).abs() * 0.25 + 0.05)
    };
    Splats {
        centers: (0..SPLATS).map(vector).collect(),
        shapes: Shapes::Each((0..SPLATS).map(factor).collect()),
        strength: Strength::Opacity {
            peaks: (0..SPLATS).map(|i| 0.2 + 0.7 * random(900 + i)).collect(),
            filter: OpacityFilter::Compensated,
            least: 0.0,
        },
        colors: (0..SPLATS).map(|i| vector(400 + i).abs().to_array()).collect(),
        harmonics: Some(Harmonics { degree, coefficients: (0..SPLATS * per_splat).map(color).collect() }),
        normals: None,
        material: Material::UNLIT,
    }
}

fn cameras() -> Vec<Camera> {
    let eyes = [DVec3::new(2.5, 2.0, -4.5), DVec3::new(-3.0, 1.0, 4.0), DVec3::new(0.5, -5.0, 0.2)];
    let pose = |eye| Pose::look_at(eye, DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0)).unwrap();
    let both = |eye| {
        [
            Camera::perspective(pose(eye), 0.6, [32; 2]).unwrap(),
            Camera::orthographic(pose(eye), 3.0, [32; 2]).unwrap(),
        ]
    };
    eyes.into_iter().flat_map(both).collect()
}

/// The largest difference of a channel.
fn apart(a: &Frame, b: &Frame) -> f32 {
    let channels = a.color.iter().flatten().zip(b.color.iter().flatten());
    channels.map(|(p, q)| (p - q).abs()).fold(0.0, f32::max)
}

#[test]
fn the_rasterizer_and_r1_see_the_same_colours() {
    let turned = DAffine3::from_mat3_translation(
        DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 2.0),
        DVec3::new(0.2, -0.1, 0.1),
    );
    let mirrored = turned * DAffine3::from_scale(DVec3::new(-1.1, 0.9, 1.0));
    for degree in 1..=3 {
        for (to_world, blend) in [
            (DAffine3::IDENTITY, Blend::Linear),
            (turned, Blend::Display),
            (mirrored, Blend::Linear),
            (mirrored, Blend::Display),
        ] {
            let splats = trained(degree);
            let plain = Cloud::new(Splats { harmonics: None, ..splats.clone() }).unwrap();
            let cloud = Cloud::new(splats).unwrap().transformed(to_world);
            let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
            let plain = Scene { clouds: vec![plain.transformed(to_world)], lights: Vec::new() };
            // Everything off by which the rasterizer trades accuracy: what is left of e^{−20} is nothing.
            let settings = RenderSettings {
                cutoff: 40.0,
                footprint: FootprintForm::Exact,
                tolerance: 0.0,
                blend,
                ..unshaded()
            };
            // Single precision: pixels and conics are right to 1e-5 of a pixel, which changes an opacity by 1e-5 at
            // most where σ is half a pixel or more, as filtered splats have it; about ten overlap. That is 1e-4
            // of the range of colours: display values up to 1 + 1.06, in linear light 5.3. Decoding a mean of
            // display values has slopes up to 2.4/1.055 · (2.115/1.055)^1.4 = 6.
            let bound = match blend {
                Blend::Linear => 1e-4 * 5.3,
                Blend::Display => 1e-4 * 2.06 * 6.0,
            };
            for camera in cameras() {
                let frame = render(&scene, &camera, &settings, &()).unwrap();
                let r1 = reference(&scene, &camera, &settings, ReferenceKind::R1, &|_| ()).unwrap();
                let error = apart(&frame, &r1);
                assert!(error <= bound, "degree {degree}, {blend:?}: {error}");
                // They are seen at all.
                assert!(apart(&frame, &render(&plain, &camera, &settings, &()).unwrap()) > 0.05);
            }
        }
    }
}
