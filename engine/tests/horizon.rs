//! A plane seen nearly edge-on, of surfels that are smaller than a pixel: the pixel's filter reaches over the horizon, where the
//! plane's rays end.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, Closed, Cloud, FootprintForm, Frame, Material, Pose, ReferenceKind, RenderSettings, Scene,
    Shapes, Splats, Strength, Surface, reference,
};
use scenes::{draw, unshaded};

/// Pixels along a side; the horizon lies in the middle.
const SIDE: u32 = 12;
const FOCAL: f64 = 100.0;

/// How far below the horizon the plane begins and ends, in pixels, and how far apart surfels are there.
const FROM: f64 = 2.25;
const TO: f64 = 0.25;
const STEP: f64 = 0.125;

/// A plane 1 below the eye: surfels a step apart in the picture, each with the area and covariance of its patch.
fn ground() -> Cloud {
    let (mut centers, mut factors, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    let rows = ((FROM - TO) / STEP) as usize;
    for row in 0..rows {
        let [near, far] = [row, row + 1].map(|i| FOCAL / (FROM - STEP * i as f64));
        let (middle, length) = (0.5 * (near + far), far - near);
        let width = STEP * middle / FOCAL;
        for column in -80..80 {
            let x = (f64::from(column) + 0.5) * width;
            centers.push(DVec3::new(x, -1.0, -middle).as_vec3());
            let deviations = DVec3::new(width, 0.0, length) / 12f64.sqrt();
            factors.push(Mat3::from_cols(
                Vec3::Z * deviations.z as f32,
                Vec3::X * deviations.x as f32,
                Vec3::ZERO,
            ));
            areas.push((width * length) as f32);
        }
    }
    let surface = Surface {
        areas,
        opacities: None,
        depth_tolerance: 400.0,
        coverage_floor: 1.0,
        closed: Closed::Nowhere,
    };
    Cloud::new(Splats {
        colors: vec![[1.0; 3]; centers.len()],
        centers,
        shapes: Shapes::Each(factors),
        strength: Strength::Surface(surface),
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

#[test]
fn what_lies_beyond_the_horizon_takes_nothing_of_the_plane() {
    let pose = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y).unwrap();
    let fov = 2.0 * (f64::from(SIDE) / 2.0 / FOCAL).atan();
    let camera = Camera::perspective(pose, fov, [SIDE; 2]).unwrap();
    let ground = ground();
    let scene = Scene { clouds: vec![ground.clone()], lights: Vec::new() };
    let settings = |footprint| RenderSettings { footprint, ..unshaded() };
    let r1 = reference(&scene, &camera, &unshaded(), ReferenceKind::R1, &|_| ()).unwrap();
    let forms = [FootprintForm::Affine, FootprintForm::Auto, FootprintForm::Exact];
    let drawn = forms.map(|form| (format!("{form:?}"), draw(vec![ground.clone()], &camera, &settings(form))));
    for (name, frame) in [("R1".to_string(), r1)].into_iter().chain(drawn) {
        let Frame { color, .. } = &frame;
        for row in 0..SIDE {
            // A pixel's filter and a surfel's patch over a band of the picture.
            let below = f64::from(row) + 0.5 - f64::from(SIDE) / 2.0;
            let sigma = (0.3_f64 + STEP * STEP / 6.0).sqrt();
            let expected = normal_cdf((FROM - below) / sigma) - normal_cdf((TO - below) / sigma);
            let found = f64::from(color[(row * SIDE + SIDE / 2) as usize][3]);
            println!("{name}, {below} pixels below: {found:.4} for {expected:.4}");
            // The middle of the last row lies 0.0125 pixels from its row's, where α changes by 0.7 a pixel at most.
            assert!((found - expected).abs() < 0.01, "{name}, row {row}: {found}, not {expected}");
        }
    }
}
