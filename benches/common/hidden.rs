//! Scenes of which most is hidden.

use super::volumes::data;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use oblate::engine::cloud::oblate_factor;
use oblate::engine::{Closed, Cloud, Material, Shapes, Splats, Strength, Surface};
use oblate::importers::{Content, OpenOptions, open};
use oblate::surfels::{Density, SamplerSettings, sample};
use std::f64::consts::PI;

/// The mesh that fills the room.
pub(crate) const ARMADILLO: &str = "meshes/armadillo.obj";

/// Closed spheres in each other, of the same number of surfels an area.
pub(crate) fn nested_spheres() -> Vec<Cloud> {
    (0..8).map(|i| sphere(1.0 - 0.1 * i as f32, [0.2 + 0.1 * i as f32, 0.8 - 0.1 * i as f32, 0.5])).collect()
}

fn sphere(radius: f32, color: [f32; 3]) -> Cloud {
    let count = (1_500_000.0 * radius * radius) as usize;
    let golden = PI * (3.0 - 5f64.sqrt());
    let normal = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let across = (1.0 - z * z).sqrt();
        DVec3::new(cos * across, sin * across, z).as_vec3()
    };
    let normals: Vec<Vec3> = (0..count).map(normal).collect();
    let area = 4.0 * PI as f32 * radius * radius / count as f32;
    let sigma = 0.8 * area.sqrt();
    let splats = Splats {
        centers: normals.iter().map(|normal| *normal * radius).collect(),
        shapes: Shapes::Each(normals.iter().map(|n| oblate_factor(*n, sigma, f32::INFINITY)).collect()),
        strength: Strength::Surface(Surface {
            areas: vec![area; count],
            opacities: None,
            depth_tolerance: sigma,
            coverage_floor: 0.95,
            closed: Closed::EVERYWHERE,
        }),
        colors: vec![color; count],
        harmonics: None,
        normals: Some(normals),
        material: Material::default(),
    };
    Cloud::new(splats.in_morton_order()).expect("the numbers are finite")
}

/// Twelve rows of thirteen armadillos each, which share their surfels, one unit tall.
pub(crate) fn room_of_armadillos() -> Vec<Cloud> {
    let opened = open(data(ARMADILLO), &OpenOptions::default()).expect("it was there");
    let Content::Mesh(mesh) = opened.content else { panic!("{ARMADILLO} is a mesh") };
    let [low, high] = mesh.bounds().expect("it is not empty");
    let one = sample(&mesh, Density::Count(250_000), &SamplerSettings::default()).expect("it has an area");
    let to_middle = DAffine3::from_translation(-0.5 * (low + high));
    let scale = DVec3::splat(1.0 / (high - low).max_element());
    let place = |i: usize| {
        let [column, row] = [i % 13, i / 13].map(|n| n as f64);
        let shift = DVec3::new(0.7 * (column - 6.0) + 0.3 * (row % 2.0), 0.0, 0.8 * row);
        let turn = DQuat::from_rotation_y(7.0 * column + 3.0 * row);
        one.clone().transformed(DAffine3::from_scale_rotation_translation(scale, turn, shift) * to_middle)
    };
    (0..12 * 13).map(place).collect()
}
