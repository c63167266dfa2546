//! What is drawn to be compared: fog, trained splats, sheets.

use crate::closed::Closed;
use crate::cloud::{Cloud, Material, OpacityFilter, Shapes, Splats, Strength, Surface, oblate_factor};
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};

fn number(i: usize, k: f64) -> f32 {
    let x = (i as f64 + 0.37) * k;
    ((x - x.floor()) * 2.0 - 1.0) as f32
}

fn spot(i: usize) -> Vec3 {
    Vec3::new(number(i, 0.754_877_67), number(i, 0.569_840_29), number(i, 0.437_016_02))
}

fn color(i: usize) -> [f32; 3] {
    [0.127, 0.311, 0.233].map(|k| number(i, k) * 0.5 + 0.5)
}

fn cloud(centers: Vec<Vec3>, shapes: Shapes, strength: Strength) -> Cloud {
    let colors = (0..centers.len()).map(color).collect();
    let (harmonics, normals, material) = (None, None, Material::UNLIT);
    Cloud::new(Splats { centers, shapes, strength, colors, harmonics, normals, material }).unwrap()
}

pub(super) fn fog(mass: f32) -> Cloud {
    let count = 400;
    let strength = Strength::Extinction { masses: vec![mass; count] };
    let factor = Mat3::from_diagonal(Vec3::new(0.12, 0.1, 0.14));
    cloud((0..count).map(spot).collect(), Shapes::Shared(factor), strength)
}

pub(super) fn trained() -> Cloud {
    let count = 200;
    let shape = |i| oblate_factor(spot(i + 3), 0.16 + 0.1 * number(i, 0.71), 1.0 + (i % 5) as f32);
    let peaks = (0..count).map(|i| 0.5 + 0.49 * number(i, 0.618)).collect();
    let (filter, least) = (OpacityFilter::Compensated, Strength::LEAST_OF_TRAINED);
    cloud(
        (0..count).map(spot).collect(),
        Shapes::Each((0..count).map(shape).collect()),
        Strength::Opacity { peaks, filter, least },
    )
}

pub(super) fn sheet(opacity: f32, degrees: f64, shift: f64) -> Cloud {
    let (side, spacing) = (40, 0.06_f32);
    let place = |i: usize| Vec3::new((i % side) as f32 - 19.5, (i / side) as f32 - 19.5, 0.0) * spacing;
    let strength = Strength::Surface(Surface {
        areas: vec![spacing * spacing; side * side],
        opacities: Some(vec![opacity; side * side]),
        depth_tolerance: 0.8 * spacing,
        coverage_floor: 0.98,
        closed: Closed::Nowhere,
    });
    let shape = Shapes::Shared(oblate_factor(Vec3::NEG_Z, 0.8 * spacing, f32::INFINITY));
    let turned = DMat3::from_rotation_x(f64::to_radians(degrees));
    cloud((0..side * side).map(place).collect(), shape, strength)
        .transformed(DAffine3::from_mat3_translation(turned, DVec3::Z * shift))
}
