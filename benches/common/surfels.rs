//! Opaque surfels: half of them on a torus, half on a sphere that it surrounds, in random order.

use glam::Vec3;
use oblate::chart::scenes::random::Random;
use oblate::engine::cloud::oblate_factor;
use oblate::engine::{Closed, Material, Shapes, Splats, Strength, Surface};
use std::f32::consts::{PI, TAU};

/// Where a surfel is: at two angles of the torus, or in a direction from the middle of the sphere.
pub(crate) enum Place {
    Torus([f32; 2]),
    Sphere(Vec3),
}

/// In wholly random places, which have holes. All are as large as they may be on a million.
pub(crate) fn torus_and_sphere(count: usize) -> Splats {
    let mut random = Random(3);
    let places = (0..count).map(|i| match i % 2 {
        0 => Place::Torus([random.uniform(0.0, TAU), random.uniform(0.0, TAU)]),
        _ => Place::Sphere(random.direction()),
    });
    let radius = 0.006 * (1e6 / count as f32).sqrt();
    surfels_at(places.collect(), |_| radius / 2.0, (radius, 0.2))
}

/// The share of one of so many surfels, on the torus in the mean.
pub(crate) fn on_torus(count: usize) -> f32 {
    8.0 * PI * PI * 0.35 / count as f32
}

/// Surfels of a standard deviation by area, and their depth tolerance and coverage floor.
pub(crate) fn surfels_at(
    places: Vec<Place>,
    sigma: impl Fn(f32) -> f32,
    (depth_tolerance, coverage_floor): (f32, f32),
) -> Splats {
    let (mut centers, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let mut areas = Vec::new();
    let on_torus = on_torus(places.len());
    let on_sphere = 2.0 * PI / places.len() as f32;
    for place in places {
        match place {
            Place::Torus([u, w]) => {
                let normal = Vec3::new(w.cos() * u.cos(), w.cos() * u.sin(), w.sin());
                centers.push(Vec3::new(u.cos(), u.sin(), 0.0) + normal * 0.35);
                normals.push(normal);
                areas.push(on_torus * (1.0 + 0.35 * w.cos()));
                colors.push([3.0 * u, 3.0 * u + 2.0, 2.0 * w + 4.0].map(|x| 0.5 + 0.45 * x.cos()));
            }
            Place::Sphere(normal) => {
                centers.push(normal * 0.5 + Vec3::Z * 0.55);
                normals.push(normal);
                areas.push(on_sphere);
                colors.push((0.5 + 0.4 * (normal * 9.0).map(f32::sin)).to_array());
            }
        }
    }
    let shape = |(n, area): (&Vec3, &f32)| oblate_factor(*n, sigma(*area), f32::INFINITY);
    Splats {
        shapes: Shapes::Each(normals.iter().zip(&areas).map(shape).collect()),
        strength: Strength::Surface(Surface {
            areas,
            opacities: None,
            depth_tolerance,
            coverage_floor,
            closed: Closed::EVERYWHERE,
        }),
        centers,
        colors,
        harmonics: None,
        normals: Some(normals),
        material: Material::default(),
    }
}
