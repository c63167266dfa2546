//! The references against answers that are numbers.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

use glam::{DAffine3, DMat3, DVec2, DVec3, Mat3, Vec3};
use oblate_engine::SceneError;
use oblate_engine::cloud::oblate_factor;
use oblate_engine::color::{linear_to_srgb, srgb_to_linear};
use oblate_engine::reference::{ReferenceKind, reference};
use oblate_engine::{
    Blend, Camera, Closed, Cloud, Frame, Harmonics, Intrinsics, Light, Material, OpacityFilter, Pose,
    Projection, RenderSettings, Scene, Shapes, Splats, Strength, Surface,
};
use std::f64::consts::TAU;
use std::sync::Mutex;

mod depths;
mod harmonics;
mod pictures;
mod surfaces;
mod volumes;

/// Camera space is the world.
const POSE: Pose = Pose { world_to_camera: DAffine3::IDENTITY };

fn camera(projection: Projection, focal: f64, size: u32) -> Camera {
    let center = DVec2::splat(f64::from(size) / 2.0);
    let intrinsics = Intrinsics { focal: DVec2::splat(focal), center };
    Camera::from_intrinsics(POSE, intrinsics, projection, [size, size]).unwrap()
}

fn perspective(focal: f64, size: u32) -> Camera {
    camera(Projection::Perspective, focal, size)
}

fn orthographic(focal: f64, size: u32) -> Camera {
    camera(Projection::Orthographic, focal, size)
}

/// Without light, and with surfels that end where nothing is left of them.
fn unlit(low_pass: f64) -> RenderSettings {
    RenderSettings { shade: false, low_pass, outline: 50.0, ..RenderSettings::default() }
}

fn draw(clouds: Vec<Cloud>, camera: &Camera, settings: &RenderSettings) -> Frame {
    let scene = Scene { clouds, lights: Vec::new() };
    reference(&scene, camera, settings, ReferenceKind::R1, &|_| {}).unwrap()
}

fn cloud(centers: Vec<Vec3>, shapes: Shapes, strength: Strength, colors: Vec<[f32; 3]>) -> Cloud {
    let material = Material::default();
    Cloud::new(Splats { centers, shapes, strength, colors, harmonics: None, normals: None, material })
        .unwrap()
}

/// Round kernels of one σ and mass.
fn kernels(centers: &[Vec3], sigma: f32, mass: f32, colors: &[[f32; 3]]) -> Cloud {
    let strength = Strength::Extinction { masses: vec![mass; centers.len()] };
    cloud(centers.to_vec(), Shapes::Shared(Mat3::IDENTITY * sigma), strength, colors.to_vec())
}

fn opacity_kernels(centers: &[Vec3], sigma: f32, peak: f32, colors: &[[f32; 3]]) -> Cloud {
    let strength = Strength::Opacity {
        peaks: vec![peak; centers.len()],
        filter: OpacityFilter::Compensated,
        least: 0.0,
    };
    cloud(centers.to_vec(), Shapes::Shared(Mat3::IDENTITY * sigma), strength, colors.to_vec())
}

/// A square lattice of surfels, unit distance apart, in the plane through `center` with `normal`.
/// With σ = 0.8 the sum of their coverage is 1 within 4 exp(−2π² 0.64) = 1.3e-5.
fn plane(center: Vec3, normal: Vec3, half: i32, opacity: f32, color: [f32; 3]) -> Cloud {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let centers: Vec<Vec3> = (-half..=half)
        .flat_map(|i| (-half..=half).map(move |j| center + tangent * i as f32 + bitangent * j as f32))
        .collect();
    let count = centers.len();
    let surface = Surface {
        areas: vec![1.0; count],
        opacities: Some(vec![opacity; count]),
        depth_tolerance: 0.8,
        coverage_floor: 0.99,
        closed: Closed::Nowhere,
    };
    let shape = Shapes::Shared(oblate_factor(normal, 0.8, f32::INFINITY));
    let mut splats = cloud(centers, shape, Strength::Surface(surface), vec![color; count]).splats();
    splats.normals = Some(vec![normal; count]);
    Cloud::new(splats).unwrap()
}

/// The same surfels, each standing for half the area.
fn thinned(sheet: &Cloud) -> Cloud {
    let mut splats = sheet.splats();
    let Strength::Surface(surface) = &mut splats.strength else { unreachable!() };
    surface.areas.iter_mut().for_each(|area| *area *= 0.5);
    Cloud::new(splats).unwrap()
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b} within {tolerance}");
}

fn same_picture(a: &Frame, b: &Frame, tolerance: f64) {
    for (p, q) in a.color.iter().flatten().zip(b.color.iter().flatten()) {
        close(f64::from(*p), f64::from(*q), tolerance);
    }
}

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
const WHITE: [f32; 3] = [1.0; 3];
