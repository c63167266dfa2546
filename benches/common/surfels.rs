//! Opaque surfels: half of them on a torus, half on a sphere that it surrounds, in random places and random order.

use glam::Vec3;
use oblate::chart::scenes::random::Random;
use oblate::engine::cloud::oblate_factor;
use oblate::engine::{Closed, Material, Shapes, Splats, Strength, Surface};
use std::f32::consts::{PI, TAU};

pub(crate) fn torus_and_sphere(count: usize) -> Splats {
    let mut random = Random(3);
    let radius = 0.006 * (1e6 / count as f32).sqrt();
    let (mut centers, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let [on_torus, on_sphere] = [4.0 * PI * PI * 0.35, PI].map(|area| 2.0 * area / count as f32);
    let mut areas = Vec::new();
    for i in 0..count {
        if i % 2 == 0 {
            let [u, w] = [random.uniform(0.0, TAU), random.uniform(0.0, TAU)];
            let normal = Vec3::new(w.cos() * u.cos(), w.cos() * u.sin(), w.sin());
            centers.push(Vec3::new(u.cos(), u.sin(), 0.0) + normal * 0.35);
            normals.push(normal);
            areas.push(on_torus * (1.0 + 0.35 * w.cos()));
            colors.push([3.0 * u, 3.0 * u + 2.0, 2.0 * w + 4.0].map(|x| 0.5 + 0.45 * x.cos()));
        } else {
            let normal = random.direction();
            centers.push(normal * 0.5 + Vec3::Z * 0.55);
            normals.push(normal);
            areas.push(on_sphere);
            colors.push((0.5 + 0.4 * (normal * 9.0).map(f32::sin)).to_array());
        }
    }
    Splats {
        shapes: Shapes::Each(
            normals.iter().map(|n| oblate_factor(*n, radius / 2.0, f32::INFINITY)).collect(),
        ),
        strength: Strength::Surface(Surface {
            areas,
            opacities: None,
            depth_tolerance: radius,
            // Wholly random places have holes.
            coverage_floor: 0.2,
            closed: Closed::EVERYWHERE,
        }),
        centers,
        colors,
        harmonics: None,
        normals: Some(normals),
        material: Material::default(),
    }
}
